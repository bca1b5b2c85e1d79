"""Signals sampled on separate clocks, brought to the rows of one clock.

One way for the files of `sysid convert --join`, for columns that are empty in the rows between
their own, and for channels that a file samples at different instants: measured signals lie on the
line between their own samples, commands hold from one to the next.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid import signals
from sysid.io.channels import TEST_COLUMN
from sysid.io.reshaping import median_period
from sysid.io.time_breaks import ROUNDING
from sysid.types import BoolArray, FloatArray, IntArray

FILLS = ("hold", "linear")
# Samples that show a rate.
_FEWEST = 3


def is_held(target: str, fill: str | None, held: Sequence[str]) -> bool:
    """Whether a column of the log holds from sample to sample: those of `held` do, and all or none
    where `fill` says so."""
    if target == TEST_COLUMN:
        return True
    return target in held if fill is None else fill == "hold"


def values_at(grid: FloatArray, clock: FloatArray, values: FloatArray, held: bool) -> FloatArray:
    """`values` (n,) sampled at `clock` (n,) s, taken at `grid` (m,) s: held, or linear between."""
    if not held:
        return np.asarray(np.interp(grid, clock, values), dtype=float)
    return np.asarray(values[rows_held(grid, clock)])


def rows_held(grid: FloatArray, clock: FloatArray) -> IntArray:
    """The sample of `clock` (n,) s in force at each of `grid` (m,) s; at least the first."""
    # Clocks that differ by a shift agree but for its rounding.
    rounding = ROUNDING * median_period(clock)
    return np.maximum(np.searchsorted(clock, grid + rounding, side="right") - 1, 0)


def within(grid: FloatArray, clock: FloatArray) -> BoolArray:
    """Which of `grid` (m,) s lie between the first and the last sample of `clock` (n,) s."""
    rounding = ROUNDING * median_period(clock)
    return np.asarray((grid >= clock[0] - rounding) & (grid <= clock[-1] + rounding))


def has_value(grid: FloatArray, clock: FloatArray, held: bool) -> BoolArray:
    """Where a signal sampled at `clock` (n,) s has a value among `grid` (m,) s.

    A measured one has none in a pause of its own; a command holds beyond its last sample for no
    longer than it ever did before.
    """
    inside = within(grid, clock)
    if not held:
        return inside if len(clock) < _FEWEST else inside & ~signals.in_pauses(clock, grid)
    rounding = ROUNDING * median_period(clock)
    longest = float(np.max(np.diff(clock))) if len(clock) > 1 else np.inf
    return np.asarray(inside | ((grid > clock[-1]) & (grid < clock[-1] + longest - rounding)))


def has_own_rate(
    rows: IntArray, time: FloatArray, held: bool, starts: IntArray | None = None
) -> bool:
    """Whether a column that is filled in `rows` (k,) alone is sampled at a different rate.

    Then its rows lie apart from one another, or, where tables of two clocks were merged, its
    own times are even although rows of the other lie between. `time` (n,) s is that of all rows,
    `starts` the first rows of tests. A cell that is missing in a full column is neither.
    """
    if len(rows) < _FEWEST:
        return held and len(rows) > 1 and 2 * len(rows) < len(time)
    if np.median(np.diff(rows)) >= 2.0:
        return True
    first = np.zeros(1, dtype=np.intp) if starts is None else starts
    lacking = [
        own
        for test, own in zip(
            np.split(np.arange(len(time)), first[1:]),
            np.split(rows, np.searchsorted(rows, first[1:])),
            strict=True,
        )
        if len(own) < len(test)
    ]
    return all(_is_even_between_others(own, time) for own in lacking)


def _is_even_between_others(rows: IntArray, time: FloatArray) -> bool:
    """Whether times of `rows` (k,) are even, and other rows lie between."""
    if len(rows) < _FEWEST:
        return False
    own = np.diff(time[rows])
    return bool(np.max(np.diff(rows)) > 1 and np.max(own) < signals.SAMPLE_MISSING * np.median(own))


__all__ = ["FILLS", "has_own_rate", "has_value", "is_held", "rows_held", "values_at", "within"]
