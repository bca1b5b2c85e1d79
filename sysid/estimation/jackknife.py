"""The scatter of an estimate from what it becomes without each of its groups (tests, bins, ...)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sysid.types import FloatArray


def jackknife(without: Callable[[int], FloatArray], groups: int) -> FloatArray:
    """Covariance (p, p) of an estimate: `without(i)` is the estimate (p,) without group i.

    (n - 1)/n of the sum of squares about their mean (Tukey 1958; Efron, Stein 1981), n = `groups`,
    with n - 1 degrees of freedom. Raises whatever `without` raises.
    """
    found = np.array([without(i) for i in range(groups)], dtype=float)
    off = found - found.mean(axis=0)
    return np.asarray((groups - 1) / groups * off.T @ off)


__all__ = ["jackknife"]
