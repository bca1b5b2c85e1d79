"""What a row's force or torque is: a command that holds to the next row, or a reading at the row.

The log format has a motor's command, which holds from its row to the next. A rig without a motor
is moved by something else, and its column may be a load cell's: a reading at the row. Half a sample
lies between the two, which acceleration turns into mass and viscous friction. The recording itself
says which it is: one of the two balances the motion better.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid import signals
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.types import BoolArray, FloatArray, IntArray

# Stretches of a test whose errors count as independent.
_STRETCHES = 8
_FEWEST_ROWS = 40
# A reading is half a sample early: clearly nearer to that than to none.
_NEARER = 0.25
_STANDARD_ERRORS = 2.0
# Waves over the position that the balance is given, a cog's and its harmonics', and the fewest
# periods of one in the visited stretch: fewer are gravity or a spring.
_WAVES, _PERIODS = 3, 2.0
# Share of the median speed, below which the shaft is at rest and the friction law does not hold.
_SLOW = 0.02


def readings_line(rig: Rig) -> str:
    """The notice that the efforts are readings."""
    return (
        f"{rig.effort_channel} balances the motion as a reading at each row, not as a command that "
        "holds to the next: it is used as a reading"
    )


def with_commands(trials: Iterable[Trial], rig: Rig) -> tuple[Trial, ...]:
    """The trials with the command that acts alike in place of readings of force or torque."""
    name = rig.effort_channel
    return tuple(
        replace(t, channels={**t.channels, name: _command(t.time, t[name])}) if name in t else t
        for t in trials
    )


def _command(time: FloatArray, readings: FloatArray) -> FloatArray:
    """`_between_pauses` of each stretch (n,); what a pause hides is not made up."""
    found = np.array(readings, dtype=float)
    for rows in signals.between_pauses(time):
        found[rows] = _between_pauses(time[rows], found[rows])
    return found


def _between_pauses(time: FloatArray, readings: FloatArray) -> FloatArray:
    """The held command (n,) with the same effect at the rows as `readings` (n,).

    The second difference of positions is the acceleration a + h2 a''/12 for a sampling period with
    h2 its square; the mean of two commands about a row is u + h2 u''/8 of the command half a sample
    later: the command is the reading there, less h2/24 of its second derivative.
    """
    if len(time) < 4:
        return readings
    from scipy.interpolate import CubicSpline

    curve = CubicSpline(time, readings)
    steps = np.diff(time, append=2.0 * time[-1] - time[-2])
    middle = np.minimum(time + 0.5 * steps, time[-1])
    return np.asarray(curve(middle) - curve(middle, 2) * steps**2 / 24.0)


def effort_is_read(trials: Iterable[Trial], rig: Rig) -> bool:
    """Whether force or torque are readings at the rows of these tests of motion.

    A rig file with [motor] declares a command. Without, the half sample is estimated by which the
    effort lags behind the motion, with its error from the scatter over stretches; what repeats over
    the position is part of the balance, as it would hide half a sample, or look like one.
    """
    if rig.has_declared_motor:
        return False
    cases = [case for t in trials if (case := _case(t, rig)) is not None]
    if not cases:
        return False
    width = max(case.known.shape[1] for case in cases)
    cases = [case for case in cases if case.known.shape[1] == width]
    samples, error, left = _lag(cases)
    for _ in range(_WAVES):
        wave = _wave_left(cases, left)
        if wave is None:
            break
        cases = [case.with_wave(wave) for case in cases]
        narrow, width = width, cases[0].known.shape[1]
        if _STRETCHES * width > len(left):
            break
        with_wave = _lag(cases)
        was, now = (float(values @ values) for values in (left, with_wave[-1]))
        count = len(left)
        # Schwarz's criterion, as the rows are nearly independent.
        if not now > 0.0 or count * math.log(was / now) < (width - narrow) * math.log(count):
            break
        samples, error, left = with_wave
    return bool(samples + _STANDARD_ERRORS * error < -_NEARER)


@dataclass(frozen=True)
class _LagTest:
    """A test's filtered position (m,), the effort as held (m,), what balances it (m, p), and the
    rows (n,) that count."""

    period: float
    cutoff: float
    position: FloatArray
    direction: FloatArray
    known: FloatArray
    target: FloatArray
    rows: IntArray

    def with_wave(self, wave: float) -> _LagTest:
        """And an effort that repeats over the position with a wave number, as cogging does; along
        the motion too, as the motor's own does where friction is what it has to overcome."""
        phase = wave * self.position
        waves = np.column_stack([np.sin(phase), np.cos(phase)])
        both = np.column_stack([waves, self.direction[:, None] * waves])
        columns = signals.lowpass(both, self.period, self.cutoff)
        return replace(self, known=np.column_stack([self.known, columns]))

    def regressors(self) -> FloatArray:
        """(n, p + 1): the last one is the effort's change in a sample, as the others predict it."""
        fitted = np.linalg.lstsq(self.known[self.rows], self.target[self.rows])[0]
        change = self.period * signals.first_derivative(self.known @ fitted, self.period)
        return np.column_stack([self.known, change])[self.rows]


