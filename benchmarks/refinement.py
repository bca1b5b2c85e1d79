"""Estimation by simulation error, as measured.

    python benchmarks/refinement.py coverage [--seeds 1701 1702 ...] [--keep DIR]
    python benchmarks/refinement.py convergence [--rigs 50] [--off 0.3] [--first 2001]

coverage: generated campaigns (standard size, friction scatter of 2 % from test to test,
quantisation), fitted and refined; error over standard error of each parameter, intervals that hold
the truth, position error on held-out logs before and after. convergence: eight parameters of random
rigs under PWM, five logs of 10 s with the sensors' noise, each parameter started off by that share
with a sign of its own and no prior; a rig counts where every parameter ends within 1 % or five
standard errors of the truth.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

import sysid as si  # noqa: E402
from benchmarks.rigs import random_runs  # noqa: E402
from sysid.estimation.autoregression import Autoregression  # noqa: E402
from sysid.plant.ports import Model  # noqa: E402
from sysid.plant.preparation import open_intervals  # noqa: E402
from sysid.plant.simulator import simulate  # noqa: E402
from sysid.refinement.estimation import FrictionScatter, estimate  # noqa: E402
from sysid.refinement.problem import Problem  # noqa: E402
from sysid.refinement.runs import Run  # noqa: E402
from sysid.refinement.unknowns import Unknown  # noqa: E402

# --- coverage -----------------------------------------------------------------------------------

LAWS = {
    "c_fill": "c_fill",
    "c_dis": "c_dis",
    "choked_flow_fill_kg_s": "choked_flow_fill_kg_s",
    "choked_flow_dis_kg_s": "choked_flow_dis_kg_s",
}


def generated(folder: Path, seed: int) -> tuple[Path, Path, dict[str, Any]]:
    """Campaign, fitted bundle and truth of a seed; made where they are missing."""
    campaign, truth = folder / f"c{seed}", folder / f"c{seed}.json"
    if not truth.exists():
        command = [sys.executable, "-m", "datasets.generator", "-o", str(campaign)]
        command += ["--seed", str(seed), "--size", "standard", "--parquet", "--scatter", "0.02"]
        command += ["--truth", str(truth)]
        subprocess.run(command, check=True, cwd=REPOSITORY, capture_output=True)
    bundle = folder / f"b{seed}.json"
    if not bundle.exists():
        # Switched valves are refined: which surface the averaged ones have does not matter.
        read = si.read_campaign(campaign / "campaign.toml")
        si.write_bundle(si.fit(read, surface="bipolynomial"), bundle)
    return campaign / "campaign.toml", bundle, json.loads(truth.read_text("utf-8"))


def true_values(truth: dict[str, Any]) -> dict[str, float]:
    """By the names of a refinement's parameters."""
    found = {f"friction.{k}": float(v) for k, v in truth["friction"].items()}
    for side, law in truth["valves"].items():
        found |= {f"valves.{side}.{LAWS[k]}": float(v) for k, v in law.items()}
    return found


def coverage(seeds: list[int], keep: Path | None) -> None:
    """Print each campaign's figures, then all of them."""
    shares: dict[str, list[float]] = {}
    kept: dict[str, list[bool]] = {}
    held, total, ratios, unconverged = 0, 0, [], 0
    with tempfile.TemporaryDirectory() as temporary:
        for seed in seeds:
            campaign, bundle, truth = generated(keep or Path(temporary), seed)
            begun = time.perf_counter()
            found = si.refine(si.read_campaign(campaign), si.read_bundle(bundle))
            unconverged += not found.converged
            true = true_values(truth)
            inside = 0
            for p in found.parameters:
                low, high = p.estimate.interval
                holds = low <= true[p.name] <= high
                inside += holds
                kept.setdefault(p.name, []).append(holds)
                error = (p.estimate.value - true[p.name]) / p.estimate.std
                shares.setdefault(p.name, []).append(error)
            held, total = held + inside, total + len(found.parameters)
            fit = found.fits["holdout"]
            ratios.append(float(fit.after[0] / fit.before[0]))
            print(
                f"{seed}: {inside} of {len(found.parameters)} intervals hold, held-out position "
                f"{fit.before[0]:.3g} -> {fit.after[0]:.3g}, {found.left_out} of "
                f"{found.segments + found.left_out} segments left out, "
                f"{time.perf_counter() - begun:.0f} s",
                flush=True,
            )
    for name, own in shares.items():
        print(
            f"{name:32} mean error over std {statistics.mean(own):+.2f} +- "
            f"{1 / len(own) ** 0.5:.2f}, spread {statistics.pstdev(own):.2f}, "
            f"{sum(kept[name])} of {len(own)} hold"
        )
    print(f"intervals that hold: {held} of {total} ({100 * held / total:.1f} %)")
    print(f"held-out position after over before: median {statistics.median(ratios):.2f}")
    print(f"not converged: {unconverged} of {len(seeds)}")


# --- convergence --------------------------------------------------------------------------------

NUMBERS = (
    "static_effort",
    "coulomb_effort",
    "viscous",
    "choked_fill_a",
    "choked_dis_a",
    "choked_fill_b",
    "choked_dis_b",
    "c_fill_a",
)
POSITION_NOISE, PRESSURE_NOISE = 2e-5, 170.0
LOGS, SECONDS = 5, 10.0


