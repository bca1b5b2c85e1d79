"""Friction that grows with the load, fitted over logs of different payloads.

    python benchmarks/load_friction.py [--rigs 30] [--first 8000]

Random rigs (every third vertical, every third linear), three motion tests with each of three
payloads, each test with its own friction (2 % scatter), and one more with each that is held out.
Half of the rigs with no part that grows with the load. Printed: the error of the share, how often
its interval holds, the RMSE of the held-out effort with and without it over that of the same law
with the true share, and how often a share is given where there is none (asked: 5 %, the noise
floor, none).
"""

from __future__ import annotations

import argparse
import copy
import dataclasses
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from datasets.generator.campaign import make_friction_tests
from datasets.generator.effects import typical
from datasets.generator.rigs import GeneratedRig, random_rig
from sysid.friction import FrictionResult, fit_friction, friction_rmse
from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content

PAYLOADS = {"rotary": (0.0, 0.4, 0.8), "linear": (0.0, 4.0, 8.0)}
FORMS = (("horizontal", "rotary"), ("vertical", "rotary"), ("horizontal", "linear"))


def carrying(rig: GeneratedRig, payload: float) -> GeneratedRig:
    """The same rig with another payload, kg."""
    content = copy.deepcopy(rig.content)
    content["inertia"]["payload_mass_kg"] = payload
    return dataclasses.replace(rig, content=content)


def made(seed: int, share: float, repeats: int = 4) -> tuple[list[Trial], list[Trial], Rig]:
    """Training and held-out tests of a rig, and the rig; `share` of the motor's effort."""
    orientation, motion = FORMS[seed % len(FORMS)]
    rig = random_rig(np.random.default_rng(seed), orientation, motion)
    effect = typical("load-dependent-friction", "gear", np.random.default_rng(seed))
    effect = dataclasses.replace(effect, values={**effect.values, "gear_friction": share})
    trials: tuple[list[Trial], list[Trial]] = ([], [])
    for k, payload in enumerate(PAYLOADS[motion]):
        tests = make_friction_tests(
            100 * seed + k,
            rig=carrying(rig, payload),
            kinds=("friction-motion",),
            effects=(effect,) if share else (),
        ).kinds["friction-motion"]
        for n, test in enumerate(tests):
            columns = {name: v for name, v in test.columns.items() if name != "time_s"}
            label = f"{payload:g} kg, {n}"
            trial = Trial(label, test.columns["time_s"], columns, f"made, test {label}")
            trials[n == len(tests) - 1].append(dataclasses.replace(trial, payload_kg=payload))
    return *trials, rig_from_content(rig.content, "generated")


def with_share(fit: FrictionResult, share: float) -> FrictionResult:
    """The fit with another share."""
    assert fit.load is not None
    changed = dataclasses.replace(fit.load.share, value=share)
    return dataclasses.replace(fit, load=dataclasses.replace(fit.load, share=changed))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rigs", type=int, default=30)
    parser.add_argument("--first", type=int, default=8000)
    o = parser.parse_args()
    began, off, held, gains, named = time.perf_counter(), [], [], [], 0
    for seed in range(o.first, o.first + o.rigs):
        rng = np.random.default_rng(seed)
        share = float(rng.uniform(0.02, 0.12))
        fitted, rest, rig = made(seed, share)
        fit = fit_friction(fitted, rig, kind="motion", load="motor")
        plain = fit_friction(fitted, rig, kind="motion")
        if fit.load is None:
            print(f"{seed}: {share:.4f} is not shown: {fit.notices[-1]}")
            off.append(1.0)
            continue
        found = fit.load.share
        off.append(abs(found.value / share - 1.0))
        held.append(found.holds(share))
        errors = [friction_rmse(one, rest, rig) for one in (plain, fit)]
        gains.append(errors)
        none, _, rig = made(seed, 0.0)
        without = fit_friction(none, rig, kind="motion", load="motor").load
        named += without is not None
        print(
            f"{seed}: share {share:.4f}, found {found.value:.4f} +- {found.std:.4f}; held-out RMSE "
            f"{errors[0]:.4g} to {errors[1]:.4g} {rig.units.effort}"
            + (f"; without: {without.share.value:.4f} named" if without else ""),
            flush=True,
        )
    print(f"share within 5 %: {sum(e <= 0.05 for e in off)} of {len(off)}; median error "
          f"{100 * np.median(off):.2g} %, largest {100 * max(off):.2g} %")  # fmt: skip
    print(f"intervals that hold: {sum(held)} of {len(held)}; named where none is: {named}")
    print(f"held-out RMSE with over without, median {np.median([b / a for a, b in gains]):.2f}")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
