"""`sysid run` killed at random moments: no half-written file, and the next call finishes.

    python benchmarks/interruption.py [--kills 30] [--seed 0]

Each kill is a SIGKILL at a moment drawn evenly over the run's own length, then the same
folder is checked: every file must be complete (JSON parses, HTML ends, the C header closes).
At the end one more call must finish.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def is_whole(path: Path) -> bool:
    """Whether a result file is complete."""
    if path.suffix == ".json":
        try:
            json.loads(path.read_text())
        except ValueError:
            return False
        return True
    if path.suffix == ".html":
        return path.read_text().rstrip().endswith("</html>")
    if path.suffix == ".h":
        return path.read_text().rstrip().endswith("*/")
    return path.suffix == ".mat" and path.stat().st_size > 1000


def main() -> None:
    """Kill, check, and finish."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    draw = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results"
        command = [sys.executable, "-m", "sysid", "demo", "-o", str(results)]
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        whole_run = time.perf_counter() - start
        broken, left = 0, 0
        for _ in range(options.kills):
            # Most kills start afresh, so that they hit every stage; some resume.
            if draw.random() < 0.7:
                shutil.rmtree(results, ignore_errors=True)
            with subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            ) as run:
                time.sleep(draw.uniform(0.0, whole_run))
                run.send_signal(signal.SIGKILL)
            files = [p for p in results.rglob("*") if p.is_file()]
            broken += sum(not is_whole(p) for p in files if not p.name.startswith(".sysid-"))
            left += sum(p.name.startswith(".sysid-") for p in files)
        subprocess.run(command, check=True, capture_output=True)
        finished = (results / "report.html").is_file()
    print(f"{options.kills} kills over {whole_run:.0f} s, seed {options.seed}")
    print(f"half-written files: {broken}; temporary files left: {left}; finished: {finished}")


if __name__ == "__main__":
    main()
