"""Breakaway: static friction from slow ramps (thesis 3.4.2, Table 3.4.1).

The thesis stops a ramp when the shaft has moved by one encoder count. Below breakaway the
contacts deform elastically (presliding), so that criterion depends on the resolution of
the encoder. Here the onset of sustained motion is located, and the effort is taken there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.estimation.linear import (
    UNKNOWN,
    Estimate,
    FTest,
    Variance,
    indicator,
    mean_estimate,
    nested_f_test,
    satterthwaite,
    t_quantile,
)
from sysid.estimation.multiple_tests import SIGNIFICANCE
from sysid.estimation.quality import FitQuality, repeats_lack_of_fit
from sysid.identification.friction.counted_onset import (
    FEWEST,
    MOST,
    MOST_PUSHED,
    CountedStart,
    Pushed,
    begins_by_counts,
)
from sysid.identification.friction.effort import TrialUse, titles
from sysid.io.motion import MotionUnits
from sysid.recording.friction_kind import STATIC
from sysid.recording.recording import Recording
from sysid.types import BoolArray, FloatArray

# A shaft that moves by less than its noise for this long is at rest. With twice the time that a
# test's own first motion takes, static friction by 300 counts a revolution was 2.4 % too small; so
# it is within 2 %.
REST_S = 0.03
TRAVEL_SHARE = 1e-3  # of the stroke: motion beyond it is more than presliding
SUSTAINED_SHARE = 1e-2  # of the stroke: a movement that ends within it was a slip
NOISE_TIMES, QUANTUM_TIMES = 8.0, 4.0
# To tell creep a movement is looked at over so many times its presliding range, and again.
_LONGER_WAY = SUSTAINED_SHARE / TRAVEL_SHARE
AVERAGE_S = 0.2  # of the efforts before the onset
POSITION_GAP = 0.05  # of the stroke, between one start position and the next
# In a motion that grows as the cube of time the first pause between counts is up to four times the
# second.
_REST_TO_COUNT, _LEAST_COUNTS = 5.0, 8
# An effort has stopped growing if it stays this many times longer than at any of so many steps.
_LONGER, _LEAST_STEPS = 5, 20

CRITERION = (
    "onset of sustained motion: the first movement that leaves the presliding range "
    f"({TRAVEL_SHARE:g} of the stroke, or {NOISE_TIMES:g} times the position's noise, or "
    f"{QUANTUM_TIMES:g} counts) and lasts to the end of the test or for {SUSTAINED_SHARE:g} of "
    "the stroke; its start is where a motion that begins at rest fits the "
    f"position best; the efforts are those of the {AVERAGE_S:g} s before, extrapolated to it"
)


@dataclass(frozen=True)
class Onset:
    """When sustained motion starts: `time` s, `index` of the last sample before it.

    `place`, by the edges of a coarse encoder: where the shaft rested less what was read, rad or m;
    None of a fine one. `before` is a sample at which the movement has not begun.
    """

    time: float
    index: int
    direction: int
    threshold: float
    place: float | None = None
    before: int = 0

    def moved(self, trial: Recording) -> FloatArray:
        """The movement's distance (k,) from the sample before it, up to its largest."""
        distance = self.direction * (trial.position[self.before :] - trial.position[self.before])
        return np.asarray(distance[: int(np.argmax(distance)) + 1])


@dataclass(frozen=True)
class PositionMean:
    """Static friction at one position of the piston."""

    position: float
    estimate: Estimate
    count: int

    def to_json(self) -> dict[str, Any]:
        """The bundle's row: position rad or m, number of tests, static friction there."""
        return {
            "position": self.position,
            "tests": self.count,
            "static": self.estimate.to_json(),
        }


