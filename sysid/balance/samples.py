"""The effort balance as rows of a regression: what friction and inertia balance, sample by sample.

inertia a + coulomb sign(v) + viscous v + offset = motor + cylinder - gravity, thesis 3.4.2
with the law of 3.4.1 inserted. Both sides go through the filter of `FilteredMotion`. A command
holds from its row to the next, so that the effort at a row is the mean of the row's and the one
before; half a sample of delay would appear as viscous friction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.balance.motion import FilteredMotion
from sysid.recording.recording import Recording
from sysid.signals import MIN_SAMPLES
from sysid.types import FloatArray

COULOMB, VISCOUS, OFFSET, INERTIA = range(4)
# A direction's upper over lower quartile of speed from which a law over speed is identified.
_LEAST_SPAN = 1.5
# Correlation of speed and load beyond which the two cannot be distinguished.
_TIED = 0.6
# Of the spread of the cylinder's effort, below which a motor's drives nothing.
_OFF = 0.01
# Share of the samples of one direction beyond those of the other.
_MOST_ONE_WAY = 0.98
NAMES = ("coulomb", "viscous", "offset", "inertia")
"""The parameters whose columns the regressors are."""


@dataclass(frozen=True)
class MotionSamples:
    """One trial, filtered: regressors (n, 4) for Coulomb, viscous, offset and inertia, and
    the effort (n,) that they balance; only samples that count, thinned so that the filter
    leaves them independent. `noise` (4,) is the variance of the regressors' noise,
    `rest_speed` the rule's limit, `load` (n,) the cylinder's effort in addition to a motor's (0
    without one), `since` and `until` (n,) the distance since the last reversal of the motion and to
    the next one, infinite without one. `carried` (n, 2): the motor's effort, and that of motor and
    cylinder, its magnitude along the motion; `helped` (n, 2): what of `effort` is not that.
    `added`: the inertia of the test's payload beyond the rig file's, which `effort` is less."""

    regressors: FloatArray
    effort: FloatArray
    noise: FloatArray
    rest_speed: float
    load: FloatArray
    since: FloatArray
    until: FloatArray
    carried: FloatArray
    helped: FloatArray
    added: float

    @property
    def speed(self) -> FloatArray:
        """(n,), in the rig's unit."""
        return self.regressors[:, VISCOUS]

    def kept(self, rows: NDArray[np.bool_]) -> MotionSamples:
        """These samples (n,) only."""
        return replace(
            self,
            regressors=self.regressors[rows],
            effort=self.effort[rows],
            load=self.load[rows],
            since=self.since[rows],
            until=self.until[rows],
            carried=self.carried[rows],
            helped=self.helped[rows],
        )


def motion_samples(recording: Recording, cutoff_hz: float) -> MotionSamples:
    """Filter both sides of the effort balance and select the samples that count."""
    motion = FilteredMotion(recording, cutoff_hz)
    speed, acceleration = motion.speed, motion.acceleration
    regressors = np.column_stack([motion.way, speed, np.ones(len(speed)), acceleration])
    held, cylinder = signals.held_about_rows(recording.motor), recording.cylinder
    drive = np.column_stack([held, held + cylinder])
    carried = motion.smooth(np.abs(drive) * np.sign(speed)[:, None])
    others = [cylinder - recording.load_effort, -recording.load_effort]
    added = recording.added_inertia * acceleration
    helped = motion.smooth(np.column_stack(others)) - added[:, None]
    effort = motion.smooth(held + cylinder - recording.load_effort) - added
    rows = motion.rows
    noise = np.array([0.0, motion.speed_noise**2, 0.0, motion.acceleration_noise**2])
    since, until = _about_reversals(motion.position, speed, motion.rest_speed)
    # Where air alone drives the motion, its effort follows the speed as any effort would: this is
    # not a confounding of the two. So it is next to a motor that is logged, and stays off.
    driven = recording.has_motor and float(np.max(np.abs(held))) > _OFF * float(np.ptp(cylinder))
    load = recording.cylinder if driven else np.zeros(len(speed))
    return MotionSamples(
        regressors[rows],
        effort[rows],
        noise,
        motion.rest_speed,
        load[rows],
        since[rows],
        until[rows],
        carried[rows],
        helped[rows],
        recording.added_inertia,
    )


def _about_reversals(
    position: FloatArray, speed: FloatArray, rest_speed: float
) -> tuple[FloatArray, FloatArray]:
    """The distance since the last reversal and to the next, (n,) each, infinite without one.

    A rest after which the motion goes on as before, and the log's start, are no reversals.
    """
    moving = np.flatnonzero(np.abs(speed) > rest_speed)
    turns = np.flatnonzero(np.diff(np.sign(speed[moving])))
    # The last row of the old direction, and the first of the new one.
    before, after = moving[turns], moving[turns + 1]
    rows, none = np.arange(len(speed)), np.array([math.inf])
    came_from = np.concatenate([none, position[after - 1]])
    goes_to = np.concatenate([position[before + 1], none])
    since = np.abs(position - came_from[np.searchsorted(before, rows)])
    until = np.abs(position - goes_to[np.searchsorted(before, rows)])
    return np.asarray(since), np.asarray(until)


def only_way(speed: FloatArray) -> float:
    """The direction, 1 or -1, that speeds (n,) have, but for so few samples that they say nothing
    of the other; 0 where they have both. What friction and an offset add to is one number then."""
    mean = float(np.mean(np.sign(speed)))
    return float(np.sign(mean)) if abs(mean) > _MOST_ONE_WAY else 0.0


def _tells_speeds(speed: FloatArray, load: FloatArray) -> bool:
    """Whether speeds (n,) differ enough within a direction to identify friction over speed.

    Where a screw drives the axis at one speed each way, Coulomb friction, viscous friction
    and an offset reduce to two numbers, and the remaining variation of the speed follows the
    `load` (n,), the cylinder's effort. The effort of air that flows through open exhausts also
    follows the speed, but as its effect: it resists in both directions and is not counted.
    """
    means = [
        float(np.mean(load[way * speed > 0.0] * way))
        for way in (1.0, -1.0)
        if np.any(way * speed > 0.0)
    ]
    resists = len(means) == 2 and max(means) < 0.0
    for way in (1.0, -1.0):
        own = way * speed[way * speed > 0.0]
        pushed = load[way * speed > 0.0]
        if len(own) < MIN_SAMPLES:
            continue
        spans = np.quantile(own, 0.75) > _LEAST_SPAN * np.quantile(own, 0.25)
        steady = np.ptp(pushed) == 0.0 or np.ptp(own) == 0.0
        tied = not (steady or resists) and abs(float(np.corrcoef(own, pushed)[0, 1])) > _TIED
        if spans and not tied:
            return True
    return False


def tells_speeds(speeds: Sequence[FloatArray], loads: Sequence[FloatArray]) -> bool:
    """Whether speeds of several tests, (n,) each, identify friction over speed.

    Where their speeds differ enough, and those of one test do while they do not follow its load,
    the others do not hide it: next to one that air drives faster than the motor the other, the
    speed follows the load from test to test though it does not within each.
    """
    speed, load = np.concatenate(list(speeds)), np.concatenate(list(loads))
    if _tells_speeds(speed, load):
        return True
    return _tells_speeds(speed, np.zeros(len(speed))) and any(map(_tells_speeds, speeds, loads))
