"""`sysid run` killed at random moments: no half-written file, no process left, and it resumes.

    python benchmarks/interruption.py [--count 200] [--seed 0] [--jobs 2] [--demo]

Each kill is a SIGKILL of `sysid run --jobs 2` at a moment drawn evenly over the run's own length:
checks, fit, diagnosis, validation, report and exports of a small campaign (an axis), or with
`--demo` of the bundled one. After it every file must be complete (JSON parses, everything else
ends as in an undisturbed run), no temporary file may outlast the next call, and 10 s later no
process of the run may be alive (each carries a mark in its environment). At the end one more call
must finish.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import random
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

_MARK = "SYSID_KILLED_RUN"
_PATIENCE_S = 10.0
_RIG = '[rig]\nname = "axis"\nmotion = "linear"\norientation = "horizontal"\n'


def write_axis(folder: Path) -> Path:
    """A campaign of four logs of an axis whose viscous friction differs by direction."""
    folder.joinpath("rig.toml").write_text(_RIG)
    text = 'rig = "rig.toml"\n'
    for seed in range(4):
        rng = np.random.default_rng(seed)
        time_s = np.arange(0.0, 4.0, 0.01)
        tones = [(w, rng.uniform(0.0, 6.3)) for w in (1.7, 4.1, 9.3)]
        position = sum(0.08 / w * np.sin(w * time_s + p) for w, p in tones)
        speed = sum(0.08 * np.cos(w * time_s + p) for w, p in tones)
        rate = sum(-0.08 * w * np.sin(w * time_s + p) for w, p in tones)
        friction = 8.0 * np.tanh(speed / 1e-3) + 150.0 * speed - 40.0 * np.abs(speed)
        force = 20.0 * rate + friction + 0.5 * rng.standard_normal(len(time_s))
        log = {"time_s": time_s, "position_m": position, "motor_force_n": force}
        pd.DataFrame(log).to_csv(folder / f"{seed}.csv", index=False)
        use = "holdout" if seed == 3 else "fit"
        text += f'\n[[log]]\nkind = "friction-motion"\nfile = "{seed}.csv"\nuse = "{use}"\n'
    folder.joinpath("campaign.toml").write_text(text)
    return folder / "campaign.toml"


def last_line(path: Path) -> bytes:
    """How a text file ends; of a binary one only that it holds something."""
    data = path.read_bytes()
    return data[-1:] and b"binary" if path.suffix == ".mat" else data[-20:]


def is_whole(path: Path, ending: bytes | None) -> bool:
    """Whether a result file is complete; `ending` is that of an undisturbed run's."""
    if path.suffix == ".json":
        try:
            json.loads(path.read_text())
        except ValueError:
            return False
        return True
    return last_line(path) == ending if ending is not None else bool(path.stat().st_size)


def alive(mark: str) -> list[int]:
    """Processes whose environment holds this mark."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"{_MARK}={mark}\0".encode() in entry.read_bytes() + b"\0":
                state = entry.with_name("stat").read_text().rpartition(")")[2].split()[0]
                found += [] if state == "Z" else [int(entry.parent.name)]
        except OSError:
            continue
    return found


def outlived(mark: str) -> list[int]:
    """Those still there after 10 s; they are ended."""
    deadline = time.monotonic() + _PATIENCE_S
    while (left := alive(mark)) and time.monotonic() < deadline:
        time.sleep(0.2)
    for number in left:
        os.kill(number, signal.SIGKILL)
    return left


@dataclass
class Found:
    """What was counted over all kills."""

    broken: list[str] = field(default_factory=list)
    temporary: int = 0
    outlived: int = 0
    finished_first: int = 0
    stages: collections.Counter[str] = field(default_factory=collections.Counter)


def kill_once(command: list[str], results: Path, after_s: float, found: Found) -> bool:
    """One run killed after so many seconds; False where it had already ended."""
    mark = secrets.token_hex(8)
    said = results.parent / "said.txt"
    with (
        said.open("wb") as output,
        subprocess.Popen(
            command, stdout=output, stderr=output, env={**os.environ, _MARK: mark}
        ) as run,
    ):
        try:
            run.wait(after_s)
        except subprocess.TimeoutExpired:
            run.send_signal(signal.SIGKILL)
    found.outlived += len(outlived(mark))
    if run.returncode == 0:
        found.finished_first += 1
        return False
    lines = said.read_text(errors="replace").splitlines()
    found.stages[doing(lines)] += 1
    return True


def doing(lines: list[str]) -> str:
    """What a killed run was at: the first word of what it had said last."""
    told = [line.split() for line in lines if line.startswith("sysid: ") and "notice:" not in line]
    return told[-1][1] if told else "starting"


def check(results: Path, endings: dict[str, bytes], found: Found) -> None:
    """Every file of the results: whole, or a temporary one."""
    for path in results.rglob("*"):
        if not path.is_file():
            continue
        if path.name.startswith(".sysid-"):
            found.temporary += 1
        elif not is_whole(path, endings.get(str(path.relative_to(results)))):
            found.broken.append(str(path.relative_to(results)))


def main() -> None:
    """Kill, check, and finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--demo", action="store_true", help="the bundled campaign (minutes each)")
    options = parser.parse_args()
    draw, found = random.Random(options.seed), Found()
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results"
        words = ["demo"] if options.demo else ["run", str(write_axis(Path(folder)))]
        command = [sys.executable, "-m", "sysid", *words, "-o", str(results)]
        command += ["--jobs", str(options.jobs)]
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        length = time.perf_counter() - start
        whole = [p for p in results.rglob("*") if p.is_file()]
        endings = {str(p.relative_to(results)): last_line(p) for p in whole}
        kills = 0
        while kills < options.count:
            # Half the kills start afresh, the others resume: so that all stages are hit.
            if draw.random() < 0.5:
                shutil.rmtree(results, ignore_errors=True)
            kills += kill_once(command, results, draw.uniform(0.0, length), found)
            check(results, endings, found)
            if kills % 5 == 0:
                print(f"{kills} kills: {found}", flush=True)
        subprocess.run(command, check=True, capture_output=True)
        left = sum(p.name.startswith(".sysid-") for p in results.rglob("*"))
        finished = set(endings) <= {str(p.relative_to(results)) for p in results.rglob("*")}
    print(f"{kills} kills over {length:.0f} s, seed {options.seed}, --jobs {options.jobs}")
    print(f"at: {dict(found.stages)}; runs that ended before their kill: {found.finished_first}")
    print(
        f"half-written files: {len(found.broken)} {sorted(set(found.broken))}; processes alive "
        f"after {_PATIENCE_S:.0f} s: {found.outlived}; temporary files after a kill: "
        f"{found.temporary}, after the next call: {left}; finished: {finished}"
    )


if __name__ == "__main__":
    main()