@dataclass(frozen=True)
class StaticFriction:
    """Mean static friction, and whether it depends on position or direction.

    `repeatability` is the standard deviation between trials at one position and in one
    direction. `tests` are the nested F tests by `position`, `direction` and their
    `interaction`. `repeats` is the variance from one test to the next over the square of the mean,
    `rested_in` in how many tests the shaft rested whose rests these are, 0 of ramps.
    """

    estimate: Estimate
    repeatability: float
    by_position: tuple[PositionMean, ...]
    by_direction: dict[str, Estimate]
    tests: dict[str, FTest]
    notices: tuple[str, ...] = ()
    quality: FitQuality | None = None
    criterion: str = CRITERION
    repeats: Variance = UNKNOWN
    rested_in: int = 0

    def with_scatter(self, sliding: Variance) -> StaticFriction:
        """With the error of a mean over so few tests, whose friction differs by what these rests
        show and by what the `sliding` friction of the same tests does (relative variance): all
        rests of a test have its friction. That of ramps, a test each, has it already.
        """
        repeats = self.repeats.pooled(sliding)
        if not self.rested_in or not repeats.dof:
            return self
        own = self.estimate
        shares = np.array([own.std**2, own.value**2 * repeats.value / self.rested_in])
        known = own.degrees_of_freedom if own.has_error else math.inf
        dof = satterthwaite(shares, np.array([known, repeats.dof]))
        std = float(np.sqrt(shares.sum()))
        found = Estimate.symmetric(own.value, std, own.unit, dof)
        if math.isinf(own.interval[1]):  # a limit that the tests do not set
            found = replace(found, interval=(found.interval[0], math.inf))
        return replace(self, estimate=found)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Repeatability and tests, one line each."""
        unit = self.estimate.unit
        lines = [f"static friction repeats to {self.repeatability:.3g} {unit} (one std)"]
        if not math.isfinite(self.repeatability):
            lines = ["static friction: no test repeats another, so that its scatter is not known"]
        for factor, test in self.tests.items():
            verdict = "matters" if self.matters(factor) else "is not significant"
            lines.append(
                f"static friction: {factor} {verdict} (F = {test.statistic:.3g} with "
                f"{test.dof_numerator} and {test.dof_denominator} degrees of freedom, "
                f"p = {test.p_value:.2g})"
            )
        return tuple(lines)

    def matters(self, factor: str) -> bool:
        test = self.tests.get(factor)
        return test is not None and test.p_value < SIGNIFICANCE


def fit_static(
    trials: Sequence[Recording], units: MotionUnits, notices: list[str]
) -> tuple[StaticFriction | None, list[TrialUse]]:
    """Static friction from ramps; None where none of them moved."""
    uses = [breakaway(trial, units) for trial in trials]
    for use in uses:
        if not use.used:
            notices.append(f"{use.title}: excluded from static friction, {use.reason}")
    used = [use for use in uses if use.used]
    if not used:
        return None, uses
    stopped = [use for use in used if use.has_stopped]
    if stopped:
        largest = max(abs(use.values["breakaway"]) for use in stopped)
        notices.append(
            f"static friction: the effort had stopped growing before the shaft moved in "
            f"{titles(stopped)}; if the recording clips it ({largest:.3g} {units.effort}), "
            "static friction is larger"
        )
    values = np.array([abs(use.values["breakaway"]) for use in used])
    starts = np.array([use.values["position"] for use in used])
    still = max(use.values["travel_threshold"] for use in used)
    places = _places(starts, trials[0].rig.travel, still)
    directions = np.array([use.values["direction"] for use in used])
    found = static_summary(values, starts, places, directions, units.effort)
    crept = [use for use in used if "creep_low" in use.values]
    return (_with_creep(found, crept, len(used)) if crept else found), uses


def _with_creep(found: StaticFriction, crept: Sequence[TrialUse], used: int) -> StaticFriction:
    """With the error of ramps that crept, of so many: anywhere between two efforts in each, and
    alike in all, so that it is no smaller in a mean."""
    low, high = (np.array([use.values[f"creep_{end}"] for use in crept]) for end in ("low", "high"))
    reach = float(np.sum(high - low)) / (2.0 * used)

    def less_certain(one: Estimate) -> Estimate:
        return one.with_uniform_error(reach).within(0.0, math.inf)

    unit = found.estimate.unit
    notice = (
        f"static friction: the shaft creeps before it breaks away in {titles(crept)}, at an effort "
        f"between {float(np.median(low)):.3g} and {float(np.median(high)):.3g} {unit}; slower "
        "ramps show it more sharply"
    )
    return replace(
        found,
        estimate=less_certain(found.estimate),
        by_position=tuple(replace(p, estimate=less_certain(p.estimate)) for p in found.by_position),
        by_direction={way: less_certain(e) for way, e in found.by_direction.items()},
        notices=(*found.notices, notice),
    )


def breakaway(trial: Recording, units: MotionUnits) -> TrialUse:
    """One ramp's breakaway effort, signed, in `values`; or why it is excluded."""
    use = TrialUse(trial.label, trial.source, STATIC)
    found = find_onset(trial)
    if isinstance(found, str):
        use.exclude(found)
        return use
    onset = found
    first = max(0, onset.index + 1 - round(AVERAGE_S / trial.period))
    window = slice(first, onset.index + 1)
    times = trial.time[window]
    # A command holds from its row to the next: friction lies between the last two. Where a fine
    # encoder shows the motion, its start is found early by as much, as drag bends it.
    lag = 0.0 if onset.place is None else 0.5 * trial.period
    motor = _carried_on(times, trial.motor[window], onset.time - lag)
    cylinder = _carried_on(times, trial.cylinder[window], onset.time)
    at_rest = trial.with_position(trial.position + (onset.place or 0.0))
    effort = motor + cylinder - float(np.mean(at_rest.load_effort[window]))
    creep = _creep(trial, onset)
    if creep:
        effort = onset.direction * (creep["creep_low"] + creep["creep_high"]) / 2.0
    use.values = {"breakaway": effort, "direction": float(onset.direction)}
    if effort * onset.direction <= 0.0:
        use.exclude(
            f"it moved against the applied effort ({effort:.3g} {units.effort}): is the sign of "
            "the effort or of the position reversed, or is a load or the vertical orientation "
            "missing from the rig file?"
        )
        return use
    use.values |= {
        "position": float(trial.position[0]),
        "onset_s": onset.time,
        "travel_threshold": onset.threshold,
        **creep,
    }
    use.has_stopped = _has_stopped(trial.motor[: onset.index + 1])
    return use


