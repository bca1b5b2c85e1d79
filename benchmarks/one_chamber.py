"""Rigs with one chamber and a spring: fit, open loop, and one undeclared effect that is found.

    python benchmarks/one_chamber.py run RESULTS.jsonl [--first 6000] [--count 20] [--quick]
    python benchmarks/one_chamber.py table RESULTS.jsonl

`run` draws a rig and its campaign for each seed: linear or rotary, with or without a motor, under
pressure or a vacuum, with a 3/2 valve or a fill and a bleed valve, and some ten times slower,
smaller or stiffer. It is made twice: with nothing missing, of which the fitted numbers, the
open-loop errors on held-out tests and the verdict are kept, and with one effect of the catalogue,
which `sysid diagnose` is asked for. One line of JSON per seed is appended; those already present
are skipped. `table` prints what was found. Seeds 5000 to 5999 are for development, 6000 on for the
report.
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
from benchmarks.history import commit  # noqa: E402
from datasets.generator.campaign import GeneratedCampaign, stream  # noqa: E402
from datasets.generator.effects import Injected, typical  # noqa: E402
from datasets.generator.effects.catalogue import FORMS  # noqa: E402
from datasets.generator.files import write_campaign  # noqa: E402
from datasets.generator.one_chamber import make_one_chamber_campaign, scaled  # noqa: E402

# Effects that a rig with one chamber can have; those of a motor where it has one.
OF_AIR = (
    "stribeck-friction",
    "asymmetric-coulomb-friction",
    "position-dependent-friction",
    "presliding",
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
    "temperature-drift",
    "exhaust-back-pressure",
    "valve-delay",
    "duty-dead-zone",
    "sticking-valve",
    "pressure-offset",
    "pressure-gain",
    "pressure-lag",
)
OF_A_MOTOR = ("torque-constant-error", "torque-ripple", "amplifier-lag")
OF_A_SHAFT = ("mounting-tilt",)
# Flows that only a supply above the atmosphere has.
CHOKED = ("subsonic-flow-shape", "choked-exhaust-scaling")
# What a rig differs by: its speed, area and length by similarity, and its spring.
SIZES = {
    "as it is": {},
    "slow": {"time": 10.0},
    "small": {"area": 0.1, "length": 0.5},
    "large": {"area": 10.0, "length": 2.0, "time": 3.0},
    "stiff": {"stiffer": 10.0},
}


class FailedError(Exception):
    """A command that failed: its last line."""


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A seed's rig, what it is in words, and its effect, on chamber A where it has a side."""

    rig: dict[str, Any]
    size: str
    effect: Injected

    @property
    def said(self) -> str:
        """What the rig is."""
        r = self.rig
        supply = "vacuum" if r["vacuum"] else "pressure"
        valves = "fill and bleed" if r["bleeds"] else "3/2"
        motor = "motor" if r["with_motor"] else "no motor"
        return ", ".join((r["motion"], motor, supply, valves, self.size))


def drawn(seed: int) -> Drawn:
    """The rig and the effect of a seed."""
    rng = stream(seed, "effects", 1000)
    rig = {
        "motion": str(rng.choice(["rotary", "linear"])),
        "with_motor": bool(rng.random() < 0.4),
        "vacuum": bool(rng.random() < 0.25),
        "bleeds": bool(rng.random() < 0.35),
    }
    names = OF_AIR + OF_A_MOTOR * rig["with_motor"] + OF_A_SHAFT * (rig["motion"] == "rotary")
    names = tuple(name for name in names if not (rig["vacuum"] and name in CHOKED))
    size = str(rng.choice(list(SIZES)))
    name = names[int(rng.integers(len(names)))]
    effect = typical(name, str(rng.choice(FORMS[name])), rng)
    return Drawn(rig, size, dataclasses.replace(effect, side="a") if effect.side else effect)


def made(seed: int, drawn: Drawn, effects: tuple[Injected, ...]) -> GeneratedCampaign:
    """The campaign of a seed."""
    size = dict(SIZES[drawn.size])
    stiffer = size.pop("stiffer", 1.0)
    campaign = make_one_chamber_campaign(seed, stiffer=stiffer, effects=effects, **drawn.rig)
    return scaled(campaign, **size) if size else campaign


def command(*words: str) -> str:
    """What a command prints."""
    done = call(*words)
    if done.returncode != 0:
        raise FailedError((done.stderr.strip() or "nothing was said").splitlines()[-1])
    return done.stdout


def fitted(folder: Path, campaign: GeneratedCampaign) -> None:
    """A campaign in a folder, fitted there."""
    write_campaign(folder, campaign, "generated")
    command("sysid", "fit", str(folder / "campaign.toml"), "-o", str(folder / "bundle.json"))


