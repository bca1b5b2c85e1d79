"""How well tanks of any size, rate and law give their law back, and which law is chosen.

    python -m benchmarks.tanks [--draws 20] [--seed 0] [--kinds short slow exact choked iso warm]
    python -m benchmarks.tanks --verdicts            # with the verdict of the diagnosis of each
    python -m benchmarks.tanks --law thesis          # by that law, without the choice (faster)

Each draw has its own volume, law, noise, rate, duration and number of discharges. The pressure is
integrated apart from `sysid.plant`: the gas' mass and internal energy are the states.

`short`, `slow`, `exact`: the thesis' exhaust, 5 to 400 ml at 50 to 1000 Hz, 20 to 500 l at 0.2 to
2 Hz, 20 readings without noise. `choked`: from above its choked boundary. `cooled`, `isothermal`,
`adiabatic`: its flow out of gas with a temperature, that the wall warms a little, all or not at all
(of the former two the law is the gas' own). `iso`: ISO 6358,
isothermal; `warm`: ISO 6358 from a single recording, the gas warmed by the wall.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from sysid.estimation.linear import Estimate
from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.pipeline.fit_part import bench_fit

R, K = 287.0, 1.4
ANR_DENSITY, ANR_TEMPERATURE = 1.185, 293.15
Flow = Callable[[float, float], float]


@dataclass(frozen=True)
class Draw:
    """Discharges of one tank, its rig, and the truth: the law's name and its numbers by key."""

    trials: tuple[Trial, ...]
    rig: Rig
    law: str
    truth: Mapping[str, float]


@dataclass(frozen=True)
class Tank:
    """Volume (m3), pressure outside (Pa), and temperature of the room (K)."""

    volume: float
    atmosphere: float
    temperature: float

    def rig(self) -> Rig:
        air = {
            "gas_constant_j_per_kg_k": R,
            "heat_capacity_ratio": K,
            "temperature_k": self.temperature,
            "atmospheric_pressure_pa": self.atmosphere,
            "supply_pressure_pa": 8e5,
        }
        head = {"name": "tank", "orientation": "horizontal"}
        content = {"rig": head, "air": air, "tank": {"volume_m3": self.volume}}
        return rig_from_content(content, "generated")

    def base(self, flow: Callable[[float], float], start: float, times: np.ndarray) -> np.ndarray:
        """Pressure by the thesis' chamber, whose gas keeps its temperature (3.3.6)."""
        gain = K * R * self.temperature / self.volume
        jump = self.atmosphere / 0.53

        def boundary(_: float, p: np.ndarray) -> float:
            return float(p[0] - jump)

        boundary.terminal = True  # type: ignore[attr-defined]
        found, t, p = np.empty(len(times)), float(times[0]), start
        done = np.zeros(len(times), dtype=bool)
        for events in ([boundary] if start > jump else [], []):
            left = times[~done]
            if not len(left):
                break
            run = solve_ivp(
                lambda _, y: [-gain * flow(float(y[0]))], (t, float(times[-1]) + 1e-9), [p],
                t_eval=left, events=events or None, rtol=1e-10, atol=1e-6,
            )  # fmt: skip
            count = len(run.t)
            found[np.flatnonzero(~done)[:count]] = run.y[0]
            done[np.flatnonzero(~done)[:count]] = True
            if events and len(run.t_events[0]):
                t, p = float(run.t_events[0][0]), jump * (1.0 - 1e-12)
        return found

    def real(self, flow: Flow, wall: float, start: float, times: np.ndarray) -> np.ndarray:
        """Pressure of gas with a temperature; `wall` W/K, infinite for an isothermal tank."""
        volume, room = self.volume, self.temperature
        mass = start * volume / (R * room)
        c_v = R / (K - 1.0)

        def isothermal(_: float, y: np.ndarray) -> list[float]:
            return [-flow(float(y[0]) * R * room / volume, room)]

        def warmed(_: float, y: np.ndarray) -> list[float]:
            m, energy = y
            gas = energy / (m * c_v)
            out = flow(m * R * gas / volume, gas)
            return [-out, -out * K * c_v * gas + wall * (room - gas)]

        span, rates = (0.0, float(times[-1]) + 1e-9), warmed if np.isfinite(wall) else isothermal
        begin = [mass, mass * c_v * room] if np.isfinite(wall) else [mass]
        run = solve_ivp(rates, span, begin, t_eval=times, method="LSODA", rtol=1e-9, atol=1e-12)
        if np.isfinite(wall):
            return np.asarray((K - 1.0) * run.y[1] / volume)
        return np.asarray(run.y[0] * R * room / volume)


