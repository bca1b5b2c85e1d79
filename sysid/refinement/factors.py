"""Factorisations of equations: as few rows as there are columns, the same squares."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sysid.types import FloatArray

# Least pivot of columns of length 1 with which normal equations say as much as the equations: the
# square of what is lost of the weakest direction is some 1e-16 over the square of it.
_LEAST_PIVOT = 1e-4


def triangular(rows: Sequence[FloatArray]) -> FloatArray:
    """The triangular factor (k, k) of stacked rows, (n, k) each."""
    return np.asarray(np.linalg.qr(np.vstack(list(rows)), mode="r"), dtype=float)


def triangular_of_squares(
    squares: FloatArray,
    rows: Callable[[], Sequence[FloatArray]],
    summed: tuple[int, FloatArray] | None = None,
) -> FloatArray:
    """The triangular factor (k, k) of rows with these normal equations (k, k) (Cholesky).

    `summed`: a column that is a sum of others, and how much of each (k,), which has no pivot of its
    own. From the `rows` themselves (`triangular`) where columns are too near to dependent.
    """
    size = np.sqrt(np.diag(squares))
    known = np.flatnonzero(size)
    if summed is not None:
        known = known[known != summed[0]]
    own = np.ix_(known, known)
    try:
        lower = np.linalg.cholesky(squares[own] / np.outer(size[known], size[known]))
    except np.linalg.LinAlgError:
        return triangular(rows())
    if not np.min(np.diag(lower), initial=1.0) >= _LEAST_PIVOT:
        return triangular(rows())
    factor = np.zeros_like(squares)
    factor[own] = lower.T * size[known]
    if summed is not None:
        factor[:, summed[0]] = factor @ summed[1]
    return factor


__all__ = ["triangular", "triangular_of_squares"]
