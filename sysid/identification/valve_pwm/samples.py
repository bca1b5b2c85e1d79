"""Mean flow of a pulsed valve from the pressure of constant-duty tests (thesis 3.5.3, 3.7.2).

A window of pressure gives one sample: the mean flow over it, the mean pressure, and the
flow's standard error. How:

1. A moving mean over whole PWM periods (`pulse_block`) removes the ripple of the pulses.
   Where a period is not a multiple of the sampling period, the shortest run of samples is used
   that is one of several periods (300 Hz at 1 kHz: 10 samples are 3 periods).
2. The slope of that mean over a window, by least squares, is the mean of dP/dt with
   parabolic weights; the pressure is averaged with the same weights. So a flow that is a
   straight line over pressure within the window comes out without bias.
3. A window is as long as the pressure takes for `TRAVEL_SHARE` of the range from atmosphere
to supply, and at least long enough that the noise of the slope stays small; it never crosses
   a choked boundary, where the flow jumps (thesis 3.6.6, 3.6.10).

The thesis filters with a zero-phase 50 Hz low-pass before differentiating. The least-squares
slope is a zero-phase low-pass as well, but one whose length and noise gain are known
exactly, and which does not spread the flow's jump beyond its window.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from sysid.io.rig import Air, Rig
from sysid.plant.base import CRITICAL_RATIO, flow_from_pressure_rate
from sysid.signals import deviation_by_median
from sysid.surfaces.windows import FlowWindows, slopes
from sysid.types import BoolArray, FloatArray, IntArray

TRAVEL_SHARE = 0.03
# PWM periods in the longest window, where the pressure hardly changes.
_LONGEST_WINDOW = 40
# Largest noise of a sample's flow, as a share of the flow of the fully open valve; windows are
# made long enough for it.
FLOW_NOISE_SHARE = 0.005
# Of the PWM period, for its fundamental to lie below half the sampling rate.
FEWEST_PHASES = 3
# Standard errors of white noise by which a fundamental exceeds nothing.
_FUNDAMENTAL_SHOWS = 4.0
# Length of the mean of the tests' pulse starts as unit vectors: 0 where they are anywhere, and this
# where they scatter by a twentieth of a period.
_TOGETHER = 0.95


@dataclass(frozen=True)
class PwmTest:
    """One constant-duty test of one valve with the piston held, on a uniform time grid.

    `pressure` (n,) Pa, one sample every `period` s from the test's first row; `usable` (n,)
    False where the sensor is clipped, samples are lost or the supply is another than the rig
    file's; `known` (n,) the same but for the supply. `volume` m3 of the chamber, `temperature` K,
    `supply` Pa (logged, else the rig's, both in the scale of `pressure` where that shows it),
    `line` (n,) Pa: by how much the logged supply is above it, `supply_at_start` Pa as logged (else
    the rig's), `filling`: started from the atmosphere.
    """

    label: str
    source: str
    valve: str
    filling: bool
    duty: float
    period: float
    pressure: FloatArray
    usable: BoolArray
    volume: float
    temperature: float
    supply: float
    supply_at_start: float
    supply_logged: bool
    line: FloatArray
    known: BoolArray


@dataclass(frozen=True)
class FlowSamples:
    """Samples of mean flow: `duty`, `pressure` [Pa], `flow` [kg/s], `std` [kg/s], all (n,).

    `supply` (n,) [Pa]: while the valve is open. `windows`: of which rows they are. `crosses` (n,):
    these rows lie on both sides of a choked boundary, so that the mean is of two laws. `test` (n,)
    is the number of the sample's test, an index into `labels`, `supplies` [Pa], `volumes` [m3],
    `per_flow` (tests,), k R T / V of each test's chamber, Pa/kg, and `sampling` (tests,): the
    centre of its pulses, as a share of the PWM period after a row (NaN: not known), and how many
    phases of the period its rows show.
    """

    duty: FloatArray
    pressure: FloatArray
    flow: FloatArray
    std: FloatArray
    supply: FloatArray
    windows: FlowWindows
    crosses: BoolArray
    test: IntArray
    labels: tuple[str, ...]
    supplies: tuple[float, ...]
    volumes: tuple[float, ...]
    per_flow: tuple[float, ...]
    sampling: tuple[tuple[float, int], ...]

    def __len__(self) -> int:
        return len(self.flow)

    def per_flow_of(self, test: IntArray) -> FloatArray:
        """k R T / V of the chamber of each test number (n,), Pa/kg."""
        return np.asarray(np.array(self.per_flow)[test])

    def supply_of(self, test: IntArray) -> FloatArray:
        """Supply of each test number (n,), Pa."""
        return np.asarray(np.array(self.supplies)[test])

    def part(self, rows: BoolArray | IntArray) -> FlowSamples:
        """The samples in `rows`; tests keep their numbers."""
        return FlowSamples(
            self.duty[rows],
            self.pressure[rows],
            self.flow[rows],
            self.std[rows],
            self.supply[rows],
            self.windows.select(rows),
            self.crosses[rows],
            self.test[rows],
            self.labels,
            self.supplies,
            self.volumes,
            self.per_flow,
            self.sampling,
        )


def pulse_block(pwm_period: float, period: float) -> int:
    """Samples (one every `period` s) that span whole PWM periods, up to rounding.

    The shortest run up to 20 ms (or four PWM periods) that differs from whole periods by
    less than 1 % of one; else the one with the smallest error.
    """
    ratio = pwm_period / period
    longest = max(0.02, 4.0 * pwm_period)
    if period >= longest:
        return 1
    best, least = 1, math.inf
    periods = 1
    while periods * pwm_period <= longest or (best == 1 and least is math.inf):
        samples = max(1, round(periods * ratio))
        missed = abs(samples - periods * ratio) / ratio
        if missed < least - 1e-9:
            best, least = samples, missed
        if least < 0.01:
            break
        periods += 1
    return best


def settled_after(rig: Rig) -> float:
    """Time, s, from a test's first row that is excluded: the valve is not yet periodic.

    The valve's state depends on commands no older than the longer of the two delays. Before
    that the first pulse has not opened it (filling), or it is still on from before the first
    row (discharging). Rounded up to whole PWM periods.
    """
    period = float(rig.require("pwm", "which the mean over pulses needs").period_s)
    delays = rig.valves
    longest = max(delays.on_delay_s, delays.off_delay_s) if delays else 0.0
    return max(1, math.ceil(longest / period - 1e-9)) * period


def open_share(duty: float, rig: Rig) -> float:
    """Share of time that the valve is open under a constant duty, by the declared delays."""
    period = float(rig.require("pwm", "which the mean over pulses needs").period_s)
    gain = rig.valves.off_delay_s - rig.valves.on_delay_s if rig.valves else 0.0
    if duty <= 0.0:
        return 0.0
    return 1.0 if duty >= 1.0 else min(max(duty + gain / period, 0.0), 1.0)


def choked_boundaries(air: Air, supply: float) -> tuple[float, float]:
    """Pressures, Pa, at which the filling and the exhaust flow change their law (3.5.1)."""
    return CRITICAL_RATIO * supply, air.atmospheric_pressure_pa / CRITICAL_RATIO


def sample_tests(tests: Sequence[PwmTest], rig: Rig) -> FlowSamples:
    """Samples of mean flow from tests of one valve in one direction.

    Tests too short for a window give none. Standard errors include the pressure noise, with
    the part of its autocorrelation that a mean over whole PWM periods keeps; an error of the
    volume, the temperature or the sensor's scale is common to all samples and not included.
    """
    air: Air = rig.require("air", "which the flow from dP/dt needs")
    pwm_period = float(rig.require("pwm", "which the mean over pulses needs").period_s)
    skip = settled_after(rig)
    means = [_PulseMean.of(t, pulse_block(pwm_period, t.period), skip) for t in tests]
    noise = _pooled_noise(means, rig)
    fastest = max((m.fastest() for m in means), default=0.0)
    sampling = _sampling(means, tests, rig)
    parts, windows = [], []
    for number, (test, mean) in enumerate(zip(tests, means, strict=True)):
        begin, end = _windows(test, mean, air, noise, fastest, pwm_period)
        if len(begin) == 0:
            continue
        rate, pressure = slopes(mean.values, begin, end, test.period)
        gains = np.array([_slope_gain(int(n), mean.block) for n in end - begin])
        flow, std = (
            flow_from_pressure_rate(
                value,
                pressure,
                test.volume,
                0.0,
                air.heat_capacity_ratio,
                air.gas_constant_j_per_kg_k,
                test.temperature,
            )
            for value in (rate, noise * gains / test.period)
        )
        size = len(begin)
        crosses = _crosses(test, mean, begin, end, air)
        row, rows = mean.first + begin, end - begin + mean.block - 1
        supply = test.supply + _line_while_open(test, row, rows, sampling[number][0], rig)
        parts.append(
            (np.full(size, test.duty), pressure, flow, std, supply, crosses, np.full(size, number))
        )
        windows.append(
            FlowWindows(
                row,
                rows,
                test.pressure[row],
                np.full(size, mean.block),
                np.full(size, test.period),
                # 1.2: mean square of parabolic weights over a window, of mean 1.
                noise * np.sqrt(1.2 / rows) if math.isfinite(noise) else np.zeros(size),
            )
        )
    labels = tuple(t.label for t in tests)
    heat = air.heat_capacity_ratio * air.gas_constant_j_per_kg_k
    of_tests = (
        labels,
        tuple(t.supply for t in tests),
        tuple(t.volume for t in tests),
        tuple(heat * t.temperature / t.volume for t in tests),
        sampling,
    )
    if not parts:
        none, numbers = np.empty(0), np.empty(0, dtype=np.intp)
        parts.append((none, none, none, none, none, none.astype(bool), numbers))
        windows.append(FlowWindows(numbers, numbers, none, numbers, none, none))
    columns = zip(*parts, strict=True)
    duty, level, mass_flow, error, supply, crosses, own = map(np.concatenate, columns)
    made_of = FlowWindows.joined(windows)
    return FlowSamples(
        duty, level, mass_flow, error, supply, made_of, crosses, own.astype(np.intp), *of_tests
    )


def _line_while_open(
    test: PwmTest, row: IntArray, rows: IntArray, centre: float, rig: Rig
) -> FloatArray:
    """Mean of `test.line` (n,), Pa, over the rows of each window in which the valve is open.

    Over all of its rows where the place of the pulses (`centre`, as in `FlowSamples.sampling`) is
    not known, or where no row is at one.
    """
    if not test.line.any():  # no supply was logged
        return np.zeros(len(row))
    opened = np.ones(len(test.line))
    if math.isfinite(centre):
        turns = np.arange(len(opened)) * (test.period / rig.require("pwm", "pulses").period_s)
        since = np.abs((turns - centre + 0.5) % 1.0 - 0.5)
        opened = (since <= 0.5 * open_share(test.duty, rig)).astype(float)
    sums = [np.concatenate(([0.0], np.cumsum(v))) for v in (opened, opened * test.line, test.line)]
    count, drawn, whole = (total[row + rows] - total[row] for total in sums)
    return np.asarray(np.where(count > 0.0, drawn / np.maximum(count, 1.0), whole / rows))


@dataclass(frozen=True)
class _PulseMean:
    """A test's pressure, averaged over `block` samples at a time (whole PWM periods).

    `values` (m,) Pa: values[i] is the mean of pressure[first + i : first + i + block];
    `usable` (m,): none of those is unusable.
    """

    values: FloatArray
    usable: BoolArray
    block: int
    period: float
    first: int

    @classmethod
    def of(cls, test: PwmTest, block: int, skip: float) -> _PulseMean:
        first = math.ceil(skip / test.period - 1e-6)
        pressure, usable = test.pressure[first:], test.usable[first:]
        if len(pressure) <= block:
            return cls(np.empty(0), np.empty(0, dtype=bool), block, test.period, first)
        # Summed from the first sample on, so that the cumulative sum loses no digits.
        offset = pressure[0]
        total = np.concatenate(([0.0], np.cumsum(pressure - offset)))
        bad = np.concatenate(([0], np.cumsum(~usable)))
        values = offset + (total[block:] - total[:-block]) / block
        return cls(values, bad[block:] == bad[:-block], block, test.period, first)

    def noise(self) -> float:
        """White-noise equivalent of one sample, Pa: from third differences of the means.

        Over disjoint blocks these contain neither ripple nor smooth motion, and the median
        ignores the few across a jump. Noise that is correlated within a block is included as it
        enters the flow.
        """
        b = self.block
        if len(self.values) < 6 * b:
            return math.nan
        third = np.diff(self.values[::b], 3) if b > 1 else np.diff(self.values, 3)
        if b > 1:
            shifted = self.values[b // 2 :: b]
            third = np.concatenate((third, np.diff(shifted, 3)))
        return deviation_by_median(third) * math.sqrt(b / 20.0)

    def phases(self, pwm_period: float) -> int:
        """How many places of the PWM period the samples of a mean are at."""
        periods = max(1, round(self.block * self.period / pwm_period))
        return self.block // math.gcd(self.block, periods)

    def pulse_centre(self, test: PwmTest, pwm_period: float) -> float:
        """Middle of the open valve's part of the period, as its share, from a row on; or NaN.

        The pressure's ripple is the integral of the pulses, whose fundamental is a cosine about
        their middle. NaN where fewer than three phases, or noise, hide it.
        """
        if self.phases(pwm_period) < FEWEST_PHASES or np.count_nonzero(self.usable) < 2:
            return math.nan
        begin = self.first + self.block // 2
        place = np.arange(begin, begin + len(self.values))
        ripple = (test.pressure[place] - self.values)[self.usable]
        turns = place[self.usable] * (test.period / pwm_period)
        found = complex(np.sum(ripple * np.exp(-2j * np.pi * turns)))
        unlikely = _FUNDAMENTAL_SHOWS * math.sqrt(0.5 * len(ripple)) * float(np.std(ripple))
        if abs(found) <= unlikely:
            return math.nan
        return float(-np.angle(1j * found) / (2.0 * np.pi)) % 1.0

    @cached_property
    def rates(self) -> FloatArray:
        """dP/dt, (m,) Pa/s, over two blocks around each mean."""
        n, b = len(self.values), self.block
        index = np.arange(n)
        left, right = np.maximum(index - b, 0), np.minimum(index + b, n - 1)
        return (self.values[right] - self.values[left]) / ((right - left) * self.period)

    def fastest(self) -> float:
        """Highest |dP/dt|, Pa/s."""
        if len(self.values) < 2 or not self.usable.any():
            return 0.0
        return float(np.max(np.abs(self.rates[self.usable])))


def _sampling(
    means: Sequence[_PulseMean], tests: Sequence[PwmTest], rig: Rig
) -> tuple[tuple[float, int], ...]:
    """Each test's pulse centre (a share of the period, or NaN) and the phases that its rows show.

    Where the pulses of all tests begin at one place among the rows, as they do where the log and
    the pulses start together, that place holds for all: pulses or pauses that fall between two
    rows do not show it themselves. Too few phases show none: a period starts at the test's first
    row then, as the log format has it, and the valve moves by its declared delays.
    """
    pwm_period = float(rig.require("pwm", "which the mean over pulses needs").period_s)
    phases = [m.phases(pwm_period) for m in means]
    centres = np.array([m.pulse_centre(t, pwm_period) for m, t in zip(means, tests, strict=True)])
    duty = np.array([t.duty for t in tests])
    clear = np.isfinite(centres) & (np.minimum(duty, 1.0 - duty) > 1.0 / np.array(phases))
    begins = np.exp(2j * np.pi * (centres - 0.5 * duty)[clear])
    centres[~clear] = math.nan
    together = begins.mean() if len(begins) else 0.0
    if abs(together) > _TOGETHER:
        centres = (float(np.angle(together)) / (2.0 * np.pi) + 0.5 * duty) % 1.0
    if rig.valves is not None:
        delays = 0.5 * (rig.valves.on_delay_s + rig.valves.off_delay_s) / pwm_period
        few = np.array(phases) < FEWEST_PHASES
        centres = np.where(few, (delays + 0.5 * duty) % 1.0, centres)
    return tuple(zip(centres.tolist(), phases, strict=True))


def _pooled_noise(means: Sequence[_PulseMean], rig: Rig) -> float:
    """Noise of one pressure sample, Pa: the median over the tests.

    Where all are too short to show it, the rig file's; NaN without one.
    """
    found = [n for n in (m.noise() for m in means) if math.isfinite(n)]
    if found:
        return float(np.median(found))
    declared = rig.sensors.pressure_noise_pa
    return math.nan if declared is None else declared


def _shortest_window(noise: float, fastest: float, period: float, block: int) -> int:
    """Means in the shortest window: two blocks of samples, or until the slope's noise is small.

    The noise of a least-squares slope over a time D is noise sqrt(12 period / D^3).
    """
    shortest = block + 1
    if fastest <= 0.0 or not noise > 0.0:
        return shortest
    duration = (noise * math.sqrt(12.0 * period) / (FLOW_NOISE_SHARE * fastest)) ** (2.0 / 3.0)
    return max(shortest, math.ceil(float(duration) / period) - block + 1)


def _windows(
    test: PwmTest, mean: _PulseMean, air: Air, noise: float, fastest: float, pwm_period: float
) -> tuple[IntArray, IntArray]:
    """Begin and end (exclusive) of each window, as indices into the pulse means."""
    empty = np.empty(0, dtype=np.intp)
    if len(mean.values) < 2 or not mean.usable.any():
        return empty, empty
    shortest = _shortest_window(noise, fastest, test.period, mean.block)
    longest = max(round(_LONGEST_WINDOW * pwm_period / test.period), shortest)
    travel = TRAVEL_SHARE * abs(test.supply - air.atmospheric_pressure_pa)
    with np.errstate(divide="ignore"):
        wanted = travel / (np.abs(mean.rates) * test.period)
    passed = np.cumsum(1.0 / np.clip(wanted, shortest, longest))
    begins, ends = [], []
    for start, stop in _stretches(test, mean, air):
        if stop - start < mean.block + 1:
            continue
        share = passed[start:stop] - passed[start]
        count = max(1, min(round(float(share[-1])), (stop - start) // shortest))
        cuts = np.searchsorted(share, share[-1] * np.arange(1, count) / count)
        begins.append(start + np.concatenate(([0], cuts)))
        ends.append(start + np.concatenate((cuts, [stop - start])))
    if not begins:
        return empty, empty
    begin, end = np.concatenate(begins), np.concatenate(ends)
    kept = end - begin >= 2
    return begin[kept], end[kept]


def _stretches(test: PwmTest, mean: _PulseMean, air: Air) -> list[tuple[int, int]]:
    """Runs of usable means on one side of every choked boundary."""
    # The running extreme is used, so that noise around a boundary does not cut repeatedly.
    values = mean.values
    course = np.maximum.accumulate(values) if test.filling else np.minimum.accumulate(values)
    regime = sum((course > p).astype(np.int8) for p in choked_boundaries(air, test.supply))
    changes = (np.diff(regime) != 0) | (np.diff(mean.usable.astype(np.int8)) != 0)
    edges = np.concatenate(([0], np.flatnonzero(changes) + 1, [len(values)]))
    pairs = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    return [(start, stop) for start, stop in pairs if mean.usable[start]]


def _crosses(
    test: PwmTest, mean: _PulseMean, begin: IntArray, end: IntArray, air: Air
) -> BoolArray:
    """Which windows (n,) cross a boundary.

    The means of a window stay on one side of a choked boundary; its samples, over which they are
    taken, may not.
    """
    crosses = np.zeros(len(begin), dtype=bool)
    boundaries = choked_boundaries(air, test.supply)
    for i, (start, stop) in enumerate(zip(begin.tolist(), end.tolist(), strict=True)):
        own = test.pressure[mean.first + start : mean.first + stop + mean.block - 1]
        low, high = own.min(), own.max()
        crosses[i] = any(low < boundary < high for boundary in boundaries)
    return crosses


@lru_cache(maxsize=4096)
def _slope_gain(points: int, block: int) -> float:
    """Standard deviation of a slope per sampling period, for white noise of 1 per sample.

    The slope is over `points` moving means of `block` samples each.
    """
    c = np.arange(points) - 0.5 * (points - 1)
    weights = np.convolve(c / (c @ c), np.ones(block) / block)
    return float(np.sqrt(weights @ weights))
