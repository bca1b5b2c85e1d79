"""Index jumps, stale rows and counter wraps in healthy logs: found, and what a fit then says.

    python -m benchmarks.damaged_logs [--count 100] [--first 51000] [--jobs 2]

Each seed makes one log of friction tests (motion, constant effort or ramps; orientation, motion,
sampling and effects of the catalogue drawn as in `healthy.py`) and fits it whole, then with each
damage alone. Jumps: 1 to 3, their sizes log-uniform from `LEAST_COUNTS` counts to a tenth of the
travel, each in any row. Stale rows: the position, the pressures or all of them come every 2 to 12
rows, every other log with a jitter of one row. Wraps: the counter has 16 bits, or starts again at
each turn; logs that never cross its end have none. A jump or a wrap is found where a notice names
its row, stale rows where a notice names their channel. Parameters are compared with the undamaged
log's: both within 3 standard errors of the undamaged log's, and of either fit's.
"""

from __future__ import annotations

import argparse
import itertools
import math
import re
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.healthy import EFFECTS
from datasets.generator.campaign import Size, drawn_effects, make_campaign, stream
from datasets.generator.effects import parsed
from datasets.generator.files import Dialect, log_frame
from datasets.generator.rigs import random_rig
from sysid.errors import SysidError
from sysid.estimation.linear import Estimate
from sysid.friction import fit_friction
from sysid.io.logs import Log, read_log
from sysid.io.rig import Rig, rig_from_content

KINDS = ("friction-motion", "friction-motion", "friction-sliding", "friction-static")
SIZE = Size(2, 2, 1, 0.24, (1, 1), (1, 1), (1, 1))
LEAST_COUNTS = 4.0
MOST_OF_TRAVEL = 0.1
STRIDES = (2, 13)
TRUSTED = re.compile(r" jumps by | repeats: | wraps around ")
PRESSURES = ("pressure_a_pa", "pressure_b_pa")
SIZES = (4.0, 8.0, 16.0, 64.0, math.inf)


@dataclass
class Damage:
    """One damage of one log: what was drawn, what of it was found, and the parameters after it.

    `drawn` holds (size in counts, found) of each jump, or one entry; `within` whether all
    parameters lie within 3 standard errors: of the undamaged log's, of either fit's.
    """

    kind: str
    drawn: list[tuple[float, bool]]
    within: tuple[bool, bool] | None = None
    why: str = ""


@dataclass
class Outcome:
    """A log: its title, the false alarms of it undamaged, and its damages."""

    title: str
    false: list[str] = field(default_factory=list)
    damages: list[Damage] = field(default_factory=list)


@dataclass(frozen=True)
class Healthy:
    """A log without damage: its table, kind and rig, and one count of its position."""

    frame: pd.DataFrame
    kind: str
    rig: Rig
    count: float

    @property
    def position(self) -> str:
        return self.rig.position_channel

    def read(self, frame: pd.DataFrame) -> Log:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "log.parquet"
            frame.to_parquet(path)
            return read_log(path, self.rig)

    def estimates(self, log: Log) -> dict[str, Estimate]:
        """The friction's parameters that are identified; none where nothing is."""
        try:
            found = fit_friction(log.trials, self.rig, kind=self.kind, estimate_inertia=True)
        except SysidError:
            return {}
        return {n: e for n, e in found.by_name().items() if math.isfinite(e.value)}


