"""Held-out logs decide nothing: bundles are the same to the byte whatever these logs hold.

Distorted, shortened, or missing, they change the errors that say that they are of held-out tests,
the validation, and the list of logs and the verdict in the provenance.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from other_catalogues import only
from own_components import CYLINDER, MOTOR, done
from test_components_valves import BENCH, sweep

from datasets.components import logs as component_logs
from datasets.generator import motor_axis as motor_axis_tests
from datasets.generator.campaign import Size, drawn_effects, make_campaign
from datasets.generator.files import write_campaign
from datasets.generator.motor_axis import axis_tests, motor_axis, write_axis_campaign
from sysid.checks import bench as bench_checks
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.fitting import fit_law
from sysid.diagnosis.bench.registry import part_tested
from sysid.diagnosis.bench.valve_time import valve_time
from sysid.estimation.linear import Estimate
from sysid.io.bundled import bundled_campaign
from sysid.io.campaign import read_campaign
from sysid.io.logs import Trial
from sysid.parameters import Bundle, Parts
from sysid.plant.effects.catalogue import catalogue

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


# What the tests here lack, and some that might be taken for it.
_TRIED = (
    "seal-friction",
    "quadratic-drag",
    "stribeck-friction",
    "torque-constant-error",
    "wall-heat-transfer",
    "atmosphere-leakage",
    "dead-volume-error",
)


@pytest.fixture
def few_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some of three subsystems: how many effects are tried decides nothing here."""
    only(_TRIED, monkeypatch)


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


def _in_motion(frame: pd.DataFrame) -> pd.DataFrame:
    """The second half of each test: it begins anywhere in a motion, which no simulation can do."""
    tests = frame.groupby("test") if "test" in frame else [("", frame)]
    return pd.concat([one.tail(len(one) // 2) for _, one in tests], ignore_index=True)


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


_CHANGES: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame], ...]] = {
    "distorted": (_distorted,),
    "shortened": (_shortened,),
    "both": (_distorted, _shortened),
    "in motion": (_in_motion,),
}


def variant(campaign: Path, folder: Path, name: str) -> Path:
    """A copy of a campaign that differs in its held-out logs alone: `_CHANGES`, or "removed"."""
    path = folder / name / campaign.name
    shutil.copytree(campaign.parent, path.parent)
    if name == "removed":
        _without(path)
        return path
    for entry in tomllib.loads(path.read_text("utf-8"))["log"]:
        if entry.get("use") == "holdout":
            for change in _CHANGES[name]:
                _rewritten(path.parent / entry["file"], change)
    return path


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


def written(campaign: Path, commands: str, folder: Path, options: Sequence[Any]) -> Written:
    """Fit a campaign, and diagnose, refine and run it where `commands` name that."""
    folder.mkdir()
    fitted, longer, refined = (folder / f"{n}.json" for n in ("fitted", "longer", "refined"))
    component = [*options[options.index("--component") :][:2]] if "--component" in options else []
    done("fit", campaign, *component, "-o", fitted)
    made, found = [fitted], {"effects": [], "residual": {}}
    if "diagnose" in commands:
        told = done("diagnose", campaign, "--bundle", fitted, "-o", longer, "--json", *options)
        found = json.loads(told.out)
        made.append(longer)
    if "refine" in commands:
        done("refine", campaign, "--bundle", fitted, *component, "-o", refined)
        made.append(refined)
    if "run" in commands:
        done("run", campaign, "-o", folder / "run", *options)
        found = json.loads((folder / "run" / "diagnosis.json").read_text("utf-8"))
        made += [*sorted((folder / "run").glob("*ed.json")), folder / "run" / "bundle.json"]
    return Written(
        {str(path.relative_to(folder)): stripped(path) for path in made},
        tuple(effect["id"] for effect in found["effects"]),
        found["residual"],
    )


# What the slow tests go through.
ALL = "diagnose refine run"
EACH = dict.fromkeys(("distorted", "shortened", "removed"), ALL)
# What the others do.
FEW = ("both", "removed")


