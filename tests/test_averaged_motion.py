"""The averaged law in motion, against the on/off law under the real pulses; the ripple itself."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from benchmarks.rigs import REFERENCE
from sysid.io.channels import SIDES
from sysid.plant.base import Parameters
from sysid.plant.effects.supply import SupplyDroop
from sysid.plant.effects.valve import DutyDeadZone, SubsonicFlowShape, ValveDelay
from sysid.plant.ports import Effect, Model
from sysid.plant.pulse_means import pulse_means
from sysid.plant.simulator import Inputs, Trajectory, ValveCommand, open_intervals, simulate
from sysid.surfaces.averaged import AveragedLaw

TIME = np.arange(3001) * 1e-3


def moved() -> Inputs:
    """Both duties in slow sines of opposite sign, through zero flow and both boundaries."""
    way = np.sin(2.0 * np.pi * 0.8 * TIME)
    duties = [ValveCommand(np.clip(0.3 + 0.1 * s * way, 0.0, 1.0), True) for s in (1.0, -1.0)]
    return Inputs(TIME, 0.0 * TIME, *duties)


def run(
    inputs: Inputs, effects: tuple[Effect, ...] = (), law: Parameters | None = None
) -> Trajectory:
    """By the on/off law, or by the averaged law of `law`'s parameters."""
    surfaces = () if law is None else tuple(AveragedLaw.of(law, side) for side in SIDES)
    return simulate([inputs], [Model(REFERENCE, effects)], surfaces)[0]


def differences(one: Trajectory, other: Trajectory) -> tuple[float, float]:
    """RMS of position (rad) and the larger one of the pressures (Pa)."""

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean((getattr(one, name) - getattr(other, name)) ** 2)))

    return rms("position"), max(rms("pressure_a"), rms("pressure_b"))


EFFECTS: dict[str, tuple[Effect, ...]] = {
    "none": (),
    "delay": (ValveDelay(on_delay_s=3e-4, off_delay_s=-2e-4),),
    "dead zone": (DutyDeadZone(dead_time_s=1.2e-3),),
    "droop": (SupplyDroop(droop_pa_s_per_kg=1.3e7),),
    "flow shape": (SubsonicFlowShape(filling_blend=0.6, exhaust_blend=0.6),),
}


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_the_averaged_law_moves_as_the_pulses_do(effects: tuple[Effect, ...]) -> None:
    pulses = run(moved(), effects)
    assert np.ptp(pulses.position) > 0.2
    position, pressure = differences(run(moved(), effects, REFERENCE), pulses)
    assert position < 0.02 * np.ptp(pulses.position)
    # The droop's and the shape's flows are taken at the mean of their ripple.
    assert pressure < 500.0
    if effects:  # it would not do without them
        without = differences(run(moved(), (), REFERENCE), pulses)
        assert max(without[0] / position, without[1] / pressure) > 2.0


def test_the_averaged_laws_own_delays_count() -> None:
    """A law fitted under PWM alone brings its own difference of the delays."""
    other = REFERENCE.replace(off_delay_a=REFERENCE.off_delay_a + 3e-4)
    model = Model(other)
    inputs = moved()
    pulses = simulate([inputs], [model])[0]
    position, pressure = differences(run(inputs, (), other), pulses)
    assert position < 0.02 * np.ptp(pulses.position)
    assert pressure < 500.0


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_ripple_is_the_open_time_less_its_share(share: float) -> None:
    model = Model(REFERENCE.replace(on_delay_a=0.0, off_delay_a=0.0))
    duty = np.full(len(TIME), share)
    intervals = open_intervals(Inputs(TIME, 0.0 * TIME, ValveCommand(duty, True)), "a", model)
    begins = np.arange(10) * 5e-3
    start = np.arange(100) * 5e-4
    found = pulse_means(begins, intervals, start, np.full(100, 5e-4), 0.05)
    np.testing.assert_allclose(found.share, share, atol=1e-9)
    np.testing.assert_allclose(found.ripple_mean, 0.5 * share * (1.0 - share), atol=1e-9)
    # It starts and ends at zero in every period, and is highest when the pulse ends.
    np.testing.assert_allclose(found.ripple_start[::10], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.ripple_end[9::10], 0.0, atol=1e-9)
    assert found.ripple_end.max() == pytest.approx(share * (1.0 - share), abs=1e-9)
    assert (found.ripple_start >= -1e-9).all()


def test_before_the_first_period_a_valve_is_as_it_was() -> None:
    model = Model(REFERENCE)
    command = ValveCommand(np.full(len(TIME), 0.5), True, starts_on=True)
    intervals = open_intervals(Inputs(TIME, 0.0 * TIME, command), "a", model)
    begins = np.arange(3) * 5e-3 + REFERENCE.on_delay_a
    found = pulse_means(begins, intervals, np.array([0.0, 1e-3]), np.array([1e-3, 1e-3]), 1.0)
    assert found.period.tolist() == [-1, -1]
    assert found.share.tolist() == [1.0, 1.0]
    assert not found.ripple_end.any()


def test_the_sensors_see_the_ripple() -> None:
    """At the rows, within the periods: a held chamber goes up and down with the pulses."""
    still = REFERENCE.replace(static_effort=1e6)
    inputs = dataclasses.replace(moved(), valve_b=None)
    laws: Any = tuple(AveragedLaw.of(still, side) for side in SIDES)
    averaged = simulate([inputs], [Model(still)], laws)[0]
    pulses = simulate([inputs], [Model(still)])[0]
    settled = slice(1000, None)
    steps = [np.diff(one.pressure_a[settled]) for one in (averaged, pulses)]
    assert np.abs(steps[1]).max() > 300.0
    assert float(np.sqrt(np.mean((steps[0] - steps[1]) ** 2))) < 0.1 * np.abs(steps[1]).max()
