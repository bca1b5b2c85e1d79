"""The line of zero flow, where a filling and a discharging surface meet.

A filling test ends just above it and a discharging test just below: a surface of one direction
alone has its largest error there, and its domain does not reach across. Points of the other
direction next to the line tie both surfaces to the same duty.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid.surfaces.domain import DUTY_RESOLUTION, Domain
from sysid.surfaces.samples import SurfacePoints
from sysid.types import BoolArray

# Of the largest flow in either direction: how far across the line a surface is carried.
TIE_SHARE = 0.1


def tie_points(own: SurfacePoints, other: SurfacePoints, domain: Domain) -> SurfacePoints:
    """Points of the other direction within `TIE_SHARE` of zero flow, at pressures of `domain`.

    Tests are numbered; those of the other direction are -1, -2, ... here.
    """
    largest = max(float(np.abs(p.flow).max(initial=0.0)) for p in (own, other))
    low, high = domain.pressure_range
    inside = (other.pressure >= low) & (other.pressure <= high)
    ties = other.select(inside & (np.abs(other.flow) <= TIE_SHARE * largest))
    return ties.relabelled(-1 - ties.test.astype(np.intp))


def apart_from(ties: SurfacePoints, duty: NDArray[np.float64]) -> BoolArray:
    """Which ties (k,) are of none of the duties (n,): a held-out test's twin says too much."""
    levels = np.unique(np.rint(duty / DUTY_RESOLUTION))
    return ~np.isin(np.rint(ties.duty / DUTY_RESOLUTION), levels)


__all__ = ["TIE_SHARE", "apart_from", "tie_points"]
