"""When a valve is really open: commands, PWM periods, delays, overtaking edges.

`docs/reference/log-format.md`, "What the samples mean". numpy only. All times in s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.types import BoolArray, FloatArray, IntArray

DelayPort = Callable[[FloatArray, FloatArray, bool], FloatArray]

TIME_TOLERANCE = 1e-9
"""Times closer than this, s, are one: a log's decimal times and a PWM grid differ by rounding."""

WHOLE_STEP = 1.0 - 1e-6
"""A sub-step is split where this share of it is longer than the longest step."""


@dataclass(frozen=True)
class OpenIntervals:
    """A valve is open in [opens[i], closes[i]); sorted, disjoint, of positive length."""

    opens: FloatArray
    closes: FloatArray

    def open_time(self, starts: FloatArray, ends: FloatArray) -> FloatArray:
        """Time open within each [starts, ends], s; exact."""
        return self._cumulative(ends) - self._cumulative(starts)

    def open_fraction(self, starts: FloatArray, ends: FloatArray) -> FloatArray:
        """Share of each [starts, ends] in which the valve is open, 0 to 1."""
        return self.open_time(starts, ends) / (ends - starts)

    def between(self, bounds: FloatArray) -> FloatArray:
        """Time open between each two of the rising `bounds` (n + 1,), (n,) s; exact."""
        # Pulses are fewer than bounds: they are searched for, not the bounds.
        begun = np.searchsorted(bounds, self.opens)
        count = np.cumsum(np.bincount(begun, minlength=len(bounds) + 1)[: len(bounds)])
        return np.diff(self._open_before(bounds, count))

    def is_open(self, times: FloatArray) -> BoolArray:
        """Whether the valve is open just after each time."""
        opened = np.searchsorted(self.opens, times, side="right")
        closed = np.searchsorted(self.closes, times, side="right")
        return opened > closed

    def _cumulative(self, times: FloatArray) -> FloatArray:
        return self._open_before(times, np.searchsorted(self.opens, times, side="right"))

    def _open_before(self, times: FloatArray, count: NDArray[np.intp]) -> FloatArray:
        """Time open before each of `times`, at which `count` intervals have begun."""
        if len(self.opens) == 0:
            return np.zeros_like(times)
        total = np.concatenate(([0.0], np.cumsum(self.closes - self.opens)))
        before = np.maximum(count - 1, 0)
        running = np.minimum(times, self.closes[before]) - self.opens[before]
        return np.where(count > 0, total[before] + running, 0.0)


