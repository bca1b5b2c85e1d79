"""A run's inputs, and the sub-steps and commands that the simulation of it needs; numpy only."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from sysid.io.channels import SIDES
from sysid.io.rig import NO_LOAD, Load
from sysid.plant import plant, valve_timing
from sysid.plant.ports import Model, overrides
from sysid.plant.pulse_means import pulse_means
from sysid.types import FloatArray, IntArray

_T = TypeVar("_T")
_Key = tuple[Any, ...]


@dataclass(frozen=True)
class ValveCommand:
    """One valve's command over a run: on/off or, if `is_duty`, the PWM duty.

    `values` (n,): 0 or 1, or 0 to 1. `starts_on`: the valve was on before the first row.
    """

    values: FloatArray
    is_duty: bool = False
    starts_on: bool = False


@dataclass(frozen=True)
class History:
    """What sensors that remember saw before a run: `time` (m,) s from its first row, negative, and
    `states` (4, m) as a `Trajectory` has them; `end` (4,) at that row.
    """

    time: FloatArray
    states: FloatArray
    end: FloatArray


@dataclass(frozen=True)
class Inputs:
    """One run: rows as in a log. `time` (n,) s increasing; `motor` (n,) Nm or N.

    A valve that is None stays off. The state at the first row: rad or m, rad/s or m/s, Pa;
    a pressure that is None is the atmosphere. `elapsed`: s from the test's start to the first
    row, as effects count time from the test's start, and a run may start within it. `remembered`:
    what the effects' states have there beyond those with which they begin, by name and in their
    units; 0 for one that is not given. `seen`: what its sensors saw before; None: the first row.
    `load`: what is carried beyond the model's own payload. `supply`: the line's pressure in this
    run, Pa; None: the model's.
    """

    time: FloatArray
    motor: FloatArray
    valve_a: ValveCommand | None = None
    valve_b: ValveCommand | None = None
    position: float = 0.0
    velocity: float = 0.0
    pressure_a: float | None = None
    pressure_b: float | None = None
    elapsed: float = 0.0
    remembered: Mapping[str, float] = field(default_factory=dict)
    seen: History | None = None
    load: Load = NO_LOAD
    supply: float | None = None

    def valve(self, side: str) -> ValveCommand | None:
        """Valve A's or B's command."""
        return self.valve_a if side == "a" else self.valve_b


@dataclass(frozen=True)
class SwitchedRun:
    """One run under the on/off law: its rows, and the edges that turn its valves.

    `edges`: of A and B, increasing times in s, after an odd number of which the valve is open.
    """

    time: FloatArray
    motor: FloatArray
    edges: tuple[FloatArray, FloatArray]

    @property
    def timing(self) -> tuple[FloatArray, ...]:
        """What moves with the valves' delays: the edges."""
        return self.edges

    def __len__(self) -> int:
        return len(self.time) - 1


@dataclass
class PreparedRun:
    """One run prepared for mean flows: its sub-steps and commands on them.

    `ripple`, of mean-flow models that know of the pulses: by valve, at the sub-steps' starts,
    their ends, and its mean over the period (see `pulse_means`).
    """

    grid: valve_timing.Grid
    motor: FloatArray
    opens: dict[str, FloatArray]
    ripple: tuple[FloatArray, ...] = ()

    @property
    def timing(self) -> tuple[FloatArray, ...]:
        """What moves with the valves' delays: the durations."""
        return (self.grid.duration,)

    def __len__(self) -> int:
        return len(self.motor)


