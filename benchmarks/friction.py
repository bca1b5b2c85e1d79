"""Figures of friction, as measured.

    python benchmarks/friction.py [--only thesis|emps|generated|vertical|low-speed|coarse]
        [--seeds 50]

thesis: Tables 3.4.1 and 3.4.2. emps: the measured positioning system of Janot, Gautier, Brunot
(2019), skipped where ../shared/data is absent. generated: random rigs with known friction; the
seeds are 0, 1, 2, ... vertical: vertical rigs, trials that come to rest, and with bristles, in
several forms; the seeds are 2000, 2001, ... low-speed: motion logs of a small servo, ten runs each,
rigid, with bristles, and with Stribeck friction too; the seeds are 9500, 9501, ... (those of the
rule's development were 9000 to 9119). coarse: static friction by encoders of few counts; the seeds
are 3000, 3001, ... (3000 to 3007 were looked at in its development).
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.small_servo import FORMS as SERVO_FORMS  # noqa: E402
from benchmarks.small_servo import campaigns  # noqa: E402
from datasets.generator.campaign import drawn_effects, make_friction_tests  # noqa: E402
from datasets.thesis.recompute import sliding_friction, static_friction  # noqa: E402
from sysid.errors import NotIdentifiedError  # noqa: E402
from sysid.estimation.linear import Estimate  # noqa: E402
from sysid.friction import FrictionResult, fit_friction, friction_rmse  # noqa: E402
from sysid.io.logs import Trial  # noqa: E402
from sysid.io.rig import Rig, rig_from_content  # noqa: E402
from sysid.types import FloatArray  # noqa: E402

EMPS = REPOSITORY.parent / "shared" / "data" / "emps"
PUBLISHED = {
    "mass_kg": (95.1, 1.0),
    "viscous_n_s_per_m": (203.5, 2.0),
    "coulomb_n": (20.4, 3.0),
    "offset_n": (-3.2, 5.0),
}
FORMS: dict[str, dict[str, Any]] = {
    "vertical arm": {"orientation": "vertical"},
    "vertical arm, from rest to rest": {"orientation": "vertical", "to_rest": True},
    "the same with bristles": {"orientation": "vertical", "to_rest": True, "bristles": True},
    "vertical linear axis": {"orientation": "vertical", "motion": "linear"},
    "horizontal arm from rest, with bristles": {"to_rest": True, "bristles": True},
}
PARTS = ("thesis", "emps", "generated", "vertical", "low-speed", "coarse")
COARSE = (4000, 2000, 1000, 800, 500, 360, 200)
# Of the encoder's edges, in counts.
JITTER = (0.0, 0.05, 0.1)
TARGETS = {"static": 3.0, "coulomb": 2.0, "viscous": 6.0}


def thesis() -> None:
    """Figure 1."""
    static, sliding = static_friction(), sliding_friction()
    places = "/".join(f"{p.estimate.value:.3f}" for p in static.by_position)
    test = static.tests["position"]
    print("1. thesis")
    print(f"   static mean {static.estimate.value:.3f} Nm (issue: 0.333)")
    print(f"   left/middle/right {places} (0.368/0.353/0.278)")
    print(f"   position: F = {test.statistic:.1f} (27.6), p = {test.p_value:.1e}")
    print(f"   C_vf = {shown(sliding.viscous)} (0.0488 [0.040, 0.063])")
    print(f"   tau_cf = {shown(sliding.coulomb)} (0.2081 [0.196, 0.216])")
    for cluster in sliding.clusters:
        print(
            f"   clusters: {', '.join(cluster.first)} | {', '.join(cluster.second)}; "
            f"p = {cluster.p_value:.4f}"
        )


def shown(estimate: Estimate) -> str:
    low, high = estimate.interval
    return f"{estimate.value:.4f} [{low:.4f}, {high:.4f}] {estimate.unit}"


def emps_trial(name: str) -> Trial:
    from scipy.io import loadmat

    data = loadmat(EMPS / f"{name}.mat")
    flat = {key: np.asarray(data[key], dtype=float).ravel() for key in ("t", "qm", "vir")}
    gain = float(np.asarray(data["gtau"]).squeeze())
    channels = {"position_m": flat["qm"], "motor_force_n": gain * flat["vir"]}
    return Trial(name, flat["t"], channels, name)


def emps() -> None:
    """Figure 2."""
    print("2. EMPS")
    if not EMPS.is_dir():
        print("   skipped: ../shared/data/emps is absent")
        return
    rig = Rig("emps", "horizontal", "linear")
    fitted, held_out = emps_trial("DATA_EMPS"), emps_trial("DATA_EMPS_PULSES")
    result = fit_friction([fitted], rig, kind="motion", estimate_inertia=True)
    for name, (published, percent) in PUBLISHED.items():
        estimate = result[name]
        off = 100.0 * (estimate.value / published - 1.0)
        inside = "inside" if estimate.holds(published) else "NOT inside"
        print(
            f"   {name} {shown(estimate)}: {off:+.2f} % of {published:g} (+-{percent:g} %), "
            f"published value {inside} the interval"
        )
    print(f"   force RMSE, fitted {friction_rmse(result, [fitted], rig):.2f} N")
    print(f"   force RMSE, held out (pulses) {friction_rmse(result, [held_out], rig):.2f} N")
    for factor in (1.0, -1.0):
        added = with_pulses(held_out, factor)
        error = friction_rmse(result, [added], rig)
        print(f"   force RMSE, held out, {factor:+g} times the pulses added {error:.2f} N")


def with_pulses(trial: Trial, factor: float) -> Trial:
    """The validation file with its force pulses added to what the drive was commanded."""
    from scipy.io import loadmat

    pulses = np.asarray(loadmat(EMPS / f"{trial.label}.mat")["pulses_N"], dtype=float).ravel()
    force = trial["motor_force_n"] + factor * pulses
    return replace(trial, channels={**trial.channels, "motor_force_n": force})


def generated_fit(
    seed: int, *, counts: int | None = None, jitter: float = 0.0, **form: Any
) -> tuple[FrictionResult, dict[str, float]]:
    """One random rig's fit and its true friction; `form` as in `make_friction_tests`.

    `counts` a revolution, of a rotary rig, instead of the 80,000 of the generator's encoder, with
    an edge that jitters by so many counts, one standard deviation.
    """
    rng = np.random.default_rng(seed)
    tests = make_friction_tests(seed, kinds=("friction-static", "friction-sliding"), **form)
    rig = rig_from_content(tests.rig, "generated")
    trials = [
        Trial(
            f"{kind} {test.label}",
            test.columns["time_s"],
            {
                name: counted(values, counts, jitter, rng)
                if counts and name == "theta_rad"
                else values
                for name, values in test.columns.items()
                if name != "time_s"
            },
            "generated",
        )
        for kind, group in tests.kinds.items()
        for test in group
    ]
    return fit_friction(trials, rig), tests.truth["friction"]


def counted(angle: FloatArray, counts: int, jitter: float, rng: np.random.Generator) -> FloatArray:
    """An angle (n,), rad, as an encoder of so many counts a revolution reads it."""
    count = 2.0 * np.pi / counts
    noise = jitter * rng.standard_normal(len(angle))
    return np.asarray(np.round(angle / count + noise) * count)


def coarse(seeds: int) -> None:
    """Static friction by coarse encoders."""
    for counts, jitter in [(None, 0.0), *((c, j) for j in JITTER for c in COARSE)]:
        fits = [
            generated_fit(seed, counts=counts, jitter=jitter) for seed in range(3000, 3000 + seeds)
        ]
        pairs = [(fit["static_nm"], truth["static_nm"]) for fit, truth in fits]
        known = [(estimate, truth) for estimate, truth in pairs if estimate.identified]
        errors = [100.0 * (estimate.value / truth - 1.0) for estimate, truth in known]
        held = 100.0 * np.mean([estimate.holds(truth) for estimate, truth in known])
        print(
            f"6. {counts or 'all'} counts, jitter {jitter:g}, {seeds} seeds: static friction off "
            f"by {np.median(errors):+.2f} % (median), at most {np.max(np.abs(errors)):.1f} %; "
            f"truth inside the 95 % interval in {held:.0f} %; none from {seeds - len(known)}",
            flush=True,
        )


def generated(seeds: int) -> None:
    """Figure 3."""
    errors: dict[str, list[float]] = {}
    held: dict[str, list[bool]] = {}
    for seed in range(seeds):
        result, truth = generated_fit(seed)
        for name, value in truth.items():
            errors.setdefault(name, []).append(abs(result[name].value / value - 1.0))
            held.setdefault(name, []).append(result[name].holds(value))
    print(f"3. generated, {seeds} seeds, 2 % trial scatter")
    for name, values in errors.items():
        target = TARGETS[name.split("_")[0]]
        print(
            f"   {name}: median error {100.0 * np.median(values):.2f} % (within {target:g} %), "
            f"truth inside the 95 % interval in {100.0 * np.mean(held[name]):.0f} % (90 to 99 %)"
        )


def vertical(seeds: int) -> None:
    """Friction comes out whenever the log holds it: medians, and how many rigs are refused."""
    for name, form in FORMS.items():
        errors: dict[str, list[float]] = {}
        refused = []
        for seed in range(2000, 2000 + seeds):
            chosen = dict(form)
            bristles = [("presliding", "lugre", 1.0)] if chosen.pop("bristles", False) else []
            try:
                result, truth = generated_fit(seed, effects=drawn_effects(seed, bristles), **chosen)
            except NotIdentifiedError:
                refused.append(seed)
                continue
            if not result.has_sliding:
                refused.append(seed)
                continue
            for key, value in truth.items():
                errors.setdefault(key, []).append(abs(result[key].value / value - 1.0))
        found = ", ".join(
            f"{key.split('_')[0]} {100.0 * np.median(v):.2f} % (largest {100.0 * np.max(v):.1f})"
            for key, v in errors.items()
        )
        print(f"4. {name}, {seeds} seeds: median error of {found}; refused {refused}", flush=True)


def low_speed(seeds: int) -> None:
    """Motion at low speed: bias and coverage of Coulomb and viscous friction."""
    for form in SERVO_FORMS:
        errors: dict[str, list[float]] = {"coulomb_nm": [], "viscous_nm_s_per_rad": []}
        held: dict[str, list[bool]] = {name: [] for name in errors}
        widths: dict[str, list[float]] = {name: [] for name in errors}
        refused = 0
        for servo, trials in campaigns(range(9500, 9500 + seeds), form):
            result = fit_friction(trials, servo.rig, kind="motion")
            refused += not result.has_sliding
            for name, truth in zip(errors, (servo.coulomb, servo.viscous), strict=True):
                estimate = result[name]
                if estimate.identified:
                    errors[name].append(estimate.value / truth - 1.0)
                    held[name].append(estimate.holds(truth))
                    widths[name].append(0.5 * float(np.ptp(estimate.interval)) / truth)
        for name, values in errors.items():
            print(
                f"5. small servo, {form}, {seeds} seeds: {name.split('_')[0]} bias "
                f"{100.0 * np.median(values):+.1f} % (median), |error| "
                f"{100.0 * np.median(np.abs(values)):.1f} %, largest "
                f"{100.0 * np.max(np.abs(values)):.0f} %; truth inside the 95 % interval in "
                f"{100.0 * np.mean(held[name]):.0f} %, its half-width "
                f"{100.0 * np.median(widths[name]):.1f} %; refused {refused}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--seeds", type=int, default=50)
    options = parser.parse_args()
    if options.only in (None, "thesis"):
        thesis()
    if options.only in (None, "emps"):
        emps()
    if options.only in (None, "generated"):
        generated(options.seeds)
    if options.only in (None, "vertical"):
        vertical(options.seeds)
    if options.only in (None, "low-speed"):
        low_speed(options.seeds)
    if options.only in (None, "coarse"):
        coarse(options.seeds)


if __name__ == "__main__":
    main()
