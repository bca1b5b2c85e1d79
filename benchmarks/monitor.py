"""The monitor on generated machines: false alarms while healthy, and what it finds of wear.

    python benchmarks/monitor.py healthy [--machines 8] [--hours 0.5] [--first 5000]
    python benchmarks/monitor.py exported [--machines 8] [--hours 10] [--first 5000]
    python benchmarks/monitor.py wear [--machines 10] [--first 5000]

Machines are the generator's: its equations, integrator and sensors are its own. A machine repeats
a motion of its own to and fro, on/off or under PWM, until an end stop; friction scatters from
cycle to cycle as the bundle says. Its bundle is off by errors of the size that it states.

`healthy`: how many alarms there are in so many hours of motion of each machine. `exported`: the
same by its exported C, compiled with gcc -O2: 200 healthy cycles of the plant are simulated, and
played again and again from a random one on, with noise of its own each time; a reading is missing
where the first one follows the last, so that no state jumps; the monitor begins anew, and learns,
every 1,000 cycles. `wear`: each drift at twice the
smallest change that the monitor states for ten cycles of this machine's motion; how many are found
within ten cycles, and named rightly.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from datasets.generator.effects.catalogue import Injected  # noqa: E402
from datasets.generator.rigs import GeneratedRig, random_rig  # noqa: E402
from datasets.generator.runs import Commands, Start, simulated  # noqa: E402
from datasets.generator.sensors import PRESSURE_COUNT_PA, measured  # noqa: E402
from sysid.controllers.monitor.design import MonitorDesign, monitor_design  # noqa: E402
from sysid.controllers.monitor.drifts import DRIFTS, NAMES, TESTED, UNDECIDED  # noqa: E402
from sysid.controllers.monitor.evidence import WITHIN, detectable, mean_cycle  # noqa: E402
from sysid.controllers.monitor.logged import CycleVerdict, WatchedSamples, monitored  # noqa: E402
from sysid.exporters import export_bundle  # noqa: E402
from sysid.io.motion import LINEAR, ROTARY  # noqa: E402
from sysid.parameters import Bundle  # noqa: E402
from sysid.parameters.content import SCHEMA  # noqa: E402
from sysid.parameters.files import bundle_from_json  # noqa: E402
from sysid.types import FloatArray  # noqa: E402

# Relative standard errors of a bundle's numbers, and of the delays, s, as usual campaigns give.
FRICTION_ERROR, FLOW_ERROR, DELAY_ERROR_S = 0.01, 0.003, 3e-5
SCATTER = 0.02
SETTLING = 15
"""Healthy cycles before a drift begins."""


@dataclass(frozen=True)
class Machine:
    """A generated machine at work: its rig, its bundle, and the motion that it repeats."""

    rig: GeneratedRig
    bundle: Bundle
    rest_s: float
    stroke_s: float
    duties: tuple[float, float] | None
    motor: float

    def commands(self) -> Commands:
        """One cycle: B open at first, then A, then B."""
        h = self.rig.row_period
        rest, stroke = round(self.rest_s / h), round(self.stroke_s / h)
        a = np.concatenate((np.zeros(rest), np.ones(stroke), np.zeros(stroke + 1)))
        motor = self.motor * (2.0 * a - 1.0)
        if self.duties is None:
            return Commands(motor, valve_a=a, valve_b=1.0 - a)
        high, low = self.duties
        duty_a, duty_b = low + (high - low) * a, high + (low - high) * a
        # No pulse lasts from one cycle into the next, which is integrated anew.
        quiet = 1 + 2 * round(float(self.rig.content["pwm"]["period_s"]) / h)
        duty_a[-quiet:] = duty_b[-quiet:] = 0.0
        return Commands(motor, duty_a=duty_a, duty_b=duty_b)


def machine(seed: int) -> Machine:
    """The machine of a seed."""
    rng = np.random.default_rng([seed, 1])
    rig = random_rig(rng, motion=("rotary", "linear")[seed % 2])
    duties = None
    if seed % 3 == 2:
        duties = float(rng.uniform(0.6, 0.9)), float(rng.uniform(0.05, 0.2))
    motor = float(rng.uniform(0.0, 0.3)) * rig.max_effort if seed % 5 == 4 else 0.0
    periods = 1.0 / rig.row_period
    rest, stroke = rng.uniform(0.1, 0.5), rng.uniform(0.6, 1.5)
    # Whole PWM periods, so that each cycle begins with one.
    rest, stroke = (5.0 * round(v * periods / 5.0) / periods for v in (rest, stroke))
    return Machine(rig, _bundle(rig, rng), rest, stroke, duties, motor)


def _bundle(rig: GeneratedRig, rng: np.random.Generator) -> Bundle:
    """A bundle of the rig's truth, off by errors of the size that it states."""

    def known(value: float, std: float, unit: str) -> dict[str, Any]:
        return {"value": value + std * float(rng.standard_normal()), "std": std, "unit": unit}

    truth = rig.truth_content()
    units = LINEAR if rig.is_linear else ROTARY
    friction = {
        key: known(value, FRICTION_ERROR * value, units.unit(name))
        for (key, value), name in zip(
            truth["friction"].items(), units.named(truth["friction"]), strict=True
        )
    }
    valves = {}
    for side, law in truth["valves"].items():
        other = {"c_fill": "kg/(s Pa^0.5)", "c_dis": "kg/(s Pa)"}
        flows = {
            key: known(value, FLOW_ERROR * value, other.get(key, "kg/s"))
            for key, value in law.items()
        }
        delays = {
            key: known(float(rig.content["valves"][key]), DELAY_ERROR_S, "s")
            for key in ("on_delay_s", "off_delay_s")
        }
        level = float(rig.content["air"]["supply_pressure_pa"])
        valves[side] = {"discrete": {**flows, **delays, "supply_pressure_pa": level}}
    content = {
        "schema": SCHEMA,
        "created": "2026-01-02T03:04:05+00:00",
        "sysid_version": "0",
        "rig": rig.content,
        "friction": friction,
        "valves": valves,
        "effects": [],
        "provenance": {"logs": [], "seeds": {}, "options": {}},
    }
    return bundle_from_json(content, Path("generated.json"))


