"""Rigs with one chamber and a spring: fit, open loop, and one undeclared effect that is found.

    python benchmarks/one_chamber.py run RESULTS.jsonl [--first 5000] [--count 20] [--full]
    python benchmarks/one_chamber.py table RESULTS.jsonl

`run` draws a rig and its campaign for each seed, twice: with nothing missing, of which the fitted
numbers and the open-loop errors on held-out tests are kept, and with one effect of the catalogue,
which `sysid diagnose` is asked for (`--quick` unless `--full`). One line of JSON per seed is
appended; those already present are skipped. `table` prints what was found.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.attribution import call, keep, names_class, read, wilson  # noqa: E402
from datasets.generator.campaign import stream  # noqa: E402
from datasets.generator.effects import Injected, typical  # noqa: E402
from datasets.generator.effects.catalogue import FORMS  # noqa: E402
from datasets.generator.files import write_campaign  # noqa: E402
from datasets.generator.one_chamber import make_one_chamber_campaign  # noqa: E402

# Effects that a rig with one chamber can have; those of a motor where it has one.
OF_AIR = (
    "stribeck-friction",
    "asymmetric-coulomb-friction",
    "position-dependent-friction",
    "seal-friction",
    "quadratic-drag",
    "cable-spring",
    "end-cushion",
    "inertia-mismatch",
    "torque-offset",
    "polytropic-exponent",
    "wall-heat-transfer",
    "dead-volume-error",
    "tube-lag",
    "atmosphere-leakage",
    "threshold-leakage",
    "subsonic-flow-shape",
    "choked-exhaust-scaling",
    "supply-droop",
    "exhaust-back-pressure",
    "valve-delay",
    "sticking-valve",
    "pressure-offset",
    "pressure-gain",
    "pressure-lag",
)
OF_A_MOTOR = ("torque-constant-error", "torque-ripple", "amplifier-lag")


class FailedError(Exception):
    """A command that failed: its last line."""


def drawn(seed: int) -> tuple[Injected, bool]:
    """The effect of a seed, on chamber A where it has a side, and whether the rig has a motor."""
    rng = stream(seed, "effects", 1000)
    has_motor = bool(rng.random() < 0.5)
    names = OF_AIR + OF_A_MOTOR * has_motor
    name = names[int(rng.integers(len(names)))]
    form = str(rng.choice(FORMS[name]))
    effect = typical(name, form, rng)
    return dataclasses.replace(effect, side="a") if effect.side else effect, has_motor


def command(*words: str) -> str:
    """What a command prints."""
    done = call(*words)
    if done.returncode != 0:
        raise FailedError((done.stderr.strip() or "nothing was said").splitlines()[-1])
    return done.stdout


def fitted(folder: Path, seed: int, has_motor: bool, effects: tuple[Injected, ...]) -> Any:
    """The campaign of a seed in a folder, fitted there; what is behind it."""
    made = make_one_chamber_campaign(seed, with_motor=has_motor, effects=effects)
    write_campaign(folder, made, "generated")
    command("sysid", "fit", str(folder / "campaign.toml"), "-o", str(folder / "bundle.json"))
    return made


def without_effect(seed: int, has_motor: bool) -> dict[str, Any]:
    """Relative errors of the fitted numbers, and open-loop errors on held-out tests."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        made = fitted(folder, seed, has_motor, ())
        bundle = json.loads((folder / "bundle.json").read_text("utf-8"))
        words = (str(folder / "campaign.toml"), "--bundle", str(folder / "bundle.json"))
        shown = json.loads(command("sysid", "validate", *words, "--json"))
    errors = {}
    friction, law = made.truth["friction"], made.truth["valves"]["a"]
    for part, truth in ((bundle["friction"], friction), (bundle["valves"]["a"]["discrete"], law)):
        for key, true in truth.items():
            if part[key].get("value") is not None:
                errors[key] = part[key]["value"] / true - 1.0
    return {"errors": errors, "open_loop": list(_open_loop(shown))}


