"""The averaged law as a surface: fitted to PWM tests alone, kept in bundles, simulated."""

from __future__ import annotations

import numpy as np
import pytest
from pwm_campaign import ATMOSPHERE, KRT, VALVE_A, VALVE_B, VOLUME, Valve, campaign

from sysid.errors import NotIdentifiedError
from sysid.surfaces.averaged import AveragedLaw
from sysid.surfaces.averaged_fit import AveragedFit, Conditions, MeanFlows, fit_averaged


def flows(valve: Valve, step: float = 0.08) -> MeanFlows:
    fill, out = campaign(valve, "fill", step), campaign(valve, "discharge", step)
    parts = [
        np.concatenate((getattr(fill, name), getattr(out, name)))
        for name in ("duty", "pressure", "flow")
    ]
    test = np.concatenate((fill.test, out.test + 1000))
    # Pulses of a duty of 0.0001 count as none or as one: neither is a test of the law.
    kept = parts[0] > 0.01
    std = np.full(int(kept.sum()), 5e-6)
    per_flow = np.full(len(std), KRT / VOLUME)
    return MeanFlows(*(p[kept] for p in parts), std, test[kept], per_flow)


def fitted(valve: Valve) -> AveragedFit:
    return fit_averaged(flows(valve), Conditions(valve.supply, ATMOSPHERE, valve.period))


@pytest.mark.parametrize("valve", [VALVE_A, VALVE_B], ids=["a", "b"])
def test_mean_flows_alone_give_the_law(valve: Valve) -> None:
    estimates = fitted(valve).estimates
    assert estimates["choked_flow_fill_kg_s"].value == pytest.approx(valve.choked_fill, rel=0.03)
    assert estimates["choked_flow_dis_kg_s"].value == pytest.approx(valve.choked_dis, rel=0.03)
    assert estimates["c_fill"].value == pytest.approx(valve.c_fill, rel=0.04)
    assert estimates["c_dis"].value == pytest.approx(valve.c_dis, rel=0.04)
    difference = estimates["delay_difference_s"]
    assert difference.value == pytest.approx(valve.off_delay - valve.on_delay, abs=6e-5)
    for estimate in estimates.values():
        assert estimate.identified
        assert estimate.interval[0] < estimate.value < estimate.interval[1]


def test_too_few_tests_identify_nothing() -> None:
    few = flows(VALVE_A)
    few = few.select(few.test <= np.unique(few.test)[1])
    with pytest.raises(NotIdentifiedError, match="2 tests"):
        fit_averaged(few, Conditions(VALVE_A.supply, ATMOSPHERE, VALVE_A.period))


def law() -> AveragedLaw:
    return Conditions(3.0e5, 1.0e5, 5e-3).law(np.array([7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9, 3e-4]))


def test_without_ripple_the_parts_add_up_to_the_flow() -> None:
    duty, pressure = np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(1.05e5, 2.95e5, 38))
    fill, exhaust = law().parts(duty, pressure, 3.0e5, 1.0e5, 0.0)
    np.testing.assert_allclose(fill + exhaust, law().flow(duty, pressure), rtol=1e-9, atol=1e-15)
    assert (fill >= 0.0).all() and (exhaust <= 0.0).all()


@pytest.mark.parametrize("boundary", [0.53 * 3.0e5, 1.0e5 / 0.53])
def test_the_ripple_averages_across_a_choked_boundary(boundary: float) -> None:
    """Against pulses stepped through in time, at a held mean pressure about the boundary."""
    own, duty, per_flow = law(), 0.5, 6e9
    steps = 4000
    is_open = (np.arange(steps) < own.open_share(duty) * steps).astype(float)
    errors, without = [], []
    for offset in (-1500.0, -500.0, 500.0, 1500.0):
        mean, wanted, drift = boundary + offset, 0.0, 0.0
        level = np.zeros(steps)
        for _ in range(40):  # the ripple about the mean pressure, by fixed point
            flow = is_open * own.open_flow(mean + level) + (1 - is_open) * own.closed_flow(
                mean + level
            )
            wanted = float(flow.mean())
            drift = np.cumsum(flow - wanted) * per_flow * own.period / steps
            level = drift - drift.mean()
        found = float(np.sum(own.parts(duty, mean, 3.0e5, 1.0e5, per_flow)))
        errors.append(abs(found - wanted))
        without.append(abs(float(own.flow(duty, mean)) - wanted))
    assert max(errors) < 0.35 * max(without)
