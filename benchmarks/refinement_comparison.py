"""One estimation job as whole processes: sysid, scipy, lmfit, casadi, solve_ivp, C by hand.

    python benchmarks/refinement_comparison.py [--python PATH] [--repeats 5] [--seed 3001]
        [--cores 1] [--limit 600] [--only NAME ...]

Eight parameters of a random rig from five logs of 10 s under PWM, cut into segments of 1 s with
start states of their own and each log with its own friction about the model's: position and both
pressures over their noise. Each parameter starts 30 % off, with a sign of its own. Every contender
reads the same file and writes its estimates; they take turns, and a ratio is the median of those of
the turns, of wall and of CPU time: on a machine that does other work the second is the one to
read. `--python`: an interpreter with numpy, scipy, numba, lmfit and casadi; what it lacks is
skipped and said. A contender that needs longer than `--limit` s is stopped.

The contenders use sysid's equations in steps by hand (`contenders/plant.h` and its twin for numba),
as accurate as sysid's (the same to rounding at steps of 1 ms); solve_ivp takes
`reference_plant.py`. Their derivatives are differences, casadi's its own. They go through sysid's
stages: each channel of a segment counts by its own size, each log's static friction is scanned,
the errors count as they are without segments that the model does not follow. A descent ends where a
step lowers the sum of squares by less than 1e-6 of it; sysid's where the next step would move every
parameter by less than 0.05 standard errors, or four steps lower it by less than 3e-5 together.
C: one program, gcc -O3 -march=native -ffast-math.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.refinement import LOGS, NUMBERS, rig_runs  # noqa: E402
from sysid.plant.base import PARAMETER_NAMES, Parameters  # noqa: E402
from sysid.plant.ports import Model  # noqa: E402
from sysid.plant.preparation import open_intervals  # noqa: E402

CONTENDERS = REPOSITORY / "benchmarks" / "contenders"
OFF = 0.3
# Later than any row.
NEVER = 1e9
PLANT = (
    "static_effort",
    "coulomb_effort",
    "viscous",
    "inertia",
    "gravity_moment",
    "offset",
    "max_effort",
    "area_a",
    "area_b",
    "offset_a",
    "offset_b",
    "pitch_radius",
    "stop",
    "heat_capacity_ratio",
    "rt",
    "atmosphere",
    "supply",
    "choked_fill_a",
    "choked_fill_b",
    "choked_dis_a",
    "choked_dis_b",
    "c_fill_a",
    "c_fill_b",
    "c_dis_a",
    "c_dis_b",
)
PACKAGES = {
    "scipy": ("scipy", "numba"),
    "lmfit": ("lmfit", "numba"),
    "casadi": ("casadi", "scipy"),
}


@dataclass(frozen=True)
class Contender:
    """A process: its name and command, to which job and result are appended; its job's suffix."""

    name: str
    command: tuple[str, ...]
    job: str = ".npz"


@dataclass(frozen=True)
class Used:
    """Wall and CPU time of a process, s."""

    wall: float
    cpu: float


# --- the job ------------------------------------------------------------------------------------


def plant_numbers(p: Parameters) -> list[float]:
    """The plant's numbers in the contenders' order."""
    derived = {"stop": 0.5 * p.stroke / p.pitch_radius, "rt": p.gas_constant * p.temperature}
    return [float(derived[n] if n in derived else getattr(p, n)) for n in PLANT]


def edges(runs: list[Any], side: str, model: Model) -> Any:
    """When a valve opens and closes, in turn, by run (runs, most); ends with `NEVER`."""
    found = []
    for run in runs:
        own = open_intervals(run.inputs, side, model)
        found.append(np.column_stack([own.opens, own.closes]).ravel())
    most = 1 + max(len(e) for e in found)
    padded = [np.concatenate([e, np.full(most - len(e), NEVER)]) for e in found]
    return np.minimum(np.array(padded), NEVER)


def make_job(seed: int, folder: Path) -> tuple[Path, Parameters, Parameters]:
    """Write the job for all contenders; its stem, the true parameters, where it starts."""
    runs, model = rig_runs(seed, LOGS)
    rng = np.random.default_rng([seed, 3])
    true = model.parameters
    signs = rng.choice([-1.0, 1.0], len(NUMBERS))
    moved = {
        n: float(getattr(true, n)) * (1 + OFF * s) for n, s in zip(NUMBERS, signs, strict=True)
    }
    start = true.replace(**moved)
    widths = np.array([run.start_std for run in runs])
    starts = np.array([run.start for run in runs])
    starts += widths * rng.standard_normal(starts.shape) * (widths > 1e-6)
    arrays = {
        "noise": runs[0].noise,
        "test": np.array([float(run.test) for run in runs]),
        "time": np.array([run.inputs.time for run in runs]),
        "motor": np.array([run.inputs.motor for run in runs]),
        "edges_a": edges(runs, "a", model),
        "edges_b": edges(runs, "b", model),
        "measured": np.array([run.measured for run in runs]),
        "starts": starts,
        "widths": widths,
    }
    most = max(arrays["edges_a"].shape[1], arrays["edges_b"].shape[1])
    for name in ("edges_a", "edges_b"):
        more = most - arrays[name].shape[1]
        arrays[name] = np.pad(arrays[name], ((0, 0), (0, more)), constant_values=NEVER)
    plant = np.array(plant_numbers(start))
    rows = arrays["time"].shape[1]
    stem = folder / f"job{seed}"
    with stem.with_suffix(".bin").open("wb") as file:
        np.array([len(runs), LOGS, rows, most], dtype=float).tofile(file)
        plant.tofile(file)
        for array in arrays.values():
            array.tofile(file)
    duties = {f"duty_{s}": np.array([run.inputs.valve(s).values for run in runs]) for s in "ab"}
    numbers = np.array([float(getattr(start, n)) for n in PARAMETER_NAMES])
    np.savez(
        stem.with_suffix(".npz"),
        plant=plant,
        parameters=numbers,
        names=np.array(NUMBERS),
        **arrays,
        **duties,
    )
    return stem, true, start


