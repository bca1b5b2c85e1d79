"""Friction tests in one direction or at one speed: sums of parameters in place of a refusal."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest
from friction_trials import BARE, PERIOD, RIG, constant, ramp, simulated, swing, trial

from sysid import friction
from sysid.balance.samples import tells_speeds
from sysid.commands.app import main
from sysid.friction import FrictionResult, fit_friction
from sysid.io.logs import Trial, with_channels
from sysid.io.rig import Rig, rig_from_content
from sysid.parameters import Friction

COULOMB, VISCOUS, OFFSET = 0.208, 0.0488, 0.012
TRUTH = {"coulomb_nm": COULOMB, "viscous_nm_s_per_rad": VISCOUS, "offset_nm": OFFSET}


def slid(levels: tuple[float, ...], ways: tuple[float, ...], scatter: float = 0.0) -> list[Trial]:
    rng = np.random.default_rng(3)
    return [
        constant(way * level + OFFSET, scatter * rng.normal(), f"{way * level:g} {k}", OFFSET)
        for level in levels
        for way in ways
        for k in range(3)
    ]


def moved(ways: tuple[float, ...], speeds: tuple[float, ...], label: str = "m") -> Trial:
    """An arm led through ramps of position, by a drive that is stiff; its torque is logged."""
    legs = [np.full(round(0.6 / (speed * PERIOD)), way * speed) for speed in speeds for way in ways]
    smooth = np.convolve(np.concatenate(legs), np.ones(40) / 40.0, mode="same")
    angle = -1.2 * ways[0] * (len(ways) == 1) + np.cumsum(smooth) * PERIOD
    acceleration = np.gradient(smooth, PERIOD)
    law = COULOMB * np.sign(smooth) + VISCOUS * smooth + OFFSET
    effort = law + 0.024 * acceleration
    return trial(label, effort + 0.002 * np.random.default_rng(4).normal(size=len(law)), angle)


def consistent(result: FrictionResult) -> None:
    """Each sum holds the truth, none of its parts is a number, and nothing contradicts itself."""
    for one in result.combinations:
        truth = sum(c * TRUTH[name] for c, name in zip(one.coefficients, one.of, strict=True))
        assert one.estimate.value == pytest.approx(truth, rel=0.02, abs=6e-4), one.expression
        assert any("would separate" in n and one.expression in n for n in result.notices)
        assert not any(result[name].identified for name in one.of)
    for name, estimate in result.parameters.items():
        assert estimate.identified or estimate.reason, name
    friction = result.part().friction
    assert friction is not None
    read = Friction.model_validate(json.loads(json.dumps(friction.to_json(), allow_nan=False)))
    assert list(read.sums()) == [one.expression for one in result.combinations]


def expressions(result: FrictionResult) -> list[tuple[str, ...]]:
    return [one.of for one in result.combinations]


def test_one_direction_at_several_levels() -> None:
    for way in (1.0, -1.0):
        result = fit_friction(slid((0.25, 0.28, 0.31), (way,)), RIG)
        consistent(result)
        assert expressions(result) == [("coulomb_nm", "offset_nm")]
        assert result.combinations[0].coefficients == (1.0, way)
        assert "other direction" in result.combinations[0].test
        assert result["viscous_nm_s_per_rad"].value == pytest.approx(VISCOUS, rel=0.03)


def test_one_level_in_both_directions() -> None:
    result = fit_friction(slid((0.27,), (1.0, -1.0), 0.005), RIG)
    consistent(result)
    assert expressions(result) == [("coulomb_nm", "viscous_nm_s_per_rad")]
    assert "second level" in result.combinations[0].test
    offset = result["offset_nm"]
    assert offset.holds(OFFSET) and offset.value == pytest.approx(OFFSET, abs=0.003)
    friction = result.part().friction
    assert friction is not None and friction.in_motion("offset") == offset


def test_an_offset_that_changes_the_speed_holds_what_viscous_friction_may_be() -> None:
    """The same torque both ways: the way that the offset helps is faster."""
    trials = [constant(way * 0.27, 0.0, f"{way}{k}", OFFSET) for way in (1.0, -1.0) for k in "abc"]
    result = fit_friction(trials, RIG)
    assert expressions(result) == [("coulomb_nm", "viscous_nm_s_per_rad")]
    offset = result["offset_nm"]
    speeds = {way: result.trials[k].values["speed"] for way, k in ((1.0, 0), (-1.0, 3))}
    assert -speeds[-1.0] > 1.1 * speeds[1.0]
    # Of equal torques and without viscous friction there would be next to no offset.
    assert offset.value < 0.2 * OFFSET
    assert offset.holds(OFFSET) and not offset.holds(-0.1 * OFFSET)


@pytest.mark.parametrize("count", [1, 3])
def test_one_level_in_one_direction(count: int) -> None:
    result = fit_friction(slid((0.27,), (-1.0,))[:count], RIG)
    consistent(result)
    assert expressions(result) == [("coulomb_nm", "offset_nm", "viscous_nm_s_per_rad")]


@pytest.mark.parametrize("rig", [RIG, BARE], ids=["inertia given", "inertia fitted"])
def test_motion_in_one_direction(rig: object) -> None:
    for way in (1.0, -1.0):
        result = fit_friction([moved((way,), (0.4, 0.8, 1.2))], rig, kind="motion")  # type: ignore[arg-type]
        consistent(result)
        assert expressions(result) == [("coulomb_nm", "offset_nm")]
        assert result["viscous_nm_s_per_rad"].value == pytest.approx(VISCOUS, rel=0.05)


@pytest.mark.parametrize("rig", [RIG, BARE], ids=["inertia given", "inertia fitted"])
@pytest.mark.parametrize("ways", [(1.0,), (-1.0,), (1.0, -1.0)], ids=["on", "back", "both"])
def test_motion_at_one_speed(rig: object, ways: tuple[float, ...]) -> None:
    result = fit_friction([moved(ways * (3 // len(ways)), (0.7,))], rig, kind="motion")  # type: ignore[arg-type]
    consistent(result)
    assert result.combinations
    assert all("viscous_nm_s_per_rad" in one.of for one in result.combinations)
    assert "further speeds" in result.combinations[0].test


def test_motion_that_separates_them_takes_precedence() -> None:
    trials = [*slid((0.27,), (1.0,)), swing()]
    result = fit_friction(trials, RIG)
    assert result.source == "friction-motion" and not result.combinations
    assert result["coulomb_nm"].identified
    assert not any(n.startswith("not identified") for n in result.notices)
    assert any("friction-sliding tests alone do not suffice" in n for n in result.notices)
    assert [use.used for use in result.trials if use.kind == "friction-sliding"] == [False] * 3


def test_every_test_is_accounted_for() -> None:
    short = Trial("", np.array([0.0]), {}, "folder/short.csv")
    stalled = constant(0.15, 0.0, "stalled", kick_s=0.01)
    rest = trial("", np.zeros(2000), np.zeros(2000))
    given = [*slid((0.25, 0.30), (1.0, -1.0)), stalled, rest, short, ramp(0.333, 0.208, 0.0, 1)]
    result = fit_friction(given, RIG)
    assert len(result.trials) == len(given)
    lines = [line for line in result.remarks if "tests used" in line]
    counted = sum(int(line.split(" of ")[1].split()[0]) for line in lines)
    assert counted == len(given)
    text = " ".join(lines)
    assert "1 excluded (test stalled)" in text and "short.csv" in text
    assert all(use.to_json()["test"] for use in result.trials)


def test_a_fit_that_fails_leaves_its_tests_out_by_name() -> None:
    rest = trial("rest", np.zeros(2000), np.zeros(2000))
    result = fit_friction([rest, *slid((0.25, 0.30), (1.0, -1.0))], RIG)
    assert not any(n.startswith("not identified") for n in result.notices)
    assert [use.used for use in result.trials if use.label == "rest"] == [False]
    assert result["coulomb_nm"].identified


def test_the_command_gives_the_sum(
    tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    effort = 0.4 + 0.1 * np.sin(10.0 * PERIOD * np.arange(1500))
    effort[:50] = 0.6
    one_way = trial("one way", effort, simulated(effort, 0.3, 0.208, 0.2, -1.5))
    frame = pd.DataFrame({"time_s": one_way.time, **one_way.channels})
    frame.to_csv(tmp_path / "run.csv", index=False)
    log, bundle = str(tmp_path / "run.csv"), str(tmp_path / "bundle.json")
    assert main(["fit", "friction", log, "--kind", "motion", "-o", bundle, "--no-report"]) == 0
    said = capsys.readouterr()
    assert "Identified only together" in said.out and "coulomb_nm + offset_nm" in said.out
    assert "would separate its parts" in said.err
    written = json.loads(Path(bundle).read_text())["friction"]
    assert written["coulomb_nm"]["value"] is None
    assert written["combinations"][0]["of"] == ["coulomb_nm", "offset_nm"]


def test_a_test_that_shows_friction_over_speed_is_not_hidden_by_a_faster_one() -> None:
    """The motor moves it slowly without a load, air faster the more it pushes."""
    rng = np.random.default_rng(4)
    slow, fast = rng.uniform(0.005, 0.015, 2000), rng.uniform(0.02, 0.04, 1000)
    speeds = [np.concatenate([v, -v]) for v in (slow, fast)]
    loads = [rng.normal(0.0, 0.01, 4000), speeds[1] * 50.0 + rng.normal(0.0, 0.1, 2000)]
    assert not tells_speeds([np.concatenate(speeds)], [np.concatenate(loads)])
    assert tells_speeds(speeds, loads)
    assert not tells_speeds(speeds[1:], loads[1:])


def valve_driven() -> tuple[Trial, Rig]:
    """A motion that the pressures of two equal chambers drive: 8 N, 25 N s/m, 2 kg."""
    rng, time = np.random.default_rng(2), 2e-3 * np.arange(5000)
    speed = 0.15 * np.sin(2.5 * time) + 0.05 * np.sin(6.9 * time + 0.3)
    place = np.cumsum(np.append(0.0, speed[1:] + speed[:-1])) * 1e-3
    force = 2.0 * np.gradient(speed, 2e-3) + 8.0 * np.tanh(speed / 1e-3) + 25.0 * speed
    force += 0.2 * rng.standard_normal(len(time))
    air = {
        "gas_constant_j_per_kg_k": 287.0,
        "heat_capacity_ratio": 1.4,
        "temperature_k": 293.15,
        "atmospheric_pressure_pa": 1e5,
        "supply_pressure_pa": 6e5,
    }
    cylinder = dict.fromkeys(("area_a_m2", "area_b_m2"), 4.5e-4)
    cylinder |= dict.fromkeys(("offset_a_m", "offset_b_m"), 0.3) | {"stroke_m": 0.4}
    about = {"name": "axis", "orientation": "horizontal", "motion": "linear"}
    channels = {
        "position_m": place - np.mean(place),
        "pressure_a_pa": 3e5 + force / 9e-4,
        "pressure_b_pa": 3e5 - force / 9e-4,
    }
    rig = rig_from_content({"rig": about, "air": air, "cylinder": cylinder}, "rig.toml")
    return Trial("1", time, channels, "v.csv"), rig


def test_a_motor_that_is_logged_and_off_takes_no_speed_for_the_cylinders() -> None:
    """Valves drive, and the effort's column is zero: the same as without the column."""
    test, rig = valve_driven()
    alone = fit_friction([test], rig)
    logged = fit_friction([with_channels(test, motor_force_n=np.zeros(len(test)))], rig)
    for name, truth in (("coulomb_n", 8.0), ("viscous_n_s_per_m", 25.0), ("mass_kg", 2.0)):
        assert logged[name].value == pytest.approx(alone[name].value, rel=1e-9)
        assert logged[name].value == pytest.approx(truth, rel=0.03)


