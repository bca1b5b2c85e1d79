"""F test of nested least squares fits whose residuals follow one another in time, in several runs.

The ratio of two sums of squares of correlated normal errors is about Fisher's, with the means
and the degrees of freedom of both sums by their first two moments (Box, Ann. Math. Statist. 25
(1954) 290-302). Under errors next to a unit root a slow effect takes away more squares by chance
than one that changes from sample to sample, and few degrees of freedom remain to judge it;
fewer still as that persistence is itself an estimate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.autocovariance import error_model, spectra
from sysid.estimation.autoregression import Autoregression, runs_of, stationary
from sysid.estimation.linear import LEVEL, RANK_TOLERANCE
from sysid.types import FloatArray


@dataclass(frozen=True)
class QuadraticForm:
    """A sum of squares of errors: its mean, and the degrees of freedom of its scatter."""

    mean: float
    dof: float

    @classmethod
    def of_moments(cls, trace: float, square: float) -> QuadraticForm:
        """The form A, a projection, from tr(A Omega) and tr(A Omega A Omega)."""
        return cls(trace, trace**2 / square if square > 0.0 else 0.0)


def nested_p_value(
    squares: tuple[float, float],
    jacobian: FloatArray,
    residuals: FloatArray,
    more: NDArray[np.bool_],
    groups: NDArray[np.intp] | None = None,
) -> float:
    """p-value of those columns of the full fit's `jacobian` (n, p) that `more` (p,) marks.

    `squares`: sums of squares without them and with them; `residuals` (n,) of the full fit;
    `groups` (n,) numbers the runs, which are uncorrelated with each other. 1 where the columns
    change nothing or no degrees of freedom remain.
    """
    from scipy.special import fdtrc

    basis, added = _bases(jacobian, more)
    if not added.shape[1] or len(residuals) <= basis.shape[1]:
        return 1.0
    model, runs = error_model(basis, residuals, groups), runs_of(len(residuals), groups)
    explained, residual = _forms(_upper(model, len(residuals)), basis, added, runs)
    if not (residual.mean > 0.0 and residual.dof > 0.0 and explained.mean > 0.0):
        return 1.0
    unsure = _variance_of_share(model, basis, added, runs)
    dof = 1.0 / (1.0 / residual.dof + 0.5 * unsure)
    found = max(squares[0] - squares[1], 0.0) / max(squares[1], 1e-300)
    if dof <= 0.0:
        return 1.0
    return float(fdtrc(explained.dof, dof, found * residual.mean / explained.mean))


def _bases(jacobian: FloatArray, more: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Orthonormal: of all columns (n, q), and of what those of `more` (p,) add to the others."""
    lengths = np.linalg.norm(jacobian, axis=0)
    ordered = np.argsort(more, kind="stable")
    acting = ordered[lengths[ordered] > 0.0]
    q, r = np.linalg.qr(jacobian[:, acting] / lengths[acting])
    apart = np.abs(np.diag(r)) > RANK_TOLERANCE
    if not apart.all():
        # What stands for a tied column is any direction, and those behind it are orthogonal to it.
        acting = acting[apart]
        q = np.linalg.qr(jacobian[:, acting] / lengths[acting])[0]
    return q, q[:, more[acting]]


def _forms(
    model: Autoregression, basis: FloatArray, added: FloatArray, runs: Sequence[slice]
) -> tuple[QuadraticForm, QuadraticForm]:
    """Forms of the squares that `added` (n, k) explains and that `basis` (n, q) does not."""
    spread, moved = _through(model, basis, runs), _through(model, added, runs)
    inner, gained = basis.T @ spread, added.T @ moved
    trace, square = 0.0, 0.0
    for run in runs:
        length = run.stop - run.start
        gamma, pairs = model.autocovariance(length), length - np.arange(length)
        trace += length * model.variance
        square += float(2.0 * pairs @ gamma**2) - length * model.variance**2
    square += float(np.sum(inner**2)) - 2.0 * float(np.sum(spread**2))
    return (
        QuadraticForm.of_moments(float(np.trace(gained)), float(np.sum(gained**2))),
        QuadraticForm.of_moments(trace - float(np.trace(inner)), square),
    )


def _variance_of_share(
    model: Autoregression, basis: FloatArray, added: FloatArray, runs: Sequence[slice]
) -> float:
    """Variance of log(mean explained / mean residual sum of squares) by the coefficients' error.

    Infinite near a unit root, where the coefficients carry no information.
    """
    if len(model.coefficients) == 0:
        return 0.0
    count = sum(run.stop - run.start for run in runs)
    gained, left = _pairs(added, runs), -_pairs(basis, runs)
    left[0] += count
    # As a share of the distance from a unit root.
    step = 1e-7 * min(1.0, abs(1.0 - float(np.sum(model.coefficients))))
    around = stationary(model.coefficients, model.innovation)
    if around is None or not step > 0.0:
        return math.inf
    here = around.autocovariance(len(left))
    relative = np.zeros(len(model.coefficients))
    for k, shift in enumerate(step * np.eye(len(relative))):
        # Backwards, away from the unit root.
        shifted = stationary(model.coefficients - shift, model.innovation)
        if shifted is None:
            return math.inf
        change = (here - shifted.autocovariance(len(left))) / step
        relative[k] = change @ gained / (here @ gained) - change @ left / (here @ left)
    return float(relative @ (_scatter(model, count) @ relative))


def _scatter(model: Autoregression, count: int) -> FloatArray:
    """Covariance (k, k) of the coefficients, as estimated from this many samples."""
    from scipy.linalg import toeplitz

    return np.asarray(np.linalg.inv(toeplitz(model.start[:-1]))) * (model.innovation / count)


def _upper(model: Autoregression, count: int) -> Autoregression:
    """The most persistent errors that are compatible with the model, as far as stationary.

    Residuals that by chance show little persistence are small by the same chance.
    """
    total = float(np.sum(model.coefficients))
    if not total > 0.0:
        return model
    error = math.sqrt(max(float(np.sum(_scatter(model, count))), 0.0))
    # One-sided: with this confidence the errors are no more persistent.
    raised = NormalDist().inv_cdf(LEVEL) * error / total
    raised = min(raised, max(1.0 - 1.0 / count - total, 0.0) / total)
    for halving in range(12):
        raised_by = 1.0 + raised * 0.5**halving
        found = stationary(model.coefficients * raised_by, model.innovation)
        if found is not None:
            return found
    return model


def _pairs(columns: FloatArray, runs: Sequence[slice]) -> FloatArray:
    """(m,): tr(C' Omega C) over the autocovariance at each lag, for columns C (n, k)."""
    from scipy import fft

    found = np.zeros(max(run.stop - run.start for run in runs))
    for run in runs:
        length = run.stop - run.start
        size = fft.next_fast_len(2 * length, real=True)
        power = np.sum(np.abs(fft.rfft(columns[run], size, axis=0)) ** 2, axis=1)
        found[:length] += 2.0 * fft.irfft(power, size)[:length]
    found[0] /= 2.0
    return found


def _through(model: Autoregression, columns: FloatArray, runs: Sequence[slice]) -> FloatArray:
    """Omega times columns (n, k)."""
    from scipy import fft

    found = np.empty_like(columns)
    for run, spectrum, size in spectra(model, runs):
        waves = fft.rfft(columns[run], size, axis=0) * spectrum[:, None]
        found[run] = fft.irfft(waves, size, axis=0)[: run.stop - run.start]
    return found


__all__ = ["QuadraticForm", "nested_p_value"]