# --- the contenders -----------------------------------------------------------------------------


def contenders(python: str, folder: Path) -> list[Contender]:
    """Those that the machine has; says which it has not."""
    found = [Contender("sysid", (sys.executable, str(CONTENDERS / "sysid_job.py")))]
    for name, packages in PACKAGES.items():
        lacking = [p for p in packages if not has(python, p)]
        if lacking:
            print(f"{name}: skipped, {python} has no {', '.join(lacking)}")
            continue
        found.append(Contender(name, (python, str(CONTENDERS / f"{name}_job.py"))))
    found.append(Contender("solve_ivp", (sys.executable, str(CONTENDERS / "solve_ivp_job.py"))))
    compiler = next((c for c in ("gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        print("C: skipped, the machine has neither gcc nor clang")
        return found
    program = folder / "job"
    flags = ("-std=c99", "-O3", "-march=native", "-ffast-math", "-fno-finite-math-only")
    sources = (str(CONTENDERS / "job.c"), "-o", str(program), "-lm")
    subprocess.run([compiler, *flags, *sources], check=True)
    return [*found, Contender("C", (str(program),), ".bin")]


def has(python: str, package: str) -> bool:
    """Whether an interpreter has a package."""
    done = subprocess.run([python, "-c", f"import {package}"], capture_output=True)
    return done.returncode == 0


def run(one: Contender, stem: Path, limit: float, cores: int) -> tuple[Used, list[float]]:
    """What a contender's process took, and what it wrote; nothing where it is stopped."""
    out = stem.with_suffix(".txt")
    out.unlink(missing_ok=True)
    environment = {**os.environ, "NUMBA_NUM_THREADS": str(cores), "OMP_NUM_THREADS": "1"}
    command = [*one.command, str(stem.with_suffix(one.job)), str(out)]
    begun, before = time.perf_counter(), children_cpu()
    try:
        subprocess.run(command, check=True, timeout=limit, env=environment)
    except subprocess.TimeoutExpired:
        return Used(math.inf, children_cpu() - before), []
    used = Used(time.perf_counter() - begun, children_cpu() - before)
    return used, [float(line) for line in out.read_text().split()]


def children_cpu() -> float:
    """CPU time of all processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def off(found: list[float], true: Parameters, start: Parameters) -> list[float]:
    """By parameter, how far the estimate is from the truth, relative."""
    values = (
        float(getattr(start, n)) * math.exp(x) for n, x in zip(NUMBERS, found[1:], strict=True)
    )
    return [v / float(getattr(true, n)) - 1.0 for n, v in zip(NUMBERS, values, strict=True)]


def compare(seed: int, repeats: int, limit: float, cores: int, options: Any) -> None:
    """Print what each contender found and needed, and the ratios."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        stem, true, start = make_job(seed, folder)
        known = contenders(options.python, folder)
        field = [c for c in known if not options.only or c.name in (*options.only, "sysid")]
        times: dict[str, list[Used]] = {c.name: [] for c in field}
        for turn in range(repeats + 1):  # the first fills the caches
            for one in list(field):
                used, found = run(one, stem, limit, cores)
                if not found:
                    print(
                        f"{one.name}: stopped in turn {turn} after {used.cpu:.0f} s of CPU time",
                        flush=True,
                    )
                    field.remove(one)
                elif turn:
                    times[one.name].append(used)
                else:
                    errors = ", ".join(f"{100 * e:+.3g}" for e in off(found, true, start))
                    print(
                        f"{one.name}: {found[0]:.0f} evaluations, estimates off by {errors} %; "
                        f"CPU {used.cpu:.1f} s with an empty cache",
                        flush=True,
                    )
    for name, own in times.items():
        if own:
            wall, cpu = (ratio(own, times["sysid"], kind) for kind in ("wall", "cpu"))
            medians = [statistics.median(getattr(u, k) for u in own) for k in ("wall", "cpu")]
            print(
                f"{name}: median {medians[0]:.2f} s, {wall:.2f} times sysid's; "
                f"CPU {medians[1]:.2f} s, {cpu:.2f} times"
            )
    print(f"load average {os.getloadavg()[0]:.1f}, {cores} core(s)")


def ratio(own: list[Used], ours: list[Used], kind: str) -> float:
    """The median of the ratios of the turns that both ended; NaN where there is none."""
    pairs = zip(own, ours, strict=False)
    ratios = [getattr(a, kind) / getattr(b, kind) for a, b in pairs]
    return statistics.median(ratios) if ratios else math.nan


def main() -> None:
    """Run what is asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seed", type=int, default=3001)
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--limit", type=float, default=600.0)
    parser.add_argument("--only", nargs="+", help="these and sysid")
    options = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])
    compare(options.seed, options.repeats, options.limit, options.cores, options)


if __name__ == "__main__":
    main()