class Shared:
    """What runs of a batch have in common, computed once, by the identity of their arrays."""

    def __init__(self) -> None:
        self._known: dict[_Key, tuple[Any, tuple[Any, ...]]] = {}
        # Arrays by what is soon seen of them, and those that were found to hold the same.
        self._first: dict[tuple[Any, ...], FloatArray] = {}
        self._like: dict[int, tuple[FloatArray, FloatArray]] = {}

    def __reduce__(self) -> tuple[type[Shared], tuple[()]]:
        return Shared, ()  # an identity means nothing in another process

    def once(self, arrays: tuple[Any, ...], numbers: tuple[Any, ...], make: Callable[[], _T]) -> _T:
        """make(), or what it made before of the same arrays (the objects) and numbers."""
        key = self.key(arrays, numbers)
        if key not in self._known:
            self.keep(arrays, numbers, make())
        found: _T = self[key]
        return found

    @staticmethod
    def key(arrays: tuple[Any, ...], numbers: tuple[Any, ...]) -> _Key:
        """Under which it is known what was made of the arrays (the objects) and numbers."""
        return (*map(id, arrays), *numbers)

    def keep(self, arrays: tuple[Any, ...], numbers: tuple[Any, ...], made: Any) -> None:
        """Know what was made."""
        # The arrays are kept: an id is theirs while they live.
        self._known[self.key(arrays, numbers)] = made, arrays

    def __contains__(self, key: _Key) -> bool:
        return key in self._known

    def __getitem__(self, key: _Key) -> Any:
        return self._known[key][0]

    def like(self, array: FloatArray) -> FloatArray:
        """The array (n,) itself, or the first that was seen to hold the same."""
        known = self._like.get(id(array))
        if known is None:
            seen = (len(array), *(float(array[i]) for i in (0, len(array) // 2, -1)))
            first = self._first.setdefault(seen, array)
            same = first is array or np.array_equal(first, array)
            known = self._like[id(array)] = (first if same else array), array
        return known[0]


def open_intervals(
    inputs: Inputs,
    side: str,
    model: Model,
    delays: tuple[float, float] | None = None,
    shared: Shared | None = None,
) -> valve_timing.OpenIntervals:
    """When a valve is really open, through the timing ports of the model's effects.

    `delays` of opening and closing, s, in place of the model's; `shared` as in `prepare`.
    """
    asked = inputs, side, model, delays or _delays(side, model)
    (edges,) = _edges([asked], shared or Shared())
    return valve_timing.OpenIntervals(edges[0::2].copy(), edges[1::2].copy())


_Asked = tuple[Inputs, str, Model, tuple[float, float]]
"""A run's valve, its model, and the delays of opening and closing, s."""


def _edges(asked: Sequence[_Asked], shared: Shared) -> list[FloatArray]:
    """Each valve's edges in order, s: it is open after an odd number of them.

    Those that no effect changes are worked out in one go.
    """
    found: dict[int, FloatArray] = {}
    keys: list[_Key | None] = []
    waiting: dict[_Key, tuple[_Command, tuple[float, float]]] = {}
    commands: dict[_Key, _Command] = {}
    changes = {id(model): model for _, _, model, _ in asked}
    changing = {key for key, model in changes.items() if _changes_edges(model)}
    for i, (inputs, side, model, delays) in enumerate(asked):
        values, key = inputs.valve(side), None
        if values is None:
            found[i] = np.zeros(0)
        else:
            numbers, time = _numbers(values, model), shared.like(inputs.time)
            command = _Command((time, values.values), numbers)
            if id(model) in changing:
                found[i] = _changed(command, asked[i], shared)
            else:
                key = shared.key(command.arrays, (*numbers, *delays))
                if key not in shared:
                    waiting[key] = command, delays
                    commands[shared.key(*command)] = command
        keys.append(key)
    if waiting:
        new = [c for key, c in commands.items() if key not in shared]
        for command, intervals in zip(new, _commanded(new, shared), strict=True):
            shared.keep(*command, intervals)
        _delay(list(waiting.values()), shared)
    return [found[i] if key is None else shared[key] for i, key in enumerate(keys)]


class _Command(NamedTuple):
    """A valve's command: its `arrays`, times (n,) s and values (n,), and the `numbers` on which
    its on-intervals depend next to these: whether it is a duty, on before, s of a period.
    """

    arrays: tuple[FloatArray, FloatArray]
    numbers: tuple[bool, bool, float]


def _delay(waiting: Sequence[tuple[_Command, tuple[float, float]]], shared: Shared) -> None:
    """Have `shared` keep the edges of commands after their delays."""
    intervals = [shared[shared.key(*command)] for command, _ in waiting]
    counts = [len(on) for on, _ in intervals]
    bounds = np.concatenate(([0], np.cumsum(counts)))
    on, off = (np.concatenate(one) for one in zip(*intervals, strict=True))
    on_delay, off_delay = np.repeat([delays for _, delays in waiting], counts, axis=0).T
    edges, bounds = valve_timing.joined_delayed_edges(on, off, on_delay, off_delay, bounds)
    for (command, delays), own in zip(waiting, _cut(edges, bounds), strict=True):
        shared.keep(command.arrays, (*command.numbers, *delays), own)


def _cut(joined: FloatArray, bounds: IntArray) -> list[FloatArray]:
    """Joined sequences apart: views."""
    ends = bounds.tolist()
    return [joined[a:b] for a, b in itertools.pairwise(ends)]


def _changed(command: _Command, asked: _Asked, shared: Shared) -> FloatArray:
    """A command's edges through the timing ports of the effects."""
    inputs, side, model, delays = asked
    on, off = shared.once(*command, lambda: _commanded([command], shared)[0])
    for effect in model.effects:
        on, off = effect.pulses(on, off, side)

    def port(delays: FloatArray, times: FloatArray, opening: bool) -> FloatArray:
        return _through_delays(delays, times, opening, side, inputs, model)

    return valve_timing.delayed_edges(on, off, *delays, port)


def _numbers(command: ValveCommand, model: Model) -> tuple[bool, bool, float]:
    """What a command's on-intervals depend on, next to its arrays."""
    return command.is_duty, command.starts_on, float(model.parameters.pwm_period)


def _changes_edges(model: Model) -> bool:
    return any(overrides(effect, "pulses", "delays") for effect in model.effects)


def _commanded(commands: Sequence[_Command], shared: Shared) -> list[tuple[FloatArray, FloatArray]]:
    """Commanded on-intervals: start and end, s, of each command. Those of duties in one go."""
    found: dict[int, tuple[FloatArray, FloatArray]] = {}
    duties, held, starts, periods = [], [], [], []
    for i, ((time, values), (is_duty, starts_on, period)) in enumerate(commands):
        if not is_duty:
            found[i] = valve_timing.switched_intervals(time, values, starts_on)
            continue
        begins, row = _periods(time, period, shared)
        if starts_on or values.dtype != np.float64:
            own = np.minimum(np.maximum(values[row], 0.0), 1.0)
            found[i] = valve_timing.duty_intervals(begins, own, period, starts_on)
            continue
        duties.append(i)
        starts.append(begins)
        held.append(values[row])
        periods.append(period)
    if duties:
        counts = [len(one) for one in starts]
        bounds = np.concatenate(([0], np.cumsum(counts)))
        on, off, bounds = valve_timing.joined_duty_intervals(
            np.concatenate(starts),
            np.minimum(np.maximum(np.concatenate(held), 0.0), 1.0),
            np.repeat(periods, counts),
            bounds,
        )
        found |= zip(duties, zip(_cut(on, bounds), _cut(off, bounds), strict=True), strict=True)
    return [found[i] for i in range(len(commands))]


def _periods(time: FloatArray, period: float, shared: Shared) -> tuple[FloatArray, IntArray]:
    return shared.once((time,), (period,), lambda: valve_timing.period_starts(time, period))


def _delays(side: str, model: Model) -> tuple[float, float]:
    p = model.parameters
    return float(getattr(p, f"on_delay_{side}")), float(getattr(p, f"off_delay_{side}"))


def _through_delays(
    delays: FloatArray, times: FloatArray, opening: bool, side: str, inputs: Inputs, model: Model
) -> FloatArray:
    """Delays (n,) of edges at `times` (n,) through the effects' ports, s."""
    since = times - inputs.time[0] + inputs.elapsed
    for effect in model.effects:
        delays = effect.delays(delays, since, opening, side)
    return delays


def prepare(
    inputs: Sequence[Inputs],
    models: Sequence[Model],
    surfaces: tuple[Any, ...],
    max_step: float,
    shared: Shared | None = None,
) -> Sequence[PreparedRun | SwitchedRun]:
    """Runs' rows and edges (the on/off law) or, with `surfaces`, sub-steps and mean commands.

    `shared`: of the runs prepared with it, what they have in common is worked out once.
    """
    pairs = list(zip(inputs, models, strict=True))
    if surfaces and plant.knows_pulses(surfaces):
        return [_prepare_pulsed(*pair, surfaces, max_step) for pair in pairs]
    if surfaces:
        return [_prepare_averaged(*pair, max_step) for pair in pairs]
    known = shared or Shared()
    asked = [(i, side, m, _delays(side, m)) for i, m in pairs for side in SIDES]
    edges = _edges(asked, known)
    return [
        SwitchedRun(known.like(np.asarray(one.time, dtype=float)), np.asarray(one.motor), (a, b))
        for one, a, b in zip(inputs, edges[0::2], edges[1::2], strict=True)
    ]


def with_edges(
    inputs: Inputs, model: Model, max_step: float, shared: Shared | None = None
) -> tuple[Inputs, IntArray]:
    """A run with rows also at its valves' edges, none further apart than `max_step` s; and which
    of its rows (n,) are the run's own. The commands are held between these; `shared` as in
    `prepare`.
    """
    known = shared or Shared()
    edges = _edges([(inputs, side, model, _delays(side, model)) for side in SIDES], known)
    time = np.asarray(inputs.time, dtype=float)
    grid = valve_timing.split_at(time, np.concatenate(edges), max_step)
    rows = np.concatenate(([0], np.flatnonzero(grid.ends_sample) + 1))
    closer = np.append(grid.start + time[0], time[-1])
    closer[rows] = time
    held = np.append(grid.row, len(time) - 1)
    valve_a, valve_b = (
        None if command is None else replace(command, values=np.asarray(command.values)[held])
        for command in (inputs.valve_a, inputs.valve_b)
    )
    motor = np.asarray(inputs.motor)[held]
    return replace(inputs, time=closer, motor=motor, valve_a=valve_a, valve_b=valve_b), rows


def _prepare_averaged(inputs: Inputs, model: Model, max_step: float) -> PreparedRun:
    """Sub-steps for an averaged valve model: split where a PWM period starts, not at edges."""
    time = np.asarray(inputs.time, dtype=float)
    period = float(model.parameters.pwm_period)
    starts = valve_timing.period_duties(time, np.zeros_like(time), period)[0]
    grid = valve_timing.split_at(time, starts, max_step)
    after = grid.start + time[0] + valve_timing.TIME_TOLERANCE
    opens = {}
    for side in SIDES:
        command = inputs.valve(side)
        if command is None:
            opens[side] = np.zeros(len(grid.start))
        elif command.is_duty:
            held = valve_timing.period_duties(time, command.values, period)[1]
            opens[side] = held[np.searchsorted(starts, after) - 1]
        else:
            opens[side] = np.asarray(command.values, dtype=float)[grid.row]
    return PreparedRun(grid, np.asarray(inputs.motor, dtype=float)[grid.row], opens)


def _prepare_pulsed(
    inputs: Inputs, model: Model, surfaces: tuple[Any, ...], max_step: float
) -> PreparedRun:
    """Sub-steps for mean flows that know of the pulses: split at these and at the periods.

    A period's mean flow begins when its pulse can, a switch-on delay after the command's.
    """
    time = np.asarray(inputs.time, dtype=float)
    period = float(model.parameters.pwm_period)
    starts = valve_timing.period_duties(time, np.zeros_like(time), period)[0]
    intervals, begins = {}, {}
    for side, surface in zip(SIDES, surfaces, strict=True):
        delays = plant.own_delays(surface) or _delays(side, model)
        intervals[side] = open_intervals(inputs, side, model, delays)
        on = np.full(len(starts), delays[0])
        late = _through_delays(on, starts, True, side, inputs, model)
        begins[side] = np.maximum.accumulate(starts + late)
    edges = [e for s in SIDES for e in (intervals[s].opens, intervals[s].closes, begins[s])]
    grid = valve_timing.split_at(time, np.concatenate(edges), max_step)
    opens, ripple = {}, []
    for side, surface in zip(SIDES, surfaces, strict=True):
        last = float(begins[side][-1]) + period
        means = pulse_means(
            begins[side], intervals[side], grid.start + time[0], grid.duration, last
        )
        ripple += [means.ripple_start, means.ripple_end, means.ripple_mean]
        opens[side] = means.share
        command = inputs.valve(side)
        if not plant.takes_shares(surface) and command is not None and command.is_duty:
            held = valve_timing.period_duties(time, command.values, period)[1]
            held = np.concatenate(([means.share[0]], held))
            opens[side] = held[means.period + 1]
    motor = np.asarray(inputs.motor, dtype=float)[grid.row]
    return PreparedRun(grid, motor, opens, tuple(ripple))


__all__ = [
    "Inputs",
    "PreparedRun",
    "Shared",
    "SwitchedRun",
    "ValveCommand",
    "open_intervals",
    "prepare",
    "with_edges",
]
