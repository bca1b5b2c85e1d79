"""The steady interval of a constant-effort trial, and its friction from the momentum over it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.balance.momentum import momentum_balance
from sysid.identification.friction.effort import BLOCK_S, TrialUse, titles
from sysid.identification.friction.sliding import SlidingPoints
from sysid.identification.friction.within_trial import trial_law
from sysid.io.motion import MotionUnits
from sysid.recording.friction_kind import SLIDING, constant_run, level_tolerance
from sysid.recording.recording import Recording
from sysid.types import FloatArray

STEADY = 0.05  # an interval is steady while its blocks stay within this share of its speed
STALL = 0.02  # of the fastest block: slower is a stall
COAST = 0.2  # of the fastest block: a trial that comes to rest counts while it is faster
# Of blocks: the shortest stretch, and how long a kick settles.
_SHORTEST_BLOCKS, _SETTLING_BLOCKS = 4, 2
_FEWEST_BLOCKS = 8
STALLED = "it stalls: the shaft comes to rest under the constant effort"


@dataclass(frozen=True)
class SteadyStretch:
    """Rows [start, stop) of a trial, and whether its speed is steady there."""

    start: int
    stop: int
    steady: bool
    drift: float


def find_stretch(trial: Recording) -> SteadyStretch | str:
    """The interval of constant effort and, if possible, steady speed; or why none exists.

    Starts after the kick, once all later blocks of 50 ms (in a test of less than 0.4 s a sixteenth
    of it) stay within 5 % of the median speed of the later half; where they never do, two blocks
    after the kick, as an unsteady interval.
    Ends before the end stop. A trial that comes to rest counts for the stretch before. Blocks are
    longer where a coarse encoder needs that to tell motion from rest.
    """
    start, stop = constant_run(trial.motor)
    outside = np.flatnonzero(~trial.inside[start:stop])
    if len(outside):
        at_start = outside[0] == 0
        leading = int(np.argmax(trial.inside[start:stop])) if at_start else 0
        start += leading
        later = np.flatnonzero(~trial.inside[start:stop])
        stop = start + int(later[0]) if len(later) else stop
    first, last = signals.longest_run(~trial.lost[start:stop])
    start, stop = start + first, start + last
    unit_s = _block_s(trial)
    block = max(2, round(unit_s / trial.period))
    is_short = (stop - start) * trial.period < _SHORTEST_BLOCKS * unit_s
    if is_short or stop - start < _SHORTEST_BLOCKS * block:
        return (
            f"its effort is constant for less than {_SHORTEST_BLOCKS * unit_s:.2g} s, or "
            f"{_SHORTEST_BLOCKS * block} rows, away from the end stops"
        )
    marks, speed = _blocks(trial, start, stop, block)
    while _noise(trial, marks) > COAST * np.max(speed) and len(speed) >= 2 * _FEWEST_BLOCKS:
        block *= 2
        marks, speed = _blocks(trial, start, stop, block)
    noise = _noise(trial, marks)
    if float(np.max(speed)) <= 3.0 * noise:
        return STALLED
    if not _stalls(speed, noise):
        return _settled(trial, speed, marks, noise, stop)
    return _before_rest(trial, speed, marks, noise)


def _block_s(trial: Recording) -> float:
    """How long a block is over which the speed is averaged, s: 50 ms, or less in a short test."""
    length = len(trial) * trial.period
    return BLOCK_S if length >= 2 * _SHORTEST_BLOCKS * BLOCK_S else length / (2 * _FEWEST_BLOCKS)


def _blocks(
    trial: Recording, start: int, stop: int, block: int
) -> tuple[NDArray[np.intp], FloatArray]:
    """Bounds (n + 1,) of the blocks of rows [start, stop), and the mean speed (n,) in each.

    Counted from the end, so that the last one ends with the interval; along the motion.
    """
    x = trial.position[start:stop]
    marks = len(x) - 1 - block * np.arange((len(x) - 1) // block, -1, -1)
    direction = 1.0 if x[-1] > x[0] else -1.0
    return start + marks, direction * np.diff(x[marks]) / (block * trial.period)


def _noise(trial: Recording, marks: NDArray[np.intp]) -> float:
    """What the position's noise makes at most of the mean speed in a block."""
    return 3.0 * trial.mean_speed_noise(int(marks[1] - marks[0]))


