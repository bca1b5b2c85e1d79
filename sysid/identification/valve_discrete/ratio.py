"""Where the choked boundary lies in the data: the critical ratio's profile (3.5.1).

The sum of squares over the critical ratio is not a parabola: where the fitted law is
continuous at the boundary it is flat at its minimum, and it has corners where the boundary
passes a sample. It is therefore profiled over the filling (or the discharge) alone, with the
flows and the delay refitted at each ratio.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.linear import Estimate, t_quantile
from sysid.identification.valve_discrete.curve import CurveFit, fit_curves, fitted_valve
from sysid.identification.valve_discrete.trials import EDGE_GUARD_S, FEWEST_ROWS, Piece

# The plausible range, in steps finer than the valleys of the profile: a law that jumps has two or
# three of them, 0.03 and more apart, each about as wide.
_GRID = tuple(float(r) for r in np.linspace(0.30, 0.80, 51))
_RESOLUTION = 5e-4
_BEFORE_S = 0.03
_WIDEST = 0.4


@dataclass(frozen=True)
class Direction:
    """Filling or discharging: the ratio's name, and the parameters fitted with it."""

    ratio: str
    free: tuple[str, str, str]
    filling: bool


FILL = Direction(
    "critical_ratio_fill", ("choked_flow_fill_kg_s", "c_fill", "on_delay_s"), filling=True
)
DISCHARGE = Direction(
    "critical_ratio_dis", ("choked_flow_dis_kg_s", "c_dis", "off_delay_s"), filling=False
)
# Of two valves the one that empties opens, too.
BLEED = dataclasses.replace(DISCHARGE, free=("choked_flow_dis_kg_s", "c_dis", "on_delay_s"))


def directions(curves: CurveFit) -> tuple[Direction, Direction]:
    """Filling, and discharging by the same valve or by one of its own."""
    two = all(piece.chamber.bleeds is not None for piece in curves.problem.pieces)
    return FILL, BLEED if two else DISCHARGE


def critical_ratio(curves: CurveFit, direction: Direction) -> Estimate:
    """The critical ratio of one direction with its profile's 95 % interval.

    Initial pressures, supply and atmosphere stay as fitted to the whole curve.
    """
    pieces = _transients(curves, direction)
    if not pieces:
        return Estimate.unidentified("-", "no test crosses the boundary in this direction")
    sums = _profile(curves, pieces, direction)
    profile = {r: sums(r) for r in _GRID}
    valleys = _valleys(profile)
    best = min(profile, key=profile.__getitem__)
    if best in (_GRID[0], _GRID[-1]):
        return Estimate.unidentified("-", "the pressure curve shows no boundary between regimes")
    # The bottom of each: one that is as good as the best belongs to the interval.
    profile |= dict(_bottom(sums, *bracket) for bracket in valleys)
    value = min(profile, key=profile.__getitem__)
    least = profile[value]
    rows = sum(len(p.pressure) for p in pieces)
    column = curves.fit.names.index(direction.free[0])
    quantile = t_quantile(float(curves.covariance.dof[column]))
    limit = least + curves.inflation(column) * least / rows * quantile**2
    points = sorted(profile.items())
    lower = _crossing(sums, value, points, limit)
    upper = _crossing(sums, value, points[::-1], limit)
    if lower is None or upper is None or upper - lower > _WIDEST:
        why = "the fitted law is nearly continuous at the boundary, which is therefore not visible"
        return Estimate.unidentified("-", why)
    std = (upper - lower) / (2.0 * t_quantile(math.inf))
    return Estimate(value, std, "-", (lower, upper))


