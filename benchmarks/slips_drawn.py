"""Drawn slips of unit, column, time and sign in whole campaigns: which are caught, by kind.

    python benchmarks/slips_drawn.py [--count 300] [--seed 8000] [--list] [--bare]

Each slip (`slip_catalogue.py`) changes one log, or the rig file, of a campaign: the bundled one,
generated ones of seeds from 100 times `--seed` on (horizontal and vertical, rotary and linear, with
and without an effect of the catalogue, a motor alone) and the samples where they are present. The
log is read and fitted as `sysid fit` does, and compared with the campaign's other logs as `sysid
check` does. Caught is exit 2 or 3, or a notice that names that very slip and that the unchanged
campaign does not give. With `--bare` each log stands alone, without a rig file: what the friction
and valve tests of the same campaigns show by themselves, and a table by kind.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
import shutil
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.slip_catalogue import KINDS, NOTHING, RIG_SLIPS, Kind, LogOfSlip  # noqa: E402
from datasets.generator.campaign import Size, drawn_effects, make_campaign  # noqa: E402
from datasets.generator.files import Dialect, write_campaign  # noqa: E402
from sysid.checks.consistency.campaign import (  # noqa: E402
    LogReadings,
    contradictions,
    readings_of,
)
from sysid.errors import InputError, SysidError  # noqa: E402
from sysid.friction import fit_friction  # noqa: E402
from sysid.io.bare_rig import read_bare_logs  # noqa: E402
from sysid.io.campaign import FRICTION_KINDS, Campaign, CampaignLog, read_campaign  # noqa: E402
from sysid.io.logs import Log  # noqa: E402
from sysid.io.rig import Rig  # noqa: E402
from sysid.valve_discrete import fit_valve_discrete  # noqa: E402
from sysid.valve_pwm import fit_valve_pwm  # noqa: E402

BUNDLED = REPOSITORY / "datasets" / "bundled"
SAMPLES = REPOSITORY.parent / "shared" / "samples"
SIZE = Size(2, 2, 2, 0.08, (2, 1), (2, 1), (2, 1))
MAKES = (
    ("horizontal", "rotary", ""),
    ("vertical", "rotary", ""),
    ("horizontal", "linear", ""),
    ("vertical", "linear", ""),
    ("horizontal", "rotary", "seal-friction:sum"),
    ("vertical", "rotary", "inertia-mismatch"),
    ("horizontal", "linear", "stribeck-friction"),
)
BARE_KINDS = (*FRICTION_KINDS, "valve-discrete", "valve-pwm")
FITTED_AS_FRICTION = (*FRICTION_KINDS, "motion-motor")


@dataclass
class Base:
    """A campaign in files, and what its unchanged logs give."""

    name: str
    campaign: Campaign
    readings: dict[str, LogReadings]
    said: set[str]
    unfit: set[str]
    bare: bool = False

    def entries(self) -> list[CampaignLog]:
        """The logs that slips are made in."""
        return [e for e in self.campaign.logs if not self.bare or e.kind in BARE_KINDS]

    def read(self, entry: CampaignLog) -> tuple[Log, Rig]:
        """A log, and the rig that it is fitted with."""
        if not self.bare:
            return self.campaign.read(entry), self.campaign.rig
        bare = read_bare_logs([entry.path], {})
        (log,) = bare.logs
        return dataclasses.replace(log, notices=(*log.notices, *bare.notices)), bare.read_with


@dataclass(frozen=True)
class Verdict:
    """One drawn slip and what became of it: `how` is empty where it was not caught."""

    base: str
    log: str
    kind: str
    group: str
    shown: str
    factor: float
    how: str

    @property
    def title(self) -> str:
        return f"{self.base} {self.log}: {self.kind} x {self.factor:.4g}"


# --- campaigns ----------------------------------------------------------------------------


def bases(folder: Path, seed: int, bare: bool) -> list[Base]:
    """Every campaign that slips are made in."""
    files = {"bundled": BUNDLED / "campaign.toml"}
    for number, (orientation, motion, effect) in enumerate(MAKES):
        name = " ".join(
            filter(None, (f"generated {100 * seed + number}", orientation, motion, effect))
        )
        target = folder / f"generated_{number}"
        made = make_campaign(
            100 * seed + number,
            size=SIZE,
            orientation=orientation,
            motion=motion,
            effects=drawn_effects(100 * seed + number, _wanted(effect)),
        )
        write_campaign(target, made, "generated", Dialect(parquet=True))
        files[name] = target / "campaign.toml"
    alone = folder / "alone"
    shutil.copytree(folder / "generated_0", alone)
    files["motor alone"] = motor_alone(alone)
    files |= {f"sample {f.parent.name}": f for f in sorted(SAMPLES.glob("*/campaign.toml"))}
    return [base(name, file, bare) for name, file in files.items()]


def _wanted(effect: str) -> list[tuple[str, str, float]]:
    from datasets.generator.effects import parsed

    return [parsed(effect)] if effect else []


def motor_alone(folder: Path) -> Path:
    """The campaign in `folder` without its pneumatics: motor tests of an axis."""
    rig = (folder / "rig.toml").read_text()
    keep = [p for p in rig.split("\n[") if not re.match(r"(air|cylinder|pwm|valves)\]", p)]
    (folder / "rig.toml").write_text("\n[".join(keep))
    lines = ['rig = "rig.toml"', ""]
    for stem in ("friction_static", "friction_sliding", "friction_motion", "motion_motor"):
        path = folder / f"{stem}.parquet"
        frame = pd.read_parquet(path)
        wanted = [c for c in frame if not re.match(r"pressure|valve|duty|supply", c)]
        frame[wanted].to_parquet(path)
        kind = stem.replace("_", "-")
        lines += ["[[log]]", f'kind = "{kind}"', f'file = "{path.name}"', ""]
    (folder / "campaign.toml").write_text("\n".join(lines))
    return folder / "campaign.toml"


def base(name: str, file: Path, bare: bool) -> Base:
    campaign = read_campaign(file)
    readings: dict[str, LogReadings] = {}
    found = Base(name, campaign, readings, set(), set(), bare)
    for entry in found.entries():
        log, rig = found.read(entry)
        readings[entry.file] = readings_of(log, entry.kind, rig)
        found.said.update(log.notices)
        try:
            found.said.update(fit_notices(log, entry.kind, rig))
        except SysidError:
            found.unfit.add(entry.file)
    if not bare:
        found.said.update(contradictions(readings.values(), campaign.rig))
    return found


# --- one slip -----------------------------------------------------------------------------


def judged(
    where: Base, entry: CampaignLog, kind: Kind, factor: float, folder: Path
) -> Verdict | None:
    """The slip made in one log; None where it changes nothing."""
    rig = where.campaign.rig
    frame = _frame(entry)
    about = LogOfSlip(
        entry.kind,
        entry.valve,
        rig.is_linear,
        rig.air.atmospheric_pressure_pa if rig.air else 0.0,
        rig.effort_per_volt or 1.0,
    )
    changed = kind.change(frame, about, factor)
    if changed.equals(frame):
        return None
    path = folder / Path(entry.file).with_suffix(".parquet").name
    changed.to_parquet(path)
    how = _caught_in_log(where, dataclasses.replace(entry, path=path), kind)
    return Verdict(where.name, entry.file, kind.name, kind.group, kind.shown, factor, how)


def _frame(entry: CampaignLog) -> pd.DataFrame:
    if entry.path.suffix == ".parquet":
        return pd.read_parquet(entry.path)
    return pd.read_csv(entry.path, comment="#")


def _caught_in_log(where: Base, entry: CampaignLog, kind: Kind) -> str:
    """How the changed log is caught: exit 2, exit 3, its own notice, or the campaign's."""
    try:
        log, rig = where.read(entry)
    except InputError as error:
        return f"exit 2: {error}"
    try:
        notices = [*log.notices, *fit_notices(log, entry.kind, rig)]
    except SysidError as error:
        if entry.file not in where.unfit:
            return f"exit {error.exit_code}: {error}"
        notices = [*log.notices]
    own = _named(where, notices, kind.words)
    if own or where.bare:
        return f"log: {own}" if own else ""
    found = {**where.readings, entry.file: readings_of(log, entry.kind, rig)}
    together = _named(where, contradictions(found.values(), rig), kind.words)
    return f"campaign: {together}" if together else ""


