"""How well a run followed its reference (thesis 6.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sysid.controllers.trajectories import SETTLED_S
from sysid.types import FloatArray

LOST_RAD = 0.1
"""RMSE from which on the thesis calls a loop unstable (5.4.1.3), rad."""


@dataclass(frozen=True)
class TrackingMetrics:
    """rad or m. `rmse` and `mae` (the largest absolute error) over the whole run; over the
    settled stretch `sse`, the mean absolute error, and `ssa`, the range of the position
    (both NaN where the run does not reach it)."""

    rmse: float
    mae: float
    sse: float
    ssa: float


def tracking_metrics(
    time: FloatArray,
    reference: FloatArray,
    position: FloatArray,
    settled: tuple[float, float] = SETTLED_S,
) -> TrackingMetrics:
    """Metrics of one run; all (n,), `settled` s. Raises ValueError where lengths differ."""
    if not len(time) == len(reference) == len(position) > 0:
        raise ValueError("time, reference and position must be of one length, and not empty")
    error = reference - position
    during = (time >= settled[0]) & (time <= settled[1])
    has_settled = bool(during.any())
    return TrackingMetrics(
        rmse=float(np.sqrt(np.mean(error**2))),
        mae=float(np.max(np.abs(error))),
        sse=float(np.mean(np.abs(error[during]))) if has_settled else math.nan,
        ssa=float(np.ptp(position[during])) if has_settled else math.nan,
    )


def is_lost(position: FloatArray, reference: FloatArray, reach: float) -> bool:
    """Whether a loop is unstable: not finite, beyond `reach` (rad), or off by LOST_RAD in RMSE."""
    if not np.isfinite(position).all() or np.max(np.abs(position)) > reach:
        return True
    return bool(np.sqrt(np.mean((reference - position) ** 2)) >= LOST_RAD)


__all__ = ["LOST_RAD", "TrackingMetrics", "is_lost", "tracking_metrics"]
