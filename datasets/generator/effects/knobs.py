"""Injected effects as the numbers that the compiled laws read, and the plant's own constants."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from datasets.generator.effects.catalogue import FORMS, Injected, law_keys
from datasets.generator.plant import Chamber, Plant
from datasets.generator.rigs import GRAVITY_M_PER_S2, REFERENCE_RADIUS_M, GeneratedRig

REFERENCE_INERTIA_KG_M2 = 0.02368
CONTACT_HZ, CONTACT_DAMPING = 150.0, 0.3  # of the motor's inertia on the flank of the gear

# Derived from the rig: position units a rad is 1/angle_scale of, and constants of second inertias.
_DERIVED = (
    "angle_scale",
    "arm_inertia",
    "arm_stiffness",
    "arm_damping",
    "arm_gravity",
    "motor_inertia",
    "contact_stiffness",
    "contact_damping",
    "pendulum_inertia",
    "pendulum_stiffness",
    "pendulum_damping",
)


def _fields() -> tuple[str, ...]:
    names: set[str] = set(_DERIVED)
    for id, forms in FORMS.items():
        for form in forms:
            keys, sided = law_keys(id, form)
            names |= {key + side for key in keys for side in (("_a", "_b") if sided else ("",))}
    return tuple(sorted(names))


_NAMES = _fields()
KNOBS = np.dtype([(name, np.float64) for name in _NAMES])
_CHAMBER = np.dtype([(name, np.float64) for name in Chamber._fields])
# The plant as one record: compiled functions pass it by address, a tuple value by value.
PLANT = np.dtype([(name, _CHAMBER if name in ("a", "b") else np.float64) for name in Plant._fields])
_FAST = ("presliding", "backlash", "link-flexibility")


def knobs_of(effects: Sequence[Injected], rig: GeneratedRig) -> Any:
    """The laws' numbers, a `KNOBS` array of one record; what no effect sets is 0.

    Raises ValueError where two effects set the same number, or one sets a number of no law.
    """
    knobs, given = np.zeros(1, dtype=KNOBS), set()
    k = knobs[0]
    for effect in effects:
        sides = {"": ("",), "a": ("_a",), "b": ("_b",), "both": ("_a", "_b")}[effect.side]
        for key, value in effect.values.items():
            for name in (key + side for side in sides):
                if name not in _NAMES:
                    raise ValueError(f"{effect.id} has no value {key!r} on side {effect.side!r}")
                if name in given:
                    raise ValueError(f"two effects set {name}: leave one of {effect.id} out")
                given.add(name)
                k[name] = value
    k["angle_scale"] = 1.0 / REFERENCE_RADIUS_M if rig.is_linear else 1.0
    _second_inertias(k, rig)
    if rig.is_linear:  # a tilted rack weighs the same everywhere
        weight = rig.inertia() * GRAVITY_M_PER_S2 * k["tilt_rad"] * np.sin(k["tilt_phase_rad"])
        k["torque_offset_nm"] -= weight / k["angle_scale"]
        k["tilt_rad"] = 0.0
    return knobs


def _second_inertias(k: Any, rig: GeneratedRig) -> None:
    """Arm, motor and pendulum: inertias in the position's units, springs by their frequencies."""
    inertia = rig.inertia()
    if k["arm_period_s"] > 0.0:
        k["arm_inertia"] = k["arm_share"] * inertia
        rate = 2.0 * np.pi / k["arm_period_s"]
        k["arm_stiffness"] = k["arm_inertia"] * rate**2
        k["arm_damping"] = 2.0 * k["arm_damping_ratio"] * k["arm_inertia"] * rate
    if k["gap_rad"] > 0.0 and k["use_gap"] == 1.0:
        k["motor_inertia"] = k["motor_share"] * inertia
        rate = 2.0 * np.pi * CONTACT_HZ
        k["contact_stiffness"] = k["motor_inertia"] * rate**2
        k["contact_damping"] = 2.0 * CONTACT_DAMPING * k["motor_inertia"] * rate
    if k["pendulum_kg_m2"] > 0.0:
        k["pendulum_inertia"] = k["pendulum_kg_m2"] * _mass_scale(rig)
        rate = 2.0 * np.pi * k["pendulum_hz"]
        k["pendulum_stiffness"] = k["pendulum_inertia"] * rate**2
        k["pendulum_damping"] = 2.0 * k["pendulum_damping_ratio"] * k["pendulum_inertia"] * rate


def _mass_scale(rig: GeneratedRig) -> float:
    """kg a kg m2 for a linear rig: as much of its mass as of the reference machine's inertia."""
    return rig.inertia() / REFERENCE_INERTIA_KG_M2 if rig.is_linear else 1.0


def changed_plant(plant: Plant, k: Any, rig: GeneratedRig) -> Plant:
    """The plant with the constants that the effects change; the rig file stays as declared."""
    added = float(k["added_inertia_kg_m2"] * _mass_scale(rig))
    gravity = plant.gravity
    if rig.is_vertical and k["use_gravity"] > 0.0:
        lever = 1.0 if rig.is_linear else float(rig.content["inertia"]["payload_length_m"])
        gravity += added / lever * GRAVITY_M_PER_S2
    inertia = plant.inertia + added - float(k["arm_inertia"] + k["motor_inertia"])
    if inertia <= 0.0:
        raise ValueError("the effects leave no inertia at the output: take smaller ones")
    a, b = plant.a, plant.b
    return plant._replace(
        inertia=inertia,
        gravity=gravity,
        heat_ratio=plant.heat_ratio + float(k["exponent"]),
        atmosphere=plant.atmosphere + float(k["ambient_pa"]),
        a=a._replace(offset=a.offset + float(k["offset_m_a"])),
        b=b._replace(offset=b.offset + float(k["offset_m_b"]), area=b.area + float(k["area_m2_b"])),
    )


def plant_record(plant: Plant) -> Any:
    """The plant's constants as a `PLANT` array of one record."""
    return np.array([tuple(plant)], dtype=PLANT)


def step_s(effects: Sequence[Injected], switching: bool) -> float:
    """The integrator's step, s: half where valves switch, or bristles or inertias are fast."""
    step = 50e-6 if switching else 100e-6
    return 0.5 * step if any(effect.id in _FAST for effect in effects) else step
