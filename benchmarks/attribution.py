"""Attribution measured: campaigns with and without an undeclared effect, as a user meets them.

    python benchmarks/attribution.py run [RESULTS] --first 5000 --count 200 [--jobs 2] [--known]
                                         [--kinds two]
    python benchmarks/attribution.py table [RESULTS] [--since COMMIT]

`run` draws a campaign for each seed (nothing missing, one effect of the catalogue, one that
no catalogue holds, two effects), in the size of a lab's, writes it to files, and runs
`sysid fit` and `sysid diagnose --json` on it. One line of JSON a campaign is appended to
the results; seeds already present are skipped, so that runs accumulate and can be
distributed over machines. `benchmarks/attribution.jsonl`, which is committed, holds those of the
report with the commit that each was run with: a sweep takes minutes a campaign, and goes on there.
With `--known` only campaigns whose effects are laws of the catalogue are diagnosed: what the
figures of intervals and of errors over the true model's need; with `--kinds` only those of these
kinds (only `confidently wrong` mixes kinds). `table` prints the figures with Wilson's 95 %
intervals and the confusion of names; with `--since` of what was run from that program on. Seeds
1000 to 1999 are for development, 5000 on for the report: nothing is tuned on the latter. The
program under test sees the campaign's files only; the model with the true parameters is simulated
afterwards (`true_model.py`).
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TextIO

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.history import commit  # noqa: E402
from benchmarks.true_model import SAME_LAW, true_value  # noqa: E402
from datasets.generator.effects import FORMS, OUT_OF_CATALOGUE, name_of, parsed  # noqa: E402
from sysid.plant.effects import class_of  # noqa: E402

KINDS = ("none", "one", "outside", "two")
SHARES = (0.3, 0.45, 0.125, 0.125)
SCATTERS = (0.0, 0.02, 0.04)
CATALOGUED = tuple(name for name in FORMS if name not in OUT_OF_CATALOGUE)
# Of a command that hangs. What a diagnosis finds does not depend on the time that it takes.
SECONDS = 3600
RESULTS = REPOSITORY / "benchmarks" / "attribution.jsonl"
# Written by `detectable.py pairs`.
PAIR_SIZES = REPOSITORY / "benchmarks" / "pair_sizes.jsonl"
# Pairs are asked for where both effects are above so many times the just detectable size.
LARGE = 2.0


def draw(seed: int) -> dict[str, Any]:
    """A seed's campaign: kind, effects as the generator's options, scatter."""
    rng = np.random.default_rng([seed, 77])
    kind = str(rng.choice(KINDS, p=SHARES))
    names = {
        "none": [],
        "one": list(rng.choice(CATALOGUED, 1)),
        "outside": list(rng.choice(OUT_OF_CATALOGUE, 1)),
        "two": list(rng.choice(CATALOGUED, 2, replace=False)),
    }[kind]
    effects = [f"{name}:{rng.choice(FORMS[name])}" for name in names]
    return {
        "seed": seed,
        "kind": kind,
        "effects": [str(e) for e in effects],
        "scatter": float(rng.choice(SCATTERS)),
        "orientation": str(rng.choice(["horizontal", "vertical"], p=[0.7, 0.3])),
    }


def options_of(drawn: dict[str, Any]) -> list[str]:
    """The generator's options of a seed's rig, without its effects."""
    return ["--scatter", str(drawn["scatter"]), "--orientation", drawn["orientation"]]


def call(*words: str) -> subprocess.CompletedProcess[str]:
    """A command in the repository, as a user would call it."""
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )


def one(seed: int) -> dict[str, Any]:
    """Generate, fit, diagnose; the diagnosis with what was drawn and the times (s)."""
    drawn = draw(seed)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        rig = place / "rig"
        options = ["--size", "lab", "--parquet", *options_of(drawn)]
        options += ["--truth", str(place / "truth.json")]
        for effect in drawn["effects"]:
            options += ["--effect", effect]
        made = call("datasets.generator", "-o", str(rig), "--seed", str(seed), *options)
        if made.returncode != 0:
            return drawn | {"failed": made.stderr.strip().splitlines()[-1][:200]}
        drawn["truth"] = json.loads((place / "truth.json").read_text())["effects"]
        campaign, bundle = str(rig / "campaign.toml"), str(place / "bundle.json")
        start = time.perf_counter()
        fitted = call("sysid", "fit", campaign, "-o", bundle)
        middle = time.perf_counter()
        if fitted.returncode != 0:
            return drawn | {"failed": f"fit: {fitted.stderr.strip()[-200:]}"}
        found = call("sysid", "diagnose", campaign, "--bundle", bundle, "--json")
        if found.returncode != 0:
            return drawn | {"failed": f"diagnose: {found.stderr.strip()[-200:]}"}
        seconds = {"fit_s": middle - start, "diagnose_s": time.perf_counter() - middle}
        drawn["commit"] = commit()
        if not set(drawn["effects"]) <= SAME_LAW.keys():
            return drawn | {"diagnosis": judged(json.loads(found.stdout))} | seconds
        true = call("benchmarks.true_model", campaign, bundle, str(place / "truth.json"))
        if true.returncode != 0:
            return drawn | {"failed": f"true model: {true.stderr.strip()[-200:]}"}
        errors = json.loads(true.stdout)
        diagnosis = judged(json.loads(found.stdout))
        return drawn | {"diagnosis": diagnosis, "true_errors": errors} | seconds


def judged(diagnosis: dict[str, Any]) -> dict[str, Any]:
    """What of a diagnosis the figures need."""
    names = ("id", "parameters", "ambiguous_with")
    effects = [{name: effect[name] for name in names} for effect in diagnosis["effects"]]
    kept = {name: diagnosis[name] for name in ("verdict", "because", "residual", "refined")}
    return kept | {"effects": effects}


def run(options: argparse.Namespace) -> None:
    """Append a line for every seed that the results do not hold yet."""
    path: Path = options.results
    known = {r["seed"] for r in kept(path)}
    seeds = [s for s in range(options.first, options.first + options.count) if s not in known]
    if options.kinds:
        seeds = [s for s in seeds if draw(s)["kind"] in options.kinds]
    if options.known:
        drawn = {s: set(draw(s)["effects"]) for s in seeds}
        seeds = [s for s in seeds if drawn[s] and drawn[s] <= SAME_LAW.keys()]
    with ThreadPoolExecutor(options.jobs) as pool, path.open("a") as file:
        for result in pool.map(guarded, seeds):
            keep(file, result)
            print(result["seed"], result["effects"], verdict(result), flush=True)


def guarded(seed: int) -> dict[str, Any]:
    """`one`, with an error as its result if it fails."""
    try:
        return one(seed)
    except (subprocess.TimeoutExpired, OSError, ValueError) as error:
        return draw(seed) | {"failed": str(error)[:200]}


def verdict(result: dict[str, Any]) -> str:
    """The verdict and the names, in a line."""
    if "diagnosis" not in result:
        return f"failed: {result['failed']}"
    found = result["diagnosis"]
    return f"{found['verdict']} {[e['id'] for e in found['effects']]}"


def read(path: Path) -> list[dict[str, Any]]:
    """The results of a file."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def kept(path: Path) -> list[dict[str, Any]]:
    """The results of a file so far; none before the first."""
    return read(path) if path.exists() else []


