"""The base model's laws in the header: each declared once, for its C and for its replay.

The C of a `BaseLaw` is its function of `sysid.plant.base` evaluated on the names of the header's
constants, its replay the same function on their values.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

from sysid.exporters.c_constants import parameter_values, read_constants
from sysid.exporters.c_text import KEPT, Names, comment_text, indented, real, wrapped
from sysid.exporters.flat import Flat, NumberTable, gravity_name, spring_names
from sysid.exporters.replay import Replay, simple
from sysid.io.motion import FRICTION
from sysid.plant import base, valve_laws
from sysid.plant.base import Array, Parameters, ValveParameters, array_namespace


@dataclass(frozen=True)
class BaseLaw:
    """A function of the header, present where all constants of `needs` are known.

    `arguments`: C name -> kind (`vectors.draws`). `evaluate` takes the model's parameters and them.
    """

    feature: str
    name: str
    meaning: str
    needs: tuple[str, ...]
    arguments: dict[str, str]
    evaluate: Callable[..., Array]

    def replay(self, p: Parameters) -> Replay:
        """Its replay, with these parameters."""
        return simple(
            self.name, tuple(self.arguments.values()), lambda *values: self.evaluate(p, *values)
        )

    def text(self, flat: Flat, n: Names) -> str:
        """Its C."""
        from sysid.exporters.c_printer import traced
        from sysid.exporters.symbolic import expression, symbol

        values: dict[str, Any] = parameter_values(flat, flat.constants)
        constants = read_constants(flat).items()
        values |= {key: symbol(f"{n.lower}{name}") for key, name in constants}
        result = expression(self.evaluate(Parameters(**values), *map(symbol, self.arguments)))
        lines, (answer,) = traced((), [result], n)
        read = {str(name) for name in result.free_symbols}
        unused = [f"(void){name};" for name in self.arguments if name not in read]
        r = real(n)
        inputs = ", ".join(f"{r}{KEPT}{name}" for name in self.arguments)
        head = "\n    ".join(wrapped(f"static inline {r} {n.lower}{self.name}({inputs})"))
        head = head.replace(KEPT, " ")
        comment = "\n   ".join(comment_text(line) for line in wrapped(f"{self.meaning}."))
        body = indented([*unused, *lines, f"return {answer};"])
        return f"/* {comment} */\n{head}\n{{\n{body}\n}}\n"


def law_replays(flat: Flat, constants: NumberTable, features: Collection[str]) -> Iterator[Replay]:
    """The replays of every base law in the header, with the header's own constants."""
    p = Parameters(**parameter_values(flat, constants))
    laws = [*mechanics(flat)]
    for side in flat.valves:
        laws += [*valve_flows(flat, side), *chamber(flat, side)]
    yield from (law.replay(p) for law in laws if law.feature in features)


def _motion(flat: Flat) -> tuple[str, str]:
    """C names of position and velocity."""
    return ("position_m", "velocity_m_s") if flat.rig.is_linear else ("theta_rad", "omega_rad_s")


