"""The averaged law as a surface: fitted to PWM tests alone, kept in bundles, simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pwm_campaign import ATMOSPHERE, KRT, VALVE_A, VALVE_B, VOLUME, Valve, campaign

from sysid.errors import NotIdentifiedError
from sysid.surfaces.averaged import AveragedLaw, PulseFlows, sampled_period
from sysid.surfaces.averaged_fit import AveragedFit, Conditions, MeanFlows, fit_averaged
from sysid.surfaces.domain import Domain
from sysid.types import FloatArray


def flows(valve: Valve, step: float = 0.08) -> MeanFlows:
    fill, out = campaign(valve, "fill", step), campaign(valve, "discharge", step)
    parts = [
        np.concatenate((getattr(fill, name), getattr(out, name)))
        for name in ("duty", "pressure", "flow")
    ]
    test = np.concatenate((fill.test, out.test + 1000))
    # Pulses of a duty of 0.0001 count as none or as one: neither is a test of the law.
    # The zero-phase filter of these samples spreads the flow's jump over some kPa, which the
    # package's own windows never cross.
    boundaries = (0.53 * valve.supply, ATMOSPHERE / 0.53)
    away = np.min([np.abs(parts[1] - p) for p in boundaries], axis=0) > 8e3
    kept = (parts[0] > 0.01) & away
    std = np.full(int(kept.sum()), 5e-6)
    per_flow = np.full(len(std), KRT / VOLUME)
    supply = np.full(len(std), valve.supply)
    centre, phases = np.full(len(std), np.nan), np.full(len(std), 1, dtype=np.intp)
    return MeanFlows(*(p[kept] for p in parts), std, test[kept], per_flow, supply, centre, phases)


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


def test_a_valve_dead_at_most_duties_ends_the_domain_there() -> None:
    """Dead levels rise by a little all the same, and were the scale of what is dead."""
    levels, pressure = np.arange(0.02, 1.0, 0.08), np.linspace(1.2e5, 2.9e5, 200)
    duty, p = (column.ravel() for column in np.meshgrid(levels, pressure))
    # The levels that answer stay near the supply.
    seen = (duty < 0.6) | (p > 2.0e5)
    duty, p = duty[seen], p[seen]
    flow = 1e-3 * (np.maximum(duty - 0.6, 0.0) + 0.002 * duty) - 3e-9 * (p - ATMOSPHERE)
    assert Domain.from_samples(duty, p, flow).duty_range == pytest.approx((0.58, 0.98))


def domain_of(share: Callable[[FloatArray], FloatArray]) -> tuple[float, float]:
    """Duties of the domain of a valve that is open by that share (n,) of the time."""
    levels, pressure = np.arange(0.02, 1.0, 0.04), np.linspace(1.0e5, 2.9e5, 200)
    duty, p = (column.ravel() for column in np.meshgrid(levels, pressure, indexing="ij"))
    noise = 2e-6 * np.random.default_rng(0).standard_normal(len(duty))
    flow = 7e-4 * share(duty) * np.sqrt((3e5 - p) / 2e5) + noise
    return Domain.from_samples(duty, p, flow).duty_range


@pytest.mark.parametrize("dead", [0.31, 0.59, 0.79])
def test_the_domain_ends_where_the_valve_is_dead(dead: float) -> None:
    found = domain_of(lambda duty: np.maximum(duty - dead, 0.0) / (1.0 - dead))
    assert found == pytest.approx((dead - 0.01, 0.98))


def test_a_strongly_bent_valve_is_not_taken_for_dead() -> None:
    """Its upper quartile was taken for the typical slope: the domain began at 0.50."""
    assert domain_of(lambda duty: duty**3) == pytest.approx((0.34, 0.98))
    assert domain_of(lambda duty: 1.0 - (1.0 - duty) ** 3) == pytest.approx((0.02, 0.66))


def test_delays_may_differ_by_more_than_half_a_period() -> None:
    valve = Valve(on_delay=6e-3, off_delay=3e-3)
    found = flows(valve, 0.05)
    found = found.select(found.duty > 0.58)
    law = fit_averaged(found, Conditions(valve.supply, ATMOSPHERE, valve.period))
    assert law.estimates["delay_difference_s"].identified
    assert law.estimates["delay_difference_s"].value == pytest.approx(-3e-3, abs=6e-5)


def test_too_few_tests_identify_nothing() -> None:
    few = flows(VALVE_A)
    few = few.select(few.test <= np.unique(few.test)[1])
    with pytest.raises(NotIdentifiedError, match="2 tests"):
        fit_averaged(few, Conditions(VALVE_A.supply, ATMOSPHERE, VALVE_A.period))


def law() -> AveragedLaw:
    return Conditions(3.0e5, 1.0e5, 5e-3).law(np.array([7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9, 3e-4]))


LINES = (3.0e5, 1.0e5)


def test_without_ripple_a_pulse_passes_the_flow() -> None:
    duty, pressure = np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(1.05e5, 2.95e5, 38))
    share = law().open_share(duty)
    for flows in (
        law().pulse(share, pressure, LINES, (0.0, 0.0)),
        law().mean_pulse(share, pressure, LINES, 0.0),
    ):
        np.testing.assert_allclose(
            flows.mean(share), law().flow(duty, pressure), rtol=1e-7, atol=1e-13
        )
        assert (flows.open >= 0.0).all() and (flows.closed <= 0.0).all()


@pytest.mark.parametrize("kind", ["thesis", "series", "iso6358"])
def test_the_flow_between_lines_is_the_law_s(kind: str) -> None:
    """With what does not depend on the pressure found ahead, to the last digit."""
    known = (4e-6, 8e-9) if kind == "series" else None
    conditions = Conditions(3.0e5, 1.0e5, 5e-3, by_iso=kind == "iso6358", valve_alone=known)
    numbers = [3e-9, 2e-9, 0.3, 0.4] if kind == "iso6358" else [7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9]
    one = conditions.law(np.array([*numbers, 3e-4]))
    pressure, share = np.linspace(0.9e5, 3.1e5, 111), np.linspace(0.0, 1.0, 111)
    found = one.between((np.full(111, 3.0e5), 1.0e5))(share, pressure)
    wanted = share * one.open_flow(pressure) + (1.0 - share) * one.closed_flow(pressure)
    np.testing.assert_array_equal(found, wanted)


def test_samples_within_a_period_are_placed_once_for_all_flows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Eight of the ten points of a Jacobian move the flows alone."""
    few = flows(VALVE_A, 0.16)
    size = len(few.flow)
    few = replace(few, centre=np.full(size, 0.3), phases=np.full(size, 5, dtype=np.intp))
    counts = {"placed": 0, "evaluated": 0}

    def placed(*given: Any) -> tuple[FloatArray, FloatArray]:
        counts["placed"] += 1
        return sampled_period(*given)

    pulse = AveragedLaw.mean_pulse

    def evaluated(*given: Any) -> PulseFlows:
        counts["evaluated"] += 1
        return pulse(*given)

    monkeypatch.setattr("sysid.surfaces.averaged_fit.sampled_period", placed)
    monkeypatch.setattr(AveragedLaw, "mean_pulse", evaluated)
    fit_averaged(few, Conditions(VALVE_A.supply, ATMOSPHERE, VALVE_A.period))
    assert counts["placed"] <= 0.45 * counts["evaluated"]