@dataclass(frozen=True)
class Change:
    """What became of a machine: factors and terms on its truth, by the name of the drift."""

    name: str = ""
    size: float = 0.0

    def rig(self, rig: GeneratedRig) -> GeneratedRig:
        """The rig with a leak or a late valve, which are effects of the generator."""
        name, side = self.name, self.name[-1:]
        if name == "piston_leak":
            effect = Injected("piston-leakage", "quadratic", "", {"piston_quadratic": self.size})
        elif name.startswith("leak_"):
            effect = Injected(
                "atmosphere-leakage", "quadratic", side, {"leak_quadratic": self.size}
            )
        elif "delay" in name:
            edge = name.partition("_")[0]
            effect = Injected("valve-delay", edge, side, {f"{edge}_delay_s": self.size})
        else:
            return rig
        return replace(rig, effects=(effect,))

    def of(self, name: str) -> float:
        """Its size, where it is of this drift."""
        return self.size if self.name == name else 0.0


def cycles(
    made: Machine, count: int, rng: np.random.Generator, change: Change | None = None
) -> Iterator[dict[str, FloatArray]]:
    """The rows of each cycle; `change` begins after `SETTLING` of them."""
    rig, commands = made.rig, made.commands()
    for own, states in simulated_cycles(made, count, rng, change):
        columns = commands.columns(rig) | measured(states, own, rig.truth.pressure_noise_pa, rng)
        yield {name: values[:-1] for name, values in columns.items()}


def simulated_cycles(
    made: Machine, count: int, rng: np.random.Generator, change: Change | None = None
) -> Iterator[tuple[GeneratedRig, FloatArray]]:
    """The rig and the states (n, ...) of each cycle, the next one's first among them."""
    rig, commands = made.rig, made.commands()
    position, pressures = -rig.half_travel, (rig.atmosphere, float(_supply(rig)))
    for k in range(count):
        now = change if change is not None and k >= SETTLING else Change()
        sliding, static = np.exp(SCATTER * rng.standard_normal(2))
        own = now.rig(rig)
        plant = own.plant(static, sliding)
        plant = plant._replace(
            coulomb_friction=plant.coulomb_friction + now.of("coulomb"),
            static_friction=plant.static_friction + now.of("coulomb"),
            viscous_friction=plant.viscous_friction + now.of("viscous"),
            supply=plant.supply + now.of("supply"),
        )
        start = Start(position, *pressures, (0, int(made.duties is None)))
        states = simulated(own, plant, commands, start)
        position, pressures = float(states[-1, 0]), (float(states[-1, 2]), float(states[-1, 3]))
        yield own, states


def _supply(rig: GeneratedRig) -> float:
    return float(rig.content["air"]["supply_pressure_pa"])


