"""A tank's tests as logged: from the stop of the pump on, on the time scale of the tank itself.

What is short, long or fast is so next to the time in which the pressure falls by 1 - 1/e of all
that it falls; nothing here is in seconds or in rows a second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid import signals
from sysid.diagnosis.bench.component import usable
from sysid.errors import NotIdentifiedError, input_error
from sysid.io.logs import Trial
from sysid.types import FloatArray

_PUMPS = ("pump_volts", "valve_a")
_BY_VALVE = 'sysid fit valve-discrete (in a campaign kind = "valve-discrete")'
# Residuals are means over a bin, of the tank's own time.
_BIN = 0.01
# A parabola through this time of the discharge gives a first guess of the pressure at its start,
# where enough rows lie in it: the first may still contain the pulses of the pump.
_START = 0.05
_FEWEST_IN_START = 4
# What lies later says nothing on how the tank empties.
_LONGEST = 50.0
# The pressure at the start, three numbers of a law, and two more that show how large its error is.
_FEWEST_BINS = 6
# Of the time in which the pressure falls: within it rows have to lie.
_FEWEST_IN_FALL = 2
# Of the atmosphere's pressure, which is known to about as much.
_LEAST_FALL = 0.01
# Of the excess pressure at the start: a tank with less is empty, but for errors of the atmosphere.
_EMPTY = 0.01
# Times the noise, below which an excess pressure is noise.
_SEEN = 3.0


@dataclass(frozen=True)
class Discharge:
    """One test from the stop of the pump on: means over bins of `bin_s`.

    `time` (n,) s since the stop, `pressure` (n,) Pa absolute, `start` a first guess of the pressure
    at 0, `noise` what the sensor's noise leaves of a mean, Pa.
    """

    label: str
    time: FloatArray
    pressure: FloatArray
    start: float
    bin_s: float
    noise: float = math.nan

    @property
    def scale_s(self) -> float:
        """About the tank's own time, s."""
        return self.bin_s / _BIN

    def until_empty(self, atmosphere: float) -> Discharge:
        """Without what comes after the excess pressure has fallen to a hundredth, or to noise."""
        excess = self.pressure - atmosphere
        least = max(_EMPTY * (self.start - atmosphere), _SEEN * (self.noise or 0.0))
        count = max(int(np.count_nonzero(np.cumprod(excess > least))), min(_FEWEST_BINS, len(self)))
        return replace(self, time=self.time[:count], pressure=self.pressure[:count])

    def __len__(self) -> int:
        return len(self.time)


def discharges(
    trials: Sequence[Trial], atmosphere: float
) -> tuple[tuple[Discharge, ...], tuple[str, ...]]:
    """The discharge of each trial, and why trials or rows are not used, a line each.

    `atmosphere` in Pa. Raises InputError where a column is missing, NotIdentifiedError where no
    trial shows a discharge.
    """
    read, left_out = usable(trials, lambda trial: _discharge(trial, atmosphere))
    bin_s = _round(_BIN * float(np.median([one.scale_s for one in read])))
    found, short = usable(read, lambda one: _binned(one, bin_s))
    late = [one.late for one in read if one.late]
    return tuple(found), (*left_out, *short, *late)


@dataclass(frozen=True)
class _Fall:
    """A test's rows from the stop of the pump on: `time` (n,) s since then, `pressure` (n,) Pa.

    `start` is about the pressure at 0, `scale_s` the time in which it falls by 1 - 1/e of its whole
    fall; `late` says which rows are not used, where some are not.
    """

    trial: Trial
    time: FloatArray
    pressure: FloatArray
    start: float
    scale_s: float
    late: str = ""


def _discharge(trial: Trial, atmosphere: float) -> _Fall:
    """The discharge that a trial holds. Raises as `discharges` does."""
    command = _command(trial)
    on = np.flatnonzero(trial[command] != 0.0)
    # Off in every row: the test begins with its discharge.
    first = int(on[-1]) + 1 if len(on) else 0
    if len(trial) - first < _FEWEST_BINS:
        fills = f"; {_BY_VALVE} fits how it fills" if command == "valve_a" and len(on) else ""
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: {command} is never switched off for good, "
            f"as {_FEWEST_BINS} rows or more would show; a test that goes on after the pump has "
            f"stopped, or its valve is off, would do{fills}"
        )
    time = trial.time[first:] - trial.time[first]
    pressure = trial["pressure_a_pa"][first:]
    before, after, error = _ends(pressure, trial.stride_of("pressure_a_pa"))
    # A pressure that does not fall shows no time of the tank's own: the record's stands for it.
    scale = _scale(time, pressure) if before - after > error else float(time[-1])
    start = _first_guess(time, pressure, scale)
    if atmosphere - start > _LEAST_FALL * atmosphere:
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: the tank is {atmosphere - start:.3g} Pa "
            f"below the atmosphere ({atmosphere:.6g} Pa) when {command} is off, a vacuum that "
            f"fills: a discharge from above it would do, or {_BY_VALVE} with the vacuum as the "
            "rig file's supply_pressure_pa (if the pressures are gauge ones, map them as such)"
        )
    if start - atmosphere < _LEAST_FALL * atmosphere:
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: the discharge starts only "
            f"{start - atmosphere:.3g} Pa above the atmosphere; a stronger fill would do"
        )
    if after - before > error:
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: the pressure rises from {before:.6g} to "
            f"{after:.6g} Pa while {command} is off: something still fills the tank, or its gas "
            "is warmed; a discharge after it has settled, with the supply shut, would do"
        )
    rows = int(np.count_nonzero(time <= scale))
    if rows < _FEWEST_IN_FALL:
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: the pressure falls by 1 - 1/e of its whole "
            f"fall in {scale:.3g} s, within which only {rows} rows lie; sample every "
            f"{scale / 20.0:.2g} s or faster, or discharge a larger tank"
        )
    used = time <= _LONGEST * scale
    unused = []
    if count := _earlier(trial, command, first):
        unused.append(
            f"{count} earlier discharge{'s' * (count > 1)} before row {first + 1}: only a test's "
            "last one is used (a column test that numbers them would add them)"
        )
    if not used.all():
        unused.append(
            f"rows later than {_LONGEST * scale:.3g} s after {command} is 0 are "
            "not used: the tank is empty long before"
        )
    late = f"{trial.source}: {'; '.join(unused)}" if unused else ""
    return _Fall(trial, time[used], pressure[used], start, scale, late)