def assert_same(
    campaign: Path, folder: Path, commands: Mapping[str, str], *options: Any
) -> Written:
    """That each variant of a campaign writes the same bundles; what the campaign itself wrote.

    `commands` by variant; the campaign itself goes through those of all.
    """
    every = " ".join(commands.values())
    first = written(campaign, every, folder / "given-out", (*_BUDGET, *options))
    for name, own in commands.items():
        path = variant(campaign, folder, name)
        other = written(path, own, folder / f"{name}-out", (*_BUDGET, *options))
        assert other.effects == first.effects, name
        assert other.bundles, name
        for file, text in other.bundles.items():
            assert text == first.bundles[file], (name, file)
        # The held-out logs did change: so did what is said of them.
        assert other.errors != first.errors, name
    return first


@pytest.mark.usefixtures("few_effects")
def test_of_an_axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A motor alone: its effect is found, and its numbers refined by simulation, in each."""
    monkeypatch.setattr(motor_axis_tests, "_DURATION_S", 4.0)
    rig = motor_axis(SEED, "rotary", drawn_effects(SEED, [("quadratic-drag", "quadratic", 3.0)]))
    rig.content["sampling"]["period_s"] = 0.004
    tests = axis_tests(rig, SEED, 3, 0.01) + axis_tests(rig, SEED + 500, 1)
    (tmp_path / "given").mkdir()
    campaign = write_axis_campaign(tmp_path / "given", rig, tests)
    found = assert_same(campaign, tmp_path, dict.fromkeys(FEW, "diagnose"))
    assert found.effects
    assert json.loads(found.bundles["longer.json"])["refinement"]["parameters"]


def _tank(folder: Path) -> Path:
    """Discharges of a tank that leaks: two levels to fit on, one held out. Its walls warm the gas,
    which its law has."""
    k, gas_constant, ambient, atmosphere, volume, c_dis = 1.4, 287.0, 293.15, 1e5, 1e-3, 3e-10
    c_v = gas_constant / (k - 1.0)
    lines = ['rig = "rig.toml"']
    (folder / "rig.toml").write_text(
        '[rig]\nname = "tank"\norientation = "horizontal"\n'
        f"[air]\ngas_constant_j_per_kg_k = {gas_constant}\nheat_capacity_ratio = {k}\n"
        f"temperature_k = {ambient}\natmospheric_pressure_pa = {atmosphere}\n"
        f"supply_pressure_pa = 6e5\n[tank]\nvolume_m3 = {volume}\n",
        "utf-8",
    )
    time, step = np.arange(0.0, 27.0, 0.05), 0.05
    for seed, (level, use) in enumerate(((2e4, "fit"), (6e4, "fit"), (3e4, "holdout"))):
        pressure = np.full(len(time), atmosphere + level)
        mass, gas = pressure[0] * volume / (gas_constant * ambient), ambient
        for i in range(40, len(time)):
            pressure[i] = mass * gas_constant * gas / volume
            flow = c_dis * (pressure[i] - atmosphere)
            flow += 2e-15 * (pressure[i] ** 2 - atmosphere**2)
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


def _mean_pressure(
    kind: str, trials: Sequence[Trial], rig: Any
) -> tuple[Mapping[str, Estimate], Sequence[str]]:
    """In place of a law that a check fits to each log: a number that depends on what it holds."""
    means = [float(np.mean(trial["pressure_a_pa"])) for trial in trials]
    return {"c_dis": Estimate.symmetric(means[0], 1.0, "Pa", 9.0)}, [t.source for t in trials]


@pytest.mark.slow
@pytest.mark.usefixtures("few_effects")
def test_of_a_tank(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_checks, "bench_fit", _mean_pressure)
    (tmp_path / "given").mkdir()
    few = dict.fromkeys(FEW, "run")
    assert assert_same(_tank(tmp_path / "given"), tmp_path, few, "--quick").effects


def _own(folder: Path, which: Path) -> Path:
    """A campaign of one of the worked components."""
    given = folder / "given"
    given.mkdir()
    make = component_logs.cylinder if which == CYLINDER else component_logs.servo
    make(given, SEED)
    return given / "campaign.toml"


@pytest.mark.slow
@pytest.mark.usefixtures("few_effects")
def test_of_a_component_of_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(component_logs, "_SERVO_S", 2.0)
    given = _own(tmp_path, MOTOR)
    few = dict.fromkeys(FEW, "diagnose refine")
    assert assert_same(given, tmp_path, few, "--component", MOTOR).effects


@pytest.mark.slow
@pytest.mark.parametrize("which", [CYLINDER, MOTOR])
def test_of_a_component_as_it_is_delivered(which: Path, tmp_path: Path) -> None:
    assert assert_same(_own(tmp_path, which), tmp_path, EACH, "--component", which).effects


@pytest.mark.usefixtures("few_effects")
def test_of_an_actuator(tmp_path: Path) -> None:
    """A small one by a first look, its numbers refined apart from that."""
    size = Size(1, 0, 1, 0.04, (1, 1), (1, 1), (2, 1))  # what shows in one test alone is none
    kinds = ("friction-static", "friction-sliding", "valve-discrete", "motion-discrete")
    effects = drawn_effects(SEED, [("seal-friction", "sum", 3.0)])
    made = make_campaign(SEED, size=size, kinds=kinds, effects=effects)
    (tmp_path / "given").mkdir()
    write_campaign(tmp_path / "given", made, "made by a test")
    campaign = tmp_path / "given" / "campaign.toml"
    few = dict.fromkeys(("both", "in motion"), "diagnose refine")
    assert assert_same(campaign, tmp_path, few, "--quick").effects


@pytest.mark.slow
def test_of_the_bundled_campaign(tmp_path: Path) -> None:
    given = tmp_path / "given"
    shutil.copytree(bundled_campaign().parent, given)
    found = assert_same(given / "campaign.toml", tmp_path, EACH)
    assert found.effects
    assert json.loads(found.bundles["longer.json"])["refinement"]["parameters"]


def test_readings_that_the_law_does_not_predict_end_nothing() -> None:
    """Held-out emptying of a valve whose filling alone was fitted on."""
    fitted = [sweep(period, True, (), seed, 0.01) for seed, period in enumerate((0.01, 0.02, 0.05))]
    part = valve_time(fitted, BENCH)
    bundle = Bundle.new(BENCH, fit_law(part, (), range(len(part.tests))).part(), [])
    some = {"valve-delay": catalogue()["valve-delay"]}
    found, alone = (
        diagnose_component("valve-time", fitted, held, BENCH, bundle, some)
        for held in ([sweep(0.01, False, (), 9, 0.01)], [])
    )
    assert any("filling_time_s" in n or "emptying" in n for n in found.notices)
    assert any("left out of the fit in turn" in n for n in found.notices)
    assert found.verdict == alone.verdict and found.residual == alone.residual
    assert [e.id for e in found.effects] == [e.id for e in alone.effects]


def test_training_tests_say_which_part_a_campaign_is_about(tmp_path: Path) -> None:
    """A held-out log of another kind makes neither an actuator nor another part of it."""
    rig = motor_axis(SEED)
    (tmp_path / "given").mkdir()
    path = write_axis_campaign(tmp_path / "given", rig, axis_tests(rig, SEED, 1), 0)
    bundle = Bundle.new(read_campaign(path).rig, Parts(), [])
    for kind in ("motion-motor", "tank"):
        entry = f'\n[[log]]\nkind = "{kind}"\nfile = "other.csv"\nuse = "holdout"\n'
        (path.parent / "other.csv").write_text("time_s,theta_rad\n0,0\n1,0\n", "utf-8")
        (path.parent / f"{kind}.toml").write_text(path.read_text("utf-8") + entry, "utf-8")
        other = read_campaign(path.parent / f"{kind}.toml")
        assert part_tested(other.training_kinds(), bundle) == "friction-motion"
        held = dataclasses.replace(other, logs=other.logs[-1:])
        assert held.training_kinds() == (kind,)
