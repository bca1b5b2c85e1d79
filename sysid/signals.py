"""Signal processing shared by the pipelines.

Zero-phase low-pass filtering (thesis 3.7.2 and 4.2.2: second order Butterworth, 50 Hz),
derivatives on the uniform grid, uniform resampling, and two properties of a channel,
estimated from its samples: the quantum (resolution) and the noise floor.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from sysid.errors import input_error
from sysid.types import ComplexArray, FloatArray

DEFAULT_CUTOFF_HZ = 50.0
PER_LENGTH = 4
"""Rows that are kept of each `filter_length`, which the filter leaves nearly independent."""
FILTER_ORDER = 2
# Below this share of the Nyquist frequency the filter cannot be computed.
_LEAST_SHARE = 1e-7
MIN_SAMPLES = 50
"""A recording or a segment with fewer shows no motion: a filter and its ends leave too little."""
# Jitter of time stamps from rounding, as a share of a period; it is ignored.
JITTER_IGNORED = 1e-3
# Multiple of the median step: half way to a step in which a sample is missing.
SAMPLE_MISSING = 1.5
# A gap of this many sampling periods is a pause in the recording.
PAUSE = 3.0
# Fewest samples with which noise can be distinguished from motion.
FEWEST_FOR_NOISE = 16
# Resolution of a spectrum over the position.
_MOST_CELLS = 2**17
# A channel in so many repeats a reading that often by chance.
_BY_CHANCE = 1e-3
# The median of a normal deviate's size, in its standard deviation.
_MEDIAN_DEVIATION = NormalDist().inv_cdf(0.75)
MEDIAN_OF_SQUARES = _MEDIAN_DEVIATION**2
"""The median of a squared normal deviate, over its mean."""
# Of the variance by means: where that by medians is less, jumps make up most of the means. Of
# noise with heavy tails (Laplace, Student's of 3 degrees) it is above one half.
_JUMPS = 0.25
_Mean = Callable[..., Any]


def lowpass(values: FloatArray, period: float, cutoff_hz: float | None = None) -> FloatArray:
    """Zero-phase second-order Butterworth low-pass, run forwards and backwards.

    `values` (n,) or (n, m), filtered along the first axis; `period` s; `cutoff_hz` is the
    cut-off of one pass, so that the two passes together halve the amplitude there; None: the usual
    one, 50 Hz, or as much lower as it takes to stay clear of the Nyquist frequency.
    Raises InputError when the cut-off does not lie below the Nyquist frequency.
    """
    from scipy import signal

    nyquist = 0.5 / period
    if cutoff_hz is None:
        cutoff_hz = usual_cutoff(period)
    if not 0.0 < cutoff_hz < nyquist:
        raise input_error(
            f"cut-off {cutoff_hz:g} Hz",
            f"does not lie between 0 and the Nyquist frequency, {nyquist:g} Hz",
            "choose a lower cut-off or log faster",
        )
    if cutoff_hz < _LEAST_SHARE * nyquist:
        raise input_error(
            f"cut-off {cutoff_hz:g} Hz",
            f"is less than {_LEAST_SHARE:g} of the Nyquist frequency, {nyquist:g} Hz",
            "choose a higher cut-off, or correct the time stamps",
        )
    x = np.asarray(values, dtype=float)
    if len(x) < 4:
        return x.copy()
    sections, settled = _butterworth(cutoff_hz / nyquist)
    pad = min(len(x) - 1, 3 * filter_length(period, cutoff_hz))
    # As `scipy.signal.sosfiltfilt` with odd padding, which designs its start anew at each call.
    filtered = np.concatenate([2.0 * x[0] - x[pad:0:-1], x, 2.0 * x[-1] - x[-2 : -2 - pad : -1]])
    start = settled.reshape(*settled.shape, *[1] * (x.ndim - 1))
    for _ in range(2):
        filtered, _ = signal.sosfilt(sections, filtered, axis=0, zi=start * filtered[0])
        filtered = filtered[::-1]
    return np.array(filtered[pad : pad + len(x)], dtype=float)


def highest_cutoff(period: float) -> float:
    """The highest cut-off, Hz, that stays clear of the Nyquist frequency of samples every s."""
    return 0.2 / period


def usual_cutoff(period: float) -> float:
    """The cut-off, Hz, for samples every s where nothing asks for another."""
    return min(DEFAULT_CUTOFF_HZ, highest_cutoff(period))


@lru_cache(maxsize=64)
def _butterworth(share: float) -> tuple[FloatArray, FloatArray]:
    """Sections of the filter with a cut-off of this share of the Nyquist frequency, and their
    states at rest on an input of one.
    """
    from scipy import signal

    sections = signal.butter(FILTER_ORDER, share, output="sos")
    return sections, signal.sosfilt_zi(sections)


def filter_length(period: float, cutoff_hz: float) -> int:
    """Samples over which `lowpass` spreads an event: one period of the cut-off.

    The impulse response of the two passes has fallen below 1 % of its peak there.
    """
    return max(1, math.ceil(1.0 / (cutoff_hz * period)))


def filtered_speed(position: FloatArray, period: float) -> FloatArray:
    """Speed (n,), per second, of a position (n,) after `lowpass` with its usual cut-off."""
    return first_derivative(lowpass(position, period), period)


def first_derivative(values: FloatArray, period: float) -> FloatArray:
    """Central difference on the uniform grid, (n,) per second; second order at the ends."""
    order: Literal[1, 2] = 2 if len(values) > 2 else 1
    slope = np.gradient(values, period, axis=0, edge_order=order)
    return np.asarray(slope, dtype=np.float64)


def integral(time: FloatArray, values: FloatArray) -> FloatArray:
    """Integral (n,) from the first row on of values (n,) at times (n,) s, by trapezoids."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def second_derivative(values: FloatArray, period: float) -> FloatArray:
    """Three-point second difference, (n,) per second squared; the ends repeat theirs."""
    x = np.asarray(values, dtype=float)
    if len(x) < 3:
        return np.zeros_like(x)
    inner = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / period**2
    return np.concatenate([inner[:1], inner, inner[-1:]])


