"""Tests that play themselves: commands within limits, what they tell, the file, its recognition."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from datasets.generator.campaign import SMALL, make_campaign
from datasets.generator.files import write_log
from datasets.generator.rigs import rig_toml
from sysid.checks.log_check import check_log
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign, read_campaign
from sysid.io.logs import read_log
from sysid.io.played_header import played_header
from sysid.parameters import Bundle, Parts, read_bundle, write_bundle
from sysid.parameters.friction import Friction
from sysid.parameters.valves import FittedValves
from sysid.plant.base import load_effort
from sysid.plant.trials import simulate_trials
from sysid.refinement.advice import Beginning, begin
from sysid.refinement.information import covariance, log_volume
from sysid.refinement.played import design
from sysid.refinement.played.design import exchanged
from sysid.refinement.played.limits import (
    MotionLimits,
    extremes,
    held_reach,
    inside,
    off_plants,
)
from sysid.refinement.played.proposal import PlayRequest, played_test
from sysid.refinement.played.result import PlayedTest
from sysid.refinement.played.signals import Actuators, Drive

SEED, SHARE = 5, 0.03
ASKED = "valves.a.c_fill"


def estimate(value: float) -> Estimate:
    return Estimate.symmetric(value, SHARE * abs(value), "SI", math.inf)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of bench tests alone, and a bundle of the true parameters, known to 3 %."""
    path = tmp_path_factory.mktemp("played")
    made = make_campaign(SEED, size=SMALL, kinds=("friction-sliding",))
    (path / "rig.toml").write_text(rig_toml(made.rig.content))
    write_log(path / "sliding.csv", made.logs[0].tests, made.rig)
    entry = '[[log]]\nkind = "friction-sliding"\nfile = "sliding.csv"\n'
    (path / "campaign.toml").write_text(f'rig = "rig.toml"\n{entry}')
    friction = {k: estimate(v) for k, v in made.truth["friction"].items()}
    valves = {
        side: {"discrete": {k: estimate(v) for k, v in law.items()}}
        for side, law in made.truth["valves"].items()
    }
    parts = Parts(Friction.model_validate(friction), FittedValves.model_validate(valves))
    bundle = Bundle.new(read_campaign(path / "campaign.toml").rig, parts, [])
    write_bundle(bundle, path / "bundle.json")
    return path


@pytest.fixture(scope="module")
def campaign(folder: Path) -> Campaign:
    return read_campaign(folder / "campaign.toml")


@pytest.fixture(scope="module")
def began(folder: Path, campaign: Campaign) -> Beginning:
    return begin(campaign, read_bundle(folder / "bundle.json"))


@pytest.fixture(scope="module")
def played(began: Beginning) -> PlayedTest:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "_POOL", 16)
        patch.setattr(design, "_ROUNDS", 1)
        patch.setattr(design, "_LAST_ROUNDS", 2)
        patch.setattr(design, "_VARIED", 24)
        return played_test(began, PlayRequest((ASKED,), 2.5, speed=12.0))


# --- commands --------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["motion-motor", "motion-pwm", "motion-discrete"])
def test_commands_begin_and_end_at_rest_and_stay_in_range(kind: str, campaign: Campaign) -> None:
    rig = Actuators.of(campaign.rig, 0.001, 1.25, 0.5)
    rng = np.random.default_rng(1)
    for _ in range(20):
        drive = Drive.drawn(kind, rng, rig).changed(rng, rig)
        motor, valves = drive.commands(rig)
        ends = np.r_[0:20, len(motor) - 20 : len(motor)]
        assert not motor[ends].any() and np.abs(motor).max() <= 0.5
        if kind == "motion-motor":
            assert valves is None
            continue
        assert valves is not None and not valves[:, ends].any()
        assert valves.min() >= 0.0 and valves.max() <= 1.0
        rows = rig.pwm_rows if kind == "motion-pwm" else rig.hold_rows
        changes = np.flatnonzero(np.diff(valves).any(axis=0)) + 1
        assert (changes % rows == 0).all()