def _lag(cases: Sequence[_LagTest]) -> tuple[float, float, FloatArray]:
    """By how many samples the effort lags behind the motion, its error, what is left (n,)."""
    regressors = np.concatenate([case.regressors() for case in cases])
    target = np.concatenate([case.target[case.rows] for case in cases])
    scale = np.sqrt(np.mean(regressors**2, axis=0))
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv(regressors / scale)
    values = inverse @ target
    left = target - regressors / scale @ values
    edges = np.cumsum([0, *(len(case.rows) for case in cases)])
    scores = [
        inverse[-1, rows] @ left[rows]
        for first, last in itertools.pairwise(edges)
        for rows in np.array_split(np.arange(first, last), _STRETCHES)
    ]
    return values[-1] / scale[-1], math.sqrt(np.sum(np.square(scores))) / scale[-1], left


def _wave_left(cases: Sequence[_LagTest], left: FloatArray) -> float | None:
    """The wave number over the position that is strongest in what is left (n,), if any is."""
    places = [case.position[case.rows] for case in cases]
    travel = float(np.ptp(np.concatenate(places)))
    apart = float(np.median(np.abs(np.concatenate([np.diff(place) for place in places]))))
    if not travel > 0.0 or not apart > 0.0:
        return None
    lowest, highest = 2.0 * math.pi * _PERIODS / travel, math.pi / apart
    found = signals.strongest_waves(np.concatenate(places), left, lowest, highest, 1)
    return found[0] if found else None


def _case(trial: Trial, rig: Rig) -> _LagTest | None:
    if rig.effort_channel not in trial or rig.position_channel not in trial:
        return None
    grid = signals.uniform_grid(trial.time)
    if len(grid) < _FEWEST_ROWS:
        return None
    dt = float(grid[1] - grid[0])
    cutoff = min(signals.DEFAULT_CUTOFF_HZ, 0.1 / dt)
    length = signals.filter_length(dt, cutoff)

    def smooth(values: FloatArray) -> FloatArray:
        return signals.lowpass(values, dt, cutoff)

    position = smooth(signals.resample(trial.time, trial[rig.position_channel], grid))
    speed = signals.first_derivative(position, dt)
    way = smooth(np.sign(speed))
    columns = [
        signals.second_derivative(position, dt),
        speed,
        way,
        # Friction that turns later than the motion does is no delay of the effort.
        signals.first_derivative(way, dt),
        np.ones(len(grid)),
        *((position,) if rig.is_linear else (np.sin(position), np.cos(position))),
    ]
    for name in CHAMBER_PRESSURES:
        if name in trial:
            pressure = signals.resample(trial.time, trial[name], grid)
            # Seals press harder under pressure.
            columns += [smooth(pressure), smooth(pressure * np.sign(speed))]
    effort = signals.resample(trial.time, trial[rig.effort_channel], grid, hold=True)
    target = smooth(signals.held_about_rows(effort))
    lost = signals.widened(signals.in_pauses(trial.time, grid), length)
    rows = np.flatnonzero(_moving(speed, length) & ~lost)[:: max(1, length // signals.PER_LENGTH)]
    if len(rows) < _FEWEST_ROWS:
        return None
    known = np.column_stack(columns)
    return _LagTest(dt, cutoff, position, np.sign(speed), known, target, rows)


def _moving(speed: FloatArray, reach: int) -> BoolArray:
    """Rows (n,) farther than the filter reaches from a rest and from the ends."""
    slow = _SLOW * float(np.median(np.abs(speed)))
    rests = signals.slow_stretches(speed, slow, reach // signals.PER_LENGTH)
    rests[:reach] = rests[-reach:] = True
    return ~signals.widened(rests, reach)


__all__ = ["effort_is_read", "readings_line", "with_commands"]