@overload
def recursion(factors: FloatArray, inputs: FloatArray) -> FloatArray: ...
@overload
def recursion(factors: ComplexArray, inputs: ComplexArray) -> ComplexArray: ...
def recursion(factors: Any, inputs: Any) -> Any:
    """x (n,) with x[0] = inputs[0] and x[k] = factors[k] x[k-1] + inputs[k], real or complex."""
    from scipy.linalg.lapack import dtbtrs, ztbtrs

    # A triangular system of two diagonals, which is solved one sample after the other. A filter
    # takes as long, and to import `scipy.signal` takes as long as hundreds.
    bands = np.ones((2, len(inputs)), dtype=factors.dtype)
    bands[1, :-1] = -factors[1:]
    solve = ztbtrs if np.iscomplexobj(factors) else dtbtrs
    return np.asarray(solve(bands, inputs[:, None], uplo="L", diag="U")[0][:, 0])


def uniform_grid(time: FloatArray) -> FloatArray:
    """Evenly spaced times (s) that span `time`, in steps as close to its median as possible."""
    span = float(time[-1] - time[0])
    steps = max(1, round(span / float(np.median(np.diff(time)))))
    return np.asarray(np.linspace(time[0], time[-1], steps + 1))


def is_even(time: FloatArray, grid: FloatArray) -> bool:
    """Whether times (n,) s are those of an even `grid` but for rounding."""
    near = len(grid) == len(time)
    return near and bool(np.max(np.abs(grid - time)) < JITTER_IGNORED * float(grid[1] - grid[0]))


def pauses(time: FloatArray) -> NDArray[np.intp]:
    """Rows (k,) of times (n,) s after which the recording pauses: no sample for three periods."""
    steps = np.diff(time)
    # Most recordings have none, which needs no median.
    if not len(steps) or steps.max() <= PAUSE * steps.min():
        return np.zeros(0, np.intp)
    return np.flatnonzero(steps > PAUSE * np.median(steps))


