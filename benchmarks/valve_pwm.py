"""PWM surfaces on generated campaigns: error in duty, round trip, and the time of a whole fit.

Surfaces: for every seed and PWM frequency, both valves in both directions at the declared
delays. Printed: RMSE in duty on held-out tests of the bipolynomial and of the network, their
ratio, and the largest error of the round trip duty -> flow -> duty inside the domain.
Targets: ratio at most 0.4, the network's RMSE at most 0.025, round trip within 0.5 points.

Speed: `sysid fit valve-pwm` on 480,000 rows, the whole process, against a script that fits the same
file with pandas and scipy (`contenders/pwm_job.py`): processor time. Target: at most 1.2 of its.

    python benchmarks/valve_pwm.py surfaces [--seeds 1 2] [--hertz 200 250 300]
    python benchmarks/valve_pwm.py speed [--repeats 5]
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.history import in_turn
from datasets.generator.campaign import LARGE, STANDARD, GeneratedLog, make_campaign
from datasets.generator.files import write_log
from datasets.generator.rigs import rig_toml
from sysid.identification.valve_pwm.result import DirectionFit
from sysid.io.logs import Trial
from sysid.io.rig import rig_from_content
from sysid.surfaces import Saturation
from sysid.valve_pwm import fit_valve_pwm

ROWS = 480_000
CONTENDER = Path(__file__).resolve().parent / "contenders" / "pwm_job.py"
GRID = 101


def trials_of(log: GeneratedLog) -> list[Trial]:
    """A generated log as the trials that a reader would give."""
    trials = []
    for test in log.tests:
        channels = {k: v for k, v in test.columns.items() if k != "time_s"}
        trials.append(Trial(test.label, test.columns["time_s"], channels, log.stem))
    return trials


def round_trip(fit: DirectionFit) -> dict[str, tuple[float, float]]:
    """By surface: largest |duty -> flow -> duty| in points, and the share left out of it.

    Over a grid of duty and pressure in the hull of the data. Left out, and counted: what the
    surface flags as saturated, and where the nine terms make the flow fall with the duty, as
    no valve's does; the inverse gives the rising root there.
    """
    pressure = np.linspace(*fit.domain.pressure_range, GRID)
    low, high = fit.domain.duty_limits(pressure)
    share = np.linspace(0.0, 1.0, GRID)[:, None]
    duty = low + share * (high - low)
    result = {}
    for name, surface in (("bipolynomial", fit.bipolynomial), ("ann", fit.network)):
        assert surface is not None
        flow, forward = surface.flow(duty, np.broadcast_to(pressure, duty.shape))
        back, backward = surface.duty(flow, np.broadcast_to(pressure, duty.shape))
        good = (forward == Saturation.INSIDE) & (backward == Saturation.INSIDE)
        good &= np.gradient(flow, axis=0) > 0.0
        error = 100.0 * np.abs(back - duty)[good]
        result[name] = (float(error.max()), float(1.0 - good.mean()))
    return result


def surfaces(seeds: list[int], frequencies: list[float]) -> None:
    """Print one line per surface, and the worst of all."""
    print("seed   Hz valve direction  bipolynomial  network  ratio  round trip, points (left out)")
    worst = np.zeros(4)
    for seed in seeds:
        for hertz in frequencies:
            campaign = make_campaign(seed, size=STANDARD, kinds=("valve-pwm",), pwm_frequency=hertz)
            rig = rig_from_content(campaign.rig.content, "generated")
            trials = [t for log in campaign.logs for t in trials_of(log)]
            for (valve, direction), fit in fit_valve_pwm(trials, rig, surface="both").fits.items():
                assert fit.comparison is not None
                both, trip = fit.comparison, round_trip(fit)
                print(
                    f"{seed:4d} {hertz:4.0f} {valve:>5s} {direction:9s} "
                    f"{both.bipolynomial.rmse:13.4f} {both.network.rmse:8.4f} {both.ratio:6.2f}"
                    + "".join(f"  {n} {e:.3f} ({f:.1%})" for n, (e, f) in trip.items()),
                    flush=True,
                )
                found = (both.ratio, both.network.rmse, trip["bipolynomial"][0], trip["ann"][0])
                worst = np.maximum(worst, found)
    print(
        f"worst: ratio {worst[0]:.2f} (0.40), network {worst[1]:.4f} (0.025), round trip "
        f"bipolynomial {worst[2]:.3f}, network {worst[3]:.3f} points (0.5)"
    )


def write_large_log(folder: Path) -> Path:
    """A log of ROWS rows: a large campaign's tests of both valves, some of them twice."""
    campaign = make_campaign(5, size=LARGE, kinds=("valve-pwm",))
    tests = [t for log in campaign.logs for t in log.tests]
    picked, rows = [], 0
    for i in range(2 * len(tests)):
        test = tests[i % len(tests)]
        n = min(len(test.columns["time_s"]), ROWS - rows)
        columns = {k: v[:n] for k, v in test.columns.items()}
        picked.append(dataclasses.replace(test, label=str(i + 1), columns=columns))
        rows += n
        if rows == ROWS:
            break
    path = folder / "valve_pwm.csv"
    write_log(path, picked, campaign.rig)
    (folder / "rig.toml").write_text(rig_toml(campaign.rig.content), encoding="utf-8")
    return path


def speed(repeats: int) -> None:
    """Print and record the processor time of both processes, in turn, and their ratio."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_large_log(Path(folder))
        fit = [
            sys.executable, "-m", "sysid", "fit", "valve-pwm", path.name,
            "--surface", "bipolynomial", "-o", "bundle.json", "--no-report",
        ]  # fmt: skip
        script = [sys.executable, str(CONTENDER), path.name, "rig.toml"]
        in_turn(
            "fit valve-pwm, 480,000 rows, over pandas with scipy", fit, script, path.parent, repeats
        )
        print("  (at most 1.2)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    error = kinds.add_parser("surfaces", help="error in duty and round trip")
    error.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    error.add_argument("--hertz", type=float, nargs="+", default=[200.0, 250.0, 300.0])
    timed = kinds.add_parser("speed", help="time of a whole process")
    timed.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    if arguments.kind == "surfaces":
        surfaces(arguments.seeds, arguments.hertz)
    else:
        speed(arguments.repeats)


if __name__ == "__main__":
    main()
