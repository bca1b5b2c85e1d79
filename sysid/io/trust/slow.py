"""Rows too far apart for what they sample: a motion that reverses within a few of them, a pressure
that changes within a few of them. No fit gets back what happens between two rows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sysid import signals
from sysid.types import FloatArray


def _rows_for(error: float) -> int:
    """Rows from one reversal of a sine to the next with which its acceleration comes out smaller by
    this share: with n rows, second differences give it times (sin(x) / x)^2 with x = pi / 2n."""
    return round(0.5 * math.pi / math.sqrt(3.0 * error))


# Rows per reversal from which a motion is resolved at all, and well.
_FEWEST, WANTED_ROWS = _rows_for(1e-2), _rows_for(2e-3)
# Reversals that show a motion, and the share of the test's range that each crosses.
_REVERSALS = 8
_CROSSED = 0.05
# Ratio of range to resolution or noise, below which no motion shows.
_SHOWN = 10.0
# Share of a pressure's range: the change of an exponential in half of its time constant.
_STEP = 1.0 - math.exp(-0.5)
# Largest change that resolves it.
RESOLVED_STEP = 0.05
# Rows whose largest step is the noise where they are the quietest.
_BLOCK = 10


def rows_per_reversal(parts: Sequence[FloatArray], count: float) -> float | None:
    """Rows from one reversal of a position to the next, where they are too few to resolve it.

    `parts` (n,) are its tests, `count` its resolution. The median over all tests; None where the
    motion is resolved or the shaft does not move.
    """
    found = [_between_reversals(part, count) for part in parts if _is_fast(part, count)]
    rows = np.concatenate(found) if found else np.zeros(0)
    if len(rows) < _REVERSALS:
        return None
    usual = float(np.median(rows))
    return usual if usual < _FEWEST else None


def _is_fast(values: FloatArray, count: float) -> bool:
    """Whether a test (n,) may reverse within so few rows at all: most logs are decided at once."""
    if len(values) < 2 * _BLOCK:
        return False
    way, low, high = np.mean(np.abs(np.diff(values))), np.min(values), np.max(values)
    fast = high - low > _SHOWN * count and _FEWEST * way > _CROSSED * (high - low)
    return bool(fast and not _is_noise(values))


def _is_noise(values: FloatArray) -> bool:
    """Whether readings (n,) are rather independent of one another than a motion's.

    Neighbouring steps of independent readings correlate by -1/2, those of a motion that reverses
    every two rows or more by 0 or above.
    """
    steps = np.diff(values)
    return bool(steps[1:] @ steps[:-1] < -0.25 * (steps @ steps))


def _between_reversals(values: FloatArray, count: float) -> FloatArray:
    """Rows between the reversals of a test (n,), each of which crosses a share of its range."""
    least = max(_CROSSED * float(np.ptp(values)), _SHOWN * count)
    at: list[int] = []
    way, low, high = 0, 0, 0
    for row, value in enumerate(values):
        if way >= 0 and value > values[high]:
            high = row
        if way <= 0 and value < values[low]:
            low = row
        if way >= 0 and values[high] - value > least:
            at, way, low = [*at, high], -1, row
        elif way <= 0 and value - values[low] > least:
            at, way, high = [*at, low], 1, row
    return np.diff(at).astype(float)


def largest_step(parts: Sequence[FloatArray], times: Sequence[FloatArray]) -> float | None:
    """The share of its range by which a pressure changes from one row to the next, where that is
    too much to resolve the change; `parts` (n,) are the tests in which a valve moves, `times` (n,)
    s theirs.

    The median of the tests' largest, but for those over a gap in the rows; None where the changes
    are resolved.
    """
    shares = []
    for part, time in zip(parts, times, strict=True):
        if len(part) < 2 * _BLOCK:
            continue
        steps, whole = np.abs(np.diff(part)), float(np.ptp(part))
        steps[signals.pauses(time)] = 0.0
        if whole > _SHOWN * _quietest(steps):
            shares.append(float(np.max(steps)) / whole)
    usual = float(np.median(shares)) if shares else 0.0
    return usual if usual > _STEP else None


def _quietest(steps: FloatArray) -> float:
    """The largest of steps (n,) where they are smallest: the sensor's noise."""
    count = max(1, len(steps) // _BLOCK)
    # As `np.array_split`: the first blocks hold the rows that are over.
    starts = np.arange(count) * (len(steps) // count) + np.minimum(
        np.arange(count), len(steps) % count
    )
    return float(np.min(np.maximum.reduceat(steps, starts)))


__all__ = ["RESOLVED_STEP", "WANTED_ROWS", "largest_step", "rows_per_reversal"]
