"""A PWM log fitted with pandas and scipy alone, as a lab's script does it (thesis 3.5.3, 3.7.3).

Read the log; filter each test's pressure, differentiate it, and take the mean flow in windows;
fit nine terms to each valve and direction; judge them in duty on held-out tests, in four folds.
No check of the file, no interval, no averaged law, no notice.

    python benchmarks/contenders/pwm_job.py valve_pwm.csv rig.toml
"""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import signal

CUTOFF_HZ, WINDOW, FOLDS = 50.0, 20, 4
DEGREES = [(i, j) for i in range(3) for j in range(3)]


def terms(duty, pressure):
    return np.stack([duty**i * (pressure / 1e5) ** j for i, j in DEGREES], axis=1)


def inverse(c, pressure, flow, duty):
    """The root in duty that is nearest to the true one: generous to the surface."""
    powers = np.stack([(pressure / 1e5) ** j for j in range(3)], axis=1)
    c0, c1, c2 = (powers @ c[3 * i : 3 * i + 3] for i in range(3))
    under = np.sqrt(np.maximum(c1**2 - 4.0 * c2 * (c0 - flow), 0.0))
    roots = np.stack([(-c1 + sign * under) / (2.0 * c2) for sign in (1.0, -1.0)])
    roots = np.clip(roots, 0.0, 1.0)
    return roots[np.abs(roots - duty).argmin(axis=0), np.arange(len(duty))]


def samples(frame, rig, side):
    """Duty, pressure, flow and test of each window of a valve's tests, filling and discharging."""
    air, cylinder = rig["air"], rig["cylinder"]
    area, dead = cylinder[f"area_{side}_m2"], cylinder[f"offset_{side}_m"]
    sign = 1.0 if side == "a" else -1.0
    middle = 0.5 * (air["atmospheric_pressure_pa"] + air["supply_pressure_pa"])
    period = rig["sampling"]["period_s"]
    filter_ = signal.butter(2, CUTOFF_HZ, fs=1.0 / period, output="sos")
    found: dict[bool, list[tuple[np.ndarray, ...]]] = {True: [], False: []}
    for test, rows in frame[frame[f"duty_{side}"] > 0.0].groupby("test", sort=False):
        raw = rows[f"pressure_{side}_pa"].to_numpy(float)
        smooth = signal.sosfiltfilt(filter_, raw)
        rate = np.gradient(smooth, period)
        place = cylinder["pitch_radius_m"] * rows["theta_rad"].to_numpy().mean()
        volume = area * (dead + sign * place)
        per_rate = volume / (
            air["heat_capacity_ratio"] * air["gas_constant_j_per_kg_k"] * air["temperature_k"]
        )
        count = len(raw) // WINDOW
        flow = (rate * per_rate)[: count * WINDOW].reshape(count, WINDOW).mean(axis=1)
        level = smooth[: count * WINDOW].reshape(count, WINDOW).mean(axis=1)
        duty = rows[f"duty_{side}"].iloc[0]
        columns = np.full(count, duty), level, flow, np.full(count, test)
        found[bool(raw[:WINDOW].mean() < middle)].append(columns)
    return {
        way: [np.concatenate(c) for c in zip(*parts, strict=True)]
        for way, parts in found.items()
        if parts
    }


def main() -> None:
    frame = pd.read_csv(sys.argv[1], comment="#")
    rig = tomllib.loads(Path(sys.argv[2]).read_text())
    result = {}
    for side in ("a", "b"):
        for way, (duty, pressure, flow, test) in samples(frame, rig, side).items():
            rows = terms(duty, pressure)
            c, *_ = np.linalg.lstsq(rows, flow, rcond=None)
            fold = np.random.default_rng(0).permutation(int(test.max()) + 1)[test.astype(int)]
            error = np.empty(len(duty))
            for k in range(FOLDS):
                held = fold % FOLDS == k
                own, *_ = np.linalg.lstsq(rows[~held], flow[~held], rcond=None)
                error[held] = inverse(own, pressure[held], flow[held], duty[held]) - duty[held]
            name = f"{side}, {'filling' if way else 'discharging'}"
            result[name] = {"terms": c.tolist(), "rmse_duty": float(np.sqrt(np.mean(error**2)))}
    print(json.dumps(result))


if __name__ == "__main__":
    main()
