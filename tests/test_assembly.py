"""A campaign's parts in one bundle: where friction comes from when its own tests do not give it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pandas as pd
import pytest
from golden_folder import BUNDLED
from test_friction_combinations import slid

from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.campaign import FRICTION_KINDS, MOTION_KINDS, Campaign, read_campaign
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import assumed_parameters, model_from_bundle
from sysid.parameters.valves import AveragedRecord, PwmDirections
from sysid.pipeline.fit import fit_campaign
from sysid.plant.base import exhaust_jump, filling_jump


def only(campaign: Campaign, *kinds: str) -> Campaign:
    """The campaign with its logs of these kinds alone."""
    logs = tuple(entry for entry in campaign.logs if entry.kind in kinds)
    return dataclasses.replace(campaign, logs=logs)


@pytest.fixture(scope="module")
def bundled() -> Campaign:
    return read_campaign(BUNDLED / "campaign.toml")


def test_motion_logs_give_friction_where_no_test_is_for_it(bundled: Campaign) -> None:
    own = fit_campaign(only(bundled, *FRICTION_KINDS)).bundle.friction
    found = fit_campaign(only(bundled, *MOTION_KINDS))
    friction = found.bundle.friction
    assert own is not None and friction is not None
    assert friction.source == "friction-motion"
    # Under pressure the seals, an effect that the rig does not declare, add to it.
    assert friction.coulomb_nm.value == pytest.approx(own.coulomb_nm.value, rel=0.2)
    assert any("taken from the motion logs" in n for n in found.notices)
    logs = {log.file: log.use for log in found.bundle.provenance.logs}
    assert logs["motion_motor.parquet"] == "fit"


def test_static_friction_that_no_test_shows_is_coulomb_friction_and_said(bundled: Campaign) -> None:
    bundle = fit_campaign(only(bundled, *MOTION_KINDS)).bundle
    assert bundle.friction is not None and not bundle.friction.static_nm.identified
    p = model_from_bundle(bundle, bundled.rig).parameters
    assert p.static_effort == p.coulomb_effort == bundle.friction.coulomb_nm.value
    (notice,) = assumed_parameters(bundle)
    assert "static_nm is not identified: the model uses coulomb_nm" in notice


def test_friction_tests_that_suffice_leave_the_motion_logs_alone(bundled: Campaign) -> None:
    found = fit_campaign(only(bundled, *FRICTION_KINDS, *MOTION_KINDS))
    assert found.bundle.friction is not None
    assert found.bundle.friction.source == "friction-sliding"
    fitted = {log.kind for log in found.bundle.provenance.logs if log.use == "fit"}
    assert not fitted & set(MOTION_KINDS)


def test_a_copy_that_is_held_out_is_said(bundled: Campaign, tmp_path: Path) -> None:
    (sliding,) = only(bundled, "friction-sliding").logs
    copy = tmp_path / "other.parquet"
    copy.write_bytes(sliding.path.read_bytes())
    twice = (sliding, dataclasses.replace(sliding, path=copy, use="holdout"))
    found = fit_campaign(dataclasses.replace(bundled, logs=twice))
    (notice,) = (n for n in found.notices if "byte for byte" in n)
    assert "other.parquet is a copy of" in notice and "what is fitted is not held out" in notice
    friction = only(bundled, *FRICTION_KINDS)
    assert friction.copies(friction.sources()) == []


def test_the_vertical_sample_has_friction(shared_samples: Path) -> None:
    """Its arm swings to rest in every trial; the friction is that of the samples' README."""
    campaign = read_campaign(shared_samples / "rig-3" / "campaign.toml")
    found = fit_campaign(only(campaign, "friction-static", "friction-sliding")).bundle.friction
    assert found is not None
    assert found.coulomb_nm.value == pytest.approx(0.249, rel=0.03)
    assert found.viscous_nm_s_per_rad.value == pytest.approx(0.049, rel=0.08)
    without = fit_campaign(only(campaign, "friction-static", *MOTION_KINDS)).bundle.friction
    assert without is not None and without.source == "friction-motion"
    assert without.coulomb_nm.value == pytest.approx(0.249, rel=0.03)
    assert without.viscous_nm_s_per_rad.value == pytest.approx(0.049, rel=0.08)


