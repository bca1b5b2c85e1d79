"""Motion as regressors: both sides of the effort balance filtered, and the samples that count.

inertia a + coulomb sign(v) + viscous v + offset = motor + cylinder - gravity, thesis 3.4.2
with the law of 3.4.1 inserted. Both sides go through the same zero-phase filter: the effort,
and every regressor, sign(v) among them, so that a reversal within the filter's length biases
nothing. A command holds from its row to the next, so that the effort at a row is the mean of
the row's and the one before; half a sample of delay would appear as viscous friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.recording.recording import MIN_SAMPLES, Recording
from sysid.types import FloatArray

REST_NOISE_TIMES = 5.0
REST_S = 0.005
A_LENGTH = 4
"""Samples that are kept of each length of the filter."""
_HALVINGS = 6
_REST_SHARE = 0.5
# A direction's upper over lower quartile of speed from which a law over speed is identified.
_LEAST_SPAN = 1.5
# Correlation of speed and load beyond which the two cannot be distinguished.
_TIED = 0.6
NAMES = ("coulomb", "viscous", "offset", "inertia")
"""The parameters whose columns the regressors are."""
COULOMB, VISCOUS, OFFSET, INERTIA = range(4)

RULE = (
    f"samples count where the filtered speed exceeds {REST_NOISE_TIMES:g} times its own noise; "
    f"where it does not for at least {1000.0 * REST_S:g} ms the shaft may rest, its friction is "
    "anything up to static friction, and these samples are left out, with the filter's length on "
    "either side; so are samples within 1 % of the stroke from an end and the log's ends"
)


@dataclass(frozen=True)
class MotionSamples:
    """One trial, filtered: regressors (n, 4) for Coulomb, viscous, offset and inertia, and
    the effort (n,) that they balance; only samples that count, thinned so that the filter
    leaves them independent. `noise` (4,) is the variance of the regressors' noise,
    `rest_speed` the rule's limit, `load` (n,) the cylinder's effort next to a motor's (0 without
    one), `since` and `until` (n,) the way since the last reversal of the motion and to the next
    one, infinite where there is none."""

    regressors: FloatArray
    effort: FloatArray
    noise: FloatArray
    rest_speed: float
    load: FloatArray
    since: FloatArray
    until: FloatArray

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
        )


def motion_samples(trial: Recording, cutoff_hz: float) -> MotionSamples:
    """Filter both sides of the torque balance and select the samples that count."""
    dt = trial.period
    length = signals.filter_length(dt, cutoff_hz)
    position = signals.lowpass(trial.position, dt, cutoff_hz)
    speed = signals.first_derivative(position, dt)
    acceleration = signals.second_derivative(position, dt)
    speed_noise, acceleration_noise = _filtered_noise(trial, cutoff_hz)
    sign = signals.lowpass(np.sign(speed), dt, cutoff_hz)
    regressors = np.column_stack([sign, speed, np.ones(len(speed)), acceleration])
    effort = signals.lowpass(
        signals.held_about_rows(trial.motor) + trial.cylinder - trial.gravity, dt, cutoff_hz
    )
    effort = effort - trial.added_inertia * acceleration
    rows = np.flatnonzero(~left_out(trial, cutoff_hz))[:: max(1, length // A_LENGTH)]
    noise = np.array([0.0, speed_noise**2, 0.0, acceleration_noise**2])
    rest_speed = REST_NOISE_TIMES * speed_noise
    since, until = _about_reversals(position, speed, rest_speed)
    # The air that alone drives the motion follows its speed as every effort does: it ties nothing.
    load = trial.cylinder if trial.has_motor else np.zeros(len(position))
    return MotionSamples(
        regressors[rows],
        effort[rows],
        noise,
        rest_speed,
        load[rows],
        since[rows],
        until[rows],
    )


def _about_reversals(
    position: FloatArray, speed: FloatArray, rest_speed: float
) -> tuple[FloatArray, FloatArray]:
    """The way since the last reversal and to the next one, (n,) each, infinite without one.

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


def left_out(trial: Recording, cutoff_hz: float) -> NDArray[np.bool_]:
    """Samples (n,) that do not count, by `RULE`."""
    dt = trial.period
    length = signals.filter_length(dt, cutoff_hz)
    speed = signals.first_derivative(signals.lowpass(trial.position, dt, cutoff_hz), dt)
    rest_speed = REST_NOISE_TIMES * _filtered_noise(trial, cutoff_hz)[0]
    rests = signals.long_runs(np.abs(speed) <= rest_speed, max(1, round(REST_S / dt)))
    found = signals.widened(rests | ~trial.inside | trial.lost, length)
    found[:length] = found[-length:] = True
    return found


