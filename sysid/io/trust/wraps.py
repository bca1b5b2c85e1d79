"""A position whose counter wraps around: at a power of two of its counts, or at a full turn.

After a wrap the motion goes on, a whole range of the counter away: with that range added its step
is as small as all others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.types import FloatArray

_BITS = (16, 24, 32)
# Of the counter's range: an ordinary step, and what a wrapped one may differ from the range by.
_ORDINARY = 0.25
# Of the range: a turn of 360 degrees may have been written as 6.28.
_ROUNDING = 1e-2
_FULL_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Wraps:
    """A counter's range, in the position's unit, and the wraps as (test, row in it)."""

    range: float
    rows: tuple[tuple[int, int], ...]


def counter_ranges(count: float | None, *, is_angle: bool) -> tuple[float, ...]:
    """The ranges that a counter may have, in the position's unit; `count` is its one count."""
    turn = (_FULL_TURN,) if is_angle else ()
    return turn if count is None else (*turn, *(count * 2.0**bits for bits in _BITS))


def without_wraps(
    parts: Sequence[FloatArray], ranges: Iterable[float]
) -> tuple[list[FloatArray], Wraps | None]:
    """The positions (n,) of a file's tests followed over the wraps of their counter, if it wraps.

    A test goes on from where the one before it ended; all together they are moved by whole ranges
    until their middle is next to zero, which is the middle of the stroke.
    """
    for whole in ranges:
        rows = tuple((i, int(row)) for i, part in enumerate(parts) for row in _wraps(part, whole))
        if not rows or not all(_is_ordinary(part, whole) for part in parts):
            continue
        edges = np.cumsum([len(part) for part in parts])[:-1]
        followed = _followed(np.concatenate(parts), whole)
        middle = 0.5 * (float(np.min(followed)) + float(np.max(followed)))
        followed -= whole * round(middle / whole)
        return np.split(followed, edges), Wraps(whole, rows)
    return list(parts), None


def _wraps(values: FloatArray, whole: float) -> NDArray[np.intp]:
    """Rows of a test's (n,) values before which the counter has wrapped."""
    return np.flatnonzero(np.abs(np.diff(values)) > (1.0 - _ORDINARY) * whole) + 1


def _followed(values: FloatArray, whole: float) -> FloatArray:
    """Values (n,) moved by whole ranges, so that no step is more than half of one.

    In place of `numpy.unwrap`, whose sums leave rounding on what was in whole counts.
    """
    times = np.round(np.diff(values, prepend=values[:1]) / whole)
    return np.asarray(values - whole * np.cumsum(times))


def _is_ordinary(values: FloatArray, whole: float) -> bool:
    """Whether a test (n,) is one of a counter of this range: once followed, its steps are small."""
    steps = np.abs(np.diff(_followed(values, whole)))
    within = np.ptp(values) <= (1.0 + _ROUNDING) * whole
    return bool(within and np.max(steps, initial=0.0) < _ORDINARY * whole)


__all__ = ["Wraps", "counter_ranges", "without_wraps"]
