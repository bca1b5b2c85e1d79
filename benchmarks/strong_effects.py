"""Campaigns with strong undeclared effects: whether every command ends with what can be had.

    python benchmarks/strong_effects.py --count 60 --seed 9000 --jobs 16 > strong.jsonl
    python benchmarks/strong_effects.py --count 60 --seed 9000 --first 3 --step 8
    python benchmarks/strong_effects.py --size 0.3 --commands fit

Campaign number i of `--count` has the generator's effect i, in turn and in a drawn form, so that
each id is met; behind the last id campaigns have two drawn effects at once. Sizes are drawn log-
uniform from 3 to 10 times what rigs usually show, and halved where the generator refuses them (a
rig that does not move), down to the usual size; then other rigs are tried. `sysid fit`,
`diagnose --quick` and `run --quick` (`--full`: without `--quick`) then see the files only, each a
process of its own with one job. A line of JSON says for each campaign what was drawn, and each
command's exit status, last line on standard error, seconds, and what it came to; the last line
counts those of which all commands ended with status 0, a bundle and a verdict. `--first` and
`--step` spread one sweep over machines. Seeds below 9000 are for development.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.history import commit  # noqa: E402
from datasets.generator.effects import FORMS  # noqa: E402

COMMANDS = ("fit", "diagnose", "run")
# Times the usual size.
SCALES = (3.0, 10.0)
SECONDS = 3600
# Rigs that are tried for an effect, and how far their seeds are apart.
RIGS, OTHER_RIG = 5, 100_000


def draw(seed: int, number: int) -> dict[str, Any]:
    """Campaign `number` of a sweep: its seed, its effects with their scales, and its rig."""
    rng = np.random.default_rng([seed, number, 91])
    ids = list(FORMS)
    names = [ids[number]] if number < len(ids) else list(rng.choice(ids, 2, replace=False))
    effects = []
    for name in names:
        low, high = np.log(SCALES)
        scale = round(float(np.exp(rng.uniform(low, high))), 2)
        effects.append((f"{name}:{rng.choice(FORMS[name])}", scale))
    return {
        "number": number,
        "seed": seed + number,
        "effects": effects,
        "orientation": str(rng.choice(["horizontal", "vertical"], p=[0.7, 0.3])),
    }


def call(*words: str) -> subprocess.CompletedProcess[str]:
    """A command in the repository, as a user would call it, alone on one core."""
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=REPOSITORY,
        env={**os.environ, "SYSID_JOBS": "1"},
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )


def generate(drawn: dict[str, Any], rig: Path, size: str) -> str:
    """Write the campaign; why it cannot be, or nothing.

    Its scales are halved, down to the usual size, until the rig can be run, and then on other rigs.
    """
    said, wanted = "", drawn["effects"]
    for _ in range(RIGS):
        drawn["effects"] = wanted
        while max(scale for _, scale in drawn["effects"]) >= 1.0:
            words = ["-o", str(rig), "--seed", str(drawn["seed"]), "--size", size, "--parquet"]
            words += ["--orientation", drawn["orientation"]]
            for name, scale in drawn["effects"]:
                words += ["--effect", f"{name}*{scale}"]
            made = call("datasets.generator", *words)
            if made.returncode == 0:
                return ""
            said = made.stderr.strip().splitlines()[-1][:200]
            drawn["effects"] = [(name, round(scale / 2.0, 2)) for name, scale in drawn["effects"]]
        drawn["seed"] += OTHER_RIG
    return said


def ended(*words: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """How a command of sysid with --json ended, and what it printed."""
    start = time.perf_counter()
    try:
        done = call("sysid", *words, "--json")
    except subprocess.TimeoutExpired:
        return {"status": None, "said": f"not done after {SECONDS} s"}, {}
    found: dict[str, Any] = {"status": done.returncode, "seconds": time.perf_counter() - start}
    found["seconds"] = round(found["seconds"], 1)
    if done.returncode != 0:
        found["said"] = done.stderr.strip().splitlines()[-1][:400] if done.stderr.strip() else ""
        return found, {}
    try:
        printed: dict[str, Any] = json.loads(done.stdout)
    except ValueError as error:
        return found | {"status": None, "said": f"no JSON: {error}"}, {}
    # What a user would have to read as a fault of the program.
    faults = [line for line in printed.get("notices", []) if "fault in sysid" in line]
    return (found | {"faults": faults} if faults else found), printed


def one(drawn: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """Generate a campaign and call the commands on it."""
    with contextlib.ExitStack() as stack:
        if options.keep is None:
            place = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        else:
            place = options.keep / str(drawn["seed"])
            place.mkdir(parents=True)
        refused = generate(drawn, place / "rig", options.size)
        if refused:
            return drawn | {"not_generated": refused}
        campaign, bundle = str(place / "rig" / "campaign.toml"), str(place / "bundle.json")
        quick = [] if options.full else ["--quick"]
        if "fit" in options.commands or "diagnose" in options.commands:
            drawn["fit"], printed = ended("fit", campaign, "-o", bundle)
            parts = ("friction", "valves")
            drawn["fit"]["parts"] = [name for name in parts if printed.get(name)]
        if "diagnose" in options.commands and drawn["fit"]["status"] == 0:
            words = ["diagnose", campaign, "--bundle", bundle, "-o", str(place / "longer.json")]
            drawn["diagnose"], printed = ended(*words, *quick)
            drawn["diagnose"] |= verdict(printed)
        if "run" in options.commands:
            drawn["run"], printed = ended("run", campaign, "-o", str(place / "out"), *quick)
            drawn["run"] |= verdict(printed.get("diagnosis") or {})
            files = {"bundle.json": "bundle", "report.html": "report"}
            drawn["run"] |= {n: (place / "out" / f).exists() for f, n in files.items()}
    return drawn


def guarded(drawn: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """`one`, with what keeps it from being carried out as its result."""
    try:
        return one(drawn, options)
    except (subprocess.TimeoutExpired, OSError) as error:
        return drawn | {"not_carried_out": str(error)[:200]}


def verdict(diagnosis: dict[str, Any]) -> dict[str, Any]:
    """The verdict and the names, None without a diagnosis."""
    names = [effect["id"] for effect in diagnosis.get("effects", [])]
    return {"verdict": diagnosis.get("verdict"), "named": names}


def is_whole(result: dict[str, Any], commands: list[str]) -> bool:
    """Whether every command ended with status 0, no fault, and a verdict where it gives one."""
    outcomes = [result.get(name) for name in commands]
    return all(
        outcome is not None
        and outcome["status"] == 0
        and "faults" not in outcome
        and outcome.get("verdict", "") is not None
        for outcome in outcomes
    )


def main() -> int:
    """Print a line for each campaign; status 1 where one did not end as it should."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=9000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--size", default="lab")
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--keep", type=Path, metavar="DIR", help="leave the files of each there")
    parser.add_argument("--full", action="store_true", help="diagnose and run without --quick")
    options = parser.parse_args()
    numbers = range(options.first, options.count, options.step)
    results = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for result in pool.map(lambda n: guarded(draw(options.seed, n), options), numbers):
            results.append(result)
            print(json.dumps(result), flush=True)
    made = [r for r in results if "not_generated" not in r]
    whole = sum(is_whole(r, options.commands) for r in made)
    print(json.dumps({"campaigns": len(made), "whole": whole, "commit": commit()}))
    return 0 if whole == len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
