"""A recording's motion under a zero-phase filter, and the samples of it that count in a balance.

Both sides of a balance of efforts go through the same filter: the efforts, and every term of the
motion, sign(v) among them, so that a reversal within the filter's length biases nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from sysid import signals
from sysid.recording.recording import Recording
from sysid.types import BoolArray, FloatArray, IntArray

REST_NOISE_TIMES = 5.0
_REST_SHARE = 0.5
_HALVINGS = 6
# Lengths of the filter within which the speed may change: it smears a motion that is faster.
_LENGTHS = 3.0
# What the default filter resolves, or a wider one for a fast motion, whatever a balance's cut-off;
# what is shorter is a turn. With a quarter of its own filter, 12.5 ms at 20 Hz, a quadratic drag of
# an axis was missed.
_SHORTEST_S = 1.0 / (signals.PER_LENGTH * signals.DEFAULT_CUTOFF_HZ)
RULE = (
    f"samples are used where the filtered speed exceeds {REST_NOISE_TIMES:g} times its own noise; "
    f"where it does not for at least {1000.0 * _SHORTEST_S:g} ms the shaft may be "
    "at rest, with friction anywhere up to static friction, and these samples are excluded, with "
    "the filter's length on either side, as are samples within 1 % of the stroke from an end stop "
    f"and the ends of the log; under a cut-off below {signals.DEFAULT_CUTOFF_HZ:g} Hz a reversal "
    "counts as such a rest where enough samples remain"
)


@dataclass(frozen=True, eq=False)
class FilteredMotion:
    """The motion of a recording after a low-pass of `cutoff_hz` (one pass), (n,) each."""

    recording: Recording
    cutoff_hz: float

    def smooth(self, values: FloatArray) -> FloatArray:
        """Values (n,) or (n, m) through the filter."""
        return signals.lowpass(values, self.recording.period, self.cutoff_hz)

    @cached_property
    def position(self) -> FloatArray:
        """rad or m."""
        return self.smooth(self.recording.position)

    @cached_property
    def speed(self) -> FloatArray:
        """rad/s or m/s."""
        return signals.first_derivative(self.position, self.recording.period)

    @cached_property
    def acceleration(self) -> FloatArray:
        """rad/s2 or m/s2."""
        return signals.second_derivative(self.position, self.recording.period)

    @cached_property
    def way(self) -> FloatArray:
        """The speed's sign, filtered."""
        return self.smooth(np.sign(self.speed))

    @property
    def length(self) -> int:
        """Samples over which the filter spreads an event."""
        return signals.filter_length(self.recording.period, self.cutoff_hz)

    @property
    def speed_noise(self) -> float:
        """Standard deviation of the speed's noise, rad/s or m/s."""
        return self._noise[0]

    @property
    def acceleration_noise(self) -> float:
        """Standard deviation of the acceleration's noise, rad/s2 or m/s2."""
        return self._noise[1]

    @cached_property
    def _noise(self) -> tuple[float, float]:
        """The noise (std) of the filtered channels, from that of the measured ones."""
        own = self.recording
        if own.speed_noise is None:
            measured = own.position_noise
            gains = _noise_gains(own.period, self.cutoff_hz, own.stride, own.spline)
        else:
            measured, gains = own.speed_noise, _noise_gains_of_speed(own.period, self.cutoff_hz)
        return measured.total * gains[0], measured.total * gains[1]

    @property
    def noise_power(self) -> float:
        """Share of the variance of white noise that passes the filter."""
        return _noise_power(self.recording.period, self.cutoff_hz)

    @property
    def rest_speed(self) -> float:
        """The speed below which the shaft may rest, rad/s or m/s."""
        return REST_NOISE_TIMES * self.speed_noise

    @property
    def travel_speed(self) -> float:
        """The speed above which half of the way is travelled, however long the shaft rests."""
        speeds = np.sort(np.abs(self.speed))
        way = np.cumsum(speeds)
        return float(speeds[np.searchsorted(way, 0.5 * way[-1])])

    @property
    def speed_power(self) -> float:
        """Mean square of the speed without its noise, (rad/s)2 or (m/s)2."""
        return max(float(np.mean(self.speed**2)) - self.speed_noise**2, 0.0)

    @property
    def acceleration_power(self) -> float:
        """Mean square of the acceleration without its noise, (rad/s2)2 or (m/s2)2."""
        return max(float(np.mean(self.acceleration**2)) - self.acceleration_noise**2, 0.0)

    @cached_property
    def counts(self) -> BoolArray:
        """Samples (n,) that count, by `RULE`."""
        own = self.recording
        shortest = min(_SHORTEST_S, 1.0 / (signals.PER_LENGTH * self.cutoff_hz))
        rests = signals.slow_stretches(self.speed, self.rest_speed, round(shortest / own.period))
        found = self._clear_of(rests | ~own.inside | own.lost)
        if self.cutoff_hz < signals.DEFAULT_CUTOFF_HZ:
            # So long a filter smears a rest at a reversal until it looks like one without.
            turns = np.flatnonzero(np.diff(np.sign(self.speed)))
            doubtful = np.zeros(len(found), dtype=bool)
            doubtful[turns] = True
            clear = found & self._clear_of(doubtful)
            if np.count_nonzero(clear) >= signals.MIN_SAMPLES * self._step:
                return clear
        return found

    def _clear_of(self, rows: BoolArray) -> BoolArray:
        """Samples (n,) farther than the filter's length from these rows and from the ends."""
        found = signals.widened(rows, self.length)
        found[: self.length] = found[-self.length :] = True
        return ~found

    @property
    def _step(self) -> int:
        """Samples from one that is kept to the next."""
        return max(1, self.length // signals.PER_LENGTH)

    @property
    def rows(self) -> IntArray:
        """Samples that count, thinned to `signals.PER_LENGTH` of each length of the filter."""
        return np.flatnonzero(self.counts)[:: self._step]


def fastest_cutoff(recording: Recording) -> float:
    """The highest cut-off, Hz, that stays clear of the Nyquist frequency of the readings."""
    return signals.highest_cutoff(recording.stride * recording.period)


def default_cutoff(recording: Recording, highest_hz: float) -> float:
    """The highest cut-off up to `highest_hz`, Hz, at which the motion exceeds the noise.

    It stays clear of the Nyquist frequency of the position's readings, and is halved until the
    limit of rest is well below the speeds of the motion. Longer filters smear a motion in bursts:
    where so few samples count that none of it is used, the cut-off with most of them is taken.
    """
    cutoff = min(highest_hz, fastest_cutoff(recording))
    tried = [FilteredMotion(recording, cutoff)]
    for _ in range(_HALVINGS):
        if tried[-1].rest_speed < _REST_SHARE * tried[-1].travel_speed:
            break
        tried.append(FilteredMotion(recording, 0.5 * tried[-1].cutoff_hz))
    if len(tried) > 1 and len(tried[-1].rows) < signals.MIN_SAMPLES:
        return max(tried, key=lambda motion: len(motion.rows)).cutoff_hz
    return tried[-1].cutoff_hz


def cutoff_for_fast(recordings: Sequence[Recording], usual_hz: float) -> float:
    """A cut-off above the usual one, Hz, for motion that it would smear; else the usual one.

    Where the speed changes within few lengths of the filter (its RMS over the acceleration's), the
    cut-off is doubled as long as a further octave holds more of the acceleration than of its noise.
    """
    highest, cutoff = min(map(fastest_cutoff, recordings), default=usual_hz), usual_hz
    motions = [FilteredMotion(own, cutoff) for own in recordings]
    speeds, changes = (
        sum(getattr(m, power) for m in motions) for power in ("speed_power", "acceleration_power")
    )
    if not speeds * cutoff**2 < changes * _LENGTHS**2:
        return usual_hz
    while 2.0 * cutoff <= highest:
        wider = [FilteredMotion(own, 2.0 * cutoff) for own in recordings]
        pairs = list(zip(motions, wider, strict=True))
        more = sum(w.acceleration_power - m.acceleration_power for m, w in pairs)
        noise = sum(w.acceleration_noise**2 - m.acceleration_noise**2 for m, w in pairs)
        if more <= noise:
            break
        cutoff, motions = 2.0 * cutoff, wider
    return cutoff


@lru_cache(maxsize=32)
def _noise_power(period: float, cutoff_hz: float) -> float:
    """Variance of white noise after the filter, over that before it."""
    half = 10 * signals.filter_length(period, cutoff_hz)
    impulse = np.zeros(2 * half + 1)
    impulse[half] = 1.0
    return float(np.sum(signals.lowpass(impulse, period, cutoff_hz) ** 2))


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

    Where samples are interpolated linearly between readings `stride` samples apart, a reading's
    error affects all samples up to the neighbouring readings; the mean square is taken over the
    sample's place between two readings. Likewise for a spline through readings `spline` samples
    apart (0: not a spline).
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
