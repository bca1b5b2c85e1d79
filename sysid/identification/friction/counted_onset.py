"""When a motion that grows from rest begins, by the edges at which a coarse encoder counts.

An edge says where the shaft is, exactly, and when, to a row. The readings between say only within
which count it is: where in its count the shaft rested is unknown. Taken for the reading itself,
the rest makes the motion begin too late, by 0.6 % of static friction at 1,000 counts a revolution
and by 1.4 % at 500.
"""

from __future__ import annotations

import math

import numpy as np

from sysid.types import FloatArray

FEWEST, MOST = 8, 12
"""Edges from which the start is taken: a quadratic and a cubic, its time and the place of rest need
as many; later ones are of a motion that friction and speed have bent."""
_TIMES, _PLACES = 400, 25


def begins_by_counts(edges: FloatArray, period: float) -> float:
    """The mean time, s, at which a motion begins whose counts 1, 2, ... are at `edges` (k,), s.

    The motion is a (t-t0)^2 + b (t-t0)^3 counts, a at least 0, from a rest anywhere within a count,
    all of which are equally probable; the k-th edge is k - 1/2 counts from the middle of the one at
    rest. The errors are those of the sampling, or larger where the motion's form leaves more.
    """
    time = edges - edges[0]
    passed = np.arange(len(edges)) + 0.5
    span = float(time[-1])
    start = np.linspace(-span, 0.0, _TIMES, endpoint=False)
    place = (np.arange(_PLACES) + 0.5) / _PLACES - 0.5
    s = (time - start[:, None]) / span  # (times, edges)
    squares, cubes = s**2, s**3
    way = passed - place[:, None]  # (places, edges)
    aa, ab, bb = (
        (x * y).sum(axis=1)[:, None]
        for x, y in ((squares, squares), (squares, cubes), (cubes, cubes))
    )
    ya, yb = squares @ way.T, cubes @ way.T
    determinant = aa * bb - ab * ab
    a, b = (ya * bb - yb * ab) / determinant, (yb * aa - ya * ab) / determinant
    left = (way * way).sum(axis=1) - a * ya - b * yb
    left = np.where(a >= 0.0, np.maximum(left, 0.0), math.inf)
    speed = (len(edges) - 1) / span
    variance = max((speed * period) ** 2 / 12.0, float(left.min()) / (len(edges) - 4))
    odds = np.exp(-0.5 * (left - left.min()) / variance).sum(axis=1)
    return float(edges[0] + odds @ start / odds.sum())


__all__ = ["FEWEST", "MOST", "begins_by_counts"]
