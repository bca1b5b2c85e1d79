"""Axes of a motor alone, diagnosed: effects named, false alarms, and what is left of the error.

    python -m benchmarks.axes --seeds 16 56 [--results FILE.jsonl]

For each seed the generator's axis, rotary or (every third) linear, with an inertia that no file
tells: six tests of clipped sines from rest, friction that scatters by 2 % from test to test, the
last test held out. Nothing is missing in every fourth, one effect in the next, two in the others,
1.5 times as large as usual and in a form of the generator's own. `sysid fit` and `sysid diagnose`
see the files only. The base law has an offset, so that of `torque-offset` nothing is missing; an
encoder's eccentricity hardly shows in a balance of efforts. Seeds 0 to 15 served development.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.sweeps import accumulated
from datasets.generator.effects import FORMS, Injected, typical
from datasets.generator.motor_axis import axis_tests, motor_axis, write_axis_campaign
from sysid.plant.effects import class_of

KINDS = ("none", "one", "two", "two")
TESTS, SCATTER, SCALE = 6, 0.02, 1.5
OF_THE_BASE = ("torque-offset",)
EFFECTS = (
    "position-dependent-friction",
    "stribeck-friction",
    "asymmetric-coulomb-friction",
    "load-dependent-friction",
    "quadratic-drag",
    "torque-offset",
    "mounting-tilt",
    "cable-spring",
    "gear-mesh-ripple",
    "torque-ripple",
    "end-cushion",
    "encoder-eccentricity",
)


def drawn(seed: int) -> list[Injected]:
    """A seed's effects."""
    rng = np.random.default_rng([seed, 77])
    count = {"none": 0, "one": 1, "two": 2}[KINDS[seed % 4]]
    names = [str(name) for name in rng.choice(EFFECTS, count, replace=False)]
    return [typical(n, str(rng.choice(FORMS[n])), rng, SCALE) for n in names]


def one_axis(seed: int) -> dict[str, Any]:
    """What a seed's diagnosis says; `refused` where no motion stays off the stops."""
    effects = drawn(seed)
    found: dict[str, Any] = {"seed": seed, "missing": [[e.id, e.form] for e in effects]}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig = motor_axis(seed, "rotary" if seed % 3 else "linear", effects)
        try:
            tests = axis_tests(rig, seed, TESTS, SCATTER)
        except ValueError as error:
            return {**found, "refused": str(error)}
        campaign = write_axis_campaign(folder, rig, tests)
        _call("fit", campaign, "-o", folder / "bundle.json")
        said = _call("diagnose", campaign, "--bundle", folder / "bundle.json", "--json")
    diagnosis = json.loads(said)
    named = [[e["id"], *e["ambiguous_with"]] for e in diagnosis["effects"]]
    keys = ("verdict", "because", "residual")
    return {**found, "named": named, **{key: diagnosis[key] for key in keys}}


def _call(*words: object) -> str:
    run = [sys.executable, "-m", "sysid", *map(str, words)]
    return subprocess.run(run, capture_output=True, text=True, check=True).stdout


def _is_named(one: dict[str, Any], effect: str) -> bool:
    """By itself, or as what the tests do not tell from one that is named."""
    return any(effect in (*names, *class_of(names[0])) for names in one["named"])


def summed_up(results: list[dict[str, Any]]) -> None:
    """The figures over all axes, and a line for each that is not right."""
    done = [r for r in results if "refused" not in r]
    clean = single = pair = 0
    for r in done:
        r["gone"] = [e for e, _ in r["missing"] if e not in OF_THE_BASE]
        r["right"] = [e for e in r["gone"] if _is_named(r, e)]
        wrong = [n for n in r["named"] if not any(e in (*n, *class_of(n[0])) for e in r["gone"])]
        r["wrong"] = wrong if r["verdict"] == "effects-found" else []
        if r["wrong"] or (len(r["right"]) < len(r["gone"]) and r["verdict"] == "adequate"):
            print(r["seed"], r["gone"], "->", r["verdict"], r["named"])
        clean += not r["gone"]
        single += len(r["gone"]) == 1
        pair += len(r["gone"]) == 2
    print(f"{len(done)} axes, {len(results) - len(done)} without a motion off the stops")
    alarms = [r for r in done if not r["gone"] and r["verdict"] != "adequate"]
    print(f"nothing missing: {len(alarms)} of {clean} not adequate")
    for count, of in ((1, single), (2, pair)):
        own = [r for r in done if len(r["gone"]) == count]
        whole = sum(len(r["right"]) == count for r in own)
        some = sum(bool(r["right"]) for r in own)
        print(f"{count} missing: all named in {whole} of {of}, one at least in {some}")
    print(f"named wrongly: {sum(bool(r['wrong']) for r in done)} of {len(done)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(16, 56), help="first, end")
    parser.add_argument("--results", type=Path, default=Path("axes.jsonl"))
    options = parser.parse_args()
    summed_up(accumulated(options.results, options.seeds, one_axis))


if __name__ == "__main__":
    main()