def _profile(
    curves: CurveFit, pieces: Sequence[Piece], direction: Direction
) -> Callable[[float], float]:
    """Sum of squares, Pa^2, over the ratio; each fit starts from the nearest earlier one.

    A ratio is fitted once: from another start its sum would be another, and a bracket of where the
    sums cross a limit be none.
    """
    known = {0.53: fitted_valve(curves)}

    @functools.cache
    def sums(ratio: float) -> float:
        near = known[min(known, key=lambda r: abs(r - ratio))]
        at: dict[str, Any] = {direction.ratio: float(ratio)}
        start = dataclasses.replace(near, **at)
        refit = fit_curves(pieces, start, direction.free, 1e-5)
        known[float(ratio)] = fitted_valve(refit)
        return refit.fit.sum_of_squares

    return sums


def _valleys(profile: Mapping[float, float]) -> list[tuple[float, float]]:
    """The brackets, in ratio, of the profile's minima inside its range."""
    ratios = sorted(profile)
    sums = np.array([profile[r] for r in ratios])
    lowest = (sums[1:-1] <= sums[:-2]) & (sums[1:-1] <= sums[2:])
    return [(ratios[i], ratios[i + 2]) for i in np.flatnonzero(lowest)]


def _bottom(sums: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """The lowest point of a valley: ratio and sum of squares, Pa^2."""
    from scipy import optimize

    found = optimize.minimize_scalar(
        sums, bounds=(low, high), method="bounded", options={"xatol": _RESOLUTION}
    )
    return float(found.x), float(found.fun)


def _crossing(
    sums: Callable[[float], float],
    value: float,
    from_outside: Sequence[tuple[float, float]],
    limit: float,
) -> float | None:
    """The ratio at which the profile falls below `limit` for the last time before `value`.

    `from_outside`: the grid from one end; None where the profile is below the limit there.
    """
    from scipy import optimize

    outside = None
    side = math.copysign(1.0, from_outside[0][0] - value)
    for ratio, total in from_outside:
        if (ratio - value) * side <= 0.0 or total <= limit:
            break
        outside = ratio
    if outside is None:
        return None
    inside = ratio if (ratio - value) * side > 0.0 else value
    return float(optimize.brentq(lambda r: sums(r) - limit, outside, inside, xtol=_RESOLUTION))


def _transients(curves: CurveFit, direction: Direction) -> list[Piece]:
    """The rows of each piece's first filling (or discharge), everything but the law known."""
    pieces = []
    for i, piece in enumerate(curves.problem.pieces):
        c = piece.chamber
        edges, ends = (c.opens, c.closes) if direction.filling else c.empties
        edge = next((e for e in edges if c.time[0] <= e < c.time[-1]), None)
        if edge is None:
            continue
        end = next((e for e in ends if e > edge), math.inf)
        fitted = piece.pressure + curves.residuals(i)
        rest = (
            float(np.mean(c.supply)) + curves.value("supply_shift", i)
            if direction.filling
            else curves.value("atmosphere", i)
        )
        inside = (c.time >= edge) & (c.time < end)
        moving = np.flatnonzero(inside & (np.abs(fitted - rest) > piece.noise))
        if len(moving) < FEWEST_ROWS:
            continue
        until = min(c.time[moving[-1]] + EDGE_GUARD_S, end)
        rows = (c.time >= edge - _BEFORE_S) & (c.time < until)
        pieces.append(_known(curves, i, rows, float(fitted[np.argmax(rows)])))
    return pieces


def _known(curves: CurveFit, index: int, rows: NDArray[np.bool_], initial: float) -> Piece:
    piece = curves.problem.pieces[index]
    c = piece.chamber
    time = c.time[rows]
    later = c.closes > time[0] - EDGE_GUARD_S
    opens = np.where(c.opens[later] < time[0], -np.inf, c.opens[later])
    return dataclasses.replace(
        piece,
        chamber=dataclasses.replace(c, time=time, opens=opens, closes=c.closes[later]),
        pressure=piece.pressure[rows],
        initial=initial,
        fits_initial=False,
        supply_shift=curves.value("supply_shift", index),
        fits_supply=False,
        atmosphere=curves.value("atmosphere", index),
        fits_atmosphere=False,
    )
