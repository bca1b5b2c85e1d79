"""Healthy campaigns: what the checks against slips say of recordings without one.

    python benchmarks/healthy.py [--count 200] [--first 70000] [--data ../shared/data] [--jobs 2]

Campaigns are generated from the seeds printed; orientation, motion, dialect, sampling, scatter and
effects of the catalogue (none, one or two, which are no slips) are drawn with the seed. Each is
read, checked with all its logs together, and its friction is fitted as `sysid fit` does. A false
refusal is an InputError, or friction that "cannot be"; a misleading notice is one that names a
slip. The bundled campaign, the samples and the measured sets (where their data are present) come
first.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import shutil
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.slip_catalogue import names_a_slip  # noqa: E402
from datasets.generator.campaign import Size, drawn_effects, make_campaign, stream  # noqa: E402
from datasets.generator.effects import FORMS, OUT_OF_CATALOGUE, parsed  # noqa: E402
from datasets.generator.files import Dialect, write_campaign  # noqa: E402
from datasets.generator.rigs import random_rig  # noqa: E402
from datasets.measured.run import chosen, convert_all  # noqa: E402
from datasets.measured.sets import PROJECT, SETS_FOLDER, read_set  # noqa: E402
from sysid.checks.consistency.campaign import contradictions, readings_of  # noqa: E402
from sysid.errors import InputError, NotIdentifiedError  # noqa: E402
from sysid.friction import fit_friction  # noqa: E402
from sysid.io.campaign import FRICTION_KINDS, Campaign, read_campaign  # noqa: E402

BUNDLED = REPOSITORY / "datasets" / "bundled" / "campaign.toml"
SAMPLES = REPOSITORY.parent / "shared" / "samples"
DATA = REPOSITORY.parent / "shared" / "data"
SIZE = Size(1, 2, 1, 0.24, (1, 1), (2, 1), (1, 1))
# The generator's out-of-catalogue effects are left out: nobody could call their signs healthy.
EFFECTS = tuple(id for id in FORMS if id not in OUT_OF_CATALOGUE)


@dataclass
class Tally:
    """What was said of healthy campaigns."""

    campaigns: int = 0
    logs: int = 0
    not_made: int = 0
    notices: int = 0
    refusals: list[str] = field(default_factory=list)
    misleading: list[str] = field(default_factory=list)
    unidentified: list[str] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Count what was said of others too."""
        for one in dataclasses.fields(self):
            setattr(self, one.name, getattr(self, one.name) + getattr(other, one.name))


def written(seed: int, folder: Path) -> Path | None:
    """A campaign of this seed in a folder; None where the generator cannot make it."""
    rng = np.random.default_rng([seed, 15])
    orientation = str(rng.choice(["horizontal", "vertical"]))
    motion = str(rng.choice(["rotary", "linear"]))
    dialect = Dialect(**{f.name: bool(rng.random() < 0.3) for f in dataclasses.fields(Dialect)})
    names = rng.choice(EFFECTS, size=int(rng.integers(0, 3)), replace=False)
    rig = random_rig(stream(seed, "rig"), orientation, motion)
    rig.content["sampling"]["period_s"] = float(rng.choice([0.0005, 0.001, 0.001, 0.001, 0.002]))
    try:
        wanted = [parsed(f"{name}*{rng.uniform(0.5, 1.5):.3f}") for name in names]
        campaign = make_campaign(
            seed,
            size=SIZE,
            scatter=float(rng.uniform(0.0, 0.06)),
            orientation=orientation,
            motion=motion,
            rig=rig,
            effects=drawn_effects(seed, wanted),
        )
    except (ValueError, RuntimeError):
        return None
    write_campaign(folder, campaign, "generated", dialect)
    print(f"{seed}: {orientation} {motion} {' '.join(map(str, names))}", flush=True)
    return folder / "campaign.toml"


def judge(file: Path, tally: Tally) -> None:
    """Read, check and fit one campaign, and count what is said of it."""
    tally.campaigns += 1
    try:
        campaign = read_campaign(file)
        said = [*campaign.notices, *campaign.rig.notices, *_of_logs(campaign, tally)]
    except InputError as error:
        tally.refusals.append(f"{file}: {error}")
        return
    tally.notices += len(said)
    tally.misleading += [f"{file.parent.name}: {line}" for line in said if names_a_slip(line)]


def _of_logs(campaign: Campaign, tally: Tally) -> Iterator[str]:
    """Every notice of the readers, of the friction fits and of the comparison."""
    found, tests = [], []
    for entry in campaign.logs:
        tally.logs += 1
        log = campaign.read(entry)
        yield from log.notices
        found.append(readings_of(log, entry.kind, campaign.rig))
        if entry.kind in FRICTION_KINDS and entry.use == "fit":
            tests += [(trial, entry.kind) for trial in log.trials]
    yield from contradictions(found, campaign.rig)
    if not tests:
        return
    try:
        result = fit_friction([t for t, _ in tests], campaign.rig, kind=[kind for _, kind in tests])
    except NotIdentifiedError as error:
        tally.unidentified.append(f"{campaign.path}: {error}")
        return
    yield from result.notices
    tally.refusals += [f"{campaign.path}: {line}" for line in result.impossible]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=70000, help="first seed")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the measured data")
    options = parser.parse_args()
    rest = Tally()
    for file in (BUNDLED, *sorted(SAMPLES.glob("*/campaign.toml"))):
        judge(file, rest)
    show("bundled and samples", rest)
    if options.data.is_dir():
        show("measured", judged_sets(options.data))
    tally, seeds = Tally(), itertools.count(options.first)
    with ProcessPoolExecutor(options.jobs) as pool:
        while tally.campaigns < options.count:
            some = list(itertools.islice(seeds, min(20, options.count - tally.campaigns)))
            for found in pool.map(judged, some):
                tally.add(found)
            show(f"generated, seeds {options.first} to {some[-1]}", tally)


def judged(seed: int) -> Tally:
    """What is said of the campaign of a seed."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        made = written(seed, Path(name) / str(seed))
        if made is None:
            tally.not_made += 1
        else:
            judge(made, tally)
    return tally


def judged_sets(data: Path) -> Tally:
    """Every campaign of the measured sets, converted as `python -m datasets.measured` does."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        for folder in chosen(SETS_FOLDER, (), data):
            measured = read_set(folder)
            work = Path(name) / measured.name
            work.mkdir()
            for file in folder.glob("*.toml"):
                shutil.copyfile(file, work / file.name)
            convert_all(measured, data if measured.data == "shared" else PROJECT, work, print)
            for entry in measured.campaigns:
                judge(work / entry.file, tally)
    return tally


def show(title: str, tally: Tally) -> None:
    """The counts, and each false alarm by name."""
    print(
        f"{title}: {tally.campaigns} campaigns ({tally.not_made} could not be made), "
        f"{tally.logs} logs, {len(tally.refusals)} false refusals, {len(tally.misleading)} "
        f"misleading of {tally.notices} notices, {len(tally.unidentified)} without friction",
        flush=True,
    )
    for name, lines in (
        ("refused", tally.refusals),
        ("misleading", tally.misleading),
        ("without friction", tally.unidentified),
    ):
        for line in lines:
            print(f"   {name}: {line}")


if __name__ == "__main__":
    main()
