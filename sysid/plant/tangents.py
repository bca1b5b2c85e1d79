"""Open-loop simulation with its derivatives: forward mode through every step and every event.

The tangents of a run's states by its start state and by any of the model's numbers are carried
along with the states. Choking, sticking, breakaway and the stops move with the parameters: the
share of a step at which an event lies is a function of the states, so that its derivative, and
with it the jump of the tangents there, is part of the result. A valve's edges move with its
delays: they (of mean flows: the sub-steps' durations) have tangents as well, differences of the
exact edges, which are linear in the delays.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sysid.errors import SimulationError
from sysid.parallel import in_threads
from sysid.plant.jax_setup import jax, jnp, on_processor
from sysid.plant.lanes import Lanes, Table
from sysid.plant.ports import Model, Structure, join, overrides, split, stack_models
from sysid.plant.preparation import Inputs, Shared, prepare
from sysid.plant.programs import kept
from sysid.plant.simulator import (
    COMPILER_OPTIONS,
    ENDLESS,
    MAX_STEP,
    MOST_EVENTS,
    STATE,
    at_first_row,
    check_commands,
    check_known,
    in_their_tests,
    start_lanes,
)
from sysid.plant.stepper import advance
from sysid.plant.tables import Timing, block_of
from sysid.types import FloatArray

Direction = tuple[int, str]
"""A number of the model: its part (0 the base parameters, 1 on the effects) and its name."""

STARTS = STATE
"""The first tangents of every run: by its start position, velocity and pressures."""

# As in `simulator`: few shapes are ever compiled. The tangents fill the vectors next to the runs.
_WIDTH = 8
_ROWS_A_CALL = (256, 1024)
# Delays are moved by this for the edges' tangents, s: less than any sub-step that counts.
_DELAY_STEP = 1e-7
_TIMING = ("on_delay_a", "off_delay_a", "on_delay_b", "off_delay_b")


class Tangents(NamedTuple):
    """One run: `states` (4, n) at its rows and `slopes` (4 + k, 4, n), by start and direction.

    States are position, velocity, pressures: rad or m, rad/s or m/s, Pa. A start at rest (velocity
    exactly 0) has no slope by its velocity.
    """

    states: FloatArray
    slopes: FloatArray


class _Slopes(NamedTuple):
    """Tangents that go on from chunk to chunk: those of the lanes' floats, (k, runs) each."""

    time: Any
    position: Any
    velocity: Any
    pressure_a: Any
    pressure_b: Any
    extra: tuple[Any, ...]
    elapsed: Any


def simulate_tangents(
    inputs: Sequence[Inputs],
    models: Sequence[Model],
    directions: Sequence[Direction],
    surfaces: tuple[Any, ...] = (),
    max_step: float = MAX_STEP,
) -> list[Tangents]:
    """Simulate every run as `simulator.simulate` does, with tangents along `directions`.

    Raises as `simulate` does.
    """
    models = in_their_tests(inputs, models)
    pairs = list(zip(inputs, models, strict=True))
    check_known(models, bool(surfaces))
    check_commands(inputs)
    varied = tuple(directions)
    order = sorted(range(len(pairs)), key=lambda i: len(pairs[i][0].time))
    blocks = [order[i : i + _WIDTH] for i in range(0, len(order), _WIDTH)]

    def block(members: list[int]) -> list[Tangents]:
        own = [pairs[i] for i in members]
        own += [own[0]] * (_WIDTH - len(own))
        return _block(own, len(members), varied, surfaces, max_step)

    results = in_threads(block, blocks)
    found = {
        i: run
        for members, own in zip(blocks, results, strict=True)
        for i, run in zip(members, own, strict=True)
    }
    return [found[i] for i in range(len(pairs))]


