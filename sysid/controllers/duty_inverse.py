"""From wanted flow to duty: the averaged law, or a surface of the thesis as a table.

An inverse is anything with `duty(flow, pressure)`: kg/s and Pa in, 0 to 1 out, (lanes,) or any
shapes that broadcast, for numpy and jax alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sysid.plant.base import Array, array_namespace
from sysid.surfaces.ann import DutyNetwork
from sysid.surfaces.averaged import AveragedLaw
from sysid.surfaces.bipolynomial import Bipolynomial
from sysid.types import FloatArray

# Nodes over flow and pressure; between them a table is bilinear.
_NODES = 97


class DutyInverse(Protocol):
    """The duty at which one valve passes a wanted mean flow."""

    def duty(self, flow: Array, pressure: Array) -> Array:
        """Duty, 0 to 1; saturated where the valve cannot pass the flow."""


@dataclass(frozen=True)
class TabulatedInverse:
    """A surface's own inverse, tabulated over flow and pressure; saturated at the edges.

    `filling` holds for flows from 0 to `flow_high`, `emptying` from `flow_low` to 0, each
    (nodes, nodes), rows flow and columns pressure from `pressure_low` to `pressure_high`;
    kg/s, Pa. With the lanes stacked: (lanes, nodes, nodes), and the limits (lanes,).
    """

    filling: Array
    emptying: Array
    flow_low: Array
    flow_high: Array
    pressure_low: Array
    pressure_high: Array

    def duty(self, flow: Array, pressure: Array) -> Array:
        """See `DutyInverse`."""
        xp = array_namespace(flow, pressure)
        column = (pressure - self.pressure_low) / (self.pressure_high - self.pressure_low)
        into = _bilinear(self.filling, flow / self.flow_high, column)
        out = _bilinear(self.emptying, 1.0 - flow / self.flow_low, column)
        return xp.where(flow >= 0.0, into, out)


@dataclass(frozen=True)
class SurfaceInverse:
    """A valve's two surfaces themselves, with numpy; `tabulated` makes of them what jax takes."""

    filling: Bipolynomial | DutyNetwork
    emptying: Bipolynomial | DutyNetwork

    def duty(self, flow: Array, pressure: Array) -> Array:
        """See `DutyInverse`; each surface saturates where it has seen no data."""
        into, out = (s.duty(flow, pressure)[0] for s in (self.filling, self.emptying))
        return np.where(flow >= 0.0, into, out)


def _bilinear(table: Array, row: Array, column: Array) -> Array:
    """`table` at shares 0 to 1 of its last two axes; one table, or one for each lane."""
    xp = array_namespace(row, column)
    cells, rests = [], []
    for share, size in zip((row, column), table.shape[-2:], strict=True):
        place = xp.clip(share, 0.0, 1.0) * (size - 1)
        # NaN is in no cell, and is the result of any.
        cell = xp.where(place < size - 2, xp.floor(place), size - 2)
        cells.append(cell.astype(int))
        rests.append(place - cell)
    (i, j), (s, t) = cells, rests
    lane: tuple[Any, ...] = (xp.arange(len(table)),) if table.ndim == 3 else ()

    def along(row: Array) -> Array:
        return (1.0 - t) * table[(*lane, row, j)] + t * table[(*lane, row, j + 1)]

    return (1.0 - s) * along(i) + s * along(i + 1)


_Inverse = Callable[[FloatArray, FloatArray], FloatArray]


def tabulated(
    filling: _Inverse,
    emptying: _Inverse,
    flows: tuple[float, float],
    pressures: tuple[float, float],
) -> TabulatedInverse:
    """The inverses of a valve's two surfaces as one table; `flows` lowest and highest, kg/s."""
    low, high = flows
    pressure = np.linspace(*pressures, _NODES)[None, :]
    rows = np.linspace(0.0, high, _NODES)[:, None], np.linspace(low, 0.0, _NODES)[:, None]
    return TabulatedInverse(
        filling=filling(rows[0], pressure),
        emptying=emptying(rows[1], pressure),
        flow_low=low,
        flow_high=high,
        pressure_low=pressures[0],
        pressure_high=pressures[1],
    )


def bipolynomials(
    law: AveragedLaw, pressures: tuple[float, float]
) -> tuple[Bipolynomial, Bipolynomial]:
    """Filling and discharging bipolynomial of a law's mean flow, on the grid of 3.7.2.

    Duties by steps of 0.01 (Table 3.7.1), pressures (Pa) from the atmosphere to the supply.
    """
    duty, pressure = np.meshgrid(np.arange(0.01, 0.96, 0.01), np.linspace(*pressures, 81))
    flow = np.asarray(law.flow(duty, pressure))
    fits = []
    for chosen in (flow > 0.0, flow < 0.0):
        x = np.stack([duty[chosen], pressure[chosen]], axis=1)
        fits.append(Bipolynomial().fit(x, flow[chosen]))
    return fits[0], fits[1]


def bipolynomial_inverse(law: AveragedLaw, pressures: tuple[float, float]) -> TabulatedInverse:
    """The thesis' inverse (3.7.3) of a law's mean flow, from bipolynomials fitted to it."""
    fill, out = bipolynomials(law, pressures)
    grid = np.linspace(*pressures, 81)
    return tabulated(
        lambda m, p: fill.duty(m, p)[0],
        lambda m, p: out.duty(m, p)[0],
        (float(np.min(law.closed_flow(grid))), float(np.max(law.open_flow(grid)))),
        pressures,
    )


__all__ = [
    "DutyInverse",
    "SurfaceInverse",
    "TabulatedInverse",
    "bipolynomial_inverse",
    "bipolynomials",
    "tabulated",
]
