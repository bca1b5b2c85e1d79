"""The figures of speed that every release records: each by the benchmark that has it.

    python benchmarks/release.py [PART ...]      # all of them by default

`demo`: `sysid demo` with an empty cache of compiled programs and with the one that it leaves, and
how many programs that is. `cores`: a diagnosis by one job and by all cores. The others run
`startup.py` (`imports`), `growth.py` (`memory`), `valve_pwm.py` (`pwm`) and `simulation.py`, which
record theirs.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.history import processor_seconds, record  # noqa: E402

BUNDLED = REPOSITORY / "datasets" / "bundled"
SYSID = [sys.executable, "-m", "sysid"]
RUNS = 5


def demo() -> None:
    """Processor time of the demo, cold over warm, and its programs; wall time of a warm one."""
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "XDG_CACHE_HOME": str(cache)}
        environment.pop("JAX_COMPILATION_CACHE_DIR", None)

        def run(name: str) -> tuple[float, float]:
            started = time.perf_counter()
            spent = processor_seconds(
                [*SYSID, "demo", "-o", str(Path(folder) / name)], environment=environment
            )
            return spent, time.perf_counter() - started

        cold, _ = run("cold")
        compiled = len(list(cache.rglob("*-cache")))
        warm = [run(f"warm {i}") for i in range(RUNS)]
    spent, wall = (statistics.median(column) for column in zip(*warm, strict=True))
    print(f"demo: {cold:.1f} s cold, {spent:.1f} s warm, {wall:.1f} s of wall, {compiled} programs")
    record("demo, cold over warm, processor", cold / spent, "-")
    record("demo, programs compiled", compiled, "programs")
    record("demo, warm, wall", wall, "s")


def cores() -> None:
    """Wall time of a diagnosis by one job over that by all cores."""
    count = len(os.sched_getaffinity(0))
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    with tempfile.TemporaryDirectory() as folder:

        def wall(*words: str) -> float:
            started = time.perf_counter()
            processor_seconds([*SYSID, *words], Path(folder), environment)
            return time.perf_counter() - started

        campaign = str(BUNDLED / "campaign.toml")
        wall("fit", campaign, "-o", "bundle.json")
        times: dict[int, list[float]] = {1: [], count: []}
        for turn in range(RUNS + 1):
            for jobs in times:
                words = (
                    "diagnose",
                    campaign,
                    "--bundle",
                    "bundle.json",
                    "-o",
                    f"{turn} {jobs}.json",
                )
                spent = wall(*words, "--jobs", str(jobs))
                times[jobs] += [spent] if turn else []  # the first compiles
    ratio = statistics.median(times[1]) / statistics.median(times[count])
    print(f"diagnose: {ratio:.2f} times as quick on {count} cores as on one")
    record(f"diagnose, {count} cores over 1", ratio, "-")


def of(*words: str) -> Callable[[], None]:
    """Another benchmark, as a process of its own."""

    def run() -> None:
        subprocess.run([sys.executable, *words], check=True, cwd=REPOSITORY)

    return run


PARTS: dict[str, list[Callable[[], None]]] = {
    "demo": [demo],
    "cores": [cores],
    "imports": [of("benchmarks/startup.py")],
    "memory": [of("benchmarks/growth.py", "--campaigns", "100")],
    "pwm": [of("benchmarks/valve_pwm.py", "speed")],
    "simulation": [of("benchmarks/simulation.py", part) for part in ("speed", "cores")],
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("parts", nargs="*", metavar="PART", help=" ".join(PARTS))
    asked = parser.parse_args().parts
    if unknown := set(asked) - set(PARTS):
        parser.error(f"{', '.join(sorted(unknown))}: is none of {', '.join(PARTS)}")
    for part in asked or PARTS:
        for measure in PARTS[part]:
            measure()


if __name__ == "__main__":
    main()
