"""The fleet figure: what changed on which rig, and from which date on; serial and in processes.

Six rigs are tested on ten dates. On two of them a seal wears: from one date on Coulomb and static
friction grow by a tenth of their first value a date. On one a chamber leaks from one date on. On
the others nothing changes but what is drawn anew each time: the friction of each trial (2 %) and,
on top, that of each date (1 %), and the sensors' noise.

    python -m benchmarks.fleet make -o DIR [--seeds 31001]    # 60 campaigns
    sysid fleet DIR/rigs/*/*/campaign.toml -o DIR/fleet --no-refine --budget 600
    python -m benchmarks.fleet judge DIR                      # what was found where, to JSON
    python -m benchmarks.fleet compare DIR [--count 6]        # serial, joblib, Dask: bits and time

Rigs of seeds 30001 to 30006 were used during development, 31001 to 31006 for the figure.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
from pathlib import Path

from datasets.generator.campaign import Size, drawn_effects, make_campaign, stream
from datasets.generator.effects import Injected
from datasets.generator.files import Dialect, write_campaign
from datasets.generator.rigs import GeneratedRig, random_rig

DATES = tuple(datetime.date(2021, 1, 15) + datetime.timedelta(days=61 * i) for i in range(10))
KINDS = (
    *("friction-static", "friction-sliding", "valve-discrete"),
    "motion-pwm",
)
SMALL = Size(2, 0, 2, 0.10, (1, 1), (1, 1), (1, 1), slidings=8)
# By the rig's place in the fleet: the first date (from 0) on which it is worn or leaks.
WORN_FROM = {0: 4, 3: 6}
LEAKS_FROM = {1: 5}
WEAR_PER_DATE = 0.10
DATE_SCATTER = 0.01


def rig_on(seed: int, place: int, date: int) -> tuple[GeneratedRig, tuple[Injected, ...]]:
    """The rig of a seed as it is on a date, and its undeclared effects."""
    rig = random_rig(stream(seed, "rig"), "horizontal", "rotary")
    content = {**rig.content, "rig": {**rig.content["rig"], "name": f"rig-{seed}"}}
    wear = max(date - WORN_FROM.get(place, len(DATES)) + 1, 0) * WEAR_PER_DATE
    drawn = stream(seed, "effects", 100 + date).normal()
    factor = (1.0 + wear) * (1.0 + DATE_SCATTER * drawn)
    truth = dataclasses.replace(
        rig.truth,
        static_friction=rig.truth.static_friction * factor,
        coulomb_friction=rig.truth.coulomb_friction * factor,
    )
    leaks = date >= LEAKS_FROM.get(place, len(DATES))
    leak = drawn_effects(seed, [("atmosphere-leakage", "quadratic", 1.0)]) if leaks else ()
    return dataclasses.replace(rig, content=content, truth=truth), leak


def make(folder: Path, first_seed: int, rigs: int, dates: int) -> None:
    """Write the campaigns, `folder/rigs/NAME/DATE/campaign.toml`."""
    for place in range(rigs):
        seed = first_seed + place
        for date in range(dates):
            rig, effects = rig_on(seed, place, date)
            campaign = make_campaign(
                1000 * seed + date, size=SMALL, rig=rig, kinds=KINDS, effects=effects
            )
            where = folder / "rigs" / f"rig-{seed}" / DATES[date].isoformat()
            write_campaign(where, campaign, "python -m benchmarks.fleet", Dialect(parquet=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make")
    making.add_argument("-o", "--output", type=Path, required=True)
    making.add_argument("--seeds", type=int, default=31001, help="the first rig's")
    making.add_argument("--rigs", type=int, default=6)
    making.add_argument("--dates", type=int, default=10)
    given = parser.parse_args()
    if given.command == "make":
        make(given.output, given.seeds, given.rigs, given.dates)


if __name__ == "__main__":
    main()