@on_processor()
def _block(
    pairs: list[tuple[Inputs, Model]],
    count: int,
    varied: tuple[Direction, ...],
    surfaces: tuple[Any, ...],
    max_step: float,
) -> list[Tangents]:
    """The first `count` of these runs; the others are idle and fill the compiled width."""
    shared = Shared()
    inputs, models = [i for i, _ in pairs], [m for _, m in pairs]
    runs = prepare(inputs[:count], models[:count], surfaces, max_step, shared)
    moved = [
        _moved(i, m, r.timing, varied, surfaces, max_step, shared)
        for (i, m), r in zip(pairs, runs, strict=False)
    ]
    model = stack_models(models)
    structure, numbers = split((model.parameters, *model.effects, *surfaces))
    lanes, slopes = _start(inputs, model, varied)
    longest = max(len(r) for r in runs)
    size = next((n for n in _ROWS_A_CALL if n >= longest), _ROWS_A_CALL[-1])
    pieces = block_of(runs, len(pairs), size, max_step, apart=True)
    first = [[np.array([[getattr(lanes, n)[i]] for n in STATE])] for i in range(count)]
    slope = [
        [np.array([[getattr(slopes, n)[:, i]] for n in STATE]).transpose(2, 0, 1)]
        for i in range(count)
    ]
    room = _room(size)
    for start, table in pieces.tables():
        timing = pieces.timing_slopes(start, moved, 4 + len(varied))
        lanes = at_first_row(lanes)
        calls = 0
        while (np.asarray(lanes.index) < table.count).any():
            if calls * room > int(table.most) + MOST_EVENTS:
                raise SimulationError(ENDLESS)
            calls += 1
            lanes, slopes, states, tangents, reached = _advance_chunk(
                lanes,
                table,
                numbers,
                slopes,
                timing,
                structure=structure,
                effects=len(model.effects),
                varied=varied,
            )
            reached, states, tangents = (np.asarray(a) for a in (reached, states, tangents))
            for i in range(count):
                rows = np.flatnonzero(reached[i])
                first[i].append(states[i][:, rows])
                slope[i].append(tangents[i][:, :, rows])
    return [
        Tangents(np.concatenate(f, axis=-1), np.concatenate(s, axis=-1))
        for f, s in zip(first, slope, strict=True)
    ]


def _moved(
    inputs: Inputs,
    model: Model,
    timing: Timing,
    varied: tuple[Direction, ...],
    surfaces: tuple[Any, ...],
    max_step: float,
    shared: Shared,
) -> dict[int, Timing]:
    """For each tangent the change of the run's timing, s per unit, where it changes.

    Where a delay's change would reorder the edges, a one-sided difference is taken.
    """
    found = {}
    for j, (part, name) in enumerate(varied, start=len(STARTS)):
        if not _moves_edges(model, part, name):
            continue
        # By step: what is as long as the timing itself.
        ends = {0.0: timing}
        for step in (_DELAY_STEP, -_DELAY_STEP):
            near = with_step(model, (part, name), step)
            other = prepare([inputs], [near], surfaces, max_step, shared)[0].timing
            if all(len(o) == len(own) for o, own in zip(other, timing, strict=True)):
                ends[step] = other
        high, low = max(ends), min(ends)
        if high > low:
            found[j] = tuple(
                _difference(*of, high - low) for of in zip(ends[high], ends[low], strict=True)
            )
    return found


def _difference(high: FloatArray, low: FloatArray, step: float) -> FloatArray:
    """Slope between two; an edge that never comes has none."""
    known = np.isfinite(low)
    slope = np.zeros(len(low))
    slope[known] = (high[known] - low[known]) / step
    return slope


def _moves_edges(model: Model, part: int, name: str) -> bool:
    if part == 0:
        return name in _TIMING
    return overrides(model.effects[part - 1], "pulses", "delays")


def number_of(model: Model, direction: Direction) -> float:
    """The number of a model that a direction names."""
    part, name = direction
    return float(getattr(model.parameters if part == 0 else model.effects[part - 1], name))


def with_step(model: Model, direction: Direction, step: float) -> Model:
    """The model with one number moved by a step."""
    part, name = direction
    value = number_of(model, direction) + step
    if part == 0:
        return Model(model.parameters.replace(**{name: value}), model.effects)
    effects: list[Any] = list(model.effects)
    effects[part - 1] = dataclasses.replace(effects[part - 1], **{name: value})
    return Model(model.parameters, tuple(effects))


def _start(
    inputs: list[Inputs], model: Model, varied: tuple[Direction, ...]
) -> tuple[Lanes, _Slopes]:
    """The lanes at their start, and their tangents."""
    lanes = start_lanes(inputs, model)
    count, runs = 4 + len(varied), len(inputs)
    states = [np.zeros((count, runs)) for _ in STATE]
    for i, state in enumerate(states):
        state[i] = 1.0
    # At rest a small velocity is braked at once: to first order nothing comes of it.
    states[1][1] = np.asarray(lanes.velocity) != 0.0
    zero = np.zeros((count, runs))
    position, velocity, pressure_a, pressure_b = states
    extra = _extra_slopes(inputs, model, lanes, varied)
    return lanes, _Slopes(zero, position, velocity, pressure_a, pressure_b, extra, zero)


