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
from sysid.identification.friction.counted_onset import FEWEST
from sysid.recording.recording import Recording
from sysid.types import FloatArray


def trial_law(trial: Recording, start: int, stop: int, inertia: float) -> tuple[float, float]:
    """Friction at zero speed (signed) and its slope over speed, over rows [start, stop).

    `inertia` is the rig file's, kg m2 or kg; what the trial's payload is more is added.
    """
    part = between_edges(trial.part(start, stop, trial.label))
    x, dt = part.position - part.position[0], part.period
    # The motor's command holds from its row to the next; pressures and position change in between.
    held = part.motor[:-1]
    impulse = _running(held) * dt
    twice = _running(impulse[:-1] * dt + 0.5 * held * dt**2)
    twice += _integral(part.cylinder - part.load_effort, dt, 2)
    t = dt * np.arange(len(x))
    columns = np.column_stack([np.ones(len(x)), t, -0.5 * t**2, -_integral(x, dt, 1)])
    names = ("start", "start speed", "Coulomb friction", "viscous friction")
    fit = linear_fit(columns, (inertia + part.added_inertia) * x - twice, names=names)
    return float(fit.coefficients[2]), float(fit.coefficients[3])


def between_edges(part: Recording) -> Recording:
    """A recording from its first to its last count, the position between them read off the edges.

    A reading of a coarse encoder says only within which count the shaft is; an edge says where it
    is. A stretch of readings that ends within a count is off by a part of it, and by the same part
    in each test that ends at the same place. As it is where most rows count, or hardly any.
    """
    x = part.position
    edges = np.flatnonzero(np.diff(x))
    if 2 * len(edges) >= len(x) or len(edges) < FEWEST:
        return part
    from scipy.interpolate import PchipInterpolator  # slow to import

    rows = slice(int(edges[0]) + 1, int(edges[-1]) + 1)
    places = 0.5 * (x[edges] + x[edges + 1])
    read = PchipInterpolator(edges + 0.5, places)(np.arange(rows.start, rows.stop))
    return part.part(rows.start, rows.stop, part.label).with_position(read)


def _integral(values: FloatArray, period: float, times: int) -> FloatArray:
    """Integral (n,) of a smooth signal from its first row on, so many times over.

    Trapezoids would take a bent course for a larger one at each row.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    t = period * np.arange(len(values))
    return np.asarray(CubicSpline(t, values).antiderivative(times)(t))


def _running(steps: FloatArray) -> FloatArray:
    """Cumulative sums that start with zero; one longer than `steps`."""
    return np.concatenate([[0.0], np.cumsum(steps)])
