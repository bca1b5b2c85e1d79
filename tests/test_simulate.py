"""The simulator against closed forms, finer steps and an independent integrator."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_model import Everywhere

from benchmarks.reference_plant import integrate
from benchmarks.rigs import REFERENCE, random_runs
from sysid.errors import InputError, NotIdentifiedError, SimulationError
from sysid.io.logs import Trial, with_channels
from sysid.io.rig import rig_from_content
from sysid.parameters import Bundle, Parts
from sysid.parameters.assembled_model import surfaces_for
from sysid.plant import simulator, tables, valve_timing
from sysid.plant.base import Parameters
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.sensor import PressureLag, TimeSkew
from sysid.plant.ports import Effect, Model, stack_models
from sysid.plant.preparation import prepare, with_edges
from sysid.plant.sensors import after_seeing, measured_channels
from sysid.plant.simulator import (
    MAX_STEP,
    Inputs,
    Trajectory,
    ValveCommand,
    remembered_after,
    simulate,
    simulate_states,
)
from sysid.plant.stepper import advance
from sysid.plant.trials import inputs_from_trial, simulate_trials, starts_on_supply

POSITION_RAD = 2e-4
PRESSURE_PA = 30.0
# Chambers that exchange no air and feel no piston: the mechanics alone.
NO_AIR = REFERENCE.replace(
    **{f"{k}_{s}": 0.0 for k in ("choked_fill", "choked_dis", "c_fill", "c_dis") for s in "ab"},
    heat_capacity_ratio=1e-12,
)
END = REFERENCE.stroke / 2 / REFERENCE.pitch_radius


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def errors(run: Trajectory, reference: Any) -> tuple[float, float]:
    """RMSE of position, and the larger one of the pressures."""
    return rms(run.position - reference[0]), max(
        rms(run.pressure_a - reference[2]), rms(run.pressure_b - reference[3])
    )


def states(run: Trajectory) -> list[Any]:
    return [run.position, run.velocity, run.pressure_a, run.pressure_b]


def one(inputs: Inputs, parameters: Parameters, **options: Any) -> Trajectory:
    return simulate([inputs], [Model(parameters)], **options)[0]


def seconds(duration: float, step: float = 1e-3) -> Any:
    return np.arange(round(duration / step) + 1) * step


def pushed(effort: Any, **changes: Any) -> Inputs:
    time = seconds(0.5)
    return Inputs(time=time, motor=np.zeros(len(time)) + effort, **changes)


def held(parameters: Parameters = REFERENCE) -> Parameters:
    """The piston held: nothing can move it."""
    return parameters.replace(static_effort=1e6)


# --- against a reference ---------------------------------------------------------------


def test_a_finer_step_changes_nothing_that_counts() -> None:
    inputs, models = random_runs(seed=1, count=8, seconds=2.0)
    fine = simulate(inputs, models, max_step=1e-3 / 64)
    for run, reference in zip(simulate(inputs, models), fine, strict=True):
        position, pressure = errors(run, states(reference))
        assert position < POSITION_RAD
        assert pressure < PRESSURE_PA
        assert np.count_nonzero(np.diff(reference.velocity == 0.0)) >= 2  # it sticks, and slides


@pytest.mark.parametrize("seed", [7, 8])
def test_solve_ivp_with_events_agrees(seed: int) -> None:
    inputs, models = random_runs(seed, count=1, seconds=0.6)
    reference = integrate(inputs[0], models[0].parameters)
    position, pressure = errors(simulate(inputs, models)[0], reference)
    assert position < POSITION_RAD
    assert pressure < PRESSURE_PA
    # With the step refined the two integrators, which share no step, meet.
    position, pressure = errors(simulate(inputs, models, max_step=1e-3 / 64)[0], reference)
    assert position < 1e-7
    assert pressure < 0.1


@pytest.mark.parametrize("name", ["tube-lag", "wall-heat-transfer", "supply-droop"])
def test_a_run_that_remembers_goes_on_as_if_it_had_not_been_cut(name: str) -> None:
    """A valve has just opened where it is cut, so that the effect's states are on their way."""
    effect: Any = catalogue()[name].typical()
    if name == "supply-droop":
        effect = dataclasses.replace(effect, line_time_s=0.02)
    model = Model(held(), (effect,))
    time = seconds(0.2)
    command = ((time > 0.0999) & (time < 0.15)).astype(float)
    whole = Inputs(time, np.zeros(len(time)), ValveCommand(command))
    cut = 108
    before = dataclasses.replace(
        whole,
        time=time[: cut + 1],
        motor=whole.motor[: cut + 1],
        valve_a=ValveCommand(command[: cut + 1]),
    )
    run = simulate([whole], [model])[0]
    rest = Inputs(
        time[cut:],
        whole.motor[cut:],
        ValveCommand(command[cut:], starts_on=True),
        **{n: float(getattr(run, n)[cut]) for n in simulator.STATE},
        elapsed=float(time[cut]),
    )
    longer = dataclasses.replace(before, time=seconds(0.3), motor=np.zeros(301), valve_a=None)
    both, alone = (simulate(runs, [model] * len(runs)) for runs in ([before, longer], [before]))
    (remembered, _) = remembered_after([before, longer], both, [model, model])
    assert remembered == remembered_after([before], alone, [model])[0]
    without, on = simulate(
        [rest, dataclasses.replace(rest, remembered=remembered)], [model, model], max_step=1e-4
    )
    exact = simulate([whole], [model], max_step=1e-4)[0]
    expected = [values[cut:] for values in states(exact)]
    lost, left = errors(without, expected)[1], errors(on, expected)[1]
    assert left < 0.1 * lost and left < PRESSURE_PA < lost


