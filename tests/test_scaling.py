"""Logs that are so many times slower, faster or larger give the same numbers, in their units.

By similarity: a rig whose chambers are wider and whose motion takes longer has efforts, flows and
delays in the ratios of areas, volumes and times, and its logs are those of the first, scaled. What
a fit makes of them may not depend on how fast the rigs are that it was written for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

import sysid as si
from datasets.generator.campaign import GeneratedCampaign
from datasets.generator.files import write_campaign
from datasets.generator.one_chamber import make_one_chamber_campaign, scaled
from sysid.estimation.linear import Estimate

Estimates = Mapping[str, Estimate]
FLOWS = ("c_fill", "c_dis", "choked_flow_fill_kg_s", "choked_flow_dis_kg_s")


def campaign_of(kind: str) -> GeneratedCampaign:
    return make_one_chamber_campaign(
        5, motion="linear", with_motor=True, kinds=(kind,), duty_step=0.12
    )


def fitted(made: GeneratedCampaign, folder: Path) -> si.Bundle:
    write_campaign(folder, made, "made")
    return si.fit(si.read_campaign(folder / "campaign.toml"), surface="bipolynomial")


def of_switched(bundle: si.Bundle) -> Estimates:
    law = bundle.valve("a").discrete
    assert law is not None
    return {name: getattr(law, name) for name in (*FLOWS, "on_delay_s", "off_delay_s")}


def of_pulsed(bundle: si.Bundle) -> Estimates:
    law = bundle.valve("a").averaged()
    assert law is not None
    return {name: getattr(law, name) for name in (*FLOWS, "delay_difference_s")}


@pytest.mark.parametrize(
    ("kind", "numbers"), [("valve-discrete", of_switched), ("valve-pwm", of_pulsed)]
)
@pytest.mark.parametrize(("time", "area"), [(10.0, 1.0), (0.1, 1.0), (20.0, 10.0)])
def test_valves_of_any_speed_and_size(
    tmp_path: Path, kind: str, numbers: Callable[[si.Bundle], Estimates], time: float, area: float
) -> None:
    made = campaign_of(kind)
    one = numbers(fitted(made, tmp_path / "one"))
    other = numbers(fitted(scaled(made, time=time, area=area), tmp_path / "other"))
    for name, estimate in one.items():
        factor = time if name.endswith("delay_s") or name.startswith("delay") else area / time
        found = other[name].times(1.0 / factor)
        assert abs(found.value - estimate.value) < 0.05 * estimate.std, name
        assert found.std == pytest.approx(estimate.std, rel=0.05), name


@pytest.mark.parametrize("time", [10.0, 0.1])
def test_friction_from_motion_of_any_speed(tmp_path: Path, time: float) -> None:
    """A slow one is sampled more densely next to its noise, so that its errors are larger; a fast
    one has a filter that does not smear it."""
    made = campaign_of("friction-motion")
    one, other = (
        fitted(campaign, tmp_path / name).friction
        for name, campaign in (("one", made), ("other", scaled(made, time=time)))
    )
    assert one is not None and other is not None
    for name, factor in (("coulomb", 1.0), ("viscous", time)):
        before, after = one.in_motion(name), other.in_motion(name)
        assert before is not None and after is not None
        after = after.times(1.0 / factor)
        assert abs(after.value - before.value) < 2.0 * max(after.std, before.std), name
        assert after.std < (1.2 if time < 1.0 else 4.0) * before.std, name


def test_a_larger_cylinder_has_the_same_friction_for_its_size(tmp_path: Path) -> None:
    made = campaign_of("friction-motion")
    one, other = (
        fitted(campaign, tmp_path / name).friction
        for name, campaign in (("one", made), ("other", scaled(made, area=100.0)))
    )
    assert one is not None and other is not None
    for name in ("coulomb", "viscous"):
        before, after = one.in_motion(name), other.in_motion(name)
        assert before is not None and after is not None
        assert after.value == pytest.approx(100.0 * before.value, rel=1e-4), name
