"""The smallest size at which each effect of the catalogue is detectable, and three times it.

    python benchmarks/detectable.py table [--seed 4000]
    python benchmarks/detectable.py check RESULTS.jsonl [--seeds 4000 4001] [--times 3] [--jobs 2]
    python benchmarks/detectable.py pairs [RESULTS] [--attribution ATTRIBUTION]

`table`, on a generated campaign of a lab's size with nothing missing: the size at which an
effect would be added, that is, its gain passes the twins' test and is a fair share of the
excess over noise. It is computed from the length of the effect's signature with the base
parameters projected out, from the twins' gains and from the excess (gains grow with the
square of the size), and printed next to the usual size on such a rig. Effects whose
strengths have a grid (thresholds) are given in the form with the largest gain.

`check` generates the campaign of each seed with each effect whose injected form is the
catalogue's own law, at `--times` its smallest detectable size there, runs `sysid fit` and
`sysid diagnose`, and prints which of them were detected. One line of JSON per campaign is
appended to the results; those already present are skipped.

`pairs`: how many times its smallest detectable size each effect of the pairs of
`attribution.py` has. Its rig is generated with nothing missing and with either effect alone; the
size is the root of what the effect, refitted, gains on the latter, over what it would take to be
added to the former. One line of JSON per pair is appended to `benchmarks/pair_sizes.jsonl`;
`attribution.py table` reads them.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.attribution import (  # noqa: E402
    PAIR_SIZES,
    RESULTS,
    call,
    found_names,
    is_detected,
    keep,
    kept,
    options_of,
    read,
    true_names,
    wilson,
)
from benchmarks.true_model import SAME_LAW, true_effects  # noqa: E402
from datasets.generator.campaign import drawn_effects  # noqa: E402
from sysid.diagnosis.actuator.equation_error import channels_of  # noqa: E402
from sysid.diagnosis.actuator.loop import Start, begin  # noqa: E402
from sysid.diagnosis.actuator.null_distribution import MARGIN, Null  # noqa: E402
from sysid.diagnosis.actuator.refit import refit  # noqa: E402
from sysid.diagnosis.actuator.projection import (  # noqa: E402
    Projected,
    projected,
    screen,
    starting_points,
)
from sysid.diagnosis.actuator.search import LEAST_SHARE, LEAST_SIZE  # noqa: E402
from sysid.diagnosis.actuator.signatures import Signatures, candidates  # noqa: E402
from sysid.diagnosis.actuator.suspects import CLEAR_RATIO, SIGNIFICANCE  # noqa: E402
from sysid.diagnosis.looked import Book  # noqa: E402
from sysid.io.campaign import KINDS, read_campaign  # noqa: E402
from sysid.parameters import read_bundle  # noqa: E402
from sysid.plant.effects import catalogue  # noqa: E402

EFFECTS = {name: effect for name, effect in catalogue().items() if not effect.averaged_only}
# Share of the usual size at which an injected law's signature is computed.
PROBE = 0.1
# Effects that are none, to stand before another.
_NOTHING = ("torque-offset:constant*1e-9", "area-error:area*1e-9")


@dataclass(frozen=True)
class Standard:
    """A campaign with nothing missing as `sysid diagnose` sees it: residual and twins."""

    base: Projected
    null: Null

    def length_to_pass(self, name: str) -> float:
        """Length of a projected signature at which an effect would be added.

        Its gain must pass the twins' test and be a fair share of the remainder beyond noise;
        some of that is due to a rig's own numerics even with nothing missing.
        """
        excess = self.null.excess(self.base)
        own = sum(max(excess[c], 0.0) for c in channels_of(EFFECTS[name].neutral()))
        shared = math.sqrt(LEAST_SHARE / (1.0 - LEAST_SHARE) * own)
        gains = self.null.gains(name)
        spread = max(1.0, float(np.std(np.sqrt(gains), ddof=1)))
        distance = float(norm.isf(SIGNIFICANCE / self.null.family))
        root = MARGIN * float(np.mean(np.sqrt(np.maximum(gains, 1.0)))) + distance * spread
        return max(shared, root, math.sqrt(CLEAR_RATIO * max(float(gains.max()), 10.0)))


class CommandFailedError(Exception):
    """A failed command: its last line."""


def command(*words: str) -> str:
    """What a command prints."""
    done = call(*words)
    if done.returncode != 0:
        raise CommandFailedError(done.stderr.strip().splitlines()[-1])
    return done.stdout


def standard(seed: int, *options: str, names: Iterable[str] = EFFECTS) -> Standard:
    """The campaign of a seed, generated, fitted and looked at; `names` can pass then."""
    start = started(seed, *options)
    start.null.calibrate(dict.fromkeys(names, math.inf), 0.0, Book())
    return Standard(projected(start.frame(start.traces), start.model), start.null)


def started(seed: int, *options: str, quick: bool = False) -> Start:
    """What the search in a seed's campaign begins with; `quick`: with one twin and few forms."""
    with tempfile.TemporaryDirectory() as folder:
        path, bundle = Path(folder) / "campaign.toml", Path(folder) / "bundle.json"
        generate(seed, Path(folder), *options)
        command("sysid", "fit", str(path), "-o", str(bundle))
        campaign = read_campaign(path)
        model = read_bundle(bundle).model(campaign.rig)
        tests = [
            (entry.file, entry.kind, trial)
            for entry in campaign.select(KINDS)
            for trial in campaign.read(entry).trials
        ]
    return begin(tests, campaign.rig, model, EFFECTS.values(), Book(quick=quick))