def test_a_smaller_drive_moves_less(began: Beginning) -> None:
    model, rig = began.setting.model, Actuators.of(began.campaign.rig, 0.001, 1.25, 0.7)
    rng = np.random.default_rng(2)
    drives = [Drive.drawn("motion-discrete", rng, rig) for _ in range(6)]
    reach = MotionLimits(0.2, math.inf, math.inf)
    small = [dataclasses.replace(d, size=0.05) for d in drives]
    assert (
        inside(small, rig, [model], reach, 0).sum() > inside(drives, rig, [model], reach, 0).sum()
    )


# --- plants that differ ----------------------------------------------------------------


def test_plants_are_off_by_a_fifth(began: Beginning) -> None:
    model = began.setting.model
    plants = off_plants(began.bundle, began.campaign.rig, model, 8, 1)
    for name in ("coulomb_effort", "choked_fill_a", "c_dis_b", "inertia", "area_a"):
        ratios = [
            float(getattr(p.parameters, name)) / float(getattr(model.parameters, name))
            for p in plants
        ]
        assert {round(r, 6) for r in ratios} == {0.8, 1.2}
    assert all(
        p.parameters.area_a / p.parameters.area_b
        == pytest.approx(model.parameters.area_a / model.parameters.area_b)
        for p in plants
    )


def test_limits_hold_on_plants_never_tried(played: PlayedTest, began: Beginning) -> None:
    other = off_plants(began.bundle, began.campaign.rig, began.setting.model, 40, 987)
    far, fast = extremes(played.motions, other)
    assert far <= played.limits.position and fast <= played.limits.speed
    assert far > 0.0
    assert max(np.abs(m.motor).max() for m in played.motions) <= played.limits.effort


def test_a_test_begins_only_where_friction_holds_the_arm(began: Beginning) -> None:
    """Everywhere in the horizontal; of an arm that hangs, until its weight overcomes friction."""
    model, limits = began.setting.model, MotionLimits(1.2, math.inf, math.inf)
    assert held_reach([model], limits) == 1.2
    p = model.parameters
    heavy = dataclasses.replace(model, parameters=p.replace(gravity_moment=2.0 * p.static_effort))
    reach = held_reach([model, heavy], limits)
    assert abs(load_effort(reach, heavy.parameters)) <= p.static_effort
    assert 0.4 < reach < math.asin(0.5)
    sprung = p.replace(stiffness=1.0, preload=2.0 * p.static_effort)
    assert held_reach([dataclasses.replace(model, parameters=sprung)], limits) == 0.0


# --- what is asked ---------------------------------------------------------------------


def test_the_test_tells_what_was_asked(played: PlayedTest) -> None:
    (asked,) = played.expected
    assert asked.name == ASKED
    assert asked.now == pytest.approx(SHARE * asked.value, rel=0.01)
    assert asked.after < 0.1 * asked.now
    assert "90 %" not in played.headline() and ASKED in played.headline()


def test_an_exchange_finds_the_best_pair() -> None:
    """Against all pairs, for a criterion under which no single option is good."""
    rng = np.random.default_rng(4)
    options = [np.outer(v, v) for v in rng.standard_normal((9, 3))]
    now = 1e-3 * np.eye(3)

    def criterion(m: np.ndarray) -> np.ndarray:
        return np.asarray(np.trace(np.linalg.inv(m), axis1=-2, axis2=-1))

    best = min(
        (criterion(now + options[i] + options[j] + options[k]), i, j, k)
        for i in range(9)
        for j in range(i, 9)
        for k in range(j, 9)
    )
    kept = exchanged(options, now, 3, criterion)
    reached = criterion(now + sum(options[i] for i in kept))
    assert reached <= 1.2 * best[0]
    # No single exchange improves it.
    for place in range(3):
        for i in range(9):
            other = [*kept[:place], i, *kept[place + 1 :]]
            assert criterion(now + sum(options[j] for j in other)) >= reached - 1e-9