def _stalls(speed: FloatArray, noise: float) -> bool:
    slow = speed < max(STALL * float(np.max(speed)), noise)
    # The kick may continue in the first blocks.
    return bool(np.any(slow[len(slow) // 4 :]))


def _settled(
    trial: Recording, speed: FloatArray, marks: NDArray[np.intp], noise: float, stop: int
) -> SteadyStretch:
    reference = float(np.median(speed[len(speed) // 2 :]))
    off = np.flatnonzero(np.abs(speed - reference) > STEADY * reference + noise)
    first = int(off[-1]) + 1 if len(off) else 0
    start = int(marks[first]) if first < len(speed) else stop
    unit_s = _block_s(trial)
    long_enough = (stop - start) * trial.period >= _SHORTEST_BLOCKS * unit_s
    steady = long_enough and not _load_changes(trial, start, stop)
    if not steady:
        settle = round(_SETTLING_BLOCKS * unit_s / trial.period)
        start = min(int(marks[0]) + settle, stop - round(_SHORTEST_BLOCKS * unit_s / trial.period))
        start = max(start, int(marks[0]))
        first = int(np.searchsorted(marks[:-1], start))
    inside = speed[min(first, len(speed) - 1) :]
    return SteadyStretch(start, stop, steady, float(np.ptp(inside)) / reference)


def _as_settled(trial: Recording, stretch: SteadyStretch) -> SteadyStretch:
    """The part of a steady stretch in which its speed changes by no more than its noise, at least
    its last quarter: what the change of momentum takes is not known without an inertia."""
    rows = stretch.stop - stretch.start
    block = max(2, rows // (2 * _FEWEST_BLOCKS))
    marks, speed = _blocks(trial, stretch.start, stretch.stop, block)
    last = speed[-(len(speed) // 4) :]
    off = np.flatnonzero(np.abs(speed - np.mean(last)) > _noise(trial, marks) + float(np.ptp(last)))
    first = min(int(off[-1]) + 1 if len(off) else 0, len(speed) - len(last))
    return replace(stretch, start=int(marks[first])) if first else stretch


def _before_rest(
    trial: Recording, speed: FloatArray, marks: NDArray[np.intp], noise: float
) -> SteadyStretch | str:
    """The stretch of a trial that comes to rest: against a stop, a cushion, a spring, gravity.

    Its longest steady stretch while it is fast, since what stops it may not be in the model;
    without one (an arm that swings uphill), all of its motion while it is fast.
    """
    unit_s = _block_s(trial)
    least = max(2, math.ceil(_SHORTEST_BLOCKS * unit_s / (trial.period * (marks[1] - marks[0]))))
    first, last = signals.longest_run(speed >= max(COAST * float(np.max(speed)), noise))
    if last - first < least:
        return STALLED
    from_, to = _longest_steady(speed[first:last], noise)
    # The top of a swing is flat, too, but most of a swing is not.
    steady = to - from_ >= max(least, (last - first) // 2)
    steady = steady and not _load_changes(trial, int(marks[first + from_]), int(marks[first + to]))
    if steady:
        first, last = first + from_, first + to
    elif last - first > least:
        first = min(first + _SETTLING_BLOCKS, last - least)
    inside = speed[first:last]
    drift = float(np.ptp(inside)) / float(np.median(inside))
    return SteadyStretch(int(marks[first]), int(marks[last]), steady, drift)


def _load_changes(trial: Recording, start: int, stop: int) -> bool:
    """Whether the known load changes over rows [start, stop) by more than a steady speed allows.

    Gravity on an arm, or a spring, then changes the speed, even where a coarse encoder does not
    show it. How far the arm gets, hence its mean load, depends on the friction: the set effort of
    such a test is not the experimenter's.
    """
    load, applied = trial.load_effort[start:stop], trial.applied[start:stop]
    return float(np.ptp(load)) > STEADY * abs(float(np.mean(applied)))


def _longest_steady(speed: FloatArray, noise: float) -> tuple[int, int]:
    """The longest run [first, last) of blocks that stay within 5 % of its mid-range speed."""
    best, first = (0, 0), 0
    for last in range(1, len(speed) + 1):
        while not _is_steady(speed[first:last], noise):
            first += 1
        if last - first > best[1] - best[0]:
            best = (first, last)
    return best


def _is_steady(speed: FloatArray, noise: float) -> bool:
    high, low = float(np.max(speed)), float(np.min(speed))
    return high - low <= STEADY * (high + low) + 2.0 * noise


def sliding_points(
    trials: Sequence[Recording], inertia: float | None, units: MotionUnits, notices: list[str]
) -> tuple[SlidingPoints | None, list[TrialUse]]:
    """One point per trial; trials that stall or are unusable are excluded, with a notice.

    Where most trials are not steady, the steady ones are excluded and the points have each
    trial's own law of friction over speed.
    """
    uses = [_use(trial, inertia) for trial in trials]
    for use in uses:
        if not use.used:
            notices.append(f"{use.title}: excluded from sliding friction, {use.reason}")
    within = _keep_one_method(uses, notices)
    if inertia is None and any(use.used for use in uses):
        notices.append(
            "the rig file gives no inertia: the change of momentum over each interval is neglected"
        )
    used = [use.values for use in uses if use.used]
    if not used:
        return None, uses
    # Only unsteady trials have their own law.
    shared = set(used[0]).intersection(*used)
    table = {key: np.array([row[key] for row in used]) for key in shared}
    set_effort = table["motor"] - table["gravity"]
    applied = set_effort + table["cylinder"]
    if _spread(set_effort) < 0.3 * _spread(applied):
        # The cylinder, not the motor, determines the levels.
        set_effort = applied
    labels = tuple(use.label for use in uses if use.used)
    direction = np.sign(table["speed"])
    laws = (table["intercept"], table["slope"]) if within else None
    points = SlidingPoints(labels, direction, set_effort, table["friction"], table["speed"], laws)
    return points, uses


def levels_of_tests(trials: Sequence[Recording]) -> list[Recording]:
    """Each stretch of constant effort as a separate trial, of tests that hold several, as far as
    its speed becomes steady; tests of one level as they are."""
    found: list[Recording] = []
    for trial in trials:
        levels = [part for part in _levels(trial) if _is_settled(part)]
        found += levels if len(levels) > 1 else [trial]
    return found


def _levels(trial: Recording) -> Iterator[Recording]:
    """The stretches in which the motor's effort stays at a level other than zero."""
    drive = trial.motor
    tolerance = level_tolerance(drive)
    steps = np.flatnonzero(np.abs(np.diff(drive)) > tolerance) + 1
    bounds = np.concatenate([[0], steps, [len(drive)]])
    number = 0
    for start, stop in pairwise(bounds.tolist()):
        own = drive[start:stop]
        long_enough = (stop - start) * trial.period >= 2 * _SHORTEST_BLOCKS * _block_s(trial)
        if not long_enough or np.ptp(own) > 2.0 * tolerance or abs(own[0]) <= tolerance:
            continue
        number += 1
        yield trial.part(start, stop, f"{trial.label} level {number}".strip())


def _is_settled(trial: Recording) -> bool:
    stretch = find_stretch(trial)
    return not isinstance(stretch, str) and stretch.steady


def _keep_one_method(uses: Sequence[TrialUse], notices: list[str]) -> bool:
    """Whether to fit within the trials (most are unsteady); steady ones are then excluded."""
    used = [use for use in uses if use.used]
    unsteady = [use for use in used if not use.values["steady"]]
    if not unsteady:
        return False
    if 2 * len(unsteady) <= len(used):
        notices.append(
            f"{titles(unsteady)}: the speed is not steady; the change of momentum is accounted for"
        )
        return False
    notices.append(
        f"{len(unsteady)} of {len(used)} constant-effort tests are not steady: friction is taken "
        "from the change of speed within each of them"
    )
    for use in used:
        if use.values["steady"]:
            use.exclude(
                "its speed is steady: friction is taken from the change of speed, as most tests "
                "are not steady"
            )
    return True


def _spread(values: FloatArray) -> float:
    return float(np.ptp(values))


def _use(trial: Recording, inertia: float | None) -> TrialUse:
    use = TrialUse(trial.label, trial.source, SLIDING)
    stretch = find_stretch(trial)
    if isinstance(stretch, str):
        use.exclude(stretch)
        return use
    if not stretch.steady and inertia is None:
        use.exclude("its speed is not steady, and the rig file gives no inertia")
        return use
    if inertia is None:
        stretch = _as_settled(trial, stretch)
    balance = momentum_balance(trial, stretch.start, stretch.stop, inertia)
    use.values = balance
    if balance["friction"] * balance["speed"] <= 0.0:
        use.exclude(
            "its effort does not drive its motion: the sign of the effort or of the position is "
            "reversed, a pressure or the effort is wrong, or a load is missing from the rig file"
        )
        return use
    if not stretch.steady and inertia is not None:
        law = trial_law(trial, stretch.start, stretch.stop, inertia)
        balance |= {"intercept": law[0], "slope": law[1]}
    ends = {"start_s": stretch.start * trial.period, "stop_s": stretch.stop * trial.period}
    use.values = balance | ends | {"steady": float(stretch.steady), "drift": stretch.drift}
    return use