def iso_flow(conductance: float, ratio: float, index: float, outside: float) -> Flow:
    """Flow out by ISO 6358, kg/s, of the pressure (Pa) and the temperature (K) of the gas."""

    def flow(pressure: float, gas: float) -> float:
        if pressure <= outside:
            return 0.0
        beyond = max(outside / pressure - ratio, 0.0) / (1.0 - ratio)
        share = (1.0 - beyond * beyond) ** index
        return conductance * ANR_DENSITY * np.sqrt(ANR_TEMPERATURE / gas) * pressure * share

    return flow


def _log(
    rng: np.random.Generator, pressure: np.ndarray, times: np.ndarray, noise: float, name: str
) -> Trial:
    """Some rows of the full tank, its valve on, and the discharge."""
    step, before = float(times[1] - times[0]), int(rng.integers(0, 12))
    time_s = np.concatenate([step * np.arange(-before, 0), times]) + before * step
    values = np.concatenate([np.full(before, pressure[0]), pressure])
    values = values + noise * rng.standard_normal(len(values))
    on = np.arange(len(time_s)) < before
    return Trial(name, time_s, {"pressure_a_pa": values, "valve_a": on.astype(float)}, name)


def _thesis(rng: np.random.Generator, kind: str) -> Draw:
    volume = 10 ** {"short": rng.uniform(-5.3, -3.4), "slow": rng.uniform(-1.7, -0.3)}.get(
        kind, rng.uniform(-4.0, -1.5)
    )
    tank = Tank(volume, rng.uniform(9.6e4, 1.03e5), rng.uniform(285.0, 303.0))
    scale = 10 ** {"short": rng.uniform(-1.3, -0.1), "slow": rng.uniform(1.2, 2.3)}.get(
        kind, rng.uniform(-0.5, 1.3)
    )
    c_dis = volume / (K * R * tank.temperature * scale)
    reach = tank.atmosphere / 0.53 - tank.atmosphere
    choked = c_dis * reach * rng.uniform(0.93, 1.1)
    truth = {"c_dis": c_dis}
    levels = rng.uniform(0.35, 0.85, int(rng.integers(1, 4))) * reach
    if kind == "choked":
        levels, truth = rng.uniform(1.6, 4.0, len(levels)) * reach, {
            **truth, "choked_flow_dis_kg_s": choked,
        }  # fmt: skip

    def flow(p: float) -> float:
        return choked if p >= tank.atmosphere / 0.53 else c_dis * (p - tank.atmosphere)

    rows = 20 if kind == "exact" else int(rng.uniform(80, 700))
    lasts = scale * rng.uniform(3.0, 9.0) * (1.0 if kind != "choked" else 1.6)
    noise = 0.0 if kind == "exact" else 10 ** rng.uniform(0.7, 2.0)
    times = np.linspace(0.0, lasts, rows)
    trials = [
        _log(rng, tank.base(flow, tank.atmosphere + level, times), times, noise, f"{kind} {i}")
        for i, level in enumerate(levels)
    ]
    return Draw(tuple(trials), tank.rig(), "thesis", truth)


def _cooled(rng: np.random.Generator, kind: str) -> Draw:
    """The thesis' flow out of gas with a temperature."""
    tank = Tank(10 ** rng.uniform(-4.3, -0.7), rng.uniform(9.6e4, 1.03e5), rng.uniform(285, 303))
    scale = 10 ** rng.uniform(-0.3, 2.0)
    c_dis = tank.volume / (K * R * tank.temperature * scale)
    reach = tank.atmosphere / 0.53 - tank.atmosphere
    choked = c_dis * reach * rng.uniform(0.93, 1.1)
    truth, levels = {"c_dis": c_dis}, rng.uniform(0.5, 0.9, int(rng.integers(1, 4))) * reach
    if rng.random() < 0.5:
        levels = rng.uniform(1.6, 4.0, len(levels)) * reach
        truth["choked_flow_dis_kg_s"] = choked

    def flow(p: float, _: float) -> float:
        return choked if p >= tank.atmosphere / 0.53 else max(c_dis * (p - tank.atmosphere), 0.0)

    # How many times the wall warms the gas through while the tank empties.
    times_warm = 10 ** rng.uniform(-0.7, 0.7)
    held = tank.atmosphere * tank.volume / tank.temperature
    wall = {"isothermal": np.inf, "adiabatic": 0.0}.get(
        kind, times_warm * held / ((K - 1.0) * scale)
    )
    times = np.linspace(0.0, scale * rng.uniform(3.0, 7.0), int(rng.uniform(100, 700)))
    noise = 10 ** rng.uniform(0.7, 2.0)
    trials = [
        _log(rng, tank.real(flow, wall, tank.atmosphere + own, times), times, noise, f"{kind} {i}")
        for i, own in enumerate(levels)
    ]
    return Draw(tuple(trials), tank.rig(), "thesis", truth)