def test_chambers_that_are_swapped_are_as_likely_as_a_reversed_position() -> None:
    test, rig = valve_driven()
    a, b = test["pressure_a_pa"], test["pressure_b_pa"]
    swapped = with_channels(test, pressure_a_pa=b, pressure_b_pa=a)
    line = fit_friction([swapped], rig).reversed_sign
    assert "position_m is reversed, or pressure_a_pa and pressure_b_pa are swapped" in line
    assert line.endswith('--map "pressure_a_pa=pressure_b_pa" --map "pressure_b_pa=pressure_a_pa"')


@pytest.mark.parametrize(("misses", "is_said"), [(0.01, True), (0.065, False)])
def test_chambers_are_swapped_only_where_a_fit_then_misses_less(
    misses: float, is_said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Friction that varies with the position makes viscous friction negative; with the pressures
    the other way round the tests that say so were left out, and the rest passed for good."""
    test, rig = valve_driven()

    def fitted(trials: Sequence[Trial], *_: object) -> object:
        is_swapped = trials[0]["pressure_a_pa"] is test["pressure_b_pa"]
        return SimpleNamespace(is_beyond_doubt=is_swapped, misses=misses)

    monkeypatch.setattr(friction, "_whole", fitted)
    as_it_is = cast(FrictionResult, SimpleNamespace(misses=0.064))
    line = friction._reversed([test], rig, None, False, None, as_it_is)
    assert ("are swapped" in line) is is_said