def samples_of(made: Machine, rows: list[dict[str, FloatArray]]) -> WatchedSamples:
    """The cycles as one recorded test."""
    columns = {name: np.concatenate([own[name] for own in rows]) for name in rows[0]}
    n = len(next(iter(columns.values())))
    position = "position_m" if made.rig.is_linear else "theta_rad"
    motor = columns.get("motor_force_n", columns.get("motor_torque_nm", np.zeros(n)))
    stem = "valve" if made.duties is None else "duty"
    return WatchedSamples(
        np.arange(n) * made.rig.row_period,
        columns[position],
        {s: columns[f"pressure_{s}_pa"] for s in "ab"},
        motor,
        {s: columns[f"{stem}_{s}"] for s in "ab"},
        dict.fromkeys("ab", made.duties is not None),
    )


def watched(
    made: Machine, design: MonitorDesign, count: int, seed: int, change: Change | None = None
) -> list[CycleVerdict]:
    """The monitor's verdicts over so many cycles."""
    rng = np.random.default_rng([seed, 2])
    rows = list(cycles(made, count, rng, change))
    pool = design.pool()
    return monitored(design, samples_of(made, rows), pool)


def changes_of(made: Machine, design: MonitorDesign, seed: int) -> FloatArray:
    """The smallest detectable changes within ten cycles of this machine's motion, (p,) SI."""
    seen = watched(made, design, 4, seed + 1_000_000)
    mean = mean_cycle([c.cycle for c in seen])
    found = detectable(mean, design.scatter, design.errors, design.scales)
    return found.by_cycles[max(WITHIN)]


@dataclass(frozen=True)
class Found:
    """What became of one drift: the kind at its first alarm, and after how many cycles."""

    seed: int
    drift: str
    size: float
    first: int | None
    kind: str
    before: int


def wear(seed: int, times: float) -> Iterator[Found]:
    """Each drift of one machine at so many times its smallest detectable change."""
    made = machine(seed)
    design = monitor_design(made.bundle)
    sizes = changes_of(made, design, seed)
    for k in TESTED:
        if not np.isfinite(sizes[k]):
            yield Found(seed, NAMES[k], float("inf"), None, "", 0)
            continue
        # Growing friction and leaks, late valves, a supply that falls.
        size = times * float(sizes[k]) * (-1.0 if NAMES[k] == "supply" else 1.0)
        seen = watched(made, design, SETTLING + max(WITHIN) + 1, seed, Change(NAMES[k], size))
        # The verdict of cycle k comes with the turn in the cycle after it.
        kinds = [c.verdict.kind for c in seen]
        after = [i for i, kind in enumerate(kinds) if i >= SETTLING - 1 and kind]
        first = after[0] - SETTLING + 2 if after else None
        named = next((kinds[i] for i in after if kinds[i] != UNDECIDED), "")
        before = sum(1 for kind in kinds[: SETTLING - 1] if kind)
        yield Found(seed, NAMES[k], size, first, named or (UNDECIDED if after else ""), before)


def show_wear(seeds: range, times: float) -> None:
    """Prints what was found, drift by drift and over all."""
    total: Counter[str] = Counter()
    for seed in seeds:
        for found in wear(seed, times):
            kind = DRIFTS[NAMES.index(found.drift)].kind
            in_time = found.first is not None and found.first <= max(WITHIN)
            possible = np.isfinite(found.size)
            total["asked"] += possible
            total["found"] += in_time
            total["named"] += in_time and found.kind == kind
            total[f"found {kind}"] += in_time
            total[f"named {kind}"] += in_time and found.kind == kind
            total[f"asked {kind}"] += possible
            total["before"] += found.before
            print(found, flush=True)
        print(dict(total), flush=True)


def show_healthy(seeds: range, hours: float) -> None:
    """Prints the alarms in so many hours of each machine, in stretches of 50 cycles."""
    alarms, count, time_s = 0, 0, 0.0
    for seed in seeds:
        made = machine(seed)
        design = monitor_design(made.bundle)
        pool, left, part = design.pool(), 3600.0 * hours, 0
        while left > 0.0:
            rng = np.random.default_rng([seed, 3, part])
            given = samples_of(made, list(cycles(made, 50, rng)))
            seen = monitored(design, given, pool)
            alarms += sum(1 for c in seen if c.verdict.alarms)
            count, part = count + len(seen), part + 1
            left -= float(given.time[-1])
            time_s += float(given.time[-1])
        print(
            f"machine {seed}: {alarms} alarms in {count} cycles, {time_s / 3600.0:.2f} h",
            flush=True,
        )