def mechanics(flat: Flat) -> Iterator[BaseLaw]:
    """The efforts of cylinder, gravity and friction."""
    u, (position, velocity) = flat.rig.units, _motion(flat)
    word, suffix, unit = u.word, u.suffix, u.effort
    resists = "gravity" if flat.rig.spring_law is None else "gravity - spring"
    static, coulomb, viscous = (f"friction_{u.key(name)}" for name in FRICTION)
    if len(flat.rig.sides) == 1:
        yield BaseLaw(
            "HAS_CYLINDER",
            f"cylinder_{word}",
            f"{word.capitalize()} of the cylinder, {unit}, from an absolute pressure, Pa (3.3.3); "
            "its other side is at the atmosphere",
            ("area_a_m2", "pitch_radius_m", "atmospheric_pressure_pa"),
            {"pressure_a_pa": "pressure"},
            lambda p, a: base.cylinder_effort(
                a, p.atmosphere, p.area_a, 0.0, p.atmosphere, p.pitch_radius
            ),
        )
    else:
        yield BaseLaw(
            "HAS_CYLINDER",
            f"cylinder_{word}",
            f"{word.capitalize()} of the cylinder, {unit}, from absolute pressures, Pa (3.3.3)",
            ("area_a_m2", "area_b_m2", "pitch_radius_m", "atmospheric_pressure_pa"),
            {"pressure_a_pa": "pressure", "pressure_b_pa": "pressure"},
            lambda p, a, b: base.cylinder_effort(
                a, b, p.area_a, p.area_b, p.atmosphere, p.pitch_radius
            ),
        )
    where = "the weight" if flat.rig.is_linear else "theta = 0 hangs down"
    yield BaseLaw(
        "HAS_GRAVITY",
        f"gravity_{word}",
        f"{word.capitalize()} of gravity against positive motion, {unit} (3.3.8-10): {where}",
        (gravity_name(flat.rig)[0],),
        {position: "position"},
        lambda p, q: base.gravity_effort(q, p.gravity_moment, p.weight) + 0.0 * q,
    )
    if flat.rig.spring_law is not None:
        yield BaseLaw(
            "HAS_SPRING",
            f"spring_{word}",
            f"{word.capitalize()} of the return spring against positive motion, {unit}",
            spring_names(flat.rig),
            {position: "position"},
            lambda p, q: base.spring_effort(q, p.stiffness, p.preload),
        )
    yield BaseLaw(
        "HAS_SLIDING_FRICTION",
        f"sliding_friction_{word}",
        f"Friction while moving, {unit} (3.4.1): Coulomb sign(w) + viscous w; 0 at rest",
        (coulomb, viscous),
        {velocity: "velocity"},
        lambda p, w: base.sliding_friction(
            w, array_namespace(w).sign(w), p.coulomb_effort, p.viscous
        ),
    )
    yield BaseLaw(
        "HAS_FRICTION",
        f"friction_{word}",
        f"Friction in full, {unit} (3.4.1, corrected). applied = cylinder + motor - {resists}, "
        f"less the constant friction_offset_{suffix} where it is known. At rest friction holds "
        f"against what is applied, up to friction_static_{suffix}",
        (static, coulomb, viscous),
        {velocity: "velocity", f"applied_{suffix}": "effort"},
        lambda p, w, applied: base.friction_effort(
            w, applied, p.static_effort, p.coulomb_effort, p.viscous
        ),
    )


def valve_flows(flat: Flat, side: str) -> Iterator[BaseLaw]:
    """Flow of one valve, on and off, by the law of each direction."""
    held, upper, name = flat.valves[side].discrete, side.upper(), f"valve_{side}"
    iso = {way: f"sonic_conductance_{way}" in held for way in ("fill", "dis")}
    own = {way: (f"valve_{side}_valve_c_{way}",) * (f"valve_c_{way}" in held) for way in iso}
    chokes = "; with its flow control it chokes by the pressure between the two"
    # Each of two valves has its own command, and none flows while both are off.
    one, two = ("valve on", "valve off"), ("fill valve on", "bleed valve on")
    fills, empties = two if flat.rig.bleeds else one
    yield BaseLaw(
        f"HAS_VALVE_{upper}_FILLING",
        f"{name}_filling_flow",
        f"Flow into chamber {upper}, kg/s, with the {fills} "
        + (
            "(ISO 6358), choked up to its critical ratio of the supply; negative above the supply"
            if iso["fill"]
            else "(3.6.6). Choked up to 0.53 of the supply, in proportion to it; negative above "
            f"the supply{chokes if own['fill'] else ''}"
        ),
        (
            *(_iso_needs(side, "fill") if iso["fill"] else _thesis_needs(flat, side, "fill")),
            *own["fill"],
            "supply_pressure_pa",
        ),
        {"pressure_pa": "pressure", "supply_pa": "supply"},
        lambda p, pressure, supply: valve_laws.filling_flow(
            _valve(flat, p, side), pressure, supply, p.supply_reference, temperature=p.temperature
        ),
    )
    yield BaseLaw(
        f"HAS_VALVE_{upper}_EXHAUST",
        f"{name}_exhaust_flow",
        f"Flow into chamber {upper}, kg/s, with the {empties} "
        + (
            "(ISO 6358): negative (out) above the atmosphere, and in proportion to the pressure "
            "where it is choked; air comes in below it"
            if iso["dis"]
            else "(3.6.7, 3.6.10): negative (out) above the atmosphere, choked from atmosphere / "
            f"0.53 on; air comes in below it{chokes if own['dis'] else ''}"
        ),
        (
            *(_iso_needs(side, "dis") if iso["dis"] else _thesis_needs(flat, side, "dis")),
            *own["dis"],
        ),
        {"pressure_pa": "pressure", "atmosphere_pa": "atmosphere"},
        lambda p, pressure, atmosphere: valve_laws.exhaust_flow(
            _valve(flat, p, side), pressure, atmosphere, temperature=p.temperature
        ),
    )


