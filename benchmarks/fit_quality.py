"""What fits say of themselves: healthy campaigns are never refused, nonsense never good.

    python benchmarks/fit_quality.py [--campaigns 12] [--seed 92000]

Healthy are whole generated campaigns (horizontal and vertical, rotary and linear in turn), the
bundled one and the samples beside the project: counted are the verdicts of all fits by kind, the
largest share of the signal's spread that each kind misses, and refusals. Nonsense are the bundled
valve and friction logs with a signal that does something else.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

import sysid as si  # noqa: E402
from datasets.generator.campaign import make_campaign  # noqa: E402
from datasets.generator.files import Dialect, write_campaign  # noqa: E402
from sysid.errors import SysidError  # noqa: E402
from sysid.io.campaign import read_campaign  # noqa: E402
from sysid.parameters import Parts  # noqa: E402
from sysid.parameters.quality import qualities_in  # noqa: E402
from sysid.pipeline.fit import CampaignFit, fit_campaign  # noqa: E402
from sysid.types import FloatArray  # noqa: E402

BUNDLED = REPOSITORY / "datasets" / "bundled"
SAMPLES = REPOSITORY.parent / "shared" / "samples"
RIGS = tuple(itertools.product(("horizontal", "vertical"), ("rotary", "linear")))
REFUSED = ("the law explains", "wrong sign", "friction tests:")


def generated(campaigns: int, seed: int, surface: str) -> Iterator[tuple[str, CampaignFit]]:
    for k in range(campaigns):
        orientation, motion = RIGS[k % len(RIGS)]
        made = make_campaign(seed + k, orientation=orientation, motion=motion)
        with tempfile.TemporaryDirectory() as folder:
            write_campaign(Path(folder), made, "", Dialect(parquet=True))
            campaign = read_campaign(Path(folder) / "campaign.toml")
            yield f"{seed + k} {orientation} {motion}", fit_campaign(campaign, surface=surface)


def given(surface: str) -> Iterator[tuple[str, CampaignFit]]:
    for folder in (BUNDLED, *sorted(SAMPLES.glob("rig-*"))):
        yield folder.name, fit_campaign(read_campaign(folder / "campaign.toml"), surface=surface)


def kind_of(place: str) -> str:
    return place.replace("valves.a.", "").replace("valves.b.", "").replace("friction, ", "")


def healthy(fits: Iterator[tuple[str, CampaignFit]]) -> None:
    verdicts: Counter[str] = Counter()
    missed: dict[str, float] = defaultdict(float)
    refused = campaigns = 0
    for name, found in fits:
        campaigns += 1
        for place, one in found.bundle.qualities().items():
            verdicts[one.verdict.partition(":")[0]] += 1
            missed[kind_of(place)] = max(missed[kind_of(place)], one.rmse_share or 0.0)
            if one.is_doubtful:
                print(f"  {name}, {place}: {one.verdict}")
        lines = [n for n in found.notices if any(text in n for text in REFUSED)]
        refused += len(lines)
        for line in lines:
            print(f"  {name}: {line}")
    print(f"healthy, {campaigns} campaigns: {dict(verdicts)}, refused or impossible: {refused}")
    for kind, share in missed.items():
        print(f"  {kind}: at most {100.0 * share:.3g} % of the spread")


# --- nonsense -----------------------------------------------------------------------------

Change = Callable[[FloatArray], FloatArray]
RNG = np.random.default_rng(20)


def sine(values: FloatArray) -> FloatArray:
    return 2e5 + 1e5 * np.sin(0.005 * np.arange(len(values))) + 150.0 * RNG.normal(size=len(values))


def walk(values: FloatArray) -> FloatArray:
    return np.clip(2e5 + 800.0 * np.cumsum(RNG.normal(size=len(values))), 8e4, 3.2e5)


PRESSURES: dict[str, Change] = {
    "backwards in time": lambda p: p[::-1],
    "rows shuffled": RNG.permutation,
    "mirrored": lambda p: p.max() + p.min() - p,
    "a sine": sine,
    "a random walk": walk,
}
EFFORTS: dict[str, Change] = {
    "zero": np.zeros_like,
    "constant": lambda u: np.full_like(u, 0.3),
    "negated": np.negative,
    "noise": lambda u: 0.3 * RNG.normal(size=len(u)),
    "half a second late": lambda u: np.roll(u, 500),
}


def fit(kind: str, path: Path) -> Parts:
    log = si.read_log(path, read_campaign(BUNDLED / "campaign.toml").rig)
    if kind == "valve_discrete":
        return si.fit_valve_discrete(log, find_ratio=False).part()
    if kind == "valve_pwm":
        return si.fit_valve_pwm(log, surface="bipolynomial").part()
    return si.fit_friction(log).part()


def nonsense() -> None:
    outcomes: Counter[str] = Counter()
    cases = [("valve_discrete_a", "pressure_a_pa", PRESSURES)]
    cases += [("valve_pwm_a", "pressure_a_pa", PRESSURES)]
    cases += [(f"friction_{n}", "motor_torque_nm", EFFORTS) for n in ("sliding", "motion")]
    for name, column, changes in cases:
        frame = pd.read_parquet(BUNDLED / f"{name}.parquet")
        for what, change in changes.items():
            groups = frame.groupby("test", sort=False)[column]
            values = np.concatenate([change(g.to_numpy()) for _, g in groups])
            outcome = judged(name, frame.assign(**{column: values}))
            outcomes[outcome.partition(":")[0]] += 1
            print(f"  {name}, {column} {what}: {outcome[:110]}")
    print(f"nonsense: {dict(outcomes)}")


def judged(name: str, frame: pd.DataFrame) -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.parquet"
        frame.to_parquet(path)
        try:
            parts = fit(name.removesuffix("_a"), path)
        except SysidError as error:
            return f"refused: {str(error).replace(folder, '')}"
    held = (qualities_in(parts.friction), qualities_in(parts.valves))
    said = [one.verdict for found in held for _, one in found]
    return max(said, key=lambda v: ("good", "usable", "poor", "impossible").index(v.split(":")[0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=12)
    parser.add_argument("--seed", type=int, default=92000)
    parser.add_argument("--surface", default="bipolynomial", help="as of sysid fit valve-pwm")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    nonsense()
    for fits in (given(chosen.surface), generated(chosen.campaigns, chosen.seed, chosen.surface)):
        healthy(fits)


if __name__ == "__main__":
    main()
