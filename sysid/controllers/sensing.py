"""What a controller sees of the plant: encoder counts, noisy pressures, filtered differences.

As on the rig (thesis 4.2.2): velocity and acceleration are differences of the encoder's
position, each through a causal second-order Butterworth low-pass of 50 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.controllers.guard import all_finite
from sysid.controllers.interface import StateEstimate
from sysid.io.rig import Rig
from sysid.plant.base import Array, array_namespace
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

    `rejected` (lanes,) counts the ticks with a reading that was not finite.
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
    """Memory at rest at the first readings; if one is not finite, at the first that are."""
    none = np.zeros(np.shape(first.position))
    pair = np.zeros((2, 1)) + none
    return SensingMemory(first, none, pair, pair, none)


def sense(
    memory: SensingMemory, readings: Readings, tick: Array, period: float, filters: Array
) -> tuple[SensingMemory, StateEstimate]:
    """The estimate after a tick's readings, and the memory.

    Where a reading, or what follows from it, is not finite, the memory stays what it was but for
    `rejected`, and all of the estimate is NaN, at which a controller lets go.

    `filters`: `filter_coefficients` by lane, (2, 3, lanes).
    """
    xp = array_namespace(readings.position)
    with np.errstate(all="ignore"):
        after, estimate = next_sample(memory, readings, tick, period, filters)
    given = [*readings, *estimate[1:], *_numbers(after), period, *filters[0], *filters[1]]
    good = all_finite(given)
    kept = SensingMemory(
        Readings(
            *(xp.where(good, new, old) for new, old in zip(after.last, memory.last, strict=True))
        ),
        xp.where(good, after.difference, memory.difference),
        xp.where(good, after.velocity_filter, memory.velocity_filter),
        xp.where(good, after.acceleration_filter, memory.acceleration_filter),
        memory.rejected + xp.where(good, 0.0, 1.0),
    )
    shown = (xp.where(good, value, xp.nan) for value in estimate[1:])
    return kept, StateEstimate(tick, *shown)


def next_sample(
    memory: SensingMemory, readings: Readings, tick: Array, period: float, filters: Array
) -> tuple[SensingMemory, StateEstimate]:
    """`sense` of readings that are finite; from a memory that is not, at rest at them."""
    xp = array_namespace(readings.position)
    is_started = True
    for value in _numbers(memory):
        is_started = is_started & xp.isfinite(value)
    before, old, *pairs = (
        xp.where(is_started, value, start)
        for value, start in (
            (memory.last.position, readings.position),
            (memory.difference, 0.0),
            *((memory.velocity_filter[k], 0.0) for k in (0, 1)),
            *((memory.acceleration_filter[k], 0.0) for k in (0, 1)),
        )
    )
    raw = (readings.position - before) / period
    change = (raw - old) / period
    velocity, first = _filtered(pairs[:2], raw, filters)
    acceleration, second = _filtered(pairs[2:], change, filters)
    position, a, b = readings
    estimate = StateEstimate(tick, position, velocity, acceleration, raw, a, b)
    return SensingMemory(readings, raw, first, second, memory.rejected), estimate


def _numbers(memory: SensingMemory) -> list[Array]:
    """The numbers on which the next sample depends, each (lanes,)."""
    pairs = (memory.velocity_filter, memory.acceleration_filter)
    return [*memory.last, memory.difference, *(pair[k] for pair in pairs for k in (0, 1))]


def _filtered(state: Sequence[Array], value: Array, filters: Array) -> tuple[Array, Array]:
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
