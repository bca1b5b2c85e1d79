"""Constants of a rig that its logs show: supply, atmosphere, sampling, PWM period, travel.

For logs that come without a rig file. A pressure is read where it rests: in a chamber whose valve
is off and at the end of a stretch in which it is on; a PWM period from the ripple of its pulses in
the pressure.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.io.channels import CHAMBER_PRESSURES, SIDES
from sysid.io.declaration import range_of
from sysid.io.rig_sections import Air
from sysid.io.samples import Log, Trial
from sysid.signals import MIN_SAMPLES, longest_run
from sysid.types import FloatArray

# Probability that the ripple of a log without pulses is taken for a PWM period.
_FALSE_RIPPLE = 1e-6
# Share of the fastest rate, and number of pulses, at which a chamber's ripple is compared with its
# mean rate.
_FAST, _LEAST_PULSES = 0.7, 4
# Share of the spectral line that pulses make at that rate, less the fall of the rate meanwhile.
_LEAST_SHARE = 0.85
# Share of a stretch under one command at its end, where the pressure has settled.
_SETTLED = 0.2
_OFF, _ON, _BEGUN = "off", "on", "begun"
"""What a chamber's valve does while its pressure rests; `begun`: a test, from either."""
VACUUM = 0.9
"""Of the atmosphere's pressure: a supply below is a vacuum, and not the weather."""
# A duty above which a chamber fills to the supply, but for the share of a pulse's end.
_NEARLY_ON = 0.95
_ATMOSPHERE = "atmospheric_pressure_pa"
# Share of a test's travel beyond which the shaft counts as moving.
_MOVED = 1e-3


@dataclass(frozen=True)
class ShownConstants:
    """Constants of a rig that its logs show, SI; None where they show nothing.

    `open_pa`: where chambers rest whose valves are off, the lowest first; all of them should be the
    atmosphere's pressure. `highest_pa`: of the pressures at the tests' ends, at most the supply's.
    `reach`: the largest distance of the position from zero, rad or m; `is_held`: whether the piston
    never leaves its place, as at an end of its stroke.
    """

    open_pa: tuple[float, ...]
    atmosphere_pa: float | None
    supply_pa: float | None
    highest_pa: float | None
    temperature_k: float | None
    sampling_s: float | None
    pwm_period_s: float | None
    reach: float | None
    is_held: bool
    largest_effort: float | None


def shown_constants(logs: Sequence[Log], position: str, effort: str) -> ShownConstants:
    """The constants that these trials show; `position` and `effort` name their channels."""
    trials = [trial for log in logs for trial in log.trials]
    rests, high = _rests(trials, position)
    places = [trial[position] for trial in trials if position in trial]
    efforts = [float(np.max(np.abs(trial[effort]))) for trial in trials if effort in trial]
    return ShownConstants(
        open_pa=rests,
        atmosphere_pa=_within(_ATMOSPHERE, _known(rests[0] if rests else None)),
        supply_pa=_within("supply_pressure_pa", high),
        temperature_k=_within("temperature_k", _known(_median_of(trials, "temperature_k"))),
        sampling_s=_sampling(trials),
        highest_pa=max((float(np.median(v)) for t in trials for v in _ends(t)), default=None),
        pwm_period_s=pwm_period(trials),
        reach=max((float(np.max(np.abs(place))) for place in places), default=None),
        is_held=all(_is_still(place) for place in places),
        largest_effort=max(efforts, default=None),
    )


def _sampling(trials: Sequence[Trial]) -> float | None:
    """The sampling period, s; None of tables without time."""
    periods = [_mean_period(trial) for trial in trials if not trial.is_readings]
    return _rounded(float(np.median(periods)), 6) if periods else None


def _mean_period(trial: Trial) -> float:
    """Mean sampling period, s: rounding of the time stamps is lost over the test."""
    return float(trial.time[-1] - trial.time[0]) / max(1, len(trial) - 1)


def _ends(trial: Trial) -> Iterator[FloatArray]:
    """The end of each chamber's pressure (m,)."""
    yield from (_end(trial[name]) for name in CHAMBER_PRESSURES if name in trial)


