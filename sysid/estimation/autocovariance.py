"""Standard errors of regressions whose residuals follow one another in time, in several runs.

One estimator for all fits: an autoregression of the residuals, its order by Akaike's criterion
(den Haan, Levin 1997, A practitioner's guide to robust covariance matrix estimation), freed of what
the fit itself took out of the residuals. Kernel estimates need far longer records: at
200 samples of first-order noise with correlation 0.9 their 95 % intervals hold in 80 to 90 %
of cases (`benchmarks/interval_coverage.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.autoregression import (
    Autoregression,
    largest_reflection,
    runs_of,
    shown_by,
    stationary,
    with_autocovariance,
)
from sysid.estimation.covariance import Covariance
from sysid.types import FloatArray

# Below this share of the variance, what the fit took out is taken to be white.
_NEGLIGIBLE = 3e-3


def error_model(
    regressors: FloatArray,
    residuals: FloatArray,
    groups: NDArray[np.intp] | None = None,
    taken_out: int = 0,
) -> Autoregression:
    """The errors (n,) of a fit on regressors (n, p), as the residuals (n,) show them.

    `groups` (n,) numbers the runs: runs are uncorrelated with each other and share one model.
    `taken_out`: further numbers that were fitted, without a regressor.
    """
    count, columns = regressors.shape
    runs = runs_of(count, groups)
    longest = max(run.stop - run.start for run in runs)
    # At least four samples for each order.
    most = min(int(10.0 * math.log10(max(count, 1))), (count - columns) // 4)
    model, variance = shown_by(residuals, runs, min(most, longest - 1))
    scale = count / max(count - columns - taken_out, 1)
    cap = largest_reflection(count)
    if model is None or len(model.coefficients) == 0:
        return Autoregression.white(scale * variance)
    shown = model.start
    peak = max(float(_spectrum(model, longest)[0].max()), model.variance)
    if columns * peak < _NEGLIGIBLE * count * model.variance:
        model = Autoregression(model.coefficients, scale * model.innovation, scale * model.start)
    else:
        model = _freed(model, shown, _orthonormal(regressors), runs, cap)
    return _persistent(model, count, cap)


def correlated_covariance(
    regressors: FloatArray,
    residuals: FloatArray,
    unscaled: FloatArray,
    groups: NDArray[np.intp] | None = None,
    taken_out: int = 0,
) -> Covariance:
    """U X' Omega X U for regressors X (n, p), U = `unscaled` (p, p), the inverse of X' X.

    Omega is the covariance of the errors by `error_model`. The degrees of freedom are each
    coefficient's own (Satterthwaite 1946), two over the relative variance of its variance: a
    mean of persistent errors has few, a contrast of neighbours has nearly n - p. That errors
    alternate, so that they cancel in a mean, is not counted on: what a law leaves of noiseless
    data alternates too, and does not cancel.
    """
    count, columns = regressors.shape
    left = float(count - columns - taken_out)
    if left <= 0.0 or columns == 0 or not np.all(np.isfinite(unscaled)):
        matrix = np.full((columns, columns), math.inf)
        return Covariance(matrix, np.zeros(columns))
    model = error_model(regressors, residuals, groups, taken_out)
    matrix = np.zeros((columns, columns))
    changes = np.zeros((len(model.coefficients), columns))
    influence = regressors @ unscaled
    for run, spectrum, size in spectra(model, runs_of(count, groups)):
        part, change = _share_of(influence[run], model, spectrum, size)
        matrix += part
        changes += change
    dof = left / (1.0 + 0.5 * _relative_variance(model, matrix, changes))
    # Errors that last as long as the data leave no fraction of one: nothing has a larger quantile.
    dof = np.maximum(dof, min(left, 1.0))
    if model.long_run_variance < model.variance:
        floor = model.variance * np.sum(influence**2, axis=0)
        raised = np.sqrt(np.maximum(floor / np.maximum(np.diag(matrix), 1e-300), 1.0))
        matrix *= np.outer(raised, raised)
    return Covariance(matrix, dof)


def _relative_variance(
    model: Autoregression, matrix: FloatArray, changes: FloatArray
) -> FloatArray:
    """(p,): n times the variance of each variance's logarithm, from the coefficients' errors."""
    columns = len(matrix)
    if len(model.coefficients) == 0:
        return np.zeros(columns)
    from scipy.linalg import toeplitz

    variances = np.diag(matrix)
    relative = changes / np.where(variances > 0.0, variances, 1.0)
    precision = toeplitz(model.start[:-1]) / model.innovation
    return np.asarray(np.einsum("ji,ji->i", relative, np.linalg.solve(precision, relative)))


def _share_of(
    influence: FloatArray, model: Autoregression, spectrum: FloatArray, size: int
) -> tuple[FloatArray, FloatArray]:
    """A run's part of the covariance (p, p), and its change with each coefficient (k, p)."""
    from scipy import fft

    columns = influence.shape[1]
    used = np.flatnonzero(np.any(influence != 0.0, axis=0))
    weight = np.full(len(spectrum), 2.0 / size)
    weight[0] /= 2.0
    if size % 2 == 0:
        weight[-1] /= 2.0
    waves = fft.rfft(np.ascontiguousarray(influence[:, used].T), size)
    waves *= np.sqrt(weight * np.maximum(spectrum, 0.0))
    matrix, change = np.zeros((columns, columns)), np.zeros((len(model.coefficients), columns))
    matrix[np.ix_(used, used)] = waves.real @ waves.real.T + waves.imag @ waves.imag.T
    if len(change):
        change[:, used] = model.sensitivity(size) @ (waves.real**2 + waves.imag**2).T
    return matrix, change


