"""Standard errors of regressions whose residuals follow one another in time, in several runs.

One estimator for all fits: an autoregression of the residuals, its order by Akaike's criterion
(den Haan, Levin 1997, A practitioner's guide to robust covariance matrix estimation), by Burg's
method over all runs at once (de Waele, Broersen 2000, The Burg algorithm for segments), freed
of what the fit itself took out of the residuals. Kernel estimates need far longer records: at
200 samples of first-order noise with correlation 0.9 their 95 % intervals hold in 80 to 90 %
of cases (`benchmarks/interval_coverage.py`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.covariance import Covariance
from sysid.types import FloatArray

# White noise added to the model, as a share of the variance: residuals that went through a
# low-pass filter have an autocovariance that is singular but for rounding.
_WHITE_SHARE = 1e-5
_SAMPLES_PER_ORDER = 4
_CORRECTION_STEPS = 2
_HALVINGS = 12
# The first damping tried, as a share of the least distance from a unit root.
_LEAST_DAMPING = 1.0 / 16.0
# Below this share of the variance, what the fit took out is taken to be white.
_NEGLIGIBLE = 3e-3
# Entries of an orthonormal basis that are zero but for rounding.
_ZERO = 1e-12


def runs_of(count: int, groups: NDArray[np.intp] | None) -> list[slice]:
    """Rows of each run; `groups` (n,) numbers the run that each row belongs to."""
    if groups is None:
        return [slice(0, count)]
    bounds = [0, *(np.flatnonzero(np.diff(groups)) + 1).tolist(), count]
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]


@dataclass(frozen=True)
class Autoregression:
    """e[t] = sum_j coefficients[j - 1] e[t - j] + white noise of variance `innovation`.

    `start` (k + 1,) is its autocovariance at lags 0 to k, the order.
    """

    coefficients: FloatArray
    innovation: float
    start: FloatArray

    @property
    def variance(self) -> float:
        return float(self.start[0])

    def independent_samples(self, lengths: Sequence[int]) -> float:
        """As many as say as much of a mean as runs of these lengths do; at most their sum."""
        gamma = self.autocovariance(max(lengths))
        lags = np.arange(len(gamma))
        sums = [float(2.0 * np.maximum(n - lags, 0) @ gamma) - n * gamma[0] for n in lengths]
        count = sum(lengths)
        return float(count * min(count * self.variance / max(sum(sums), 1e-300), 1.0))

    @property
    def long_run_variance(self) -> float:
        """Sum of the autocovariance over all lags, both ways."""
        return self.innovation / (1.0 - float(np.sum(self.coefficients))) ** 2

    def autocovariance(self, count: int) -> FloatArray:
        """At lags 0 to count - 1, (count,)."""
        from scipy.signal import lfilter, lfiltic

        order = len(self.coefficients)
        if order == 0 or count <= order + 1:
            return np.pad(self.start, (0, max(count - order - 1, 0)))[:count]
        whitening = np.concatenate([[1.0], -self.coefficients])
        state = lfiltic([1.0], whitening, self.start[:0:-1])
        rest, _ = lfilter([1.0], whitening, np.zeros(count - order - 1), zi=state)
        return np.concatenate([self.start, rest])

    def sensitivity(self, size: int) -> FloatArray:
        """(k, size // 2 + 1): change of the spectrum's logarithm with each coefficient."""
        order = len(self.coefficients)
        angles = np.outer(np.arange(1, order + 1), np.arange(size // 2 + 1))
        delays = np.exp(-2j * np.pi / size * angles)
        return np.asarray(2.0 * (delays / (1.0 - self.coefficients @ delays)).real)


def autoregression(residuals: Sequence[FloatArray], most: int) -> Autoregression:
    """The errors that runs' residuals, each (n,), show; no correction for what a fit took.

    The order is at most `most`, by AIC.
    """
    joined = np.concatenate(list(residuals))
    ends = np.cumsum([0, *(len(r) for r in residuals)]).tolist()
    runs = [slice(a, b) for a, b in itertools.pairwise(ends)]
    model, variance = _shown_by(joined, runs, most)
    return model or Autoregression(np.zeros(0), variance, np.array([variance]))


def error_model(
    regressors: FloatArray, residuals: FloatArray, groups: NDArray[np.intp] | None = None
) -> Autoregression:
    """The errors (n,) of a fit on regressors (n, p), as the residuals (n,) show them.

    `groups` (n,) numbers the runs: there is no correlation between runs, and one model.
    """
    count, columns = regressors.shape
    runs = runs_of(count, groups)
    longest = max(run.stop - run.start for run in runs)
    most = min(int(10.0 * math.log10(max(count, 1))), (count - columns) // _SAMPLES_PER_ORDER)
    model, variance = _shown_by(residuals, runs, min(most, longest - 1))
    scale = count / max(count - columns, 1)
    cap = _cap(count)
    if model is None or len(model.coefficients) == 0:
        return Autoregression(np.zeros(0), scale * variance, np.array([scale * variance]))
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
) -> Covariance:
    """U X' Omega X U for regressors X (n, p), U = `unscaled` (p, p), the inverse of X' X.

    Omega is the covariance of the errors by `error_model`. The degrees of freedom are each
    coefficient's own (Satterthwaite 1946), two over the relative variance of its variance: a
    mean of persistent errors has few, a contrast of neighbours has nearly n - p. That errors
    alternate, so that they cancel in a mean, is not counted on: what a law leaves of noiseless
    data alternates too, and does not cancel.
    """
    count, columns = regressors.shape
    left = float(count - columns)
    if left <= 0.0 or columns == 0 or not np.all(np.isfinite(unscaled)):
        matrix = np.full((columns, columns), math.inf)
        return Covariance(matrix, np.zeros(columns))
    model = error_model(regressors, residuals, groups)
    matrix = np.zeros((columns, columns))
    changes = np.zeros((len(model.coefficients), columns))
    influence = regressors @ unscaled
    for run, spectrum, size in spectra(model, runs_of(count, groups)):
        part, change = _share_of(influence[run], model, spectrum, size)
        matrix += part
        changes += change
    dof = left / (1.0 + 0.5 * _relative_variance(model, matrix, changes))
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


def _shown_by(
    residuals: FloatArray, runs: Sequence[slice], most: int
) -> tuple[Autoregression | None, float]:
    """As runs of residuals (n,) show it, damped where need be, and their mean square.

    None for residuals that are all zero.
    """
    reflections, variance = _burg(residuals, runs, most)
    shown = autocovariance_of(reflections, variance)
    shown[0] *= 1.0 + (_WHITE_SHARE if len(reflections) else 0.0)
    return _damped(shown, _cap(len(residuals))), variance


def _cap(count: int) -> float:
    """The largest reflection coefficient that so many samples can tell from 1."""
    return 1.0 - 1.0 / max(count, 2)


def _burg(residuals: FloatArray, runs: Sequence[slice], most: int) -> tuple[FloatArray, float]:
    """Reflection coefficients (k,) and the mean square; the order has the least AIC."""
    count = len(residuals)
    place = np.concatenate([np.arange(run.stop - run.start) for run in runs])
    ahead, behind = residuals[1:], residuals[:-1]
    variance = float(residuals @ residuals) / count
    found: list[float] = []
    criteria = [0.0]
    for order in range(1, most + 1):
        within = place[order:] >= order
        x, y = np.where(within, ahead, 0.0), np.where(within, behind, 0.0)
        power = float(x @ x + y @ y)
        if not power > 1e-12 * variance:
            break
        found.append(2.0 * float(x @ y) / power)
        gain = math.log(max(1.0 - found[-1] ** 2, 1e-300))
        # Short runs have few pairs this far apart, and only these speak for a higher order.
        criteria.append(criteria[-1] + int(np.count_nonzero(within)) * gain + 2.0)
        ahead, behind = (ahead - found[-1] * behind)[1:], (behind - found[-1] * ahead)[:-1]
    return np.array(found[: int(np.argmin(criteria))]), variance


def autocovariance_of(reflections: FloatArray, variance: float) -> FloatArray:
    """At lags 0 to k, (k + 1,), by the recursion of Levinson and Durbin."""
    gamma, a, innovation = [variance], np.zeros(0), variance
    for reflection in reflections:
        gamma.append(float(a @ np.array(gamma[:0:-1])) + float(reflection) * innovation)
        a = np.append(a - reflection * a[::-1], reflection)
        innovation *= 1.0 - float(reflection) ** 2
    return np.array(gamma)


def _solved(gamma: FloatArray, cap: float) -> Autoregression | None:
    """The autoregression with this autocovariance (k + 1,); None where there is none.

    A reflection coefficient beyond `cap`, or next to no innovation, is none either.
    """
    a, innovation = np.zeros(0), float(gamma[0])
    if not innovation > 0.0:
        return None
    for order in range(1, len(gamma)):
        reflection = float(gamma[order] - a @ gamma[order - 1 : 0 : -1]) / innovation
        if not abs(reflection) < cap:
            return None
        a = np.append(a - reflection * a[::-1], reflection)
        innovation *= 1.0 - reflection**2
    if innovation < 0.3 * _WHITE_SHARE * gamma[0]:
        return None
    return Autoregression(a, innovation, gamma)


def _damped(gamma: FloatArray, cap: float) -> Autoregression | None:
    """As `_solved`, where need be with the correlations damped, g[k] c^k: c moves every pole.

    Smooth residuals exceed `cap` at the first lag already. White noise in their place would be
    the worst choice of all. None for residuals that are all zero.
    """
    lags, damping = np.arange(len(gamma)), 0.0
    while damping < 1.0:
        model = _solved(gamma * (1.0 - damping) ** lags, cap)
        if model is not None:
            return model
        damping = max(2.0 * damping, _LEAST_DAMPING * (1.0 - cap))
    return None


def _freed(
    model: Autoregression,
    shown: FloatArray,
    basis: FloatArray,
    runs: Sequence[slice],
    cap: float,
) -> Autoregression:
    """The errors' model whose residuals have the autocovariance that is `shown` (k + 1,).

    A fit takes out of the residuals what looks like its regressors; of slow ones that is the
    errors' persistence. Where the full correction leaves no stationary model, as much of it is
    made as does.
    """
    found = model
    for _ in range(_CORRECTION_STEPS):
        expected = _residual_autocovariance(found, basis, runs)
        scale = shown[0] / expected[0]
        wanted = scale * found.start + (shown - scale * expected)
        for halving in range(_HALVINGS):
            trial = _solved(shown + (wanted - shown) * 0.5**halving, cap)
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
        used = np.flatnonzero(np.abs(block).max(axis=0) > _ZERO)
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
    a = scale * model.coefficients
    reflections = reflections_of(a)
    if not np.all(np.abs(reflections) < 1.0):
        return model
    variance = model.innovation / float(np.prod(1.0 - reflections**2))
    return Autoregression(a, model.innovation, autocovariance_of(reflections, variance))


def reflections_of(coefficients: FloatArray) -> FloatArray:
    """(k,), by stepping the order down; beyond 1 where there is no stationary model."""
    found: list[float] = []
    a = coefficients
    while len(a):
        last = float(a[-1])
        found.append(last)
        if abs(last) >= 1.0:
            break
        a = (a[:-1] + last * a[:-1][::-1]) / (1.0 - last**2)
    return np.array(found[::-1])


def _orthonormal(regressors: FloatArray) -> FloatArray:
    """(n, p); columns of few rows come first, so that they keep to their rows."""
    rows = np.count_nonzero(regressors, axis=0)
    q, _ = np.linalg.qr(regressors[:, np.argsort(rows, kind="stable")])
    return np.asarray(q)


def spectra(
    model: Autoregression, runs: Sequence[slice]
) -> Iterator[tuple[slice, FloatArray, int]]:
    """Of each run: its rows, and the spectrum that multiplies by its Toeplitz matrix."""
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