def keep(file: TextIO, result: dict[str, Any]) -> None:
    """Append a result to its file at once: what ends a sweep loses nothing."""
    file.write(json.dumps(result) + "\n")
    file.flush()


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    if count == 0:
        return 0.0, 1.0
    z = 1.959964
    share, shrink = hits / count, 1.0 + z * z / count
    middle = (share + z * z / (2 * count)) / shrink
    half = z / shrink * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def true_names(result: dict[str, Any]) -> list[str]:
    return [name_of(*parsed(e)[:2]) for e in result["effects"]]


def found_names(result: dict[str, Any]) -> list[str]:
    return [e["id"] for e in result["diagnosis"]["effects"]]


def is_detected(result: dict[str, Any]) -> bool:
    return bool(result["diagnosis"]["verdict"] != "adequate")


def names_class(result: dict[str, Any]) -> bool:
    """Whether the first effect is the true one, or one of its class with the class named."""
    effects = result["diagnosis"]["effects"]
    return bool(effects) and is_named(true_names(result)[0], effects[0])


def is_named(truth: str, effect: dict[str, Any]) -> bool:
    """Whether an effect found is the true one, or one of its class with the class named."""
    is_rival = truth in effect["ambiguous_with"] and effect["id"] in class_of(truth)
    return bool(truth == effect["id"] or is_rival)


