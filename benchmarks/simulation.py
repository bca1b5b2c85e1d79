"""Figures 1 and 2 of the simulation, as measured.

    python benchmarks/simulation.py accuracy [--rigs 20] [--seconds 10] [--solve-ivp 2]
    python benchmarks/simulation.py speed
    python benchmarks/simulation.py compile
    python benchmarks/simulation.py cores [--runs 512]
    python benchmarks/simulation.py lock [--runs 512]

accuracy: random rigs (seed 1) under PWM against 64 times finer steps, and the first
`--solve-ivp` seconds of each against scipy's solve_ivp with events (rtol 1e-9). speed: a batch
of 64 ten-second runs and what its preparation takes, one of 320 one-second runs, a single run,
and solve_ivp at equal error. compile: one process with an
empty cache, then more with it filled. cores: a batch of ten-second runs by 1, 2, 4 ... threads, as
many as there are cores, in turn: what a core is worth of one alone, by medians. Other work on the
machine distorts wall times: CPU time is printed next to them. lock: of a batch's CPU time by one
thread, the share that holds the interpreter's lock, and what Amdahl's law makes of it; needs gcc,
and a Python with a shared library.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.history import record  # noqa: E402
from benchmarks.reference_plant import integrate  # noqa: E402
from benchmarks.rigs import random_runs  # noqa: E402
from sysid.plant.ports import Model  # noqa: E402
from sysid.plant.preparation import Shared, prepare  # noqa: E402
from sysid.plant.simulator import (  # noqa: E402
    MAX_STEP,
    Inputs,
    Trajectory,
    check_commands,
    check_known,
    simulate,
)
from sysid.plant.tables import block_of  # noqa: E402

SEED = 1
BATCH, SECONDS = 64, 10.0
SEGMENTS = 320
# As `simulate` does it: runs of a block, rows of a piece.
BLOCK, ROWS = 16, 10240


def rms(values: Any) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def error(run: Trajectory, reference: Any) -> tuple[float, float]:
    """RMSE of position, rad, and the larger of the pressures', Pa; reference (4, n)."""
    n = reference.shape[1]
    pressures = (rms(run.pressure_a[:n] - reference[2]), rms(run.pressure_b[:n] - reference[3]))
    return rms(run.position[:n] - reference[0]), max(pressures)


def as_array(run: Trajectory) -> Any:
    """(4, n) of a trajectory."""
    return np.array([run.position, run.velocity, run.pressure_a, run.pressure_b])


def cut(inputs: Inputs, seconds: float) -> Inputs:
    """The first seconds of a run."""
    n = round(seconds * 1000) + 1
    valves = [
        dataclasses.replace(v, values=v.values[:n]) if v else None
        for v in (inputs.valve_a, inputs.valve_b)
    ]
    return dataclasses.replace(
        inputs, time=inputs.time[:n], motor=inputs.motor[:n], valve_a=valves[0], valve_b=valves[1]
    )


def accuracy(rigs: int, seconds: float, short: float) -> None:
    """Figure 1."""
    inputs, models = random_runs(SEED, rigs, seconds)
    runs = simulate(inputs, models)
    fine = [as_array(r) for r in simulate(inputs, models, max_step=MAX_STEP / 64)]
    parts = [cut(i, short) for i in inputs]
    against_fine = [error(r, f) for r, f in zip(runs, fine, strict=True)]
    against_ivp = []
    print("rig   64 x finer: rad, Pa      solve_ivp: rad, Pa      stops and starts   choked, %")
    for i, (run, part, model) in enumerate(zip(runs, parts, models, strict=True)):
        against_ivp.append(error(run, integrate(part, model.parameters)))
        rests = int(np.count_nonzero(np.diff(run.velocity == 0.0)))
        choked = 100.0 * np.mean(run.pressure_a < 0.53 * model.parameters.supply)
        a, b = against_fine[i], against_ivp[i]
        print(
            f"{i:3d}   {a[0]:.1e} {a[1]:6.2f}   {b[0]:.1e} {b[1]:6.2f}   {rests:4d} {choked:5.0f}"
        )
    for name, found in (("64 x finer", against_fine), ("solve_ivp", against_ivp)):
        position, pressure = (max(c) for c in zip(*found, strict=True))
        print(f"worst of {rigs}, {name}: {position:.1e} rad, {pressure:.1f} Pa (2e-4 rad, 30 Pa)")


