"""Held-out logs decide nothing: bundles are the same to the byte whatever these logs hold.

Distorted, shortened, or missing, they change the errors that say that they are of held-out tests,
the validation, and the list of logs and the verdict in the provenance.
"""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from own_components import CYLINDER, MOTOR, done

from datasets.components import logs as component_logs
from datasets.generator.campaign import Size, drawn_effects, make_campaign
from datasets.generator.files import write_campaign
from datasets.generator.motor_axis import axis_tests, motor_axis, write_axis_campaign
from sysid.io.bundled import bundled_campaign
from sysid.io.campaign import MOTION_KINDS

SEED = 41
# Rows that say what was done, not what was measured.
_GIVEN = ("time_s", "test", "duty", "valve", "pump_volts", "volts", "command", "pwm_period_s")
_OF_THE_HOLD_OUT = ("rmse", "residual_autocorrelation", "effort_rmse")
# More than any search here takes: a search that ends is the same with and without a bound.
_BUDGET = ("--budget", "3000")


@pytest.fixture(scope="module", autouse=True)
def _one_process() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SYSID_JOBS", "1")
        yield


def _distorted(frame: pd.DataFrame) -> pd.DataFrame:
    rng, found = np.random.default_rng(5), frame.copy()
    for name in frame.columns:
        if not name.startswith(_GIVEN):
            own = frame[name].to_numpy(dtype=float)
            spread = float(np.ptp(own))
            noise = 2e-3 * spread * rng.standard_normal(len(own))
            found[name] = 1.05 * own + 0.02 * spread + noise
    return found


