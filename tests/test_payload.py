"""`payload_mass_kg` of a log: tests described in the log or in the rig file are the same tests."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from datasets.generator.campaign import SMALL, GeneratedCampaign, make_campaign
from datasets.generator.files import write_log
from datasets.generator.rigs import random_rig, rig_toml
from sysid.balance.imposed import effort_rmse
from sysid.checks.consistency.campaign import check_consistency
from sysid.commands.app import main
from sysid.diagnosis.actuator.equation_error import EFFORT, equation_error
from sysid.diagnosis.actuator.samples import Rows, prepare
from sysid.diagnosis.actuator.states import integrate_states
from sysid.errors import InputError
from sysid.friction import fit_friction
from sysid.io.campaign import Campaign, read_campaign
from sysid.io.rig import NO_LOAD
from sysid.parameters import Bundle
from sysid.plant.effects.linkage import LinkFlexibility
from sysid.plant.tangents import simulate_tangents
from sysid.plant.trials import inputs_from_trial, simulate_trials
from sysid.recording.even import recorded
from sysid.recording.motion_tests import prepare_all
from sysid.validation.open_loop import validate

PAYLOAD = 0.6
STEMS = ("friction_static", "friction_sliding", "motion_motor_2", "motion_pwm_2")
RIGS = [("horizontal", "rotary"), ("vertical", "rotary"), ("vertical", "linear")]


@pytest.fixture(scope="module", params=RIGS, ids=" ".join)
def made(request: pytest.FixtureRequest) -> GeneratedCampaign:
    orientation, motion = request.param
    rig = random_rig(np.random.default_rng(4), orientation, motion, PAYLOAD)
    return make_campaign(4, size=SMALL, scatter=0.0, rig=rig, stems=STEMS)


def written(made: GeneratedCampaign, folder: Path, *, in_logs: bool) -> Campaign:
    """The campaign, with the payload in its rig file or in each log."""
    folder.mkdir()
    content = copy.deepcopy(made.rig.content)
    if in_logs:
        content["inertia"]["payload_mass_kg"] = 0.1
    (folder / "rig.toml").write_text(rig_toml(content))
    lines = ['rig = "rig.toml"']
    for log in made.logs:
        write_log(folder / f"{log.stem}.csv", log.tests, made.rig)
        lines += ["[[log]]", f'kind = "{log.kind}"', f'file = "{log.stem}.csv"']
        lines += [f'use = "{log.use}"']
        lines += [f"payload_mass_kg = {PAYLOAD}"] if in_logs else []
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    return read_campaign(folder / "campaign.toml")


@pytest.fixture(scope="module")
def campaigns(
    made: GeneratedCampaign, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Campaign, Campaign]:
    folder = tmp_path_factory.mktemp("payload")
    return tuple(  # type: ignore[return-value]
        written(made, folder / str(in_logs), in_logs=in_logs) for in_logs in (False, True)
    )


def bundle_of(made: GeneratedCampaign, campaign: Campaign) -> Bundle:
    from test_validation import true_bundle

    return true_bundle(made, campaign.rig)


def test_friction(campaigns: tuple[Campaign, Campaign]) -> None:
    found = []
    for campaign in campaigns:
        logs = [campaign.read(entry) for entry in campaign.logs[:2]]
        found.append(fit_friction([t for log in logs for t in log.trials], campaign.rig))
    rig_file, per_log = found
    for name, one in rig_file.parameters.items():
        assert per_log[name].identified == one.identified
        if one.identified:
            assert per_log[name].value == pytest.approx(one.value, rel=1e-9)


def test_inertia_from_motion_is_without_it(
    made: GeneratedCampaign, campaigns: tuple[Campaign, Campaign]
) -> None:
    """The fitted inertia holds with the rig file's payload, whatever each log carried."""
    if made.rig.is_linear:
        pytest.skip("the motor hardly moves this rig's weight")
    truth = made.rig.content["inertia"]["equivalent_kg_m2"]
    for campaign in campaigns:
        entry = next(e for e in campaign.logs if e.kind == "motion-motor")
        trials = campaign.read(entry).trials
        fit = fit_friction(trials, campaign.rig, kind="motion", estimate_inertia=True)
        inertia = fit.parameters["inertia"]
        assert abs(inertia.value - campaign.rig.payload_inertia() - truth) < 3.0 * inertia.std


def test_simulations(made: GeneratedCampaign, campaigns: tuple[Campaign, Campaign]) -> None:
    rmse = []
    for campaign in campaigns:
        found = validate(campaign, bundle_of(made, campaign))
        logs = found.select(model="discrete")
        rmse.append([c.errors.rmse for log in logs for c in log.channels.values()])
    assert rmse[1] == pytest.approx(rmse[0], rel=1e-6)