def _freed(
    model: Autoregression,
    shown: FloatArray,
    basis: FloatArray,
    runs: Sequence[slice],
    cap: float,
) -> Autoregression:
    """The errors' model whose residuals have the autocovariance that is `shown` (k + 1,).

    A fit removes from the residuals the component that its regressors can describe; if they are
    slow, that is the errors' persistence. Where the full correction gives no stationary model, the
    largest part of it that does is applied.
    """
    found = model
    for _ in range(2):
        expected = _residual_autocovariance(found, basis, runs)
        scale = shown[0] / expected[0]
        wanted = scale * found.start + (shown - scale * expected)
        for halving in range(12):
            trial = with_autocovariance(shown + (wanted - shown) * 0.5**halving, cap)
            if trial is not None:
                found = trial
                break
    return found


def _residual_autocovariance(
    model: Autoregression, basis: FloatArray, runs: Sequence[slice]
) -> FloatArray:
    """Expected autocovariance (k + 1,) of the residuals, (1 - Q Q') Omega (1 - Q Q').

    The mean along each diagonal within the runs, for Q = `basis` (n, p), orthonormal.
    """
    from scipy import fft

    order = len(model.coefficients)
    waves, products = [], []
    inner = np.zeros((basis.shape[1], basis.shape[1]))
    for run, spectrum, size in spectra(model, runs):
        block = basis[run]
        # Smaller entries of an orthonormal basis are zero but for rounding.
        used = np.flatnonzero(np.abs(block).max(axis=0) > 1e-12)
        wave = fft.rfft(np.ascontiguousarray(block[:, used].T), size)
        product = fft.irfft(wave * spectrum, size)[:, : len(block)]
        inner[np.ix_(used, used)] += block[:, used].T @ product.T
        waves.append((used, wave, size))
        products.append(product)
    taken, pairs = np.zeros(order + 1), np.zeros(order + 1)
    lags = np.arange(order + 1)
    for run, (used, wave, size), product in zip(runs, waves, products, strict=True):
        half = fft.rfft(product, size) - 0.5 * (inner[np.ix_(used, used)] @ wave)
        cross = fft.irfft(2.0 * np.einsum("ij,ij->j", wave.conj(), half).real, size)
        length = run.stop - run.start
        inside = lags < length
        taken[inside] += cross[lags[inside]]
        pairs += np.maximum(length - lags, 0)
    return model.start - taken / np.maximum(pairs, 1.0)


def _persistent(model: Autoregression, count: int, cap: float) -> Autoregression:
    """Without the bias towards 0, 2/n of itself, that least squares has (Shaman, Stine 1988)."""
    total = float(np.sum(model.coefficients))
    if not total > 0.0:
        return model
    scale = min(total * (1.0 + 2.0 / count), max(cap, total)) / total
    return stationary(scale * model.coefficients, model.innovation) or model


def _orthonormal(regressors: FloatArray) -> FloatArray:
    """(n, p); columns of few rows come first, so that they keep to their rows."""
    rows = np.count_nonzero(regressors, axis=0)
    q, _ = np.linalg.qr(regressors[:, np.argsort(rows, kind="stable")])
    return np.asarray(q)


def spectra(
    model: Autoregression, runs: Sequence[slice]
) -> Iterator[tuple[slice, FloatArray, int]]:
    """For each run its rows, and the spectrum that multiplies by its Toeplitz matrix."""
    known: dict[int, tuple[FloatArray, int]] = {}
    for run in runs:
        length = run.stop - run.start
        if length not in known:
            known[length] = _spectrum(model, length)
        yield run, *known[length]


def _spectrum(model: Autoregression, length: int) -> tuple[FloatArray, int]:
    """Transform of the circulant matrix that holds the Toeplitz one, and its size."""
    from scipy import fft

    size = fft.next_fast_len(2 * length, real=True)
    gamma = model.autocovariance(length)
    circle = np.zeros(size)
    circle[:length] = gamma
    circle[size - length + 1 :] = gamma[:0:-1]
    return np.asarray(fft.rfft(circle).real), size
