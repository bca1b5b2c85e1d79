"""The fleet figure: what changed on which rig, and from which date on; serial and in processes.

Six rigs are tested on ten dates. On two of them a seal wears: from one date on Coulomb and static
friction grow by a tenth of their first value a date. On one a chamber leaks from one date on. On
the others nothing changes but what is drawn anew each time: the friction of each trial (2 %) and,
on top, that of each date (1 %), and the sensors' noise.

    python -m benchmarks.fleet make -o DIR [--seeds 31001]    # 60 campaigns
    sysid fleet DIR/rigs/*/*/campaign.toml -o DIR/fleet --no-refine --budget 600
    python -m benchmarks.fleet fits DIR               # the bench tests' fits alone, where not run
    python -m benchmarks.fleet judge DIR              # what was found on which rig, and since when
    python -m benchmarks.fleet compare DIR [--count 6]  # joblib, Dask, a killed worker: bits, time

Rigs of seeds 30001 to 30006 were used during development, 31001 to 31006 for the figure.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import sysid as si
from benchmarks.history import record
from datasets.generator.campaign import Size, drawn_effects, make_campaign, stream
from datasets.generator.effects import Injected
from datasets.generator.files import Dialect, write_campaign
from datasets.generator.rigs import GeneratedRig, random_rig
from sysid.fleet.origin import origin_of, result_folder
from sysid.fleet.rows import ROW_FILE, FleetRow, effects_of, readings_of
from sysid.fleet.trends import Fleet, fleet_of

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


# --- what was found ------------------------------------------------------------------------


def campaigns_in(folder: Path) -> list[Path]:
    """The campaign files that `make` wrote."""
    return sorted((folder / "rigs").glob("*/*/campaign.toml"))


def fit_all(folder: Path) -> None:
    """Fit the campaigns that have not gone through `sysid fleet`: what its stage `fit` does."""
    (folder / "fits").mkdir(exist_ok=True)
    for path in campaigns_in(folder):
        name = result_folder(path)
        if not any(p.is_file() for p in fitted_files(folder, name)):
            si.write_bundle(si.fit(si.read_campaign(path)), folder / "fits" / f"{name}.json")
            print(name, flush=True)


def fitted_files(folder: Path, name: str) -> tuple[Path, Path]:
    """Where a campaign's fit may be: by `sysid fleet`, by `fit_all`."""
    return folder / "fleet" / name / "fitted.json", folder / "fits" / f"{name}.json"


def fleet_in(folder: Path) -> Fleet:
    """The fleet of those campaigns that are fitted; diagnosed are those that went through `run`."""
    rows = []
    for path in campaigns_in(folder):
        name = result_folder(path)
        done = next((p for p in fitted_files(folder, name) if p.is_file()), None)
        if done is None:
            continue
        fitted, row = si.read_bundle(done), done.with_name(ROW_FILE)
        final = si.read_bundle(done.with_name("bundle.json")) if row.is_file() else fitted
        said = json.loads(row.read_text("utf-8")) if row.is_file() else {}
        rows.append(
            FleetRow(
                campaign=str(path),
                folder=name,
                origin=origin_of(si.read_campaign(path)),
                verdict=said.get("verdict"),
                is_whole=said.get("is_whole", True),
                effects=effects_of(final),
                readings=readings_of(fitted, final),
            )
        )
    return fleet_of(rows)


def judge(folder: Path, first_seed: int) -> None:
    """Print what changed on each rig next to what was changed, and the count of each outcome.

    Found: the number's family, from the date of the change or the next one; a leak also by its
    sign in the valve tests. Beside it: another family of that rig from the same date, which the
    change explains. All else is false.
    """
    fleet = fleet_in(folder)
    diagnosed = sum(row.verdict is not None for row in fleet.rows)
    print(f"{diagnosed} of them diagnosed; {fleet.headline()}")
    found = beside = false = expected = 0
    for place in range(6):
        rig = f"rig-{first_seed + place}"
        dates = sorted({str(r.origin.date) for r in fleet.rows if r.origin and r.origin.rig == rig})
        if not dates:
            continue
        truth = {"friction": WORN_FROM.get(place), "leakage": LEAKS_FROM.get(place)}
        wanted = {
            f: since for f, since in truth.items() if since is not None and since < len(dates)
        }
        near = {DATES[n + late].isoformat() for n in wanted.values() for late in (0, 1)}
        changed = {(t.family, t.since) for t in fleet.changes if t.rig == rig}
        changed |= {("leakage", sign.since) for sign in fleet.leaks if sign.rig == rig}
        hits = [f for f in wanted if any(g == f and since in near for g, since in changed)]
        others = [(f, since) for f, since in changed if f not in wanted]
        expected, found = expected + len(wanted), found + len(hits)
        beside += sum(since in near for _, since in others)
        false += sum(since not in near for _, since in others)
        early = [one for one in changed if one[0] in wanted and one[1] not in near]
        false += len(early)
        said = {f: DATES[n].isoformat() for f, n in wanted.items()} or "nothing"
        print(f"{rig}, {len(dates)} dates: true {said}; found {sorted(changed) or 'nothing'}")
        for trend in (t for t in fleet.changes if t.rig == rig):
            print(f"    {trend.sentence()}")
    tested = [t for t in fleet.trends if t.change]
    print(
        f"{found} of {expected} found in time, {beside} beside, {false} false; {len(tested)} trends"
    )