def healthy(seed: int) -> tuple[str, Healthy] | None:
    """A log of this seed; None where the generator cannot make it."""
    rng = np.random.default_rng([seed, 49])
    orientation = str(rng.choice(["horizontal", "vertical"]))
    motion = str(rng.choice(["rotary", "linear"]))
    kind = str(rng.choice(KINDS))
    names = rng.choice(EFFECTS, size=int(rng.integers(0, 3)), replace=False)
    rig = random_rig(stream(seed, "rig"), orientation, motion)
    rig.content["sampling"]["period_s"] = float(rng.choice([0.0005, 0.001, 0.001, 0.002]))
    try:
        campaign = make_campaign(
            seed,
            size=SIZE,
            scatter=float(rng.uniform(0.0, 0.06)),
            orientation=orientation,
            motion=motion,
            rig=rig,
            kinds=(kind,),
            effects=drawn_effects(seed, [parsed(str(name)) for name in names]),
        )
    except (ValueError, RuntimeError):
        return None
    if not campaign.logs:
        return None
    frame = log_frame(campaign.logs[0].tests, campaign.rig, Dialect(parquet=True))
    read_with = rig_from_content(campaign.rig.content, "generated")
    title = f"{seed} {kind} {orientation} {motion} {' '.join(map(str, names))}"
    return title, Healthy(frame, kind, read_with, campaign.rig.position_per_count)


# --- damages --------------------------------------------------------------------------------


def tests_of(frame: pd.DataFrame) -> list[np.ndarray]:
    """Rows of each test."""
    if "test" not in frame:
        return [np.arange(len(frame))]
    return list(frame.groupby("test", sort=False).indices.values())


def with_jumps(log: Healthy, rng: np.random.Generator) -> tuple[pd.DataFrame, dict[int, float]]:
    """The log with jumps, and their sizes in counts by row."""
    frame = log.frame.copy()
    values = frame[log.position].to_numpy(copy=True)
    most = MOST_OF_TRAVEL * (log.rig.travel or float(np.ptp(values))) / log.count
    drawn: dict[int, float] = {}
    tests = tests_of(frame)
    for _ in range(int(rng.integers(1, 4))):
        rows = tests[int(rng.integers(len(tests)))]
        row = int(rng.integers(5, len(rows) - 5))
        size = round(math.exp(rng.uniform(math.log(LEAST_COUNTS), math.log(most))))
        if any(abs(int(rows[row]) - other) < 10 for other in drawn):
            continue
        values[rows[row:]] += size * log.count * rng.choice([-1.0, 1.0])
        drawn[int(rows[row])] = float(size)
    frame[log.position] = values
    return frame, drawn


def with_stale_rows(log: Healthy, rng: np.random.Generator) -> tuple[pd.DataFrame, list[str]]:
    """The log with channels that repeat, and these channels."""
    frame = log.frame.copy()
    pressures = [name for name in PRESSURES if name in frame]
    choices = [[log.position], pressures, [log.position, *pressures]]
    channels = choices[int(rng.integers(3))]
    stride, jitters = int(rng.integers(*STRIDES)), bool(rng.integers(2))
    for rows in tests_of(frame):
        steps = stride + (rng.integers(0, 2, len(rows)) if jitters else np.zeros(len(rows), int))
        fresh = np.cumsum(steps) - int(rng.integers(stride))
        held = np.searchsorted(fresh, np.arange(len(rows)), side="right")
        first = np.concatenate([[0], fresh])[held].clip(0, len(rows) - 1)
        for name in channels:
            frame.loc[rows, name] = frame[name].to_numpy()[rows[first]]
    return frame, channels


def with_wraps(log: Healthy, rng: np.random.Generator) -> tuple[pd.DataFrame, list[int]]:
    """The log with a counter that wraps, and the first row after each wrap."""
    whole = 2.0**16 * log.count
    if not log.rig.is_linear and rng.integers(2):
        whole = 2.0 * math.pi
    frame = log.frame.copy()
    turns = np.floor(frame[log.position].to_numpy() / whole + 1e-9)
    frame[log.position] -= whole * turns
    found = [rows[np.flatnonzero(np.diff(turns[rows])) + 1] for rows in tests_of(frame)]
    return frame, np.concatenate(found).astype(int).tolist()


# --- judging --------------------------------------------------------------------------------


def said(log: Log) -> list[str]:
    """What the notices say of samples that cannot be trusted."""
    return [line for line in log.notices if TRUSTED.search(line)]


