"""The closed loop: plant, sensors and controller a control period at a time, many at once.

Every case is a lane of one batch. Cases whose controllers differ in their numbers only are
computed together; the plants of a batch may differ in numbers, not in effects. With
`compiled` the whole run is one compiled loop; without, controllers are called from Python
with numpy arrays, for those that cannot be traced.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sysid.controllers.cases import PERIOD_S, Case, ClosedLoopRun, faults_of
from sysid.controllers.groups import Group, grouped
from sysid.controllers.guard import GuardedController, all_finite, let_go, rows_of
from sysid.controllers.interface import Commands, Controller, Reference, StateEstimate
from sysid.controllers.plant_effects import (
    SensorMemory,
    TrueSignals,
    check_effects,
    idle_effects,
    start_sensors,
    through_sensors,
)
from sysid.controllers.sensing import (
    Readings,
    SensingMemory,
    filter_coefficients,
    quantised,
    sense,
    start_sensing,
)
from sysid.controllers.trajectories import DURATION_S
from sysid.errors import NotIdentifiedError, SimulationError, input_error
from sysid.plant import plant
from sysid.plant.arrays import put_together, take_apart
from sysid.plant.base import Array, array_namespace
from sysid.plant.jax_setup import jax, jnp, on_processor
from sysid.plant.period_step import (
    ValveIntervals,
    advance_period,
    command_duty,
    command_switch,
    no_intervals,
)
from sysid.plant.ports import Model, Point, stack_models
from sysid.plant.programs import kept
from sysid.plant.simulator import ENDLESS
from sysid.plant.stepper import Lanes
from sysid.types import FloatArray

_COMPILER_OPTIONS = {"xla_backend_optimization_level": 2}
_MOST_PROGRAMS = 8
_SHOWN = ("position", "velocity", "pressure_a", "pressure_b")
_MEASURED = ("measured", "measured_a", "measured_b")
_RECORDED = (*_SHOWN, *_MEASURED, "motor", "command_a", "command_b", "payload_kg")


class _Carry(NamedTuple):
    lanes: Lanes
    valves: tuple[ValveIntervals, ValveIntervals]
    sensors: SensorMemory
    sensing: SensingMemory
    memories: tuple[Any, ...]
    invalid: Array


class _Batch(NamedTuple):
    """Inputs of a run: numbers by lane, tables by tick. Arrays (lanes,) unless stated."""

    plant: list[Array]
    controllers: list[list[Array]]
    reference: Array  # (ticks + preview, 4, lanes)
    noise: Array  # (ticks, 2, lanes)
    sensors: Array  # (2, lanes): steps of position and pressure
    sticks: Array
    fails: Array  # (2, 2, lanes): pressure's and encoder's first and last time
    uses: Array  # (2, lanes): valves, motor
    is_duty: Array
    filters: Array  # (2, 3, lanes)


class _Fixed(NamedTuple):
    """Settings for which the loop is compiled."""

    plant: Any
    groups: tuple[Group, ...]
    ticks_a_period: int
    ticks: int
    is_linear: bool


@on_processor()
def closed_loop(
    cases: Sequence[Case], duration: float = DURATION_S, *, compiled: bool = True
) -> list[ClosedLoopRun]:
    """Run every case for `duration` s at 1 kHz, all in one batch; the result in their order.

    Raises InputError for a PWM period that is no multiple of the control period, plants with
    unlike effects or an effect that no loop can take, NotIdentifiedError for a plant with a
    parameter that is NaN.
    """
    if not cases:
        return []
    batch, fixed = _prepared(cases, duration)
    carry = _start(cases, batch, fixed)
    if compiled:
        carry, record = _run(carry, batch, fixed=fixed)
    else:
        carry, record = _run_in_python(carry, batch, fixed)
    return _results(cases, batch, fixed, carry, record)


# --- before the run ------------------------------------------------------------------------


def _prepared(cases: Sequence[Case], duration: float) -> tuple[_Batch, _Fixed]:
    groups, numbers = grouped([case.controller for case in cases])
    try:
        model = stack_models([case.plant for case in cases])
    except ValueError:
        raise input_error("plants", "differ in their effects", "run them in two batches") from None
    _check_known(model)
    check_effects(cases[0].plant)
    structure, plant_numbers = take_apart(model)
    ticks = round(duration / PERIOD_S)
    preview = max(case.controller.preview for case in cases)
    time = _ticks(ticks + preview)
    columns = [
        np.asarray(getattr(case.sensors, n))
        for n in ("position_step", "pressure_step")
        for case in cases
    ]
    faults = [case.faults for case in cases]
    spans = [
        [f.pressure_fails, f.pressure_recovers, f.encoder_fails, f.encoder_recovers] for f in faults
    ]
    batch = _Batch(
        plant=plant_numbers,
        controllers=numbers,
        reference=np.stack([case.trajectory.sample(time) for case in cases], axis=2),
        noise=np.stack([_noise(case, ticks) for case in cases], axis=2),
        sensors=np.array(columns, dtype=float).reshape(2, len(cases)),
        sticks=np.array([f.encoder_sticks for f in faults]),
        fails=np.array(spans).T.reshape(2, 2, len(cases)),
        uses=np.array([[c.mode.uses_valves, c.mode.uses_motor] for c in cases], dtype=float).T,
        is_duty=np.array([case.controller.is_duty for case in cases]),
        filters=np.stack(
            [filter_coefficients(PERIOD_S, c.sensors.cutoff_hz) for c in cases], axis=2
        ),
    )
    is_linear = bool(np.all(np.asarray(model.parameters.pitch_radius) == 1.0))
    return batch, _Fixed(structure, groups, _ticks_a_period(model), ticks, is_linear)


def _ticks(count: int) -> FloatArray:
    return np.asarray(np.arange(count) * PERIOD_S, dtype=np.float64)


def _noise(case: Case, ticks: int) -> FloatArray:
    """Noise of both pressures, (ticks, 2) Pa; by the case's own seed, whatever its batch."""
    rng = np.random.default_rng(case.seed)
    return np.asarray(case.sensors.pressure_noise * rng.standard_normal((ticks, 2)))


