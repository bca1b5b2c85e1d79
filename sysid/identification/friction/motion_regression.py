"""Weighted regression on regressors with noise of known variance.

The encoder's noise in speed and acceleration, which attenuates their coefficients, is known: its
share is subtracted from the normal matrix (Fuller 1987, 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import LinearFit, linear_fit
from sysid.types import FloatArray

# Share of a regressor's squares that may be the encoder's noise.
MOST_NOISE = 0.5


@dataclass(frozen=True)
class WeightedRows:
    """Regressors (n, p), target and weights (n,), and the regressors' noise variance (p,),
    summed over the rows with their weights."""

    regressors: FloatArray
    target: FloatArray
    weights: FloatArray
    noise: FloatArray


def scaled(rows: WeightedRows, weight: float) -> WeightedRows:
    """The rows with all weights multiplied by `weight`."""
    return replace(rows, weights=rows.weights * weight, noise=rows.noise * weight)


def own_variance(rows: WeightedRows) -> float:
    """Residual variance of an unweighted fit of these rows alone."""
    solution, *_ = np.linalg.lstsq(rows.regressors, rows.target, rcond=None)
    return float(np.mean((rows.target - rows.regressors @ solution) ** 2))


def regression(rows: WeightedRows, names: Sequence[str]) -> LinearFit:
    """Weighted least squares, the noise's attenuation removed; `names` (p,) of the regressors.

    Raises NotIdentifiedError where the regressors are dependent, or mostly noise.
    """
    fit = linear_fit(rows.regressors, rows.target, rows.weights, names)
    x, weighted = rows.regressors, rows.regressors * rows.weights[:, None]
    normal = weighted.T @ x
    if np.any(rows.noise > MOST_NOISE * np.diag(normal)):
        raise NotIdentifiedError(
            "the parameters' regressors: speed or acceleration is mostly the encoder's noise; "
            "lower the cut-off or give faster motion"
        )
    try:
        unscaled = np.asarray(np.linalg.inv(normal - np.diag(rows.noise)), dtype=float)
    except np.linalg.LinAlgError:
        what = "the parameters' regressors depend on each other but for the encoder's noise"
        raise NotIdentifiedError(f"{what}; give motion at further speeds") from None
    coefficients = unscaled @ (weighted.T @ rows.target)
    return replace(
        fit, coefficients=coefficients, residuals=rows.target - x @ coefficients, unscaled=unscaled
    )


def inflation(fit: LinearFit) -> float:
    """The largest variance inflation of a regressor."""
    squares = fit.weights @ fit.regressors**2
    return float(np.max(squares * np.diag(fit.unscaled)))
