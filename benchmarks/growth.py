"""`sysid run` on many times the bundled campaign's data: time and memory against the original.

    python benchmarks/growth.py [--times 20]

Every test of every log is repeated under a label of its own, with fresh sensor noise of
the size of one count, so that no two are alike. Whole processes, one after the other, from
a filled compilation cache; peak memory is the process tree's largest resident set.
"""

from __future__ import annotations

import argparse
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

from benchmarks.history import record  # noqa: E402

BUNDLED = REPOSITORY / "datasets" / "bundled"
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


def main() -> None:
    """Run both and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=20)
    times = parser.parse_args().times
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
