"""A position whose counter wraps around: at a power of two of its counts, at a full turn, or at a
range that the wraps themselves show.

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

COUNTER_BITS = (16, 24, 32)
# Share of the counter's range that exceeds any step of the motion.
ORDINARY = 0.25
# Ratio of a step across a wrap to the others; and share of the range, for rounding in the file.
LARGER = 2.0
_ROUNDING = 2e-3
_FULL_TURN = 2.0 * math.pi
# Steps to either side that show how the motion goes on: noise leads one way once in 2^6.
ASIDE = 3


@dataclass(frozen=True)
class Wraps:
    """A counter's range, in the position's unit, and the wraps as (test, row in it)."""

    range: float
    rows: tuple[tuple[int, int], ...]


def counter_ranges(counts: Iterable[float], *, is_angle: bool) -> dict[float, str]:
    """The ranges that a counter may have, in the position's unit, and their names; `counts` are
    what one count may be."""
    ranges = {count * 2.0**bits: f"2^{bits} counts" for count in counts for bits in COUNTER_BITS}
    return ranges | ({_FULL_TURN: "2 pi"} if is_angle else {})


def shown_range(
    parts: Sequence[FloatArray], counts: Iterable[float], unit: str
) -> dict[float, str]:
    """The range by which a file's tests (n,) wrap, in the position's `unit`, and its name.

    Of a counter whose range is none of `counter_ranges`, or whose one count no step shows. Empty
    unless the motion leads, before and after most of the steps over a test's range, against them,
    as it does on both sides of a counter's end, but not of a slip from end to end; and where it
    goes along with one. One wrap alone shows no range.
    """
    sizes: list[float] = []
    found = 0
    for part in parts:
        steps = np.diff(part)
        wraps = np.abs(steps) > (1.0 - ORDINARY) * np.ptp(part)
        moving = np.flatnonzero((steps != 0.0) & ~wraps)
        rows = np.flatnonzero(wraps)
        after = np.searchsorted(moving, rows)
        inner = (after >= ASIDE) & (after + ASIDE <= len(moving))
        rows, after = rows[inner], after[inner]
        places = after[:, None] + np.arange(-ASIDE, ASIDE)
        around = steps[moving[places]] * np.sign(steps[rows])[:, None]
        next_to = around[:, ASIDE - 1 : ASIDE + 1]
        if np.any(np.all(next_to > 0.0, axis=1)):
            return {}
        found += len(rows)
        against = np.all(around < 0.0, axis=1)
        sizes += (np.abs(steps[rows]) - next_to.mean(axis=1))[against].tolist()
    if len(sizes) < 2 or 2 * len(sizes) <= found:
        return {}
    whole = float(np.median(sizes))
    apart = float(np.max(np.abs(np.array(sizes) - whole)))
    for count in counts:
        bits = round(math.log2(whole / count))
        if abs(count * 2.0**bits - whole) <= apart:
            return {count * 2.0**bits: f"2^{bits} counts"}
        whole = count * round(whole / count)
    return {whole: f"{whole:.4g} {unit}"}


def without_wraps(
    parts: Sequence[FloatArray], ranges: Iterable[float]
) -> tuple[list[FloatArray], Wraps | None]:
    """The positions (n,) of a file's tests followed over the wraps of their counter, if it wraps.

    Each is moved by whole ranges until its middle is next to zero, which is the middle of the
    stroke: a test without a wrap, too, may lie beyond one.
    """
    # Most logs hold no step that a wrap would need, which one look at their steps shows.
    step = max((float(np.max(np.abs(np.diff(part)), initial=0.0)) for part in parts), default=0.0)
    wrapping = [whole for whole in ranges if step > (1.0 - ORDINARY) * whole]
    possible = [whole for whole in wrapping if all(_is_ordinary(part, whole) for part in parts)]
    apart = [_largest_after_wraps(parts, whole) for whole in possible]
    if not any(map(math.isfinite, apart)):
        return list(parts), None
    whole = possible[int(np.argmin(apart))]
    rows = tuple((i, int(row)) for i, part in enumerate(parts) for row in _wraps(part, whole))
    followed = [_followed(part, whole) for part in parts]
    middles = [0.5 * (float(np.min(part)) + float(np.max(part))) for part in followed]
    moved = [p - whole * round(m / whole) for p, m in zip(followed, middles, strict=True)]
    return moved, Wraps(whole, rows)


def _wraps(values: FloatArray, whole: float) -> NDArray[np.intp]:
    """Rows of a test's (n,) values before which the counter has wrapped."""
    return np.flatnonzero(np.abs(np.diff(values)) > (1.0 - ORDINARY) * whole) + 1


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
    return bool(within and np.max(steps, initial=0.0) < ORDINARY * whole)


def _largest_after_wraps(parts: Sequence[FloatArray], whole: float) -> float:
    """The largest step over a wrap once followed; infinite without any, or if the others of its
    test are clearly smaller: then it is another range, or a jump."""
    largest = -math.inf
    for part in parts:
        rows = _wraps(part, whole)
        if len(rows):
            steps = np.abs(np.diff(_followed(part, whole)))
            others = float(np.max(np.delete(steps, rows - 1), initial=0.0))
            own = float(np.max(steps[rows - 1]))
            if own > LARGER * others + _ROUNDING * whole:
                return math.inf
            largest = max(largest, own)
    return largest if largest >= 0.0 else math.inf


__all__ = [
    "ASIDE",
    "COUNTER_BITS",
    "LARGER",
    "ORDINARY",
    "Wraps",
    "counter_ranges",
    "shown_range",
    "without_wraps",
]
