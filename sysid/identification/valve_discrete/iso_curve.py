"""Pressure of one held chamber through a component of ISO 6358, as a function of time.

With w = (k R T / V) C rho0 sqrt(T0 / T), choked filling from a line L is dP/dt = w L and choked
emptying dP/dt = -w P. Beyond the critical ratio b, with x = (ratio - b) / (1 - b) from 0 to 1,
filling is (1 - b) dx/dt = w (1 - x^2)^m and emptying (1 - b) dx/dt = w (b + (1 - b) x) (1 - x^2)^m.
Both end at x = 1 in finite time, with an infinite slope: in s = (1 - x)^(1 - m) they are smooth.
Time is integrated over s, and s(t) interpolated with its exact slopes.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from sysid.plant.iso6358 import DEFAULT_INDEX
from sysid.types import FloatArray

# Intervals of the integration over s, and its points in each (Gauss): to 1e-6 of the line.
_INTERVALS = 96
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class IsoPath:
    """One direction of a valve: `rate` w in 1/s, critical `ratio` b, subsonic `index` m."""

    rate: float
    ratio: float
    index: float = DEFAULT_INDEX

    def pressure(self, initial: float, line: float, elapsed: FloatArray) -> FloatArray:
        """Pressure (n,) Pa after `elapsed` (n,) s of a chamber at `initial` Pa, open to a line.

        The line's pressure is `line` Pa, above or below the chamber's; `elapsed` rises.
        """
        if initial == line:
            return np.full(len(elapsed), line)
        if initial < line:
            return line * self._filling_ratio(initial / line, elapsed)
        return line / self._emptying_ratio(line / initial, elapsed)

    def _filling_ratio(self, start: float, elapsed: FloatArray) -> FloatArray:
        """Chamber's over line's pressure."""
        choked = max(self.ratio - start, 0.0) / self.rate
        k, found = _ordered_before(elapsed, choked)
        found[:k] = start + self.rate * elapsed[:k]
        found[k:] = self._beyond(max(start, self.ratio), elapsed[k:] - choked, empties=False)
        return found

    def _emptying_ratio(self, start: float, elapsed: FloatArray) -> FloatArray:
        """Line's over chamber's pressure."""
        choked = math.log(max(self.ratio / start, 1.0)) / self.rate
        k, found = _ordered_before(elapsed, choked)
        found[:k] = start * np.exp(self.rate * elapsed[:k])
        found[k:] = self._beyond(max(start, self.ratio), elapsed[k:] - choked, empties=True)
        return found

    def _beyond(self, start: float, elapsed: FloatArray, empties: bool) -> FloatArray:
        """The ratio of the pressures from `start` (at least b) on."""
        b, m = self.ratio, self.index
        first = max((1.0 - start) / (1.0 - b), 0.0) ** (1.0 - m)
        s = _hermite(elapsed, *_course(self, first, empties))
        return np.asarray(1.0 - (1.0 - b) * s ** (1.0 / (1.0 - m)))

    def course(self, first: float, empties: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times s, s and its slopes, from `first` on to the end."""
        ends = np.linspace(first, 0.0, _INTERVALS + 1)
        middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * (ends[:-1] - ends[1:])
        inside = middle[:, None] + half[:, None] * _NODES
        parts = (self._slowness(inside, empties) @ _WEIGHTS) * half
        times = np.concatenate([[0.0], np.cumsum(parts)])
        return times, ends, -1.0 / self._slowness(ends, empties)

    def _slowness(self, s: FloatArray, empties: bool) -> FloatArray:
        """-dt/ds, s."""
        b, m = self.ratio, self.index
        left = s ** (1.0 / (1.0 - m))
        found = (1.0 - b) / (self.rate * (1.0 - m) * (2.0 - left) ** m)
        return np.asarray(found / (1.0 - (1.0 - b) * left) if empties else found)


def _ordered_before(elapsed: FloatArray, choked: float) -> tuple[int, FloatArray]:
    """How many of the times, which rise, are before the end of choked flow, and room for all."""
    return int(elapsed.searchsorted(choked)), np.empty(len(elapsed))


@functools.lru_cache(maxsize=64)
def _course(
    path: IsoPath, first: float, empties: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`IsoPath.course`: tests and rows that a law follows from the same place have the same one."""
    return path.course(first, empties)


def _hermite(
    at: FloatArray, times: FloatArray, values: FloatArray, slopes: FloatArray
) -> FloatArray:
    """The cubic through values with these slopes at `times`, held at both ends; (n,)."""
    inside = np.clip(at, times[0], times[-1])
    i = np.clip(np.searchsorted(times, inside, side="right") - 1, 0, len(times) - 2)
    step = np.diff(times)[i]
    # A start that is already the end takes no time.
    part = np.where(step > 0.0, (inside - times[i]) / np.where(step > 0.0, step, 1.0), 1.0)
    back = 1.0 - part
    bent = part * back * step * (back * slopes[i] - part * slopes[i + 1])
    blend = part * part * (3.0 - 2.0 * part)
    found = values[i] + blend * (values[i + 1] - values[i]) + bent
    return np.maximum(found, 0.0)


__all__ = ["IsoPath"]
