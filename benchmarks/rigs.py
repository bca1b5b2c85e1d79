"""Random rigs and PWM runs for the simulation's figures and tests."""

from __future__ import annotations

import numpy as np

from sysid.plant.base import Parameters
from sysid.plant.ports import Model
from sysid.plant.simulator import Inputs, ValveCommand

REFERENCE = Parameters(
    static_effort=0.333,
    coulomb_effort=0.208,
    viscous=0.0488,
    inertia=0.02368,
    gravity_moment=0.0,
    weight=0.0,
    offset=0.0,
    max_effort=0.795,
    area_a=4.524e-4,
    area_b=4.207e-4,
    offset_a=0.075,
    offset_b=0.075,
    stroke=0.127,
    pitch_radius=0.0375,
    gas_constant=287.0,
    heat_capacity_ratio=1.4,
    temperature=293.15,
    atmosphere=1e5,
    supply=3e5,
    supply_reference=3e5,
    choked_fill_a=7.8e-4,
    choked_dis_a=3.5e-4,
    c_fill_a=1.5e-6,
    c_dis_a=3.7e-9,
    on_delay_a=0.0017,
    off_delay_a=0.002,
    choked_fill_b=1.3e-3,
    choked_dis_b=3.9e-4,
    c_fill_b=1.5e-6,
    c_dis_b=3.7e-9,
    on_delay_b=0.0017,
    off_delay_b=0.002,
    pwm_period=0.005,
)
"""The thesis' rig."""

_SPREAD = [
    "static_effort",
    "coulomb_effort",
    "viscous",
    "inertia",
    "area_a",
    "area_b",
    "stroke",
    "pitch_radius",
    "choked_fill_a",
    "choked_dis_a",
    "c_fill_a",
    "c_dis_a",
    "on_delay_a",
    "off_delay_a",
    "choked_fill_b",
    "choked_dis_b",
    "c_fill_b",
    "c_dis_b",
    "on_delay_b",
    "off_delay_b",
]


def random_rig(rng: np.random.Generator) -> Parameters:
    """A rig within -20 % to +25 % of the thesis', at 2.5 to 6 bar, some of them vertical."""
    values = {name: getattr(REFERENCE, name) * rng.uniform(0.8, 1.25) for name in _SPREAD}
    values["static_effort"] = max(values["static_effort"], 1.1 * values["coulomb_effort"])
    supply = rng.uniform(2.5e5, 6e5)
    for side in ("a", "b"):
        values[f"choked_fill_{side}"] *= supply / REFERENCE.supply
        values[f"offset_{side}"] = values["stroke"] / 2 + rng.uniform(0.006, 0.02)
    vertical = rng.random() < 0.5
    return REFERENCE.replace(
        **values,
        supply=supply,
        supply_reference=supply,
        gravity_moment=rng.uniform(0.3, 1.0) if vertical else 0.0,
    )


def pwm_run(rng: np.random.Generator, seconds: float, motor: bool = True) -> Inputs:
    """Clipped sines of both duties and, if asked, of the motor, at 1 kHz."""
    time = np.arange(round(seconds * 1000) + 1) / 1000.0
    frequency, phase = rng.uniform(0.3, 1.0, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
    duties = [
        np.clip(0.3 + 0.5 * np.sin(2.0 * np.pi * f * time + p), 0.0, 1.0)
        for f, p in zip(frequency, phase, strict=True)
    ]
    effort = np.clip(0.4 * np.sin(2.0 * np.pi * 0.4 * time), -0.3, 0.3) if motor else 0.0 * time
    return Inputs(
        time=time,
        motor=effort,
        valve_a=ValveCommand(duties[0], is_duty=True),
        valve_b=ValveCommand(duties[1], is_duty=True),
    )


def random_runs(
    seed: int, count: int, seconds: float, motor: bool = True
) -> tuple[list[Inputs], list[Model]]:
    """`count` runs, each on a rig of its own."""
    rng = np.random.default_rng(seed)
    models = [Model(random_rig(rng)) for _ in range(count)]
    return [pwm_run(rng, seconds, motor) for _ in range(count)], models
