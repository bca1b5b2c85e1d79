"""Tests of an on/off valve of ISO 6358 on a held chamber, by its own equations and steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.types import FloatArray

_GAS, _TEMPERATURE, _ANR = 287.0, 293.15, 1.185


def _share(ratio: float, critical: float, index: float) -> float:
    if ratio <= critical:
        return 1.0
    beyond = min((ratio - critical) / (1.0 - critical), 1.0)
    return float((1.0 - beyond * beyond) ** index)


@dataclass(frozen=True)
class IsoBench:
    """A held chamber on such a valve: conductance (m3/(s Pa)) and critical ratio each way.

    Times in s, pressures and noise in Pa, volume in m3.
    """

    fill: tuple[float, float] = (1.5e-8, 0.3)
    exhaust: tuple[float, float] = (1.3e-8, 0.22)
    on_delay: float = 0.012
    off_delay: float = 0.009
    supply: float = 6e5
    atmosphere: float = 1.01325e5
    volume: float = 1.2e-4
    noise: float = 250.0
    period: float = 0.001
    index: float = 0.5
    on: float = 0.3
    off: float = 1.0
    end: float = 1.8

    @classmethod
    def drawn(cls, seed: int) -> IsoBench:
        """A valve, chamber, supply, delays, noise and sampling, drawn."""
        rng = np.random.default_rng([6358, seed])
        supply = float(rng.uniform(3.5e5, 9e5))
        fill = float(np.exp(rng.uniform(math.log(2e-9), math.log(5e-8))))
        exhaust = fill * float(rng.uniform(0.7, 1.2))
        # Time constant of the faster direction, s.
        slow = float(np.exp(rng.uniform(math.log(0.015), math.log(0.25))))
        gain = 1.4 * _GAS * _TEMPERATURE * _ANR
        period = float(rng.choice([0.0005, 0.001, 0.002]))
        # A command's edge is at a sample.
        off = round((0.7 + 4.0 * slow) / period) * period
        return cls(
            fill=(fill, float(rng.uniform(0.12, 0.48))),
            exhaust=(exhaust, float(rng.uniform(0.12, 0.48))),
            on_delay=float(rng.uniform(0.002, 0.02)),
            off_delay=float(rng.uniform(0.002, 0.02)),
            supply=supply,
            atmosphere=float(rng.uniform(0.95e5, 1.03e5)),
            volume=slow * gain * max(fill, exhaust),
            noise=float(np.exp(rng.uniform(math.log(60.0), math.log(1200.0)))),
            period=period,
            on=0.3,
            off=off,
            end=off + 0.4 + 10.0 * slow,
        )

    def rig(self) -> Rig:
        area, stroke = 8e-4, 0.2
        offset = self.volume / area + 0.5 * stroke
        return rig_from_content(
            {
                "rig": {"name": "chamber", "motion": "linear", "orientation": "horizontal"},
                "air": {
                    "gas_constant_j_per_kg_k": _GAS,
                    "heat_capacity_ratio": 1.4,
                    "temperature_k": _TEMPERATURE,
                    "atmospheric_pressure_pa": self.atmosphere,
                    "supply_pressure_pa": self.supply,
                },
                "cylinder": {
                    "area_a_m2": area,
                    "area_b_m2": area,
                    "offset_a_m": offset,
                    "offset_b_m": offset,
                    "stroke_m": stroke,
                },
            },
            "rig.toml",
        )

    def pressure(self, time: FloatArray) -> FloatArray:
        """Pressure (n,) Pa by Heun's method in small steps."""
        gain = 1.4 * _GAS * _TEMPERATURE / self.volume
        fastest = gain * _ANR * max(self.fill[0], self.exhaust[0]) * self.supply
        parts = max(4, math.ceil(self.period * fastest / (5e-4 * self.supply)))
        step = self.period / parts
        opens, closes = self.on + self.on_delay, self.off + self.off_delay

        def rate(t: float, p: float) -> float:
            if opens <= t < closes:
                c, b = self.fill
                if p >= self.supply:
                    return 0.0
                return gain * c * _ANR * self.supply * _share(p / self.supply, b, self.index)
            c, b = self.exhaust
            if p <= self.atmosphere:
                return 0.0
            return -gain * c * _ANR * p * _share(self.atmosphere / p, b, self.index)

        found, p = np.empty(len(time)), self.atmosphere
        for row in range(len(time)):
            found[row] = p
            for part in range(parts):
                t = float(time[row]) + part * step
                first = rate(t, p)
                if first == 0.0 and rate(t + step, p) == 0.0:
                    continue
                # An edge inside a step: each side for its own share of it.
                edge = next((e for e in (opens, closes) if t < e < t + step), None)
                if edge is not None:
                    p += (edge - t) * first
                    p += (t + step - edge) * rate(edge, p)
                else:
                    second = rate(t + 0.999999 * step, p + step * first)
                    p += 0.5 * step * (first + second)
                low, high = sorted((self.atmosphere, self.supply))
                p = min(max(p, low), high)
        return found

    def trials(self, seed: int, count: int = 1, scatter: float = 0.0) -> list[Trial]:
        """Tests that differ in their noise, 26 Pa to the count of the sensor.

        `scatter`: standard deviation of both conductances from test to test, as a share.
        """
        time = np.arange(0.0, self.end, self.period)
        rng = np.random.default_rng(seed)
        true = self.pressure(time)
        command = ((time > self.on - 1e-9) & (time < self.off - 1e-9)).astype(float)
        found = []
        for number in range(count):
            if scatter > 0.0:
                factor = 1.0 + scatter * float(rng.standard_normal())
                (fill, b), (exhaust, c) = self.fill, self.exhaust
                own = replace(self, fill=(factor * fill, b), exhaust=(factor * exhaust, c))
                true = own.pressure(time)
            noisy = true + self.noise * rng.standard_normal(len(time))
            channels = {
                "valve_a": command,
                # The volume is that at the lower end.
                "position_m": np.full(len(time), -0.1),
                "pressure_a_pa": np.round(noisy / 26.0) * 26.0,
            }
            found.append(Trial(str(number), time, channels, f"made, test {number}"))
        return found
