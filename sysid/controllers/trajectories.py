"""Trajectories 1 to 4 of the thesis (Table 4.2.1) and their vertical variants (Figure 5.5).

The thesis prints the kind of each, the sines' amplitudes and frequencies, and that the
steady state of trajectory 1 is judged from 5 to 5.5 s. Travel, times and the start of the
sines are only in its figures; here they are fields with these assumptions: 1 rad from 1 s on
and back from 6 s on, within 2 s (cycloid) and 3 s (ramp, whose corners then cost backstepping
the printed error), and sines that start at rest in their lower turning point, since a sine that
starts at full speed asks for a velocity step that no actuator follows. In the
vertical, where 0 hangs down, a sine swings between 0 and twice its amplitude and trajectory 4
rests from 9.5 s on (Figure 6.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sysid.errors import input_error
from sysid.types import FloatArray

TRAJECTORIES = (1, 2, 3, 4)
"""Numbers of the trajectories of Table 4.2.1."""
DURATION_S = 10.0
SETTLED_S = (5.0, 5.5)
"""Where the steady state of trajectory 1 is judged, s (6.4)."""


class DesiredMotion(Protocol):
    """A motion to be followed, known for all times."""

    def sample(self, time: FloatArray) -> FloatArray:
        """(n, 4) at `time` (n,) s: position rad (linear: m), its three derivatives."""


def _cycloid(share: FloatArray) -> FloatArray:
    """(n, 4) of the cycloidal rise from 0 to 1 over the share of its time, and derivatives."""
    w = 2.0 * np.pi
    s = np.clip(share, 0.0, 1.0)
    inside = (share > 0.0) & (share < 1.0)
    rates = np.stack([1.0 - np.cos(w * s), w * np.sin(w * s), w * w * np.cos(w * s)])
    return np.stack([s - np.sin(w * s) / w, *np.where(inside, rates, 0.0)], axis=1)


@dataclass(frozen=True)
class Cycloidal:
    """Rest, a cycloidal rise by `travel` from `starts`[0], and back from `starts`[1]; s, rad."""

    travel: float = 1.0
    lasts: float = 2.0
    starts: tuple[float, float] = (1.0, 6.0)
    origin: float = 0.0

    def sample(self, time: FloatArray) -> FloatArray:
        """See `DesiredMotion`."""
        there, back = (_cycloid((time - start) / self.lasts) for start in self.starts)
        rates = self.travel / self.lasts ** np.arange(4)
        found = (there - back) * rates
        found[:, 0] += self.origin
        return found


@dataclass(frozen=True)
class Ramp:
    """Like `Cycloidal`, at constant speed: its velocity jumps, its acceleration is 0."""

    travel: float = 1.0
    lasts: float = 3.0
    starts: tuple[float, float] = (1.0, 6.0)
    origin: float = 0.0

    def sample(self, time: FloatArray) -> FloatArray:
        """See `DesiredMotion`."""
        found = np.zeros((len(time), 4))
        found[:, 0] = self.origin
        for sign, start in zip((1.0, -1.0), self.starts, strict=True):
            share = (time - start) / self.lasts
            found[:, 0] += sign * self.travel * np.clip(share, 0.0, 1.0)
            moving = (share >= 0.0) & (share < 1.0)
            found[:, 1] += np.where(moving, sign * self.travel / self.lasts, 0.0)
        return found


@dataclass(frozen=True)
class Sine:
    """centre - amplitude cos(2 pi f t), at rest at its start and, from `ends` on, where it is."""

    amplitude: float
    frequency_hz: float
    centre: float = 0.0
    ends: float = np.inf

    def sample(self, time: FloatArray) -> FloatArray:
        """See `DesiredMotion`."""
        w = 2.0 * np.pi * self.frequency_hz
        t = np.minimum(time, self.ends)
        c, s = np.cos(w * t), np.sin(w * t)
        rates = np.where(time < self.ends, np.stack([w * s, w * w * c, -(w**3) * s]), 0.0)
        found = np.stack([-c, *rates], axis=1) * self.amplitude
        found[:, 0] += self.centre
        return found


def thesis_trajectory(number: int, vertical: bool = False) -> DesiredMotion:
    """Trajectory 1 to 4 of Table 4.2.1: cycloid, ramp, 0.5 rad at 1 Hz, 0.3 rad at 2 Hz."""
    sines = {3: (0.5, 1.0), 4: (0.3, 2.0)}
    if number in sines:
        amplitude, frequency = sines[number]
        centre = amplitude if vertical else 0.0
        return Sine(amplitude, frequency, centre, 9.5 if vertical and number == 4 else np.inf)
    if number not in (1, 2):
        raise input_error(f"trajectory {number}", "is not one of 1 to 4", "give one of these")
    kind = Cycloidal if number == 1 else Ramp
    return kind() if vertical else kind(origin=-0.5)


__all__ = [
    "DURATION_S",
    "SETTLED_S",
    "TRAJECTORIES",
    "Cycloidal",
    "DesiredMotion",
    "Ramp",
    "Sine",
    "thesis_trajectory",
]