def _creep(trial: Recording, onset: Onset) -> dict[str, float]:
    """The efforts along the motion before and after breakaway, `creep_low` and `creep_high`, of
    contacts that give way by more than the presliding range (seals, by a millimetre); empty of a
    movement that breaks away within it.

    From rest a ramp moves a shaft by the square to the cube of time. It crept if it has moved
    before the onset, passes a longer way later or sooner than that (friction that falls with speed
    lets it do so from rest) and at a larger effort; or if the effort doubles while it leaves the
    range. The longer way is looked at in the same manner. What is friction and what is inertia
    beyond it is not told apart: breakaway lies below the effort at which the shaft has gone it.
    """
    if onset.place is not None:
        return {}
    before = min(onset.before, onset.index)
    found, way, has_crept = replace(onset, before=before), onset.threshold, False
    moved = found.moved(trial)
    last = len(moved) - 1
    effort = onset.direction * trial.applied[before : before + len(moved)]

    def passed(distance: float) -> int:
        return int(np.argmax(moved > distance)) if moved[-1] > distance else last

    start, there = min(onset.index - before, last), passed(way)
    if effort[there] <= 0.0 or _LONGER_WAY * effort[start] < -effort[there]:
        return {}  # against the effort nothing creeps: its sign, or a load, is wrong
    while True:
        there, longer = passed(way), passed(_LONGER_WAY * way)
        is_further = moved[-1] > _LONGER_WAY * way
        own, grown, most = effort[[start, there, longer]]
        latest, soonest = ((there - start) * _LONGER_WAY ** (1.0 / k) for k in (2.0, 3.0))
        ago = max(found.index - max(longer - start, 0), 0)
        just = onset.direction * (trial.position[found.index] - trial.position[ago])
        from_rest = _LONGER_WAY * just <= way or soonest <= longer - start <= latest
        is_sharp = from_rest or not is_further or _LONGER_WAY * (most - own) <= own
        if is_sharp and grown <= 2.0 * own:
            break
        has_crept = True
        if not is_further:
            break
        way *= _LONGER_WAY
        found = _within_way(trial, found, way)
        start = min(max(found.index - before, 0), last)
    if not has_crept:
        return {}
    until = max(passed(_LONGER_WAY * way), start)
    most = float(np.max(effort[start : until + 1]))
    return {"creep_low": max(float(effort[start]), 0.0), "creep_high": most}


def breakaway_of(use: TrialUse) -> float:
    """A ramp's breakaway effort along its motion: below zero where it moved against the effort."""
    return use.values["breakaway"] * use.values["direction"]


def _has_stopped(drive: FloatArray) -> bool:
    """Whether a drive (n,) that grew before is constant at the end.

    A drive that grows in steps of that length does not count.
    """
    steps = np.flatnonzero(np.diff(drive))
    if len(steps) < _LEAST_STEPS:
        return False
    still = len(drive) - 1 - int(steps[-1])
    return still > _LONGER * int(np.max(np.diff(steps)))


