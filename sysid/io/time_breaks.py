"""Why a time goes back: a counter that wraps, a recording that starts again, rows out of order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.io.trust.wraps import COUNTER_BITS, LARGER
from sysid.types import FloatArray, IntArray

# (size in s, name) of the counters that loggers count time with.
_CLOCKS = (
    *(
        (2.0**bits * unit, f"a {bits}-bit counter of {name}")
        for bits, unit, name in (
            (32, 1e-6, "microseconds"),
            (32, 1e-3, "milliseconds"),
            (32, 1e-9, "nanoseconds"),
            (24, 1e-6, "microseconds"),
            (16, 1e-3, "milliseconds"),
            (16, 1e-6, "microseconds"),
        )
    ),
    (86400.0, "the time of day"),
)
# Recordings of a round length end where these do, and start again where the first one started.
_PARTS = (
    (604800.0, "the second of a week"),
    (43200.0, "a clock of twelve hours"),
    (3600.0, "the second of an hour"),
    (60.0, "the second of a minute"),
    (1.0, "the fraction of a second"),
)
# Counts beyond these bits are not exact in a double.
_MOST_BITS = np.finfo(float).nmant + 1
_FEWEST_BITS = 8
# Share of the median step: decimals of seconds are rounded.
_ROUNDED = 0.5
ROUNDING = 1e-6
"""Share of a period within which time stamps are the same."""


@dataclass(frozen=True)
class TimeWraps:
    """A counter that wraps: its size in the column's unit, its name, and the rows after wraps."""

    size: float
    name: str
    rows: IntArray

    def unwrapped(self, values: FloatArray) -> FloatArray:
        """The counter (n,) as one that has no end."""
        turns = np.zeros(len(values))
        turns[self.rows] = self.size
        return np.asarray(values + np.cumsum(turns))


def without_own_time(count: int) -> str:
    """What `count` rows that have the time of the row before are called, at the first of them."""
    if count == 1:
        return "a row without a time of its own"
    return f"the first of {count} rows without a time of their own"


def wraps_of(values: FloatArray) -> TimeWraps | None:
    """The wraps of a column of counts (n,), whole numbers of whatever unit; None without wraps.

    A wrap reaches the counter's size, and the step over it, modulo that size, is an ordinary one.
    """
    if not np.all(values == np.floor(values)):
        return None
    low, high = float(np.min(values)), float(np.max(values))
    for bits in range(_MOST_BITS, _FEWEST_BITS - 1, -1):
        size = 2.0**bits
        least = -size / 2 if low < 0 else 0.0
        if low >= least and high < least + size:
            rows = _over(values, size, 0.0)
            if rows.size and (bits in COUNTER_BITS or not _begin_alike(values, size, rows)):
                return TimeWraps(size, f"a {bits}-bit counter", rows)
    return None


def wraps_of_seconds(time: FloatArray) -> TimeWraps | None:
    """The wraps of times (n,) s that a counter of a common unit made; None without wraps."""
    if len(time) < 3 or np.all(np.diff(time) >= 0.0):
        return None
    for size, clock in _CLOCKS + _PARTS:
        if np.ptp(time) < size:
            rows = _over(time, size, _ROUNDED)
            is_part = (size, clock) in _PARTS
            if rows.size and not (is_part and _begin_alike(time, size, rows)):
                return TimeWraps(size, clock, rows)
    return None


def _begin_alike(values: FloatArray, size: float, rows: IntArray) -> bool:
    """Whether what follows a step back begins where the first value does, as recordings of one
    length do that start again: 60 s, or 1024 samples.

    A counter may do so too, where it began near nothing; but each step over a wrap is then as the
    others are, within their scatter, and what follows lies elsewhere by more than that.
    """
    steps = np.diff(values)
    forward = steps[steps > 0.0]
    usual = float(np.median(forward))
    scatter = float(np.percentile(np.abs(forward - usual), 95.0)) + ROUNDING * usual
    apart = np.abs(values[rows] - values[0])
    goes_on = np.all(np.abs(steps[rows - 1] + size - usual) <= scatter)
    if goes_on and np.any(apart > scatter):
        return False
    return bool(np.any(apart <= usual))


def _over(values: FloatArray, size: float, slack: float) -> IntArray:
    """The rows after steps back that are ordinary steps modulo `size`; `slack` of a step below."""
    steps = np.diff(values)
    forward = steps[steps > 0.0]
    # A single wrong value goes back, and forward again.
    if not forward.size or np.max(forward) > size / 2:
        return np.zeros(0, dtype=np.intp)
    usual = float(np.median(forward))
    # The share of steps up to which a step over a wrap is an ordinary one.
    most = max(LARGER * usual, float(np.percentile(forward, 90.0)))
    over = steps + size
    return np.flatnonzero((steps < 0.0) & (over <= most) & (over > -slack * usual)) + 1


@dataclass(frozen=True)
class TimeBreaks:
    """The rows at which a time starts again, or else the first row that is out of order."""

    starts: IntArray
    disordered: int | None = None


def time_breaks(time: FloatArray) -> TimeBreaks:
    """Where times (n,) s go back, and whether a recording starts again there.

    It does where the rows before and after are two recordings: sorted by time they would mix.
    Single rows, or a block of rows, that sorting would put in their place are out of order.
    """
    back = np.flatnonzero(np.diff(time) < 0.0) + 1
    bounds = [0, *back.tolist(), len(time)]
    for number in range(1, len(bounds) - 1):
        first, middle, last = bounds[number - 1 : number + 2]
        if not _starts_again(time[first:middle], time[middle:last]):
            return TimeBreaks(np.zeros(0, dtype=np.intp), middle)
    return TimeBreaks(back)


def _starts_again(before: FloatArray, after: FloatArray) -> bool:
    """Whether times (n,) and (m,) s, each rising, are of two recordings."""
    both = after[after <= before[-1]]
    if len(before) < 2 or len(both) < 2:
        return False
    if after[0] <= before[0]:
        return True
    mixed = before[np.searchsorted(before, after[0]) :]
    places = np.searchsorted(mixed, both)
    return len(np.unique(places)) > 1


__all__ = [
    "ROUNDING",
    "TimeBreaks",
    "TimeWraps",
    "time_breaks",
    "without_own_time",
    "wraps_of",
    "wraps_of_seconds",
]