def in_pauses(time: FloatArray, grid: FloatArray) -> NDArray[np.bool_]:
    """Which of the times `grid` (m,) s lie within a pause of the rows at `time` (n,) s."""
    row = np.searchsorted(time, grid, side="right") - 1
    return np.asarray(np.isin(row, pauses(time)) & (grid > time[row]))


def between_pauses(time: FloatArray) -> list[NDArray[np.intp]]:
    """The rows of each part of a recording (n,) s that no pause interrupts, in their order."""
    return np.split(np.arange(len(time)), pauses(time) + 1)


def resample(
    time: FloatArray, values: FloatArray, grid: FloatArray, *, hold: bool = False
) -> FloatArray:
    """`values` (n,) sampled at `time` (n,), taken at `grid` (m,) s.

    `hold` is for commands, which stay from their row to the next; measured signals are
    joined by a cubic spline, across a pause by a straight line. Time stamps with a jitter below a
    thousandth of a period count as even, and the samples are returned unchanged.
    """
    if is_even(time, grid):
        return np.asarray(values, dtype=float)
    if hold:
        rows = np.searchsorted(time, grid + 1e-9 * (grid[1] - grid[0]), side="right") - 1
        held = np.clip(rows, 0, len(time) - 1)
        return np.asarray(np.asarray(values, dtype=float)[held])
    from scipy.interpolate import CubicSpline

    values = np.asarray(values, dtype=float)
    found = np.interp(grid, time, values)
    for rows in between_pauses(time):
        if len(rows) > 1:
            own = (grid >= time[rows[0]]) & (grid <= time[rows[-1]])
            found[own] = CubicSpline(time[rows], values[rows])(grid[own])
    return np.asarray(found)


def strongest_waves(
    place: FloatArray, values: FloatArray, lowest: float, highest: float, count: int
) -> list[float]:
    """Wave numbers, rad per unit of `place` (n,), at which `values` (n,) over it peak most.

    At most `count` from `lowest` to `highest`, the strongest first; by a parabola through the
    spectrum's logarithm at a peak, as the visited stretch makes a line wide.
    """
    travel = float(np.ptp(place))
    if not travel > 0.0:
        return []
    cells = min(_MOST_CELLS, 2 ** math.ceil(math.log2(max(2.0 * travel * highest / math.pi, 2.0))))
    cell = np.minimum((place - place.min()) / travel * cells, cells - 1).astype(np.intp)
    # Padded, so that a peak lies within a quarter of the line's width.
    waves = 2.0 * math.pi / travel * np.arange(2 * cells + 1) / 4.0
    power = np.abs(np.fft.rfft(np.bincount(cell, values, cells), 4 * cells)) ** 2
    inner = power[1:-1]
    peak = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    peak = peak[(waves[peak] >= lowest) & (waves[peak] <= highest)]
    peak = peak[np.argsort(-power[peak])[:count]]
    below, here, above = np.log(np.maximum(power[[peak - 1, peak, peak + 1]], 1e-300))
    bend = 2.0 * here - below - above
    found = waves[peak] + waves[1] * 0.5 * (above - below) / np.where(bend > 0.0, bend, 1.0)
    return [float(wave) for wave in np.clip(found, lowest, highest)]