def _earlier(trial: Trial, command: str, first: int) -> int:
    """The discharges before row `first`, of the last one: each at least half as deep."""
    pressure, off = trial["pressure_a_pa"], trial[command] == 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], off[:first], [False]]).astype(int)))
    fall = float(pressure[first] - pressure[-1])
    runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return sum(
        end - start >= _FEWEST_BINS and float(pressure[start] - pressure[end - 1]) >= 0.5 * fall
        for start, end in runs
    )


def _command(trial: Trial) -> str:
    """The channel that is 0 from the start of the discharge on. Raises InputError without one."""
    used = [name for name in _PUMPS if name in trial.unusable]
    if "pressure_a_pa" not in {*trial.channels, *trial.unusable} and "pressure_b_pa" in trial:
        raise input_error(
            trial.source,
            "column pressure_a_pa is missing, which a tank test needs; the log has pressure_b_pa",
            'map that: --map "pressure_a_pa=pressure_b_pa"',
        )
    trial.require(("pressure_a_pa", *used), "which a tank test needs")
    command = next((name for name in _PUMPS if name in trial), None)
    if command is None:
        raise input_error(
            trial.source,
            "column pump_volts is missing, which shows when the tank is filled (valve_a would do "
            "as well)",
            'add it (or valve_a), or name it with --map "pump_volts=COLUMN:V"',
        )
    return command


def _ends(pressure: FloatArray, stride: int) -> tuple[float, float, float]:
    """The means of the first and the last fifth of a pressure (n,), Pa, and by how much they differ
    by noise at most."""
    some = max(1, len(pressure) // 5)
    first, last = float(np.mean(pressure[:some])), float(np.mean(pressure[-some:]))
    noise = signals.noise_floor(pressure, stride=stride).total
    return first, last, _SEEN * noise * math.sqrt(2.0 / some)


def _scale(time: FloatArray, pressure: FloatArray) -> float:
    """The time, s, in which a pressure falls by 1 - 1/e of its whole fall; (n,) each."""
    some = max(1, min(_FEWEST_IN_START, len(time) // 8))
    first, last = float(np.mean(pressure[:some])), float(np.mean(pressure[-some:]))
    fallen = np.flatnonzero(pressure <= first - (1.0 - math.exp(-1.0)) * (first - last))
    place = max(int(fallen[0]) if len(fallen) else len(time) - 1, 1)
    # Between two rows, as few may lie in a fall.
    high, low = float(pressure[place - 1]), float(pressure[place])
    level = first - (1.0 - math.exp(-1.0)) * (first - last)
    share = np.clip((high - level) / (high - low), 0.0, 1.0) if high > low else 1.0
    return float(time[place - 1] + share * (time[place] - time[place - 1]))


def _first_guess(time: FloatArray, pressure: FloatArray, scale: float) -> float:
    """The pressure at 0 s, Pa, of a parabola; of the first row where the rows are far apart."""
    early = time <= _START * scale
    if np.count_nonzero(early) < _FEWEST_IN_START:
        return float(pressure[0])
    return float(np.polynomial.Polynomial.fit(time[early], pressure[early], 2)(0.0))


def _round(value: float) -> float:
    """The nearest of 1, 2, 5 and their decades."""
    decade = 10.0 ** math.floor(math.log10(value))
    return decade * min((1.0, 2.0, 5.0, 10.0), key=lambda d: abs(math.log(d * decade / value)))


def _binned(fall: _Fall, bin_s: float) -> Discharge:
    """Its means over bins of `bin_s`; NotIdentifiedError where too few rows give any."""
    place = np.round(fall.time / bin_s, 6).astype(int)
    # The last bin ends after the last row.
    count = max(int(place[-1]), 1) if _is_fine(fall.time, bin_s) else int(place[-1]) + 1
    inside = place < count
    rows = np.bincount(place[inside], minlength=count)
    filled = rows > 0
    means = [
        np.bincount(place[inside], values[inside], count)[filled] / rows[filled]
        for values in (fall.time, fall.pressure)
    ]
    if len(means[0]) < _FEWEST_BINS:
        raise NotIdentifiedError(
            f"{fall.trial.source}: c_dis is not identified: the discharge is logged for "
            f"{fall.time[-1]:.3g} s only; a longer one, or a faster logger, would do"
        )
    sensor = signals.noise_floor(fall.pressure, stride=fall.trial.stride_of("pressure_a_pa"))
    noise = sensor.after(float(np.mean(1.0 / rows[filled])))
    return Discharge(fall.trial.title, means[0], means[1], fall.start, bin_s, noise)


def _is_fine(time: FloatArray, bin_s: float) -> bool:
    """Whether several rows lie in a bin, so that a last one that is not full counts too much."""
    return float(np.median(np.diff(time))) < 0.5 * bin_s


__all__ = ["Discharge", "discharges"]
