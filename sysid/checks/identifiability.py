"""Which parameters a log's tests can identify, and which test would identify the rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid import signals
from sysid.io.channels import SIDES
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.io.trial_kind import is_active, is_held
from sysid.model.base import CRITICAL_RATIO
from sysid.types import FloatArray

TrialsByKind = Mapping[str, Sequence[Trial]]

_FRICTION_KINDS = ("friction-motion", "friction-sliding", "motion-pwm", "motion-discrete")
# Regressors whose variance inflation is above this cannot be distinguished in practice.
_HIGHEST_VARIANCE_INFLATION = 25.0
_FEWEST_DUTIES = 5


@dataclass(frozen=True)
class Identification:
    """Whether a log identifies a parameter, and why, or which test would identify it."""

    parameter: str
    identified: bool
    reason: str


def identifications(by_kind: TrialsByKind, rig: Rig) -> Iterator[Identification]:
    """Every parameter of the model in turn; a purely electric axis has no valves.

    `by_kind` holds the log's trials by kind.
    """
    yield _static(by_kind.get("friction-static", ()), rig)
    yield from _sliding_or_motion(by_kind, rig)
    if rig.cylinder is None:
        return
    for valve in SIDES:
        yield from _discrete(by_kind.get("valve-discrete", ()), rig, valve)
        yield from _pwm(by_kind.get("valve-pwm", ()), valve)


def excitation(by_kind: TrialsByKind, rig: Rig) -> Iterator[str]:
    """One line per kind of test: the commands and their range."""
    for kind, trials in by_kind.items():
        parts = [f"{kind}: {len(trials)} test{'s' * (len(trials) > 1)}"]
        for name in (rig.effort_channel, rig.position_channel, "pressure_a_pa", "pressure_b_pa"):
            values = [t[name] for t in trials if name in t]
            if values:
                joined = np.concatenate(values)
                parts.append(f"{name} {joined.min():.4g} to {joined.max():.4g}")
        yield ", ".join(parts)


def _static(trials: Sequence[Trial], rig: Rig) -> Identification:
    if not trials:
        return Identification(
            "static friction", False, "needs friction-static tests: ramp the torque from zero"
        )
    moved = sum(not is_held(t, rig) for t in trials)
    if not moved:
        return Identification(
            "static friction", False, "no ramp reaches motion: ramp the torque further"
        )
    return Identification("static friction", True, f"{moved} of {len(trials)} ramps reach motion")


def _sliding_or_motion(by_kind: TrialsByKind, rig: Rig) -> Iterator[Identification]:
    names = ("Coulomb friction", "viscous friction", "torque offset", "inertia")
    trials = [t for kind in _FRICTION_KINDS for t in by_kind.get(kind, ())]
    trials = [t for t in trials if rig.position_channel in t and not is_held(t, rig)]
    if not trials:
        for name in names:
            yield Identification(
                name, False, "needs friction-sliding or friction-motion tests in both directions"
            )
        return
    inflation = _variance_inflation(trials, rig)
    remedy = {
        names[0]: "move in both directions",
        names[1]: "slide at two or more speeds (torque levels)",
        names[2]: "move in both directions",
        names[3]: "accelerate: reverse quickly, as a clipped sine of torque does",
    }
    for name, factor in zip(names, inflation, strict=True):
        good = bool(factor < _HIGHEST_VARIANCE_INFLATION)
        shown = f"variance inflation {factor:.1f}" if np.isfinite(factor) else "no excitation"
        yield Identification(name, good, shown if good else f"{shown}: {remedy[name]}")


def _variance_inflation(trials: Sequence[Trial], rig: Rig) -> FloatArray:
    """Of (sign v, v, 1, acceleration) over the moving samples, shape (4,)."""
    rows = []
    for trial in trials:
        velocity, acceleration = _velocity_and_acceleration(trial, rig.position_channel)
        moving = np.abs(velocity) > 0.05 * np.max(np.abs(velocity))
        v, a = velocity[moving], acceleration[moving]
        rows.append(np.column_stack([np.sign(v), v, np.ones_like(v), a]))
    matrix = np.concatenate(rows)
    norm = np.sqrt(np.sum(matrix**2, axis=0))
    norm[norm == 0.0] = np.inf
    scaled = matrix / norm
    gram = scaled.T @ scaled
    values, vectors = np.linalg.eigh(gram)
    values = np.maximum(values, 1e-12)
    inflation = np.sum(vectors**2 / values, axis=1)
    return np.where(np.isfinite(norm), inflation, np.inf)


def _velocity_and_acceleration(trial: Trial, position: str) -> tuple[FloatArray, FloatArray]:
    """Per second and per second squared, from the zero-phase filtered position, (n,) each."""
    grid = signals.uniform_grid(trial.time)
    period = float(grid[1] - grid[0])
    cutoff = min(signals.DEFAULT_CUTOFF_HZ, 0.2 / period)
    smooth = signals.lowpass(signals.resample(trial.time, trial[position], grid), period, cutoff)
    return signals.first_derivative(smooth, period), signals.second_derivative(smooth, period)


def _discrete(trials: Sequence[Trial], rig: Rig, valve: str) -> Iterator[Identification]:
    pressure = f"pressure_{valve}_pa"
    used = [t for t in trials if is_active(t, f"valve_{valve}") and pressure in t]
    air = rig.air
    parameters = ("choked filling flow", "c_fill", "choked exhaust flow", "c_dis")
    if not used or air is None:
        why = f"needs a valve-discrete test of valve {valve.upper()}: piston held, on 3 s, off"
        for name in parameters:
            yield Identification(f"valve {valve.upper()} {name}", False, why)
        return
    boundary_fill = CRITICAL_RATIO * air.supply_pressure_pa
    boundary_dis = air.atmospheric_pressure_pa / CRITICAL_RATIO
    filling = np.concatenate([t[pressure][t[f"valve_{valve}"] > 0] for t in used])
    exhaust = np.concatenate([_after_on(t, valve) for t in used])
    checks = (
        (filling, np.less, boundary_fill, "fill from the atmosphere"),
        (filling, np.greater, boundary_fill, "hold the valve on longer"),
        (exhaust, np.greater, boundary_dis, "fill further before switching off"),
        (exhaust, np.less, boundary_dis, "record longer after switching off"),
    )
    for name, (values, relation, boundary, remedy) in zip(parameters, checks, strict=True):
        share = int(np.count_nonzero(relation(values, boundary)))
        good = share >= 20
        reason = f"{share} samples in its regime (boundary {boundary:.0f} Pa)"
        yield Identification(
            f"valve {valve.upper()} {name}", good, reason if good else f"{reason}: {remedy}"
        )


def _after_on(trial: Trial, valve: str) -> FloatArray:
    command = trial[f"valve_{valve}"] > 0
    first = int(np.argmax(command))
    later = ~command
    later[:first] = False
    return trial[f"pressure_{valve}_pa"][later]


def _pwm(trials: Sequence[Trial], valve: str) -> Iterator[Identification]:
    name, pressure = f"duty_{valve}", f"pressure_{valve}_pa"
    filling: set[float] = set()
    discharging: set[float] = set()
    for trial in trials:
        if name not in trial or pressure not in trial:
            continue
        values = trial[pressure]
        rising = np.mean(values[-20:]) >= np.mean(values[:5])
        (filling if rising else discharging).add(round(float(np.median(trial[name])), 4))
    for what, duties in (("filling", filling), ("discharging", discharging)):
        duties.discard(0.0)
        good = len(duties) >= _FEWEST_DUTIES
        reason = f"{len(duties)} duties"
        if not good:
            reason += f": needs valve-pwm tests, {what}, with at least {_FEWEST_DUTIES} duties"
        yield Identification(f"valve {valve.upper()} PWM surface, {what}", good, reason)