def _open_loop(shown: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The errors of each held-out log by channel, as the first valve model simulates it."""
    for log in shown["validation"]["logs"]:
        if log["use"] == "holdout":
            for channel, errors in log["channels"].items():
                kept = {k: errors[k] for k in ("rmse", "fit_percent", "rmse_to_noise")}
                found = {"kind": log["kind"], "model": log["valve_model"], "channel": channel}
                yield found | kept


def with_effect(seed: int, has_motor: bool, effect: Injected, full: bool) -> dict[str, Any]:
    """The diagnosis of the same rig with its effect."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        fitted(folder, seed, has_motor, (effect,))
        words = [str(folder / "campaign.toml"), "--bundle", str(folder / "bundle.json")]
        words += [] if full else ["--quick"]
        found = json.loads(command("sysid", "diagnose", *words, "--json"))
    keys = ("verdict", "effects", "residual")
    return {key: found[key] for key in keys if key in found}


def one(seed: int, full: bool) -> dict[str, Any]:
    """Both campaigns of a seed."""
    effect, has_motor = drawn(seed)
    begun = time.monotonic()
    result: dict[str, Any] = {"seed": seed, "motor": has_motor, "full": full}
    result["effects"] = [f"{effect.id}:{effect.form}"]
    for name, make in (
        ("plain", lambda: without_effect(seed, has_motor)),
        ("diagnosis", lambda: with_effect(seed, has_motor, effect, full)),
    ):
        try:
            result[name] = make()
        except (FailedError, ValueError, RuntimeError) as fault:
            result[f"{name}_failed"] = str(fault)
    return result | {"wall_s": round(time.monotonic() - begun, 1)}


def run(options: argparse.Namespace) -> None:
    done = {r["seed"] for r in read(options.results)} if options.results.exists() else set()
    with options.results.open("a", encoding="utf-8") as file:
        for seed in range(options.first, options.first + options.count):
            if seed not in done:
                keep(file, one(seed, options.full))


def table(options: argparse.Namespace) -> None:
    results = read(options.results)
    plain = [r["plain"] for r in results if "plain" in r]
    keys = sorted({key for one in plain for key in one["errors"]})
    print(f"{len(plain)} rigs with nothing missing: median and largest error of a number")
    for key in keys:
        errors = np.abs([one["errors"][key] for one in plain if key in one["errors"]])
        print(f"  {key:24} {np.median(errors):8.2%} {np.max(errors):8.2%}  of {len(errors)}")
    rows = [row for one in plain for row in one["open_loop"]]
    for channel in sorted({row["channel"] for row in rows}):
        fits = [row["fit_percent"] for row in rows if row["channel"] == channel]
        print(f"  {channel:24} fits to {np.median(fits):.1f} % (least {np.min(fits):.1f} %)")
    judged = [r for r in results if "diagnosis" in r]
    hits = sum(names_class(r) for r in judged)
    low, high = wilson(hits, len(judged))
    print(f"the effect, or its class, is named first in {hits} of {len(judged)} "
          f"({low:.0%} to {high:.0%})")  # fmt: skip
    for r in judged:
        said = ", ".join(e["id"] for e in r["diagnosis"]["effects"]) or "nothing"
        print(f"  {r['seed']}: {r['effects'][0]}: {r['diagnosis']['verdict']}: {said}")
    for r in results:
        for name in ("plain_failed", "diagnosis_failed"):
            if name in r:
                print(f"  {r['seed']}: {name}: {r[name]}")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("run", "table"))
    parser.add_argument("results", type=Path)
    parser.add_argument("--first", type=int, default=5000)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--full", action="store_true", help="diagnose without --quick")
    options = parser.parse_args()
    (run if options.what == "run" else table)(options)


if __name__ == "__main__":
    main()
