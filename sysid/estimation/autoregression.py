"""Errors that follow one another in time as an autoregression: its estimate and its innovations.

Burg's method over all runs at once (de Waele, Broersen 2000, The Burg algorithm for segments), the
order by Akaike's criterion, which unlike BIC's grows with the samples where the colour is not
autoregressive, as that of drift under sensor noise. The innovations are exact from the first row
on: a row with fewer rows before it than the order is predicted from those (Levinson, Durbin).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sysid.types import FloatArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# White noise added to the model, as a share of the variance: residuals that went through a
# low-pass filter have an autocovariance that is singular but for rounding.
_WHITE_SHARE = 1e-5


@dataclass(frozen=True)
class Autoregression:
    """e[t] = sum_j coefficients[j - 1] e[t - j] + white noise of variance `innovation`.

    `start` (k + 1,) is its autocovariance at lags 0 to k, the order.
    """

    coefficients: FloatArray
    innovation: float
    start: FloatArray

    @classmethod
    def white(cls, variance: float) -> Autoregression:
        return cls(np.zeros(0), variance, np.array([variance]))

    @classmethod
    def of_reflections(cls, reflections: FloatArray, variance: float) -> Autoregression:
        """The model with these reflection coefficients (k,), each within 1, and this variance."""
        steps = list(_steps(reflections, variance))
        coefficients, innovation, _ = steps[-1]
        return cls(coefficients, innovation, np.array([gamma for _, _, gamma in steps]))

    @property
    def variance(self) -> float:
        return float(self.start[0])

    @property
    def std(self) -> float:
        """Standard deviation of the innovations."""
        return math.sqrt(self.innovation)

    def with_innovation(self, least: float) -> Autoregression:
        """The same spectral shape, scaled up where the innovation variance is below `least`."""
        if self.innovation == 0.0:
            return Autoregression.white(least)
        scale = max(least / self.innovation, 1.0)
        return Autoregression(self.coefficients, scale * self.innovation, scale * self.start)

    def innovations(self, columns: FloatArray) -> FloatArray:
        """Innovations (n, k) of one run's columns (n, k), in units of their own std."""
        white = np.array(columns)
        for lag, a in enumerate(self.coefficients, start=1):
            white[lag:] -= a * columns[:-lag]
        white /= self.std
        for row, (a, variance) in enumerate(self._predictors[:-1][: len(white)]):
            white[row] = (columns[row] - a @ columns[:row][::-1]) / math.sqrt(variance)
        return white

    @cached_property
    def _predictors(self) -> list[tuple[FloatArray, float]]:
        return [*itertools.islice(_predictions(self.start), len(self.coefficients)), self._whole]

    @property
    def _whole(self) -> tuple[FloatArray, float]:
        return self.coefficients, self.innovation

    def independent_samples(self, lengths: Sequence[int]) -> float:
        """The number of independent samples that determine a mean as well as runs of these lengths;
        at most their sum."""
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
        from scipy.linalg.lapack import dtbtrs

        order = len(self.coefficients)
        known = np.pad(self.start, (0, max(count - order - 1, 0)))[:count]
        if order == 0 or count <= order + 1:
            return known
        # A triangular system of order + 1 diagonals, solved one lag after the other. It begins
        # with the autocovariance at lags 0 to k, which is known.
        bands = np.ones((order + 1, count))
        bands[1:] = -self.coefficients[:, None]
        for lag in range(1, order + 1):
            bands[lag, : order + 1 - lag] = 0.0
        return np.asarray(dtbtrs(bands, known[:, None], uplo="L", diag="U")[0][:, 0])

    def sensitivity(self, size: int) -> FloatArray:
        """(k, size // 2 + 1): change of the spectrum's logarithm with each coefficient."""
        order = len(self.coefficients)
        angles = np.outer(np.arange(1, order + 1), np.arange(size // 2 + 1))
        delays = np.exp(-2j * np.pi / size * angles)
        return np.asarray(2.0 * (delays / (1.0 - self.coefficients @ delays)).real)


def whitening_matrix(
    models: Sequence[Autoregression], runs: Sequence[slice], scales: Sequence[float]
) -> csr_array:
    """Sparse (n, n): the innovations of rows (n,) in runs that follow one another, those of each
    run by its own model, and times its scale.
    """
    from scipy.sparse import csr_array

    columns, data, widths = [], [], [0]
    for model, run, scale in zip(models, runs, scales, strict=True):
        count, order = run.stop - run.start, len(model.coefficients)
        for depth, (coefficients, variance) in enumerate(model._predictors[:count]):
            # One row has so many before it; the last predictor is that of all from there on.
            alike = 1 if depth < order else count - order
            weights = scale * (np.append(-coefficients[::-1], 1.0) / math.sqrt(variance))
            first = np.arange(run.start, run.start + alike, dtype=np.int32)
            reach = np.arange(depth + 1, dtype=np.int32)
            columns.append((first[:, None] + reach).ravel())
            data.append(np.tile(weights, alike))
            widths += [depth + 1] * alike
    count = runs[-1].stop if runs else 0
    starts = np.cumsum(widths, dtype=np.int32)
    joined = (np.concatenate(own) if own else np.zeros(0) for own in (data, columns))
    return csr_array((*joined, starts), shape=(count, count))


def runs_of(count: int, groups: NDArray[np.intp] | None) -> list[slice]:
    """Rows of each run; `groups` (n,) numbers the run that each row belongs to."""
    if groups is None:
        return [slice(0, count)]
    bounds = [0, *(np.flatnonzero(np.diff(groups)) + 1).tolist(), count]
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]


def autoregression(residuals: Sequence[FloatArray], most: int) -> Autoregression:
    """The errors that runs' residuals, each (n,), show; no correction for what a fit took.

    The order is at most `most`, by AIC.
    """
    joined = np.concatenate(list(residuals))
    ends = np.cumsum([0, *(len(r) for r in residuals)]).tolist()
    runs = [slice(a, b) for a, b in itertools.pairwise(ends)]
    model, variance = shown_by(joined, runs, most)
    return model or Autoregression.white(variance)


def shown_by(
    residuals: FloatArray, runs: Sequence[slice], most: int
) -> tuple[Autoregression | None, float]:
    """The model of runs of residuals (n,), damped where necessary, and their mean square.

    None for residuals that are all zero.
    """
    reflections, variance = burg(residuals, runs, most)
    shown = Autoregression.of_reflections(reflections, variance).start
    shown[0] *= 1.0 + (_WHITE_SHARE if len(reflections) else 0.0)
    return damped(shown, largest_reflection(len(residuals))), variance


def largest_reflection(count: int) -> float:
    """The largest reflection coefficient that `count` samples can distinguish from 1."""
    return 1.0 - 1.0 / max(count, 2)


def burg(residuals: FloatArray, runs: Sequence[slice], most: int) -> tuple[FloatArray, float]:
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


def _raised(coefficients: FloatArray, reflection: float) -> FloatArray:
    """The predictor of one order more (Levinson, Durbin)."""
    return np.append(coefficients - reflection * coefficients[::-1], reflection)


def _steps(reflections: FloatArray, variance: float) -> Iterator[tuple[FloatArray, float, float]]:
    """Predictor, its error's variance and the autocovariance at the lag, of orders 0 to k."""
    gamma, a, innovation = [variance], np.zeros(0), variance
    yield a, innovation, variance
    for reflection in map(float, reflections):
        gamma.append(float(a @ np.array(gamma[:0:-1])) + reflection * innovation)
        a = _raised(a, reflection)
        innovation *= 1.0 - reflection**2
        yield a, innovation, gamma[-1]


def _predictions(gamma: FloatArray) -> Iterator[tuple[FloatArray, float]]:
    """Predictor and its error variance, for orders 0 to k, from an autocovariance (k + 1,).

    They end before a variance that is not above 0: such numbers are no autocovariance.
    """
    a, innovation = np.zeros(0), float(gamma[0])
    for order in range(len(gamma)):
        if order:
            reflection = float(gamma[order] - a @ gamma[order - 1 : 0 : -1]) / innovation
            a = _raised(a, reflection)
            innovation *= 1.0 - reflection**2
        if not innovation > 0.0:
            return
        yield a, innovation


def with_autocovariance(gamma: FloatArray, cap: float) -> Autoregression | None:
    """The autoregression with this autocovariance (k + 1,); None if no such model exists.

    Also None for a reflection coefficient beyond `cap` or a negligible innovation variance.
    """
    found = list(_predictions(gamma))
    if len(found) < len(gamma) or not all(abs(a[-1]) < cap for a, _ in found[1:]):
        return None
    model = Autoregression(*found[-1], gamma)
    return model if model.innovation > 0.3 * _WHITE_SHARE * model.variance else None


def damped(gamma: FloatArray, cap: float) -> Autoregression | None:
    """Like `with_autocovariance`, with the correlations damped, g[k] c^k, where necessary.

    c moves every pole. Smooth residuals exceed `cap` at the first lag already. White noise in
    their place would be the worst choice of all. None for residuals that are all zero.
    """
    lags, damping = np.arange(len(gamma)), 0.0
    while damping < 1.0:
        model = with_autocovariance(gamma * (1.0 - damping) ** lags, cap)
        if model is not None:
            return model
        # The first damping tried, as a share of the least distance from a unit root.
        damping = max(2.0 * damping, (1.0 / 16.0) * (1.0 - cap))
    return None


def reflections_of(coefficients: FloatArray) -> FloatArray:
    """(k,), by stepping the order down; beyond 1 where no stationary model exists."""
    found: list[float] = []
    a = coefficients
    while len(a):
        last = float(a[-1])
        found.append(last)
        if abs(last) >= 1.0:
            break
        a = (a[:-1] + last * a[:-1][::-1]) / (1.0 - last**2)
    return np.array(found[::-1])


def stationary(coefficients: FloatArray, innovation: float) -> Autoregression | None:
    """The model with these coefficients (k,) and innovation variance; None where not stationary."""
    reflections = reflections_of(coefficients)
    if len(reflections) < len(coefficients) or not np.all(np.abs(reflections) < 1.0):
        return None
    variance = innovation / float(np.prod(1.0 - reflections**2))
    start = Autoregression.of_reflections(reflections, variance).start
    return Autoregression(coefficients, innovation, start)


__all__ = [
    "Autoregression",
    "autoregression",
    "burg",
    "damped",
    "largest_reflection",
    "reflections_of",
    "runs_of",
    "shown_by",
    "stationary",
    "whitening_matrix",
    "with_autocovariance",
]
