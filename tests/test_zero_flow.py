"""Filling and discharging surfaces meet at the line of zero flow."""

from __future__ import annotations

import numpy as np
import pytest
from pwm_campaign import VALVE_A, campaign

from sysid.surfaces import Bipolynomial, Domain, DutyNetwork, SurfacePoints, surface_points
from sysid.surfaces.zero_flow import TIE_SHARE, apart_from, tie_points
from sysid.types import FloatArray

DIRECTIONS = ("fill", "discharge")
Measured = dict[str, tuple[SurfacePoints, Domain]]


@pytest.fixture(scope="module")
def measured() -> Measured:
    found = {}
    for direction in DIRECTIONS:
        s = campaign(VALVE_A, direction, 0.05)
        domain = Domain.from_samples(s.duty, s.pressure, s.flow)
        points = surface_points(s.duty, s.pressure, s.flow, s.test)
        found[direction] = points.select(domain.holds_duty(points.duty)), domain
    return found


def ties_of(measured: Measured, direction: str) -> SurfacePoints:
    other = DIRECTIONS[1 - DIRECTIONS.index(direction)]
    points, domain = measured[direction]
    return tie_points(points, measured[other][0], domain)


def networks(measured: Measured, tied: bool) -> dict[str, DutyNetwork]:
    found = {}
    for direction, (points, domain) in measured.items():
        if tied:
            ties = ties_of(measured, direction)
            points = points.joined(ties)
            domain = domain.with_points(ties.duty, ties.pressure, ties.flow)
        network = DutyNetwork(domain=domain, restarts=6)
        network.fit(np.column_stack((points.flow, points.pressure)), points.duty, None, points.test)
        found[direction] = network
    return found


def gap(surfaces: dict[str, DutyNetwork], pressure: FloatArray) -> float:
    """RMS difference of the duties that hold the chamber, by direction."""
    duties = [surfaces[d].duty(0.0, pressure)[0] for d in DIRECTIONS]
    return float(np.sqrt(np.mean((duties[0] - duties[1]) ** 2)))


def test_ties_are_the_other_directions_points_near_zero_flow(measured: Measured) -> None:
    own, domain = measured["fill"]
    ties = ties_of(measured, "fill")
    largest = max(float(np.abs(points.flow).max()) for points, _ in measured.values())
    assert len(ties.duty) > 20
    assert np.abs(ties.flow).max() <= TIE_SHARE * largest
    assert ties.flow.min() < 0.0
    low, high = domain.pressure_range
    assert ((ties.pressure >= low) & (ties.pressure <= high)).all()
    assert not np.isin(ties.test, own.test).any()


def test_a_held_out_duty_has_no_twin_among_the_ties(measured: Measured) -> None:
    ties = ties_of(measured, "fill")
    held = ties.duty[:1]
    kept = apart_from(ties, held)
    assert 0 < kept.sum() < len(kept)
    assert np.abs(ties.duty[kept] - held).min() > 1e-4


def test_the_domain_reaches_across_zero_flow(measured: Measured) -> None:
    points, domain = measured["discharge"]
    ties = ties_of(measured, "discharge")
    wider = domain.with_points(ties.duty, ties.pressure, ties.flow)
    low, high = wider.flow_limits(ties.pressure)
    assert (low <= ties.flow + 1e-12).all()
    assert (ties.flow <= high + 1e-12).all()
    assert wider.holds_duty(ties.duty).all()
    inner = np.linspace(*domain.pressure_range, 40)[4:-4]
    assert (domain.flow_limits(inner)[1] < 2e-5).all()
    assert (wider.flow_limits(inner)[1] > 2e-5).all()
    assert domain.with_points(*(np.empty(0),) * 3) is domain
    assert len(points.joined(None).duty) == len(points.duty)


def test_tied_networks_meet_and_cross_zero_flow(measured: Measured) -> None:
    inner = np.linspace(1.2e5, 2.6e5, 60)
    apart, tied = networks(measured, tied=False), networks(measured, tied=True)
    assert gap(tied, inner) < 0.7 * gap(apart, inner)
    # The flow of either goes through zero, so that only one counts away from the line.
    held = 0.5 * sum(tied[d].duty(0.0, inner)[0] for d in DIRECTIONS)
    assert (tied["fill"].flow(held - 0.05, inner)[0] < 0.0).all()
    assert (tied["discharge"].flow(held + 0.05, inner)[0] > 0.0).all()
    assert not (apart["fill"].flow(held - 0.05, inner)[0] < 0.0).all()


def test_tied_bipolynomials_are_nearer_at_zero_flow(measured: Measured) -> None:
    inner = np.linspace(1.2e5, 2.6e5, 60)
    gaps = []
    for tied in (False, True):
        duties = []
        for direction, (points, domain) in measured.items():
            if tied:
                ties = ties_of(measured, direction)
                points = points.joined(ties)
                domain = domain.with_points(ties.duty, ties.pressure, ties.flow)
            fitted = Bipolynomial(domain)
            fitted.fit(np.column_stack((points.duty, points.pressure)), points.flow)
            duties.append(fitted.duty(np.zeros_like(inner), inner)[0])
        gaps.append(float(np.sqrt(np.mean((duties[0] - duties[1]) ** 2))))
    assert gaps[1] < gaps[0]