def _ticks_a_period(model: Model) -> int:
    periods = np.unique(np.asarray(model.parameters.pwm_period))
    ticks = periods / PERIOD_S
    if len(periods) > 1 or abs(ticks[0] - round(ticks[0])) > 1e-6 or ticks[0] < 0.5:
        raise input_error(
            "plants",
            f"have PWM periods of {', '.join(f'{p:g} s' for p in periods)}",
            "give all one that is a multiple of the control period of 1 ms",
        )
    return round(float(ticks[0]))


def _check_known(model: Model) -> None:
    known = {n: v for n, v in vars(model.parameters).items() if v is not None}
    unknown = [n for n, v in known.items() if np.isnan(v).any()]
    if unknown:
        raise NotIdentifiedError(
            f"closed loop: {', '.join(unknown)} of the plant is not identified; "
            "fit the tests that identify it"
        )


def _start(cases: Sequence[Case], batch: _Batch, fixed: _Fixed) -> _Carry:
    n = len(cases)
    zero = np.zeros(n)
    model: Model = put_together(fixed.plant, batch.plant)
    position = batch.reference[0, 0]
    parameters = model.at(zero)
    atmosphere = zero + parameters.atmosphere
    point = Point.at_rest(parameters, zero, position=position)
    extra = plant.initial_states(point, model)
    lanes = Lanes(
        time=zero,
        position=position,
        velocity=zero,
        pressure_a=atmosphere,
        pressure_b=atmosphere,
        extra=tuple(zero + extra[name] for name in model.state_names),
        loose=zero,
        index=np.zeros(n, dtype=int),
        elapsed=zero,
    )
    signals = TrueSignals(position, zero, atmosphere, atmosphere)
    sensors = start_sensors(signals, model, PERIOD_S, fixed.is_linear)
    shown, _ = through_sensors(signals, model, sensors, zero, PERIOD_S, fixed.is_linear)
    first = Readings(
        quantised(shown.position, batch.sensors[0]), shown.pressure_a, shown.pressure_b
    )
    memories = tuple(
        controller.start(len(group.lanes)) for controller, group in _controllers(batch, fixed)
    )
    closed = no_intervals(n)
    return _Carry(lanes, (closed, closed), sensors, start_sensing(first), memories, zero)


def _controllers(batch: _Batch, fixed: _Fixed) -> list[tuple[Controller, Group]]:
    return [
        (put_together(group.structure, numbers), group)
        for group, numbers in zip(fixed.groups, batch.controllers, strict=True)
    ]


# --- a tick --------------------------------------------------------------------------------