def fastest_cutoff(trial: Recording) -> float:
    """The highest cut-off, Hz, that stays clear of the Nyquist frequency of the readings."""
    return 0.2 / (trial.stride * trial.period)


def default_cutoff(trial: Recording, highest_hz: float) -> float:
    """The highest cut-off up to `highest_hz`, Hz, at which the motion exceeds the noise.

    It stays clear of the Nyquist frequency of the position's readings, and is halved until the
    limit of rest is well below the speeds of the motion.
    """
    dt = trial.period
    cutoff = min(highest_hz, fastest_cutoff(trial))
    for _ in range(_HALVINGS):
        speed = signals.first_derivative(signals.lowpass(trial.position, dt, cutoff), dt)
        fast = float(np.quantile(np.abs(speed), 0.5))
        noise = _filtered_noise(trial, cutoff)[0]
        if REST_NOISE_TIMES * noise < _REST_SHARE * fast:
            break
        cutoff *= 0.5
    return cutoff


def tells_speeds(speed: FloatArray, load: FloatArray) -> bool:
    """Whether speeds (n,) differ enough within a direction to identify friction over speed.

    Where a screw drives the axis at one speed each way, Coulomb friction, viscous friction
    and an offset reduce to two numbers, and the remaining variation of the speed follows the
    `load` (n,), the cylinder's effort. Air that breathes through open exhausts follows the speed,
    too, but as its effect: it resists in both directions, and does not count.
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


def _filtered_noise(trial: Recording, cutoff_hz: float) -> tuple[float, float]:
    """Noise of the filtered speed and acceleration, from that of what was measured."""
    if trial.speed_noise is None:
        measured = trial.position_noise
        gains = _noise_gains(trial.period, cutoff_hz, trial.stride, trial.spline)
    else:
        measured, gains = trial.speed_noise, _noise_gains_of_speed(trial.period, cutoff_hz)
    return measured.total * gains[0], measured.total * gains[1]


@lru_cache(maxsize=32)
def _noise_gains_of_speed(period: float, cutoff_hz: float) -> tuple[float, float]:
    """Noise of the filtered speed (-) and acceleration (1/s) over that of a measured speed,
    whose integral by trapezoids is filtered and differentiated."""
    half = 10 * signals.filter_length(period, cutoff_hz)
    impulse = np.zeros(2 * half + 1)
    impulse[half : half + 2] = 0.5 * period
    smooth = signals.lowpass(np.cumsum(impulse), period, cutoff_hz)
    inner = slice(2, -2)  # the integral ends on its step: the filter's ends see no impulse
    speed = signals.first_derivative(smooth, period)[inner]
    acceleration = signals.second_derivative(smooth, period)[inner]
    return math.sqrt(float(speed @ speed)), math.sqrt(float(acceleration @ acceleration))


@lru_cache(maxsize=32)
def _noise_gains(
    period: float, cutoff_hz: float, stride: int, spline: float = 0.0
) -> tuple[float, float]:
    """Noise of the filtered speed (1/s) and acceleration (1/s2) over that of the position.

    Of samples on the line between readings `stride` of them apart an error takes in all samples to
    the next readings: its mean square is that over where a sample lies between two of them. The
    same of a spline through readings `spline` samples apart (0: it is none).
    """
    apart = spline or float(stride)
    half = 10 * signals.filter_length(period, cutoff_hz) + math.ceil(apart)
    away = np.arange(-half, half + 1) / apart
    one = _cardinal_spline(away) if spline else np.maximum(0.0, 1.0 - np.abs(away))
    smooth = signals.lowpass(one, period, cutoff_hz)
    speed = signals.first_derivative(smooth, period)
    acceleration = signals.second_derivative(smooth, period)
    return (
        math.sqrt(float(speed @ speed) / apart),
        math.sqrt(float(acceleration @ acceleration) / apart),
    )


def _cardinal_spline(away: FloatArray) -> FloatArray:
    """The cubic spline through 1 at 0 and 0 at all other whole numbers, at `away` (n,)."""
    from scipy.interpolate import CubicSpline

    last = math.ceil(float(np.max(np.abs(away)))) + 1
    knots = np.arange(-last, last + 1.0)
    return np.asarray(CubicSpline(knots, (knots == 0.0).astype(float))(away))