def _shortened(frame: pd.DataFrame) -> pd.DataFrame:
    """The first half of each test."""
    tests = frame.groupby("test") if "test" in frame else [("", frame)]
    return pd.concat([one.head(len(one) // 2) for _, one in tests], ignore_index=True)


def _rewritten(path: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    if path.suffix == ".parquet":
        change(pd.read_parquet(path)).to_parquet(path)
    else:
        change(pd.read_csv(path)).to_csv(path, index=False)


def _without(campaign: Path) -> None:
    head, *blocks = campaign.read_text("utf-8").split("[[log]]")
    kept = [block for block in blocks if 'use = "holdout"' not in block]
    assert len(kept) < len(blocks)
    campaign.write_text("[[log]]".join([head, *kept]), "utf-8")


def variants(campaign: Path, folder: Path) -> dict[str, Path]:
    """The campaign, and copies that differ in their held-out logs alone."""
    found = {"as it is": campaign}
    for name, change in (("distorted", _distorted), ("shortened", _shortened), ("removed", None)):
        copy = folder / name
        shutil.copytree(campaign.parent, copy)
        path = found[name] = copy / campaign.name
        if change is None:
            _without(path)
            continue
        for entry in tomllib.loads(path.read_text("utf-8"))["log"]:
            if entry.get("use") == "holdout":
                _rewritten(copy / entry["file"], change)
    return found


def stripped(bundle: Path) -> str:
    """A bundle's text without what may depend on held-out logs."""
    content: dict[str, Any] = json.loads(bundle.read_text("utf-8"))
    for key in ("created", "validation", "provenance"):
        content.pop(key, None)
    for effect in content.get("effects", []):
        effect.pop("holdout_rmse", None)
    for key in _OF_THE_HOLD_OUT:
        content.get("refinement", {}).get(key, {}).pop("holdout", None)
    return json.dumps(content, indent=1)


@dataclass(frozen=True)
class Written:
    """What a campaign's commands wrote: the bundles by name, and the ids of effects found."""

    bundles: dict[str, str]
    effects: tuple[str, ...]
    errors: dict[str, Any]


def written(
    campaign: Path, *, own: Path | None = None, quick: bool = False, runs: bool = True,
    refines: bool = True,
) -> Written:  # fmt: skip
    """Fit, diagnose, refine and run a campaign."""
    folder = campaign.parent / "out"
    folder.mkdir()
    fitted, longer, refined = (folder / f"{n}.json" for n in ("fitted", "longer", "refined"))
    component = () if own is None else ("--component", own)
    hurry = ("--quick",) if quick else ()
    done("fit", campaign, *component, "-o", fitted)
    given = (campaign, "--bundle", fitted, *component)
    told = done("diagnose", *given, "-o", longer, "--json", *_BUDGET, *hurry)
    made = [fitted, longer]
    if refines:
        done("refine", *given, "-o", refined)
        made.append(refined)
    if runs:
        done("run", campaign, "-o", folder / "run", *component, *_BUDGET, *hurry)
        made += [*sorted((folder / "run").glob("*ed.json")), folder / "run" / "bundle.json"]
    found = json.loads(told.out)
    return Written(
        {str(path.relative_to(folder)): stripped(path) for path in made},
        tuple(effect["id"] for effect in found["effects"]),
        found["residual"],
    )


def assert_same(campaign: Path, folder: Path, **how: Any) -> dict[str, Written]:
    """That each variant of a campaign writes the same bundles; what they wrote."""
    found = {name: written(path, **how) for name, path in variants(campaign, folder).items()}
    first = found["as it is"]
    for name, other in found.items():
        assert other.effects == first.effects, name
        assert set(other.bundles) == set(first.bundles), name
        for file, text in other.bundles.items():
            assert text == first.bundles[file], (name, file)
    # The held-out logs did change: so did what is said of them.
    assert found["distorted"].errors != first.errors
    return found


def test_of_an_axis(tmp_path: Path) -> None:
    """A motor alone: its effect is found, and its numbers refined by simulation, in each."""
    rig = motor_axis(SEED, "rotary", drawn_effects(SEED, [("quadratic-drag", "quadratic", 3.0)]))
    tests = axis_tests(rig, SEED, 3, 0.01) + axis_tests(rig, SEED + 500, 1)
    (tmp_path / "given").mkdir()
    found = assert_same(write_axis_campaign(tmp_path / "given", rig, tests), tmp_path)
    for one in found.values():
        assert one.effects
        assert json.loads(one.bundles["longer.json"])["refinement"]["parameters"]


def _tank(folder: Path) -> Path:
    """Discharges of a tank whose walls warm the gas: two levels to fit on, one held out."""
    k, gas_constant, ambient, atmosphere, volume, c_dis = 1.4, 287.0, 293.15, 1e5, 1e-3, 9e-10
    c_v = gas_constant / (k - 1.0)
    lines = ['rig = "rig.toml"']
    (folder / "rig.toml").write_text(
        '[rig]\nname = "tank"\norientation = "horizontal"\n'
        f"[air]\ngas_constant_j_per_kg_k = {gas_constant}\nheat_capacity_ratio = {k}\n"
        f"temperature_k = {ambient}\natmospheric_pressure_pa = {atmosphere}\n"
        f"supply_pressure_pa = 6e5\n[tank]\nvolume_m3 = {volume}\n",
        "utf-8",
    )
    time, step = np.arange(0.0, 42.0, 0.05), 0.05
    for seed, (level, use) in enumerate(
        ((2e4, "fit"), (4e4, "fit"), (6e4, "fit"), (3e4, "holdout"))
    ):
        pressure = np.full(len(time), atmosphere + level)
        mass, gas = pressure[0] * volume / (gas_constant * ambient), ambient
        for i in range(40, len(time)):
            pressure[i] = mass * gas_constant * gas / volume
            flow = c_dis * (pressure[i] - atmosphere)
            heat = 0.4 * (ambient - gas)
            warmer = -flow * (k * c_v * ambient - c_v * gas) + heat
            mass, gas = mass - step * flow, gas + step * warmer / (mass * c_v)
        pressure += 8.0 * np.random.default_rng([SEED, seed]).standard_normal(len(time))
        volts = np.where(time < 2.0, 5.0, 0.0)
        table = pd.DataFrame({"time_s": time, "pressure_a_pa": pressure, "pump_volts": volts})
        table.to_csv(folder / f"{seed}.csv", index=False)
        lines += ["", "[[log]]", 'kind = "tank"', f'file = "{seed}.csv"', f'use = "{use}"']
    (folder / "campaign.toml").write_text("\n".join([*lines, ""]), "utf-8")
    return folder / "campaign.toml"


def test_of_a_tank(tmp_path: Path) -> None:
    (tmp_path / "given").mkdir()
    found = assert_same(_tank(tmp_path / "given"), tmp_path, refines=False)
    assert all(one.effects for one in found.values())


def test_of_a_cylinder_of_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(component_logs, "_CYLINDER_S", 2.0)
    (tmp_path / "given").mkdir()
    component_logs.cylinder(tmp_path / "given", SEED)
    found = assert_same(tmp_path / "given" / "campaign.toml", tmp_path, own=CYLINDER)
    assert all(one.effects for one in found.values())


def test_of_a_motor_of_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(component_logs, "_SERVO_S", 2.0)
    (tmp_path / "given").mkdir()
    component_logs.servo(tmp_path / "given", SEED)
    assert_same(tmp_path / "given" / "campaign.toml", tmp_path, own=MOTOR, runs=False)


def test_of_an_actuator(tmp_path: Path) -> None:
    """A small one by a first look, its numbers refined apart from that."""
    size = Size(2, 0, 2, 0.04, (1, 1), (1, 1), (1, 1))
    kinds = ("friction-static", "friction-sliding", "valve-discrete", *MOTION_KINDS)
    effects = drawn_effects(SEED, [("seal-friction", "sum", 3.0)])
    made = make_campaign(SEED, size=size, kinds=kinds, effects=effects)
    (tmp_path / "given").mkdir()
    write_campaign(tmp_path / "given", made, "made by a test")
    campaign = tmp_path / "given" / "campaign.toml"
    found = assert_same(campaign, tmp_path, quick=True, runs=False)
    assert all(one.effects for one in found.values())


@pytest.mark.slow
def test_of_the_bundled_campaign(tmp_path: Path) -> None:
    given = tmp_path / "given"
    shutil.copytree(bundled_campaign().parent, given)
    found = assert_same(given / "campaign.toml", tmp_path)
    for one in found.values():
        assert one.effects
        assert json.loads(one.bundles["longer.json"])["refinement"]["parameters"]
