"""Commands of the workbench cancelled, and its server killed, at random moments; and the files
that it writes next to those of the command line.

    python benchmarks/app_interruption.py [--count 50] [--seed 0] [--quick]

A small campaign (an axis, `benchmarks.interruption`) is run by the workbench: so many times
*Cancel* is pressed, so many times the server is killed (SIGKILL), at a moment drawn evenly over the
run's own processor time, on which the machine's other work does not bear. After it every file must
be complete, no process may be alive 10 s later, and no temporary file may outlast the next call.
Before, one run by the workbench and one by the command line have to give the same files, but for
times and paths. `--quick`: without diagnosis and refinement, which write one file each.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import random
import re
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.interruption import (
    _MARK,
    Found,
    alive,
    check,
    doing,
    last_line,
    outlived,
    write_axis,
)
from sysid.app.jobs import Job

_WORDS = ("run", "campaign.toml", "-o", "results", "--jobs", "1")
_QUICK = ("--no-diagnose", "--no-refine")
_TICKS_S = os.sysconf("SC_CLK_TCK")
# A server with a command at work, as a window starts it.
_SERVER = """\
import sys
from pathlib import Path
from sysid.app.server import serve
from sysid.app.workbench import Workbench
folder = Path(sys.argv[1])
bench = Workbench(folder, folder / "campaign.toml", folder / "results")
bench.start("running", sys.argv[2:], {})
serve(lambda: bench, 0, lambda address: print(address, flush=True), opens_browser=False)
"""
# What may differ between two runs of the same: when, how long, where; and with the time in a bundle
# its SHA-256, which the exports name.
_TIMES = ("created", "seconds", "written")
_MOMENT = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(\+00:00| UTC)?")


def without_times(content: Any) -> Any:
    """JSON without the moments and durations in it."""
    if isinstance(content, dict):
        return {k: without_times(v) for k, v in content.items() if k not in _TIMES}
    if isinstance(content, list):
        return [without_times(v) for v in content]
    return _MOMENT.sub("", content) if isinstance(content, str) else content


def comparable(path: Path, folder: Path) -> str:
    """A result file's content without times and its folder; a MATLAB file's numbers."""
    bundle = hashlib.sha256((folder / "results" / "bundle.json").read_bytes()).hexdigest()
    if path.suffix == ".json":
        content = json.loads(path.read_text().replace(str(folder), "").replace(bundle, ""))
        if path.name == "run.json":  # digests of files that hold times
            content = {stage: sorted(record["outputs"]) for stage, record in content.items()}
        return json.dumps(without_times(content), sort_keys=True)
    if path.suffix == ".mat":
        from scipy.io import loadmat

        found = loadmat(path)
        shown = repr(sorted((k, repr(v)) for k, v in found.items() if not k.startswith("__")))
        return _MOMENT.sub("", shown.replace(bundle, ""))
    text = path.read_text("utf-8", "replace").replace(str(folder), "")
    return _MOMENT.sub("", text.replace(bundle, ""))


def differences(one: Path, other: Path) -> list[str]:
    """Files of two folders' results that differ, or that one of them lacks."""
    names = {
        str(p.relative_to(folder / "results"))
        for folder in (one, other)
        for p in (folder / "results").rglob("*")
        if p.is_file()
    }
    found = []
    for name in sorted(names):
        paths = [folder / "results" / name for folder in (one, other)]
        if not all(p.is_file() for p in paths):
            found.append(f"{name} is missing in one")
        elif len({comparable(p, f) for p, f in zip(paths, (one, other), strict=True)}) > 1:
            found.append(name)
    return found


def run_by_job(folder: Path, words: Sequence[str]) -> Job:
    """The campaign run as a window of the workbench does."""
    job = Job("running", tuple(words), folder, {})
    job.start()
    return job


def spent(process: int) -> float:
    """Processor time (s) of a process and of its children that have ended; inf once it has."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return math.inf
    return math.inf if fields[0] == "Z" else sum(map(int, fields[11:15])) / _TICKS_S


def wait_for(process: int, after_s: float) -> None:
    """Until a process has spent so much processor time, or has ended."""
    while spent(process) < after_s:
        time.sleep(0.02)


def wait(job: Job) -> None:
    """Until the command has ended."""
    while not job.is_done:
        time.sleep(0.05)


def cancel_once(folder: Path, words: Sequence[str], after_s: float, found: Found) -> bool:
    """One run cancelled after so much work; False where it had already ended."""
    mark = secrets.token_hex(8)
    os.environ[_MARK] = mark
    job = run_by_job(folder, words)
    wait_for(job._process.pid, after_s)
    was_done = job.is_done
    job.cancel()
    del os.environ[_MARK]
    found.outlived += len(outlived(mark))
    if was_done:
        found.finished_first += 1
        return False
    found.stages[doing(job.lines)] += 1
    return True


def kill_once(folder: Path, words: Sequence[str], after_s: float, found: Found) -> bool:
    """A server killed once the run that it began has done so much work; False as before."""
    mark = secrets.token_hex(8)
    command = [sys.executable, "-c", _SERVER, str(folder), *words]
    environment = {**os.environ, _MARK: mark}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment) as server:
        # The first process that the server starts; it may not listen yet.
        while not (runs := [pid for pid in alive(mark) if pid != server.pid]):
            time.sleep(0.05)
        wait_for(runs[0], after_s)
        was_done = spent(runs[0]) == math.inf
        server.send_signal(signal.SIGKILL)
    found.outlived += len(outlived(mark))
    found.finished_first += was_done
    found.stages["server killed"] += not was_done
    return not was_done


def main() -> None:
    """Compare, interrupt, check, and finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a run without its longest stages")
    options = parser.parse_args()
    words = (*_WORDS, *(_QUICK if options.quick else ()))
    draw, found = random.Random(options.seed), Found()
    with tempfile.TemporaryDirectory() as folder:
        own, other = Path(folder) / "app", Path(folder) / "line"
        for place in (own, other):
            place.mkdir()
            write_axis(place)
        begin = sum(os.times()[2:4])
        job = run_by_job(own, words)
        wait(job)
        length = sum(os.times()[2:4]) - begin
        assert job.code == 0, job.lines
        command = [sys.executable, "-m", "sysid", *words]
        subprocess.run(command, cwd=other, check=True, capture_output=True)
        apart = differences(own, other)
        print(f"files that differ between workbench and command line: {apart}", flush=True)
        results = own / "results"
        whole = [p for p in results.rglob("*") if p.is_file()]
        endings = {str(p.relative_to(results)): last_line(p) for p in whole}
        for once in (cancel_once, kill_once):
            done = 0
            while done < options.count:
                if draw.random() < 0.5:
                    shutil.rmtree(results, ignore_errors=True)
                done += once(own, words, draw.uniform(0.0, length), found)
                check(results, endings, found)
                if done % 10 == 0:
                    print(f"{once.__name__}: {done} over {length:.1f} s: {found}", flush=True)
        subprocess.run(command, cwd=own, check=True, capture_output=True)
        left = sum(p.name.startswith(".sysid-") for p in results.rglob("*"))
    print(
        f"half-written files: {len(found.broken)} {sorted(set(found.broken))}; processes alive "
        f"after 10 s: {found.outlived}; temporary files after an interruption: {found.temporary}, "
        f"after the next call: {left}"
    )


if __name__ == "__main__":
    main()
