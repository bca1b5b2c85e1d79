"""Reduction of samples to an even cover of the measured surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.errors import input_error
from sysid.surfaces.domain import PRESSURE_BINS, duty_levels, pressure_bins
from sysid.surfaces.estimator import checked_samples
from sysid.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """The measured surface, evenly covered: one point a test and pressure bin.

    Means over the samples of one test in one of the pressure bins: `duty`, `pressure` [Pa],
    `flow` [kg/s], the flow's standard error `std` [kg/s], `count` of samples and `test`
    (label) of each point, all (k,).
    """

    duty: FloatArray
    pressure: FloatArray
    flow: FloatArray
    std: FloatArray
    count: IntArray
    test: NDArray[Any]

    def select(self, rows: NDArray[Any]) -> SurfacePoints:
        """The points in `rows` (mask or numbers)."""
        return SurfacePoints(
            self.duty[rows],
            self.pressure[rows],
            self.flow[rows],
            self.std[rows],
            self.count[rows],
            self.test[rows],
        )

    def relabelled(self, test: NDArray[Any]) -> SurfacePoints:
        """The same points with other test labels (k,)."""
        return replace(self, test=test)

    def joined(self, other: SurfacePoints | None) -> SurfacePoints:
        """These points followed by the others; unchanged without others."""
        if other is None:
            return self
        pairs = [(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)]
        return SurfacePoints(*(np.concatenate(pair) for pair in pairs))


def surface_points(
    duty: ArrayLike,
    pressure: ArrayLike,
    flow: ArrayLike,
    test: ArrayLike | None = None,
    std: ArrayLike | None = None,
    bins: int = 32,
    boundaries: Sequence[float] = (),
) -> SurfacePoints:
    """Reduce samples (n,) to the even surface that both fits and their comparison use.

    A logged test rests at its equilibrium for most of its time; sample by sample, a fit
    and its RMSE would be about that one pressure. The mean over a bin of 1/32 of the
    pressure range counts every stretch of the surface once, and averages noise that would
    otherwise enter the network as input noise. `test` (n,) labels tests (absent: one
    test a duty), `std` (n,) is each sample's standard error of flow; absent, the spread
    inside the bin stands for it (NaN where one sample is alone). A bin is divided at
    `boundaries` [Pa], where the flow jumps.
    """
    u, p, m = checked_samples(duty, pressure, flow)
    if test is None:
        labels, code = duty_levels(u)
    else:
        given = np.asarray(test)
        if given.shape != u.shape:
            raise input_error("test labels", f"have shape {given.shape}", f"give {u.shape}")
        labels, code = np.unique(given, return_inverse=True)
    _, column = pressure_bins(p, bins)
    parts = len(boundaries) + 1
    column = column * parts + np.searchsorted(np.sort(boundaries), p)
    bins = bins * parts
    cell = code * bins + column
    count = np.bincount(cell)
    held = np.flatnonzero(count)
    n = count[held]

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(cell, values)[held] / n)

    flow_mean = mean(m)
    if std is None:
        variance = np.maximum(mean(m * m) - flow_mean**2, 0.0)
        error = np.where(n > 1, np.sqrt(variance / np.maximum(n - 1, 1)), np.nan)
    else:
        error = np.sqrt(mean(np.asarray(std, dtype=float) ** 2) / n)
    return SurfacePoints(mean(u), mean(p), flow_mean, error, n, labels[held // bins])


def thin_samples(
    duty: ArrayLike, pressure: ArrayLike, flow: ArrayLike, points: int, seed: int = 0
) -> IntArray:
    """Sorted row numbers of at most `points` samples, spread evenly over the surface.

    A logged test rests at its equilibrium for most of its time. So the samples are drawn
    from cells (duty level by pressure bin, 64 bins): from each cell at random up to the
    same number, give or take one.
    """
    u, p, _ = checked_samples(duty, pressure, flow)
    if len(u) <= points:
        return np.arange(len(u))
    _, level = duty_levels(u)
    _, column = pressure_bins(p, PRESSURE_BINS)
    cell = level * PRESSURE_BINS + column
    shuffled = np.random.default_rng(seed).permutation(len(u))
    order = shuffled[np.argsort(cell[shuffled], kind="stable")]
    count = np.bincount(cell)
    start = np.concatenate(([0], np.cumsum(count)[:-1]))
    rank = np.arange(len(u)) - start[cell[order]]
    held = np.sort(count[count > 0])
    quota = 1
    while np.minimum(held, quota + 1).sum() <= points:
        quota += 1
    # Fewer cells than points leave a remainder, drawn from the cells that have more; more
    # cells than points skip some cells. Both at random.
    rng = np.random.default_rng([seed, 1])
    if np.minimum(held, quota).sum() > points:
        quota = 0
    picked = order[rank < quota]
    more = rng.permutation(order[rank == quota])
    return np.sort(np.concatenate((picked, more[: points - len(picked)])))