def generate(seed: int, folder: Path, *options: str) -> None:
    """The campaign of a seed in a folder."""
    words = ["-o", str(folder), "--seed", str(seed), "--size", "lab", "--parquet"]
    command("datasets.generator", *words, *options)


# --- the table --------------------------------------------------------------------------


def table(options: argparse.Namespace) -> None:
    """Print the smallest sizes as Markdown."""
    seen = standard(options.seed)
    base = seen.base
    signatures = Signatures(base.frame, base.model, base.residual)
    print("| effect | strength | usual size | smallest detectable | usual / smallest |")
    print("| --- | --- | --- | --- | --- |")
    for name, effect in EFFECTS.items():
        enough = seen.length_to_pass(name)
        best = math.inf, "", 0.0
        for form in candidates([effect]):
            length = np.linalg.norm(base.project(signatures(form)), axis=0)
            for (strength, step), size in zip(form.steps, length, strict=True):
                usual = next(q.typical for q in effect.quantities if q.name == strength)
                smallest = abs(step) * enough / max(float(size), 1e-12)
                best = min(best, (smallest / abs(usual), strength, abs(usual)))
        ratio, strength, usual = best
        unit = next(q.unit for q in effect.quantities if q.name == strength)
        print(
            f"| `{name}` | {strength} | {usual:.3g} {unit} | {ratio * usual:.2g} {unit} "
            f"| {1.0 / ratio:.2g} |"
        )


# --- a multiple of the smallest size -----------------------------------------------------


def smallest_scale(seen: Standard, seed: int, form: str) -> float:
    """The share of its usual size at which an injected law is just detectable.

    Not below that at which the search asks simulations as well, whatever the balances show.
    """
    name, _, law = form.partition(":")
    injected = [e.content() for e in drawn_effects(seed, [(name, law, PROBE)])]
    base = seen.base
    changed = base.frame.residual(base.model + true_effects(injected)[0]) - base.residual
    length = float(np.linalg.norm(base.project(changed[:, None])))
    return max(PROBE * seen.length_to_pass(name) / max(length, 1e-12), LEAST_SIZE)


def check(options: argparse.Namespace) -> None:
    """Append a line for every seed and law missing from the results, then print the table."""
    path: Path = options.results
    known = {(r["seed"], r["form"], r["times"]) for r in kept(path)}
    with ThreadPoolExecutor(options.jobs) as pool, path.open("a") as file:
        for seed in options.seeds:
            jobs = list(jobs_of(seed, options.times, known))
            for result in pool.map(lambda job: diagnosed(*job), jobs):
                keep(file, result)
    everything = [
        r for r in read(path) if r["times"] == options.times and r["seed"] in options.seeds
    ]
    results = [r for r in everything if "diagnosis" in r]
    hits = sum(map(is_detected, results))
    low, high = wilson(hits, len(results))
    print("| seed | effect | smallest, of its usual size | verdict | found |")
    print("| --- | --- | --- | --- | --- |")
    for r in results:
        print(
            f"| {r['seed']} | {r['form']} | {r['smallest']:.2g} | {r['diagnosis']['verdict']} "
            f"| {' + '.join(found_names(r)) or '-'} |"
        )
    for r in everything:
        if "failed" in r:
            print(f"\nseed {r['seed']}, {r['form']}: {r['failed']}")
    print(f"\n{hits} of {len(results)} detected, {100 * low:.0f} to {100 * high:.0f} %")


