"""Campaigns in which nothing moves: valves and chambers are diagnosed and simulated alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import sysid as si
from datasets.generator.campaign import SMALL, make_campaign
from datasets.generator.effects import Injected
from datasets.generator.files import write_campaign
from datasets.generator.one_chamber import make_one_chamber_campaign
from sysid.errors import NotIdentifiedError

# Duties in coarser steps show the law and what acts on it as well.
SIZE = dataclasses.replace(SMALL, discrete_trials=3, duty_step=0.08)
DROOP = Injected("supply-droop", "coupled", "", {"droop_pa_s_per_kg": 1.28e7, "use_droop": 1.0})


def diagnosed(
    folder: Path, stems: tuple[str, ...], effects: tuple[Injected, ...] = ()
) -> si.CampaignDiagnosis:
    write_campaign(folder, make_campaign(11, size=SIZE, stems=stems, effects=effects), "made")
    campaign = si.read_campaign(folder / "campaign.toml")
    return si.diagnose(campaign, si.fit(campaign))


@pytest.mark.slow
def test_pwm_tests_alone_show_what_the_supply_lacks(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, ("valve_pwm_a", "valve_pwm_b"), (DROOP,))
    (effect,) = found.effects
    assert effect.id == "supply-droop"
    droop = effect.estimates["droop_pa_s_per_kg"].value
    assert droop == pytest.approx(DROOP.values["droop_pa_s_per_kg"], rel=0.05)
    said = "\n".join(found.notices)
    assert "the flows are those of the averaged law of its PWM tests" in said
    assert "the piston is held in every training test" in said
    # The extended bundle has the law that the effect is next to, without any friction.
    law = found.bundle.valve("a").discrete
    assert law is not None and law.choked_flow_fill_kg_s.identified
    assert found.bundle.friction is None


def test_of_one_valve_alone_nothing_is_missed_and_no_friction_is_tried(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, ("valve_pwm_a",))
    assert found.verdict == "adequate"
    tried = set(found.record.screened)
    assert {"valve-delay", "supply-droop"} <= tried
    assert not tried & {"stribeck-friction", "inertia-mismatch", "torque-offset", "backlash"}
    # Nothing was found: the bundle keeps the laws that its tests gave it.
    assert found.bundle.valve("a").discrete is None


def test_a_held_chamber_is_simulated_and_diagnosed_without_friction(tmp_path: Path) -> None:
    kinds = ("valve-discrete",)
    made = make_one_chamber_campaign(7, motion="linear", with_motor=False, kinds=kinds)
    write_campaign(tmp_path, made, "made")
    campaign = si.read_campaign(tmp_path / "campaign.toml")
    bundle = si.fit(campaign)
    assert bundle.friction is None
    log = campaign.read(campaign.logs[0])
    for run in si.simulate(log, bundle):
        assert np.ptp(run.channels["position_m"]) == 0.0
        gap = run.channels["pressure_a_pa"] - run.trial["pressure_a_pa"]
        assert np.sqrt(np.mean(gap**2)) < 1.1 * made.rig.truth.pressure_noise_pa
    assert si.diagnose(campaign, bundle).verdict == "adequate"
    free = [dataclasses.replace(t, channels={"valve_a": t["valve_a"]}) for t in log.trials]
    with pytest.raises(NotIdentifiedError, match=r"holds no friction; .* give its place as posi"):
        si.simulate(free, bundle, rig=campaign.rig)