def within(before: dict[str, Estimate], after: dict[str, Estimate]) -> tuple[bool, bool]:
    """Whether all parameters are within 3 standard errors: of those before, of either's."""
    own = both = True
    for name, old in before.items():
        new = after.get(name)
        if new is None:
            return False, False
        apart = abs(new.value - old.value)
        own &= apart <= 3.0 * old.std
        both &= apart <= 3.0 * max(old.std, new.std)
    return own, both


def damaged(log: Healthy, before: dict[str, Estimate], seed: int) -> Iterator[Damage]:
    """Each damage of a log, judged."""
    rng = np.random.default_rng([seed, 50])
    frame, sizes = with_jumps(log, rng)
    yield judged(log, before, "jumps", frame, {f"row {r + 1} ": s for r, s in sizes.items()})
    stale, channels = with_stale_rows(log, rng)
    yield judged(log, before, "stale", stale, {f"{name} repeats": 0.0 for name in channels})
    wrapped, rows = with_wraps(log, rng)
    if rows:
        yield judged(log, before, "wraps", wrapped, {f"row {rows[0] + 1} ": 0.0})


def judged(
    log: Healthy,
    before: dict[str, Estimate],
    kind: str,
    frame: pd.DataFrame,
    signs: dict[str, float],
) -> Damage:
    """One damage: `signs` of it in the notices, with the size of each, and the fit afterwards."""
    try:
        read = log.read(frame)
    except SysidError as error:
        return Damage(kind, [(size, False) for size in signs.values()], (False, False), str(error))
    lines = said(read)
    drawn = [(size, any(sign in line for line in lines)) for sign, size in signs.items()]
    after = log.estimates(read)
    close = within(before, after) if before else None
    why = ""
    if close is not None and not all(close):
        why = "; ".join(
            f"{n} {e.value:.4g} +- {e.std:.2g} -> "
            + (f"{after[n].value:.4g} +- {after[n].std:.2g}" if n in after else "none")
            for n, e in before.items()
        )
    return Damage(kind, drawn, close, why)


def outcome(seed: int) -> Outcome | None:
    """One seed's log, whole and with each damage."""
    made = healthy(seed)
    if made is None:
        return None
    title, log = made
    whole = log.read(log.frame)
    found = Outcome(title, said(whole))
    found.damages += damaged(log, log.estimates(whole), seed)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=51000, help="first seed")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.count)
    with ProcessPoolExecutor(options.jobs) as pool:
        found = [made for made in pool.map(outcome, seeds) if made is not None]
    show(found, options.count)


def show(found: list[Outcome], count: int) -> None:
    """The counts, and each miss by name."""
    false = [f"{o.title}: {line}" for o in found for line in o.false]
    print(f"{len(found)} logs of {count} seeds; false alarms: {len(false)}", *false, sep="\n   ")
    for kind in ("jumps", "stale", "wraps"):
        own = [(o.title, d) for o in found for d in o.damages if d.kind == kind]
        drawn = [entry for _, d in own for entry in d.drawn]
        fitted = [d.within for _, d in own if d.within is not None]
        print(
            f"{kind}: {len(own)} logs; found {share([ok for _, ok in drawn])}; parameters within 3 "
            f"standard errors of the undamaged log's {share([a for a, _ in fitted])}, of either "
            f"fit's {share([b for _, b in fitted])}"
        )
        if kind == "jumps":
            by_size: dict[float, list[bool]] = defaultdict(list)
            for size, ok in drawn:
                by_size[next(limit for limit in SIZES[1:] if size < limit)].append(ok)
            for low, limit in itertools.pairwise(SIZES):
                print(f"   {low:g} to {limit:g} counts: {share(by_size[limit])}")
        for title, d in own:
            if not all(ok for _, ok in d.drawn) or (d.within is not None and not all(d.within)):
                missed = [size for size, ok in d.drawn if not ok]
                print(f"   {title}: missed {missed}; {d.within}; {d.why}")


def share(flags: list[bool]) -> str:
    return f"{sum(flags)} of {len(flags)}" + (f" ({np.mean(flags):.1%})" if flags else "")


if __name__ == "__main__":
    main()
