"""Open-loop validation measured: against the true parameters, and the bands' false alarms.

    python benchmarks/validation.py simulation --seeds 20
    python benchmarks/validation.py bands --sequences 2000 --coloured 500

`simulation`: generated campaigns with nothing undeclared, horizontal and vertical. Each is
fitted, then validated twice: with the fitted bundle, and with one that holds the rig's true
parameters (each test's own friction scatters about them by 2 %). `bands`: white and coloured
sequences that have nothing to do with the inputs. Seeds are 0, 1, 2, ...; results go to
standard output as Markdown, and with --json to a file.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from sysid.types import FloatArray

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from datasets.generator.campaign import GeneratedCampaign, Size, make_campaign, size_of  # noqa: E402
from datasets.generator.files import Dialect, write_log  # noqa: E402
from datasets.generator.rigs import rig_toml  # noqa: E402
from sysid.estimation.linear import Estimate  # noqa: E402
from sysid.friction import fit_friction  # noqa: E402
from sysid.io.campaign import FRICTION_KINDS, Campaign, read_campaign  # noqa: E402
from sysid.io.logs import Trial  # noqa: E402
from sysid.io.source import Source  # noqa: E402
from sysid.parameters import Bundle, FittedValves, Friction, Parts  # noqa: E402
from sysid.validation.open_loop import validate  # noqa: E402
from sysid.validation.residual_tests import cross_correlation_test, whiteness_test  # noqa: E402
from sysid.validation.results import ValidationResult  # noqa: E402
from sysid.valve_discrete import fit_valve_discrete  # noqa: E402

Rng = np.random.Generator

LIMIT = 1.3
LENGTHS = (200, 1000, 6000)
ORIENTATIONS = ("horizontal", "vertical")


# --- open-loop error against that of the true parameters --------------------------------


def written(generated: GeneratedCampaign, folder: Path) -> Campaign:
    """The campaign as files (Parquet), read back."""
    dialect = Dialect(parquet=True)
    (folder / "rig.toml").write_text(rig_toml(generated.rig.content))
    lines = ['rig = "rig.toml"']
    for log in generated.logs:
        file = f"{log.stem}{dialect.suffix}"
        write_log(folder / file, log.tests, generated.rig, dialect)
        lines += ["[[log]]", f'kind = "{log.kind}"', f'file = "{file}"', f'use = "{log.use}"']
        lines += [f'valve = "{log.valve}"'] if log.valve else []
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    return read_campaign(folder / "campaign.toml")


def fitted_bundle(campaign: Campaign) -> Bundle:
    """Friction and both discrete valves, fitted on the campaign's fit logs."""
    sources: list[Source] = []

    def trials(*kinds: str, valve: str | None = None) -> list[tuple[str, Trial]]:
        found = []
        for entry in campaign.select(kinds):
            if valve in (None, entry.valve):
                log = campaign.read(entry)
                sources.append(Source.of(log, entry.use, entry.kind))
                found += [(entry.kind, t) for t in log.trials]
        return found

    friction = trials(*FRICTION_KINDS)
    fit = fit_friction([t for _, t in friction], campaign.rig, kind=[k for k, _ in friction])
    parts = fit.part()
    for side in "ab":
        tests = [t for _, t in trials("valve-discrete", valve=side)]
        parts = parts.merged(fit_valve_discrete(tests, campaign.rig, valve=side).part())
    return Bundle.new(campaign.rig, parts, sources)


def true_bundle(generated: GeneratedCampaign, campaign: Campaign) -> Bundle:
    """A bundle of the generator's own parameters."""

    def known(values: dict[str, float]) -> dict[str, Estimate]:
        return {k: Estimate(v, 0.0, k.rsplit("_", 1)[-1], (v, v)) for k, v in values.items()}

    truth = generated.truth
    valves = {side: {"discrete": known(truth["valves"][side])} for side in "ab"}
    parts = Parts(
        Friction.model_validate(known(truth["friction"])), FittedValves.model_validate(valves)
    )
    return Bundle.new(campaign.rig, parts, [])


def pooled(result: ValidationResult) -> dict[str, dict[str, float]]:
    """By channel, over all motion logs: RMSE over 1 s, and the mean whole-log fit percentage."""
    squares: dict[str, list[tuple[float, int]]] = {}
    fits: dict[str, list[float]] = {}
    for log in result.logs:
        for name, channel in log.channels.items():
            horizon = channel.horizons[-1]
            if horizon.rmse is not None:
                squares.setdefault(name, []).append((horizon.rmse**2, horizon.segments))
            if channel.errors.fit_percentage is not None:
                fits.setdefault(name, []).append(channel.errors.fit_percentage)
    found = {}
    for name, parts in squares.items():
        values, weights = (np.array(part) for part in zip(*parts, strict=True))
        rmse = float(np.sqrt(np.average(values, weights=weights)))
        found[name] = {"rmse_1s": rmse, "fit_percent": float(np.mean(fits[name]))}
    return found


def simulate_one(seed: int, orientation: str, size: Size) -> dict[str, Any]:
    """One campaign: both bundles' errors and their ratio, by channel."""
    kinds = (*FRICTION_KINDS, "valve-discrete", "motion-motor", "motion-pwm", "motion-discrete")
    generated = make_campaign(seed, size=size, orientation=orientation, kinds=kinds)
    with tempfile.TemporaryDirectory() as folder:
        campaign = written(generated, Path(folder))
        motions = ("motion-motor", "motion-pwm", "motion-discrete")
        found = {
            name: pooled(validate(campaign, bundle, kinds=motions))
            for name, bundle in (
                ("fitted", fitted_bundle(campaign)),
                ("true", true_bundle(generated, campaign)),
            )
        }
    ratios = {c: v["rmse_1s"] / found["true"][c]["rmse_1s"] for c, v in found["fitted"].items()}
    return {"seed": seed, "orientation": orientation, "ratio": ratios, **found}