def timed(function: Callable[[], Any], times: int) -> tuple[list[float], list[float]]:
    """Wall and CPU time of each of several calls, s."""
    wall, cpu = [], []
    for _ in range(times):
        started, used = time.perf_counter(), time.process_time()
        function()
        wall.append(time.perf_counter() - started)
        cpu.append(time.process_time() - used)
    return wall, cpu


def report(name: str, simulated: float, wall: list[float], cpu: list[float]) -> None:
    """A line: times real time, fastest and median; they differ with the machine's load."""
    cores = min(2, len(os.sched_getaffinity(0)))
    best, median, busy = min(wall), statistics.median(wall), min(cpu)
    print(
        f"{name}: fastest {best:.4f} s = {simulated / best:.0f} x real time, median {median:.4f} s "
        f"= {simulated / median:.0f} x; CPU {busy:.4f} s = {simulated / busy:.0f} x a core "
        f"({cores} cores)"
    )
    record(f"simulation, {name}, CPU", busy, "s")


def prepared(inputs: list[Inputs], models: list[Model]) -> None:
    """What `simulate` does in Python before the compiled steps: checks, edges, tables."""
    shared = Shared()
    for first in range(0, len(inputs), BLOCK):
        own, of_own = inputs[first : first + BLOCK], models[first : first + BLOCK]
        check_known(of_own, averaged=False)
        check_commands(own)
        runs = prepare(own, of_own, (), MAX_STEP, shared)
        for _ in block_of(runs, BLOCK, ROWS, MAX_STEP).tables():
            pass


def speed() -> None:
    """Figure 2: times real time, and against solve_ivp."""
    print(f"load average {os.getloadavg()[0]:.1f}")
    inputs, models = random_runs(SEED, BATCH, SECONDS, motor=False)
    first = timed(lambda: simulate(inputs, models), 1)[0][0]
    single = timed(lambda: simulate(inputs[:1], models[:1]), 1)[0][0]
    print(f"first call, compilation or its cache included: {first:.2f} s, single {single:.2f} s")
    batch = timed(lambda: simulate(inputs, models), 15)
    report(f"batch of {BATCH} runs of {SECONDS:g} s", BATCH * SECONDS, *batch)
    share = min(timed(lambda: prepared(inputs, models), 15)[1]) / min(batch[1])
    print(f"preparation: {share:.2f} of the batch's CPU time")
    short = random_runs(SEED, SEGMENTS, 1.0, motor=False)
    segments = timed(lambda: simulate(*short), 15)
    report(f"batch of {SEGMENTS} runs of 1 s", SEGMENTS * 1.0, *segments)
    alone = timed(lambda: simulate(inputs[:1], models[:1]), 15)
    report(f"single run of {SECONDS:g} s", SECONDS, *alone)
    per_second = min(batch[1]) / (BATCH * SECONDS)

    part = cut(inputs[0], 2.0)
    truth = integrate(part, models[0].parameters)
    ours = error(simulate([part], models[:1])[0], truth)
    print(f"ours: {ours[0]:.1e} rad, {ours[1]:.2f} Pa against rtol 1e-9")
    for rtol in (1e-2, 1e-3, 1e-4):
        used = time.process_time()
        found = integrate(part, models[0].parameters, rtol, "RK45")
        used = time.process_time() - used
        theirs = rms(found[0] - truth[0]), rms(found[2:] - truth[2:])
        print(
            f"solve_ivp RK45 with events, rtol {rtol:g}: {theirs[0]:.1e} rad, {theirs[1]:.2f} Pa; "
            f"CPU {used:.2f} s for 2 s = {used / 2.0 / per_second:.0f} times ours in a batch"
        )


_PROCESS = """
import sys, time
sys.path.insert(0, {root!r})
started = time.perf_counter(), time.process_time()
from benchmarks.rigs import random_runs
from sysid.plant.simulator import simulate
inputs, models = random_runs(1, {count}, 1.0)
imported = time.perf_counter(), time.process_time()
simulate(inputs, models)
ended = time.perf_counter(), time.process_time()
print(*(b - a for a, b in zip(imported, ended)), *(b - a for a, b in zip(started, ended)))
"""