def fit_notices(log: Log, kind: str, rig: Rig) -> Sequence[str]:
    """What the fit of a log of this kind says; SysidError where it gives no result."""
    if kind in FITTED_AS_FRICTION:
        result = fit_friction(log.trials, rig)
        result.require_possible()
        return result.notices
    if kind == "valve-discrete":
        return fit_valve_discrete(log.trials, rig, find_ratio=False).notices
    if kind == "valve-pwm":
        return fit_valve_pwm(log.trials, rig, surface="bipolynomial").notices
    return ()


def _named(where: Base, notices: Sequence[str], words: str) -> str:
    found = (n for n in notices if n not in where.said and re.search(words, n))
    return next(found, "")


def judged_rig(where: Base, slip: str, folder: Path) -> Verdict | None:
    """A slip in the rig file: every log is read and compared anew."""
    key, factor, words = RIG_SLIPS[slip]
    text = Path(where.campaign.rig.source).read_text()
    changed = re.sub(
        rf"(?m)^({key}) = ([-+\d.e]+)", lambda m: f"{m[1]} = {float(m[2]) * factor:.9g}", text
    )
    if changed == text:
        return None
    (folder / "rig.toml").write_text(changed)
    how = _caught_in_rig(where, folder / "rig.toml", words)
    return Verdict(where.name, "rig.toml", slip, "rig", "one log", factor, how)