@pytest.mark.parametrize("sensor", [PressureLag(3e-3), TimeSkew(2e-3)], ids=["lag", "skew"])
def test_sensors_of_a_run_that_goes_on_have_seen_what_was_before(sensor: Any) -> None:
    """Cut where a pressure rises: its sensor is some kPa behind, and so is the measured start."""
    model = Model(held(), (sensor,))
    time = seconds(0.2)
    command = ((time > 0.0999) & (time < 0.15)).astype(float)
    whole = Inputs(time, np.zeros(len(time)), ValveCommand(command))
    cut = 108
    run = simulate([whole], [model])[0]
    shown = measured_channels(run, "theta_rad", model)
    before = dataclasses.replace(
        whole,
        time=time[: cut + 1],
        motor=whole.motor[: cut + 1],
        valve_a=ValveCommand(command[: cut + 1]),
    )
    rest = Inputs(
        time[cut:],
        whole.motor[cut:],
        ValveCommand(command[cut:], starts_on=True),
        pressure_a=float(shown["pressure_a_pa"][cut]),
        pressure_b=float(shown["pressure_b_pa"][cut]),
        elapsed=float(time[cut]),
    )
    behind = float(run.pressure_a[cut]) - float(shown["pressure_a_pa"][cut])
    assert behind > 1e3
    goes_on = after_seeing(rest, simulate([before], [model])[0], "theta_rad", model)
    assert goes_on.pressure_a == pytest.approx(run.pressure_a[cut], abs=1e-3 * behind)
    errors = []
    for one in (goes_on, rest):
        (found,) = simulate([one], [model])
        own = measured_channels(found, "theta_rad", model, one.elapsed, one.seen)
        errors.append(np.abs(own["pressure_a_pa"] - shown["pressure_a_pa"][cut:]).max())
    assert errors[0] < 1e-3 * errors[1] and errors[1] > 0.5 * behind


def test_a_run_at_its_rows_alone_is_the_same() -> None:
    inputs, models = random_runs(seed=5, count=1, seconds=0.5)
    model = models[0] + PressureLag(2e-3)
    (seen,), (alone,) = simulate(inputs, [model]), simulate_states(inputs, [model], MAX_STEP)
    assert seen.between is not None
    np.testing.assert_allclose(alone, seen.states, rtol=1e-12, atol=1e-12)


def test_a_run_does_not_depend_on_its_batch() -> None:
    inputs, models = random_runs(seed=2, count=5, seconds=0.5)
    short = dataclasses.replace(
        inputs[0],
        time=inputs[0].time[:200],
        motor=inputs[0].motor[:200],
        valve_a=None,
        valve_b=None,
    )
    together = simulate([*inputs, short] * 4, [*models, models[0]] * 4)
    alone = [
        one(i, m.parameters) for i, m in zip([*inputs, short], [*models, models[0]], strict=True)
    ]
    for run, other in zip(together, alone * 4, strict=True):
        assert len(run.position) == len(other.position)
        position, pressure = errors(run, states(other))
        assert position < 1e-9
        assert pressure < 1e-4


