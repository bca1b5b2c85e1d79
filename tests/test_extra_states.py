"""Extra states along measured traces, against a plain loop over the samples."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from test_diagnosis import made

from sysid.diagnosis.actuator.equation_error import (
    CHANNELS,
    EFFORT,
    _without_sensors,
    equation_error,
    forget,
)
from sysid.diagnosis.actuator.samples import Rows, Traces, prepare
from sysid.diagnosis.actuator.states import StatesModel, integrate_states, measured_flow, point_of
from sysid.io.channels import SIDES
from sysid.plant import plant
from sysid.plant.base import Array
from sysid.plant.effects import catalogue
from sysid.plant.effects.chamber import TemperatureDrift, TubeLag, WallHeatTransfer
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.linkage import Backlash
from sysid.plant.effects.sensor import PressureLag, PressureOffset
from sysid.plant.effects.supply import SupplyDroop
from sysid.plant.effects.valve import CoilHeating
from sysid.plant.ports import Effect, Model
from sysid.types import FloatArray

KINDS = [kind for kind in catalogue().values() if kind.states]
# Seconds, as `sysid.diagnosis.actuator.states` has them: run-up and piece, with and without flows.
RUN_UP, PIECE = 0.35, 0.25
MECHANICAL_RUN_UP, MECHANICAL_PIECE = 2.0, 0.5


def brief_traces(each: int = 1) -> tuple[Traces, Model]:
    """A valve test and a motion test, 1500 samples of each, or one in `each` of them."""
    tests, rig, model = made(scatter=0.0)
    kinds = ("valve-discrete", "motion-discrete")
    brief = [next(test for test in tests if test[1] == kind) for kind in kinds]
    cut = [
        (
            file,
            kind,
            replace(
                trial,
                time=trial.time[:1500:each],
                channels={name: values[:1500:each] for name, values in trial.channels.items()},
            ),
        )
        for file, kind, trial in brief
    ]
    return prepare(cut, rig, model), model


@pytest.fixture(scope="module")
def short() -> tuple[Traces, Model]:
    return brief_traces()


def with_states(kind: type) -> CatalogueEffect:
    """A typical effect of a kind that may have states."""
    effect: CatalogueEffect = kind.typical()  # type: ignore[attr-defined]
    # A droop has states with a volume behind its resistance alone.
    own: dict[str, Any] = {} if effect.states else {"line_time_s": 0.02}
    return replace(effect, **own)


def plainly(traces: Traces, model: Model, low: int, stop: int) -> dict[str, FloatArray]:
    """Heun's method from row `low` on, one row after the other: the states at `low` to `stop`.

    In two steps a row where one is too long for a contact.
    """
    step = float(traces.time[low + 1] - traces.time[low])
    channels = {f.name: getattr(traces, f.name) for f in fields(traces) if f.name != "runs"}

    parts = 2 if any(effect.fastest_rate for effect in model.effects) else 1

    def at(row: int, share: float) -> Traces:
        """Between two rows what is sampled goes on in a straight line, but for the direction."""
        own = {n: (1.0 - share) * v[[row]] + share * v[[row + 1]] for n, v in channels.items()}
        way = channels["direction"][[row + 1 if share == 1.0 else row]]
        return Traces(runs=(), **own | {"direction": way})

    def rates(row: int, share: float, state: dict[str, FloatArray]) -> dict[str, FloatArray]:
        here = at(row, share)
        point = replace(point_of(here, model), extra=state)
        flows = {side: measured_flow(side, here, point, model) for side in SIDES}
        found = plant.state_rates(point, flows, model)
        return {name: np.asarray(value) for name, value in found.items()}

    begin = point_of(at(low, 0.0), model)
    state = {n: np.asarray(v) for n, v in plant.initial_states(begin, model).items()}
    history = [state]
    step /= parts
    for row in range(low, stop):
        for part in range(parts):
            slope = rates(row, part / parts, state)
            trial = {n: state[n] + step * slope[n] for n in state}
            after = rates(row, (part + 1) / parts, trial)
            state = {n: state[n] + 0.5 * step * (slope[n] + after[n]) for n in state}
        history.append(state)
    return {n: np.array([float(s[n][0]) for s in history]) for n in state}


@pytest.mark.parametrize("drifts", [False, True])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.id)
def test_states_are_those_of_a_plain_loop(
    kind: type, drifts: bool, short: tuple[Traces, Model]
) -> None:
    traces, model = short
    model = model + with_states(kind)
    if drifts:
        model = model + TemperatureDrift(0.2)
    needs_flow = StatesModel.of(model, traces).acts_on_rates
    assert needs_flow is (kind in (WallHeatTransfer, TubeLag, SupplyDroop))
    run_up_s, piece_s = (RUN_UP, PIECE) if needs_flow else (MECHANICAL_RUN_UP, MECHANICAL_PIECE)
    found = integrate_states(traces, model, needs_flow)
    assert set(found) == set(model.state_names)
    for run in traces.runs:
        if not run.moves and not needs_flow:
            assert all(not found[name][run.rows].any() for name in found)
            continue
        count, run_up = round(piece_s / run.period), round(run_up_s / run.period)
        first = run.rows.start + 2 * count
        low = max(run.rows.start, first - run_up)
        expected = plainly(traces, model, low, first + count - 1)
        for name, values in expected.items():
            size = float(np.abs(values).max())
            np.testing.assert_allclose(
                found[name][first : first + count],
                values[first - low :],
                rtol=1e-9,
                atol=1e-10 * size,
            )


def test_states_between_slow_samples_follow_a_motion_that_goes_on() -> None:
    """Were it held until the next sample, the shaft would strike the motor behind its backlash."""
    places = []
    for each in (1, 5):
        traces, model = brief_traces(each)
        gap = model + Backlash(0.02, 2.0, 0.1)
        angle = integrate_states(traces, gap, needs_flow=False)["backlash_motor_rad"]
        run = next(run for run in traces.runs if run.moves)
        places.append((angle - traces.position)[run.rows])
    quick, slow = places[0][::5], places[1]
    assert np.abs(quick).max() > 0.01
    assert np.sqrt(np.mean((slow - quick) ** 2)) < 0.1 * np.std(quick)


@pytest.mark.parametrize("side", SIDES)
def test_what_an_effect_adds_to_a_pressures_rate_is_no_flow(
    side: str, short: tuple[Traces, Model]
) -> None:
    """Heat from the wall: the flow that makes a rate is found from that rate."""
    traces, model = short
    model = model + WallHeatTransfer(0.3, "both", 0.8)
    warmer = {f"wall_log_temperature_{s}": np.full(len(traces), 0.1) for s in SIDES}
    point = replace(point_of(traces, model), extra=warmer)
    flow = 1e-4 * np.sin(np.arange(len(traces)))
    rate = np.asarray(plant.pressure_rate(side, flow, point, model))
    seen = replace(traces, **{f"rate_{side}": rate})
    np.testing.assert_allclose(measured_flow(side, seen, point, model), flow, atol=1e-12)


class _OwnSensor(CatalogueEffect):
    """A user's: says nothing of how it measures."""

    id, quantities = "own-sensor", ()

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        name = "pressure_a_pa"
        return {**channels, name: channels[name] * 1.01} if name in channels else dict(channels)