def rig_runs(seed: int, logs: int = LOGS, seconds: float = SECONDS) -> tuple[list[Run], Model]:
    """A random rig's logs cut into segments of 1 s, each from its true start state."""
    inputs, models = random_runs(seed, logs, seconds)
    model = models[0]
    rng = np.random.default_rng([seed, 2])
    runs = []
    for number, (one, found) in enumerate(
        zip(inputs, simulate(inputs, [model] * logs), strict=True)
    ):
        states = np.array([found.position, found.velocity, found.pressure_a, found.pressure_b])
        noise = np.array([POSITION_NOISE, PRESSURE_NOISE, PRESSURE_NOISE])
        measured = states[[0, 2, 3]] + noise[:, None] * rng.standard_normal((3, states.shape[1]))
        settled = settled_rows(one, model)
        runs += segments(number, one, states, measured, noise, settled)
    return runs, model


def settled_rows(inputs: Any, model: Model) -> Any:
    """Rows that start a PWM period while neither valve is open: no edge is under way there."""
    period = round(1000 * float(model.parameters.pwm_period))
    rows = np.arange(0, len(inputs.time), period)
    at = inputs.time[rows]
    free = [~open_intervals(inputs, side, model).is_open(at) for side in ("a", "b")]
    return rows[free[0] & free[1]]


def segments(
    number: int, inputs: Any, states: Any, measured: Any, noise: Any, settled: Any
) -> list[Run]:
    """A log's segments of 1 s, one after another, each from a settled row."""
    rows, found, start = 1000, [], 0
    while (later := settled[settled >= start]).size and later[0] + rows < measured.shape[1]:
        part = slice(later[0], later[0] + rows + 1)
        start = part.start
        valves = [
            dataclasses.replace(v, values=v.values[part]) if v else None
            for v in (inputs.valve_a, inputs.valve_b)
        ]
        cut = dataclasses.replace(
            inputs,
            time=inputs.time[part],
            motor=inputs.motor[part],
            valve_a=valves[0],
            valve_b=valves[1],
            position=float(states[0, start]),
            velocity=float(states[1, start]),
            pressure_a=float(states[2, start]),
            pressure_b=float(states[3, start]),
            elapsed=float(inputs.time[start] - inputs.time[0]),
        )
        std = np.array([noise[0], 0.02 if states[1, start] else 1e-9, noise[1], noise[2]])
        found.append(Run(number, f"log {number}", cut, measured[:, part], std, noise))
        start += rows
    return found


def unknown(model: Model, name: str, off: float) -> Unknown:
    """A positive parameter, started off by a share."""
    value = float(getattr(model.parameters, name)) * (1.0 + off)
    return Unknown(name, (0, name), value, np.nan, "", 0.0, np.inf, value, "valve")


def converges(seed: int, off: float) -> tuple[bool, float, int]:
    """Whether all of a rig's parameters are found; the largest error, relative; evaluations."""
    runs, model = rig_runs(seed)
    signs = np.random.default_rng([seed, 3]).choice([-1.0, 1.0], len(NUMBERS))
    unknowns = tuple(unknown(model, n, off * s) for n, s in zip(NUMBERS, signs, strict=True))
    started = Model(model.parameters.replace(**{u.name: u.value for u in unknowns}), model.effects)
    white = tuple(tuple(Autoregression.white(float(n) ** 2) for n in run.noise) for run in runs)
    scatter = FrictionScatter(0.02, 0.02, 5.0)
    problem = Problem(tuple(runs), unknowns, started, "theta_rad", white, scatter.pair, LOGS)
    found = estimate(problem, scatter)
    point = found.solution.point
    std = np.sqrt(np.diag(found.solution.at.error_covariance()))
    errors, near = [], True
    for i, u in enumerate(unknowns):
        true = float(getattr(model.parameters, u.name))
        value = u.at(float(point.shared[i]))
        errors.append(abs(value / true - 1.0))
        near &= errors[-1] < max(0.01, 5.0 * float(std[i]))
    return near, max(errors), found.evaluations


def convergence(rigs: int, off: float, first: int) -> None:
    """Print each rig's outcome, and how many converged; seeds from the first on."""
    done = 0
    for seed in range(first, first + rigs):
        begun = time.perf_counter()
        near, error, evaluations = converges(seed, off)
        done += near
        print(
            f"{seed}: {'found' if near else 'NOT found'}, largest error {100 * error:.3g} %, "
            f"{evaluations} simulations, {time.perf_counter() - begun:.0f} s",
            flush=True,
        )
    print(f"converged: {done} of {rigs} from {100 * off:.0f} % off")


def main() -> None:
    """Run what is asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["coverage", "convergence"])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1701, 1731)))
    parser.add_argument("--keep", type=Path, help="Folder with campaigns of earlier calls.")
    parser.add_argument("--rigs", type=int, default=50)
    parser.add_argument("--off", type=float, default=0.3)
    parser.add_argument("--first", type=int, default=2001, help="The first rig's seed.")
    options = parser.parse_args()
    if options.what == "coverage":
        coverage(options.seeds, options.keep)
    else:
        convergence(options.rigs, options.off, options.first)


if __name__ == "__main__":
    main()