def _extra_slopes(
    inputs: list[Inputs], model: Model, lanes: Lanes, varied: tuple[Direction, ...]
) -> tuple[FloatArray, ...]:
    """Tangents of the effects' states at the start, by central differences of these."""
    if not model.state_names:
        return ()
    slopes = np.zeros((len(model.state_names), 4 + len(varied), len(inputs)))

    def extra(given: list[Inputs], own: Model) -> FloatArray:
        return np.array([np.broadcast_to(e, len(given)) for e in start_lanes(given, own).extra])

    for i, name in enumerate(STATE):
        here = np.asarray(getattr(lanes, name))
        step = 1e-6 * np.maximum(np.abs(here), 1e-3)
        ends = []
        for sign in (1.0, -1.0):
            moved = [
                dataclasses.replace(one, **{name: float(h + sign * s)})  # type: ignore[arg-type]
                for one, h, s in zip(inputs, here, step, strict=True)
            ]
            ends.append(extra(moved, model))
        slopes[:, i] = (ends[0] - ends[1]) / (2.0 * step)
    for j, (part, name) in enumerate(varied):
        holder: Any = model.parameters if part == 0 else model.effects[part - 1]
        value = np.asarray(getattr(holder, name), dtype=float)
        step = 1e-6 * np.maximum(np.abs(value), 1e-12)
        ends = []
        for sign in (1.0, -1.0):
            new: Any = dataclasses.replace(holder, **{name: value + sign * step})
            effects = list(model.effects)
            if part:
                effects[part - 1] = new
            moved_model = Model(model.parameters if part else new, tuple(effects))
            ends.append(extra(inputs, moved_model))
        slopes[:, 4 + j] = (ends[0] - ends[1]) / (2.0 * step)
    return tuple(slopes)


@kept(4, COMPILER_OPTIONS)
def _advance_chunk(
    lanes: Lanes,
    table: Table,
    numbers: list[dict[str, Any]],
    slopes: _Slopes,
    timing: tuple[Any, ...],
    *,
    structure: Structure,
    effects: int,
    varied: tuple[Direction, ...],
) -> tuple[Lanes, _Slopes, Any, Any, Any]:
    """Like `simulator._advance_chunk`, with the tangents of the lanes, (directions, ...) each.

    States (runs, 4, steps) and their tangents (runs, directions, 4, steps): a run's lie together.
    `timing`: tangents (directions, runs, ...) of the table's timing.
    """
    runs = table.count.shape[0]

    def whole(floats: tuple[_Slopes, Any, tuple[Any, ...]]) -> Any:
        state, times, values = floats
        given = [dict(part) for part in numbers]
        for (part, name), value in zip(varied, values, strict=True):
            given[part][name] = value
        parts = join(structure, given)
        model = Model(parts[0], parts[1 : 1 + effects])
        surfaces = parts[1 + effects :]
        begun = lanes._replace(**state._asdict())
        now, states, reached = _run_through(begun, table.retimed(times), model, surfaces)
        left = _Slopes(*(getattr(now, n) for n in _Slopes._fields))
        return (left, states), (now, reached)

    start = _Slopes(*(getattr(lanes, n) for n in _Slopes._fields))
    values = tuple(numbers[part][name] for part, name in varied)
    # Each direction moves its own number by one.
    basis = jnp.eye(4 + len(varied))[:, 4:]
    along = tuple(
        jnp.broadcast_to(basis[:, j, None], (4 + len(varied), runs)) for j in range(len(varied))
    )

    def push(tangent: Any) -> Any:
        return jax.jvp(whole, ((start, table.timing, values),), (tangent,), has_aux=True)

    (_, states), (moved, tangents), (now, reached) = jax.vmap(push, out_axes=(None, 0, None))(
        (slopes, timing, along)
    )
    by_run = jnp.stack(states).transpose(2, 0, 1)
    return now, moved, by_run, jnp.stack(tangents).transpose(3, 1, 0, 2), reached


def _room(rows: int) -> int:
    """Steps that a call has room for: rows and edges at usual PWM, and some events."""
    return 7 * rows // 4 + 64


def _run_through(
    lanes: Lanes, table: Table, model: Model, surfaces: tuple[Any, ...]
) -> tuple[Lanes, tuple[Any, ...], Any]:
    """The loop of `simulator._advance_chunk` with a record of every step, as far as there is room.

    Returns the lanes, the states after every step (steps, runs) and whether that step reached a
    row of the log (runs, steps).
    """
    room = _room(table.motor.shape[1])
    shape = (room, table.count.shape[0])
    record = jax.lax.dynamic_update_index_in_dim

    def unfinished(carry: Any) -> Any:
        step, lanes, _, _ = carry
        return (step < room) & jnp.any(lanes.index < table.count)

    def advance_once(carry: Any) -> Any:
        step, lanes, states, reached = carry
        after = advance(lanes, table, model, surfaces)
        states = tuple(
            record(s, value, step, 0) for s, value in zip(states, after.shown(), strict=True)
        )
        ends = table.rows(after) > table.rows(lanes)
        return step + 1, after, states, record(reached, ends, step, 0)

    states = tuple(jnp.zeros(shape) for _ in STATE)
    carry = (0, lanes, states, jnp.zeros(shape, dtype=bool))
    _, lanes, states, reached = jax.lax.while_loop(unfinished, advance_once, carry)
    return lanes, states, reached.T


__all__ = ["STARTS", "Direction", "Tangents", "number_of", "simulate_tangents", "with_step"]
