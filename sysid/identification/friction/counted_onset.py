"""When a motion that grows from rest begins, by the edges at which a coarse encoder counts.

An edge says where the shaft is, exactly, and when, to a row. The readings between say only within
which count it is: where in its count the shaft rested is unknown. Taken for the reading itself,
the rest makes the motion begin too late, by 0.6 % of static friction at 1,000 counts a revolution
and by 1.4 % at 500.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.types import FloatArray

FEWEST, MOST, MOST_PUSHED = 8, 12, 24
"""Edges from which the start is taken: two terms of the motion, its time and the place of rest need
as many; later ones are of a motion that friction and speed have bent, less so where the known
efforts are accounted for."""
_TIMES, _PLACES = 400, 25

Pushed = Callable[[FloatArray], FloatArray]
"""The way in counts, (m, k), by which known efforts would have moved the shaft by each of k edges
since each of the times (m,), s, had it been in balance then."""


@dataclass(frozen=True)
class CountedStart:
    """When a motion begins, s, and where in its count the shaft rested, -1/2 to 1/2 along it."""

    time: float
    place: float


def begins_by_counts(
    edges: FloatArray, period: float, pushed: Pushed | None = None
) -> CountedStart:
    """The mean start of a motion whose counts 1, 2, ... are at `edges` (k,), s.

    All places of rest within a count are equally probable; the k-th edge is k - 1/2 counts from the
    middle of the one at rest. The motion is a (t-t0)^2 + b (t-t0)^3 counts, a at least 0. Where it
    is known how the efforts `pushed` it, it is that way, more by a (t-t0)^2, as friction drops,
    and less by what viscous friction takes, which goes with the integral of the way. An edge is
    known to a row, so that its error in counts grows with the speed, the square root of the way;
    or the errors are larger, as far as the motion's form leaves more.
    """
    time = edges - edges[0]
    passed = np.arange(len(edges)) + 0.5
    weight = np.asarray(1.0 / passed, dtype=np.float64)
    span = float(time[-1])
    start = np.linspace(-span, 0.0, _TIMES, endpoint=False)
    place = (np.arange(_PLACES) + 0.5) / _PLACES - 0.5
    s = (time - start[:, None])[:, None, :] / span  # (times, 1, edges)
    way = (passed - place[:, None])[None]  # (1, places, edges)
    if pushed is None:
        left = _left(way, s**2, s**3, weight, math.inf)
    else:
        moved = way - pushed(edges[0] + start)[:, None, :]
        left = _left(moved, s**2, _integral(way, s), weight, 0.0)
    growth = (math.sqrt(passed[-1]) - math.sqrt(passed[0])) / span
    of_rows = (2.0 * growth * period) ** 2 / 12.0
    variance = max(of_rows, float(left.min()) / (len(edges) - 4))
    odds = np.exp(-0.5 * (left - left.min()) / variance)
    odds /= odds.sum()
    return CountedStart(float(edges[0] + odds.sum(axis=1) @ start), float(odds.sum(axis=0) @ place))


def _left(
    way: FloatArray, one: FloatArray, other: FloatArray, weight: FloatArray, most: float
) -> FloatArray:
    """Weighted squares that a `one` + b `other` leave of a way, all (times, places, edges): with a
    at least 0, infinite where that is not so, and b at most `most`."""
    aa, ab, bb, ya, yb = (
        (x * y) @ weight
        for x, y in ((one, one), (one, other), (other, other), (way, one), (way, other))
    )
    b = np.minimum((yb * aa - ya * ab) / (aa * bb - ab * ab), most)
    a = (ya - b * ab) / aa
    left = (way * way) @ weight - a * (2.0 * ya - a * aa - 2.0 * b * ab) - b * (2.0 * yb - b * bb)
    return np.asarray(np.where(a >= 0.0, np.maximum(left, 0.0), math.inf))


def _integral(way: FloatArray, s: FloatArray) -> FloatArray:
    """Integral (times, places, edges) of a way (1, places, edges) over times s (times, 1, edges)
    since the start, from one edge to the next by the power of time that goes through both."""
    longer = np.log(s[..., 1:] / s[..., :-1])
    area = way * s
    steps = np.diff(area, axis=-1) * longer / (np.log(way[..., 1:] / way[..., :-1]) + longer)
    first = area[..., :1] / 3.0  # a square's
    return np.asarray(np.cumsum(np.concatenate([first, steps], axis=-1), axis=-1))


__all__ = ["FEWEST", "MOST", "MOST_PUSHED", "CountedStart", "Pushed", "begins_by_counts"]
