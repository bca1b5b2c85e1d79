"""Rigs: the thesis' reference machine, and random ones around it.

A rig is what `rig.toml` declares (`content`) and what no file contains (`Truth`). In the base model
the two agree; an undeclared effect is in the truth alone (`effects`).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from datasets.generator.effects.catalogue import Injected
from datasets.generator.plant import Chamber, Plant

GRAVITY_M_PER_S2 = 9.81
SPREAD = 0.20  # half-width of the uniform draw of what is to be identified
SPREAD_OF_DIMENSIONS = 0.10  # and of what the rig file declares
REFERENCE_RADIUS_M = 0.0375

Content = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class ValveTruth:
    """One valve's law: flows kg/s, `c_fill` kg/(s Pa^0.5), `c_dis` kg/(s Pa) (Table 3.6.1)."""

    c_fill: float
    c_dis: float
    choked_flow_fill_kg_s: float
    choked_flow_dis_kg_s: float


@dataclass(frozen=True)
class Truth:
    """What the fits should find. Friction is in Nm and Nm s/rad (linear: N and N s/m)."""

    static_friction: float
    coulomb_friction: float
    viscous_friction: float
    valve_a: ValveTruth
    valve_b: ValveTruth
    pressure_noise_pa: float


@dataclass(frozen=True)
class GeneratedRig:
    """A rig file's content and the truth behind it."""

    content: Content
    truth: Truth
    effects: tuple[Injected, ...] = ()

    @property
    def atmosphere(self) -> float:
        """The room's real pressure, Pa; the rig file declares another one if an effect says so."""
        error = sum(e.values.get("ambient_pa", 0.0) for e in self.effects)
        return float(self.content["air"]["atmospheric_pressure_pa"]) + error

    @property
    def is_linear(self) -> bool:
        return bool(self.content["rig"].get("motion") == "linear")

    @property
    def is_vertical(self) -> bool:
        return bool(self.content["rig"]["orientation"] == "vertical")

    @property
    def radius(self) -> float:
        """Stroke per unit of position, m/rad (linear: 1)."""
        return float(self.content["cylinder"].get("pitch_radius_m", 1.0))

    @property
    def half_travel(self) -> float:
        """The end stops' position, rad or m."""
        return float(self.content["cylinder"]["stroke_m"]) / 2.0 / self.radius

    @property
    def sides(self) -> tuple[str, ...]:
        """The chambers that there are."""
        return tuple(self.content["cylinder"].get("chambers", ("a", "b")))

    @property
    def bleeds(self) -> bool:
        """Whether chamber A has two on/off valves, and is shut while both are off."""
        return bool(self.content["valves"].get("arrangement") == "fill-and-bleed")

    @property
    def max_effort(self) -> float:
        if "motor" not in self.content:
            return 0.0
        key = "max_force_n" if self.is_linear else "max_torque_nm"
        return float(self.content["motor"][key])

    @property
    def effort_per_volt(self) -> float:
        key = "force_per_volt_n" if self.is_linear else "torque_per_volt_nm"
        return float(self.content["motor"][key])

    @property
    def row_period(self) -> float:
        return float(self.content["sampling"]["period_s"])

    @property
    def position_per_count(self) -> float:
        """The encoder's resolution, rad or m."""
        sensors = self.content["sensors"]
        if self.is_linear:
            return 1.0 / float(sensors["encoder_counts_per_m"])
        return 2.0 * np.pi / float(sensors["encoder_counts_per_rev"])

    def gravity(self) -> float:
        """Amplitude of gravity's effort (3.3.8, 3.3.9), Nm or N; 0 in the horizontal."""
        if not self.is_vertical:
            return 0.0
        i = self.content["inertia"]
        if self.is_linear:
            return float(i["mass_kg"] + i["payload_mass_kg"]) * GRAVITY_M_PER_S2
        arm = i["arm_mass_kg"] * i["arm_length_m"] / 2.0
        return float(arm + i["payload_mass_kg"] * i["payload_length_m"]) * GRAVITY_M_PER_S2

    def inertia(self) -> float:
        """Whole inertia with payload (3.3.5), kg m2 or kg."""
        i = self.content["inertia"]
        if self.is_linear:
            return float(i["mass_kg"] + i["payload_mass_kg"])
        return float(i["equivalent_kg_m2"] + i["payload_mass_kg"] * i["payload_length_m"] ** 2)

    def plant(self, static_factor: float = 1.0, sliding_factor: float = 1.0) -> Plant:
        """The integrator's constants; the factors are one trial's own friction."""
        air = self.content["air"]
        t = self.truth
        return Plant(
            inertia=self.inertia(),
            static_friction=t.static_friction * static_factor,
            coulomb_friction=t.coulomb_friction * sliding_factor,
            viscous_friction=t.viscous_friction * sliding_factor,
            gravity=self.gravity(),
            rotary=0.0 if self.is_linear else 1.0,
            radius=self.radius,
            max_effort=self.max_effort,
            half_travel=self.half_travel,
            gas_constant=float(air["gas_constant_j_per_kg_k"]),
            heat_ratio=float(air["heat_capacity_ratio"]),
            temperature=float(air["temperature_k"]),
            atmosphere=float(air["atmospheric_pressure_pa"]),
            supply=float(air["supply_pressure_pa"]),
            declared_supply=float(air["supply_pressure_pa"]),
            a=self._chamber("a", 1.0, t.valve_a),
            b=self._chamber("b", -1.0, t.valve_b),
            **self._spring(),
        )

    def _spring(self) -> dict[str, float]:
        """The declared return spring, whose preload is that at the end where A is smallest (with a
        supply below the atmosphere: largest)."""
        spring, air = self.content.get("spring", {}), self.content["air"]
        keys = ("stiffness_n_per_m", "preload_n")
        if not self.is_linear:
            keys = ("stiffness_nm_per_rad", "preload_nm")
        stiffness, preload = (float(spring.get(key, 0.0)) for key in keys)
        way = 1.0 if air["supply_pressure_pa"] > air["atmospheric_pressure_pa"] else -1.0
        effort = way * (preload + stiffness * self.half_travel)
        return {"spring_stiffness": stiffness, "spring_effort": effort}

    def _chamber(self, side: str, direction: float, valve: ValveTruth) -> Chamber:
        cylinder = self.content["cylinder"]
        # Where there is no chamber, the piston's side is open: a large volume before no area.
        return Chamber(
            area=float(cylinder.get(f"area_{side}_m2", 1e-12)),
            offset=float(cylinder.get(f"offset_{side}_m", 1e12)),
            direction=direction,
            choked_fill=valve.choked_flow_fill_kg_s,
            choked_dis=valve.choked_flow_dis_kg_s,
            c_fill=valve.c_fill,
            c_dis=valve.c_dis,
        )

    def truth_content(self) -> dict[str, Any]:
        """The truth under the names of the parameter bundle (`bundle.md`)."""
        t = self.truth
        static, coulomb, viscous = (
            ("static_n", "coulomb_n", "viscous_n_s_per_m")
            if self.is_linear
            else ("static_nm", "coulomb_nm", "viscous_nm_s_per_rad")
        )
        valves = self.content["valves"]
        return {
            "friction": {
                static: t.static_friction,
                coulomb: t.coulomb_friction,
                viscous: t.viscous_friction,
            },
            "inertia": self.inertia(),
            "valves": {s: dataclasses.asdict(getattr(t, f"valve_{s}")) for s in self.sides},
            "delays": {"on_delay_s": valves["on_delay_s"], "off_delay_s": valves["off_delay_s"]},
            "pressure_noise_pa": t.pressure_noise_pa,
            "effects": [effect.content() for effect in self.effects],
        }


