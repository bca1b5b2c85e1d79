"""The second plant of the benchmarks against the simulator: written apart, they agree."""

from __future__ import annotations

import shutil
import tomllib
from typing import Any

import numpy as np
import pytest

from benchmarks.second_plant import PERIOD_S, _edges, _ran, drawn_rig, rig_file
from sysid.io.rig import rig_from_content
from sysid.plant.base import Parameters, ValveParameters, parameters_from_rig
from sysid.plant.effects.friction import Presliding
from sysid.plant.effects.linkage import PitchEccentricity
from sysid.plant.ports import Model
from sysid.plant.simulator import Inputs, ValveCommand, simulate

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler (gcc)")
ROWS = 1500


def parameters_of(rig: dict[str, float]) -> Parameters:
    """What the rig file declares, with the true friction and flows."""
    declared = rig_from_content(tomllib.loads(rig_file(rig)), "rig.toml")
    valves = {
        f"valve_{side}": ValveParameters(
            *(rig[f"{name}_{side}"] for name in ("fill", "dis", "fill_root", "dis_linear"))
        )
        for side in "ab"
    }
    return parameters_from_rig(
        declared,
        static_effort=rig["static_nm"],
        coulomb_effort=rig["coulomb_nm"],
        viscous=rig["viscous"],
        **valves,
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