def names_both(result: dict[str, Any]) -> bool:
    """Whether both effects of a pair, or their classes, are among the first three."""
    found = result["diagnosis"]["effects"][:3]
    return all(any(is_named(name, effect) for effect in found) for name in true_names(result))


def is_confidently_wrong(result: dict[str, Any]) -> bool:
    """A single wrong name, without rivals or reservations."""
    found = result["diagnosis"]
    effects = found["effects"]
    alone = len(effects) == 1 and not effects[0]["ambiguous_with"]
    wrong = alone and effects[0]["id"] not in true_names(result)
    return bool(wrong and found["verdict"] == "effects-found")


def intervals_hold(result: dict[str, Any]) -> list[bool]:
    """Whether the interval of each strength found by its own law contains the truth."""
    found = {e["id"]: e["parameters"] for e in result["diagnosis"]["effects"]}
    held = []
    for drawn, truth in zip(result["effects"], result["truth"], strict=True):
        parameter = next(iter(SAME_LAW.get(drawn, {})), "")
        estimate = found.get(truth["id"], {}).get(parameter)
        # What acts in steps may have no error, and so no interval.
        if estimate is not None and estimate.get("interval") is not None:
            low, high = estimate["interval"]
            true = true_value(drawn, parameter, truth["values"])
            held.append((low is None or low <= true) and (high is None or true <= high))
    return held


def over_truth(result: dict[str, Any], channel: str = "theta_rad") -> float | None:
    """Held-out error after, over that of the same model with the true parameters."""
    errors, true = result["diagnosis"]["residual"].get(channel), result.get("true_errors")
    return None if errors is None or not true else float(errors["after"] / true[channel])


def over_floor(result: dict[str, Any]) -> float | None:
    """Held-out error of the position after, over the noise floor."""
    errors = result["diagnosis"]["residual"].get("theta_rad")
    return None if errors is None else float(errors["after"] / errors["noise_floor"])


def quartiles(values: list[float | None]) -> str:
    """Median and quartiles in a row's two cells."""
    known = sorted(v for v in values if v is not None)
    if not known:
        return "- | -"
    low, middle, high, most = np.quantile(known, (0.25, 0.5, 0.75, 0.9))
    spread = f"quartiles {low:.2f} to {high:.2f}, nine of ten below {most:.2f}"
    return f"median {middle:.2f} of {len(known)} | {spread}"


def since(results: list[dict[str, Any]], first: str | None) -> list[dict[str, Any]]:
    """The results from the first one of a program on; all without one."""
    places = [i for i, r in enumerate(results) if first and r.get("commit", "") == first]
    if first and not places:
        sys.exit(f"no result is of {first}: see `by commit` of `table`")
    return results[places[0] :] if places else results


