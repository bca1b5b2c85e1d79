"""Effects in the closed loop: the plant takes the whole catalogue, and says what cannot act."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from datasets.thesis.reference_rig import plant, rig
from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.design_model import design_model
from sysid.controllers.effective_law import averaged_law
from sysid.controllers.interface import Commands, Controller, Reference, StateEstimate
from sysid.controllers.loop import PERIOD_S, Case, ClosedLoopRun, closed_loop
from sysid.controllers.modes import Mode
from sysid.controllers.prediction import Motion, corrected, loaded, motor_command, point_at
from sysid.controllers.sensing import SensorSuite
from sysid.controllers.trajectories import thesis_trajectory
from sysid.errors import InputError, SimulationError
from sysid.plant import plant as model_plant
from sysid.plant.base import Array
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.friction import StribeckFriction
from sysid.plant.effects.linkage import LinkFlexibility
from sysid.plant.effects.motor import TorqueConstantError, TorqueOffset, TorqueRipple
from sysid.plant.effects.sensor import (
    AmbientPressureError,
    EncoderEccentricity,
    LostCounts,
    PressureGain,
    PressureLag,
    PressureOffset,
    TimeSkew,
)
from sysid.plant.effects.supply import ExhaustBackPressure, SupplyDroop
from sysid.plant.effects.valve import DutyDeadZone, SubsonicFlowShape, ValveDelay
from sysid.plant.ports import Effect, Model
from sysid.plant.sensors import measured_channels
from sysid.plant.simulator import Inputs, ValveCommand, simulate
from sysid.surfaces.averaged import AveragedLaw


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
    """The same commands through the open-loop simulation: what its sensors show of its samples.

    A loop's sensors see one pressure a sample, those of a simulation what is between them too.
    """
    a, b = (ValveCommand(c, run.is_duty) for c in (run.command_a, run.command_b))
    inputs = Inputs(run.time, run.motor, a, b, position=float(run.position[0]))
    found = dataclasses.replace(simulate([inputs], [model])[0], between=None)
    return {"position": found.position, **measured_channels(found, "theta_rad", model)}


# Lines of their own: a boundary that moves with the other chamber's flow leaves its pressure behind
# by as much as 1e-4 within a step, and the loop's steps end elsewhere.
USUAL: dict[str, dict[str, Any]] = {
    "time-skew": {"time_skew_s": 2.3e-3, "side": "b"},
    "supply-droop": {"common_share": 0.0},
    "exhaust-back-pressure": {"common_share": 0.0},
    # A loop keeps the last pulses only; of those that a dead zone forgets none may be left.
    "duty-dead-zone": {"side": "a"},
    "sticking-valve": {"side": "b"},
    # With it friction of all kinds at once is more than what starts the shaft.
    "stroke-dependent-seals": {"seal_bend_nm_per_pa_rad": 0.0},
}


def test_the_loop_has_every_effect_of_the_catalogue() -> None:
    """All at once at their usual sizes, delays of half a tick among them, as in open loop."""
    model = plant()
    for name, kind in catalogue().items():
        model = model + kind.typical(**USUAL.get(name, {}))
    for run in runs_on(model):
        expected = open_loop(run, model)
        assert np.ptp(run.position) > 0.02
        np.testing.assert_allclose(run.position, expected["position"], atol=1e-6)
        np.testing.assert_allclose(run.measured, expected["theta_rad"], atol=1e-6)
        for side, shown in (("a", run.measured_a), ("b", run.measured_b)):
            gap = np.abs(shown - expected[f"pressure_{side}_pa"])
            # A pulsating supply moves the boundary too, which a pressure leaves within a step.
            assert np.quantile(gap, 0.9) < 0.1 and gap.max() < 1e-4 * 1.6e5
        # The mean-flow effects cannot act on single pulses, and the run says so.
        idle = [line.split()[1] for line in run.faults if line.startswith("plant: ")]
        assert idle == [name for name, kind in catalogue().items() if kind.averaged_only]


def test_a_plant_that_switches_without_end_is_said() -> None:
    """As one whose friction is nothing at rest and 10 Nm from there on: a loop ends with one line,
    as a simulation does.

    The effects are those of the test before, in other sizes: what was compiled for it serves.
    """
    steep = {"power_law_nm": 10.0, "power_law_exponent": 0.1}
    sizes = {**USUAL, "power-law-friction": steep}
    model = plant()
    for name, kind in catalogue().items():
        model = model + kind.typical(**sizes.get(name, {}))
    with pytest.raises(SimulationError, match="switches endlessly"):
        runs_on(model)


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


@pytest.mark.parametrize("pause", [1.0, 0.4, 0.0])
def test_a_closed_loop_opens_partly_as_the_whole_log_does(pause: float) -> None:
    rng = np.random.default_rng(8)
    edges = np.cumsum(rng.uniform(3e-4, 4e-3, 60)).reshape(-1, 2)
    zone = DutyDeadZone(1e-3, "both", 2.2, pause)
    whole = np.column_stack(zone.pulses(edges[:, 0], edges[:, 1], "a"))
    until = np.array([edges[-1, 1] + 0.1])
    shown = zone.recent_pulses(edges[::-1, :1], edges[::-1, 1:], until, "a")
    recent = np.hstack(shown)[::-1]
    assert not np.array_equal(whole, edges[: len(whole)])
    np.testing.assert_allclose(recent[np.isfinite(recent[:, 0])], whole, rtol=1e-12)


@pytest.mark.parametrize("pause", [1.0, 0.4, 0.0])
def test_the_law_of_a_partial_opening_is_that_of_its_pulses_and_inverts(pause: float) -> None:
    zone = DutyDeadZone(1e-3, "both", 2.2, pause)
    own, plain = averaged_law(plant() + zone, "a"), AveragedLaw.of(plant().parameters, "a")
    period = float(plant().parameters.pwm_period)
    starts = np.arange(6) * period
    for duty in (0.1, 0.23, 0.3, 0.4, 0.5, 0.63, 0.7, 0.77, 0.95):
        on, off = zone.pulses(starts, starts + duty * period, "a")
        within = np.clip([on, off], 2 * period, 4 * period)
        open_time = float(np.sum(within[1] - within[0])) / (2 * period)
        assert own.open_share(duty) == pytest.approx(plain.open_share(open_time), abs=1e-9)
    shares = np.linspace(0.075, 0.95, 36)  # below it the shortest pulse opens for longer
    np.testing.assert_allclose(own.open_share(own.duty_of_share(shares)), shares, atol=1e-9)


@pytest.mark.parametrize(
    "effect",
    [
        PressureLag(2e-3, "a"),
        PressureLag(4e-3, "both", 1.0),
        PressureLag(0.0),
        TimeSkew(2.3e-3),
        TimeSkew(0.0, "b"),
    ],
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
            assert value[0] == pytest.approx(whole[name][i], abs=1e-4)


@pytest.mark.parametrize("bound", [0.0, 1.0])
def test_a_lag_has_a_slope_at_the_bounds_of_its_order(bound: float) -> None:
    """Where one of its two stages has no lag, or both have the same."""
    from sysid.plant.jax_setup import jax

    pressure = np.array([1.0e5, 2.0e5, 1.5e5, 1.0e5, 3.0e5])

    def shown(share: Array) -> Array:
        effect = PressureLag(4e-3, "a", share)
        memory = effect.start_sensing({"pressure_a_pa": pressure[0]}, PERIOD_S)
        for row in pressure:
            now, memory = effect.sense({"pressure_a_pa": row}, memory, 0.0, PERIOD_S)
        return now["pressure_a_pa"]

    near = abs(bound - 1e-5)
    slope = (shown(near) - shown(bound)) / (near - bound)
    assert float(jax.grad(shown)(bound)) == pytest.approx(float(slope), rel=1e-3)


@pytest.mark.parametrize("of_all", [0.0, 1.0])
def test_counts_are_lost_a_sample_at_a_time_as_in_a_whole_log(of_all: float) -> None:
    effect, time = LostCounts(0.1, 1.0, of_all), PERIOD_S * np.arange(60)
    position = 0.2 * np.sin(12.0 * time)
    whole = effect.measure({"theta_rad": position}, time)["theta_rad"]
    memory = effect.start_sensing({"theta_rad": position[:1]}, PERIOD_S)
    assert np.abs(whole - position).max() > 1e-3
    for i in range(60):
        now = {"theta_rad": position[i : i + 1]}
        shown, memory = effect.sense(now, memory, time[i : i + 1], PERIOD_S)
        assert shown["theta_rad"][0] == pytest.approx(whole[i], abs=1e-12)


@pytest.mark.parametrize("on_link", [0.0, 1.0])
def test_an_encoder_behind_a_flexible_link_shows_it_a_sample_at_a_time(on_link: float) -> None:
    effect, time = LinkFlexibility(0.3, 25.0, 0.05, on_link), PERIOD_S * np.arange(80)
    position = np.where(time < 0.02, 0.0, 0.1 * (1.0 - np.cos(12.0 * (time - 0.02))))
    speed = np.where(time < 0.02, 0.0, 1.2 * np.sin(12.0 * (time - 0.02)))
    channels = {"theta_rad": position, "velocity_rad_per_s": speed}
    whole = effect.measure(channels, time)
    assert (np.abs(whole["theta_rad"] - position).max() > 1e-4) == bool(on_link)
    memory = effect.start_sensing({k: v[:1] for k, v in channels.items()}, PERIOD_S)
    for i in range(len(time)):
        now = {k: v[i : i + 1] for k, v in channels.items()}
        shown, memory = effect.sense(now, memory, time[i : i + 1], PERIOD_S)
        for name, value in shown.items():
            assert value[0] == pytest.approx(whole[name][i], abs=1e-12)


def test_a_pressure_that_would_be_early_is_on_time_and_the_run_says_so() -> None:
    run = runs_on(plant() + TimeSkew(-2e-3), 0.05)[0]
    np.testing.assert_array_equal(run.measured_a, run.pressure_a)
    assert any("time-skew advances a pressure in time" in line for line in run.faults)


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
        (_Smoothed(), "`measure` uses several rows"),
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


# --- what controllers make of their bundle's effects ------------------------------------------


def estimate_of(position: float, pressure_a: float, pressure_b: float) -> StateEstimate:
    values = (position, 0.1, 0.2, 0.1, pressure_a, pressure_b)
    return StateEstimate(np.array(0), *(np.array([v]) for v in values))


def test_known_sensor_errors_are_undone() -> None:
    model = plant() + PressureOffset(1.7e3, "a") + PressureGain(0.01, "b")
    model = model + EncoderEccentricity(7e-4, 7e-4) + PressureLag(2e-3)
    true = {"theta_rad": np.array([0.3]), "pressure_a_pa": np.array([2e5])}
    true["pressure_b_pa"] = np.array([1.5e5])
    shown = true
    for effect in model.effects[:3]:
        shown = effect.measure(shown, np.zeros(1))
    found = corrected(estimate_of(*(float(row[0]) for row in shown.values())), model)
    assert found.position[0] == pytest.approx(0.3, abs=1e-7)
    assert found.pressure_a[0] == pytest.approx(2e5, abs=1.0)
    assert found.pressure_b[0] == pytest.approx(1.5e5, abs=1.0)
    plain = estimate_of(0.3, 2e5, 1.5e5)
    assert corrected(plain, plant()) == plain


def test_the_motor_is_told_what_gives_the_wanted_effort() -> None:
    model = plant() + TorqueConstantError(-0.08) + TorqueRipple(0.05, 0.02)
    point = point_at(Motion(*np.array([[0.2], [0.1], [2e5], [1e5]])), model, 0.0, 0.0, 0.1)
    command = motor_command(np.array([0.3]), point, model)
    given = model_plant.motor_effort(dataclasses.replace(point, motor=command), model)
    assert command[0] > 0.31
    assert given[0] == pytest.approx(0.3, rel=1e-3)
    wanted = np.array([0.3])
    assert motor_command(wanted, point, plant()) is wanted


@pytest.mark.parametrize(
    "effect",
    [
        SupplyDroop(10e3 / 7.8e-4),
        ExhaustBackPressure(5e3 / 3.5e-4),
        SubsonicFlowShape(1.0, 1.0),
        DutyDeadZone(9e-4),
        ValveDelay(5e-4, -5e-4),
        AmbientPressureError(-2e3),
    ],
    ids=lambda effect: effect.id,
)
def test_the_averaged_law_has_the_effects_and_inverts(effect: Effect) -> None:
    plain, own = AveragedLaw.of(plant().parameters, "a"), averaged_law(plant() + effect, "a")
    duty, pressure = np.meshgrid(np.linspace(0.2, 0.78, 30), np.linspace(1.1e5, 2.7e5, 17))
    flow = own.flow(duty, pressure)
    np.testing.assert_allclose(own.duty(flow, pressure), duty, atol=1e-6)
    changed = np.max(np.abs(own.flow(0.1, pressure) - plain.flow(0.1, pressure)))
    assert changed > 1e-6  # 1e-3 of a valve's flow


def test_the_law_of_the_dead_zone_takes_the_nearer_end() -> None:
    own = averaged_law(plant() + DutyDeadZone(1e-3), "a")
    duties = own.duty_of_share(np.array([0.13, 0.2, 0.3, 0.9, 0.99]))
    np.testing.assert_allclose(duties, [0.0, 0.2, 0.24, 0.8, 1.0], atol=1e-9)
    assert (own.open_share(np.array([0.1, 0.95])) == [0.0, 1.0]).all()


def test_states_that_no_controller_measures_leave_its_model() -> None:
    flexible = design_model(plant() + LinkFlexibility(0.5) + TorqueOffset(0.01), rig=rig())
    seen = loaded(flexible, 0.0)
    assert [type(e) for e in seen.effects] == [TorqueOffset]
    assert seen.at(0.0).inertia == plant().parameters.inertia


def test_a_found_effect_is_worth_its_name() -> None:
    """Backstepping, pneumatic, on a plant with Stribeck friction: told of it and not told."""
    true = plant() + StribeckFriction(0.12)
    cases = [
        Case(
            BacksteppingController(design_model(known, rig=rig()), portion=0.0),
            true,
            thesis_trajectory(1),
            Mode.PNEUMATIC,
        )
        for known in (plant(), true)
    ]
    base, told = (run.metrics.rmse for run in closed_loop(cases))
    assert told < 0.6 * base