def stepped(share: float, start: float, per_flow: float, steps: int = 20_000) -> FloatArray:
    """Pressures of one period, pulse first, in small steps from `start`, Pa."""
    own = law()
    step = per_flow * own.period / steps
    found = np.empty(steps + 1)
    found[0] = pressure = start
    for i in range(steps):
        is_open = i < share * steps
        pressure += step * float(own.open_flow(pressure) if is_open else own.closed_flow(pressure))
        found[i + 1] = pressure
    return found


# About the two choked boundaries, 159 and 188.7 kPa, where the law jumps.
@pytest.mark.parametrize("start", [156.5e3, 158e3, 159.5e3, 186e3, 187.5e3, 189e3])
@pytest.mark.parametrize("share", [0.2, 0.3, 0.4])
def test_a_pulse_against_small_steps(start: float, share: float) -> None:
    per_flow = 3e9
    exact = stepped(share, start, per_flow)
    own = law()
    flow = (exact[-1] - exact[0]) / (per_flow * own.period)
    scale = float(own.choked_fill)
    drift = exact[-1] - exact[0]
    # The mean over a period holds at its middle, where the straight line has drifted half.
    at = start + 0.5 * drift
    pulse = own.pulse(np.float64(share), at, LINES, (per_flow, 0.0))
    assert float(pulse.mean(share)) == pytest.approx(flow, abs=6e-3 * scale)
    # Of one period, which the pulse begins: seen once a period at its start, it is about half of
    # its own length later.
    _, lead = sampled_period(np.float64(share), np.float64(0.5 * share), 1)
    held = own.mean_pulse(np.float64(share), float(exact.mean()), LINES, per_flow, (0.0, lead))
    assert float(held.mean(share)) == pytest.approx(flow, abs=6e-3 * scale)


def test_the_bend_of_the_ramps_is_where_the_law_jumps() -> None:
    share, start, per_flow = 0.32, 157.5e3, 3e9
    exact = stepped(share, start, per_flow)
    at = 0.5 * (exact[0] + exact[-1])
    pulse = law().pulse(np.float64(share), at, LINES, (per_flow, 0.0))
    peak = int(np.argmax(exact))
    bend = int(np.argmax(exact > 159e3))
    assert float(pulse.rise[0]) == pytest.approx(bend / peak, abs=0.03)
    assert float(pulse.rise[1]) == pytest.approx((159e3 - start) / (exact[peak] - start), abs=0.03)