def test_friction_tests_in_one_direction_give_the_sum(tmp_path: Path) -> None:
    frames = [
        pd.DataFrame({"time_s": one.time, **one.channels, "test": k})
        for k, one in enumerate(slid((0.25, 0.31), (1.0,), 0.005))
    ]
    pd.concat(frames).to_csv(tmp_path / "sliding.csv", index=False)
    (tmp_path / "rig.toml").write_text(
        '[rig]\nname = "arm"\norientation = "horizontal"\nmotion = "rotary"\n\n'
        "[inertia]\nequivalent_kg_m2 = 0.024\n"
    )
    path = tmp_path / "campaign.toml"
    path.write_text(
        'rig = "rig.toml"\n\n[[log]]\nfile = "sliding.csv"\nkind = "friction-sliding"\n'
    )
    found = fit_campaign(read_campaign(path))
    friction = found.bundle.friction
    assert friction is not None
    assert list(friction.sums()) == ["coulomb_nm + offset_nm"]
    assert friction.viscous_nm_s_per_rad is not None and friction.viscous_nm_s_per_rad.identified
    assert any("other direction" in n and "would separate" in n for n in found.notices)


def test_a_flow_of_one_regime_follows_from_that_of_the_other_and_is_said(
    bundled: Campaign,
) -> None:
    kinds = ("friction-static", "friction-sliding", "valve-discrete")
    bundle = fit_campaign(only(bundled, *kinds)).bundle
    valves = bundle.valves
    assert valves is not None and assumed_parameters(bundle) == []
    known = model_from_bundle(bundle, bundled.rig).parameters

    def without(*keys: str) -> Bundle:
        lacking = {key: Estimate.unidentified("kg/s", "it scatters") for key in keys}
        law = bundle.valve("b").discrete
        assert law is not None
        b = bundle.valve("b").replaced(discrete=law.replaced(**lacking))
        return bundle.replaced(valves=valves.replaced(b=b))

    for keys in (("choked_flow_fill_kg_s", "c_dis"), ("c_fill", "choked_flow_dis_kg_s")):
        lacking = without(*keys)
        p = model_from_bundle(lacking, bundled.rig).parameters
        air = bundled.rig.air
        assert air is not None
        fill = filling_jump(air.supply_pressure_pa, p.choked_fill_b, p.c_fill_b)
        out = exhaust_jump(air.atmospheric_pressure_pa, p.choked_dis_b, p.c_dis_b)
        assert fill == pytest.approx(0.0, abs=1e-12) and out == pytest.approx(0.0, abs=1e-12)
        assert p.choked_fill_a == known.choked_fill_a
        said = [n for n in assumed_parameters(lacking) if "valves.b.discrete: " in n]
        assert len(said) == 2
        assert all(any(f"{key} is not identified" in n for n in said) for key in keys)
    lacking = without("choked_flow_fill_kg_s", "c_fill")
    with pytest.raises(NotIdentifiedError, match="choked_flow_fill_kg_s is not identified"):
        model_from_bundle(lacking, bundled.rig)
    seen = {
        "choked_flow_fill_kg_s": 1.2e-3, "c_fill": 2e-6, "choked_flow_dis_kg_s": 4e-4,
        "c_dis": 4e-9, "delay_difference_s": 1e-4,
    }  # fmt: skip
    found = {key: Estimate.symmetric(v, 0.01 * v, "1", 9.0) for key, v in seen.items()}
    averaged = AveragedRecord(**found)
    b = lacking.valve("b").replaced(pwm=PwmDirections(averaged=averaged))
    pulsed = lacking.replaced(valves=valves.replaced(b=b))
    p = model_from_bundle(pulsed, bundled.rig).parameters
    assert (p.choked_fill_b, p.c_fill_b) == (1.2e-3, 2e-6)
    assert p.choked_dis_b == known.choked_dis_b
    said = [n for n in assumed_parameters(pulsed) if "that of the averaged law" in n]
    assert len(said) == 2
