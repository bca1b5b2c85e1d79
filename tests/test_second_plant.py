"""The second plant of the benchmarks against the simulator: written apart, they agree."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest

from benchmarks.rigs import REFERENCE
from benchmarks.second_plant import PERIOD_S, _edges, _ran, drawn_rig
from sysid.plant.base import Parameters
from sysid.plant.effects.friction import Presliding
from sysid.plant.effects.linkage import PitchEccentricity
from sysid.plant.ports import Model
from sysid.plant.simulator import Inputs, ValveCommand, simulate

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler (gcc)")
ROWS = 1500


def parameters_of(rig: dict[str, float]) -> Parameters:
    flows = {
        f"{name}_{side}": rig[f"{own}_{side}"]
        for side in "ab"
        for name, own in (
            ("choked_fill", "fill"),
            ("c_fill", "fill_root"),
            ("choked_dis", "dis"),
            ("c_dis", "dis_linear"),
            ("area", "area"),
            ("offset", "offset"),
        )
    }
    delays = {f"{edge}_delay_{side}": rig[f"{edge}_s"] for edge in ("on", "off") for side in "ab"}
    return REFERENCE.replace(
        **flows,
        **delays,
        inertia=rig["inertia"],
        static_effort=rig["static_nm"],
        coulomb_effort=rig["coulomb_nm"],
        viscous=rig["viscous"],
        pitch_radius=rig["radius"],
        temperature=rig["temperature"],
        atmosphere=rig["atmosphere"],
        supply=rig["supply"],
        supply_reference=rig["supply"],
        max_effort=rig["max_torque"],
        gravity_moment=0.0,
    )


@pytest.mark.parametrize(
    ("lacks", "effect"),
    [
        ({}, None),
        (
            {"bristle": 300.0, "bristle_damping": 0.8},
            lambda rig: Presliding(1 / 300, rig["static_nm"] - rig["coulomb_nm"], 0.02, 0.8),
        ),
        (
            {"eccentric": 0.05, "eccentric_phase": 0.0},
            lambda rig: PitchEccentricity(eccentricity_cosine=0.05),
        ),
    ],
    ids=["base model", "presliding", "eccentric pinion"],
)
def test_both_plants_move_alike(lacks: dict[str, float], effect: Any) -> None:
    rng = np.random.default_rng(3)
    rig = drawn_rig(rng)
    time = np.arange(ROWS) * PERIOD_S
    torque = 0.6 * np.sin(2.0 * np.pi * 1.3 * time)
    valves = {side: np.repeat(rng.integers(0, 2, ROWS // 100), 100).astype(float) for side in "ab"}
    edges = [_edges(valves[side], False, 0, rig) for side in "ab"]
    outside = {f"pressure_{side}": rig["atmosphere"] for side in "ab"}
    test = {"held": 0.0, "angle": 0.1, "sliding": 1.0, "sticking": 1.0, "end": 1.6} | outside
    rows = _ran(rig | lacks, test, torque, *edges)
    model = Model(parameters_of(rig), (effect(rig),) if effect else ())
    commands = {f"valve_{side}": ValveCommand(valves[side], False) for side in "ab"}
    run = simulate([Inputs(time, torque, **commands, position=0.1, **outside)], [model])[0]
    count = len(rows)
    assert count > 600 and np.ptp(rows[:, 0]) > 0.3
    np.testing.assert_allclose(run.position[:count], rows[:, 0], atol=2e-4)
    for place, name in ((1, "pressure_a"), (2, "pressure_b")):
        np.testing.assert_allclose(getattr(run, name)[:count], rows[:, place], rtol=2e-4)