@pytest.mark.parametrize(
    "sensors",
    [
        (PressureOffset(500.0),),
        (PressureLag(2e-3),),
        (_OwnSensor(),),
        (PressureOffset(500.0), _OwnSensor()),
    ],
)
def test_what_sensors_show_at_some_rows_is_what_they_show_of_all(
    sensors: tuple[Effect, ...], short: tuple[Traces, Model]
) -> None:
    traces, model = short
    model = Model(model.parameters, sensors)
    rows = dict.fromkeys(CHANNELS, Rows(np.arange(50, len(traces), 7)))
    whole, some = equation_error(traces, model), equation_error(traces, model, rows=rows)
    for name in CHANNELS:
        np.testing.assert_allclose(some[name], whole[name][rows[name].index], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.id)
def test_states_that_do_not_follow_the_valves_are_the_same_at_another_timing(
    kind: type, short: tuple[Traces, Model]
) -> None:
    """These are not integrated again for each timing that is tried."""
    traces, model = short
    effect = with_states(kind)
    late = traces.with_opening(np.roll(traces.open_a, 20), np.roll(traces.open_b, 20))
    at, later = (integrate_states(t, model + effect, needs_flow=True) for t in (traces, late))
    same = all(np.array_equal(at[name], later[name]) for name in at)
    assert same is not StatesModel.of(model + effect, traces).follows_valves


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.id)
def test_states_are_integrated_again_only_for_numbers_that_they_follow(
    kind: type, short: tuple[Traces, Model]
) -> None:
    """A fit moves one number after the other, and most change no state."""
    traces, model = short
    whole = model + with_states(kind)
    here = integrate_states(traces, whole, needs_flow=True)
    asked = StatesModel.of(whole, traces)
    for name in (f.name for f in fields(model.parameters)):
        value = getattr(model.parameters, name)
        if not isinstance(value, float) or value == 0.0:
            continue
        moved = Model(model.parameters.replace(**{name: 1.05 * value}), whole.effects)
        there = integrate_states(traces, moved, needs_flow=True)
        same = all(np.array_equal(here[n], there[n]) for n in here)
        assert same or StatesModel.of(moved, traces) != asked, name
    stiffer = Model(model.parameters.replace(viscous=0.1), whole.effects)
    assert StatesModel.of(stiffer, traces) == asked


def test_other_sensors_leave_no_traces_of_the_last_ones(short: tuple[Traces, Model]) -> None:
    """Each takes fourteen channels, and none is asked for again."""
    traces, model = short
    rows = dict.fromkeys(CHANNELS, Rows(np.arange(0, len(traces), 2)))
    alive = []
    for offset in (100.0, 200.0, 300.0):
        sensors = (PressureOffset(offset), CoilHeating(1e-3), TubeLag(2e-3))
        equation_error(traces, Model(model.parameters, sensors), CHANNELS, rows)
        alive.append(weakref.ref(_without_sensors(traces, sensors[:1])))
    # The next may be asked of the torque balance alone.
    equation_error(traces, Model(model.parameters, (PressureOffset(400.0),)), (EFFORT,), rows)
    gc.collect()
    assert [kept() is not None for kept in alive] == [False, False, False]
    forget()
