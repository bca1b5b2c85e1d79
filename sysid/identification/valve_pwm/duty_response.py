"""A valve's opening over duty at one PWM frequency, and the range in which it follows the duty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sysid.surfaces.comparison import ResolutionStudy
from sysid.types import FloatArray

# A step of duty that gives less than this share of an even step is one of responses that overlap.
_OVERLAP = 0.5


@dataclass(frozen=True)
class LinearRange:
    """The duties `first` to `last` in which a valve's opening follows the duty, with their errors.

    `std` that of last - first. The opening is `low` up to `first` and `high` from `last` on.
    """

    first: float
    last: float
    std: float
    low: float = 0.0
    high: float = 1.0

    @property
    def width(self) -> float:
        """Of the duty, 0 to 1."""
        return self.last - self.first


@dataclass(frozen=True, eq=False)
class DutyResponse:
    """One valve at one PWM frequency: its opening over duty, and what follows.

    `duty` (n,); `opening` (n,) the share of time that the valve is open, 0 at the least and 1 at
    the largest that the tests show; `std` its standard error; `linear` the linear range of the
    duty; `resolution` by direction (Table 3.7.1); `curves`: pressure over time of each test, with
    its duty and whether it fills.
    """

    valve: str
    period_s: float
    source: str
    duty: FloatArray
    opening: FloatArray
    std: float
    linear: LinearRange
    resolution: Mapping[str, ResolutionStudy] = field(default_factory=dict)
    curves: tuple[tuple[float, bool, FloatArray, FloatArray], ...] = ()

    @property
    def frequency_hz(self) -> float:
        """Of the pulses."""
        return 1.0 / self.period_s

    @property
    def unusable_s(self) -> float:
        """The part of a period in which the end of a pulse changes nothing, s."""
        return (1.0 - self.linear.width) * self.period_s

    @property
    def overlapping(self) -> list[tuple[float, float]]:
        """Neighbouring duties whose responses overlap: less than half of an even step apart."""
        steps = np.diff(self.opening) / np.diff(self.duty)
        least = _OVERLAP / max(self.linear.width, 1e-9) * (self.linear.high - self.linear.low)
        near = np.flatnonzero(steps < least)
        return [(round(float(self.duty[i]), 6), round(float(self.duty[i + 1]), 6)) for i in near]

    @property
    def unevenness(self) -> float:
        """RMS of the opening about the line, as a share of the whole opening."""
        line = line_of(self.duty, self.linear)
        return float(np.sqrt(np.mean((self.opening - line) ** 2)))

    @property
    def least_step(self) -> float:
        """The step of duty whose response is twice its own standard error."""
        slope = (self.linear.high - self.linear.low) / max(self.linear.width, 1e-9)
        return 2.0 * math.sqrt(2.0) * self.std / slope


def line_of(duty: FloatArray, linear: LinearRange) -> FloatArray:
    """The opening (n,) by the line."""
    x = np.clip((duty - linear.first) / linear.width, 0.0, 1.0)
    return np.asarray(linear.low + (linear.high - linear.low) * x)


__all__ = ["DutyResponse", "LinearRange", "line_of"]
