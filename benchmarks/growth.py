"""`sysid run` on many times the bundled campaign's data: time and memory against the original.

    python benchmarks/growth.py [--times 20]
    python benchmarks/growth.py --campaigns 100

Every test of every log is repeated under a label of its own, with fresh sensor noise of
the size of one count, so that no two are alike. Whole processes, one after the other, from
a filled compilation cache; peak memory is the process tree's largest resident set.

With --campaigns, one process fits, refines and diagnoses (`quick`) so many small campaigns of
different rigs, each with another effect: its memory at the end, garbage given back, over that after
the tenth.
"""

from __future__ import annotations

import argparse
import gc
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

import sysid as si  # noqa: E402
from benchmarks.fleet import KINDS, SMALL  # noqa: E402
from benchmarks.history import record  # noqa: E402
from datasets.generator.campaign import drawn_effects, make_campaign  # noqa: E402
from datasets.generator.effects import FORMS  # noqa: E402
from datasets.generator.files import write_campaign  # noqa: E402
from sysid.parallel import give_back  # noqa: E402

BUNDLED = REPOSITORY / "datasets" / "bundled"
SEED = 33001
_NOISE = {"pressure_a_pa": 50.0, "pressure_b_pa": 50.0}


def repeated(source: Path, target: Path, times: int) -> int:
    """Write a campaign whose logs hold each test `times` times; returns the rows."""
    rng = np.random.default_rng(0)
    rows = 0
    shutil.copytree(source, target)
    for log in [*target.glob("*.csv"), *target.glob("*.parquet")]:
        table = pd.read_parquet(log) if log.suffix == ".parquet" else pd.read_csv(log, comment="#")
        copies = []
        for i in range(times):
            copy = table.copy()
            label = copy["test"].astype(str) if "test" in copy else pd.Series("1", copy.index)
            copy["test"] = label + f"-{i}"
            for name, size in _NOISE.items():
                if name in copy:
                    copy[name] += size * rng.standard_normal(len(copy))
            copies.append(copy)
        whole = pd.concat(copies, ignore_index=True)
        rows += len(whole)
        if log.suffix == ".parquet":
            whole.to_parquet(log)
        else:
            whole.to_csv(log, index=False)
    return rows


def measured(campaign: Path, results: Path) -> tuple[float, float]:
    """Seconds and peak memory (GB) of one `sysid run`."""
    command = [sys.executable, "-m", "sysid", "run", str(campaign), "-o", str(results)]
    start = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        _, status, usage = os.wait4(run.pid, 0)
        run.returncode = os.waitstatus_to_exitcode(status)
    if run.returncode != 0:
        raise SystemExit(f"sysid run ended with {run.returncode}")
    return time.perf_counter() - start, usage.ru_maxrss / 1e6


def held() -> float:
    """This process' resident set, GB, without what it has freed."""
    gc.collect()
    give_back()
    pages = int(Path("/proc/self/statm").read_text("utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e9


def one_after_the_other(count: int) -> None:
    """So many campaigns in this process."""
    names = sorted(FORMS)
    after: list[float] = []
    for number in range(count):
        name = names[number % len(names)]
        with tempfile.TemporaryDirectory() as folder:
            try:
                effects = drawn_effects(SEED + number, [(name, FORMS[name][0], 1.0)])
                made = make_campaign(SEED + number, size=SMALL, kinds=KINDS, effects=effects)
            except ValueError as error:
                print(f"{name}: {error}")
                made = make_campaign(SEED + number, size=SMALL, kinds=KINDS)
            write_campaign(Path(folder), made, "python benchmarks/growth.py")
            _all_of(si.read_campaign(Path(folder) / "campaign.toml"))
        after.append(held())
        print(f"{number + 1}: {name}, {after[-1]:.3f} GB", flush=True)
    ratio = after[-1] / after[min(count, 10) - 1]
    record(f"growth, {count} campaigns in a process over ten, memory", ratio, "-")
    print(f"{ratio:.2f} times")


def _all_of(campaign: si.Campaign) -> None:
    try:
        bundle = si.fit(campaign)
        si.refine(campaign, bundle)
        si.diagnose(campaign, bundle, quick=True)
    except si.SysidError as error:
        print(error)


def main() -> None:
    """Run both and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--campaigns", type=int)
    given = parser.parse_args()
    if given.campaigns:
        one_after_the_other(given.campaigns)
        return
    times = given.times
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        found = {}
        for count in (1, times):
            rows = repeated(BUNDLED, place / f"data-{count}", count)
            results = place / f"results-{count}"
            found[count] = measured(place / f"data-{count}" / "campaign.toml", results)
            seconds, memory = found[count]
            print(f"{count} times: {rows} rows, {seconds:.1f} s, {memory:.2f} GB", flush=True)
            record(f"growth, {count} times the bundled campaign", seconds, "s")
            record(f"growth, {count} times the bundled campaign, memory", memory, "GB")
    ratios = [b / a for a, b in zip(found[1], found[times], strict=True)]
    print(f"time {ratios[0]:.1f} times, memory {ratios[1]:.2f} times")


if __name__ == "__main__":
    main()