def switched_intervals(
    time: FloatArray, command: FloatArray, starts_on: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Commanded on-intervals of an on/off column; a command holds from its row to the next.

    Before the first row the valve is off (`starts_on`: on). An interval that is on in the
    last row ends at infinity; one that was on before starts at minus infinity.
    """
    on = np.concatenate(([starts_on], command > 0.5))
    change = np.flatnonzero(on[1:] != on[:-1])
    edges = time[change]
    rising = on[1:][change]
    opens, closes = edges[rising], edges[~rising]
    if starts_on:
        opens = np.concatenate(([-np.inf], opens))
    if on[-1]:
        closes = np.concatenate((closes, [np.inf]))
    return opens, closes


def period_duties(
    time: FloatArray, duty: FloatArray, period: float
) -> tuple[FloatArray, FloatArray]:
    """Start of every PWM period and the duty in force then, which holds for the period."""
    starts, row = period_starts(time, period)
    return starts, np.minimum(np.maximum(duty[row], 0.0), 1.0)


def period_starts(time: FloatArray, period: float) -> tuple[FloatArray, NDArray[np.intp]]:
    """Start of every PWM period and the row in force then."""
    span = time[-1] - time[0]
    count = int(np.floor((span + TIME_TOLERANCE) / period)) + 1
    starts = time[0] + np.arange(count) * period
    return starts, _rows_before(time, starts + TIME_TOLERANCE) - 1


def _rows_before(time: FloatArray, at: FloatArray) -> NDArray[np.intp]:
    """How many rows lie at or before each time: searchsorted, at once where rows are even."""
    n = len(time)
    guess = np.floor((at - time[0]) * ((n - 1) / (time[-1] - time[0])))
    row = np.minimum(np.maximum(guess, 0.0), n - 2.0).astype(np.intp)
    right = (time[row] <= at) & (at < time[row + 1])
    found: NDArray[np.intp] = row + 1
    if right.all():
        return found
    found[~right] = np.searchsorted(time, at[~right], side="right")
    return found


def pwm_intervals(
    time: FloatArray, duty: FloatArray, period: float, starts_on: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Commanded on-intervals of a duty column: on for duty * period from each period's start.

    Periods start at multiples of `period` from the first row. `starts_on` as in
    switched_intervals.
    """
    return duty_intervals(*period_duties(time, duty, period), period, starts_on)


def duty_intervals(
    starts: FloatArray, held: FloatArray, period: float, starts_on: bool = False
) -> tuple[FloatArray, FloatArray]:
    """pwm_intervals of the duty held in each period, from its start."""
    # The last period is not cut: what it would do after the last row is not simulated.
    ends = starts + held * period
    on = held > 0.0
    opens, closes = (starts, ends) if on.all() else (starts[on], ends[on])
    if starts_on:
        opens = np.concatenate(([-np.inf], opens))
        closes = np.concatenate((starts[:1], closes))
    return _without_gaps(opens, closes, np.array([0, len(opens)]))[:2]


def joined_duty_intervals(
    starts: FloatArray, held: FloatArray, period: FloatArray, bounds: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """duty_intervals of several commands one after the other, each between two of `bounds`.

    `starts`, `held`, `period` (n,): of every period. Returns the intervals with their bounds.
    """
    on = held > 0.0
    ends = starts + held * period
    if not on.all():
        starts, ends, bounds = _only(on, bounds, starts, ends)
    return _without_gaps(starts, ends, bounds)


def _only(kept: BoolArray, bounds: IntArray, *joined: FloatArray) -> list[Any]:
    """What is kept (n,) of joined sequences, each between two of `bounds`; and the bounds in it."""
    at = np.flatnonzero(kept)
    return [*(one.take(at) for one in joined), at.searchsorted(bounds)]


def _without_gaps(
    opens: FloatArray, closes: FloatArray, bounds: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Joined intervals, those that follow at once made one; with their bounds."""
    gap = np.ones(len(opens) + 1, dtype=bool)
    gap[1:-1] = opens[1:] - closes[:-1] > TIME_TOLERANCE
    gap[bounds] = True
    if gap.all():
        return opens, closes, bounds
    opens, bounds = _only(gap[:-1], bounds, opens)
    return opens, closes[gap[1:]], bounds


def delayed(
    opens: FloatArray,
    closes: FloatArray,
    on_delay: float,
    off_delay: float,
    port: DelayPort | None = None,
) -> OpenIntervals:
    """When the valve is open, from the commanded on-intervals.

    An edge takes effect after its delay; an edge that overtakes the one before it cancels
    it, and itself (the state stays). `port` may change the delay of every edge.
    """
    edges = delayed_edges(opens, closes, on_delay, off_delay, port)
    return OpenIntervals(edges[0::2].copy(), edges[1::2].copy())


def delayed_edges(
    opens: FloatArray,
    closes: FloatArray,
    on_delay: float,
    off_delay: float,
    port: DelayPort | None = None,
) -> FloatArray:
    """The edges of `delayed` in order: the valve is open after an odd number of them."""
    later: tuple[FloatArray | float, FloatArray | float] = on_delay, off_delay
    if port is not None:
        later = (
            port(np.full(len(opens), on_delay), opens, True),
            port(np.full(len(closes), off_delay), closes, False),
        )
    return joined_delayed_edges(opens, closes, *later, np.array([0, len(opens)]))[0]


def joined_delayed_edges(
    opens: FloatArray,
    closes: FloatArray,
    on_delay: FloatArray | float,
    off_delay: FloatArray | float,
    bounds: IntArray,
) -> tuple[FloatArray, IntArray]:
    """delayed_edges of several commands one after the other, each between two of `bounds`.

    Delays of all or of each (n,), s. Returns the edges with their bounds.
    """
    edges = np.empty(2 * len(opens))
    edges[0::2], edges[1::2] = opens + on_delay, closes + off_delay
    bounds = 2 * bounds
    while True:
        overtaken = np.zeros(len(edges) + 1, dtype=bool)  # each edge by the one before it
        overtaken[1:-1] = edges[1:] - edges[:-1] <= TIME_TOLERANCE
        overtaken[bounds] = False
        if not overtaken.any():
            return edges, bounds
        # In a run of overtaken edges the first pair cancels; the remaining ones are checked again.
        first = overtaken[1:] & ~overtaken[:-1]
        kept = ~first
        kept[1:] &= ~first[:-1]
        edges, bounds = _only(kept, bounds, edges)


@dataclass(frozen=True)
class Grid:
    """Sub-steps between which a run has an edge, a sample or (averaged) a period's start.

    `duration` (n,) s; `row` (n,) the log row in force; `ends_sample` (n,) whether a sample
    lies at the sub-step's end; `start` (n,) s since the first row.
    """

    start: FloatArray
    duration: FloatArray
    row: NDArray[np.intp]
    ends_sample: BoolArray


def split_at(time: FloatArray, edges: FloatArray, max_step: float) -> Grid:
    """Sub-steps of a log's samples, split at the edges and so that none exceeds max_step.

    An edge within the tolerance of a sample, or of another edge, counts as there.
    """
    edges = np.clip(edges, time[0] - 1.0, time[-1] + 1.0)  # some lie at infinity
    edge = np.sort(edges, kind="stable")  # a few sorted runs: merged, not sorted
    before = np.where(
        edge <= time[0] + TIME_TOLERANCE, 0, _rows_before(time, edge - TIME_TOLERANCE)
    )
    inside = before < len(time)
    on_sample = before == 0  # or before the first row
    on_sample[inside] |= time[before[inside]] - edge[inside] <= TIME_TOLERANCE
    apart = np.concatenate(([True], np.diff(edge) > TIME_TOLERANCE))[: len(edge)]
    kept = inside & ~on_sample & apart
    # Merge two sorted arrays by position, which is several times faster than sorting.
    place = before[kept] + np.arange(int(kept.sum()))
    points = np.empty(len(time) + len(place))
    is_sample = np.ones(len(points), dtype=bool)
    is_sample[place] = False
    points[place] = edge[kept]
    points[is_sample] = time
    row = np.cumsum(is_sample[:-1]) - 1
    grid = Grid(points[:-1] - time[0], np.diff(points), row, is_sample[1:])
    return _no_longer_than(grid, max_step)


def _no_longer_than(grid: Grid, max_step: float) -> Grid:
    if grid.duration.max() <= max_step * (1.0 + 1e-6):
        return grid
    parts = np.maximum(np.ceil(grid.duration / max_step * WHOLE_STEP).astype(np.intp), 1)
    owner = np.repeat(np.arange(len(parts)), parts)
    last = np.cumsum(parts)
    first = np.concatenate(([0], last))
    within = np.arange(len(owner)) - first[owner]
    duration = (grid.duration / parts)[owner]
    ends = np.zeros(len(owner), dtype=bool)
    ends[last - 1] = grid.ends_sample
    start = grid.start[owner] + within * duration
    return Grid(start, duration, grid.row[owner], ends)
