"""Effects in the closed loop: the plant takes the whole catalogue, and says what cannot act."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from datasets.thesis.reference_rig import plant
from sysid.control.interface import Commands, Controller, Reference, StateEstimate
from sysid.control.loop import PERIOD_S, Case, ClosedLoopRun, closed_loop
from sysid.control.sensing import SensorSuite
from sysid.control.trajectories import thesis_trajectory
from sysid.errors import InputError
from sysid.model.base import Array
from sysid.model.effects.catalogue import catalogue
from sysid.model.effects.entry import CatalogueEffect
from sysid.model.effects.sensor import PressureLag, TimeSkew
from sysid.model.effects.valve import DutyDeadZone
from sysid.model.ports import Effect, Model
from sysid.model.sensors import measured_channels
from sysid.model.simulator import Inputs, ValveCommand, simulate


@dataclass(frozen=True)
class Recorded(Controller):
    """Commands that do not depend on the plant: duties from 0 to 1, or switching."""

    is_duty: bool = True

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        t = estimate.tick * PERIOD_S + 0.0 * estimate.position
        swing, other = (7.3 * t) % 1.2 - 0.1, (11.1 * t) % 1.2 - 0.1
        if not self.is_duty:
            swing, other = 1.0 * ((41.0 * t) % 1.0 > 0.5), 1.0 * ((29.0 * t) % 1.0 > 0.4)
        return memory, Commands(0.4 * (t % 0.3 > 0.15), swing, other)


def runs_on(model: Model, duration: float = 0.6) -> list[ClosedLoopRun]:
    """Duties and switching on a plant, seen by its sensors and no others."""
    trajectory = thesis_trajectory(1)
    perfect = SensorSuite.perfect()
    cases = [Case(Recorded(d), model, trajectory, sensors=perfect) for d in (True, False)]
    return closed_loop(cases, duration)


def open_loop(run: ClosedLoopRun, model: Model) -> dict[str, Array]:
    """The same commands through the open-loop simulation: what its sensors show."""
    a, b = (ValveCommand(c, run.is_duty) for c in (run.command_a, run.command_b))
    inputs = Inputs(run.time, run.motor, a, b, position=float(run.position[0]))
    found = simulate([inputs], [model])[0]
    return {"position": found.position, **measured_channels(found, "theta_rad", model)}


def test_the_loop_has_every_effect_of_the_catalogue() -> None:
    """All at once at their usual sizes, delays of half a tick among them, as in open loop."""
    model = plant()
    for name, kind in catalogue().items():
        options = {"time_skew_s": 2.3e-3, "side": "b"} if name == "time-skew" else {}
        model = model + kind.typical(**options)
    for run in runs_on(model):
        expected = open_loop(run, model)
        assert np.ptp(run.position) > 0.02
        np.testing.assert_allclose(run.position, expected["position"], atol=1e-6)
        np.testing.assert_allclose(run.measured, expected["theta_rad"], atol=1e-6)
        for side, shown in (("a", run.measured_a), ("b", run.measured_b)):
            np.testing.assert_allclose(shown, expected[f"pressure_{side}_pa"], atol=0.1)
        # The mean-flow effects cannot act on single pulses, and the run says so.
        assert [line.split()[1] for line in run.faults] == [
            name for name, kind in catalogue().items() if kind.averaged_only
        ]


def test_the_dead_zone_forgets_short_pulses_and_short_pauses() -> None:
    """On 0.5 ms, off 4.5 ms; on 4.5, off 0.5; on 2, off 3: with 1 ms, and with none."""
    never = -np.inf
    on = np.array([0.010, 0.005, 0.0, never])[:, None]
    off = np.array([0.012, 0.0095, 0.0005, never])[:, None]
    until = np.array([0.015])
    shown_on, shown_off = DutyDeadZone(1e-3).recent_pulses(on, off, until, "a")
    np.testing.assert_array_equal(shown_on[:, 0], [0.005, never, never, never])
    np.testing.assert_array_equal(shown_off[:, 0], [0.012, never, never, never])
    for kept in DutyDeadZone(0.0).recent_pulses(on, off, until, "a"), (on, off):
        np.testing.assert_array_equal(kept[0], on)
        np.testing.assert_array_equal(kept[1], off)
    # A pause of 0.5 ms to the next pulse: the valve stays on until that pulse decides.
    _, later = DutyDeadZone(1e-3).recent_pulses(on, off, np.array([0.0125]), "a")
    assert later[0, 0] == np.inf


@pytest.mark.parametrize(
    "effect",
    [PressureLag(2e-3, "a"), PressureLag(0.0), TimeSkew(2.3e-3), TimeSkew(0.0, "b")],
    ids=lambda effect: f"{effect.id} {effect}",
)
def test_a_sample_at_a_time_is_the_whole_log(effect: Effect) -> None:
    time = PERIOD_S * np.arange(40)
    rng = np.random.default_rng(3)
    channels = {f"pressure_{s}_pa": 1e5 + np.cumsum(rng.normal(0, 1e3, 40)) for s in "ab"}
    whole = effect.measure(channels, time)
    memory = effect.start_sensing({k: v[:1] for k, v in channels.items()}, PERIOD_S)
    for i in range(40):
        now = {k: v[i : i + 1] for k, v in channels.items()}
        shown, memory = effect.sense(now, memory, time[i : i + 1], PERIOD_S)
        for name, value in shown.items():
            assert value[0] == pytest.approx(whole[name][i], abs=1e-6)


def test_a_pressure_that_would_be_early_is_on_time_and_the_run_says_so() -> None:
    run = runs_on(plant() + TimeSkew(-2e-3), 0.05)[0]
    np.testing.assert_array_equal(run.measured_a, run.pressure_a)
    assert any("time-skew makes a pressure early" in line for line in run.faults)


@dataclass(frozen=True)
class _Own(CatalogueEffect):
    size: Array = 0.0
    id = "own-effect"


class _Smoothed(_Own):
    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        return {name: np.full(len(row), np.mean(row)) for name, row in channels.items()}


class _Branching(_Own):
    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        return {name: row if row[0] > -1e9 else -row for name, row in channels.items()}


class _Longer(_Own):
    def pulses(self, on: Array, off: Array, side: str) -> tuple[Array, Array]:
        return on, off + 1e-4


class _NumpyDelay(_Own):
    def delays(self, delays: Array, times: Array, opening: bool, side: str) -> Array:
        return delays + 1e-4 * (float(times[0, 0]) > 1.0)


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (_Smoothed(), "`measure` looks at several rows"),
        (_Branching(), "`sense` cannot be compiled"),
        (_Longer(), "`pulses` takes whole logs"),
        (_NumpyDelay(), "`delays` cannot be compiled"),
    ],
)
def test_an_effect_that_no_loop_can_take_is_refused(effect: Effect, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        runs_on(plant() + effect, 0.01)
    assert "own-effect" in str(caught.value)
    assert "\n" not in str(caught.value)
