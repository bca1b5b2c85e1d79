"""Trials of one level that fall into two clusters (as set 2 of thesis Table 3.4.2 does)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.quality import SIGNIFICANT
from sysid.types import FloatArray

MIN_TRIALS = 5


@dataclass(frozen=True)
class Clusters:
    """Two clusters among the trials of one level: their labels, and the test's numbers."""

    first: tuple[str, ...]
    second: tuple[str, ...]
    statistic: float
    p_value: float

    @property
    def text(self) -> str:
        return (
            f"tests {', '.join(self.first)} and tests {', '.join(self.second)} of one level fall "
            f"into two clusters (p = {self.p_value:.2g}): conditions changed between them; their "
            "errors are not independent, and the intervals are too narrow"
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "clusters": [list(self.first), list(self.second)],
            "statistic": self.statistic,
            "p_value": self.p_value,
        }


def gap_statistic(sorted_values: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Best split of each row of sorted values (m, n) into two parts of at least two values.

    The statistic is the gap between the parts over their pooled standard deviation: Fisher's
    criterion with the gap in place of the distance of means, so that a single outlier or
    a wide spread does not count as clusters. Returns it and the size of the lower part, (m,).
    """
    x = np.atleast_2d(sorted_values)
    n = x.shape[1]
    total, squares = np.cumsum(x, axis=1), np.cumsum(x**2, axis=1)
    sizes = np.arange(2, n - 1)
    low = squares[:, sizes - 1] - total[:, sizes - 1] ** 2 / sizes
    high_sum = total[:, -1:] - total[:, sizes - 1]
    high = squares[:, -1:] - squares[:, sizes - 1] - high_sum**2 / (n - sizes)
    gaps = x[:, sizes] - x[:, sizes - 1]
    within = np.sqrt(np.maximum(low + high, 1e-12 * squares[:, -1:]) / (n - 2))
    ratio = np.where(gaps > 0.0, gaps / np.maximum(within, 1e-300), 0.0)
    best = np.argmax(ratio, axis=1)
    return ratio[np.arange(len(x)), best], sizes[best]


@lru_cache(maxsize=64)
def _null(n: int) -> FloatArray:
    """Sorted statistics of `n` normal values, by simulation with a fixed seed."""
    draws = np.random.default_rng([20231, n]).standard_normal((20_000, n))
    return np.sort(gap_statistic(np.sort(draws, axis=1))[0])


def cluster_test(values: FloatArray) -> tuple[float, float, int]:
    """Gap statistic of (n,) values, n >= 5; its p-value under one normal law; the split.

    The split is the number of values in the lower cluster. The p-value is the rank among
    20,000 simulated samples of the same size, so at least 1/20,001.
    """
    x = np.sort(np.asarray(values, dtype=float) - float(np.mean(values)))
    statistic, split = gap_statistic(x)
    null = _null(len(x))
    above = len(null) - int(np.searchsorted(null, statistic[0], side="left"))
    return float(statistic[0]), (above + 1) / (len(null) + 1), int(split[0])


def find_clusters(
    values: FloatArray, levels: NDArray[np.intp], labels: Sequence[str]
) -> tuple[Clusters, ...]:
    """Levels (n,) whose values (n,) fall into two clusters; labels name the trials.

    The false-alarm rate over all levels tested is 1 % (Bonferroni).
    """
    tested = [level for level in np.unique(levels) if np.sum(levels == level) >= MIN_TRIALS]
    found = []
    for level in tested:
        rows = np.flatnonzero(levels == level)
        inside = values[rows]
        if not float(np.std(inside)) > 1e-12 * max(1.0, float(np.max(np.abs(inside)))):
            continue
        statistic, p_value, split = cluster_test(inside)
        if math.isfinite(statistic) and p_value < SIGNIFICANT / len(tested):
            order = rows[np.argsort(inside)]
            parts = (sorted(order[:split]), sorted(order[split:]))
            first, second = (tuple(labels[i] for i in part) for part in parts)
            found.append(Clusters(first, second, statistic, p_value))
    return tuple(found)