def _carried_on(times: FloatArray, effort: FloatArray, when: float) -> float:
    """Effort at `when` from the samples before: their fitted line if it rises, else their mean."""
    if len(times) < 5:
        return float(effort[-1])
    t = times - times.mean()
    slope = float(t @ effort / (t @ t))
    rest = effort - effort.mean() - slope * t
    error = math.sqrt(float(rest @ rest) / (len(t) - 2) / float(t @ t))
    rises = abs(slope) > 4.0 * error
    return float(effort.mean()) + (slope * (when - float(times.mean())) if rises else 0.0)


def find_onset(trial: Recording) -> Onset | str:
    """Onset of sustained motion in a ramp, or why none was found."""
    x = trial.position
    if len(x) < 20:
        return "it is too short"
    span, counts, hold, threshold = _scales(trial)
    for start, end in signals.runs(_moves(trial, hold, threshold)):
        before = _first_of_its_counts(counts, start)
        after = min(end + hold - 1, len(x) - 1)
        travel = float(x[after] - x[before])
        to_the_end = after >= len(x) - 2
        if abs(travel) > max(threshold, 0.0 if to_the_end else SUSTAINED_SHARE * span):
            if start < hold // 2:
                return "it moves from its first samples: not at rest when the ramp starts"
            began = _by_edges(trial, counts[counts >= before])
            if began is not None:
                index = int(np.searchsorted(trial.time, began.time, side="right")) - 1
                way = 1 if travel > 0.0 else -1
                place = way * began.place * trial.position_noise.quantum
                return Onset(began.time, max(index, 1), way, threshold, place)
            return _locate(trial, _before_a_slow_start(trial, before, hold), after, threshold, hold)
    return (
        f"it never moves by more than {threshold:.2g} (noise, counts, presliding): the ramp ends "
        "below breakaway, ramp higher"
    )


