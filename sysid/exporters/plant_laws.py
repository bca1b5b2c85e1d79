"""The plant's equations on names: the model's own ports, printed as functions of C.

Base laws and effects alike are the functions of `sysid.plant`, evaluated where their numbers are
fields of a struct `q` and the point where the plant is another, `s`. What integrates them, and
locates the events between their regimes, is the template `plant.h.in`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy

from sysid.errors import SysidError, input_error
from sysid.exporters.c_printer import all_statements, reduced
from sysid.exporters.c_text import LARGEST, Names, indented, wrapped
from sysid.exporters.symbolic import (
    NamedRow,
    Symbolic,
    expression,
    forget_expressions,
    symbol,
)
from sysid.io.channels import SIDES
from sysid.io.rig import NO_LOAD, Load, Rig
from sysid.plant import base, plant, valve_laws
from sysid.plant.base import Parameters, parameter_names
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Effect, Model, Point, overrides, with_load
from sysid.plant.sensors import state_channels

NAMES = Names("plant_", "PLANT_")
KEPT = 8
"""On-intervals of a valve that may still act."""

_HEAD = "const plant_parameters *q, const plant_point *s"
_LOAD = ("inertia", "gravity_moment", "weight")


@dataclass(frozen=True)
class PlantNumber:
    """A number of the model, a field of the struct of parameters: its C name and its value."""

    name: str
    value: float


@dataclass(frozen=True)
class TracedPlant:
    """The plant on names: the numbers of its struct, and its functions as text of C.

    `states` are the effects' own, `memory` how many numbers their sensors remember; `drifts`: the
    parameters change over time. `load`: what a kilogram of payload adds to inertia, gravity's
    moment and weight; None where the rig does not say where the payload is.
    """

    numbers: tuple[PlantNumber, ...]
    states: tuple[str, ...]
    memory: int
    drifts: bool
    own_payload_kg: float
    load: Load | None
    functions: str


def traced_plant(model: Model, effects: Sequence[CatalogueEffect], rig: Rig) -> TracedPlant:
    """The model of a rig on names; `effects` are the model's.

    Raises InputError for an effect whose ports have no form in C.
    """
    forget_expressions()
    return _Tracer(model, effects, rig).made()


def effect_number(place: int, label: str) -> str:
    """The struct's field of an effect's own number, by the effect's place in the bundle."""
    return f"effect_{place + 1}_{label}"


def load_per_kg(rig: Rig) -> tuple[float, Load | None]:
    """The rig's own payload, kg, and what one more kilogram adds; None where it does not say."""
    own = 0.0 if rig.inertia is None else rig.inertia.payload_mass_kg
    try:
        return own, rig.load_of(own + 1.0)
    except SysidError:
        return own, None