def test_a_run_longer_than_a_call_is_compiled_once() -> None:
    """What a call returns has the types that it took: others would be compiled for anew."""
    from sysid.plant.jax_setup import jax

    inputs, models = random_runs(seed=2, count=1, seconds=0.1)
    model = stack_models(models)
    prepared = prepare(inputs[:1], models[:1], (), 1e-3)
    table = tables.block_of(prepared, 1, 64, 1e-3).table(0)
    lanes = simulator.at_first_row(simulator.start_lanes(inputs, model))
    after = jax.eval_shape(lambda *given: advance(*given, model, ()), lanes, table)
    given = jax.eval_shape(lambda lanes: lanes, lanes)
    assert after == given
    assert [a.weak_type for a in jax.tree.leaves(after)] == [
        g.weak_type for g in jax.tree.leaves(given)
    ]


def test_the_pieces_of_a_long_run_share_one_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulator, "_ROWS_A_CALL", 48)
    inputs, models = random_runs(seed=2, count=1, seconds=0.2)
    before = set(simulator._advance_chunk._kept)
    simulate(inputs, models)
    assert len(set(simulator._advance_chunk._kept) - before) == 1


def test_the_models_of_a_batch_are_stacked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many blocks it is cut into: each would hold the interpreter's lock meanwhile."""
    stacked = []

    def counted(models: list[Model]) -> Model:
        stacked.append(len(models))
        return stack_models(models)

    monkeypatch.setattr(simulator, "stack_models", counted)
    simulate(*random_runs(seed=2, count=40, seconds=0.05))
    assert stacked == [40]


def test_runs_that_share_a_log_are_prepared_once_and_stay_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    inputs, models = random_runs(seed=2, count=6, seconds=0.2)
    shared = [dataclasses.replace(inputs[0], position=0.01 * i) for i in range(6)]
    alone = [one(i, m.parameters) for i, m in zip(shared, models, strict=True)]
    calls = []
    period_starts = valve_timing.period_starts

    def counted(*given: Any) -> Any:
        calls.append(given)
        return period_starts(*given)

    monkeypatch.setattr(valve_timing, "period_starts", counted)
    monkeypatch.setenv("SYSID_JOBS", "1")
    together = simulate(shared, models)  # each with delays of its own
    assert len(calls) == 1
    for run, other in zip(together, alone, strict=True):
        position, pressure = errors(run, states(other))
        assert position < 1e-9
        assert pressure < 1e-4


