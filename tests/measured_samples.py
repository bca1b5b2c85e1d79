"""What the tests of the measured sets share: a set made here, and canned results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

# --- a set made here: a linear axis that follows sines, its friction of Stribeck's shape ------

MASS, COULOMB, VISCOUS, DROP, SPEED = 20.0, 12.0, 80.0, 14.0, 0.02  # kg, N, N s/m, N, m/s
PERIOD, SECONDS = 0.001, 5.0
SET = """\
title = "An axis made by a test"
source = "tests/measured_samples.py"
licence = "none needed"
folder = "axis"
question = "Is the friction's shape found again?"

{converts}
[[campaign]]
file = "campaign.toml"
name = "tests 0, 1, 2 fitted; 3 held out"
[[campaign]]
file = "repeat_1.toml"
name = "tests 1, 2, 3 fitted; 0 held out"
repeat = true
"""
RECIPE = """\
[map]
time_s = "#1:ms"
position_m = "#2:mm"
motor_force_n = "#3:2 N"
[options]
header = false
delimiter = ";"
"""
RIG = '[rig]\nname = "axis"\norientation = "horizontal"\nmotion = "linear"\n'


def _axis(seed: int, period: float) -> str:
    """Time [ms], position [mm], half the force [N], as a lab might write them."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, period)
    position, velocity, acceleration = np.zeros((3, len(time)))
    for amplitude, frequency in zip((0.06, 0.02, 0.008), rng.uniform(0.2, 1.2, 3), strict=True):
        w, phase = 2.0 * np.pi * frequency, rng.uniform(0.0, 2.0 * np.pi)
        position += amplitude * np.sin(w * time + phase)
        velocity += amplitude * w * np.cos(w * time + phase)
        acceleration -= amplitude * w**2 * np.sin(w * time + phase)
    friction = COULOMB + DROP * np.exp(-np.abs(velocity) / SPEED)
    # A command holds until the next row: the row's force acts over the half sample after it.
    force = MASS * acceleration + VISCOUS * velocity + np.sign(velocity) * friction
    force += rng.normal(0.0, 0.3, len(time))
    encoder = np.round(position / 1e-6) * 1e-6
    rows = zip(1e3 * time, 1e3 * encoder, 0.5 * force, strict=True)
    return "".join(f"{t:.1f};{x:.6f};{f:.5f}\n" for t, x, f in rows)


def _campaign(fitted: list[int], held_out: int) -> str:
    uses = [(k, "fit") for k in fitted] + [(held_out, "holdout")]
    logs = "".join(
        f'[[log]]\nkind = "friction-motion"\nfile = "axis_{k}.csv"\nuse = "{use}"\n'
        for k, use in uses
    )
    return f'rig = "rig.toml"\n{logs}'


def make_set(root: Path, name: str = "axis", period: float = PERIOD) -> Path:
    """The set's folder `root`/sets/`name`; its data lie in `root`/data/axis, a row a `period`."""
    folder, data = root / "sets" / name, root / "data" / "axis"
    folder.mkdir(parents=True)
    data.mkdir(parents=True, exist_ok=True)
    for k in range(4):
        (data / f"run{k}.txt").write_text(_axis(k, period))
    converts = "".join(
        f'[[convert]]\nsource = "run{k}.txt"\nrecipe = "recipe.toml"\nlog = "axis_{k}.csv"\n'
        for k in range(4)
    )
    (folder / "set.toml").write_text(SET.format(converts=converts))
    (folder / "recipe.toml").write_text(RECIPE)
    (folder / "rig.toml").write_text(RIG)
    (folder / "campaign.toml").write_text(_campaign([0, 1, 2], 3))
    (folder / "repeat_1.toml").write_text(_campaign([1, 2, 3], 0))
    return folder


# --- canned results -------------------------------------------------------------------------


def effect(id: str, ambiguous: tuple[str, ...] = ()) -> dict[str, Any]:
    estimate = {"value": 14.2, "std": 0.4, "unit": "N", "interval": [13.4, 15.0]}
    return {
        "id": id,
        "parameters": {"stribeck_force_n": estimate},
        "p_value": 1e-9,
        "holdout_rmse": {"motor_force_n": {"before": 4.0, "after": 1.0}},
        "ambiguous_with": list(ambiguous),
    }


def diagnosis(*effects: dict[str, Any], after: float = 1.0) -> dict[str, Any]:
    return {
        "verdict": "effects-found" if effects else "adequate",
        "effects": list(effects),
        "residual": {"motor_force_n": {"before": 4.0, "after": after, "noise_floor": 0.5}},
        "unexplained": [],
        "rejected": [],
        "notices": [],
    }


def campaign(file: str, found: dict[str, Any] | None, of: str | None = None) -> dict[str, Any]:
    estimate = {"value": 12.0, "std": 0.1, "unit": "N", "interval": [11.8, 12.2]}
    return {
        "file": file,
        "name": f"recordings of {file}",
        "repeat": of is not None,
        "of": of,
        "problem": None if found is not None else "sysid diagnose: error: no",
        "status": 0 if found is not None else 3,
        "law": {"friction.coulomb_n": estimate},
        "diagnosis": found,
    }


def canned(*campaigns: dict[str, Any], name: str = "axis") -> dict[str, Any]:
    said = {key: f"{key} of {name}" for key in ("title", "question", "source", "licence", "folder")}
    measured = {
        "name": name,
        **said,
        "data": "shared",
        "notices": [],
        "problem": None,
        "campaigns": list(campaigns),
    }
    return {"sysid_version": "0", "sets": [measured]}