def without_effect(seed: int, drawn: Drawn, quick: bool) -> dict[str, Any]:
    """Fitted numbers against the truth, open-loop errors on held-out tests, and the verdict."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        campaign = made(seed, drawn, ())
        fitted(folder, campaign)
        bundle = json.loads((folder / "bundle.json").read_text("utf-8"))
        words = (str(folder / "campaign.toml"), "--bundle", str(folder / "bundle.json"))
        shown = json.loads(command("sysid", "validate", *words, "--json"))
        found = diagnosed(folder, quick)
    errors, held = {}, {}
    friction, law = campaign.truth["friction"], campaign.truth["valves"]["a"]
    law = law | campaign.truth["delays"]
    for part, truth in ((bundle["friction"], friction), (bundle["valves"]["a"]["discrete"], law)):
        for key, true in truth.items():
            if part[key].get("value") is not None:
                errors[key] = part[key]["value"] / true - 1.0
                low, high = part[key]["interval"]
                held[key] = low <= true <= high
    lines = list(_open_loop(shown))
    return {"errors": errors, "held": held, "open_loop": lines, "diagnosis": found}


def _open_loop(shown: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The errors of each held-out log by channel, as the first valve model simulates it."""
    for log in shown["validation"]["logs"]:
        if log["use"] == "holdout":
            for channel, errors in log["channels"].items():
                kept = {k: errors[k] for k in ("rmse", "fit_percent", "rmse_to_noise")}
                found = {"kind": log["kind"], "model": log["valve_model"], "channel": channel}
                yield found | kept


def diagnosed(folder: Path, quick: bool) -> dict[str, Any]:
    """The diagnosis of a fitted campaign."""
    words = [str(folder / "campaign.toml"), "--bundle", str(folder / "bundle.json")]
    words += ["--quick"] if quick else []
    found = json.loads(command("sysid", "diagnose", *words, "--json"))
    keys = ("verdict", "because", "effects", "residual")
    return {key: found[key] for key in keys if key in found}


def with_effect(seed: int, drawn: Drawn, quick: bool) -> dict[str, Any]:
    """The diagnosis of the same rig with its effect."""
    with tempfile.TemporaryDirectory() as place:
        fitted(Path(place), made(seed, drawn, (drawn.effect,)))
        return diagnosed(Path(place), quick)


def one(seed: int, quick: bool) -> dict[str, Any]:
    """Both campaigns of a seed."""
    rig = drawn(seed)
    begun = time.monotonic()
    result: dict[str, Any] = {"seed": seed, "rig": rig.said, "commit": commit()}
    result["effects"] = [f"{rig.effect.id}:{rig.effect.form}"]
    for name, make in (("plain", without_effect), ("diagnosis", with_effect)):
        try:
            result[name] = make(seed, rig, quick)
        except (FailedError, ValueError, RuntimeError) as fault:
            result[f"{name}_failed"] = str(fault)
    return result | {"wall_s": round(time.monotonic() - begun, 1)}


def run(options: argparse.Namespace) -> None:
    done = {r["seed"] for r in read(options.results)} if options.results.exists() else set()
    with options.results.open("a", encoding="utf-8") as file:
        for seed in range(options.first, options.first + options.count):
            if seed not in done:
                keep(file, one(seed, options.quick))


def table(options: argparse.Namespace) -> None:
    results = read(options.results)
    plain = [r["plain"] for r in results if "plain" in r]
    keys = sorted({key for one in plain for key in one["errors"]})
    print(f"{len(plain)} rigs with nothing missing: median and largest error, intervals that hold")
    for key in keys:
        errors = np.abs([one["errors"][key] for one in plain if key in one["errors"]])
        held = [one["held"][key] for one in plain if key in one["held"]]
        print(
            f"  {key:24} {np.median(errors):8.2%} {np.max(errors):8.2%}  {sum(held)} of {len(held)}"
        )
    quiet = sum(one["diagnosis"]["verdict"] == "adequate" for one in plain)
    print(f"  adequate: {quiet} of {len(plain)}")
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
        own = "" if "plain" not in r else r["plain"]["diagnosis"]["verdict"]
        first = f"  {r['seed']} ({r['rig']}): {r['effects'][0]}"
        print(f"{first}: {r['diagnosis']['verdict']}: {said}; without it: {own}")
    for r in results:
        for name in ("plain_failed", "diagnosis_failed"):
            if name in r:
                print(f"  {r['seed']}: {name}: {r[name]}")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("run", "table"))
    parser.add_argument("results", type=Path)
    parser.add_argument("--first", type=int, default=6000)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--quick", action="store_true", help="diagnose with --quick")
    options = parser.parse_args()
    (run if options.what == "run" else table)(options)


if __name__ == "__main__":
    main()