@pytest.mark.parametrize("count", [2, 40])
def test_no_number_depends_on_how_many_cores_there_were(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit; runs of different lengths, so that threads take turns in another order."""
    inputs, models = random_runs(seed=5, count=count, seconds=0.3)
    for i, whole in enumerate(inputs):
        rows = len(whole.time) - 7 * (i % 11)
        valves = [dataclasses.replace(v, values=v.values[:rows]) for v in _valves(whole)]
        time, motor = whole.time[:rows], whole.motor[:rows]
        inputs[i] = Inputs(time, motor, *valves)
    found = []
    for jobs in ("1", "2", "3", "16"):
        monkeypatch.setenv("SYSID_JOBS", jobs)
        found.append(np.concatenate([run.states.ravel() for run in simulate(inputs, models)]))
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])


def test_rows_far_apart_take_as_many_steps_as_they_need(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulator, "MOST_EVENTS", 1)
    time = np.array([0.0, 10.0])
    run = one(Inputs(time=time, motor=np.zeros(2), pressure_a=2e5), held())
    assert run.pressure_a[-1] == pytest.approx(1e5, rel=1e-3)


def test_a_run_without_an_end_is_not_known_from_there_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes more steps than a table may; the run beside it is as it is alone."""
    slow = Inputs(time=np.array([0.0, 10.0]), motor=np.zeros(2), pressure_a=2e5)
    quick = Inputs(time=seconds(0.05), motor=np.zeros(51), pressure_a=2e5)
    alone = one(quick, held())
    models = [Model(held())] * 2
    monkeypatch.setattr(simulator, "MOST_EVENTS", -9000)
    with pytest.raises(SimulationError, match="switches endlessly"):
        simulate([slow, quick], models)
    endless, beside = simulate([slow, quick], models, nan_if_endless=True)
    assert np.isfinite(endless.states[:, 0]).all() and np.isnan(endless.states[:, 1]).all()
    np.testing.assert_array_equal(beside.states, alone.states)


def test_a_run_in_pieces_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    inputs, models = random_runs(seed=2, count=2, seconds=0.5)
    inputs[1] = dataclasses.replace(inputs[1], time=inputs[1].time + 1e3)
    whole = simulate(inputs, models)
    monkeypatch.setattr(simulator, "_ROWS_A_CALL", 48)
    for run, other in zip(simulate(inputs, models), whole, strict=True):
        position, pressure = errors(run, states(other))
        assert position < 1e-9
        assert pressure < 1e-4


def test_a_slower_log_gives_the_same_motion() -> None:
    inputs, models = random_runs(seed=3, count=1, seconds=1.0, motor=False)
    # Commands change only where both logs have a row, and a PWM period starts.
    duty = [np.repeat(i.values[::20], 20)[: len(inputs[0].time)] for i in _valves(inputs[0])]
    dense = _with_duties(inputs[0], duty, 1)
    sparse = _with_duties(inputs[0], duty, 4)
    fast, slow = one(dense, models[0].parameters), one(sparse, models[0].parameters)
    assert rms(fast.position[::4] - slow.position) < POSITION_RAD
    assert rms(fast.pressure_a[::4] - slow.pressure_a) < PRESSURE_PA


def _valves(inputs: Inputs) -> list[ValveCommand]:
    return [v for v in (inputs.valve_a, inputs.valve_b) if v is not None]


def _with_duties(inputs: Inputs, duties: list[Any], stride: int) -> Inputs:
    a, b = (ValveCommand(d[::stride], is_duty=True) for d in duties)
    time, motor = inputs.time[::stride], inputs.motor[::stride]
    return dataclasses.replace(inputs, time=time, motor=motor, valve_a=a, valve_b=b)


# --- chambers, against closed forms ----------------------------------------------------


def filled(parameters: Parameters, **changes: Any) -> Trajectory:
    """Valve A on from the first row to 1 s, then off; the piston held."""
    time = seconds(2.0)
    valve = ValveCommand((time < 1.0).astype(float))
    return one(Inputs(time, 0.0 * time, valve_a=valve, **changes), held(parameters))


def test_filling_and_discharging_follow_their_closed_forms() -> None:
    p = REFERENCE
    run = filled(p)
    per_flow = 1.4 * p.gas_constant * p.temperature / (p.offset_a * p.area_a)
    since = run.time - p.on_delay_a
    boundary = 0.53 * p.supply
    linear = p.atmosphere + per_flow * p.choked_fill_a * since
    choked = (since > 0) & (linear < boundary)
    np.testing.assert_allclose(run.pressure_a[choked], linear[choked], atol=1e-6)
    until = (boundary - p.atmosphere) / (per_flow * p.choked_fill_a)
    root = np.sqrt(p.supply - boundary) - 0.5 * per_flow * p.c_fill_a * (since - until)
    rises = (since > until) & (root > 0) & (run.time < 1.0)
    np.testing.assert_allclose(run.pressure_a[rises], p.supply - root[rises] ** 2, atol=2.0)
    full = (root < -5.0) & (run.time < 1.0)
    np.testing.assert_allclose(run.pressure_a[full], p.supply, atol=1e-3)
    assert full.any() and choked.sum() > 10 and rises.sum() > 10

    after = run.time - 1.0 - p.off_delay_a
    falls = p.supply - per_flow * p.choked_dis_a * after
    limit = p.atmosphere / 0.53
    choked = (after > 0) & (falls > limit)
    np.testing.assert_allclose(run.pressure_a[choked], falls[choked], atol=1e-3)
    begun = (p.supply - limit) / (per_flow * p.choked_dis_a)
    decay = np.exp(-per_flow * p.c_dis_a * (after - begun))
    late = after > begun
    expected = p.atmosphere + (limit - p.atmosphere) * decay
    np.testing.assert_allclose(run.pressure_a[late], expected[late], atol=0.05)
    assert choked.sum() > 10 and late.sum() > 10


def test_a_small_chamber_reaches_the_supply_without_chatter() -> None:
    tiny = REFERENCE.replace(offset_a=REFERENCE.stroke / 2 + 5e-4, c_fill_a=6e-6)
    run = filled(tiny, position=-END)
    on = (run.time > 0.1) & (run.time < 1.0)
    assert np.ptp(run.pressure_a[on]) < 1e-3
    assert run.pressure_a[on][0] == pytest.approx(tiny.supply, abs=1e-3)


def test_air_flows_back_above_the_supply_and_in_below_the_atmosphere() -> None:
    time = seconds(0.3)
    on = ValveCommand(np.ones_like(time), starts_on=True)
    start = {"pressure_a": 3.4e5, "pressure_b": 0.8e5}
    run = one(Inputs(time, 0.0 * time, valve_a=on, **start), held())
    assert (np.diff(run.pressure_a)[:20] < 0).all()
    assert run.pressure_a[-1] == pytest.approx(REFERENCE.supply, abs=1e-3)
    per_flow = 1.4 * 287.0 * 293.15 / (REFERENCE.offset_b * REFERENCE.area_b)
    expected = 1e5 - 0.2e5 * np.exp(-per_flow * REFERENCE.c_dis_b * time)
    np.testing.assert_allclose(run.pressure_b, expected, atol=0.01)


def test_pressure_slides_along_the_choked_boundary() -> None:
    # The choked law fills faster than a receding piston empties; the unchoked law does not.
    p = REFERENCE.replace(c_fill_a=2e-7, coulomb_effort=0.0, viscous=0.0, inertia=1e6)
    time = seconds(0.02)
    on = ValveCommand(np.ones_like(time), starts_on=True)
    boundary = 0.53 * p.supply
    start = {"pressure_a": boundary, "pressure_b": 1e5, "velocity": 10.0}
    run = one(Inputs(time, 0.0 * time, valve_a=on, **start), p)
    np.testing.assert_allclose(run.pressure_a, boundary, rtol=1e-9)


# --- mechanics, against closed forms ---------------------------------------------------


@pytest.mark.parametrize("effort", [0.332, -0.332])
def test_below_breakaway_the_shaft_stays_where_it_is(effort: float) -> None:
    run = one(pushed(effort, position=0.2), NO_AIR)
    assert (run.position == 0.2).all()
    assert (run.velocity == 0.0).all()


@pytest.mark.parametrize("effort", [0.34, -0.34])
def test_above_breakaway_it_slides_as_coulomb_and_viscous_friction_let_it(effort: float) -> None:
    run = one(pushed(effort), NO_AIR)
    p, way = REFERENCE, np.sign(effort)
    final = (abs(effort) - p.coulomb_effort) / p.viscous
    rate = p.viscous / p.inertia
    expected = way * final * (run.time - (1.0 - np.exp(-rate * run.time)) / rate)
    inside = abs(expected) < END
    np.testing.assert_allclose(run.position[inside], expected[inside], atol=1e-9)


def test_a_sliding_shaft_stops_at_the_right_time_and_sticks() -> None:
    run = one(pushed(0.0, velocity=1.0), NO_AIR)
    p = REFERENCE
    rate, final = p.viscous / p.inertia, p.coulomb_effort / p.viscous
    stop = np.log(1.0 + 1.0 / final) / rate
    assert (run.velocity[run.time > stop] == 0.0).all()
    assert (run.velocity[run.time < stop - 1e-6] > 0.0).all()
    travel = (1.0 + final) * (1.0 - np.exp(-rate * stop)) / rate - final * stop
    np.testing.assert_allclose(run.position[run.time > stop], travel, atol=1e-9)


def test_the_shaft_breaks_away_when_the_ramp_reaches_static_friction() -> None:
    time = seconds(0.5)
    run = one(Inputs(time, time), NO_AIR)
    # A command holds from its row on: the first one above the limit moves the shaft by the next.
    above = int(np.argmax(time > REFERENCE.static_effort))
    assert int(np.argmax(run.velocity > 0.0)) == above + 1


def test_an_end_stop_takes_all_speed_and_holds_until_pushed_back() -> None:
    time = seconds(3.0)
    motor = np.where(time < 2.0, 0.7, -0.7)
    run = one(Inputs(time, motor), NO_AIR)
    first = int(np.argmax(run.position == run.position.max()))
    assert run.position[first] == pytest.approx(END, rel=1e-15)
    assert 0 < first < 2000
    assert (run.velocity[first:2001] == 0.0).all()
    assert run.position[-1] < END


def test_a_vertical_arm_is_held_by_friction_or_falls_to_hang() -> None:
    upright = {"position": 0.9}
    heavy = one(pushed(0.0, **upright), NO_AIR.replace(gravity_moment=1.0))
    light = one(pushed(0.0, **upright), NO_AIR.replace(gravity_moment=0.3))
    assert heavy.position[-1] < 0.8
    assert (light.position == 0.9).all()


def test_a_linear_axis_falls_as_its_weight_says() -> None:
    p = NO_AIR.replace(
        pitch_radius=1.0,
        weight=19.62,
        inertia=2.0,
        static_effort=6.0,
        coulomb_effort=4.0,
        viscous=0.0,
        stroke=10.0,
        offset_a=6.0,
        offset_b=6.0,
        max_effort=100.0,
    )
    run = one(pushed(0.0), p)
    np.testing.assert_allclose(run.position, -0.5 * 15.62 / 2.0 * run.time**2, atol=1e-12)


def test_the_motor_is_limited_as_declared() -> None:
    runs = [one(pushed(e), NO_AIR.replace(max_effort=0.5)) for e in (0.5, 5.0)]
    np.testing.assert_array_equal(runs[0].position, runs[1].position)


def test_a_closed_cylinder_is_an_adiabatic_spring() -> None:
    p = REFERENCE.replace(**{k: getattr(NO_AIR, k) for k in vars(NO_AIR) if "_dis_" in k})
    run = one(pushed(0.0, velocity=3.0), p)
    for pressure, offset, sign in (
        (run.pressure_a, p.offset_a, 1),
        (run.pressure_b, p.offset_b, -1),
    ):
        volume = offset + sign * p.pitch_radius * run.position
        invariant = pressure * volume**1.4
        np.testing.assert_allclose(invariant, invariant[0], rtol=1e-7)
    assert np.ptp(run.position) > 0.1


# --- effects and valve models ----------------------------------------------------------


def test_a_neutral_effect_changes_no_bit_and_a_strong_one_every_channel() -> None:
    inputs, models = random_runs(seed=4, count=1, seconds=0.4)
    bare = simulate(inputs, models)[0]
    neutral = simulate(inputs, [models[0] + Everywhere(0.0)])[0]
    acting = simulate(inputs, [models[0] + Everywhere(0.2)])[0]
    for at_zero, changed, value in zip(states(neutral), states(acting), states(bare), strict=True):
        np.testing.assert_array_equal(at_zero, value)
        assert rms(changed - value) > 0.0


@dataclass(frozen=True)
class SlowMotor(Effect):
    """Test-only: the motor's effort through a first-order lag, as an extra state."""

    states = ("effort",)
    lag: Any = 0.01

    def motor_effort(self, effort: Any, point: Any) -> Any:
        return point.extra["effort"]

    def initial_states(self, point: Any) -> dict[str, Any]:
        return {"effort": 0.0 * point.position}

    def state_rates(self, point: Any, flows: Any) -> dict[str, Any]:
        return {"effort": (point.motor - point.extra["effort"]) / self.lag}


def test_an_extra_state_is_integrated_and_triggers_breakaway() -> None:
    run = simulate([pushed(0.5)], [Model(NO_AIR) + SlowMotor(0.05)])[0]
    breaks = -0.05 * np.log(1.0 - REFERENCE.static_effort / 0.5)
    first = int(np.argmax(run.velocity > 0.0))
    assert run.time[first - 1] <= breaks <= run.time[first]


@dataclass(frozen=True)
class LinearSurfaces:
    """Test-only: a flow that is proportional to duty, and an exhaust that is to the rest."""

    gain: Any

    def fill(self, duty: Any, pressure: Any) -> Any:
        return self.gain * (duty * (3e5 - pressure) - (1.0 - duty) * (pressure - 1e5))

    def discharge(self, duty: Any, pressure: Any) -> Any:
        return self.fill(duty, pressure)


def test_an_averaged_valve_model_settles_where_its_surface_is_zero() -> None:
    time = seconds(3.0)
    duty = [ValveCommand(np.full(len(time), d), is_duty=True) for d in (0.25, 0.75)]
    surfaces = (LinearSurfaces(3e-9), LinearSurfaces(3e-9))
    run = one(Inputs(time, 0.0 * time, *duty), held(), surfaces=surfaces)
    np.testing.assert_allclose([run.pressure_a[-1], run.pressure_b[-1]], [1.5e5, 2.5e5], rtol=1e-6)
    rate = 1.4 * 287.0 * 293.15 / (REFERENCE.offset_a * REFERENCE.area_a) * 3e-9 * 2e5 / 2e5
    expected = 1.5e5 - 0.5e5 * np.exp(-rate * time)
    np.testing.assert_allclose(run.pressure_a, expected, rtol=1e-6)


def test_a_duty_counts_for_the_period_that_it_starts() -> None:
    time = seconds(0.05)
    duty = np.where(time < 0.012, 1.0, 0.0)  # changes within a period of 5 ms
    command = ValveCommand(duty, is_duty=True)
    run = one(
        Inputs(time, 0.0 * time, command),
        held(),
        surfaces=(LinearSurfaces(3e-9), LinearSurfaces(3e-9)),
    )
    assert time[int(np.argmax(run.pressure_a))] == pytest.approx(0.015)


# --- inputs ----------------------------------------------------------------------------


def test_a_parameter_that_was_not_identified_is_named() -> None:
    with pytest.raises(NotIdentifiedError, match="c_fill_b"):
        one(pushed(0.1), REFERENCE.replace(c_fill_b=float("nan")))


def test_no_inputs_no_runs_and_malformed_ones_are_refused() -> None:
    assert simulate([], []) == []
    time = seconds(0.1)
    with pytest.raises(ValueError, match="have the length of time"):
        one(Inputs(time, np.zeros(3)), REFERENCE)
    with pytest.raises(ValueError, match="two rows"):
        one(Inputs(time[:1], np.zeros(1)), REFERENCE)


def _trial(**channels: Any) -> Trial:
    time = seconds(0.2)
    given = {k: np.broadcast_to(v, time.shape).astype(float) for k, v in channels.items()}
    return Trial("1", 5.0 + time, given, "log.csv test 1")


def _rig(text: str) -> Any:
    import tomllib

    return rig_from_content(tomllib.loads(text), "rig.toml")


def test_trials_start_from_their_first_rows_and_may_differ_in_length(rig_text: str) -> None:
    rig = _rig(rig_text)
    first = _trial(theta_rad=0.3, pressure_a_pa=1.2e5, duty_a=0.4, valve_a=0.0)
    second = Trial("2", first.time[:50], {"motor_torque_nm": np.full(50, 0.5)}, "log.csv test 2")
    found = simulate_trials([first, second], rig, REFERENCE)
    assert [len(f["time_s"]) for f in found] == [201, 50]
    start = {name: float(values[0]) for name, values in found[0].items()}
    assert start == {
        "time_s": 5.0,
        "theta_rad": 0.3,
        "velocity_rad_per_s": 0.0,
        "pressure_a_pa": 1.2e5,
        "pressure_b_pa": 1e5,
    }
    assert found[0]["pressure_a_pa"].max() > 1.25e5
    assert found[1]["theta_rad"][-1] > 0.0


def test_a_logged_supply_is_the_lines_pressure_of_its_test(rig_text: str) -> None:
    """Where nothing fills; what a flow takes from it is the model's to say."""
    rig = _rig(rig_text)
    rows = np.arange(201)
    valve = np.where(rows < 100, 1.0, 0.0)
    logged = np.where(rows < 100, 3.3e5, 3.5e5)
    on_line = _trial(valve_a=valve, pressure_a_pa=1e5, supply_pressure_pa=logged)
    assert on_line.line_pressure_pa == 3.5e5
    assert _trial(valve_a=valve).line_pressure_pa is None
    assert _trial(valve_a=valve, supply_pressure_pa=np.nan).line_pressure_pa is None
    bleeds = _trial(valve_a_bleed=1.0, supply_pressure_pa=3.4e5)
    assert bleeds.line_pressure_pa == 3.4e5
    assert _trial(duty_a=0.5, supply_pressure_pa=3.3e5).line_pressure_pa is None
    higher, declared = (
        simulate_trials([trial], rig, REFERENCE)[0]["pressure_a_pa"]
        for trial in (on_line, _trial(valve_a=valve, pressure_a_pa=1e5))
    )
    assert higher.max() > declared.max() + 1e4


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({"theta_rad": 0.0}, "holds no command"),
        ({"duty_a": 1.2}, "duty_a = 1.2 at 5 s"),
        ({"valve_a": 0.5}, "valve_a = 0.5 at 5 s"),
        ({"duty_a": 0.5, "valve_a": 1.0}, "both duty_a and valve_a"),
        ({"duty_a": np.nan}, "duty_a is missing at 5 s"),
        ({"duty_a": 0.1, "pressure_b_pa": np.nan}, "pressure_b_pa is missing"),
    ],
)
def test_inputs_that_cannot_be_simulated(
    rig_text: str, channels: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        inputs_from_trial(_trial(**channels), _rig(rig_text))


def test_valve_models_by_name(rig_text: str) -> None:
    rig = _rig(rig_text)
    empty = Bundle.new(rig, Parts(), [])
    assert surfaces_for(empty, rig, "discrete") == ()
    with pytest.raises(InputError, match="bipolynomial"):
        surfaces_for(empty, rig, "cubic")
    with pytest.raises(NotIdentifiedError, match="ann"):
        surfaces_for(empty, rig, "ann")


def test_only_a_held_test_under_pwm_may_start_on_the_supply(rig_text: str) -> None:
    rig = _rig(rig_text)
    held = _trial(duty_a=0.4, duty_b=0.1, pressure_a_pa=2.9e5, pressure_b_pa=1.1e5, theta_rad=0.1)
    assert starts_on_supply(held, rig) == (True, False)
    moved = with_channels(held, theta_rad=np.linspace(0.0, 0.5, len(held)))
    assert starts_on_supply(moved, rig) == (False, False)


def test_effects_change_the_measured_channels(rig_text: str) -> None:
    trial = _trial(duty_a=0.3)
    model = Model(REFERENCE) + Everywhere(0.0)
    scaled = Model(REFERENCE) + Scaled(0.01)
    plain, found = (simulate_trials([trial], _rig(rig_text), m)[0] for m in (model, scaled))
    np.testing.assert_allclose(found["pressure_a_pa"], 1.01 * plain["pressure_a_pa"])


@dataclass(frozen=True)
class Scaled(Effect):
    """Test-only: a sensor's gain."""

    gain: Any = 0.0

    def measure(self, channels: Any, time: Any) -> dict[str, Any]:
        return {**channels, "pressure_a_pa": channels["pressure_a_pa"] * (1.0 + self.gain)}


@pytest.mark.parametrize("effect", [PressureLag(2e-3), TimeSkew(2.3e-3)], ids=lambda e: e.id)
def test_a_sensor_that_remembers_sees_what_is_between_the_rows(effect: Effect) -> None:
    """Pressures turn at the valves' edges: a line from row to row is no measure of them."""
    inputs, models = random_runs(seed=3, count=1, seconds=1.0, motor=False)
    stride = 25
    duties = [np.repeat(i.values[::20], 20)[: len(inputs[0].time)] for i in _valves(inputs[0])]
    log = _with_duties(inputs[0], duties, 1)
    time = np.linspace(log.time[0], log.time[-1], stride * (len(log.time) - 1) + 1)
    row = np.arange(len(time)) // stride
    a, b = (ValveCommand(d[row], is_duty=True) for d in duties)
    close = dataclasses.replace(log, time=time, motor=log.motor[row], valve_a=a, valve_b=b)
    bare = models[0].parameters
    model = Model(bare, (effect,))
    run = simulate([log], [model])[0]
    plain, reference = one(log, bare), one(close, bare)
    for name in ("pressure_a", "pressure_b"):
        np.testing.assert_allclose(getattr(run, name), getattr(plain, name), atol=1e-2)

    def shown(of: Trajectory) -> Any:
        return measured_channels(of, "theta_rad", model)["pressure_a_pa"]

    expected = shown(reference)[::stride]
    assert rms(shown(run) - expected) < 0.1 * rms(shown(plain) - expected)


def test_rows_between_hold_the_commands_and_leave_the_logs_rows() -> None:
    inputs, models = random_runs(seed=3, count=1, seconds=1.0, motor=False)
    sparse = _with_duties(inputs[0], [v.values for v in _valves(inputs[0])], 5)
    closer, rows = with_edges(sparse, models[0], 1e-3)
    np.testing.assert_array_equal(closer.time[rows], sparse.time)
    assert np.diff(closer.time).min() > 0.0 and np.diff(closer.time).max() < 1.001e-3
    for given, held in zip(_valves(sparse), _valves(closer), strict=True):
        np.testing.assert_array_equal(held.values[rows], given.values)
        between = np.searchsorted(rows, np.arange(len(closer.time)), side="right") - 1
        np.testing.assert_array_equal(held.values, given.values[between])


# --- processes -------------------------------------------------------------------------


def test_the_compilation_cache_lies_in_the_users_cache(tmp_path: Path) -> None:
    code = (
        "from sysid.plant.jax_setup import jax, cache_directory;"
        "print(cache_directory()); print(jax.config.jax_compilation_cache_dir);"
        "print(jax.config.jax_enable_x64);"
        "jax.jit(lambda x: x * 2 + 1)(1.0).block_until_ready()"
    )
    import os

    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**environment, "XDG_CACHE_HOME": str(tmp_path)},
    )
    folder = tmp_path / "sysid" / "jax"
    assert done.stdout.split() == [str(folder), str(folder), "True"]
    assert any(folder.iterdir())