def resting(trial: Recording) -> list[tuple[int, int]]:
    """The rests (first row, row after) of a test that moves in between; none of a short one."""
    if len(trial) < 20:
        return []
    _, _, hold, threshold = _scales(trial)
    rests = signals.runs(~_moves(trial, hold, threshold))
    # The window that first moves by less may have begun in the motion before.
    return [(first and first + hold // 2, stop) for first, stop in rests if stop - first >= hold]


def rested(trial: Recording, until: int) -> bool:
    """Whether the shaft rested for most of the time before a row: one that turns slowly is as slow
    as one that rests, but passes more places."""
    _, _, hold, threshold = _scales(trial)
    before = trial.position[: until + 1]
    away = float(np.median(np.abs(before - np.median(before))))
    return away <= _still(trial, hold, threshold)


def _scales(trial: Recording) -> tuple[float, NDArray[np.intp], int, float]:
    """The stroke, rad or m, the samples after which a coarse encoder counts, over how many samples
    a rest is judged, and the way beyond which a shaft has moved."""
    x, noise = trial.position, trial.position_noise
    span = trial.rig.travel if trial.rig.travel is not None else 20.0 * float(np.ptp(x))
    counts = _counts(trial, TRAVEL_SHARE * span)
    hold = max(2, round(REST_S / trial.period), _rest_in_counts(counts))
    least = NOISE_TIMES * trial.drift(hold), QUANTUM_TIMES * noise.quantum
    return span, counts, hold, max(TRAVEL_SHARE * span, *least)


def _moves(trial: Recording, hold: int, threshold: float) -> BoolArray:
    """Where a shaft moves within `hold` samples by more than one at rest does, (n - hold,)."""
    x = trial.position
    return np.asarray(np.abs(x[hold:] - x[:-hold]) > _still(trial, hold, threshold))


def _still(trial: Recording, hold: int, threshold: float) -> float:
    """By how much a shaft at rest may move within `hold` samples, rad or m."""
    return max(6.0 * trial.drift(hold), 1.5 * trial.position_noise.quantum, 0.05 * threshold)


def _counts(trial: Recording, presliding: float) -> NDArray[np.intp]:
    """Samples (k,) after which a coarse encoder counts; none of one that counts in presliding.

    The same holds for one whose noise counts. A count that the next one takes back is jitter at the
    edge of a count, not motion.
    """
    noise = trial.position_noise
    if noise.noise > 0.25 * noise.quantum or presliding > 2.0 * noise.quantum:
        return np.empty(0, dtype=np.intp)
    change = np.diff(trial.position)
    counts = np.flatnonzero(np.abs(change) > 0.5 * noise.quantum)
    sizes = np.rint(change[counts] / noise.quantum)
    kept, i = [], 0
    while i < len(counts):
        if i + 1 < len(counts) and sizes[i] == -sizes[i + 1]:
            i += 2
        else:
            kept.append(counts[i])
            i += 1
    return np.array(kept, dtype=np.intp)


def _by_edges(trial: Recording, counts: NDArray[np.intp]) -> CountedStart | None:
    """The start of the motion whose first counts are after these samples (k,); None where fewer
    than it takes go one way, or all within a row."""
    efforts = _Efforts.of(trial)
    most = MOST if efforts is None else MOST_PUSHED
    change = trial.position[counts + 1] - trial.position[counts]
    quantum = trial.position_noise.quantum
    sizes = np.rint(change / quantum).astype(np.intp)
    rows = np.repeat(counts, np.abs(sizes))[:most]
    ways = np.repeat(np.sign(sizes), np.abs(sizes))[:most]
    one_way = signals.runs(ways == ways[0])[0][1] if len(ways) else 0
    rows = rows[: max(one_way, MOST)]
    if len(rows) < FEWEST or one_way < len(rows) or rows[0] == rows[-1]:
        return None
    edges = 0.5 * (trial.time[rows] + trial.time[rows + 1])
    pushed = None
    if efforts is not None:
        places = trial.position[rows[0]] + ways[0] * quantum * (np.arange(len(rows)) + 0.5)
        pushed = efforts.along(edges, places, quantum * ways[0])
    found = begins_by_counts(edges, trial.period, pushed)
    return replace(found, time=max(found.time, float(trial.time[0])))


@dataclass(frozen=True)
class _Efforts:
    """The known efforts on a shaft of known inertia: of motor, cylinder, gravity and spring.

    Gravity, a spring and the air that the piston moves change them on a way of few counts.
    """

    trial: Recording
    inertia: float

    @staticmethod
    def of(trial: Recording) -> _Efforts | None:
        """None where the rig file declares no inertia."""
        inertia = trial.rig.total_inertia()
        if inertia is None or not trial.rig.has_declared_inertia:
            return None
        return _Efforts(trial, inertia + trial.added_inertia)

    def along(self, edges: FloatArray, places: FloatArray, count: float) -> Pushed:
        """What they do to a motion that is at `places` (k,) at its `edges` (k,), s; `count` rad or
        m, below zero where it goes down."""
        trial = self.trial
        time, period = trial.time, trial.period
        read = np.where(time > edges[0], np.interp(time, edges, places), trial.position)
        effort = trial.with_position(read).applied / (self.inertia * count)
        once = signals.integral(time, effort)
        twice = signals.integral(time, once)

        def pushed(start: FloatArray) -> FloatArray:
            begin = np.maximum(start, time[0] + period)[:, None]
            rest = np.minimum(REST_S, begin - time[0])
            at = np.interp(begin, time, once)
            held = (at - np.interp(begin - rest, time, once)) / rest  # its mean at rest
            s = edges - begin
            moved = np.interp(edges, time, twice) - np.interp(begin, time, twice) - at * s
            return np.asarray(moved - 0.5 * held * s**2)

        return pushed


def _rest_in_counts(counts: NDArray[np.intp]) -> int:
    """Samples in which the fastest motion of a trial counts three times; 0 without counts."""
    if len(counts) < _LEAST_COUNTS:
        return 0
    return 1 + int(np.min(counts[3:] - counts[:-3]))


def _first_of_its_counts(counts: NDArray[np.intp], start: int) -> int:
    """The sample before the first of the `counts` of the motion that is under way at `start`.

    Motion that grows from rest counts ever faster: a pause many times longer than the next one
    was rest, or presliding.
    """
    row = int(np.searchsorted(counts, start))
    while 0 < row < len(counts) - 1:
        before, after = counts[row] - counts[row - 1], counts[row + 1] - counts[row]
        if before > _REST_TO_COUNT * after:
            break
        row -= 1
    return min(start, int(counts[row])) if row < len(counts) else start


def _before_a_slow_start(trial: Recording, before: int, hold: int) -> int:
    """The sample at which a movement that is under way at `before` has not begun yet.

    A heavy load begins so slowly that it counts as at rest while a rest is judged. Longer and
    longer stretches before show it: where they lead back by more than presliding, they are motion.
    """
    x, row, reach = trial.position, before, 2 * hold
    _, _, _, presliding = _scales(trial)
    still = _still(trial, hold, presliding)
    while row >= reach and abs(float(x[row] - x[row - reach])) > still:
        row -= reach
        reach *= 2
    return row if abs(float(x[before] - x[row])) > presliding else before


def _locate(trial: Recording, before: int, after: int, threshold: float, hold: int) -> Onset:
    """Onset of the movement between two samples: rest, then a (t-t0)^2 + b (t-t0)^3.

    With a drop from static to Coulomb friction the acceleration jumps (a); without one it
    grows with the ramp (b). Both are non-negative in the direction of motion, and the shaft
    may creep before. Each candidate t0 is fitted by least squares over the samples from well before
    the movement to where it passes the threshold.
    """
    way = 1 if trial.position[after] > trial.position[before] else -1
    movement = Onset(float(trial.time[before]), before, way, threshold, before=before)
    return _within_way(trial, movement, threshold, 2 * hold)


def _within_way(trial: Recording, movement: Onset, way: float, least: int = 0) -> Onset:
    """Onset of a movement by its course until it has moved by more than `way`, and as long before,
    or `least` samples."""
    x, t, before = trial.position, trial.time, movement.before
    end = before + int(np.argmax(movement.moved(trial) > way))
    first = max(0, before - max(least, end - before))
    times, course = t[first : end + 1], movement.direction * (x[first : end + 1] - x[before])

    low, high = first + 2, end - 2
    if high - low < 3:
        low, high = first + 1, end
    best = _begins(times.tobytes(), course.tobytes(), low - first, high - first, trial.period)
    index = int(np.searchsorted(t, best, side="right")) - 1
    return replace(movement, time=best, index=max(index, 1))


# The fit of a ramp, the check of what it identifies and the comparison with other logs each ask.
@lru_cache(maxsize=256)
def _begins(times: bytes, course: bytes, low: int, high: int, period: float) -> float:
    """When a motion begins, s, by the doubles in `times` and `course`: in rows `low` to `high`."""
    t, x = np.frombuffer(times), np.frombuffer(course)

    def squares(t0: float) -> float:
        return _rest_then_motion(t, x, t0)

    row = _least(lambda i: squares(float(t[i])), low, high)
    return _refined(squares, float(t[row]), period)


def _least(squares: Callable[[int], float], low: int, high: int) -> int:
    """Row in [low, high) of the smallest sum of squares: coarse steps over all, then finer ones."""
    step = max(1, (high - low) // 12)
    best = min(range(low, high, step), key=squares)
    while step > 1:
        reach, step = step, max(1, step // 4)
        near = range(max(low, best - reach), min(high, best + reach + 1), step)
        best = min(near, key=squares)
    return best


def _refined(squares: Callable[[float], float], best: float, period: float) -> float:
    """Vertex of the parabola through the sum of squares at a candidate and its neighbours."""
    left, middle, right = (squares(best + k * period) for k in (-1.0, 0.0, 1.0))
    curvature = left - 2.0 * middle + right
    if curvature <= 0.0:
        return best
    return best + period * float(np.clip(0.5 * (left - right) / curvature, -0.5, 0.5))


def _rest_then_motion(times: FloatArray, course: FloatArray, t0: float) -> float:
    """Sum of squares of the best rest (with creep) and motion from t0."""
    s = np.maximum(times - t0, 0.0)
    scale = max(float(s[-1]), 1e-12)
    creep = np.minimum(times - t0, 0.0) / max(t0 - float(times[0]), 1e-12)
    share = s / scale
    columns = (np.ones_like(times), creep, share * share, share * share * share, course)
    # A rotation changes no sum of squares: five rows hold what all of them do.
    rows: FloatArray = np.asarray(np.linalg.qr(np.stack(columns, axis=1), mode="r"))
    rounding = len(times) * float(np.finfo(float).eps)
    best = math.inf
    # With both terms the sum is no larger than with either: it is asked first.
    for terms in ((0, 1, 2, 3), (0, 1, 2), (0, 1, 3)):
        own = rows[:, terms]
        solution, *_ = np.linalg.lstsq(own, rows[:, 4], rcond=rounding)
        if np.all(solution[2:] >= 0.0):
            best = min(best, float(np.sum((rows[:, 4] - own @ solution) ** 2)))
            if len(terms) == 4:
                break
    return best


def _places(starts: FloatArray, travel: float | None, still: float) -> NDArray[np.intp]:
    """Number of the position each ramp starts from, (n,); positions are separated by gaps.

    Starts within the way `still` that is no motion are one place, whatever the range of them all.
    """
    gap = POSITION_GAP * (travel if travel is not None else 2.0 * float(np.ptp(starts)))
    order = np.argsort(starts)
    place = np.zeros(len(starts), dtype=np.intp)
    place[order[1:]] = np.cumsum(np.diff(starts[order]) > max(gap, still))
    return place


def static_summary(
    values: FloatArray,
    positions: FloatArray,
    places: Sequence[Any] | NDArray[Any],
    directions: FloatArray,
    unit: str,
) -> StaticFriction:
    """Mean, repeatability and F tests of breakaway efforts, all arguments (n,).

    `values` are magnitudes; `places` labels the place of each trial, `positions` where it
    started; `directions` is +1 or -1. Where the place matters (p < 0.05), the mean's error is
    that over places as a random factor, not over trials.
    """
    place, way = indicator(places), indicator(directions)
    cell = indicator([f"{p}|{d:g}" for p, d in zip(places, directions, strict=True)])
    both = np.hstack([place, way])
    candidates = {
        "position": nested_f_test(both, way, values),
        "direction": nested_f_test(both, place, values),
        "interaction": nested_f_test(cell, both, values),
    }
    tests = {name: test for name, test in candidates.items() if test is not None}
    repeatability, dof = _within(cell, values)
    if dof == 0:
        repeatability, dof = _within(both, values)
    by_position = []
    for column in place.T.astype(bool):
        n = int(column.sum())
        mean = float(values[column].mean())
        error = repeatability / math.sqrt(n)
        estimate = Estimate.symmetric(mean, error, unit, dof)
        by_position.append(PositionMean(float(positions[column].mean()), estimate, n))
    by_position.sort(key=lambda entry: entry.position)
    by_direction = {
        f"{d:+.0f}": mean_estimate(values[directions == d], unit) for d in np.unique(directions)
    }
    result = StaticFriction(
        mean_estimate(values, unit), repeatability, tuple(by_position), by_direction, tests
    )
    judged = _quality(values, cell, repeatability if dof else None, unit)
    between = Variance((repeatability / values.mean()) ** 2, dof) if dof else UNKNOWN
    return replace(_over_places(result, values, unit), quality=judged, repeats=between)


def _quality(values: FloatArray, cell: FloatArray, scatter: float | None, unit: str) -> FitQuality:
    """How well the mean represents all places and directions."""
    test = nested_f_test(cell, np.ones((len(values), 1)), values)
    found = FitQuality.of(
        "breakaway effort",
        unit,
        values,
        values - values.mean(),
        has_constant=False,
        lack_of_fit=repeats_lack_of_fit(test),
        scatter=scatter,
    )
    return replace(found, spare=len(values) - 1)


def _within(design: FloatArray, values: FloatArray) -> tuple[float, int]:
    """Pooled standard deviation around a design's means, and its degrees of freedom."""
    fitted, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    dof = len(values) - int(rank)
    if dof == 0:
        return math.inf, 0
    return math.sqrt(float(np.sum((values - design @ fitted) ** 2)) / dof), dof


def _over_places(result: StaticFriction, values: FloatArray, unit: str) -> StaticFriction:
    """The same, with the mean's error over places where these differ; with its notices."""
    notices = []
    estimate = result.estimate
    if result.matters("position"):
        means = np.array([entry.estimate.value for entry in result.by_position])
        std = float(np.std(means, ddof=1)) / math.sqrt(len(means))
        half = t_quantile(len(means) - 1) * std
        value = float(values.mean())
        estimate = Estimate(value, std, unit, (max(value - half, 0.0), value + half))
        notices.append(
            "static friction depends on the position: use the values by position; the mean's "
            "interval is that over positions"
        )
    if result.matters("direction"):
        parts = ", ".join(f"{way}: {e.value:.4g}" for way, e in result.by_direction.items())
        notices.append(f"static friction depends on the direction ({parts} {unit})")
    return StaticFriction(
        estimate,
        result.repeatability,
        result.by_position,
        result.by_direction,
        result.tests,
        tuple(notices),
    )