def _end(pressure: FloatArray) -> FloatArray:
    """The last tenth of a test's pressure (n,), where it has come the nearest to rest."""
    return pressure[-max(1, len(pressure) // 10) :]


def _is_still(place: FloatArray) -> bool:
    """Whether a position (n,) hardly changes, next to its distance from zero."""
    return float(np.ptp(place)) <= _MOVED * float(np.max(np.abs(place)))


def _within(key: str, value: float | None) -> float | None:
    """A pressure, where it is one that a rig can have as this key of [air]."""
    return value if value is not None and range_of(Air, key).holds(value) else None


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


# --- pressures ----------------------------------------------------------------------------


def _rests(trials: Sequence[Trial], position: str) -> tuple[tuple[float, ...], float | None]:
    """The pressures (Pa) at which open chambers rest, and filled ones; none: not shown.

    A logged supply pressure is that of filled ones.
    """
    found: dict[str, list[float]] = {_OFF: [], _ON: [], _BEGUN: []}
    for trial in trials:
        for side in SIDES:
            if f"pressure_{side}_pa" in trial:
                for state, values in _resting(trial, side, position):
                    found[state].append(float(np.median(values)))
    begun_open, begun_filled = _apart(found[_BEGUN])
    if begun_open and not begun_filled and _within(_ATMOSPHERE, begun_open[0]) is None:
        begun_open, begun_filled = [], begun_open  # every test empties
    rests = tuple(float(np.median(own)) for own in _apart([*found[_OFF], *begun_open]) if own)
    logged = _median_of(trials, "supply_pressure_pa")
    if logged is not None:
        return rests, _known(logged)
    # Leaks and short stretches keep a chamber below the supply: the highest rests count.
    on = [*found[_ON], *begun_filled]
    low = rests[0] if rests else 0.0
    is_vacuum = bool(on) and _within(_ATMOSPHERE, low) is not None and max(on) < VACUUM * low
    way = -1.0 if is_vacuum else 1.0
    reach = max((way * (value - low) for value in on), default=0.0)
    top = [value for value in on if way * (value - low) > 0.9 * reach]
    return rests, _known(float(np.median(top)) if top else None)


def _median_of(trials: Sequence[Trial], name: str) -> float | None:
    """The median over tests of a channel's; None where none has it."""
    found = [float(np.median(trial[name])) for trial in trials if name in trial]
    return float(np.median(found)) if found else None


def _known(value: float | None) -> float | None:
    """To 10 Pa or so, as no sensor's reading is known better."""
    return None if value is None else _rounded(value, 5)


def _resting(trial: Trial, side: str, position: str) -> Iterator[tuple[str, FloatArray]]:
    """Stretches of a chamber's pressure (m,) that may be at rest, and the state of its valve.

    Before the first command it is where the test began; after one, at the end of each stretch.
    """
    pressure = trial[f"pressure_{side}_pa"]
    switch, duty = f"valve_{side}", f"duty_{side}"
    two = [s for s in (switch, duty) if f"{s}_fill" in trial or f"{s}_bleed" in trial]
    if two:
        yield from _resting_of_two(trial, pressure, two[0])
    elif switch in trial:
        command = trial[switch]
        edges = [0, *(np.flatnonzero(np.diff(command)) + 1), len(command)]
        for first, last in itertools.pairwise(edges):
            if first == 0 and command[0] == 0.0 and trial.has_its_start:
                yield _OFF, pressure[:last]
            else:
                settled = max(1, round(_SETTLED * (last - first)))
                yield _ON if command[first] else _OFF, pressure[last - settled : last]
    elif duty in trial and bool(np.any(trial[duty])):
        # The first row is from before the first pulse.
        if trial.has_its_start:
            yield _BEGUN, pressure[:1]
        if bool(np.all(trial[duty] > _NEARLY_ON)):
            yield _ON, _end(pressure)
    else:
        # A shaft that moves pumps air through the exhausts.
        place = trial[position] if position in trial else np.zeros(len(pressure))
        moved = np.abs(place - place[0]) > _MOVED * np.ptp(place)
        yield _OFF, pressure[: int(np.argmax(moved)) if moved.any() else len(pressure)]


def _resting_of_two(
    trial: Trial, pressure: FloatArray, stem: str
) -> Iterator[tuple[str, FloatArray]]:
    """The same of a chamber with a fill and a bleed valve, by their columns' stem: shut, it rests
    anywhere."""
    fill, bleed = f"{stem}_fill", f"{stem}_bleed"
    off = np.zeros(len(pressure), dtype=bool)
    fills, empties = (trial[n] > _NEARLY_ON if n in trial else off for n in (fill, bleed))
    # Without its fill valve's column a log may as well be of a discharge alone.
    if trial.has_its_start and fill in trial:
        yield _BEGUN, pressure[:1]
    edges = [0, *(np.flatnonzero(np.diff(2 * fills + empties)) + 1), len(pressure)]
    for first, last in itertools.pairwise(edges):
        if fills[first] != empties[first]:
            settled = max(1, round(_SETTLED * (last - first)))
            yield _ON if fills[first] else _OFF, pressure[last - settled : last]


def _apart(values: Sequence[float]) -> tuple[list[float], list[float]]:
    """Pressures in two groups, as where tests begin at the atmosphere and at the supply.

    They are apart where the gap between them is wider than either group.
    """
    ordered = sorted(values)
    if len(ordered) < 2:
        return ordered, []
    cut = int(np.argmax(np.diff(ordered))) + 1
    lower, upper = ordered[:cut], ordered[cut:]
    gap = upper[0] - lower[-1]
    if gap > max(lower[-1] - lower[0], upper[-1] - upper[0], 0.1 * lower[0]):
        return lower, upper
    return ordered, []


# --- pulses -------------------------------------------------------------------------------


def pwm_period(trials: Iterable[Trial]) -> float | None:
    """The PWM period (s) that the ripple of pulses in the pressures shows; None: none does.

    The spectrum of the pressures' steps, summed over tests, has its strongest line at the pulses'
    frequency: harmonic n of pulses of duty d is as sin(pi n d) / n, the first the largest. The
    line counts where noise alone would exceed it with a chance of 1e-6, and where it is as large as
    pulses of this period make it: sampled too seldom, those of a shorter one show a smaller line.
    """
    from scipy.ndimage import median_filter
    from scipy.special import chdtri

    ripples = [ripple for trial in trials for ripple in _ripples(trial)]
    if not ripples:
        return None
    period = float(np.median([ripple.period for ripple in ripples]))
    rows = max(len(ripple.steps) for ripple in ripples)
    size = 1 << (2 * rows - 1).bit_length()
    power = np.zeros(size // 2 + 1)
    for ripple in ripples:
        spectrum = np.abs(np.fft.rfft(ripple.steps * np.hanning(len(ripple.steps)), size)) ** 2
        power += spectrum / np.median(spectrum)
    first = 4 * size // rows  # slower than four periods a test is the filling itself
    if first >= len(power) - 1:
        return None
    # The noise of steps grows with frequency: each line is held against its neighbours.
    ground = median_filter(power, size=40 * size // rows, mode="nearest")
    over = power[first:] / ground[first:]
    at = first + int(np.argmax(over))
    degrees = 2 * len(ripples)
    level = chdtri(degrees, _FALSE_RIPPLE / len(over)) / chdtri(degrees, 0.5)
    place = _peak(power, at) / size
    if over[at - first] < level:
        return None
    shares = [ripple.share_of_pulses(place) for ripple in ripples]
    if np.all(np.isnan(shares)) or np.nanquantile(shares, 0.25) < _LEAST_SHARE:
        return None
    return _even_period(place / period, rows * period)


@dataclass(frozen=True)
class _Ripple:
    """A chamber's pressure steps (n,) under pulses less their slow part, which is `slow` (n,)."""

    period: float
    duty: float
    steps: FloatArray
    slow: FloatArray

    def share_of_pulses(self, frequency: float) -> float:
        """Size of the line at a frequency (cycles a row), over that of pulses of this frequency.

        NaN where the test is too short. While a chamber fills the fastest nothing leaves it: at a
        mean rate m it takes m / d in a pulse of duty d, and one that empties loses m / (1 - d)
        between pulses. Rows take means over their period.
        """
        fast = np.abs(self.slow) > _FAST * float(np.max(np.abs(self.slow)))
        first, last = longest_run(fast)
        if (last - first) * frequency < _LEAST_PULSES:
            return math.nan
        window = np.hanning(last - first)
        turns = np.exp(-2j * np.pi * frequency * np.arange(last - first))
        line = abs(np.sum(window * self.steps[first:last] * turns))
        slow = self.slow[first:last]
        share = np.where(slow > 0.0, self.duty, 1.0 - self.duty)
        swing = np.abs(slow) / share * np.sin(np.pi * self.duty) / np.pi
        return float(line / (np.sum(window * swing) * np.sinc(frequency)))


def _ripples(trial: Trial) -> Iterator[_Ripple]:
    """The ripple of each chamber whose valve is pulsed at a constant duty."""
    for side in SIDES:
        duty, pressure = f"duty_{side}", f"pressure_{side}_pa"
        if duty not in trial or pressure not in trial or len(trial) < MIN_SAMPLES:
            continue
        share = float(np.median(trial[duty]))
        if not 0.0 < share < 1.0:
            continue
        steps = np.diff(trial[pressure])
        kernel = np.ones(min(51, len(steps) // 2 * 2 - 1))
        slow = np.convolve(steps, kernel, "same") / np.convolve(np.ones_like(steps), kernel, "same")
        yield _Ripple(_mean_period(trial), share, steps - slow, slow)


def _peak(power: FloatArray, at: int) -> float:
    """The place of a line between bins, by a parabola through the logarithms of three."""
    if not 0 < at < len(power) - 1:
        return float(at)
    left, middle, right = np.log(power[at - 1 : at + 2])
    curvature = left - 2.0 * middle + right
    return at + (0.5 * (left - right) / curvature if curvature else 0.0)


def _even_period(frequency: float, length: float) -> float:
    """The period of a line: of those that it may be, the one with the fewest digits.

    A timer's period is a round number of seconds or of pulses a second; a line is known to a
    twentieth of the resolution of tests of this `length` (s).
    """
    spread = 0.05 / length
    for digits in range(1, 7):
        hertz, seconds = _rounded(frequency, digits), _rounded(1.0 / frequency, digits)
        for period in (seconds, 1.0 / hertz):
            if abs(1.0 / period - frequency) <= spread:
                return period
    return 1.0 / frequency


__all__ = ["VACUUM", "ShownConstants", "pwm_period", "shown_constants"]
