"""What a controller sees of the plant: encoder counts, noisy pressures, filtered differences.

As on the rig (thesis 4.2.2): velocity and acceleration are differences of the encoder's
position, each through a causal second-order Butterworth low-pass of 50 Hz.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.controllers.interface import StateEstimate
from sysid.io.rig import Rig
from sysid.model.base import Array, array_namespace
from sysid.signals import DEFAULT_CUTOFF_HZ, FILTER_ORDER
from sysid.types import FloatArray


@dataclass(frozen=True)
class SensorSuite:
    """Resolution of the position (rad or m), noise (std) and resolution of pressures, Pa.

    0 stands for a perfect one. `cutoff_hz` is that of the differences' filter; infinite for
    none. The defaults are the reference rig's: 80,000 counts a revolution, 150 Pa of noise,
    26 Pa a count.
    """

    position_step: float = 2.0 * np.pi / 80000.0
    pressure_noise: float = 150.0
    pressure_step: float = 26.0
    cutoff_hz: float = DEFAULT_CUTOFF_HZ

    @classmethod
    def perfect(cls) -> SensorSuite:
        """Sensors that show the truth, and differences that no filter delays."""
        return cls(0.0, 0.0, 0.0, np.inf)

    @classmethod
    def of(cls, rig: Rig) -> SensorSuite:
        """The sensors that a rig file declares; what it does not say is perfect."""
        s = rig.sensors
        counts = (
            (s.encoder_counts_per_m if rig.is_linear else s.encoder_counts_per_rev) if s else None
        )
        turn = 1.0 if rig.is_linear else 2.0 * np.pi
        noise = (s.pressure_noise_pa if s else None) or 0.0
        return cls(turn / counts if counts else 0.0, noise, 0.0)


class Readings(NamedTuple):
    """Raw readings at a tick, (lanes,): rad or m, Pa."""

    position: Array
    pressure_a: Array
    pressure_b: Array


class SensingMemory(NamedTuple):
    """Last good readings; last difference; the two filters' states (2, lanes) each.

    `rejected` (lanes,) counts readings that were not finite.
    """

    last: Readings
    difference: Array
    velocity_filter: Array
    acceleration_filter: Array
    rejected: Array


def filter_coefficients(period: float, cutoff_hz: float = DEFAULT_CUTOFF_HZ) -> FloatArray:
    """(2, 3): numerator and denominator of the Butterworth low-pass at this sampling, s.

    Those of no filter at all from the Nyquist frequency on.
    """
    from scipy import signal

    if not cutoff_hz < 0.5 / period:
        return np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    return np.stack(signal.butter(FILTER_ORDER, cutoff_hz, fs=1.0 / period))


def quantised(value: Array, step: Array) -> Array:
    """A value as a count of steps shows it; as it is where the step is 0."""
    xp = array_namespace(value, step)
    real = xp.where(step > 0.0, step, 1.0)
    return xp.where(step > 0.0, xp.round(value / real) * real, value)


def start_sensing(first: Readings) -> SensingMemory:
    """Memory at rest at the first readings."""
    none = 0.0 * first.position
    pair = np.zeros((2, 1)) + none
    return SensingMemory(first, none, pair, pair, none)


def sense(
    memory: SensingMemory, readings: Readings, tick: Array, period: float, filters: Array
) -> tuple[SensingMemory, StateEstimate]:
    """The estimate after a tick's readings; one that is not finite is the last good one.

    `filters`: `filter_coefficients` by lane, (2, 3, lanes).
    """
    xp = array_namespace(readings.position)
    good = Readings(
        *(
            xp.where(xp.isfinite(new), new, old)
            for new, old in zip(readings, memory.last, strict=True)
        )
    )
    lost = sum(xp.where(xp.isfinite(new), 0.0, 1.0) for new in readings)
    raw = (good.position - memory.last.position) / period
    change = (raw - memory.difference) / period
    velocity, first = _filtered(memory.velocity_filter, raw, filters)
    acceleration, second = _filtered(memory.acceleration_filter, change, filters)
    estimate = StateEstimate(
        tick, good.position, velocity, acceleration, raw, good.pressure_a, good.pressure_b
    )
    rejected: Any = memory.rejected + lost
    return SensingMemory(good, raw, first, second, rejected), estimate


def _filtered(state: Array, value: Array, filters: Array) -> tuple[Array, Array]:
    """One sample through the filter (direct form II transposed) and the state after it."""
    xp = array_namespace(value)
    (b0, b1, b2), (_, a1, a2) = filters
    out = b0 * value + state[0]
    return out, xp.stack([b1 * value - a1 * out + state[1], b2 * value - a2 * out])


__all__ = [
    "Readings",
    "SensingMemory",
    "SensorSuite",
    "filter_coefficients",
    "quantised",
    "sense",
    "start_sensing",
]
