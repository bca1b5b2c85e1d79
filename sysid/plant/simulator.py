"""Open-loop simulation of any model on any inputs, many runs in one batch."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid.errors import NotIdentifiedError, SimulationError
from sysid.io.channels import SIDES
from sysid.parallel import in_threads
from sysid.plant import plant
from sysid.plant.base import MAX_STEP
from sysid.plant.jax_setup import jax, jnp, on_processor
from sysid.plant.lanes import Lanes, Table
from sysid.plant.ports import Model, Point, Structure, join, split, stack_models
from sysid.plant.preparation import (
    Inputs,
    Shared,
    ValveCommand,
    open_intervals,
    prepare,
    with_edges,
)
from sysid.plant.programs import kept
from sysid.plant.stepper import advance
from sysid.plant.tables import Block, block_of
from sysid.types import FloatArray, IntArray

# Runs simulated together in one compiled call. A batch is cut into blocks of these widths,
# padded with idle runs, so that few shapes are ever compiled.
_WIDTHS = (1, 16)
# Rows (mean flows: sub-steps) in one compiled call: the compiled shapes do not depend on a
# log's length. Of a shorter one the rest is never touched.
_ROWS_A_CALL = 10240
# Half the compile time of the default level, and no slower; vectors as wide as the processor's,
# where the compiler would stop at 256 bit.
COMPILER_OPTIONS = {"xla_backend_optimization_level": 2, "xla_cpu_prefer_vector_width": 512}
# No run needs nearly as many steps for its events: more would be an endless loop.
MOST_EVENTS = 2_000_000
ENDLESS = (
    "simulation: the model switches endlessly at one instant; its effects or flows are inconsistent"
)


@dataclass(frozen=True)
class Between:
    """A run at its `rows` (n,) and between them, where a pressure's slope may change.

    `time` (m,) s, `states` (4, m) as in `Trajectory`: what a sensor that remembers has seen.
    """

    time: FloatArray
    states: FloatArray
    rows: IntArray


@dataclass(frozen=True)
class Trajectory:
    """A simulated run at its input's rows; arrays (n,): s, rad or m, rad/s or m/s, Pa.

    `between` is known where a sensor of the model remembers; `extra` (k,) are the effects' states
    at the last row, in the order of the model's `state_names`.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    pressure_a: FloatArray
    pressure_b: FloatArray
    between: Between | None = field(default=None, kw_only=True)
    extra: FloatArray | None = field(default=None, kw_only=True)

    @property
    def states(self) -> FloatArray:
        """(4, n): position, velocity, pressures."""
        return np.array([getattr(self, name) for name in STATE])


# For each part of a model, the names of its numbers.
_Layout = tuple[tuple[str, ...], ...]
# These numbers, (numbers, runs), and those that all runs share: of the valves' surfaces.
_Packed = tuple[FloatArray, list[dict[str, Any]]]


@dataclass(frozen=True)
class _Begun:
    """The runs of a batch before their first step: `numbers` (numbers, runs) of their models, as
    `layout` names them, and `shared` those of the surfaces; `lanes` (runs,).
    """

    structure: Structure
    effects: int
    layout: _Layout
    numbers: FloatArray
    shared: list[dict[str, Any]]
    lanes: Lanes

    @staticmethod
    @on_processor()
    def of(inputs: list[Inputs], models: list[Model], surfaces: tuple[Any, ...]) -> _Begun:
        """Of all runs in one go: what it takes in Python does not depend on their number."""
        model = stack_models(models)
        structure, own = split((model.parameters, *model.effects))
        of_surfaces, shared = split(surfaces)
        lanes = at_first_row(start_lanes(inputs, model))
        if surfaces:
            none = np.zeros(len(inputs))
            lanes = lanes._replace(ripple_a=none, ripple_b=none)
        return _Begun(
            structure + of_surfaces,
            len(model.effects),
            tuple(map(tuple, own)),
            np.array([values for part in own for values in part.values()]),
            shared,
            lanes,
        )

    def at(self, members: IntArray) -> tuple[Lanes, _Packed]:
        """The lanes and numbers of some runs."""
        lanes = jax.tree.map(lambda one: one[members] if np.ndim(one) else one, self.lanes)
        return lanes, (self.numbers.take(members, axis=1), self.shared)


def _unpack(layout: _Layout, packed: _Packed) -> list[dict[str, Any]]:
    """The numbers of a model's parts, and of the surfaces."""
    rows = iter(packed[0])
    return [*(dict(zip(names, rows, strict=False)) for names in layout), *packed[1]]


