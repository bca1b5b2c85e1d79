"""A valve with a flow control in series (thesis 3.6): both coefficients from logs with and without.

    python -m benchmarks.flow_control [--first 3600] [--count 30] [--declared]

Drawn valves and flow controls, each tested with the flow control and without, one to three tests
each; the choked flows jump at their boundary as the thesis' do. Printed: the errors of the
coefficients of the valve and of the flow control, their 95 % intervals, and the law that the tests
choose. `--declared`: the valve's own coefficients are the rig file's, no test without is given.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.types import FloatArray
from sysid.valve_discrete import fit_valve_discrete

_GAS, _HEAT, _TEMPERATURE = 287.0, 1.4, 293.15
_CHOKED = 0.53


@dataclass(frozen=True)
class SeriesBench:
    """A held chamber on a valve and a flow control, by the thesis' equations of two orifices.

    `c_fill` kg/(s Pa^0.5) and `c_dis` kg/(s Pa), of the valve and of the flow control (None: there
    is none); choked flows of the valve kg/s; delays s; pressures and noise Pa; volume m3.
    """

    c_fill: tuple[float, float | None]
    c_dis: tuple[float, float | None]
    choked_fill: float
    choked_dis: float
    on_delay: float = 0.0017
    off_delay: float = 0.002
    supply: float = 3e5
    atmosphere: float = 1e5
    volume: float = 6e-5
    noise: float = 150.0
    period: float = 0.001
    on: float = 0.3
    off: float = 1.0
    end: float = 2.0

    @classmethod
    def drawn(cls, seed: int) -> SeriesBench:
        """A valve, a flow control, a chamber, its supply, delays and noise, drawn."""
        rng = np.random.default_rng([36, seed])
        supply, atmosphere = float(rng.uniform(2.4e5, 6e5)), float(rng.uniform(0.96e5, 1.02e5))
        # The valve alone fills the chamber's choked part in so many seconds.
        slow = float(np.exp(rng.uniform(math.log(0.03), math.log(0.2))))
        c_valve = float(np.exp(rng.uniform(math.log(1e-6), math.log(6e-6))))
        d_valve = c_valve * float(rng.uniform(0.9e-3, 2.2e-3))
        choked = c_valve * math.sqrt((1.0 - _CHOKED) * supply)
        empties = d_valve * atmosphere * (1.0 / _CHOKED - 1.0)
        volume = slow * _HEAT * _GAS * _TEMPERATURE * choked / (0.5 * supply)
        # How much the flow control lets through, over the valve.
        wide, wide_back = (float(np.exp(rng.uniform(math.log(0.5), math.log(3.0)))) for _ in "ab")
        falls = volume / (_HEAT * _GAS * _TEMPERATURE * d_valve) * (1.0 + 1.0 / wide_back)
        rises = slow * (1.0 + 1.0 / wide)
        period = float(rng.choice([0.0005, 0.001]))
        off = round((0.3 + 0.1 + 8.0 * rises) / period) * period
        return cls(
            (c_valve, wide * c_valve),
            (d_valve, wide_back * d_valve),
            choked * float(rng.uniform(0.8, 1.3)),
            empties * float(rng.uniform(0.8, 1.3)),
            on_delay=float(rng.uniform(0.001, 0.012)),
            off_delay=float(rng.uniform(0.001, 0.012)),
            supply=supply,
            atmosphere=atmosphere,
            volume=volume,
            noise=float(np.exp(rng.uniform(math.log(60.0), math.log(500.0)))),
            period=period,
            off=off,
            end=off + 0.1 + 10.0 * falls,
        )

    def bare(self) -> SeriesBench:
        """The same valve without its flow control."""
        return replace(self, c_fill=(self.c_fill[0], None), c_dis=(self.c_dis[0], None))

    def rig(self, declared: bool = False) -> Rig:
        """Its rig file; `declared`: with the valve's own coefficients."""
        area, stroke = 4.5e-4, 0.127
        offset = self.volume / area + 0.5 * stroke
        content = {
            "rig": {"name": "chamber", "motion": "linear", "orientation": "horizontal"},
            "air": {
                "gas_constant_j_per_kg_k": _GAS,
                "heat_capacity_ratio": _HEAT,
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
        }
        if declared:
            content["valve_a"] = {
                "law": "thesis-series",
                "valve_c_fill": self.c_fill[0],
                "valve_c_dis": self.c_dis[0],
            }
        return rig_from_content(content, "rig.toml")

    def flow(self, pressure: float, is_open: bool) -> float:
        """Flow into the chamber, kg/s (3.6.1 to 3.6.10): by the pressure between the two."""
        if is_open:
            one, two = self.c_fill
            share = 0.0 if two is None else one**2 / (one**2 + two**2)
            between = share * self.supply + (1.0 - share) * pressure
            if between <= _CHOKED * self.supply:
                return self.choked_fill
            return one * math.sqrt(max(self.supply - between, 0.0))
        one, two = self.c_dis
        share = 0.0 if two is None else one / (one + two)
        between = share * self.atmosphere + (1.0 - share) * pressure
        if between >= self.atmosphere / _CHOKED:
            return -self.choked_dis
        return one * (self.atmosphere - between)

    def pressure(self, at: FloatArray) -> FloatArray:
        """Pressure (n,) Pa by Heun's method in small steps."""
        gain = _HEAT * _GAS * _TEMPERATURE / self.volume
        opens, closes = self.on + self.on_delay, self.off + self.off_delay
        parts = 16
        step = self.period / parts

        def advanced(p: float, is_open: bool, dt: float) -> float:
            first = gain * self.flow(p, is_open)
            second = gain * self.flow(p + dt * first, is_open)
            return min(p + 0.5 * dt * (first + second), self.supply)

        found, p = np.empty(len(at)), self.atmosphere
        for row in range(len(at)):
            found[row] = p
            for part in range(parts):
                t = float(at[row]) + part * step
                edge = next((e for e in (opens, closes) if t < e < t + step), None)
                if edge is None:
                    p = advanced(p, opens <= t < closes, step)
                else:
                    p = advanced(p, opens <= t < closes, edge - t)
                    p = advanced(p, opens <= edge < closes, t + step - edge)
        return found

    def trials(self, seed: int, count: int, label: str = "") -> list[Trial]:
        """Tests that differ in their noise, 26 Pa to the count of the sensor."""
        at = np.arange(0.0, self.end, self.period)
        rng = np.random.default_rng(seed)
        true = self.pressure(at)
        command = ((at > self.on - 1e-9) & (at < self.off - 1e-9)).astype(float)
        has_control = self.c_fill[1] is not None
        found = []
        for number in range(count):
            noisy = true + self.noise * rng.standard_normal(len(at))
            channels = {
                "valve_a": command,
                "position_m": np.full(len(at), -0.0635),
                "pressure_a_pa": np.round(noisy / 26.0) * 26.0,
            }
            name = f"{label}{number}"
            found.append(Trial(name, at, channels, f"made, test {name}", flow_control=has_control))
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=3600)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--declared", action="store_true")
    asked = parser.parse_args()
    errors: dict[str, list[float]] = {}
    held: Counter[str] = Counter()
    counted: Counter[str] = Counter()
    laws: Counter[str] = Counter()
    began = time.process_time()
    for seed in range(asked.first, asked.first + asked.count):
        bench = SeriesBench.drawn(seed)
        trials = bench.trials(seed, 1 + seed % 3)
        if not asked.declared:
            trials += bench.bare().trials(seed + 10**6, 1 + seed % 2, "bare ")
        fit = fit_valve_discrete(trials, bench.rig(asked.declared), find_ratio=False)["a"]
        assert fit.choice is not None
        laws["/".join(dict.fromkeys(fit.choice.laws.values()))] += 1
        truths = {
            "valve_c_fill": bench.c_fill[0],
            "control_c_fill": bench.c_fill[1],
            "valve_c_dis": bench.c_dis[0],
            "control_c_dis": bench.c_dis[1],
            "choked_flow_fill_kg_s": bench.choked_fill,
            "choked_flow_dis_kg_s": bench.choked_dis,
        }
        line = []
        for name, truth in truths.items():
            found = fit.estimates.get(name)
            if found is None or not found.identified or truth is None:
                line.append(f"{name} -")
                counted[f"{name} not identified"] += 1
                continue
            error = found.value / truth - 1.0
            errors.setdefault(name, []).append(error)
            counted[name] += 1
            held[name] += found.holds(truth)
            line.append(f"{name} {100 * error:+.2f} %{'' if found.holds(truth) else '*'}")
        print(f"{seed}: {', '.join(line)}")
    print(f"laws: {dict(laws)}; {(time.process_time() - began) / asked.count:.1f} s each")
    for name, values in errors.items():
        worst = max(map(abs, values))
        print(
            f"{name}: median {100 * np.median(np.abs(values)):.2f} %, largest {100 * worst:.2f} %, "
            f"within 2 %: {sum(abs(v) < 0.02 for v in values)} of {len(values)}; "
            f"intervals hold in {held[name]} of {counted[name]}"
        )
    print({k: v for k, v in counted.items() if "not" in k})


if __name__ == "__main__":
    main()
