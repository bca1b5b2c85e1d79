"""Samples that were misread: single ones far outside all others, a position without its sign.

A position that jumps there and back within a test was fixed before (`jumps`), by the motion around
it; this file treats pressures, and the first and last samples of a position.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid.signals import MIN_SAMPLES
from sysid.types import FloatArray

# Most outliers on one side of a test, and their distance from the range of the others, as a share
# of it and in steps.
_MOST_SPIKES = 3
_APART = 0.5
_STEPS_APART = 20.0
# Rows over which a position reverses, its speed there as a share of the test's highest, and of the
# speed a little farther away.
_FOLD_ROWS = 5
_FOLD_SPEED = 0.2
_STRAIGHT = 0.7


def folds(values: FloatArray) -> bool:
    """Whether a position (n,) of one test turns round at zero at full speed, as its size does."""
    low, step = float(np.min(values)), float(np.max(np.abs(np.diff(values)), initial=0.0))
    if low < 0.0 or low > step or len(values) < MIN_SAMPLES:
        return False
    n = _FOLD_ROWS
    inner = values[2 * n : -2 * n]
    lowest = (inner <= values[2 * n - 1 : -2 * n - 1]) & (inner < values[2 * n + 1 : -2 * n + 1])
    i = 2 * n + np.flatnonzero(lowest & (inner <= step))
    near = np.minimum(values[i - n], values[i + n]) - values[i]
    far = np.maximum(values[i - 2 * n] - values[i - n], values[i + 2 * n] - values[i + n])
    # A smooth motion reverses with a third of the speed that it has a little farther away;
    # one that reverses again so soon is sampled too coarsely to decide.
    before, after = np.maximum(i - 3 * n, 0), np.minimum(i + 3 * n, len(values) - 1)
    goes_on = (values[before] > values[i - 2 * n]) & (values[after] > values[i + 2 * n])
    return bool(np.any(goes_on & (near > _STRAIGHT * far) & (near > _FOLD_SPEED * n * step)))


def spikes(values: FloatArray) -> NDArray[np.intp]:
    """Rows of single samples that lie farther outside all others than half these others' range.

    `values` (n,), of one test; at most `_MOST_SPIKES` rows to a side, no two adjacent. Such a
    sample is a transmission error: a pressure or position does not jump there and back.
    """
    found: list[int] = []
    steps = np.abs(np.diff(values))
    moves = steps[steps > 0.0]
    if len(values) < MIN_SAMPLES or moves.size == 0:
        return np.array(found, dtype=np.intp)
    least = _STEPS_APART * float(np.median(moves))
    if np.max(moves) <= least:  # the steps to and from a spike are larger
        return np.array(found, dtype=np.intp)
    for side in (1.0, -1.0):
        found += _highest_apart(side * values, least)
    return np.array(sorted(found), dtype=np.intp)


def without_spikes(values: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """The rows of `spikes` of a test (n,), and its values with those on the line between others."""
    rows = spikes(values)
    if rows.size == 0:
        return rows, values.copy()
    ordinary = np.delete(np.arange(len(values)), rows)
    repaired = values.copy()
    repaired[rows] = np.interp(rows, ordinary, values[ordinary])
    return rows, repaired


def _highest_apart(values: FloatArray, least: float) -> list[int]:
    """The rows of the few highest values that stand apart from the rest, each alone, by `least`."""
    count = _MOST_SPIKES + 1
    top = np.argpartition(values, -count)[-count:]
    top = top[np.argsort(values[top])[::-1]]
    low = float(np.min(values))
    for many in range(_MOST_SPIKES, 0, -1):
        rest = float(values[top[many]])
        rows = set(top[:many].tolist())
        apart = float(values[top[many - 1]]) - rest > max(_APART * (rest - low), least)
        alone = not any(i + 1 in rows for i in rows)
        if apart and alone and rest > low:
            return sorted(rows)
    return []


__all__ = ["folds", "spikes", "without_spikes"]