def jobs_of(
    seed: int, times: float, known: set[tuple[int, str, float]]
) -> Iterator[tuple[int, str, float, float]]:
    """Seed, form, its smallest scale and the factor by which it is injected."""
    forms = [form for form in SAME_LAW if (seed, form, times) not in known]
    if forms:
        seen = standard(seed)
        for form in forms:
            yield seed, form, smallest_scale(seen, seed, form), times


def diagnosed(seed: int, form: str, smallest: float, times: float) -> dict[str, Any]:
    """Generate, fit and diagnose, as a user would; an error is a result too."""
    drawn = {"seed": seed, "form": form, "smallest": smallest, "times": times}
    with tempfile.TemporaryDirectory() as folder:
        campaign, bundle = str(Path(folder) / "campaign.toml"), str(Path(folder) / "bundle.json")
        try:
            generate(seed, Path(folder), "--effect", f"{form}*{times * smallest:.6g}")
            command("sysid", "fit", campaign, "-o", bundle)
            found = command("sysid", "diagnose", campaign, "--bundle", bundle, "--json")
        except CommandFailedError as error:
            return {**drawn, "failed": str(error)}
    return {**drawn, "diagnosis": json.loads(found)}


# --- pairs -------------------------------------------------------------------------------


def pairs(options: argparse.Namespace) -> None:
    """Append the sizes of each pair's effects that the results do not hold yet."""
    path: Path = options.results
    known = {r["seed"] for r in kept(path)}
    drawn = [r for r in read(options.attribution) if r["kind"] == "two" and "diagnosis" in r]
    with path.open("a") as file:
        for pair in (r for r in drawn if r["seed"] not in known):
            result = {"seed": pair["seed"], "sizes": sizes_of(pair)}
            keep(file, result)
            print(pair["seed"], pair["effects"], result["sizes"], flush=True)


def sizes_of(pair: dict[str, Any]) -> list[float]:
    """How many times its smallest detectable size each effect of a pair has on its rig."""
    words, names = options_of(pair), true_names(pair)
    seen = standard(pair["seed"], *words, names=names)
    found = []
    for place, name in enumerate(names):
        # In its own place, since that says what sign and shape are drawn.
        nothing = next(form for form in _NOTHING if form.split(":")[0] != name)
        alone = [nothing] * place + [pair["effects"][place]]
        chosen = [word for form in alone for word in ("--effect", form)]
        start = started(pair["seed"], *words, *chosen, quick=True)
        base = projected(start.frame(start.traces), start.model)
        screened = screen(base, candidates([EFFECTS[name]], start.traces.travel), Book())
        refits = [refit(base, [effect]) for effect in starting_points(screened)[name]]
        gain = max([r.gain for r in screened] + [r.gain for r in refits])
        found.append(round(math.sqrt(max(gain, 0.0)) / seen.length_to_pass(name), 2))
    return found


def main() -> None:
    """Print the table, check it, or say how large the effects of pairs are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    printer = commands.add_parser("table")
    printer.add_argument("--seed", type=int, default=4000)
    printer.set_defaults(action=table)
    checker = commands.add_parser("check")
    checker.add_argument("results", type=Path)
    checker.add_argument("--seeds", type=int, nargs="+", default=[4000])
    checker.add_argument("--times", type=float, default=3.0)
    checker.add_argument("--jobs", type=int, default=1)
    checker.set_defaults(action=check)
    sizes = commands.add_parser("pairs")
    sizes.add_argument("results", type=Path, nargs="?", default=PAIR_SIZES)
    sizes.add_argument("--attribution", type=Path, default=RESULTS)
    sizes.set_defaults(action=pairs)
    options = parser.parse_args()
    options.action(options)


if __name__ == "__main__":
    main()