def _measured(
    carry: _Carry, tick: Array, batch: _Batch, fixed: _Fixed
) -> tuple[Readings, SensorMemory]:
    """The readings at a tick: as the plant's sensors show it, quantised, noisy, and faulty
    where a fault says so."""
    time = tick * PERIOD_S
    signals = TrueSignals(*(getattr(carry.lanes, name) for name in _SHOWN))
    model: Model = put_together(fixed.plant, batch.plant)
    now = time + 0.0 * signals.position
    shown, sensors = through_sensors(signals, model, carry.sensors, now, PERIOD_S, fixed.is_linear)
    last = carry.sensing.last
    position = quantised(shown.position, batch.sensors[0])
    position = jnp.where(time >= batch.sticks, last.position, position)
    noise = batch.noise[tick]
    a, b = (
        quantised(pressure + noise[i], batch.sensors[1])
        for i, pressure in enumerate((shown.pressure_a, shown.pressure_b))
    )
    out = (time >= batch.fails[:, 0]) & (time < batch.fails[:, 1])
    readings = Readings(jnp.where(out[1], jnp.nan, position), jnp.where(out[0], jnp.nan, a), b)
    return readings, sensors


def _reference(tick: Array, batch: _Batch, group: Group, preview: int) -> Reference:
    lanes, table = np.array(group.lanes), batch.reference
    rows: Array
    if isinstance(table, np.ndarray):
        rows = table[tick : tick + preview + 1][:, :, lanes]
    else:
        rows = jax.lax.dynamic_slice_in_dim(table, tick, preview + 1)[:, :, lanes]
    xp = array_namespace(table)
    now, later = ([part[i] for i in range(4)] for part in (rows[0], xp.moveaxis(rows[1:], 1, 0)))
    ahead = Reference(later[0], later[1], later[2], later[3]) if preview else None
    return Reference(now[0], now[1], now[2], now[3], ahead)


def _commanded(
    carry: _Carry, estimate: StateEstimate, batch: _Batch, fixed: _Fixed
) -> tuple[tuple[Any, ...], Commands, Array]:
    """Every group's memory and the commands of all lanes, in the lanes' order.

    And 1 in the lanes that let go for another reason than the estimate, else 0.
    """
    memories, parts = [], []
    xp = array_namespace(estimate.position)
    for (controller, group), memory in zip(_controllers(batch, fixed), carry.memories, strict=True):
        lanes = np.array(group.lanes)
        own = StateEstimate(estimate.tick, *(x[lanes] for x in estimate[1:]))
        reference = _reference(estimate.tick, batch, group, controller.preview)
        memory, commands, bad = _guarded(controller, memory, own, reference)
        memories.append(memory)
        parts.append([xp.zeros(len(lanes)) + c for c in (*commands, bad)])
    order = np.argsort(np.concatenate([g.lanes for g in fixed.groups]))
    *joined, bad = (xp.concatenate([p[i] for p in parts])[order] for i in range(5))
    return tuple(memories), Commands(*joined), bad


def _guarded(
    controller: Controller, memory: Any, estimate: StateEstimate, reference: Reference
) -> tuple[Any, Commands, Array]:
    """A controller's memory and commands, which lets go where what it gets or gives is not finite.

    A user's own is not called with an estimate that has no finite lane, unless it is compiled.
    And 1 in the lanes that let go for another reason than the estimate, else 0.
    """
    xp = array_namespace(estimate.position)
    seen = all_finite(estimate[1:])
    if xp is np and not np.any(seen):
        return (*let_go(seen, memory, memory, Commands(0.0, 0.0, 0.0)), np.zeros(np.shape(seen)))
    after, commands = controller.commands(memory, estimate, reference)
    if type(controller).commands is GuardedController.commands:  # it lets go by itself
        return after, commands, xp.where(seen, after.rejected - memory.rejected, 0.0)
    good = seen & all_finite([*rows_of(reference, controller.preview), *commands[:3]])
    return (*let_go(good, memory, after, commands), xp.where(seen & ~good, 1.0, 0.0))


def _allowed(commands: Commands, batch: _Batch) -> Commands:
    """The commands that the mode allows."""
    motor, a, b, payload = commands
    valves, uses_motor = batch.uses
    return Commands(motor * uses_motor, a * valves, b * valves, payload)


