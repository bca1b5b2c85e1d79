"""Autocovariance of residuals that follow one another in time, in several runs (trials)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.types import FloatArray

# Autocorrelations this many standard errors from zero are real (Politis 2003).
_REAL_CORRELATION = 2.0
_SILENT_LAGS = 5


def runs_of(count: int, groups: NDArray[np.intp] | None) -> list[slice]:
    """Rows of each run; `groups` (n,) numbers the run that each row belongs to."""
    if groups is None:
        return [slice(0, count)]
    bounds = [0, *(np.flatnonzero(np.diff(groups)) + 1).tolist(), count]
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]


def tapered_autocovariance(residuals: FloatArray, runs: Sequence[slice], dof: int) -> FloatArray:
    """Autocovariance from lag 0 on, flat-top tapered, ended where it has died out.

    It counts in full up to the last lag after which five in a row are not significant, and
    falls to zero over as many lags again (Politis 2003, Adaptive bandwidth choice).
    """
    count = len(residuals)
    longest = min(count // 10, max(r.stop - r.start for r in runs) - 1)

    def gamma(lag: int) -> float:
        products = (residuals[r.start : r.stop - lag] @ residuals[r.start + lag : r.stop]
                    for r in runs if r.stop - r.start > lag)  # fmt: skip
        return float(sum(products)) / max(dof, 1)

    significant = _REAL_CORRELATION * math.sqrt(math.log10(max(count, 10)) / count)
    values = [gamma(0)]
    last = 0
    while len(values) <= min(last + _SILENT_LAGS, longest):
        values.append(gamma(len(values)))
        if abs(values[-1]) >= significant * values[0]:
            last = len(values) - 1
    end = min(2 * last, longest)
    values += [gamma(lag) for lag in range(len(values), end + 1)]
    taper = np.clip(2.0 - np.arange(end + 1) / max(last, 1), 0.0, 1.0)
    taper[0] = 1.0
    return np.array(values[: end + 1]) * taper


def toeplitz_product(columns: FloatArray, gamma: FloatArray) -> FloatArray:
    """Omega times `columns` (n, p) for the Toeplitz matrix of `gamma`."""
    total: FloatArray = gamma[0] * columns
    for lag in range(1, min(len(gamma), len(columns))):
        total[lag:] += gamma[lag] * columns[:-lag]
        total[:-lag] += gamma[lag] * columns[lag:]
    return total