class _Tracer:
    def __init__(self, model: Model, effects: Sequence[CatalogueEffect], rig: Rig) -> None:
        self._rig, self._effects = rig, effects
        self._names = parameter_names(model.parameters)
        # Two valves a chamber are other equations, no number.
        bleeds = model.parameters.bleeds
        own = {k: symbol(f"q->{k}") for k in self._names}
        self._parameters = Parameters(**own, bleeds=bleeds)
        self._numbers = [
            PlantNumber(k, _finite(float(getattr(model.parameters, k)))) for k in self._names
        ]
        named = [self._named(place, effect) for place, effect in enumerate(effects)]
        self._model = Model(self._parameters, tuple(named))
        self._point = self._at("s", self._parameters)

    def made(self) -> TracedPlant:
        """Everything, in the order in which the template calls it."""
        own, load = load_per_kg(self._rig)
        drifts, after = self._after_effects(load)
        sensors, memory = self._sensors()
        parts = [after, *self._mechanics(), *(self._chamber(side) for side in SIDES)]
        parts += [self._stage(), self._outputs(), self._states_at_start(), sensors]
        parts += [self._pulses(side) for side in SIDES]
        parts += [self._delay(side, opening) for side in SIDES for opening in (True, False)]
        return TracedPlant(
            numbers=tuple(self._numbers),
            states=self._model.state_names,
            memory=memory,
            drifts=drifts,
            own_payload_kg=own,
            load=load,
            functions="\n".join(parts),
        )

    def _named(self, place: int, effect: CatalogueEffect) -> CatalogueEffect:
        """The effect with the struct's fields as its numbers.

        A shape that is 0 stays that number: an effect's plain form has no more to work out.
        """
        names: dict[str, Symbolic] = {}
        for quantity in type(effect).quantities:
            value = float(getattr(effect, quantity.name))
            if value != 0.0 or quantity.is_strength:
                name = effect_number(place, quantity.label)
                names[quantity.name] = symbol(f"q->{name}")
                self._numbers.append(PlantNumber(name, _finite(value)))
        named: CatalogueEffect = dataclasses.replace(effect, **names)  # type: ignore[type-var]
        return named

    def _at(self, name: str, parameters: Parameters) -> Point:
        states = [state for effect in self._effects for state in effect.states]
        return Point(
            **{k: symbol(f"{name}->{k}") for k in _POINT},
            parameters=parameters,
            extra={state: symbol(f"{name}->extra[{k}]") for k, state in enumerate(states)},
        )

    def _after_effects(self, load: Load | None) -> tuple[bool, str]:
        """The parameters in force at a time under a payload; whether that changes over time."""
        more = NO_LOAD
        if load is not None:
            per_kg = {k: float(getattr(load, k)) * symbol("more_kg") for k in _LOAD}
            more = Load(**per_kg)
        loaded = Model(with_load(self._parameters, more), self._model.effects)
        found = self._called("parameters", lambda: loaded.at(symbol("time")))
        results = {
            f"out->{k}": value
            for k in self._names
            if expression(value := getattr(found, k)) != expression(getattr(self._parameters, k))
        }
        made = _function(
            "in_force",
            "The parameters with more_kg more of a payload than the rig's own, and what effects do "
            "to them; out is a copy of q before",
            "const plant_parameters *q, plant_real time, plant_real more_kg, plant_parameters *out",
            results,
        )
        time = sympy.Symbol("time")
        return any(time in expression(v).free_symbols for v in results.values()), made

    def _mechanics(self) -> list[str]:
        point, model = self._point, self._model
        applied = symbol("applied")
        volume_rates = {
            f"out[{k}]": plant.volume_rate(side, point, model) for k, side in enumerate(SIDES)
        }
        return [
            _function(
                "applied_effort",
                "All efforts but friction, Nm or N (3.3.7)",
                _HEAD,
                {"return": self._called("efforts", lambda: plant.applied_effort(point, model))},
            ),
            _function(
                "breakaway_effort",
                "Effort up to which the plant stays at rest, Nm or N (3.4.1)",
                f"{_HEAD}, plant_real applied",
                {
                    "return": self._called(
                        "friction", lambda: plant.breakaway_effort(applied, point, model)
                    )
                },
            ),
            _function(
                "end_stop",
                "Position of the upper end stop; the lower one is its negative",
                "const plant_parameters *q",
                {"return": 0.5 * point.parameters.stroke / point.parameters.pitch_radius},
            ),
            _function(
                "volume_rates",
                "dV/dt of chambers A and B, m3/s",
                f"{_HEAD}, plant_real out[2]",
                volume_rates,
            ),
        ]

    def _chamber(self, side: str) -> str:
        """What decides a valve's regime, and what the approach to the pressure that the chamber is
        open to needs, as `stepper._supply_gap`."""
        point, model = self._point, self._model
        p, pressure = point.parameters, point.pressure(side)
        is_open, valve = point.is_open(side) > 0, point.parameters.valve(side)

        def found() -> dict[str, Any]:
            xp = base.array_namespace(pressure)
            choked = {True: is_open, False: ~is_open}
            above, below = (
                plant.discrete_flow(side, choked[k], point, model) for k in (False, True)
            )
            filling = plant.filling_boundary(side, point, model)
            boundary = xp.where(is_open, filling, plant.exhaust_boundary(side, point, model))
            fixed = xp.where(
                is_open,
                valve_laws.filling_boundary(valve, p.supply),
                valve_laws.exhaust_boundary(valve, p.atmosphere),
            )
            flow = xp.where(pressure - boundary > 0, above, below)
            volume = plant.chamber_volume(side, plant.displacement(point, model), p)
            gas = p.heat_capacity_ratio * p.gas_constant * p.temperature
            line = plant.supply_pressure(side, point, model)
            root = valve_laws.root_coefficient(valve, "fill", line, pressure, p.temperature)
            nears: Any = xp.where(is_open, 1.0, 0.0)
            if valve_laws.obeys_iso(valve, "dis"):
                exhaust = plant.exhaust_pressure(side, point, model)
                back = valve_laws.root_coefficient(valve, "dis", exhaust, pressure, p.temperature)
                line, root = xp.where(is_open, line, exhaust), xp.where(is_open, root, back)
                nears = 1.0
            values = (
                *(boundary, fixed, above, below),
                plant.pressure_rate(side, flow, point, model),
                *(volume, gas / volume, root, line, nears),
            )
            return {f"out->{n}": v for n, v in zip(_REGIME, values, strict=True)}

        return _function(
            f"chamber_{side}",
            f"Chamber {side.upper()} on both sides of its choked boundary",
            f"{_HEAD}, plant_chamber_laws *out",
            self._called("valve and chamber", found),
        )

    def _stage(self) -> str:
        """Everything that a stage of the step needs, in one function, which shares its parts."""
        point, model = self._point, self._model

        def found() -> dict[str, Any]:
            applied = plant.applied_effort(point, model)
            flows, rates = {}, []
            for side in SIDES:
                choked = symbol(f"choked_{side}")
                flows[side] = plant.discrete_flow(side, choked, point, model)
                rates.append(plant.pressure_rate(side, flows[side], point, model))
            extra = plant.state_rates(point, flows, model)
            values = {
                "out->applied": applied,
                "out->breakaway": plant.breakaway_effort(applied, point, model),
                "out->acceleration": plant.acceleration(applied, point, model),
            }
            for k, side in enumerate(SIDES):
                values |= {f"out->flow[{k}]": flows[side], f"out->pressure_rate[{k}]": rates[k]}
            states = model.state_names
            return values | {f"out->extra_rate[{k}]": extra[name] for k, name in enumerate(states)}

        return _function(
            "stage",
            "Efforts, flows and the states' derivatives, each valve choked or not as said",
            f"{_HEAD}, int choked_a, int choked_b, plant_rates *out",
            self._called("equations", found),
        )

    def _outputs(self) -> str:
        point, model = self._point, self._model

        def found() -> dict[str, Any]:
            p = point.parameters
            radius = plant.pitch_radius(point, model)
            values = {
                "cylinder": base.cylinder_effort(
                    *(point.pressure_a, point.pressure_b),
                    *(p.area_a, p.area_b, p.atmosphere, radius),
                ),
                "motor": plant.motor_effort(point, model),
                "gravity": base.load_effort(point.position, p),
                "sliding": plant.sliding_friction(point, model),
            }
            return {f"out->{name}": value for name, value in values.items()}

        return _function(
            "efforts_at",
            "Efforts of cylinder and motor, of gravity (and a return spring) and of sliding "
            "friction (these against positive motion), Nm or N",
            f"{_HEAD}, plant_efforts *out",
            self._called("efforts", found),
        )

    def _states_at_start(self) -> str:
        def found() -> dict[str, Any]:
            start = plant.initial_states(self._point, self._model)
            return {f"out[{k}]": start[name] for k, name in enumerate(self._model.state_names)}

        return _function(
            "states_at_start",
            "The effects' states at the start",
            f"{_HEAD}, plant_real *out",
            self._called("initial_states", found),
        )

    def _sensors(self) -> tuple[str, int]:
        """What the sensors show: at rest, sample by sample, and what they remember at rest."""
        position = self._rig.position_channel
        names = state_channels(position)
        time, step = symbol("time"), symbol("step")
        channels = {name: symbol(f"x[{k}]") for k, name in enumerate(names)}
        still, shown = dict(channels), dict(channels)
        begun: list[Any] = []
        kept: list[Any] = []
        for effect, numeric in zip(self._model.effects, self._effects, strict=True):
            if overrides(numeric, "start_sensing"):
                first: Any = self._of(effect, "start_sensing", still, step)
                memory = tuple(symbol(f"memory[{len(begun) + k}]") for k in range(len(first)))
                begun += first
                shown, after = self._of(effect, "sense", shown, memory, time, step)
                kept += after
            elif overrides(numeric, "measure"):
                still = self._of(effect, "measure", still, time)
                shown = self._of(effect, "measure", shown, time)
        head = "const plant_parameters *q, plant_real time, const plant_real x[4]"
        texts = [
            _function(
                "shown_at_rest",
                "What the sensors show of position, velocity and pressures that have not changed",
                f"{head}, plant_real y[4]",
                {f"y[{k}]": still[name] for k, name in enumerate(names)},
            ),
            _function(
                "memory_at_rest",
                "What the sensors remember of such a start",
                f"{head}, plant_real *memory",
                {f"memory[{k}]": value for k, value in enumerate(begun)},
            ),
            _function(
                "shown",
                "What the sensors show after step s",
                f"{head}, plant_real step, plant_real *memory, plant_real y[4]",
                {f"y[{k}]": shown[name] for k, name in enumerate(names)}
                | {f"memory[{k}]": value for k, value in enumerate(kept)},
            ),
        ]
        return "\n".join(texts), len(begun)

    def _pulses(self, side: str) -> str:
        """A valve's last on-intervals as its effects let them pass."""
        on, off = (
            NamedRow([symbol(f"v->{name}[{k}]") for k in range(KEPT)]) for name in ("on", "off")
        )
        for effect in self._model.effects:
            if overrides(effect, "pulses"):
                passed = self._of(effect, "recent_pulses", on, off, symbol("until"), side)
                on, off = (NamedRow(tuple(row)) for row in passed)
        results = {f"v->opens[{k}]": value for k, value in enumerate(on)}
        results |= {f"v->closes[{k}]": value for k, value in enumerate(off)}
        return _function(
            f"passed_{side}",
            f"The on-intervals of valve {side.upper()} as its effects let them pass, before its "
            "delays; until: when the next pulse may start",
            "const plant_parameters *q, plant_real until, plant_valve *v",
            results,
        )

    def _delay(self, side: str, opening: bool) -> str:
        edge = "on" if opening else "off"
        delay = getattr(self._parameters, f"{edge}_delay_{side}")
        for effect in self._model.effects:
            if overrides(effect, "delays"):
                delay = self._of(effect, "delays", delay, symbol("time"), opening, side)
        return _function(
            f"{edge}_delay_{side}",
            f"Delay of valve {side.upper()} from the command to turn {edge}, given at time, s",
            "const plant_parameters *q, plant_real time",
            {"return": delay},
        )

    def _of(self, effect: Effect, port: str, *arguments: Any) -> Any:
        named: Any = effect
        return self._called(port, lambda: getattr(effect, port)(*arguments), named.id)

    def _called(self, what: str, evaluate: Callable[[], Any], culprit: str = "") -> Any:
        """What it gives; InputError, naming the effect, where a port has no form in C."""
        try:
            return evaluate()
        except Exception as error:  # whatever an effect's code raises
            culprit = culprit or self._culprit()
            reason = str(error).strip().partition("\n")[0][:80]
            raise input_error(
                f"effect {culprit}",
                f"cannot be part of a plant in C: {what} needs more than the present ({reason})",
                "export a bundle without it, or simulate in Python",
            ) from None

    def _culprit(self) -> str:
        """The effect that has no form in C by itself, else all of them."""
        return ", ".join(effect.id for effect in self._effects) or "of the base model"