def table(options: argparse.Namespace) -> None:
    """Print the figures as Markdown."""
    everything = since(read(options.results), options.since)
    results = [r for r in everything if "diagnosis" in r]
    by = {kind: [r for r in results if r["kind"] == kind] for kind in KINDS}
    detected = [r for r in by["one"] if is_detected(r)]
    sizes = {r["seed"]: r["sizes"] for r in kept(PAIR_SIZES)}
    rows = [
        ("false alarms, nothing missing", [is_detected(r) for r in by["none"]], "at most 1 %"),
        ("detected, typical size", [is_detected(r) for r in by["one"]], "95 %"),
        ("right class, of those detected", [names_class(r) for r in detected], "95 %"),
        (
            "right name, of those detected",
            [true_names(r)[0] in found_names(r)[:1] for r in detected],
            "90 % (no near rival)",
        ),
        (
            "`unexplained`, effect outside the catalogue",
            [r["diagnosis"]["verdict"] == "unexplained" for r in by["outside"]],
            "90 %",
        ),
        (
            "confidently wrong",
            [is_confidently_wrong(r) for r in results if r["kind"] != "none"],
            "at most 1 %",
        ),
        (
            "both of two among the first three",
            [names_both(r) for r in by["two"]],
            "-",
        ),
        (
            "the same, both above twice the just detectable size",
            [names_both(r) for r in by["two"] if min(sizes.get(r["seed"], [0.0])) > LARGE],
            "75 %",
        ),
        (
            "intervals that contain the strength, form the catalogue's",
            [held for r in results for held in intervals_hold(r)],
            "90 to 98 %",
        ),
        ("the same, of one effect alone", [h for r in by["one"] for h in intervals_hold(r)], "-"),
    ]
    print(f"{len(everything)} campaigns, {len(everything) - len(results)} failed")
    by_commit = Counter(r.get("commit", "unknown") for r in everything)
    print("by commit: " + ", ".join(f"{name} {n}" for name, n in by_commit.items()) + "\n")
    print("| figure | measured | 95 % interval | asked |\n| --- | --- | --- | --- |")
    for name, hits, asked in rows:
        low, high = wilson(sum(hits), len(hits))
        share = f"{100 * sum(hits) / max(len(hits), 1):.0f} % ({sum(hits)} of {len(hits)})"
        print(f"| {name} | {share} | {100 * low:.0f} to {100 * high:.0f} % | {asked} |")
    named = [r for r in by["one"] if names_class(r) and true_names(r) == found_names(r)]
    print(
        "| position's held-out error after, over the true parameters', effect named "
        f"| {quartiles([over_truth(r) for r in named])} | 1.05; nine of ten 1.3 |"
    )
    for side in "ab":
        ratios = [over_truth(r, f"pressure_{side}_pa") for r in named]
        print(f"| the same, pressure {side} | {quartiles(ratios)} | - |")
    print(f"| position's, over the noise floor | {quartiles([over_floor(r) for r in named])} | - |")
    times = sorted(r["diagnose_s"] for r in results)
    if times:
        print(f"| `sysid diagnose`, median | {times[len(times) // 2]:.0f} s | | 20 s, alone |")
    print("\n| true | found | verdict | times |\n| --- | --- | --- | --- |")
    pairs = Counter(
        (
            " + ".join(true_names(r)) or "-",
            " + ".join(found_names(r)) or "-",
            r["diagnosis"]["verdict"],
        )
        for r in results
    )
    for (truth, found, said), count in sorted(pairs.items()):
        print(f"| {truth} | {found} | {said} | {count} |")
    for r in everything:
        if "failed" in r:
            print(f"\nseed {r['seed']} {r['effects']}: {r['failed']}")


def main() -> None:
    """Run, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    runner = commands.add_parser("run")
    runner.add_argument("results", type=Path, nargs="?", default=RESULTS)
    runner.add_argument("--first", type=int, default=5000)
    runner.add_argument("--count", type=int, default=200)
    runner.add_argument("--jobs", type=int, default=1)
    runner.add_argument("--known", action="store_true")
    runner.add_argument("--kinds", nargs="+", choices=KINDS)
    runner.set_defaults(action=run)
    printer = commands.add_parser("table")
    printer.add_argument("results", type=Path, nargs="?", default=RESULTS)
    printer.add_argument("--since", metavar="COMMIT")
    printer.set_defaults(action=table)
    options = parser.parse_args()
    options.action(options)


if __name__ == "__main__":
    main()
