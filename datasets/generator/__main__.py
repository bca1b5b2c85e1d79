"""`python -m datasets.generator -o DIR --seed N`: a campaign of a random rig, in files."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from datasets.generator.bundled import BUNDLED_FOLDER, write_bundled
from datasets.generator.campaign import (
    KINDS,
    Size,
    drawn_effects,
    make_campaign,
    size_of,
    stream,
)
from datasets.generator.effects import parsed
from datasets.generator.files import Dialect, write_campaign, write_text
from datasets.generator.rigs import GeneratedRig, random_rig, reference_rig

_FLAGS = {
    "counts": "encoder counts instead of the position",
    "volts": "the motor's command in volts",
    "text_labels": "t1, t2 in place of test numbers",
    "comments": "comment lines on top of each CSV file",
    "running_time": "time continues from test to test",
    "supply": "the measured supply pressure as a column",
    "parquet": "Parquet instead of CSV",
}


def _size(text: str) -> Size:
    try:
        return size_of(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither small, standard, lab, large nor a positive factor"
        ) from None


def _kinds(text: str) -> tuple[str, ...]:
    kinds = tuple(part.strip() for part in text.split(","))
    for kind in kinds:
        if kind not in KINDS:
            raise argparse.ArgumentTypeError(f"{kind!r} is not one of {', '.join(KINDS)}")
    return kinds


def _not_negative(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of 0 or more")
    return value


def _pwm_frequency(text: str) -> float:
    value = _not_negative(text)
    if not 10.0 <= value <= 500.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not within 10 to 500 Hz")
    return value


def _seed(text: str) -> int:
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 0 or more")
    return int(text)


def _effect(text: str) -> tuple[str, str, float]:
    try:
        return parsed(text)
    except ValueError as fault:
        raise argparse.ArgumentTypeError(str(fault)) from None


def parser() -> argparse.ArgumentParser:
    """The command line's arguments."""
    p = argparse.ArgumentParser(prog="python -m datasets.generator", description=__doc__)
    p.add_argument("-o", "--output", type=Path, metavar="DIR", help="folder for the campaign")
    p.add_argument("--seed", type=_seed, help="seed of the rig and of every test")
    p.add_argument(
        "--size", type=_size, default="standard", help="small, standard, lab, large, factor"
    )
    p.add_argument("--kinds", type=_kinds, default=KINDS, help="comma-separated; default all")
    p.add_argument("--rig", choices=("random", "reference"), default="random")
    p.add_argument("--orientation", choices=("horizontal", "vertical"), default="horizontal")
    p.add_argument("--motion", choices=("rotary", "linear"), default="rotary")
    p.add_argument("--payload", type=_not_negative, default=0.0, metavar="KG")
    p.add_argument(
        "--scatter", type=_not_negative, default=0.02, help="of friction, trial to trial"
    )
    p.add_argument(
        "--noise", type=_not_negative, metavar="PA", help="pressure noise; default: drawn"
    )
    p.add_argument("--pwm-frequency", type=_pwm_frequency, default=200.0, metavar="HZ")
    p.add_argument("--truth", type=Path, metavar="FILE", help="write the truth there, as JSON")
    p.add_argument(
        "--effect",
        type=_effect,
        action="append",
        default=[],
        metavar="ID[:FORM][*SCALE]",
        help="an undeclared effect, its size times SCALE; may be repeated",
    )
    p.add_argument("--bundled", action="store_true", help="regenerate datasets/bundled/")
    for name, text in _FLAGS.items():
        p.add_argument("--" + name.replace("_", "-"), action="store_true", help=text)
    return p


def _rig(arguments: argparse.Namespace) -> GeneratedRig:
    a = arguments
    if a.rig == "reference":
        return reference_rig(a.orientation, a.motion, a.payload)
    return random_rig(stream(a.seed, "rig"), a.orientation, a.motion, a.payload)


def _generate(p: argparse.ArgumentParser, a: argparse.Namespace, command: str) -> list[Path]:
    if a.output is None or a.seed is None:
        p.error("-o DIR and --seed N are needed (or --bundled)")
    if a.truth is not None and a.output.resolve() in a.truth.resolve().parents:
        p.error("--truth must lie outside the campaign's folder, where a fit might find it")
    try:
        campaign = make_campaign(
            a.seed,
            size=a.size,
            scatter=a.scatter,
            noise_pa=a.noise,
            pwm_frequency=a.pwm_frequency,
            rig=_rig(a),
            kinds=a.kinds,
            effects=drawn_effects(a.seed, a.effect),
        )
    except (ValueError, RuntimeError) as fault:  # conflicting effects, a rig that does not move
        p.error(str(fault))
    dialect = Dialect(**{name: getattr(a, name) for name in _FLAGS})
    written = write_campaign(a.output, campaign, command, dialect)
    if a.truth is not None:
        truth = campaign.truth | {"command": command}
        write_text(a.truth, json.dumps(truth, indent=1, allow_nan=False) + "\n")
        written.append(a.truth)
    return written


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    p = parser()
    a = p.parse_args(given)
    began = time.perf_counter()
    command = shlex.join(["python", "-m", "datasets.generator", *_without_places(given)])
    written = write_bundled(a.output or BUNDLED_FOLDER) if a.bundled else _generate(p, a, command)
    size = sum(path.stat().st_size for path in written)
    print(f"{len(written)} files, {size / 1e6:.1f} MB, {time.perf_counter() - began:.1f} s")
    return 0


def _without_places(given: list[str]) -> list[str]:
    """The arguments without machine paths, for the record."""
    kept, skip = [], False
    for text in given:
        if not skip and text not in ("-o", "--output", "--truth"):
            if not text.startswith(("--output=", "--truth=", "-o")):
                kept.append(text)
            continue
        skip = not skip
    return kept


if __name__ == "__main__":
    sys.exit(main())
