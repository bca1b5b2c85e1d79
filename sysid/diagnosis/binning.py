"""Means of a residual in bins of a regressor, as figures draw them."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid.types import FloatArray, IntArray

BINS = 24
"""Bins of a curve over a regressor that a diagnosis holds, at most."""


def equal_count_edges(regressor: FloatArray, count: int) -> FloatArray:
    """Edges (k,) of at most so many bins of values (n,), of equal count; ties share a bin."""
    return np.unique(np.quantile(regressor, np.linspace(0.0, 1.0, count + 1)))


def bins_of(regressor: FloatArray, most: int, least: int) -> tuple[IntArray, int]:
    """The bin of every value (n,) and how many there are: at most so many, of equal count.

    A bin holds at least `least` values; if at most `most` distinct values exist, each has its own
    bin. Ties share a bin.
    """
    values, place = np.unique(regressor, return_inverse=True)
    if len(values) <= most:
        return place, len(values)
    count = max(1, min(most, len(regressor) // least))
    edges = equal_count_edges(regressor, count)
    place = np.searchsorted(edges[1:-1], regressor, side="right")
    return np.unique(place, return_inverse=True)[1], len(np.unique(place))


def about_means(place: IntArray, values: FloatArray) -> FloatArray:
    """Values (n,) less the mean of their bin; `place` (n,): each one's, numbered from 0."""
    return np.asarray(values - (np.bincount(place, values) / np.bincount(place))[place])


def binned_means(place: IntArray, values: FloatArray, group: IntArray) -> dict[str, Any]:
    """Means of values (n,) in bins, their standard errors, and the share of variance they explain.

    `place` (n,): each value's bin, `group` (n,): the test, or the unbroken stretch of one, that it
    is from. Values within a group are correlated: the errors take each group within a bin as one
    observation. Lists `means` and `errors` (bins,); `share`, 0 to 1, is adjusted for the number of
    bins, `power` the corresponding mean square.
    """
    count = np.bincount(place)
    means = np.bincount(place, values) / count
    inside = values - means[place]
    clusters, index = np.unique(place * (int(group.max()) + 1) + group, return_inverse=True)
    sums = np.bincount(index, inside)
    owner = clusters // (int(group.max()) + 1)
    own = np.bincount(owner)
    correction = own / np.maximum(own - 1, 1)
    errors = np.sqrt(np.bincount(owner, sums**2) * correction) / count
    total = float(values @ values) / len(values)
    freedom = max(len(values) - len(means), 1)
    share = 1.0 - float(inside @ inside) / freedom / total if total > 0.0 else 0.0
    return {
        "share": max(share, 0.0),
        "power": max(share, 0.0) * total,
        "means": means.tolist(),
        "errors": errors.tolist(),
    }


__all__ = ["about_means", "binned_means", "bins_of", "equal_count_edges"]
