"""The PWM period that the tests' pressure ripples with, compared with the rig file's.

The pulses show as a line in the spectrum of the pressure, the strongest of their harmonics at
one over the period: the pressure rises and falls in ramps, whose harmonics decay.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid.estimation.quality import FEWEST_REPEATS
from sysid.identification.valve_pwm.samples import PwmTest
from sysid.types import BoolArray, FloatArray

# Deviation of the period that is said, as a share of the declared one.
SAID_DEVIATION = 0.02
# Power of a line above the median of that about it. The noise of three tests exceeds 10 times
# its median once in 10^9 frequencies; what else a log holds is seldom as narrow as a line.
_LINE_POWER = 20.0
_NOISE_BINS = 41


def deviating_period(tests: Sequence[PwmTest], declared: float) -> list[str]:
    """A notice where one valve's pressure ripples with another period than declared, s.

    None where the sampling or the noise hides the ripple.
    """
    whole = [t for t in tests if t.usable.all()]
    # Duties whose pulses and pauses are long enough to ripple.
    rippling = [t for t in whole if 0.2 <= t.duty <= 0.8]
    if len(rippling) < FEWEST_REPEATS:
        return []
    sampling = float(np.median([t.period for t in rippling]))
    rows = int(np.median([len(t.pressure) for t in rippling]))
    rippling = _alike(rippling, sampling, rows)
    # With fewer rows in a declared period, what shows may be an alias.
    short = rows < 4 * _NOISE_BINS or declared < 3.0 * sampling
    if short or len(rippling) < FEWEST_REPEATS:
        return []
    power = _spectrum(rippling, rows)
    strongest = _strongest_line(power)
    expected = _around(rows * sampling / declared, len(power))
    # A harmonic of ramps has a quarter of the fundamental's power, or less.
    if strongest is None or power[strongest] < 4.0 * power[expected].max(initial=0.0):
        return []
    seen = rows * sampling / _peak(power, strongest)
    if abs(seen / declared - 1.0) < SAID_DEVIATION:
        return []
    # A line that tests without pulses also show is mains hum, or comes from the supply.
    quiet = _alike([t for t in whole if not 0.05 < t.duty < 0.95], sampling, rows)
    if quiet and _spectrum(quiet, rows)[strongest] > 0.5 * power[strongest]:
        return []
    place = rippling[0].source.removesuffix(f", test {rippling[0].label}")
    return [
        f"{place}: pressure_{rippling[0].valve}_pa ripples with a period of {1e3 * seen:.3g} ms, "
        f"the rig file's [pwm] period_s is {1e3 * declared:.3g} ms: the delays' difference is "
        "wrong by their ratio, and means over pulses keep their ripple; correct the rig file"
    ]


def _alike(tests: Sequence[PwmTest], sampling: float, rows: int) -> list[PwmTest]:
    """The tests of that sampling period, s, with at least so many rows."""
    near = 0.5 * SAID_DEVIATION * sampling
    return [t for t in tests if len(t.pressure) >= rows and abs(t.period - sampling) < near]


def _spectrum(tests: Sequence[PwmTest], rows: int) -> FloatArray:
    """Mean power of the tests' pressure by frequency, (rows // 2 + 1,)."""
    # Second differences remove the course from start to rest; the division undoes the rest.
    changes = np.diff(np.array([t.pressure[:rows] for t in tests]), 2, axis=1)
    window = np.hanning(rows - 2)
    power = np.mean(np.abs(np.fft.rfft(changes * window, rows, axis=1)) ** 2, axis=0)
    gain = (2.0 * np.sin(np.pi * np.arange(len(power)) / rows)) ** 4
    gain[0] = np.inf
    return np.asarray(power / gain)


def _strongest_line(power: FloatArray) -> int | None:
    """Bin of the strongest line of a spectrum (m,); None where it has none."""
    about = sliding_window_view(np.pad(power, _NOISE_BINS // 2, mode="symmetric"), _NOISE_BINS)
    lines = power > _LINE_POWER * np.median(about, axis=1)
    # The slow course leaks into the lowest bins, which therefore hold no line.
    lines[: _NOISE_BINS // 2] = False
    return int(np.argmax(np.where(lines, power, 0.0))) if lines.any() else None


def _around(place: float, bins: int) -> BoolArray:
    """Which bins (mask) a line at a place between them may fill."""
    # Bins by which a line may miss its place; a Hann window widens it by two to either side.
    width = max(3, SAID_DEVIATION * place)
    return np.asarray(np.abs(np.arange(bins) - place) <= width)


def _peak(power: FloatArray, index: int) -> float:
    """Place of a peak between bins: that of the parabola through three logarithms."""
    if index == len(power) - 1:
        return float(index)
    left, middle, right = np.log(power[index - 1 : index + 2])
    bend = left - 2.0 * middle + right
    return index + (0.5 * float((left - right) / bend) if bend < 0.0 else 0.0)


__all__ = ["deviating_period"]
