"""A position that jumps within one sample: an index pulse that sets the counter, or lost counts.

A mass has a speed that an impact, a slip or a valve may change within a sample, but it cannot take
a step and go on as before. So a step is a jump where it lies outside all steps around it, by more
than the sensor's errors and the irregularity of the motion around it allow. An impact's or a
breakaway's step lies between the speeds before and after it. A position that jumps there and back
within a few rows has two such steps, in opposite directions, outside all others around them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid import signals
from sysid.io.trust.wraps import ASIDE, ORDINARY
from sysid.types import FloatArray

# Multiple of the range of the surrounding steps about their line: less is a slip of a few rows.
_IRREGULAR = 3.0
# A reading in whole counts is within half a count of the truth, and a step within one:
# two steps differ by at most two counts.
_COUNTS = 2.5
# Chance of one false alarm in a test whose errors are as those of its other rows.
_FALSE_ALARM = 1e-4
_USUAL, _SELDOM = 0.9, 0.99
# Variance of third differences, which leave hardly any motion, of white noise.
_THIRD = math.comb(2 * 3, 3)
_UPPER_QUARTILE = NormalDist().inv_cdf(0.75)
# Third differences whose median is the noise around a step.
_BLOCK = 32
# Steps from which a sensor's readings show its resolution.
_FEWEST_STEPS = 10
# Jumps in a test that moves by nothing else.
_MOST_JUMPS = 3


def _line(back: int) -> FloatArray:
    """(s, s): the least-squares line through the steps around a jump, at these steps; it may go
    `back` by a step so many later (0: it does not)."""
    places = np.delete(np.arange(2 * ASIDE + 1.0 + back), [ASIDE, ASIDE + back])
    places -= places.mean()
    return np.asarray(np.outer(places, places) / (places @ places) + 1.0 / len(places))


# Indexed by the number of steps after which a jump goes back (0: not within those around it).
_LINES = tuple(_line(back) for back in range(ASIDE + 1))


@dataclass(frozen=True)
class Jump:
    """A jump before the row `row` of a test: its size in the position's unit, the speed of its
    step, and the highest speed of the steps around it (both per second)."""

    row: int
    size: float
    speed: float
    usual_speed: float


@dataclass(frozen=True)
class _Around:
    """The steps of a test that have `ASIDE` others on both sides, (m,) each.

    `back`: after how many steps the position would go back, 0: not at all. `outside`: how far a
    step, and that back in the other direction, lie outside the others; `range`: the others' about
    their line; `mean` and `fastest`: their mean and their highest speed.
    """

    back: int
    outside: FloatArray
    range: FloatArray
    mean: FloatArray
    fastest: FloatArray


@dataclass(frozen=True)
class Resolution:
    """The smallest step of a position; `is_whole`: all its readings are multiples of it."""

    step: float
    is_whole: bool


def without_jumps(
    time: FloatArray, position: FloatArray, resolution: Resolution
) -> tuple[FloatArray, list[Jump]]:
    """One test's position (n,) joined on after each jump, and the jumps by their rows.

    `time` (n,) s, increasing; `position` m or rad. What follows a jump is moved to where the motion
    around it leads; by whole counts where the position is in counts.
    """
    found: list[Jump] = []
    if np.all(position == position[:1]):  # held
        return position, found
    joined = position
    for jump in _at_start(time, position, resolution):
        joined = joined.copy()
        joined[jump.row :] -= jump.size
        found.append(jump)
    # Jumps in a test; a recording with more of them is no recording of a motion.
    for _ in range(50):
        jumps = _largest(time, joined, resolution)
        if not jumps or jumps[0].size == 0.0:
            break
        joined = joined.copy()
        for jump in jumps:
            joined[jump.row :] -= jump.size
        found += jumps
    if _is_the_motion(joined, found):
        return position, []
    return joined, sorted(found, key=lambda jump: jump.row)


def _at_start(time: FloatArray, position: FloatArray, resolution: Resolution) -> list[Jump]:
    """The jump in a test's first rows, which have too few steps before them; none without one.

    Only a step over most of what the test covers, against the motion that follows, and clearly
    longer than all later steps is one: as of a counter that begins at 0 and wraps at once. What
    moves along with such a step may be a slip or a piston that runs to its end.
    """
    steps, periods = np.diff(position), np.diff(time)
    if len(steps) < 2 * ASIDE + 2 or not math.isfinite(resolution.step):
        return []
    count = _COUNTS * resolution.step
    later = float(np.max(np.abs(steps[ASIDE:])))
    least = max((1.0 - ORDINARY) * float(np.ptp(position)), _IRREGULAR * later) + count
    at = int(np.argmax(np.abs(steps[:ASIDE])))
    after = steps[at + 1 : at + 1 + ASIDE]
    if not (abs(steps[at]) > least and later > count and np.all(after * steps[at] < 0.0)):
        return []
    usual = float(after[0] / periods[at + 1])
    size = float(steps[at] - usual * periods[at])
    if resolution.is_whole:
        size = resolution.step * round(size / resolution.step)
    return [Jump(at + 1, size, abs(float(steps[at] / periods[at])), abs(usual))]


def _is_the_motion(joined: FloatArray, found: list[Jump]) -> bool:
    """Whether many jumps make up more than half of a test's travel: slips too short for its rows,
    so that the `joined` position (n,) without them is not the motion."""
    way = float(np.sum(np.abs(np.diff(joined))))
    return len(found) > _MOST_JUMPS and sum(abs(jump.size) for jump in found) > way


def resolution_of(positions: FloatArray, declared: float | None = None) -> Resolution:
    """The resolution of a sensor by all its readings (n,), of all tests of a file.

    Readings with a few steps only do not show it, as a step of theirs may be a jump: then it is
    the `declared` one, else unknown, and infinite.
    """
    steps = np.abs(np.diff(positions))
    steps = steps[steps > 1e-9 * np.max(np.abs(positions), initial=0.0)]
    if len(steps) < _FEWEST_STEPS:
        smallest = float(np.min(steps, initial=math.inf))
        if np.count_nonzero(steps < 1.5 * smallest) < 2:
            smallest = math.inf if declared is None else declared
        return Resolution(smallest, False)
    whole = signals.quantum(positions)
    return Resolution(whole or float(np.min(steps)), whole > 0.0)


def _largest(time: FloatArray, position: FloatArray, resolution: Resolution) -> list[Jump]:
    """The clearest jump of a test, with that back where it goes back; none without any."""
    looks = [around for back in range(ASIDE + 1) if (around := _around(time, position, back))]
    best = _clearest(position, resolution, looks)
    return [] if best is None else _jumps_at(time, position, resolution, *best)


def over_two_steps(time: FloatArray, position: FloatArray, resolution: Resolution) -> list[Jump]:
    """Jumps that take two steps of a test's position (n,), as those of a log that was resampled do.

    `without_jumps` leaves them, for a slip may take as long; none where there are more than a few.
    """
    found: list[Jump] = []
    if np.all(position == position[:1]):  # held
        return found
    joined = position.copy()
    while len(found) <= _MOST_JUMPS:
        around = _around(time, joined, 1, spread=True)
        best = None if around is None else _clearest(joined, resolution, [around])
        if best is None:
            return found
        around, step = best
        row, size = step + ASIDE + 1, 0.0
        for part in (row, row + 1):
            period = time[part] - time[part - 1]
            own = joined[part] - joined[part - 1] - around.mean[step] * period
            joined[part:] -= own
            size += float(own)
        speed = abs(
            float(position[row + 1] - position[row - 1]) / float(time[row + 1] - time[row - 1])
        )
        found.append(Jump(row, size, speed, float(around.fastest[step])))
    return []


def runs_into_stop(
    position: FloatArray, jump: Jump, ends: tuple[float, float], count: float
) -> bool:
    """Whether a jump over two steps of a position (n,) is a motion that runs into a stop: it rests
    right after, at the end of the `ends` between which all positions of its file lie.
    """
    later = position[jump.row + 1 : jump.row + 2 + ASIDE]
    reached = ends[1] if jump.size > 0.0 else ends[0]
    return bool(np.ptp(later[-2:]) <= count and abs(later[-1] - reached) <= count)


def _clearest(
    position: FloatArray, resolution: Resolution, looks: Sequence[_Around]
) -> tuple[_Around, int] | None:
    """The clearest jump: its look, and the index of its step in that; None without any."""
    if not any(around.outside.any() for around in looks):
        return None
    count = resolution.step
    noises = _largest_noise(position, count)
    best, clearest, seldom = None, 0.0, 0.0
    for around in looks:
        noise = noises[: len(around.outside)]
        # The part that whole counts do not explain.
        beyond = np.maximum(0.0, around.outside - _COUNTS * count)
        ratio = beyond / (count + noise + around.range)
        # Rounding gives the steps of an even motion a range of a count about their line.
        irregular = np.maximum(0.0, around.range - count)
        # Steps there and back by chance are rarer than steps outside the others.
        seldom = max(seldom, _seldom_passed(ratio))
        clear = (beyond > noise + _IRREGULAR * irregular) & (ratio > seldom)
        ratio = np.where(clear, ratio, 0.0)
        if ratio.max() > clearest:
            best, clearest = (around, int(np.argmax(ratio))), float(ratio.max())
    return best


def _jumps_at(
    time: FloatArray, position: FloatArray, resolution: Resolution, around: _Around, step: int
) -> list[Jump]:
    """The jump of a step (index into `around`), and that back by as much where it goes back."""
    period, moved = (np.diff(values)[step + ASIDE] for values in (time, position))
    size = float(moved - around.mean[step] * period)
    if resolution.is_whole:
        size = resolution.step * round(size / resolution.step)
    jumps: list[Jump] = []
    for row in sorted({step + ASIDE + 1, step + ASIDE + 1 + around.back}):
        speed = abs(float(position[row] - position[row - 1])) / float(time[row] - time[row - 1])
        jumps.append(Jump(row, -size if jumps else size, speed, float(around.fastest[step])))
    return jumps


def _largest_noise(position: FloatArray, count: float) -> FloatArray:
    """The most that noise, without the rounding to counts, adds to each step (m,) with `ASIDE`
    others on both sides, in a test's length.

    By third differences over all rows, and over the blocks around a step: the noise of a clock
    whose jitter is not logged grows with the speed.
    """
    third = np.abs(np.diff(position, 3))
    quiet = np.sort(third)[: max(1, math.ceil(_USUAL * len(third)))]
    everywhere = math.sqrt(float(np.mean(quiet**2)) / _THIRD)
    sizes = [len(b) for b in np.array_split(third, max(1, len(third) // _BLOCK))]
    larger = sizes.count(sizes[0]) * sizes[0]  # the first blocks hold the rows that are over
    blocks = np.concatenate(
        [
            np.median(part.reshape(-1, size), axis=1)
            for part, size in ((third[:larger], sizes[0]), (third[larger:], sizes[-1]))
        ]
    )
    around = np.max(sliding_window_view(np.pad(blocks, 1, mode="edge"), 3), axis=1)
    # Step k + 3 is in third differences k + 1 to k + 3.
    local = np.repeat(around, sizes)[2 : 2 + len(position) - 1 - 2 * ASIDE]
    noise = np.maximum(everywhere, local / (_UPPER_QUARTILE * math.sqrt(_THIRD)))
    free = np.sqrt(np.maximum(0.0, noise**2 - count**2 / 12.0))
    return math.sqrt(2.0) * -NormalDist().inv_cdf(0.5 * _FALSE_ALARM / len(position)) * free


def _seldom_passed(ratio: FloatArray) -> float:
    """The limit that the largest of the test's ratios (m,) exceeds with probability `_FALSE_ALARM`:
    errors may have heavier tails than noise, and their quantiles show it, which a few jumps do not
    touch."""
    usual, seldom = np.quantile(ratio, (_USUAL, _SELDOM), method="lower")
    decades = math.log10(max(1.0, (1.0 - _SELDOM) * len(ratio)) / _FALSE_ALARM)
    return float(seldom + (seldom - usual) * decades)


def _around(
    time: FloatArray, position: FloatArray, back: int, spread: bool = False
) -> _Around | None:
    """The steps with those around them; `spread`: the one after is the rest of the jump."""
    periods, steps = np.diff(time), np.diff(position)
    window = 2 * ASIDE + 1 + back
    if len(steps) < window + 2:
        return None
    count = len(steps) - window + 1
    speeds, pair = steps / periods, (ASIDE, ASIDE + back)
    others = np.stack([speeds[k : k + count] for k in range(window) if k not in pair])
    lengths = np.stack([periods[k : k + count] for k in range(window)])
    # A row's time stamp may be late: its step may have taken any of the periods around it.
    short, long = lengths.min(axis=0), lengths.max(axis=0)
    low, high = others.min(axis=0), others.max(axis=0)
    there, again = (steps[at : at + count] for at in pair)
    most, least = np.maximum(high * short, high * long), np.minimum(low * short, low * long)
    if spread:
        up, down = np.minimum(there, again) - most, least - np.maximum(there, again)
        both = np.where(up > 0.0, there + again - 2.0 * most, 2.0 * least - there - again)
        outside = np.where((up > 0.0) | (down > 0.0), both, 0.0)
    elif back:
        outside = np.maximum(
            np.minimum(there - most, least - again), np.minimum(least - there, again - most)
        )
    else:
        outside = np.maximum(there - most, least - there)
    outside = np.maximum(0.0, outside)
    # What happens in a pause of the recording is unknown.
    paused = np.zeros(len(steps), dtype=bool)
    paused[signals.pauses(time)] = True
    if paused.any():
        outside[sliding_window_view(paused, window).any(axis=1)] = 0.0
    left = others - _LINES[back] @ others
    return _Around(
        back,
        outside,
        np.ptp(left, axis=0) * long,
        others.mean(axis=0),
        np.abs(others).max(axis=0),
    )


__all__ = [
    "Jump",
    "Resolution",
    "over_two_steps",
    "resolution_of",
    "runs_into_stop",
    "without_jumps",
]
