"""Samples at which it is not known on which side of a valve's choked boundary they are.

There the base law jumps, by a third of the flow or more. An effect that lowers the supply
pressure, or raises that of the exhaust, moves the boundary: what is near where it may be says
nothing of any effect, and a fit is trapped there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from sysid.diagnosis.actuator.samples import Traces
from sysid.diagnosis.actuator.states import point_of
from sysid.plant import plant, valve_laws
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.types import BoolArray, FloatArray

# As a share of the boundary: what noise and smoothing may hide.
_NEAR_BOUNDARY = 0.02


def near_boundaries(
    traces: Traces, model: Model, side: str, moving: Sequence[CatalogueEffect]
) -> BoolArray:
    """Samples (n,) near a choked boundary, or where one of the effects `moving` may take it."""
    share, pressure = traces.is_open(side), traces.pressure(side)
    atmosphere = float(model.parameters.atmosphere)
    valve = model.parameters.valve(side)
    fill = valve_laws.filling_boundary(valve, traces.supply)
    exhaust = np.asarray(valve_laws.exhaust_boundary(valve, atmosphere))
    fills, exhausts = [fill], [exhaust]
    for effect in moving:
        moved = model + effect
        point = point_of(traces, moved)
        on: dict[str, Any] = {f"open_{side}": np.ones(len(traces))}
        off: dict[str, Any] = {f"open_{side}": np.zeros(len(traces))}
        fills.append(np.asarray(plant.filling_boundary(side, replace(point, **on), moved)))
        exhausts.append(np.asarray(plant.exhaust_boundary(side, replace(point, **off), moved)))
    # A boundary crossed between two samples is uncertain at both.
    travel = np.abs(np.gradient(pressure))

    def within(bounds: Sequence[FloatArray], at: FloatArray) -> BoolArray:
        margin = _NEAR_BOUNDARY * at + travel
        low, high = reduce(np.minimum, bounds), reduce(np.maximum, bounds)
        return np.asarray((pressure > low - margin) & (pressure < high + margin))

    vents = point_of(traces, model).vents(side)
    near = ((share > 0.0) & within(fills, fill)) | ((vents > 0.0) & within(exhausts, exhaust))
    return np.asarray(near)


__all__ = ["near_boundaries"]