def _caught_in_rig(where: Base, file: Path, words: str) -> str:
    from sysid.io.rig import read_rig

    try:
        campaign = dataclasses.replace(where.campaign, rig=read_rig(file))
        found = []
        for entry in campaign.logs:
            log = campaign.read(entry)
            own = _named(where, log.notices, words)
            if own:
                return f"log: {own}"
            if entry.kind in FRICTION_KINDS:
                fit_notices(log, entry.kind, campaign.rig)
            found.append(readings_of(log, entry.kind, campaign.rig))
    except SysidError as error:
        return f"exit {error.exit_code}: {error}"
    together = _named(where, contradictions(found, campaign.rig), words)
    return f"campaign: {together}" if together else ""


# --- all of them --------------------------------------------------------------------------


def drawn(places: Sequence[Base], count: int, seed: int, folder: Path) -> Iterator[Verdict]:
    """`count` different slips; each kind of slip has the same chance, one in nine is the rig's."""
    rng = np.random.default_rng(seed)
    seen: set[tuple[str, ...]] = set()
    while len(seen) < count:
        where = places[int(rng.integers(len(places)))]
        if rng.random() < 1.0 / 9.0 and not where.bare:
            slip = str(rng.choice(list(RIG_SLIPS)))
            key: tuple[str, ...] = (where.name, slip)
            verdict = None if key in seen else judged_rig(where, slip, folder)
        else:
            kind = KINDS[int(rng.integers(len(KINDS)))]
            entries = [e for e in where.entries() if e.kind in kind.logs]
            if not entries:
                continue
            entry = entries[int(rng.integers(len(entries)))]
            linear = where.campaign.rig.is_linear and kind.linear_factors is not None
            factors = kind.linear_factors if linear and kind.linear_factors else kind.factors
            factor = float(rng.choice(factors))
            key = (where.name, entry.file, kind.name, f"{factor:g}")
            verdict = None if key in seen else judged(where, entry, kind, factor, folder)
        if verdict is not None:
            seen.add(key)
            yield verdict


def report(verdicts: Sequence[Verdict]) -> None:
    """Shares by group and by where a slip can be seen, and those not caught by name."""
    groups: dict[str, list[Verdict]] = defaultdict(list)
    for v in verdicts:
        groups["nothing can show" if v.shown == NOTHING else v.group].append(v)
    for name, own in sorted(groups.items()):
        caught = sum(bool(v.how) for v in own)
        print(f"{name}: {caught} of {len(own)} caught")
    able = [v for v in verdicts if v.shown != NOTHING]
    caught = sum(bool(v.how) for v in able)
    share = 100.0 * caught / len(able)
    print(f"that a log or a campaign can show: {caught} of {len(able)} caught ({share:.1f} %)")
    print("how:", dict(Counter(v.how.split(":")[0] or "not" for v in able)))
    for v in verdicts:
        if not v.how:
            print(f"   not caught ({v.shown}): {v.title}")


def by_kind(verdicts: Sequence[Verdict]) -> None:
    """Of each kind of slip, how many logs alone show."""
    for name in dict.fromkeys(kind.name for kind in KINDS):
        own = [v for v in verdicts if v.kind == name]
        if own:
            print(f"   {name}: {sum(bool(v.how) for v in own)} of {len(own)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=8000)
    parser.add_argument("--list", action="store_true", help="how each slip was caught")
    parser.add_argument("--bare", action="store_true", help="each log alone, without a rig file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "changed").mkdir()
        places = bases(folder, options.seed, options.bare)
        verdicts = []
        for verdict in drawn(places, options.count, options.seed, folder / "changed"):
            verdicts.append(verdict)
            if options.list:
                print(f"{verdict.title} -> {verdict.how[:160] or 'NOT CAUGHT'}", flush=True)
    report(verdicts)
    if options.bare:
        by_kind(verdicts)


if __name__ == "__main__":
    main()