def held_about_rows(command: FloatArray) -> FloatArray:
    """A command (n,) centred on each row: the mean of its value before and after the row."""
    return np.asarray(0.5 * (command + np.concatenate([command[:1], command[:-1]])))


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """[first, last) of every run of set samples of a mask (n,), in their order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(mask, dtype=np.int8), [0]])))
    return [(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def long_runs(mask: NDArray[np.bool_], least: int) -> NDArray[np.bool_]:
    """A mask (n,) without its runs that are shorter than `least` samples."""
    kept = np.zeros(len(mask), dtype=bool)
    for start, stop in runs(mask):
        kept[start:stop] = stop - start >= least
    return kept


def widened(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """A mask (n,) extended by `reach` samples on either side of what is set."""
    count = np.concatenate([[0], np.cumsum(mask)])
    rows = np.arange(len(mask))
    high, low = np.minimum(rows + reach + 1, len(mask)), np.maximum(rows - reach, 0)
    return np.asarray(count[high] > count[low])


def slow_stretches(speed: FloatArray, limit: FloatArray | float, least: int) -> NDArray[np.bool_]:
    """Rows (n,) of possible rest: the speed within `limit` for at least `least` rows.

    At a reversal the speed is low for fewer.
    """
    return long_runs(np.abs(speed) <= limit, max(1, least))


def longest_run(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """[first, last) of the longest run of set samples, the first of equals; (0, 0) without any."""
    return max(runs(mask), key=lambda run: run[1] - run[0], default=(0, 0))


def repeats_by_chance(noise: float, step: float, rows: int) -> float:
    """Equal readings in a row that a dithering sensor does not give by chance in so many rows.

    A reading repeats at most as often as noise around the middle of a step stays within the step.
    Infinite where the noise never leaves it.
    """
    same = math.erf(0.5 * step / (math.sqrt(2.0) * noise)) if noise > 0.0 else 1.0
    if same >= 1.0:
        return math.inf
    return math.ceil(math.log(_BY_CHANCE / rows) / math.log(same)) if same > 0.0 else 1.0


def is_cut_off(values: FloatArray, run: tuple[int, int], noise: NoiseFloor, repeats: int) -> bool:
    """Whether equal readings, rows [first, last), are a sensor's end and not where `values` settle.

    Either noise would have broken them, as it does elsewhere, where no reading is repeated more
    than `repeats` times in a row; or the signal came at speed: it still had to go more than twice
    its last step, as its last two steps show. What settles has less ahead of it, whether it does so
    as an exponential, whose steps shrink by one ratio, or as a parabola.
    """
    first, last = run
    # Runs vary: so many times the longest that noise leaves elsewhere is none of them.
    by_chance = repeats_by_chance(noise.noise, noise.quantum, len(values))
    if repeats <= by_chance and last - first > 4.0 * max(repeats, by_chance):
        return True
    least = 6.0 * (noise.quantum + noise.total)
    before = np.flatnonzero(np.abs(values[:first] - values[max(first - 1, 0)]) > least)
    rows = first - 1 - int(before[-1]) if len(before) else first
    if last - first <= rows or first - 1 - 2 * rows < 0:
        return False
    last_steps = np.diff(values[[first - 1 - 2 * rows, first - 1 - rows, first - 1]])
    earlier, step = last_steps.tolist()
    ahead = step * step / (earlier - step) if abs(earlier) > abs(step) else math.inf
    return bool(step * earlier > 0.0 and abs(ahead) > 2.0 * abs(step))


def quantum(values: FloatArray) -> float:
    """Resolution of a channel, in its own unit; 0 where its values are not quantized.

    The smallest step between distinct values, refined over all of them: each step must be
    a whole multiple of it. Rounding in the file (a step of 7.854e-5 written with seven
    decimals) is allowed for.
    """
    levels = np.unique(np.asarray(values, dtype=float))
    if len(levels) < 2:
        return 0.0
    steps = np.diff(levels)
    # One unit in the last place of a double is rounding, not a converter.
    steps = steps[steps > 1e-12 * max(abs(levels[0]), abs(levels[-1]))]
    if len(steps) == 0:
        return 0.0
    smallest = float(np.median(steps[steps < 1.5 * steps.min()]))
    near = steps[steps < 20.0 * smallest]
    if len(near) < 0.5 * len(steps):
        return 0.0
    # A signal that moves by three or four counts per sample shows no single count.
    tolerance = 0.05 if len(near) > 10 else 0.01
    for part in range(1, 6):
        multiples = near * part / smallest
        whole = np.round(multiples)
        if math.sqrt(float(np.mean((multiples - whole) ** 2))) < tolerance * math.sqrt(part):
            return float(whole @ near / (whole @ whole))
    return 0.0


# Of a converter's sawtooth of error: how many harmonics, and how much is left of one that counts.
_HARMONICS, _BLURRED = 20, 1e-3


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of a channel, in its own unit.

    `noise` is the standard deviation of the random noise before the converter,
    `quantum` the converter's step (0: none found), and `total` the standard deviation of
    the whole error of one sample: sqrt(noise^2 + quantum^2/12).
    """

    noise: float
    quantum: float

    @property
    def total(self) -> float:
        return math.sqrt(self.noise**2 + self.quantum**2 / 12.0)

    def after(self, power: float) -> float:
        """Standard deviation after a filter that leaves `power` (0 to 1) of white noise's variance.

        A converter's error is white too where half a count of noise precedes it (Widrow, Kollar
        2008); of a quieter signal it stays as long as the signal stays between two counts.
        """
        of_converter = power if self.noise > 0.5 * self.quantum else 1.0
        return math.sqrt(power * self.noise**2 + of_converter * self.quantum**2 / 12.0)

    def rounding(self, values: FloatArray) -> FloatArray:
        """The mean error (n,) of a converter, with a count at 0, at true values (n,): what no
        average over samples takes away. Noise before the converter blurs it (Widrow, Kollar 2008).
        """
        if not self.quantum > 0.0:
            return np.zeros(len(values))
        found, turn = np.zeros(len(values)), 2.0 * math.pi / self.quantum
        for k in range(1, _HARMONICS + 1):
            blurred = math.exp(-0.5 * (k * turn * self.noise) ** 2)
            if blurred < _BLURRED:
                break
            found += (-1.0) ** k * blurred / (k * math.pi) * np.sin(k * turn * values)
        return self.quantum * found