def _real(rng: np.random.Generator, kind: str) -> Draw:
    tank = Tank(10 ** rng.uniform(-3.3, -1.5), rng.uniform(9.6e4, 1.03e5), rng.uniform(285, 303))
    scale, ratio = 10 ** rng.uniform(-0.3, 1.2), rng.uniform(0.15, 0.55)
    conductance = tank.volume / (R * tank.temperature * ANR_DENSITY * scale)
    surface = 6.0 * tank.volume ** (2.0 / 3.0)
    wall = np.inf if kind == "iso" else surface * 10 ** rng.uniform(0.3, 1.7)
    flow = iso_flow(conductance, ratio, 0.5, tank.atmosphere)
    count = int(rng.integers(2, 5)) if kind == "iso" else 1
    noise, rows = 10 ** rng.uniform(0.8, 2.4), int(rng.uniform(100, 800))
    times = np.linspace(0.0, scale * rng.uniform(3.0, 7.0), rows)
    trials = [
        _log(rng, tank.real(flow, wall, start, times), times, noise, f"{kind} {i}")
        for i, start in enumerate(rng.uniform(3.5e5, 8e5, count))
    ]
    truth = {"sonic_conductance": conductance, "critical_ratio": ratio}
    return Draw(tuple(trials), tank.rig(), "iso6358", truth)


def drawn(kind: str, seed: int) -> Draw:
    """A tank of a kind and its discharges, by a seed."""
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    made = {"iso": _real, "warm": _real} | dict.fromkeys(_COOLED, _cooled)
    return made.get(kind, _thesis)(rng, kind)


_COOLED = ("cooled", "isothermal", "adiabatic")
KINDS = ("short", "slow", "exact", "choked", *_COOLED, "iso", "warm")


def verdict_of(draw: Draw, bundle_parts: object) -> str:
    """The verdict of the diagnosis of a draw, without held-out tests."""
    from sysid.diagnosis.bench.diagnose import diagnose_component
    from sysid.parameters import Bundle
    from sysid.plant.effects.catalogue import catalogue

    bundle = Bundle.new(draw.rig, bundle_parts, [])
    found = diagnose_component("tank", draw.trials, (), draw.rig, bundle, catalogue())
    return f"{found.verdict} {[e.id for e in found.effects]} {found.reason or ''}".strip()


def measured(kind: str, draws: int, first: int, verdicts: bool, by: str = "auto") -> None:
    """Law, errors and intervals of draws of a kind, a line each, and their sums."""
    right, errors, held = [], {}, {}  # type: ignore[var-annotated]
    for seed in range(first, first + draws):
        draw, began = drawn(kind, seed), time.process_time()
        line = f"{kind} {seed}:"
        try:
            found = bench_fit("tank", draw.trials, draw.rig, by)
        except Exception as error:  # a benchmark counts what fails
            print(f"{line} FAILS {type(error).__name__}: {error}", flush=True)
            right.append(False)
            continue
        part = found.part()
        law = part.valves.side("a").discrete
        assert law is not None
        name = law.law_of("dis")
        right.append(name == draw.law)
        values: dict[str, Estimate] = {
            key.removesuffix(".exhaust"): estimate for key, estimate in law.estimates().items()
        }
        for key, true in draw.truth.items():
            estimate = values.get(key)
            if estimate is None or not estimate.identified:
                line += f" {key} not identified"
                continue
            scale = 1.0 if key == "critical_ratio" else true
            errors.setdefault(key, []).append(abs(estimate.value - true) / scale)
            holds = estimate.interval[0] <= true <= estimate.interval[1]
            held.setdefault(key, []).append(holds)
            wide = (estimate.interval[1] - estimate.interval[0]) / scale
            line += f" {key} {errors[key][-1]:.2g} of {wide:.2g}{'' if holds else ' OUT'}"
        seconds = time.process_time() - began
        said = f" {verdict_of(draw, part)}" if verdicts else ""
        wall = law.wall_conductance_w_per_k
        gas = "gas warmed" if name == "thesis" and wall is not None else ""
        gas += " open" if any("do not distinguish" in line for line in found.notices) else ""
        quality = law.quality["discharge"].verdict if isinstance(law.quality, dict) else ""
        print(f"{line} {name} {gas} {quality} {seconds:.1f} s{said}", flush=True)
    print(f"{kind}: law right in {sum(right)} of {len(right)}")
    for key, own in errors.items():
        print(
            f"  {key}: median error {np.median(own):.2g}, largest {max(own):.2g}, "
            f"intervals hold in {sum(held[key])} of {len(held[key])}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--verdicts", action="store_true")
    parser.add_argument("--law", choices=("auto", "thesis", "iso6358"), default="auto")
    asked = parser.parse_args()
    for kind in asked.kinds:
        measured(kind, asked.draws, asked.seed, asked.verdicts, asked.law)


if __name__ == "__main__":
    main()