# --- serial, joblib, Dask ------------------------------------------------------------------


def compare(folder: Path, count: int) -> None:
    """The same campaigns by two processes of joblib, two Dask workers, and with one killed.

    Compared with what `folder/fleet` holds, which one process made; to the last bit, but for the
    time of day at which a bundle was made.
    """
    from distributed import LocalCluster

    done = sorted((folder / "fleet").glob(f"*/{ROW_FILE}"))[:count]
    campaigns = [json.loads(path.read_text("utf-8"))["campaign"] for path in done]
    stages = [json.loads((path.parent / "run.json").read_text("utf-8")) for path in done]
    serial = sum(stage["seconds"] for run in stages for stage in run.values())
    print(f"{len(campaigns)} campaigns, serial: {serial:.0f} s, load {os.getloadavg()[0]:.1f}")
    own = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    joblib_s = timed(run_fleet(campaigns, folder / "joblib", ["--jobs", "2"]))
    report(folder, "joblib", campaigns, joblib_s)
    with LocalCluster(**own) as cluster:
        words = ["--scheduler", cluster.scheduler_address]
        dask_s = timed(run_fleet(campaigns, folder / "dask", words))
        report(folder, "dask", campaigns, dask_s)
        under_way = run_fleet(campaigns[:2], folder / "killed", words)
        time.sleep(0.5 * dask_s / max(len(campaigns) / 2, 1))
        os.kill(cluster.workers[0].pid, signal.SIGKILL)
        print("a worker was killed")
        report(folder, "killed", campaigns[:2], timed(under_way))
    record(f"fleet of {len(campaigns)}, joblib, 2 processes", joblib_s, "s")
    record(f"fleet of {len(campaigns)}, Dask, 2 workers", dask_s, "s")


def run_fleet(campaigns: Sequence[str], out: Path, words: Sequence[str]) -> subprocess.Popen[bytes]:
    """`sysid fleet` anew, in a process of its own."""
    shutil.rmtree(out, ignore_errors=True)
    options = ["--no-refine", "-o", str(out), *words]
    return subprocess.Popen(
        [sys.executable, "-m", "sysid", "fleet", *campaigns, *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def timed(process: subprocess.Popen[bytes]) -> float:
    """Seconds until a process that was just started has ended; it has to end well."""
    start = time.perf_counter()
    if process.wait():
        raise SystemExit(f"sysid fleet ended with {process.returncode}")
    return time.perf_counter() - start


def report(folder: Path, name: str, campaigns: Sequence[str], seconds: float) -> None:
    """Print the time, and how many results are the serial ones to the last bit."""
    names = [result_folder(Path(path)) for path in campaigns]
    same = sum(results(folder / "fleet" / n) == results(folder / name / n) for n in names)
    load = os.getloadavg()[0]
    print(f"{name}: {seconds:.0f} s, load {load:.1f}; the same: {same} of {len(names)}", flush=True)


def results(folder: Path) -> dict[str, Any]:
    """Bundle, diagnosis and row of a campaign, without the moment at which they were made.

    Without the notices of the run, too: one that resumed another has only some of them.
    """
    names = ("fitted.json", "bundle.json", "diagnosis.json", ROW_FILE)
    found = {name: json.loads((folder / name).read_text("utf-8")) for name in names}
    for name in names[:2]:
        del found[name]["created"]
    del found[ROW_FILE]["notices"]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make")
    making.add_argument("-o", "--output", dest="folder", type=Path, required=True)
    making.add_argument("--rigs", type=int, default=6)
    making.add_argument("--dates", type=int, default=10)
    fitting = commands.add_parser("fits")
    judging = commands.add_parser("judge")
    comparing = commands.add_parser("compare")
    comparing.add_argument("--count", type=int, default=6)
    for one in (fitting, judging, comparing):
        one.add_argument("folder", type=Path)
    for one in (making, judging):
        one.add_argument("--seeds", type=int, default=31001, help="the first rig's")
    given = parser.parse_args()
    if given.command == "make":
        make(given.folder, given.seeds, given.rigs, given.dates)
    elif given.command == "fits":
        fit_all(given.folder)
    elif given.command == "judge":
        judge(given.folder, given.seeds)
    else:
        compare(given.folder, given.count)


if __name__ == "__main__":
    main()