def noise_floor(
    values: FloatArray,
    resolution: float | None = None,
    stride: int = 1,
    *,
    between_jumps: bool = False,
) -> NoiseFloor:
    """Noise of a uniformly sampled channel, from the channel itself.

    Differences of order 2 to 6 remove motion that is slow compared with the sampling (Gasser,
    Sroka, Jennen-Steinmetz 1986 for order 2): the smallest of the five variances is the
    one that holds the least motion. Each is the median over blocks, so that a kick or a
    jump in a few of them does not matter. Noise that a sensor or its filter has coloured
    shows only in differences over several samples: the lag is doubled as long as the
    variance settles; motion, unlike noise, would multiply it.

    The variance of the differences is not noise^2: below half a count a converter
    swallows noise or turns it into whole counts. Averaged over where the signal lies
    between two counts, what survives is

        quantum^2 h(noise/quantum),
        h(x) = x^2 + sum_k (1 - exp(-4 pi^2 k^2 x^2)) / (2 pi^2 k^2),

    (Widrow, Kollar 2008: the quantisation error's mean square less its mean's), which is
    inverted. The noise of a signal that rests between the same two counts is not
    identifiable below a third of a count; `total` never falls below the share of the
    quantisation.

    `values` (n,), n >= `FEWEST_FOR_NOISE`; `resolution` overrides the quantum found in the data.
    Of samples interpolated between measured ones only each `stride`-th is taken: those next to one
    another hold the same errors, and their differences hardly any. `between_jumps`: of a channel
    that may jump in every block, as an effort does at reversals of friction and at cogs, by medians
    of the squares; where it finds no noise so, or less than a count, that of all differences.
    """
    x = np.asarray(values, dtype=float)
    x = x[::stride] if len(x) >= FEWEST_FOR_NOISE * stride else x
    step = quantum(x) if resolution is None else resolution
    variance = _noise_variance(x, 1)
    if variance > step**2:
        variance = _settled_variance(x, variance)
    if between_jumps and (calm := _noise_variance(x, 1, _by_median)) > step**2:
        calm = _settled_variance(x, calm, _by_median)
        variance = calm if calm < _JUMPS * variance else variance
    if step * step == 0.0:  # none, or one whose square is below the smallest number
        return NoiseFloor(math.sqrt(variance), 0.0)
    return NoiseFloor(step * _noise_in_counts(variance / step**2), step)


def position_floor(values: FloatArray, stride: int = 1) -> NoiseFloor:
    """Noise of a position: that of its least change where it rests on one count most of the time.

    Such a rest shows no noise, and a fast motion in between no count.
    """
    found = noise_floor(values, stride=stride)
    if found.total > 0.0:
        return found
    steps = np.abs(np.diff(values))
    # One unit in the last place of a double is rounding, not a change.
    steps = steps[steps > 1e-12 * np.abs(values).max(initial=0.0)]
    return NoiseFloor(0.0, float(steps.min())) if steps.size else found


