"""The averaged law and the inverses: against exact open times, surfaces, and edges."""

from __future__ import annotations

import numpy as np
import pytest

from datasets.thesis.reference_rig import bipolynomial_design, design, plant
from sysid.controllers.duty_inverse import bipolynomials
from sysid.plant import valve_timing as timing
from sysid.plant.base import ValveParameters
from sysid.surfaces.averaged import AveragedLaw

DELAYS = ((0.0017, 0.0020), (0.0020, 0.0017), (0.001, 0.001))
PRESSURES = np.linspace(1.0e5, 2.99e5, 41)


def law(on: float = 0.0017, off: float = 0.0020, side: str = "a") -> AveragedLaw:
    delays = {f"{name}_delay_{side}": value for name, value in (("on", on), ("off", off))}
    return AveragedLaw.of(plant(**delays).parameters, side)


@pytest.mark.parametrize("delays", DELAYS)
def test_the_open_share_is_that_of_the_pulses(delays: tuple[float, float]) -> None:
    """Settled PWM through `timing`, period by period."""
    own = law(*delays)
    for duty in (0.0, 0.02, 0.05, 0.3, 0.7, 0.93, 0.96, 1.0):
        time = np.arange(0.0, 0.1, 1e-3)
        on, off = timing.pwm_intervals(time, np.full(len(time), duty), 0.005)
        intervals = timing.delayed(on, off, *delays)
        exact = intervals.open_fraction(np.array([0.05]), np.array([0.055]))[0]
        assert own.open_share(duty) == pytest.approx(exact, abs=1e-9), duty


@pytest.mark.parametrize("delays", DELAYS)
@pytest.mark.parametrize("side", ["a", "b"])
def test_duty_inverts_flow(delays: tuple[float, float], side: str) -> None:
    own = law(*delays, side)
    duty, pressure = np.meshgrid(np.linspace(0.07, 0.93, 31), PRESSURES)
    flow = own.flow(duty, pressure)
    np.testing.assert_allclose(own.duty(flow, pressure), duty, atol=1e-9)


def test_flows_beyond_the_valve_saturate() -> None:
    own = law()
    assert (own.duty(1.0, PRESSURES) == 1.0).all()
    assert (own.duty(-1.0, PRESSURES) == 0.0).all()
    assert np.isfinite(own.duty(1e-5, np.array([0.9e5, 3.0e5, 3.2e5]))).all()


def test_the_gap_of_the_shortest_pulse() -> None:
    """Shares that no pulse gives get the nearer end of the gap."""
    own = law()
    shortest = 0.0003 / 0.005
    low, high = own.duty_of_share(np.array([0.4, 0.6]) * shortest)
    assert low == 0.0 and 0.0 < high < 1e-5
    assert own.open_share(high) == pytest.approx(shortest, abs=1e-5)


def test_fill_and_exhaust_are_the_on_off_law() -> None:
    own = law()
    assert own.flow(1.0, 1.2e5) == pytest.approx(7.8e-4)
    assert own.flow(0.0, 2.5e5) == pytest.approx(-3.5e-4)
    assert plant().parameters.valve("a") == ValveParameters(7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9)
    with pytest.raises(ValueError, match="side"):
        AveragedLaw.of(plant().parameters, "c")


def test_an_inverse_is_the_surfaces_own() -> None:
    """The controller's inverse against the bipolynomials' own, filling and discharging."""
    own = design()
    exact = AveragedLaw.of(own.parameters, "a")
    fill, out = bipolynomials(exact, (1.0e5, 3.0e5))
    inverse = bipolynomial_design().inverse_a
    for surface, flows in ((fill, (1e-4, 4e-4)), (out, (-3e-4, -5e-5))):
        flow, pressure = np.meshgrid(np.linspace(*flows, 7), np.linspace(1.3e5, 2.4e5, 9))
        duty, flags = surface.duty(flow, pressure)
        assert (flags == 0).sum() > 10
        np.testing.assert_allclose(inverse.duty(flow, pressure), duty, rtol=1e-12)


def test_the_law_beats_the_bipolynomial_where_it_holds() -> None:
    """RMSE in duty at most half of the thesis' surfaces on a valve that obeys the law."""
    duty, pressure = np.meshgrid(np.linspace(0.1, 0.9, 33), PRESSURES)
    exact = law()
    flow = exact.flow(duty, pressure)
    errors = [
        np.sqrt(np.mean((np.asarray(i.duty(flow, pressure)) - duty) ** 2))
        for i in (exact, bipolynomial_design().inverse_a)
    ]
    assert errors[0] < 0.5 * errors[1]
