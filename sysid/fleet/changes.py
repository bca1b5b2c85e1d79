"""The date from which a series of estimates changes.

A series of a few dates with known standard errors is compared with two kinds of change, at every
date: a step from that date on, and a growth in proportion to time that begins after the date
before. The test is the maximum of the likelihood ratio over all of them (Worsley, "On the
likelihood ratio test for a shift in location of normal populations", JASA 74, 1979, 365-367), with
weights 1/s^2. Where the scatter about the change is larger than the standard errors say, these are
scaled up by it (Birge, Phys. Rev. 40, 1932, 207): a rig is never quite the same on two days. That
makes each ratio an F statistic at most, and Bonferroni's bound over all candidates makes the
p-value one that is never too small, however the candidates depend on one another.

Packages for change points (`ruptures`, for example) search long series with a penalty: they give
places but no p-value, and know neither standard errors nor uneven dates. With ten dates all places
can be tried, and the rate of false alarms is what matters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sysid.types import FloatArray

LEAST_DATES = 4
Shape = Literal["step", "growth"]


@dataclass(frozen=True)
class Change:
    """The most likely change of a series.

    `first`: the number of the first date on which it shows; `size` its size at the last date, with
    its standard error `std`; `before` the level until then, `dispersion` the factor by which the
    standard errors are scaled up (1: none). `p_value` of no change at any date.
    """

    first: int
    shape: Shape
    before: float
    size: float
    std: float
    dispersion: float
    p_value: float

    def at(self, days: FloatArray) -> FloatArray:
        """The fitted course (n,) over the series' own days."""
        return self.before + self.size * _shape(days, self.first, self.shape)

    def to_json(self) -> dict[str, Any]:
        """In JSON types."""
        return dict(vars(self))


def change_in(days: FloatArray, values: FloatArray, std: FloatArray) -> Change | None:
    """The most likely change of values (n,) with standard errors over days (n,), ascending.

    None where there are fewer than four dates: a change would have no scatter to stand out from.
    """
    if len(np.unique(days)) < LEAST_DATES:
        return None
    weights = 1.0 / np.square(std)
    centred = values - np.average(values, weights=weights)
    total = float(weights @ np.square(centred))
    dof = len(values) - 2
    found: list[tuple[float, int, Shape]] = []
    for first, shape in _candidates(days):
        x = _shape(days, first, shape)
        x = x - np.average(x, weights=weights)
        gain = float(weights @ (x * centred)) ** 2 / float(weights @ (x * x))
        left = max(total - gain, 0.0) / dof
        found.append((gain / max(left, 1.0), first, shape))
    from scipy.special import fdtrc

    statistic, first, shape = max(found, key=lambda one: one[0])
    p_value = min(len(found) * float(fdtrc(1, dof, statistic)), 1.0)
    return _fitted(days, values, weights, first, shape, p_value)


def _candidates(days: FloatArray) -> Iterator[tuple[int, Shape]]:
    """Every date but the first; a growth that begins before the last one is a step."""
    for first in range(1, len(days)):
        if days[first] > days[first - 1]:
            yield first, "step"
            if days[first] < days[-1]:
                yield first, "growth"


def _shape(days: FloatArray, first: int, shape: Shape) -> FloatArray:
    """1 at the last date, 0 before the change."""
    if shape == "step":
        return (np.arange(len(days)) >= first).astype(float)
    begin = days[first - 1]
    return np.asarray(np.maximum(days - begin, 0.0) / (days[-1] - begin))


def _fitted(
    days: FloatArray,
    values: FloatArray,
    weights: FloatArray,
    first: int,
    shape: Shape,
    p_value: float,
) -> Change:
    x = np.stack([np.ones(len(days)), _shape(days, first, shape)], axis=1)
    information = x.T @ (x * weights[:, None])
    covariance = np.linalg.inv(information)
    before, size = covariance @ (x.T @ (weights * values))
    residual = values - x @ np.array([before, size])
    variance = float(weights @ np.square(residual)) / (len(days) - 2)
    dispersion = math.sqrt(max(variance, 1.0))
    std = dispersion * math.sqrt(covariance[1, 1])
    return Change(first, shape, float(before), float(size), std, dispersion, p_value)


__all__ = ["LEAST_DATES", "Change", "Shape", "change_in"]
