"""A history of figures, so that a slowdown shows: one JSON line for each time one was measured.

    python benchmarks/history.py [FIGURE]      # each figure: last value, median of the ones before

Benchmarks call `record`; the lines go into `benchmarks/history.jsonl`, which is committed with the
change that they were measured for. `load` is the load average a core at that moment: times that
were measured on a busy machine say little.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import resource
import statistics
import subprocess
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent
HISTORY = REPOSITORY / "benchmarks" / "history.jsonl"
# A value beyond this many times the median of the earlier ones is marked.
MARKED = 1.25


def record(figure: str, value: float, unit: str, path: Path = HISTORY) -> None:
    """Append a figure with the date, the commit (+ where files differ from it) and the load."""
    line = {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "figure": figure,
        "value": float(f"{value:.4g}"),
        "unit": unit,
        "load": round(os.getloadavg()[0] / (os.cpu_count() or 1), 2),
    }
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line) + "\n")


def commit() -> str:
    """The commit that is checked out, with a + where files differ from it; empty without git."""

    def git(*words: str) -> str:
        command = ["git", "-C", str(REPOSITORY), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no", "--", "sysid")
        return git("rev-parse", "--short", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


def processor_seconds(
    command: Sequence[str], folder: Path | None = None, environment: Mapping[str, str] | None = None
) -> float:
    """Processor time of one whole process and those it waits for, s; it works in a folder (None:
    this one). RuntimeError with its last words where it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr[-500:]}")
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def in_turn(
    name: str, ours: Sequence[str], theirs: Sequence[str], folder: Path | None, runs: int
) -> float:
    """Two processes in turn: both medians of processor time, and the median of the ratio of pairs.

    Ours and the ratio are recorded under `name`; the ratio is returned.
    """
    processor_seconds(ours, folder), processor_seconds(theirs, folder)
    pairs = [
        (processor_seconds(ours, folder), processor_seconds(theirs, folder)) for _ in range(runs)
    ]
    mine, other = (statistics.median(pair[i] for pair in pairs) for i in (0, 1))
    ratio = statistics.median(a / b for a, b in pairs)
    print(f"{name}: {mine:.2f} s against {other:.2f} s of processor time, ratio {ratio:.2f}")
    record(f"{name}, processor", mine, "s")
    record(f"{name}, ratio", ratio, "-")
    return ratio


def read(path: Path = HISTORY) -> dict[str, list[dict[str, Any]]]:
    """The lines by figure, oldest first."""
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for line in path.read_text("utf-8").splitlines() if path.is_file() else []:
        entry = json.loads(line)
        found[entry["figure"]].append(entry)
    return dict(found)


def shown(figure: str, entries: list[dict[str, Any]]) -> str:
    """A figure in one line."""
    last, before = entries[-1], [entry["value"] for entry in entries[:-1]]
    text = f"{figure}: {last['value']:g} {last['unit']} ({last['date'][:10]}, {last['commit']}"
    if not before:
        return f"{text}, the first)"
    median = statistics.median(before)
    mark = "  <-- more than before" if last["value"] > MARKED * median else ""
    return f"{text}; median of {len(before)} before: {median:g}){mark}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("figure", nargs="?", default="", help="part of the figure's name")
    wanted = parser.parse_args().figure
    for figure, entries in sorted(read().items()):
        if wanted in figure:
            print(shown(figure, entries))


if __name__ == "__main__":
    main()