def reference_rig(
    orientation: str = "horizontal", motion: str = "rotary", payload_kg: float = 0.0
) -> GeneratedRig:
    """The thesis' machine: what it prints and what its tables imply.

    The linear one is the same machine seen at the rack: efforts over the pitch radius, inertia and
    viscous friction over its square.
    """
    _check(orientation, ("horizontal", "vertical"))
    _check(motion, ("rotary", "linear"))
    linear = motion == "linear"
    r = REFERENCE_RADIUS_M if linear else 1.0
    content: Content = {
        "rig": {"name": "generated", "orientation": orientation},
        "air": {
            "gas_constant_j_per_kg_k": 287.0,
            "heat_capacity_ratio": 1.4,
            "temperature_k": 293.15,
            "atmospheric_pressure_pa": 1.0e5,
            "supply_pressure_pa": 3.0e5,
        },
        "cylinder": {
            "area_a_m2": 4.524e-4,
            "area_b_m2": 4.207e-4,
            "offset_a_m": 0.075,
            "offset_b_m": 0.075,
            "stroke_m": 0.127,
        },
        "inertia": {},
        "motor": {},
        "pwm": {"period_s": 0.005},
        "valves": {"on_delay_s": 0.0017, "off_delay_s": 0.0020},
        "sampling": {"period_s": 0.001},
        "sensors": {},
    }
    if linear:
        content["rig"]["motion"] = "linear"
        # A vertical linear rig has no pendulum: its mass is one that the friction can hold.
        mass = 0.6 if orientation == "vertical" else _digits(0.02368 / r**2)
        content["inertia"] = {"mass_kg": mass, "payload_mass_kg": payload_kg}
        content["motor"] = {"force_per_volt_n": 2.12, "max_force_n": 21.2}
        content["sensors"] = {"encoder_counts_per_m": 340000}
    else:
        content["cylinder"]["pitch_radius_m"] = REFERENCE_RADIUS_M
        content["inertia"] = {
            "equivalent_kg_m2": 0.02368,
            "payload_mass_kg": payload_kg,
            "payload_length_m": 0.370,
        }
        if orientation == "vertical":
            content["inertia"] |= {"arm_mass_kg": 0.30, "arm_length_m": 0.46}
        content["motor"] = {"torque_per_volt_nm": 0.0795, "max_torque_nm": 0.795}
        content["sensors"] = {"encoder_counts_per_rev": 80000}
    content["sensors"]["pressure_noise_pa"] = 200.0
    truth = Truth(
        static_friction=_digits(0.333 / r),
        coulomb_friction=_digits(0.208 / r),
        viscous_friction=_digits(0.0488 / r**2),
        valve_a=ValveTruth(1.5e-6, 3.7e-9, 7.8e-4, 3.5e-4),
        valve_b=ValveTruth(1.5e-6, 3.7e-9, 1.3e-3, 3.9e-4),
        pressure_noise_pa=200.0,
    )
    return GeneratedRig(content, truth)


