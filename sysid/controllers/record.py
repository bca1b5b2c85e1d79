"""What a controller was given, from the record of a closed loop: estimates and references."""

from __future__ import annotations

import numpy as np

from sysid.controllers.cases import PERIOD_S, Case, ClosedLoopRun
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.sensing import filter_coefficients


def estimates_of(case: Case, run: ClosedLoopRun) -> StateEstimate:
    """What the controller was given at every tick, (n,), as `sense` makes it."""
    from scipy.signal import lfilter

    (b, a) = filter_coefficients(PERIOD_S, case.sensors.cutoff_hz)
    raw = np.diff(run.measured, prepend=run.measured[0]) / PERIOD_S
    change = np.diff(raw, prepend=0.0) / PERIOD_S
    return StateEstimate(
        tick=np.arange(len(run.time)),
        position=run.measured,
        velocity=lfilter(b, a, raw),
        acceleration=lfilter(b, a, change),
        raw_velocity=raw,
        pressure_a=run.measured_a,
        pressure_b=run.measured_b,
    )


def true_states(run: ClosedLoopRun) -> StateEstimate:
    """The plant's own state at every tick, (n,), as an estimate without errors."""
    return StateEstimate(
        tick=np.arange(len(run.time)),
        position=run.position,
        velocity=run.velocity,
        acceleration=np.gradient(run.velocity, PERIOD_S),
        raw_velocity=run.velocity,
        pressure_a=run.pressure_a,
        pressure_b=run.pressure_b,
    )


def references_of(run: ClosedLoopRun) -> Reference:
    """The reference at every tick, (n,), without a preview."""
    return Reference(*run.reference.T)


__all__ = ["estimates_of", "references_of", "true_states"]
