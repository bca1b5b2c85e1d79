"""What a tank's coefficients by the thesis are worth where the gas has a temperature of its own.

By 3.3.6 the gas takes no heat from the wall, and keeps its temperature. A tank that empties slowly
next to what its wall conducts falls as many times more slowly as its heat capacities differ (1.4),
and gas that cools falls more slowly than by 3.3.6 too. Both leave much the shape of the discharge,
so that the law follows it with coefficients that are too small. With the flow out of gas that has a
temperature, and a wall of every conductance, the law is fitted again: the conductances that the
tests do not rule out say what the coefficients may be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.diagnosis.bench import tank_gas
from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.fitting import FittedLaw, fit_law
from sysid.estimation.linear import LEVEL
from sysid.plant.base import Parameters
from sysid.types import FloatArray

# Conductances of the wall: how many times the gas is warmed through while its pressure falls, from
# none to all that can be told from more. In between the coefficients go over steadily.
_TIMES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)


@dataclass(frozen=True)
class WallRange:
    """A coefficient with gas that has a temperature, over that by 3.3.6: at the conductances that
    the tests do not rule out, from `low` to `high`, `best` at the likeliest.

    `reaches_none` and `reaches_all`: whether a wall that conducts nothing, or all, is among them.
    """

    low: float
    best: float
    high: float
    reaches_none: bool
    reaches_all: bool

    @property
    def text(self) -> str:
        """ "1.26 to 1.40 times"; one number where both are the same."""
        low, high = f"{self.low:.2f}", f"{self.high:.2f}"
        return f"{low} times" if low == high else f"{low} to {high} times"


def wall_ranges(
    component: Component, by_share: Callable[[float], Component], full: float
) -> dict[str, WallRange]:
    """Each coefficient's, by name, of `component`, a tank under the thesis' law.

    `by_share` the tank whose wall leaves a share of the expansion adiabatic, `full` the conductance
    (as a share, too) that warms the gas through once while its pressure falls.
    """
    every = range(len(component.tests))
    without = fit_law(component, (), every)
    odds = (1.0 - full) / full
    shares = [1.0 / (1.0 + times * odds) for times in _TIMES]
    fits: list[FittedLaw] = []
    for share in (*shares, 0.0):
        near = fits[-1].law if fits else without.law
        fits.append(fit_law(by_share(share), (), every, near))
    beyond = _deviances(fits)
    names = [p.name for p in component.parameters()]
    by_fit = np.array([[f.law.values[n] / without.law.values[n] for n in names] for f in fits])
    open_ones = beyond <= 0.0
    ends = np.vstack([by_fit[open_ones], *_crossings(beyond, by_fit)])
    best = by_fit[int(np.argmin(beyond))]
    return {
        name: WallRange(
            float(ends[:, i].min()),
            float(best[i]),
            float(ends[:, i].max()),
            bool(open_ones[0]),
            bool(open_ones[-1]),
        )
        for i, name in enumerate(names)
    }


def _deviances(fits: Sequence[FittedLaw]) -> FloatArray:
    """Twice the log of the likelihood's ratio to the best fit's, (k,), less what an unknown number
    more may give by chance: below 0 where the tests do not rule a fit out."""
    from scipy.special import chdtri

    squares = np.array([max(f.fit.sum_of_squares, 1e-300) for f in fits])
    least = fits[int(np.argmin(squares))]
    count = max(least.independent_samples - len(least.fit.values) - 1.0, 1.0)
    return np.asarray(count * np.log(squares / squares.min()) - chdtri(1, 1.0 - LEVEL))


def _crossings(beyond: FloatArray, values: FloatArray) -> list[FloatArray]:
    """Values (names,) where the line between two neighbours, (k,) and (k, names), passes 0."""
    found = []
    for i in range(len(beyond) - 1):
        here, there = float(beyond[i]), float(beyond[i + 1])
        if (here <= 0.0) != (there <= 0.0) and math.isfinite(here - there):
            found.append(values[i] + here / (here - there) * (values[i + 1] - values[i]))
    return found


def once_through(p: Parameters, volume: float, time: float) -> float:
    """The share that a wall leaves adiabatic which warms a tank's gas (of `volume` m3, at the
    atmosphere's pressure) through once in `time` s."""
    held = float(p.atmosphere) * volume / float(p.temperature)
    conductance = held / ((float(p.heat_capacity_ratio) - 1.0) * time)
    return tank_gas.adiabatic_share(conductance, volume)


__all__ = ["WallRange", "once_through", "wall_ranges"]