_POINT = (
    *("time", "position", "velocity", "pressure_a", "pressure_b"),
    *("motor", "open_a", "open_b", "direction"),
)
_REGIME = (
    *("boundary", "fixed", "flow_above", "flow_below"),
    *("rate", "volume", "per_flow", "root", "line", "nears"),
)


def _finite(value: float) -> float:
    return math.copysign(LARGEST, value) if math.isinf(value) else value


def _function(name: str, meaning: str, arguments: str, results: Mapping[str, Any]) -> str:
    """A function of C; its results are worked out before the first is set."""
    made = reduced(*(expression(value) for value in results.values()))
    lines, texts = all_statements(made, NAMES)
    read = {found.partition("-")[0].partition("[")[0] for found in made.names()}
    declared = [
        argument.split()[-1].lstrip("*").partition("[")[0] for argument in arguments.split(", ")
    ]
    targets = {target.partition("-")[0].partition("[")[0] for target in results}
    lines += [f"(void){argument};" for argument in declared if argument not in read | targets]
    if "return" in results:
        kind = "plant_real"
        lines.append(f"return {texts[0]};")
    else:
        kind = "void"
        lines += [f"const plant_real y{k} = {text};" for k, text in enumerate(texts)]
        lines += [f"{target} = y{k};" for k, target in enumerate(results)]
    comment = "\n   ".join(wrapped(f"{meaning}.", 92))
    head = "\n    ".join(wrapped(f"static inline {kind} plant_{name}({arguments})", 92))
    return f"/* {comment} */\n{head}\n{{\n{indented(lines)}\n}}\n"


__all__ = [
    "KEPT",
    "NAMES",
    "PlantNumber",
    "TracedPlant",
    "effect_number",
    "traced_plant",
]
