"""Whether a diagnosis finds the same on a busy machine: the bundled campaign alone, and in a crowd.

    python benchmarks/busy.py [--processes 8] [--jobs 2]

Fits the bundled campaign once and diagnoses it twice, the second time beside so many processes that
only compute. Prints of both the verdict, the effects with their numbers, the errors after, the
counted evaluations and the times (s), and whether what was printed is the same to the last byte.
Beside eight processes it takes about five times as long as alone.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent
CAMPAIGN = REPOSITORY / "datasets" / "bundled" / "campaign.toml"


def sysid(*words: str) -> str:
    """What a command prints."""
    own = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, "-m", "sysid", *words]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=own).stdout


@contextmanager
def crowd(processes: int) -> Iterator[None]:
    """So many processes that compute within the block."""
    endless = [sys.executable, "-c", "while True: pass"]
    started = [subprocess.Popen(endless) for _ in range(processes)]
    try:
        yield
    finally:
        for one in started:
            one.kill()
            one.wait()


def show(name: str, found: dict[str, Any], wall: float) -> None:
    """A diagnosis in a few lines."""
    print(f"{name}: {found['verdict']}, {found['evaluations']} evaluations, {wall:.0f} s")
    for effect in found["effects"]:
        numbers = {k: v for k, v in effect["parameters"].items() if isinstance(v, dict)}
        values = ", ".join(f"{k} {v['value']:.5g} +- {v['std']:.2g}" for k, v in numbers.items())
        print(f"  {effect['id']}: {values}")
    for channel, error in found["residual"].items():
        print(f"  {channel}: {error['after']:.6g}, a correct model {error['noise_floor']:.6g}")
    for one in found["not_done"]:
        print(f"  not done: {one}")


def main() -> None:
    """Both diagnoses, and what differs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--processes", type=int, default=8)
    parser.add_argument("--jobs", default="2")
    given = parser.parse_args()
    printed = []
    with tempfile.TemporaryDirectory() as folder:
        bundle = str(Path(folder) / "bundle.json")
        sysid("fit", str(CAMPAIGN), "-o", bundle, "--jobs", given.jobs)
        for processes in (0, given.processes):
            with crowd(processes):
                start = time.perf_counter()
                words = ("--bundle", bundle, "--json", "--jobs", given.jobs)
                printed.append(sysid("diagnose", str(CAMPAIGN), *words))
                wall = time.perf_counter() - start
            name = f"beside {processes} processes" if processes else "alone"
            show(name, json.loads(printed[-1]), wall)
    print(f"the same to the last byte: {printed[0] == printed[1]}")


if __name__ == "__main__":
    main()
