"""Samples of constant-duty valve tests, from the physics, for the tests and benchmarks of
the surfaces: valve law with its jump at the choked boundary (thesis 3.6.6, 3.6.10), pulses
with declared delays, pressure noise and quantisation, zero-phase filter, mean over periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from sysid.types import FloatArray

ATMOSPHERE = 1.0e5
VOLUME = 6.27e-5  # chamber A at the end of the stroke, m3
KRT = 1.4 * 287.0 * 293.15
STEP = 1e-4


@dataclass(frozen=True)
class Valve:
    """Parameters of Table 3.6.1 and the timing of the rig file."""

    choked_fill: float = 7.8e-4
    c_fill: float = 1.5e-6
    choked_dis: float = 3.5e-4
    c_dis: float = 3.7e-9
    supply: float = 3.0e5
    period: float = 5e-3
    on_delay: float = 1.7e-3
    off_delay: float = 2.0e-3

    def fill_flow(self, pressure: FloatArray) -> FloatArray:
        gap = self.supply - pressure
        free = self.c_fill * np.sign(gap) * np.sqrt(np.abs(gap))
        return np.where(pressure <= 0.53 * self.supply, self.choked_fill, free)

    def exhaust_flow(self, pressure: FloatArray) -> FloatArray:
        free = self.c_dis * (pressure - ATMOSPHERE)
        return np.where(pressure >= ATMOSPHERE / 0.53, self.choked_dis, free)

    def open_fraction(self, duty: FloatArray) -> FloatArray:
        """Share of a period in which the valve is open: a pulse or a gap that the delays
        swallow does not show."""
        pulse = duty * self.period + self.off_delay - self.on_delay
        return np.clip(pulse / self.period, 0.0, 1.0)

    def mean_flow(self, duty: FloatArray, pressure: FloatArray) -> FloatArray:
        share = self.open_fraction(duty)
        return share * self.fill_flow(pressure) - (1.0 - share) * self.exhaust_flow(pressure)


VALVE_A = Valve()
VALVE_B = Valve(choked_fill=1.3e-3, choked_dis=3.9e-4)


@dataclass(frozen=True)
class Samples:
    """(n,) each: one sample a window of whole PWM periods."""

    duty: FloatArray
    pressure: FloatArray
    flow: FloatArray
    test: NDArray[np.intp]


def simulate(valve: Valve, duty: FloatArray, start: float, seconds: float) -> FloatArray:
    """Chamber pressure (T, D) at 1 kHz for each duty (D,); the open share of every 0.1 ms step
    is exact, so pulses need not end on a step."""
    per_row = round(1e-3 / STEP)
    width = np.where(duty > 0, valve.open_fraction(duty) * valve.period, 0.0)
    pressure = np.full(len(duty), start)
    rows = np.empty((round(seconds * 1e3), len(duty)))
    for row in range(len(rows)):
        rows[row] = pressure
        for k in range(per_row):
            begin = (row * per_row + k) * STEP - valve.on_delay
            share = _open_until(begin + STEP, width, valve.period)
            share = (share - _open_until(begin, width, valve.period)) / STEP
            flow = share * valve.fill_flow(pressure) - (1 - share) * valve.exhaust_flow(pressure)
            pressure = pressure + STEP * KRT / VOLUME * flow
    return rows


def _open_until(time: float, width: FloatArray, period: float) -> FloatArray:
    whole, rest = np.divmod(time, period)
    return whole * width + np.minimum(rest, width)


def campaign(
    valve: Valve,
    direction: str,
    step: float = 0.02,
    noise: float = 250.0,
    seconds: float = 1.0,
    seed: int = 0,
) -> Samples:
    """Tests at duties 0.0001, 0.0001 + step, ... up to 0.9501 from the atmosphere ("fill") or
    from the supply ("discharge")."""
    duty = 0.0001 + step * np.arange(int(0.95 / step + 1e-9) + 1)
    start = ATMOSPHERE if direction == "fill" else valve.supply
    clean = simulate(valve, duty, start, seconds)
    noisy = clean + noise * np.random.default_rng(seed).standard_normal(clean.shape)
    measured = np.round(noisy / 26.0) * 26.0 if noise > 0 else clean
    smooth = sosfiltfilt(butter(2, 50.0, fs=1000.0, output="sos"), measured, axis=0)
    flow = VOLUME / KRT * np.gradient(smooth, 1e-3, axis=0)
    # Whole periods: 5 ms at 200 Hz, 4 ms at 250 Hz, 10 ms (three) at 300 Hz.
    window = next(w for w in range(1, 50) if abs(w / 1e3 / valve.period % 1.0) < 1e-6)
    count = len(clean) // window
    edges = slice(2, count - 2)  # the filter's run-in and run-out
    blocks = [a[: count * window].reshape(count, window, -1) for a in (smooth, flow)]
    p, m = (block.mean(axis=1)[edges].T for block in blocks)
    test = np.repeat(np.arange(len(duty)), p.shape[1])
    return Samples(duty[test], p.ravel(), m.ravel(), test)