# More programs than a command needs; each takes some 20 MB.
@kept(12, COMPILER_OPTIONS, given_up=(0,))
def _advance_chunk(
    record: Any,
    lanes: Lanes,
    table: Table,
    packed: _Packed,
    most: Any,
    *,
    structure: Structure,
    effects: int,
    layout: _Layout,
) -> tuple[Any, Lanes, Any]:
    """Advance every run through its table, in `most` steps.

    Returns the record (runs, 4, rows + 1), the states at the ends of the table's rows, where the
    steps within a row write over one another; the lanes, an `index` of -1 for those that did not
    come through, which stay so; and how many rows they went, (runs,).
    """
    parts = join(structure, _unpack(layout, packed))
    model = Model(parts[0], parts[1 : 1 + effects])
    surfaces = parts[1 + effects :]
    runs = table.count.shape[0]
    lanes = at_first_row(lanes, jnp.where(lanes.index < 0, table.count, 0))

    def unfinished(carry: Any) -> Any:
        step, lanes, _ = carry
        return (step < most) & jnp.any(lanes.index < table.count)

    def advance_once(carry: Any) -> Any:
        step, lanes, record = carry
        after = advance(lanes, table, model, surfaces)
        states, rows = jnp.stack(after.shown()), table.rows(lanes)
        for i in range(runs):  # one scatter of all would be ten times as dear
            own = states[None, :, i, None]
            record = jax.lax.dynamic_update_slice(record, own, (i, 0, rows[i]))
        return step + 1, after, record

    _, lanes, record = jax.lax.while_loop(unfinished, advance_once, (0, lanes, record))
    through = jnp.where(lanes.index < table.count, -1, table.count)
    return record, lanes._replace(index=through), table.rows(lanes)


@on_processor()
def _advance_block(
    block: Block, begun: _Begun, members: list[int], lengths: list[int], nan_if_endless: bool
) -> tuple[list[FloatArray], FloatArray]:
    """(4, samples) of the `members` of a batch: position, velocity, pressures at their rows, of
    which there are `lengths`; and the effects' states (k, members) at the last.
    """
    count = len(members)
    # Idle runs repeat the first.
    lanes, packed = begun.at(np.array(members + members[:1] * (block.width - count)))
    rows = _Rows(lanes, lengths)
    of = {"structure": begun.structure, "effects": begun.effects, "layout": begun.layout}
    record = _record_of(block.width)
    for _, table in block.tables():
        most = np.array(int(table.most) + MOST_EVENTS)
        record, lanes, gone = _advance_chunk(record, lanes, table, packed, most, **of)
        rows.take(np.asarray(record), np.asarray(gone))
        if not nan_if_endless and (np.asarray(lanes.index) < 0).any():
            raise SimulationError(ENDLESS)
    _RECORDS.append(record)
    endless = np.asarray(lanes.index)[:count] < 0
    for i in np.flatnonzero(endless):
        rows.runs[i][:, rows.filled[i] :] = math.nan
    extra = np.array(lanes.extra).reshape(-1, block.width)[:, :count]
    extra[:, endless] = math.nan
    return rows.runs, extra


# Records that no block uses: fresh memory for each would cost as much as a short run.
_RECORDS: deque[Any] = deque(maxlen=64)


def _record_of(width: int) -> Any:
    """A record (width, 4, rows + 1) to be written over."""
    shape = (width, len(STATE), _ROWS_A_CALL + 1)
    for _ in range(len(_RECORDS)):
        with suppress(IndexError):  # other threads take some too
            record = _RECORDS.popleft()
            if record.shape == shape:
                return record
            _RECORDS.append(record)
    return jax.device_put(np.zeros(shape))  # not of a compiled program


def at_first_row(lanes: Lanes, index: Any = None) -> Lanes:
    """The lanes at the first row of a table, or at the rows `index`."""
    none = np.zeros(len(lanes.index), dtype=int)
    index = none if index is None else index
    return lanes._replace(index=index, elapsed=np.zeros(len(none)), passed=(none, none))


class _Rows:
    """The states at the rows of a block of runs, as they come: (4, samples) of each in `runs`."""

    def __init__(self, lanes: Lanes, lengths: list[int]) -> None:
        first = np.array([getattr(lanes, name) for name in STATE])[:, : len(lengths)].T
        self._first: FloatArray | None = first
        self._together = None
        if len(set(lengths)) == 1:
            # (runs, 4, samples) where all are as long.
            self._together = np.empty((len(lengths), len(STATE), lengths[0]))
            self.runs = list(self._together)
        else:
            self.runs = [np.empty((len(STATE), n)) for n in lengths]
        self.filled = np.ones(len(lengths), dtype=int)

    def take(self, record: FloatArray, gone: IntArray) -> None:
        """Copy the rows of a record (runs, 4, rows + 1) through which the runs have gone."""
        counts = gone[: len(self.filled)]
        ends = (self.filled + counts).tolist()
        if self._together is not None and len(set(ends)) == 1:
            n, end = int(counts[0]), ends[0]
            self._together[:, :, end - n : end] = record[: len(ends), :, :n]
        else:
            for run, own, n, end in zip(self.runs, record, counts.tolist(), ends, strict=False):
                run[:, end - n : end] = own[:, :n]
        if self._first is not None:
            # Not before: what first touches fresh memory waits for it, and a copy as short as
            # this one holds the interpreter's lock meanwhile.
            for run, start in zip(self.runs, self._first, strict=True):
                run[:, 0] = start
            self._first = None
        self.filled += counts