CYCLES, LIFE = 200, 1000
"""Cycles that are simulated for `exported`, and those after which its monitor begins anew."""
HEALTHY_C = r"""
#include "model.h"
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static uint64_t seed;

static double uniform(void)
{
    uint64_t z = (seed += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

static double normal(void)
{
    static double kept;
    static int has;
    double x, y, r;
    if (has) {
        has = 0;
        return kept;
    }
    do {
        x = 2 * uniform() - 1;
        y = 2 * uniform() - 1;
        r = x * x + y * y;
    } while (r >= 1 || r <= 0);
    r = sqrt(-2 * log(r) / r);
    kept = y * r;
    has = 1;
    return x * r;
}

static double stepped(double value, double step)
{
    return step * floor(value / step + 0.5);
}

int main(int argc, char **argv)
{
    static sysid_monitor m;
    const int cycles = atoi(argv[1]), rows = atoi(argv[2]), life = atoi(argv[3]);
    const double step = atof(argv[4]), count = atof(argv[5]), noise = atof(argv[6]);
    const double samples = atof(argv[7]);
    const size_t size = (size_t)rows * 3;
    double *states = malloc(sizeof(double) * size * (size_t)cycles);
    double *commands = malloc(sizeof(double) * size);
    double done = 0;
    unsigned long seen = 0, alarms = 0;
    int was = 0, k, i, first;
    seed = strtoull(argv[8], 0, 10);
    if (argc != 9 || !states || !commands ||
        fread(commands, sizeof(double), size, stdin) != size ||
        fread(states, sizeof(double) * size, (size_t)cycles, stdin) != (size_t)cycles) {
        return 1;
    }
    while (done < samples) {
        sysid_monitor_start(&m, DUTY);
        first = (int)(uniform() * cycles);
        for (k = 0; k < life && done < samples; k++) {
            const double *s = states + size * (size_t)((first + k) % cycles);
            for (i = 0; i < rows; i++) {
                /* The first cycle does not begin where the last one ended. */
                const int seam = i == 0 && k > 0 && (first + k) % cycles == 0;
                const double a = seam ? NAN : stepped(s[3 * i + 1] + noise * normal(), count);
                const double b = stepped(s[3 * i + 2] + noise * normal(), count);
                const int alarm =
                    sysid_monitor_update(&m, stepped(s[3 * i], step), a, b, commands[3 * i],
                                         commands[3 * i + 1], commands[3 * i + 2]);
                alarms += alarm && !was;
                was = alarm;
            }
            done += rows;
        }
        seen += m.cycles;
    }
    printf("%lu %lu\n", alarms, seen);
    return 0;
}
"""


def show_exported(seeds: range, hours: float) -> None:
    """Prints the alarms of each machine's exported C in so many hours of healthy motion."""
    alarms, count, total = 0, 0, 0.0
    for seed in seeds:
        made = machine(seed)
        rng = np.random.default_rng([seed, 4])
        runs = [s[:, :4] for _, s in simulated_cycles(made, CYCLES + 2, rng)][2:]
        states = np.array([run[:-1, [0, 2, 3]] for run in runs])
        rows = states.shape[1]
        given = made.commands()
        duty = made.duties is not None
        valves = (given.duty_a, given.duty_b) if duty else (given.valve_a, given.valve_b)
        commands = np.array([given.motor, *valves], dtype=float).T[:rows]
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            export_bundle(made.bundle, place / "model.h", "c", check=False)
            (place / "healthy.c").write_text(HEALTHY_C)
            build = ["gcc", "-std=c99", "-O2", f"-DDUTY={int(duty)}", "healthy.c", "-lm"]
            subprocess.run([*build, "-o", "healthy"], cwd=place, check=True)
            samples = 3600.0 * hours / made.rig.row_period
            noise = made.rig.truth.pressure_noise_pa
            numbers = (CYCLES, rows, LIFE, made.rig.position_per_count, PRESSURE_COUNT_PA, noise)
            data = np.ascontiguousarray(commands).tobytes() + np.ascontiguousarray(states).tobytes()
            ran = subprocess.run(
                ["./healthy", *map(str, (*numbers, samples, seed))],
                cwd=place,
                input=data,
                capture_output=True,
                check=True,
            )
        found, seen = map(int, ran.stdout.split())
        alarms, count, total = alarms + found, count + seen, total + hours
        print(
            f"machine {seed}{', PWM' if duty else ''}: {found} alarms in {seen} cycles; all: "
            f"{alarms} in {count} cycles, {total:.1f} h",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("healthy", "exported", "wear"))
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--first", type=int, default=5000)
    parser.add_argument("--times", type=float, default=2.0)
    parser.add_argument("--hours", type=float, default=0.5)
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.machines)
    if asked.what == "healthy":
        show_healthy(seeds, asked.hours)
    elif asked.what == "exported":
        show_exported(seeds, asked.hours)
    else:
        show_wear(seeds, asked.times)


if __name__ == "__main__":
    main()
