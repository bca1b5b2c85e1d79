"""Readings that repeat since their sensor is slower than the logger.

Such a channel changes at a regular stride of rows, and by several of its steps at once though it
stands still in the rows before and after: a fresh reading that had moved so far within one row
would move in the next ones too. A coarse encoder moves by single counts at strides that follow its
speed; a channel at rest does not change at all.

Only the fresh readings are measurements. A repeated one is as old as its first row; the rows
between two fresh ones are taken on the line from one to the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.types import FloatArray

# Changes by several steps that show a pattern, and their share that stands alone.
_FEWEST = 20
_ALONE = 0.5
_SEVERAL = 1.5
# The share of the strides that are within a row, or this share, of the usual one or a multiple of
# it, at which fresh readings came out equal.
_REGULAR = 0.9
_JITTER = 0.2
_MULTIPLES = 3
# Share of a stride by which a reading may come early.
_EARLY = 0.25


@dataclass(frozen=True)
class Staleness:
    """How a channel repeats: rows from one fresh reading to the next, and the share of all rows
    that repeat one."""

    stride: float
    share: float


def staleness(parts: Sequence[FloatArray]) -> Staleness | None:
    """How one channel's readings repeat, by all tests (n,) of a file; None where they do not."""
    step = _step(parts)
    if step == 0.0:
        return None
    alone = several = 0
    strides = []
    for values in parts:
        steps = np.abs(np.diff(values, prepend=values[:1], append=values[-1:]))
        is_several = steps > _SEVERAL * step
        is_several[[0, -1]] = False
        rows = np.flatnonzero(is_several)
        several += len(rows)
        alone += int(np.count_nonzero((steps[rows - 1] == 0.0) & (steps[rows + 1] == 0.0)))
        changes = np.flatnonzero(steps)
        gaps = np.diff(changes)
        strides.append(gaps[is_several[changes[:-1]] & is_several[changes[1:]]])
    if several < _FEWEST or alone < _ALONE * several:
        return None
    stride = _regular(np.concatenate(strides))
    return None if stride is None else Staleness(stride, 1.0 - 1.0 / stride)


def fresh_readings(values: FloatArray, stride: float) -> tuple[FloatArray, FloatArray]:
    """Rows (m,), counted from 0, and values (m,) of one test's fresh readings; `values` (n,).

    Where nothing changes for several strides fresh readings came out equal. The row of the first
    may be before the test's first, as it is a stride before the second.
    """
    changes = np.flatnonzero(np.diff(values)) + 1
    if len(changes) == 0:
        return np.array([0.0, len(values) - 1.0]), values[[0, -1]]
    gaps = np.diff(changes, prepend=0, append=len(values))
    # Number of readings between changes; after the last one a stride may be incomplete.
    times = np.maximum(1, np.floor(gaps / stride + _EARLY).astype(int))
    times[-1] = max(1, math.floor((gaps[-1] - 1) / stride) + 1)
    before = changes[0] - stride * np.arange(times[0], 0, -1)
    after = changes[-1] + stride * np.arange(times[-1])
    between = [
        np.linspace(first, last, number, endpoint=False)
        for first, last, number in zip(changes[:-1], changes[1:], times[1:-1], strict=True)
    ]
    rows = np.concatenate([before, *between, after])
    found = np.repeat(values[np.concatenate([[0], changes])], times)
    return np.where(rows < 0.0, rows, np.round(rows)), found


def _step(parts: Sequence[FloatArray]) -> float:
    """The channel's smallest step; 0 where it never changes."""
    whole = signals.quantum(np.concatenate(parts))
    if whole > 0.0:
        return whole
    steps = np.concatenate([np.abs(np.diff(values)) for values in parts])
    steps = steps[steps > 0.0]
    return float(np.min(steps)) if len(steps) else 0.0


def _regular(gaps: NDArray[np.intp]) -> float | None:
    """The stride, in rows, of which the gaps (m,) between changes are multiples; None without
    such a stride."""
    if len(gaps) < _FEWEST // 2:
        return None
    usual = float(np.median(gaps))
    jitter = max(1.0, _JITTER * usual)
    times = np.clip(np.ceil((gaps - jitter) / usual), 1, _MULTIPLES)
    is_regular = np.abs(gaps - times * usual) <= jitter
    if np.mean(is_regular) < _REGULAR or usual <= 1.0:
        return None
    return float(np.sum(gaps[is_regular]) / np.sum(times[is_regular]))


__all__ = ["Staleness", "fresh_readings", "staleness"]