def travel(values: FloatArray, count: float = 0.0) -> float:
    """How far a position (n,) moves beyond what its sensor's noise and `count` alone range over.

    A potentiometer's readings of a piston that is held range over many of their own deviations,
    the more the longer it is logged; a coarse encoder flickers by a count.
    """
    spread = float(np.ptp(values))
    if len(values) < FEWEST_FOR_NOISE or not spread > 0.0:
        return max(spread - count, 0.0)
    # Of n independent normal deviates, the largest is below sqrt(2 ln n) deviations.
    reach = 2.0 * noise_floor(values).noise * math.sqrt(2.0 * math.log(len(values)))
    return max(spread - max(reach, count), 0.0)


def deviation_by_median(values: FloatArray, about: float = 0.0) -> float:
    """Standard deviation of normal `values` (n,), n > 0, by the median of their distances.

    In their unit; a few far ones hardly move it.
    """
    return float(np.median(np.abs(values - about))) / _MEDIAN_DEVIATION


def _by_median(squares: FloatArray, axis: int | None = None) -> Any:
    """The mean of squared normal deviates, by their median."""
    return np.median(squares, axis=axis) / MEDIAN_OF_SQUARES


def _settled_variance(x: FloatArray, variance: float, mean: _Mean = np.mean) -> float:
    """Variance of coloured noise: over the lag at which it has settled, before motion shows."""
    found = [variance]
    for lag in (2, 4, 8, 16, 32):
        if len(x) < FEWEST_FOR_NOISE * lag:
            break
        found.append(_noise_variance(x, lag, mean))
    settled = variance
    for i in range(1, len(found) - 1):
        # Motion grows at least sixteenfold with a doubled lag, coloured noise by a few times.
        if found[i] > 8.0 * settled:
            break
        if found[i] > 1.1 * settled and found[i + 1] < 2.0 * found[i]:
            settled = found[i]
    return settled


def _noise_variance(x: FloatArray, lag: int, mean: _Mean = np.mean) -> float:
    """Smallest variance (of one sample) among the differences of all orders over this lag.

    `mean` of the squared differences of a block.
    """
    orders = [k for k in (2, 3, 4, 5, 6) if len(x) >= 8 + k * lag]
    return min((_difference_variance(x, k, lag, mean) for k in orders), default=0.0)


def _difference_variance(x: FloatArray, order: int, lag: int, mean: _Mean) -> float:
    """Variance of noise in `x` from its differences of one order, median over blocks."""
    for _ in range(order):
        x = x[lag:] - x[:-lag]
    squares = x**2 / math.comb(2 * order, order)
    # At most 16 blocks, of at least 64 samples.
    count = min(16, len(squares) // 64)
    if count < 3:
        return float(mean(squares))
    each, over = divmod(len(squares), count)
    longer = over * (each + 1)  # as `np.array_split`: the first blocks hold the rows that are over
    means = [
        mean(part.reshape(-1, size), axis=1)
        for part, size in ((squares[:longer], each + 1), (squares[longer:], each))
    ]
    return float(np.median(np.concatenate(means)))


def _surviving_variance(noise: float) -> float:
    """h of `noise_floor`: variance after the converter, noise and result in counts."""
    k2 = np.arange(1.0, 400.0) ** 2
    kept = (1.0 - np.exp(-4.0 * math.pi**2 * k2 * noise**2)) / (2.0 * math.pi**2 * k2)
    return float(noise**2 + kept.sum())


def _noise_in_counts(variance: float) -> float:
    """Noise (counts) that leaves this variance (counts^2): h inverted by bisection."""
    if variance <= 0.0:
        return 0.0
    low, high = 0.0, math.sqrt(variance) + 1.0
    if variance > 4.0:
        return math.sqrt(variance - 1.0 / 12.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _surviving_variance(middle) < variance:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
