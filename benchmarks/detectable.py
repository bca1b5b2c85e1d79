"""The smallest size at which each effect of the catalogue is detectable, and three times it.

    python benchmarks/detectable.py table [--seed 4000]
    python benchmarks/detectable.py check RESULTS.jsonl [--seeds 4000 4001] [--times 3] [--jobs 2]
    python benchmarks/detectable.py pairs [RESULTS] [--attribution ATTRIBUTION]

`table`, on a generated campaign of a lab's size with nothing missing: the size at which a set of
this one effect has evidence: what it explains, channel by channel, is worth as much as its numbers
cost, their information about a prior of one usual size, as the number of forms that are tried, and
as what twins gain where nothing is missing. It is computed from the effect's signature with the
base parameters projected out, whose square grows with that of the size, and printed next to the
usual size on such a rig. Each effect is given in the form that is detectable first.

`check` generates the campaign of each seed with each effect whose injected form is the
catalogue's own law, at `--times` its smallest detectable size there, runs `sysid fit` and
`sysid diagnose`, and prints which of them were detected. One line of JSON per campaign is
appended to the results; those already present are skipped.

`pairs`: how many times its smallest detectable size each effect of the pairs of
`attribution.py` has. Its rig is generated with nothing missing and with either effect alone; what
the effect, fitted, explains of the latter is compared with what it would take to be evidence on the
former. One line of JSON per pair is appended to `benchmarks/pair_sizes.jsonl`;
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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

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
from sysid.diagnosis.actuator.equation_error import CHANNELS  # noqa: E402
from sysid.diagnosis.actuator.fitted_set import fit_set  # noqa: E402
from sysid.diagnosis.actuator.loop import Start, begin  # noqa: E402
from sysid.diagnosis.actuator.misfit import ResidualChannel, cost, rise, weights_of  # noqa: E402
from sysid.diagnosis.actuator.null_distribution import Null  # noqa: E402
from sysid.diagnosis.actuator.projection import Projected, channel_squares, projected  # noqa: E402
from sysid.diagnosis.actuator.screened import (  # noqa: E402
    Bias,
    Screening,
    noise_channels,
    screened,
)
from sysid.diagnosis.actuator.signatures import Candidate  # noqa: E402
from sysid.diagnosis.search_record import Recorder  # noqa: E402
from sysid.io.campaign import KINDS, read_campaign  # noqa: E402
from sysid.parameters import read_bundle  # noqa: E402
from sysid.plant.effects import catalogue  # noqa: E402
from sysid.plant.effects.entry import CatalogueEffect  # noqa: E402
from sysid.types import FloatArray  # noqa: E402

EFFECTS = {name: effect for name, effect in catalogue().items() if not effect.averaged_only}
# Share of the usual size at which an injected law's signature is computed.
PROBE = 0.1
# Effects that are none, to stand before another.
_NOTHING = ("torque-offset:constant*1e-9", "area-error:area*1e-9")


# Twins that say what an effect gains where nothing is missing, as in a search.
_TWINS = 2
# The smallest size is known to this share of it; it is looked for so many times.
_CLOSELY, _MOST_STEPS = 1e-3, 500


@dataclass(frozen=True)
class Standard:
    """A campaign with nothing missing as `sysid diagnose` sees it.

    Its residual, every form's columns, and what twins gain by them. `none` (channels,): the squares
    of the residual.
    """

    base: Projected
    some: Screening
    bias: Bias
    none: FloatArray

    def forms_of(self, name: str) -> list[int]:
        """The numbers of an effect's forms."""
        return [f for f, form in enumerate(self.some.forms) if form.id == name]

    def smallest(self, form: int, squares: FloatArray, size: float = 1.0) -> float:
        """The share of a size at which a set of this form alone has evidence; inf where none has.

        `squares` (channels,): of its projected signature at that size; `size`: that of its
        strengths, in usual sizes.
        """
        share = 1.0
        for _ in range(_MOST_STEPS):
            before, gain, price = share, *self._gain_and_price(form, share**2 * squares)
            price += (share * size) ** 2
            # What it explains grows less than with its square, so that this does not overshoot.
            share *= math.sqrt(price / max(gain, 1e-300))
            if not math.isfinite(share) or share > 1e6:
                break
            if abs(share / before - 1.0) < _CLOSELY:
                return share
        return math.inf

    def _gain_and_price(self, form: int, squares: FloatArray) -> tuple[float, float]:
        """What a form gains by explaining squares (channels,), and what that must outweigh."""
        columns = self.some.columns
        origin = self.none + squares
        channels = [
            ResidualChannel(c.rows, c.draws, c.square, float(own))
            for c, own in zip(columns.channels, origin, strict=True)
        ]
        weights = weights_of(channels, self.none)
        own = list(columns.blocks[form].columns)
        information = np.einsum("c,cij->ij", weights, columns.gram[:, own][:, :, own])
        size = float(np.linalg.slogdet(np.eye(len(own)) + information)[1])
        twins = rise(channels, self.none, self.bias.gained(self.some, (form,), weights))
        price = size + float(columns.penalty[form]) + twins
        return float(cost(channels, origin) - cost(channels, self.none)), price


class CommandFailedError(Exception):
    """A failed command: its last line."""