def compile_time() -> None:
    """Figure 2: the compile time, and what the second process pays."""
    print(f"load average {os.getloadavg()[0]:.1f}")
    for name, count in (("batch of 64", 64), ("single", 1)):
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "XDG_CACHE_HOME": cache}
            environment.pop("JAX_COMPILATION_CACHE_DIR", None)
            code = _PROCESS.format(root=str(REPOSITORY), count=count)
            rows = []
            for _ in range(4):
                done = subprocess.run(
                    [sys.executable, "-c", code],
                    env=environment,
                    capture_output=True,
                    text=True,
                    check=True,
                )
                rows.append([float(x) for x in done.stdout.split()])
        first, later = rows[0], [min(c) for c in zip(*rows[1:], strict=True)]
        print(
            f"{name}, first call: {first[0]:.2f} s (CPU {first[1]:.2f}) with an empty cache, "
            f"{later[0]:.2f} s (CPU {later[1]:.2f}) in the next processes: "
            f"{later[0] / first[0]:.2f} (CPU {later[1] / first[1]:.2f}) of it; whole with imports "
            f"{first[2]:.2f} and {later[2]:.2f} s"
        )


def cores(runs: int) -> None:
    """A batch by more and more threads."""
    print(f"load average {os.getloadavg()[0]:.1f}")
    inputs, models = random_runs(SEED, runs, SECONDS, motor=False)
    most = len(os.sched_getaffinity(0))
    counts = [n for n in (1, 2, 4, 8, 16, 32, 64) if n <= most]
    wall: dict[int, list[float]] = {n: [] for n in counts}
    for turn in range(6):
        for count in counts:
            os.environ["SYSID_JOBS"] = str(count)
            spent = timed(lambda: simulate(inputs, models), 1)[0]
            wall[count] += spent if turn else []  # the first compiles
    for count in counts:
        median = statistics.median(wall[count])
        worth = statistics.median(wall[1]) / median / count
        print(f"{count} threads: {runs * SECONDS / median:.0f} x real time, {worth:.2f} a core")
        record(f"simulation, {runs} runs, a core of {count}", worth, "of one alone")


_LOCKED = """
import ctypes, sys, time
sys.path.insert(0, {root!r})
from benchmarks.rigs import random_runs
from sysid.plant.simulator import simulate
free = ctypes.PyDLL(None).free_seconds
free.restype = ctypes.c_double
inputs, models = random_runs({seed}, {runs}, {seconds}, motor=False)
simulate(inputs, models)
kept = []  # so that each batch is given fresh memory
for _ in range(5):
    own, given, whole = time.thread_time(), free(), time.process_time()
    kept.append(simulate(inputs, models))
    own, whole = time.thread_time() - own, time.process_time() - whole
    print((own - (free() - given)) / whole)
"""


def lock(runs: int) -> None:
    """The share of a batch's CPU time that holds the interpreter's lock."""
    source = REPOSITORY / "benchmarks" / "contenders" / "lock_clock.c"
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "lock_clock.so"
        include = f"-I{sysconfig.get_path('include')}"
        build = ["gcc", "-O2", "-shared", "-fPIC", include, str(source), "-o", str(library), "-ldl"]
        subprocess.run(build, check=True)
        code = _LOCKED.format(root=str(REPOSITORY), seed=SEED, runs=runs, seconds=SECONDS)
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "LD_PRELOAD": str(library), "SYSID_JOBS": "1"},
            capture_output=True,
            text=True,
            check=True,
        )
    shares = [float(line) for line in done.stdout.split()]
    share = statistics.median(shares)
    print(f"{share:.3f} ({min(shares):.3f} to {max(shares):.3f}) of the CPU time holds the lock")
    for cores in (2, 4, 8, 16):
        print(f"{cores} cores: at most {1.0 / (share + (1.0 - share) / cores):.1f} times one")
    record(f"simulation, {runs} runs, holds the lock", share, "of the CPU time")


def main() -> None:
    """Run the part that was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("part", choices=["accuracy", "speed", "compile", "cores", "lock"])
    parser.add_argument("--runs", type=int, default=512)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--solve-ivp", type=float, default=2.0, help="s of each run")
    options = parser.parse_args()
    if options.part == "accuracy":
        accuracy(options.rigs, options.seconds, options.solve_ivp)
    elif options.part == "speed":
        speed()
    elif options.part == "lock":
        lock(options.runs)
    elif options.part == "cores":
        cores(options.runs)
    else:
        compile_time()


if __name__ == "__main__":
    main()