STATE = ("position", "velocity", "pressure_a", "pressure_b")


def start_lanes(inputs: list[Inputs], model: Model) -> Lanes:
    n = len(inputs)
    zero = np.zeros(n)
    time = zero + [i.elapsed for i in inputs]
    parameters = model.at(time)
    atmosphere = np.broadcast_to(parameters.atmosphere, n)

    def column(name: str) -> FloatArray:
        given = [getattr(i, name) for i in inputs]
        return np.array(
            [a if g is None else g for g, a in zip(given, atmosphere, strict=True)], dtype=float
        )

    position, velocity, pressure_a, pressure_b = (column(name) for name in STATE)
    point = Point(
        time=time,
        position=position,
        velocity=velocity,
        pressure_a=pressure_a,
        pressure_b=pressure_b,
        motor=np.array([i.motor[0] for i in inputs]),
        open_a=zero,
        open_b=zero,
        direction=np.sign(velocity),
        parameters=parameters,
    )
    extra = plant.initial_states(point, model)
    return Lanes(
        time=time,
        position=position,
        velocity=velocity,
        pressure_a=pressure_a,
        pressure_b=pressure_b,
        extra=tuple(
            extra[name] + np.array([i.remembered.get(name, 0.0) for i in inputs])
            for name in model.state_names
        ),
        loose=zero,
        index=np.zeros(n, dtype=int),
        elapsed=zero,
    )


def check_known(models: Sequence[Model], averaged: bool) -> None:
    """Refuse a parameter that is not a number: it would propagate."""
    laws = ("choked_fill", "choked_dis", "c_fill", "c_dis")
    unused = {f"{law}_{side}" for law in laws for side in SIDES} if averaged else set()
    # Neighbours of one run share its model.
    for model in {id(own): own for own in models}.values():
        numbers = vars(model.parameters).items()
        unknown = [name for name, value in numbers if value != value and name not in unused]
        if unknown:
            raise NotIdentifiedError(
                f"simulation: {', '.join(unknown)} of the model is not identified; "
                "fit the tests that identify it"
            )


def check_commands(inputs: Sequence[Inputs]) -> None:
    """Refuse commands that are not numbers: they would propagate."""
    seen: set[int] = set()  # neighbours of one run share its arrays
    for one in inputs:
        n = len(one.time)
        if n < 2:
            raise ValueError("a run needs at least two rows")
        columns = [one.motor] + [c.values for c in (one.valve_a, one.valve_b) if c]
        new = [c for c in columns if id(c) not in seen]
        if any(len(c) != n for c in columns) or not all(np.isfinite(c).all() for c in new):
            raise ValueError("motor and valve commands must be finite and have the length of time")
        seen.update(map(id, new))


def in_their_tests(inputs: Sequence[Inputs], models: Sequence[Model]) -> list[Model]:
    """Each run's model, with what it carries beyond the model's own payload, on its supply."""
    return [
        model.carrying(one.load).supplied_at(one.supply)
        for one, model in zip(inputs, models, strict=True)
    ]


def simulate(
    inputs: Sequence[Inputs],
    models: Sequence[Model],
    surfaces: tuple[Any, ...] = (),
    max_step: float = MAX_STEP,
    *,
    nan_if_endless: bool = False,
) -> list[Trajectory]:
    """Simulate every run open loop, each with its own model, all at once.

    `models` may differ in numbers but not in effects. Without `surfaces` the valves follow
    the discrete law under their real pulses. With `surfaces`, valve A's and B's, the chambers
    get the mean flow over each PWM period: each is a dataclass of numbers whose methods
    `fill` and `discharge` map (duty, pressure in Pa) to kg/s. If they have a `pulse` (the averaged
    law) or a `span` (open less closed flow, kg/s) too, a period's flow begins when its pulse can,
    and the pressures ripple with the pulses (`pulse_means`). Runs may differ in length and
    sampling. The result at the rows of `inputs` does not depend on which runs share a batch.

    Raises NotIdentifiedError for a parameter that is NaN, ValueError for malformed inputs,
    SimulationError where a run switches without end at one instant: it is NaN from there on, and
    the others are as they are, with `nan_if_endless`.
    """
    if not inputs:
        return []
    check_known(models, bool(surfaces))
    models = in_their_tests(inputs, models)
    if not surfaces and models[0].has_remembering_sensor:
        return _simulated_between(inputs, models, max_step, nan_if_endless)
    found = _simulated(inputs, models, surfaces, max_step, nan_if_endless)
    return [
        Trajectory(np.asarray(one.time), *own, extra=extra)
        for one, (own, extra) in zip(inputs, found, strict=True)
    ]


