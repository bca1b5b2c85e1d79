"""Rows that share a time stamp: of a clock too coarse for them, or rows that were written twice."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.types import BoolArray, FloatArray

# Stamps that say how fast the rows are; rows for each of a coarse clock's, of which a few rows
# without a stamp of their own do not make one.
_FEWEST_STAMPS, _ROWS_PER_STAMP = 4, 1.5
# Rows over which stamps may scatter about a line: a coarse clock's are late by one at most, those
# that jitter is rounded in by one more.
_LATE, _JITTER = 1.01, 2.0


def repeats(time: FloatArray) -> BoolArray:
    """The rows (n,) that have the time of the row before."""
    return np.append(False, np.diff(time) == 0.0)


def written_twice(time: FloatArray, columns: Mapping[str, FloatArray]) -> BoolArray:
    """The rows (n,) that have all values of the row before, its time among them."""
    same = repeats(time)
    if not same.any():
        return same
    for values in columns.values():
        known = np.isnan(values)
        equal = (values[1:] == values[:-1]) | (known[1:] & known[:-1])
        same[1:] &= equal
    return same


def spread_evenly(time: FloatArray) -> FloatArray | None:
    """Times (n,) s of rows at one rate, whose clock does not go back and is too coarse for them.

    None where the rows are not even by it: each stamp is to be that of a row on a line, late by
    less than a row. Several rows share one, or each has its own but for rounding: a single row more
    than there are stamps is a row too many, and a clock that stops is none that is coarse.
    """
    first = np.flatnonzero(~repeats(time))
    if len(first) < _FEWEST_STAMPS or np.any(np.diff(time) < 0.0):
        return None
    # The first stamp may have begun before the first row.
    at, stamps = first[1:], time[first[1:]]
    period, start = np.polyfit(at - at[0], stamps - stamps[0], 1)
    off = (stamps - stamps[0]) - (start + period * (at - at[0]))
    steps = np.diff(time[first])
    ticks = steps / float(np.median(steps))
    # Rounding omits a stamp for each that it repeats, which once may be a mistake in one stamp; a
    # row too many omits none.
    omitted = int(np.count_nonzero(ticks > 1.5))
    is_rounded = omitted > 1 and abs(len(time) - 1 - float(np.sum(ticks))) < 1.5
    if not float(np.ptp(off)) <= (_JITTER if is_rounded else _LATE) * period:
        return None
    shared = np.diff(np.append(first, len(time)))
    stands = max(shared[0], shared[-1]) > np.max(shared[1:-1])  # a clock that starts late, or stops
    if not is_rounded and (stands or len(time) < _ROWS_PER_STAMP * len(first)):
        return None
    return np.asarray(stamps[0] + start + period * (np.arange(len(time)) - at[0]))


__all__ = ["repeats", "spread_evenly", "written_twice"]