def _iso_needs(side: str, way: str) -> tuple[str, ...]:
    quantities = ("sonic_conductance", "critical_ratio", "subsonic_index")
    return (*(f"valve_{side}_{quantity}_{way}" for quantity in quantities), "temperature_k")


def _thesis_needs(flat: Flat, side: str, way: str) -> tuple[str, ...]:
    unchoked = f"valve_{side}_c_{way}"
    if _is_never_choked(flat, side, way):
        return unchoked, "supply_pressure_pa" if way == "fill" else "atmospheric_pressure_pa"
    return f"valve_{side}_choked_flow_{way}_kg_s", unchoked


def _is_never_choked(flat: Flat, side: str, way: str) -> bool:
    """Whether the chamber's pressure reaches no choked flow, of which no test says anything."""
    held = flat.valves[side].discrete
    is_known = held[f"choked_flow_{way}_kg_s"].value is not None
    return flat.rig.air is not None and flat.rig.supply_way < 0.0 and not is_known


def _valve(flat: Flat, p: Parameters, side: str) -> ValveParameters:
    """A valve; beyond what a vacuum's chamber reaches its law is continuous, as in the model."""
    valve = p.valve(side)
    obeys = {way: not valve_laws.obeys_iso(valve, way) for way in ("fill", "dis")}
    if obeys["fill"] and _is_never_choked(flat, side, "fill"):
        c = valve.c_fill if valve.valve_c_fill is None else valve.valve_c_fill
        line = p.supply_reference
        flow = base.unchoked_filling_flow(base.filling_boundary(line), line, c)
        valve = replace(valve, choked_fill=flow)
    if obeys["dis"] and _is_never_choked(flat, side, "dis"):
        c = valve.c_dis if valve.valve_c_dis is None else valve.valve_c_dis
        flow = base.unchoked_exhaust_flow(base.exhaust_boundary(p.atmosphere), p.atmosphere, c)
        valve = replace(valve, choked_dis=-flow)
    return valve


def chamber(flat: Flat, side: str) -> Iterator[BaseLaw]:
    """Pressure rate (3.3.6) and its inverse (3.5.3) of one chamber."""
    upper, (position, velocity) = side.upper(), _motion(flat)
    volume_of = base.chamber_volume_a if side == "a" else base.chamber_volume_b

    def volumes(p: Parameters, q: Array, w: Array) -> tuple[Array, Array]:
        area, offset = getattr(p, f"area_{side}"), getattr(p, f"offset_{side}")
        swept = area * p.pitch_radius * (1.0 if side == "a" else -1.0)
        return volume_of(q, area, offset, p.pitch_radius), swept * w

    def where_possible(volume: Array, value: Array) -> Array:
        """NaN where no such position exists."""
        xp = array_namespace(volume)
        return xp.where(volume > 0.0, value, xp.nan)

    def rate(p: Parameters, pressure: Array, q: Array, w: Array, flow: Array) -> Array:
        volume, grows = volumes(p, q, w)
        air = p.heat_capacity_ratio, p.gas_constant, p.temperature
        return where_possible(volume, base.pressure_rate(pressure, flow, volume, grows, *air))

    def flow(p: Parameters, rate: Array, pressure: Array, q: Array, w: Array) -> Array:
        volume, grows = volumes(p, q, w)
        air = p.heat_capacity_ratio, p.gas_constant, p.temperature
        found = base.flow_from_pressure_rate(rate, pressure, volume, grows, *air)
        return where_possible(volume, found)

    air = ("heat_capacity_ratio", "gas_constant_j_per_kg_k", "temperature_k")
    needs = (f"area_{side}_m2", f"offset_{side}_m", "pitch_radius_m", *air)
    moving = {"pressure_pa": "pressure", position: "position", velocity: "velocity"}
    yield BaseLaw(
        f"HAS_CHAMBER_{upper}",
        f"pressure_rate_{side}",
        f"dP/dt of chamber {upper}, Pa/s (3.3.6), from the flow into it, kg/s; NaN where no volume "
        "is left",
        needs,
        {**moving, "flow_kg_s": "flow"},
        rate,
    )
    yield BaseLaw(
        f"HAS_CHAMBER_{upper}",
        f"flow_for_pressure_rate_{side}",
        f"The flow into chamber {upper}, kg/s, that gives this dP/dt, Pa/s: (3.3.6) solved",
        needs,
        {"rate_pa_s": "rate", **moving},
        flow,
    )


__all__ = ["BaseLaw", "chamber", "law_replays", "mechanics", "valve_flows"]