def test_the_volume_of_errors_is_that_of_their_covariance() -> None:
    """Of a stack; also where a parameter is hardly known, and one not at all."""
    rng = np.random.default_rng(6)
    stack = np.array([a.T @ a for a in rng.standard_normal((5, 9, 4)) * [1.0, 1e3, 1e-2, 0.0]])
    for columns in ([0], [1, 2], [3]):
        own = [covariance(one)[np.ix_(columns, columns)] for one in stack]
        assert log_volume(stack, columns) == pytest.approx(np.linalg.slogdet(own)[1], abs=1e-6)


def test_what_cannot_be_asked_is_one_line(began: Beginning) -> None:
    with pytest.raises(InputError, match=r"parameter 'valves.c'.*unknown"):
        played_test(began, PlayRequest(("valves.c",)))
    with pytest.raises(InputError, match=r"1 s is too short; give at least 1.25 s"):
        played_test(began, PlayRequest((ASKED,), 1.0))


# --- the file, and the log that comes back ---------------------------------------------


def test_the_file_is_simulated_and_recognised(
    played: PlayedTest, began: Beginning, tmp_path: Path
) -> None:
    rig = began.campaign.rig
    path = played.write(tmp_path / "test.csv")
    log = read_log(path, rig)
    assert len(log) == len(played.motions)
    assert any(m.start for m in played.motions)
    shown = simulate_trials(log.trials, rig, began.setting.model)
    for channels, motion in zip(shown, played.motions, strict=True):
        # The file rounds the motor's command: within a thousandth of a count.
        shown_at = channels[rig.position_channel]
        assert shown_at == pytest.approx(motion.channels[0], abs=1e-3 * (rig.encoder_step or 0.0))
    # What a rig records: the commands with the measured channels, under the same comments.
    frame = played.frame
    for name in (rig.position_channel, "pressure_a_pa", "pressure_b_pa"):
        frame[name] = np.concatenate([c[name] for c in shown])
    back = tmp_path / "recorded.csv"
    head = [line for line in path.read_text().splitlines() if line.startswith("#")]
    back.write_text("\n".join([*head, frame.to_csv(index=False)]))
    found = check_log(read_log(back, rig), rig)
    assert set(found.kinds) == {played.kind}
    assert any("designed for valves.a.c_fill" in line for line in found.notices)
    assert not found.contradicts
    (other,) = {"motion-pwm", "motion-discrete"} - {played.kind}
    wrong = check_log(read_log(back, rig), rig, other)
    assert any(f'give kind = "{played.kind}"' in line for line in wrong.contradicts)
    # Without them, by its content.
    back.write_text(frame.to_csv(index=False))
    assert set(check_log(read_log(back, rig), rig).kinds) == {played.kind}


def test_a_header_says_what_it_was_made_of() -> None:
    header = played_header(
        ["rig x", "sysid test: motion-pwm", "for: a.b kg/(s_Pa), expected standard error 2, now 3"]
    )
    assert header is not None and header.kind == "motion-pwm"
    assert header.asked == (("a.b", 3.0, 2.0, "kg/(s Pa)"),)
    again = dataclasses.replace(header, starts={"2": -0.25}, unit="rad")
    assert played_header(again.lines()) == again
    assert played_header(["sysid test:", "for: x"]) is None


def test_the_command_writes_a_test(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(design, "_POOL", 10)
    monkeypatch.setattr(design, "_ROUNDS", 1)
    monkeypatch.setattr(design, "_LAST_ROUNDS", 0)
    monkeypatch.setattr(design, "_VARIED", 4)
    monkeypatch.setattr("sysid.refinement.advice.effect_sizes", lambda *_: ((), {}))
    out = tmp_path / "test.csv"
    words = ["advise", str(folder / "campaign.toml"), "--bundle", str(folder / "bundle.json")]
    assert main([*words, "--for", ASKED]) == 2
    assert "--for needs -o" in capsys.readouterr().err
    more = ["-o", str(out), "--for", ASKED, "--duration", "1.25", "--json"]
    assert main([*words, *more]) == 0
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert "its speed is not limited" not in said.out and "give --max-speed" in said.err
    assert told["written"] == str(out) and out.is_file()
    assert told["test"]["expected"][0]["parameter"] == ASKED
    assert told["test"]["reached"]["position"] <= told["test"]["limits"]["position"]