def test_tangents(made: GeneratedCampaign, campaigns: tuple[Campaign, Campaign]) -> None:
    slopes = []
    for campaign in campaigns:
        entry = next(e for e in campaign.logs if e.kind == "motion-motor")
        trial = campaign.read(entry).trials[0]
        model = bundle_of(made, campaign).model(campaign.rig)
        inputs = inputs_from_trial(trial, campaign.rig)
        (run,) = simulate_tangents([inputs], [model], [(0, "inertia"), (0, "viscous")])
        slopes.append(np.asarray(run.slopes))
        (simulated,) = simulate_trials([trial], campaign.rig, model)
        channel = campaign.rig.position_channel
        assert simulated[channel] == pytest.approx(np.asarray(run.states)[0], abs=1e-6)
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-5, atol=1e-6 * np.abs(slopes[0]).max())


def test_balance_along_the_measured_motion(
    made: GeneratedCampaign, campaigns: tuple[Campaign, Campaign]
) -> None:
    errors, rmse, along = [], [], []
    for campaign in campaigns:
        entries = [e for e in campaign.logs if e.kind.startswith("motion")]
        trials = [(e.file, e.kind, t) for e in entries for t in campaign.read(e).trials]
        model = bundle_of(made, campaign).model(campaign.rig)
        traces = prepare(trials, campaign.rig, model)
        along.append((traces, model))
        errors.append(equation_error(traces, model, (EFFORT,))[EFFORT])
        some = traces.at(Rows(np.arange(100, 200)))
        assert some.carried.shape == (100, 3 if len(errors) == 2 else 0)
        motor = [t for _, kind, t in trials if kind == "motion-motor"]
        rmse.append(effort_rmse([recorded(t, campaign.rig, []) for t in motor], model))
    np.testing.assert_allclose(errors[1], errors[0], atol=1e-9 * np.abs(errors[0]).max())
    if made.rig.is_linear:
        return
    # A link that bends under the load has a state that depends on it.
    bent = LinkFlexibility.typical()
    states = [integrate_states(t, m + bent, needs_flow=False) for t, m in along]
    for name in states[0]:
        scale = np.abs(states[0][name]).max()
        np.testing.assert_allclose(states[1][name], states[0][name], atol=1e-6 * scale)
    # So has its effort: a share of the inertia and the load together.
    by_link = [equation_error(t, m + bent, (EFFORT,))[EFFORT] for t, m in along]
    np.testing.assert_allclose(by_link[1], by_link[0], atol=1e-6 * np.abs(by_link[0]).max())
    assert rmse[1] == pytest.approx(rmse[0], rel=1e-9)


def test_logs_do_not_contradict_one_another(campaigns: tuple[Campaign, Campaign]) -> None:
    assert [check_consistency(campaign, "fit") for campaign in campaigns] == [(), ()]


def test_where_it_is_said(campaigns: tuple[Campaign, Campaign], tmp_path: Path) -> None:
    _, campaign = campaigns
    assert [s.to_json()["payload_mass_kg"] for s in campaign.sources()] == [PAYLOAD] * 4
    assert main(["fit", str(campaign.path), "-o", str(tmp_path / "b.json")]) == 0
    logs = json.loads((tmp_path / "b.json").read_text())["provenance"]["logs"]
    assert {log.get("payload_mass_kg") for log in logs} == {PAYLOAD}
    (tests, _) = prepare_all(
        campaign.read(campaign.logs[2]).trials, campaign.logs[2].kind, campaign.rig, 1.0
    )
    assert all(test.load != NO_LOAD for test in tests)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ('"heavy"', "payload_mass_kg = 'heavy' is not a number"),
        ("-1.0", "payload_mass_kg = -1 is not plausible"),
    ],
)
def test_values_that_are_none(value: str, said: str, tmp_path: Path, rig_text: str) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    (tmp_path / "a.csv").write_text("time_s\n0\n")
    text = 'rig = "rig.toml"\n[[log]]\nkind = "motion-motor"\nfile = "a.csv"\npayload_mass_kg = '
    (tmp_path / "campaign.toml").write_text(text + value + "\n")
    with pytest.raises(InputError, match=rf"entry 1 \(a.csv\): {said}"):
        read_campaign(tmp_path / "campaign.toml")


def test_the_rig_file_says_where_it_is(tmp_path: Path, rig_text: str) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    (tmp_path / "a.csv").write_text("time_s\n0\n")
    text = (
        'rig = "rig.toml"\n[[log]]\nkind = "motion-motor"\nfile = "a.csv"\npayload_mass_kg = 1.0\n'
    )
    (tmp_path / "campaign.toml").write_text(text)
    with pytest.raises(InputError, match=r"payload_length_m is missing, but .*entry 1 \(a.csv\)"):
        read_campaign(tmp_path / "campaign.toml")
    (tmp_path / "campaign.toml").write_text(text.replace("1.0", "0.0"))
    assert read_campaign(tmp_path / "campaign.toml").logs[0].payload_kg == 0.0
