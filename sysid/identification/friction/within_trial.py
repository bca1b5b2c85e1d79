"""Sliding friction within each trial, where the speed changes much under the set effort.

A pendulum that moves uphill never moves steadily: levels do not separate speeds then, but
each trial covers many speeds. Its motion is integrated twice instead of being
differentiated twice,

    inertia x - (double integral of the applied effort)
        = c0 + c1 t - b t^2 / 2 - viscous (integral of x - x0),

with b = coulomb s + offset, so that the encoder's noise enters unamplified.
"""

from __future__ import annotations

import numpy as np

from sysid.estimation.linear import linear_fit
from sysid.recording.recording import Recording
from sysid.types import FloatArray


def trial_law(trial: Recording, start: int, stop: int, inertia: float) -> tuple[float, float]:
    """Friction at zero speed (signed) and its slope over speed, over rows [start, stop).

    `inertia` is the rig file's, kg m2 or kg; what the trial's payload is more is added.
    """
    rows, dt = slice(start, stop), trial.period
    x = trial.position[rows] - trial.position[start]
    measured = (trial.cylinder - trial.load_effort)[rows]
    # The motor's command holds from its row to the next; the pressures change in between.
    held = trial.motor[rows][:-1] + 0.5 * (measured[:-1] + measured[1:])
    impulse = _running(held) * dt
    twice = _running(impulse[:-1] * dt + 0.5 * held * dt**2)
    distance = _running(0.5 * (x[:-1] + x[1:])) * dt
    t = dt * np.arange(len(x))
    columns = np.column_stack([np.ones(len(x)), t, -0.5 * t**2, -distance])
    names = ("start", "start speed", "Coulomb friction", "viscous friction")
    fit = linear_fit(columns, (inertia + trial.added_inertia) * x - twice, names=names)
    return float(fit.coefficients[2]), float(fit.coefficients[3])


def _running(steps: FloatArray) -> FloatArray:
    """Cumulative sums that start with zero; one longer than `steps`."""
    return np.concatenate([[0.0], np.cumsum(steps)])