def random_rig(
    rng: np.random.Generator,
    orientation: str = "horizontal",
    motion: str = "rotary",
    payload_kg: float = 0.0,
) -> GeneratedRig:
    """A rig around the reference: what is identified +-20 %, declared dimensions +-10 %."""
    base = reference_rig(orientation, motion, payload_kg)

    def near(value: float, spread: float) -> float:
        return _digits(value * rng.uniform(1.0 - spread, 1.0 + spread))

    content = {section: dict(table) for section, table in base.content.items()}
    for section, keys in (
        ("cylinder", ("area_a_m2", "area_b_m2", "stroke_m", "pitch_radius_m")),
        ("motor", ("torque_per_volt_nm", "force_per_volt_n")),
    ):
        for key in keys:
            if key in content[section]:
                content[section][key] = near(content[section][key], SPREAD_OF_DIMENSIONS)
    for key in ("equivalent_kg_m2", "mass_kg"):
        if key in content["inertia"]:
            content["inertia"][key] = near(content["inertia"][key], SPREAD)
    cylinder = content["cylinder"]
    for side in "ab":  # half the stroke and a dead length of 11 mm, more or less
        dead = rng.uniform(0.009, 0.014)
        cylinder[f"offset_{side}_m"] = _digits(cylinder["stroke_m"] / 2.0 + dead)
    air = content["air"]
    air["temperature_k"] = round(rng.uniform(288.0, 303.0), 1)
    air["atmospheric_pressure_pa"] = round(rng.uniform(98.0e3, 103.0e3), -2)
    air["supply_pressure_pa"] = round(rng.uniform(280.0e3, 330.0e3), -3)
    content["valves"]["on_delay_s"] = round(rng.uniform(0.0014, 0.0018), 5)
    content["valves"]["off_delay_s"] = round(rng.uniform(0.0018, 0.0023), 5)
    noise = round(rng.uniform(150.0, 250.0))
    content["sensors"]["pressure_noise_pa"] = float(noise)

    t = base.truth
    coulomb = near(t.coulomb_friction, SPREAD)
    ratio = t.static_friction / t.coulomb_friction
    # Static friction is drawn as a multiple of Coulomb's, so that it always exceeds it.
    truth = Truth(
        static_friction=_digits(coulomb * ratio * rng.uniform(0.85, 1.10)),
        coulomb_friction=coulomb,
        viscous_friction=near(t.viscous_friction, SPREAD),
        valve_a=_random_valve(t.valve_a, near),
        valve_b=_random_valve(t.valve_b, near),
        pressure_noise_pa=float(noise),
    )
    return GeneratedRig(content, truth)


def _random_valve(valve: ValveTruth, near: Any) -> ValveTruth:
    values = {key: near(value, SPREAD) for key, value in dataclasses.asdict(valve).items()}
    return ValveTruth(**values)


def _digits(value: float) -> float:
    """Five significant digits: what a rig file would hold."""
    return float(f"{value:.5g}")


def _check(value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise ValueError(f"{value!r} is not one of {', '.join(allowed)}")


def rig_toml(content: Content) -> str:
    """A rig file's text."""
    lines = []
    for section, table in content.items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {_toml(value)}" for key, value in table.items()]
        lines.append("")
    return "\n".join(lines)


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
