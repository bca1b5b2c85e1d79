"""Many tests at once: p-values for the false discovery rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.types import FloatArray

SIGNIFICANCE = 0.05
"""Share of false discoveries among what is called significant."""


def adjusted(p_values: Sequence[float]) -> FloatArray:
    """P-values (n,) adjusted for the false discovery rate, whatever the tests' dependence (n,).

    Benjamini and Yekutieli, Ann. Statist. 29 (2001) 1165-1188, by scipy.
    """
    from scipy.stats import false_discovery_control

    if not len(p_values):
        return np.zeros(0)
    return np.asarray(false_discovery_control(p_values, method="by"))


__all__ = ["SIGNIFICANCE", "adjusted"]