def simulate_states(
    inputs: Sequence[Inputs], models: Sequence[Model], max_step: float
) -> list[FloatArray]:
    """The states (4, n) of every run at its rows alone, NaN from where it switches without end:
    `simulate` where nothing else is asked."""
    check_known(models, averaged=False)
    found = _simulated(inputs, in_their_tests(inputs, models), (), max_step, nan_if_endless=True)
    return [own for own, _ in found]


def remembered_after(
    inputs: Sequence[Inputs], runs: Sequence[Trajectory], models: Sequence[Model]
) -> list[dict[str, float]]:
    """The excess of the effects' states at each run's last row over those with which they would
    begin there, for the `remembered` of a run that goes on from it.

    `runs` as simulated from the `inputs`. Nothing of one that does not stay finite.
    """
    names = models[0].state_names if models else ()
    if not names:
        return [{} for _ in inputs]
    last = [
        dataclasses.replace(
            one,
            **dict(zip(STATE, map(float, run.states[:, -1]), strict=True)),  # type: ignore[arg-type]
            motor=np.asarray(one.motor)[-1:],
            elapsed=one.elapsed + float(np.ptp(one.time)),
            remembered={},
        )
        for one, run in zip(inputs, runs, strict=True)
    ]
    begun = np.array(start_lanes(last, stack_models(in_their_tests(inputs, models))).extra)
    beyond = np.array([run.extra for run in runs]) - begun.T
    return [
        dict(zip(names, own.tolist(), strict=True)) if np.isfinite(own).all() else {}
        for own in beyond
    ]


def _simulated_between(
    inputs: Sequence[Inputs], models: Sequence[Model], max_step: float, nan_if_endless: bool
) -> list[Trajectory]:
    """Every run, also at its steps between the rows."""
    shared = Shared()
    closer = [with_edges(i, m, max_step, shared) for i, m in zip(inputs, models, strict=True)]
    found = _simulated([i for i, _ in closer], models, (), max_step, nan_if_endless)
    return [
        Trajectory(
            np.asarray(one.time),
            *own[:, rows],
            between=Between(given.time, own, rows),
            extra=extra,
        )
        for one, (own, extra), (given, rows) in zip(inputs, found, closer, strict=True)
    ]


def _simulated(
    inputs: Sequence[Inputs],
    models: Sequence[Model],
    surfaces: tuple[Any, ...],
    max_step: float,
    nan_if_endless: bool,
) -> list[tuple[FloatArray, FloatArray]]:
    """(4, samples) of every run, and the effects' states (k,) at its last row."""
    pairs = list(zip(inputs, models, strict=True))
    # Not by the number of cores: the last digits depend on the width.
    width = next((w for w in _WIDTHS if w >= len(pairs)), _WIDTHS[-1])
    # Runs of similar length go together: in a block the short ones wait for the longest.
    order = sorted(range(len(pairs)), key=lambda i: len(pairs[i][0].time))
    blocks = [order[i : i + width] for i in range(0, len(order), width)]

    begun = _Begun.of(list(inputs), list(models), surfaces)
    shared = Shared()

    def block(members: list[int]) -> tuple[list[FloatArray], FloatArray]:
        own, of_own = (list(of) for of in zip(*(pairs[i] for i in members), strict=True))
        check_commands(own)
        runs = prepare(own, of_own, surfaces, max_step, shared)
        return _advance_block(
            block_of(runs, width, _ROWS_A_CALL, max_step),
            begun,
            members,
            [len(one.time) for one in own],
            nan_if_endless,
        )

    results = in_threads(block, blocks)
    found = {
        i: (own, last)
        for members, (states, extra) in zip(blocks, results, strict=True)
        for i, own, last in zip(members, states, extra.T, strict=False)
    }
    return [found[i] for i in range(len(pairs))]


__all__ = [
    "MAX_STEP",
    "Inputs",
    "Trajectory",
    "ValveCommand",
    "open_intervals",
    "remembered_after",
    "simulate",
    "simulate_states",
]
