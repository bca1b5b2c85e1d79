"""Many tests at once: p-values for the false discovery rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.types import FloatArray

SIGNIFICANCE = 0.05
"""Share of false discoveries among what is called significant."""
LEAST_P = 1e-300
"""No p-value is written as less: it stays a number with a logarithm."""


def adjusted(p_values: Sequence[float]) -> FloatArray:
    """P-values (n,) adjusted for the false discovery rate, whatever the tests' dependence (n,).

    Benjamini and Yekutieli, Ann. Statist. 29 (2001) 1165-1188, as `scipy.stats.
    false_discovery_control`, which takes a second to import.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)
    rank = np.arange(1, len(p) + 1)
    scaled = p[order] * (len(p) / rank * _of_dependence(len(p)))
    found = np.empty_like(p)
    # Of those with larger p-values none is adjusted to less.
    found[order] = np.minimum.accumulate(scaled[::-1])[::-1]
    return np.asarray(np.clip(found, 0.0, 1.0))


def largest_significant(p_values: Sequence[float]) -> float:
    """The p-value up to which these (n,), adjusted, are significant; of none, that of a first."""
    n = len(p_values)
    found = max(int(np.count_nonzero(adjusted(p_values) < SIGNIFICANCE)), 1)
    return SIGNIFICANCE * found / (n * _of_dependence(n))


def _of_dependence(n: int) -> float:
    """By what the correction of n independent tests grows for such as depend on one another."""
    return float(np.sum(1.0 / np.arange(1, n + 1)))


__all__ = ["LEAST_P", "SIGNIFICANCE", "adjusted", "largest_significant"]