def command(*words: str) -> str:
    """What a command prints."""
    done = call(*words)
    if done.returncode != 0:
        raise CommandFailedError(done.stderr.strip().splitlines()[-1])
    return done.stdout


def standard(seed: int, *options: str, names: Iterable[str] = EFFECTS) -> Standard:
    """The campaign of a seed, generated, fitted and looked at; `names` are asked for then."""
    start = started(seed, *options)
    base, recorder = projected(start.logged, start.model), Recorder()
    some = all_forms(base, start.null, start.forms, recorder)
    bias = Bias(start.null.twins[:_TWINS])
    bias.ask(set(names), start.forms, recorder)
    for miss in recorder.missed:
        print(f"{miss.subject}: {miss.reason}", file=sys.stderr)
    return Standard(base, some, bias, channel_squares(base, base.rest))


def all_forms(
    base: Projected, null: Null, forms: Iterable[Candidate], recorder: Recorder
) -> Screening:
    """Every form against a residual, with its noise as in a search's first round."""
    none = channel_squares(base, base.rest)
    unknown = noise_channels(base, null, none, np.full(len(CHANNELS), math.inf))
    some = screened(base, list(forms), unknown, recorder)
    known = noise_channels(base, null, none, some.columns.directions())
    return Screening(some.forms, some.columns.among(known))


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
    return begin(tests, campaign.rig, model, EFFECTS.values(), Recorder(quick=quick))


def generate(seed: int, folder: Path, *options: str) -> None:
    """The campaign of a seed in a folder."""
    words = ["-o", str(folder), "--seed", str(seed), "--size", "lab", "--parquet"]
    command("datasets.generator", *words, *options)


# --- the table --------------------------------------------------------------------------


def table(options: argparse.Namespace) -> None:
    """Print the smallest sizes as Markdown."""
    seen = standard(options.seed)
    print("| effect | strength | usual size | smallest detectable | usual / smallest |")
    print("| --- | --- | --- | --- | --- |")
    for name, effect in EFFECTS.items():
        best = min(
            (seen.smallest(form, own[:, i]), i)
            for form in seen.forms_of(name)
            for own in [squares_of(seen, form)]
            for i in range(own.shape[1])
        )
        share, strength = best[0], effect.strengths()[best[1]]
        usual = strength.usual_size
        print(
            f"| `{name}` | {strength.name} | {usual:.3g} {strength.unit} "
            f"| {share * usual:.2g} {strength.unit} | {1.0 / share:.2g} |"
        )


def squares_of(seen: Standard, form: int) -> FloatArray:
    """Of each strength of a form at its usual size the squares, (channels, strengths)."""
    own = list(seen.some.columns.blocks[form].columns)
    return np.array([np.diag(gram)[own] for gram in seen.some.columns.gram])


# --- a multiple of the smallest size -----------------------------------------------------


def smallest_scale(seen: Standard, seed: int, form: str) -> float:
    """The share of its usual size at which an injected law is just detectable."""
    name, _, law = form.partition(":")
    injected = [e.content() for e in drawn_effects(seed, [(name, law, PROBE)])]
    base = seen.base
    changed = (
        base.frame.residual(base.model + true_effects(injected, base.model.parameters)[0])
        - base.residual
    )
    missing = base.project(changed[:, None])[:, 0]
    squares = channel_squares(base, missing) / PROBE**2
    return seen.smallest(nearest_form(seen, name, missing), squares)


def nearest_form(seen: Standard, name: str, missing: FloatArray) -> int:
    """The number of an effect's form that explains most of what is missing, (rows,)."""
    own = seen.forms_of(name)
    base = replace(seen.base, rest=-missing)
    some = screened(base, [seen.some.forms[f] for f in own], seen.some.columns.channels, Recorder())
    alone = some.columns.proposals([(f,) for f in range(len(own))])
    place = min(range(len(own)), key=lambda f: float(np.sum(alone[f].squares)))
    return own[place]


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
        start = started(pair["seed"], *words, *chosen)
        found.append(round(times_the_smallest(seen, start, name), 2))
    return found


def times_the_smallest(seen: Standard, start: Start, name: str) -> float:
    """How many times as large an effect, alone on a rig, is as it must be to be detected."""
    base = projected(start.logged, start.model)
    forms = [form for form in start.forms if form.id == name]
    some = screened(base, forms, seen.some.columns.channels, Recorder())
    alone = some.columns.proposals([(f,) for f in range(len(forms))])
    best = max(alone, key=lambda one: one.evidence)
    if best.evidence == -math.inf:
        return 0.0
    none = channel_squares(base, base.rest)
    fitted = fit_set(base, some.columns.channels, some.effects(best), best.squares)
    explained = np.maximum(none - fitted.squares, 0.0)
    form = seen.some.forms.index(some.forms[best.forms[0]])
    return 1.0 / seen.smallest(form, explained, usual_sizes(fitted.effects[0]))


def usual_sizes(effect: CatalogueEffect) -> float:
    """The length of an effect's strengths, each in its usual size."""
    sizes = [float(getattr(effect, q.name)) / q.usual_size for q in effect.strengths()]
    return float(np.linalg.norm(sizes))


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