def simulation(seeds: range, size: Size) -> dict[str, Any]:
    """All campaigns, printed as they are done."""
    channels = ("theta_rad", "pressure_a_pa", "pressure_b_pa")
    print("RMSE over 1 s, fitted / true parameters, and fit % of whole logs, fitted (true)\n")
    print("| seed | orientation | " + " | ".join(f"{c} ratio | fit %" for c in channels) + " |")
    print("|---" * (2 + 2 * len(channels)) + "|")
    rows = []
    for seed in seeds:
        for orientation in ORIENTATIONS:
            row = simulate_one(seed, orientation, size)
            rows.append(row)
            cells = []
            for c in channels:
                fit, true = row["fitted"][c]["fit_percent"], row["true"][c]["fit_percent"]
                cells += [f"{row['ratio'][c]:.3f}", f"{fit:.1f} ({true:.1f})"]
            print(f"| {seed} | {orientation} | " + " | ".join(cells) + " |", flush=True)
    worst = {c: max(r["ratio"][c] for r in rows) for c in channels}
    median = {c: float(np.median([r["ratio"][c] for r in rows])) for c in channels}
    above = sum(r["ratio"][c] > LIMIT for r in rows for c in channels)
    print(f"\nlargest ratio {worst}, median {median}; {above} above {LIMIT}")
    return {"rows": rows, "worst": worst, "median": median, "above_limit": above}


# --- false-alarm rates ------------------------------------------------------------------


def _clipped_sine(n: int, rng: Rng) -> FloatArray:
    cycles, phase = rng.uniform(2.0, 6.0), rng.uniform(0.0, 2.0 * np.pi)
    sine = np.sin(2.0 * np.pi * cycles * np.arange(n) / n + phase)
    return np.asarray(np.clip(sine, -0.8, 0.8))


def _switching(n: int, rng: Rng) -> FloatArray:
    levels = rng.permutation(np.resize([0.0, 1.0], n // 20 + 1))
    return np.asarray(np.repeat(levels, 20)[:n])


def _autoregressive(n: int, rng: Rng) -> FloatArray:
    return np.asarray(lfilter([1.0], [1.0, -0.95], rng.standard_normal(n)))


INPUTS: dict[str, Callable[[int, Rng], FloatArray]] = {
    "clipped sine": _clipped_sine,
    "on/off": _switching,
    "AR(1) 0.95": _autoregressive,
}
# Numerator and denominator of the filter that colours white noise.
NOISES: dict[str, tuple[list[float], list[float]]] = {
    "white": ([1.0], [1.0]),
    "AR(1) 0.5": ([1.0], [1.0, -0.5]),
    "AR(1) 0.9": ([1.0], [1.0, -0.9]),
    "AR(1) 0.99": ([1.0], [1.0, -0.99]),
    "AR(2) resonant": ([1.0], [1.0, -1.8, 0.9]),
    "MA(1) 0.8": ([1.0, 0.8], [1.0]),
    "AR(1) 0.9 + white": ([1.0, -0.6], [1.0, -0.9]),
}


def bands(white_sequences: int, coloured_sequences: int) -> dict[str, Any]:
    """Share of sequences that alarm; every cell has its own seed."""
    print(f"False alarms in %, nominal 5: {white_sequences} white sequences a cell, ", end="")
    print(f"{coloured_sequences} coloured\n")
    print("| noise | samples | whiteness | " + " | ".join(f"cross: {u}" for u in INPUTS) + " |")
    print("|---" * (3 + len(INPUTS)) + "|")
    rows = []
    for i, (noise, (numerator, denominator)) in enumerate(NOISES.items()):
        sequences = white_sequences if noise == "white" else coloured_sequences
        for n in LENGTHS:
            row: dict[str, Any] = {"noise": noise, "samples": n}
            for j, (name, make) in enumerate(INPUTS.items()):
                rng = np.random.default_rng([i, n, j])
                alarms = np.zeros(2)
                for _ in range(sequences):
                    white = rng.standard_normal(n + 500)
                    residual = lfilter(numerator, denominator, white)[500:]
                    inputs = {"first": make(n, rng), "second": _clipped_sine(n, rng)}
                    found = cross_correlation_test(residual, inputs)["first"]
                    alarms[0] += not found.passed
                    if noise == "white" and j == 0:
                        white_test = whiteness_test(residual)
                        alarms[1] += white_test is not None and not white_test.passed
                row[name] = float(alarms[0] / sequences)
                if noise == "white" and j == 0:
                    row["whiteness"] = float(alarms[1] / sequences)
            rows.append(row)
            whiteness = f"{100 * row['whiteness']:.2f}" if "whiteness" in row else "-"
            cells = " | ".join(f"{100 * row[u]:.2f}" for u in INPUTS)
            print(f"| {noise} | {n} | {whiteness} | {cells} |", flush=True)
    return {"white": white_sequences, "coloured": coloured_sequences, "rows": rows}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("simulation", "bands"))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--size", default="standard", help="small, standard, large or a factor")
    parser.add_argument("--sequences", type=int, default=2000)
    parser.add_argument("--coloured", type=int, default=500)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    start = time.perf_counter()
    if arguments.what == "simulation":
        result = simulation(range(arguments.seeds), size_of(arguments.size))
    else:
        result = bands(arguments.sequences, arguments.coloured)
    print(f"\n{time.perf_counter() - start:.0f} s")
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
