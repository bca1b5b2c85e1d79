"""Residuals of the equations of shaft and chambers at given points, through the ports.

Measured less modelled, thesis 3.4.2 and 3.5.2. `acceleration` rad/s2 or m/s2 and `rate` Pa/s are
the measured ones, (n,) as the points are.
"""

from __future__ import annotations

import numpy as np

from sysid.plant import plant
from sysid.plant.ports import Model, Point
from sysid.types import FloatArray


def effort_residual(point: Point, acceleration: FloatArray, model: Model) -> FloatArray:
    """The effort (n,), Nm or N, along positive motion that accelerates the inertia and that the
    model does not give."""
    applied = plant.applied_effort(point, model)
    friction = plant.sliding_friction(point, model)
    return np.asarray(point.parameters.inertia * acceleration - (applied - friction))


def breakaway_residual(point: Point, model: Model) -> FloatArray:
    """The applied effort less the model's breakaway effort, (n,), Nm or N."""
    applied = np.asarray(plant.applied_effort(point, model))
    limit = plant.breakaway_effort(applied, point, model)
    return np.asarray(np.abs(applied) - limit)


def modelled_rate(side: str, point: Point, model: Model) -> FloatArray:
    """A chamber's pressure rate (n,), Pa/s; each sample holds a share of filling and one of
    exhaust."""
    flow = plant.shared_flow(side, point.is_open(side), point, model)
    return np.asarray(plant.pressure_rate(side, flow, point, model))


__all__ = ["breakaway_residual", "effort_residual", "modelled_rate"]