def _driven(
    carry: _Carry, commands: Commands, tick: Array, batch: _Batch, fixed: _Fixed
) -> tuple[Lanes, tuple[ValveIntervals, ValveIntervals]]:
    """Plant and valves after the tick's commands."""
    model: Model = put_together(fixed.plant, batch.plant)
    time = tick * PERIOD_S
    starts = batch.is_duty & (tick % fixed.ticks_a_period == 0)
    valves = []
    for valve, command in zip(carry.valves, (commands.valve_a, commands.valve_b), strict=True):
        valve = command_duty(valve, time, command, model.parameters.pwm_period, starts)
        valves.append(command_switch(valve, time, command > 0.5, ~batch.is_duty))
    pair = (valves[0], valves[1])
    period = fixed.ticks_a_period
    follows = jnp.where(batch.is_duty, (tick // period + 1) * period * PERIOD_S, jnp.inf)
    span = (time, (tick + 1) * PERIOD_S, follows)
    return advance_period(carry.lanes, pair, commands.motor, span, model), pair


def _recorded(carry: _Carry, seen: SensingMemory, commands: Commands) -> tuple[Array, ...]:
    """A row of the record; of the measurements the last good ones."""
    return (*(getattr(carry.lanes, name) for name in _SHOWN), *seen.last, *commands)


@kept(_MOST_PROGRAMS, _COMPILER_OPTIONS)
def _run(carry: _Carry, batch: _Batch, *, fixed: _Fixed) -> tuple[_Carry, tuple[Array, ...]]:
    def body(carry: _Carry, tick: Array) -> tuple[_Carry, tuple[Array, ...]]:
        readings, sensors = _measured(carry, tick, batch, fixed)
        sensing, estimate = sense(carry.sensing, readings, tick, PERIOD_S, batch.filters)
        memories, commands, bad = _commanded(carry, estimate, batch, fixed)
        commands = _allowed(commands, batch)
        lanes, valves = _driven(carry, commands, tick, batch, fixed)
        row = _recorded(carry, sensing, commands)
        return _Carry(lanes, valves, sensors, sensing, memories, carry.invalid + bad), row

    carry, batch = jax.tree.map(jnp.asarray, (carry, batch))
    result: tuple[_Carry, tuple[Array, ...]] = jax.lax.scan(body, carry, jnp.arange(fixed.ticks))
    return result


@kept(_MOST_PROGRAMS, _COMPILER_OPTIONS)
def _sense_once(
    carry: _Carry, tick: Array, batch: _Batch, *, fixed: _Fixed
) -> tuple[SensorMemory, SensingMemory, StateEstimate]:
    readings, sensors = _measured(carry, tick, batch, fixed)
    return sensors, *sense(carry.sensing, readings, tick, PERIOD_S, batch.filters)


@kept(_MOST_PROGRAMS, _COMPILER_OPTIONS)
def _drive_once(
    carry: _Carry, commands: Commands, tick: Array, batch: _Batch, *, fixed: _Fixed
) -> tuple[Lanes, tuple[ValveIntervals, ValveIntervals], Commands]:
    commands = _allowed(commands, batch)
    return *_driven(carry, commands, tick, batch, fixed), commands


def _run_in_python(carry: _Carry, batch: _Batch, fixed: _Fixed) -> tuple[_Carry, tuple[Array, ...]]:
    """Like `_run`, with the controllers called from Python on numpy arrays."""
    bare = fixed._replace(groups=())
    numbers = jax.tree.map(jnp.asarray, batch._replace(controllers=[]))
    rows = []
    for tick in range(fixed.ticks):
        memories = carry.memories
        seen = carry._replace(memories=())
        sensors, sensing, estimate = _sense_once(seen, tick, numbers, fixed=bare)
        estimate = StateEstimate(tick, *(np.asarray(x) for x in estimate[1:]))
        memories, commands, bad = _commanded(carry, estimate, batch, fixed)
        lanes, valves, commands = _drive_once(seen, commands, tick, numbers, fixed=bare)
        rows.append([np.asarray(x) for x in _recorded(carry, sensing, commands)])
        carry = _Carry(lanes, valves, sensors, sensing, memories, carry.invalid + bad)
    return carry, tuple(np.stack(column) for column in zip(*rows, strict=True))


# --- after the run -------------------------------------------------------------------------


def _results(
    cases: Sequence[Case],
    batch: _Batch,
    fixed: _Fixed,
    carry: _Carry,
    record: tuple[Array, ...],
) -> list[ClosedLoopRun]:
    columns = dict(zip(_RECORDED, (np.asarray(x) for x in record), strict=True))
    time = _ticks(fixed.ticks)
    runs = []
    for lane, case in enumerate(cases):
        own = {name: column[:, lane] for name, column in columns.items()}
        if np.isnan(carry.lanes.velocity[lane]):
            raise SimulationError(ENDLESS)
        reference = np.asarray(batch.reference[: fixed.ticks, :, lane])
        counts = float(carry.sensing.rejected[lane]), float(carry.invalid[lane])
        lines = idle_effects(case.plant) + faults_of(case, time, reference[:, 0], own, counts)
        duty = case.controller.is_duty
        runs.append(ClosedLoopRun(time, reference, **own, is_duty=duty, faults=tuple(lines)))
    return runs


__all__ = ["PERIOD_S", "Case", "ClosedLoopRun", "closed_loop"]
