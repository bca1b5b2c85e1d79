"""What a residual shows about a model: fit percentage, whiteness, correlation with the inputs.

Both tests examine many lags jointly: `band` is drawn so that a residual without structure has a
correlation outside it, at any lag of any input, in `alarm_rate` of the cases (default 5 %).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.autoregression import Autoregression, burg
from sysid.estimation.linear import RANK_TOLERANCE
from sysid.estimation.multiple_tests import SIGNIFICANCE
from sysid.signals import MIN_SAMPLES
from sysid.types import FloatArray, IntArray

ALARM_RATE = SIGNIFICANCE
MAX_AR_ORDER = 30
_DRAWS = 20_000
_CHUNK_ROWS = 32_768


def rmse(residual: FloatArray) -> float:
    """Root mean square of a residual (n,), in its unit."""
    return math.sqrt(float(np.mean(np.square(residual))))


def max_error(residual: FloatArray) -> float:
    """Largest absolute value of a residual (n,), in its unit."""
    return float(np.max(np.abs(residual)))


def fit_percentage(measured: FloatArray, simulated: FloatArray) -> float | None:
    """100 (1 - norm(y - y_hat)/norm(y - mean(y))), both (n,).

    100 is perfect, 0 no better than the mean, and it may be negative. None where the
    measurement is constant.
    """
    spread = float(np.linalg.norm(measured - np.mean(measured)))
    if spread == 0.0:
        return None
    return 100.0 * (1.0 - float(np.linalg.norm(measured - simulated)) / spread)


@dataclass(frozen=True)
class CorrelationTest:
    """Correlations of one residual with itself or with one input, and their band.

    `lags` (m,) samples, `correlations` (m,), `band` (m,): half-width at each lag. `p_value`
    is that of the whole family (all lags, and all inputs tested together); `passed` is
    whether it is at least the alarm rate, that is, whether all of the family lie inside.
    `order` is that of the prewhitening filter (0: none was needed or wanted), `samples` how
    many samples took part.
    """

    lags: IntArray
    correlations: FloatArray
    band: FloatArray
    p_value: float
    passed: bool
    order: int
    samples: int

    @property
    def outside(self) -> int:
        """How many lags lie outside the band."""
        return int(np.count_nonzero(np.abs(self.correlations) > self.band))

    def to_json(self) -> dict[str, Any]:
        """Verdict and the largest correlation, without the arrays."""
        largest = int(np.argmax(np.abs(self.correlations) / self.band))
        return {
            "passed": self.passed,
            "p_value": self.p_value,
            "largest_correlation": float(self.correlations[largest]),
            "at_lag": int(self.lags[largest]),
            "band": float(self.band[largest]),
            "lags_outside": self.outside,
            "lags": len(self.lags),
            "prewhitening_order": self.order,
        }


# --- whiteness -------------------------------------------------------------------------


def autocovariance(values: FloatArray, max_lag: int) -> FloatArray:
    """Biased autocovariance at lags 0 to `max_lag`, (max_lag + 1,), mean removed; by FFT."""
    from scipy import fft

    x = np.asarray(values, dtype=float) - np.mean(values)
    size = fft.next_fast_len(len(x) + max_lag, real=True)
    spectrum = fft.rfft(x, size)
    power = spectrum.real**2 + spectrum.imag**2
    return np.asarray(fft.irfft(power, size)[: max_lag + 1] / len(x), dtype=float)


def whiteness_test(
    residual: FloatArray, max_lag: int | None = None, alarm_rate: float = ALARM_RATE
) -> CorrelationTest | None:
    """Whether a residual (n,) is white: its largest autocorrelation at lags 1 to `max_lag`.

    Default 25 lags, at most n/5. Under whiteness the autocorrelations are independent with
    variance (n - k)/(n (n + 2)) (Box, Pierce 1970; Ljung, Box 1978) and, as correlations are,
    distributed like those of a Gaussian sample of that variance; the band at each lag is
    Sidak's, so that the whole family errs at the alarm rate. (The Ljung-Box statistic itself
    errs in 6.5 % of the cases at n = 200.) None below 50 samples or for a constant.
    """
    n = len(residual)
    lags = np.arange(1, min(max_lag or 25, n // 5) + 1)
    if n < MIN_SAMPLES:
        return None
    covariance = autocovariance(residual, len(lags))
    if covariance[0] <= _constant_variance(residual):
        return None
    correlations = covariance[1:] / covariance[0]
    freedom = n * (n + 2.0) / (n - lags) - 1.0
    single = -math.expm1(math.log1p(-alarm_rate) / len(lags))
    p_values = _correlation_p_values(correlations, freedom)
    # 1 - (1 - p)^m, kept exact where p is tiny.
    family = float(-np.expm1(len(lags) * np.log1p(-np.min(p_values))))
    return CorrelationTest(
        lags=lags,
        correlations=correlations,
        band=_correlation_quantile(single, freedom),
        p_value=family,
        passed=family >= alarm_rate,
        order=0,
        samples=n,
    )


def _constant_variance(values: FloatArray) -> float:
    """Variance below which a sequence is constant but for rounding."""
    return float((1e-12 * np.max(np.abs(values), initial=0.0)) ** 2)


def _correlation_p_values(correlations: FloatArray, freedom: FloatArray) -> FloatArray:
    """Two-sided, of correlations with variance 1/(freedom + 1): t = r sqrt(f/(1 - r^2))."""
    from scipy.special import stdtr

    r = np.minimum(np.abs(correlations), 1.0 - 1e-15)
    return np.asarray(2.0 * stdtr(freedom, -r * np.sqrt(freedom / (1.0 - r * r))))


def _correlation_quantile(p_value: float, freedom: FloatArray) -> FloatArray:
    """The correlation of this two-sided p-value."""
    from scipy.special import stdtrit

    t = stdtrit(freedom, 1.0 - 0.5 * p_value)
    return np.asarray(t / np.sqrt(freedom + t * t))


# --- correlation with the inputs -------------------------------------------------------


def cross_correlation_test(
    residual: FloatArray,
    inputs: Mapping[str, FloatArray],
    lags: IntArray | None = None,
    alarm_rate: float = ALARM_RATE,
    max_order: int = MAX_AR_ORDER,
    seed: int = 0,
) -> dict[str, CorrelationTest]:
    """Whether a residual (n,) depends on inputs (n,) now or `lags` samples ago.

    The band is one for the whole family, all lags of all inputs. A coloured residual is
    first whitened by an autoregressive filter of order up to `max_order` (Burg's method,
    order by AIC), and the inputs go through the same filter (Box, Jenkins 1976; Haugh 1976):
    the correlations are those of the filtered series. The correlations at neighbouring lags
    of a slow input are nearly one and the same, so that independent bands would be far too
    wide: given the inputs, the correlations of Gaussian white noise are jointly distributed
    as a point on a sphere projected on the inputs' directions, and the largest is drawn
    20,000 times from that (`seed`), with no approximation.

    Default lags: 0, then up to a tenth of the samples in geometric steps. Constant inputs are
    omitted; empty where all are constant, the residual is constant, or n < 50.
    """
    e = np.asarray(residual, dtype=float)
    moving = {k: u for k, u in inputs.items() if np.var(u) > _constant_variance(u)}
    if len(e) < MIN_SAMPLES or not moving or np.var(e) <= _constant_variance(e):
        return {}
    lags = spread_lags(len(e)) if lags is None else np.asarray(lags, dtype=np.intp)
    e, white, order = prewhitened(e, [*moving.values()], max_order)
    family = _Family.of(e, white, lags)
    if not family.between.any():
        return {}
    largest = family.largest_of_noise(seed)
    band = float(np.quantile(largest, 1.0 - alarm_rate))
    observed = float(np.max(np.abs(family.correlations)))
    p_value = (1.0 + np.count_nonzero(largest >= observed)) / (1.0 + len(largest))
    rows = family.correlations.reshape(len(moving), len(lags))
    return {
        name: CorrelationTest(
            lags=lags,
            correlations=row,
            band=np.full(len(lags), band),
            p_value=float(p_value),
            passed=observed <= band,
            order=order,
            samples=family.samples,
        )
        for name, row in zip(moving, rows, strict=True)
    }


def spread_lags(n: int) -> IntArray:
    """Lag 0, and up to 24 from 1 to n/10 samples in geometric steps."""
    return np.unique(np.round(np.geomspace(1, n // 10, 24)).astype(np.intp) - 1)


def prewhitened(
    residual: FloatArray, inputs: Sequence[FloatArray], max_order: int = MAX_AR_ORDER
) -> tuple[FloatArray, list[FloatArray], int]:
    """A residual and inputs, (n,) each, through the filter that whitens the residual, its order p.

    The mean is removed first, and the rows that the start affects, (n - p,) remain. An
    autoregression of order up to n/10 at most, undamped: drift under sensor noise needs all of it.
    """
    columns = np.column_stack([residual, *inputs])
    columns -= columns.mean(axis=0)
    n = len(columns)
    reflections, variance = burg(columns[:, 0], [slice(0, n)], min(max_order, n // 10))
    model = Autoregression.of_reflections(reflections, variance)
    own, *others = model.innovations(columns)[len(reflections) :].T
    return own, others, len(reflections)


@dataclass(frozen=True)
class _Family:
    """Correlations (m,) of a residual with lagged inputs, and theirs with each other (m, m)."""

    correlations: FloatArray
    between: FloatArray
    samples: int

    @classmethod
    def of(cls, residual: FloatArray, inputs: list[FloatArray], lags: IntArray) -> _Family:
        """All sums run over the rows that have every lag, a piece at a time."""
        first, n = int(lags.max()), len(residual)
        count = len(inputs) * len(lags)
        gram, sums = np.zeros((count + 1, count + 1)), np.zeros(count + 1)
        for start in range(first, n, _CHUNK_ROWS):
            stop = min(start + _CHUNK_ROWS, n)
            columns = [u[start - k : stop - k] for u in inputs for k in lags]
            block = np.array([*columns, residual[start:stop]])
            gram += block @ block.T
            sums += block.sum(axis=1)
        samples = n - first
        before = np.diag(gram).copy()
        gram -= np.outer(sums, sums) / samples
        size = np.sqrt(np.maximum(np.diag(gram), 0.0))
        # An input that moves only where a lag does not reach is constant at that lag.
        size[np.diag(gram) <= RANK_TOLERANCE * before] = np.inf
        scaled = gram / np.outer(size, size)
        return cls(scaled[-1, :-1], scaled[:-1, :-1], samples)

    def largest_of_noise(self, seed: int) -> FloatArray:
        """Largest absolute correlation of white noise with the lagged inputs, (draws,)."""
        values, vectors = np.linalg.eigh(self.between)
        # Directions with less variance than this share of the largest do not affect the maximum.
        kept = values > 1e-7 * values[-1]
        rank = int(kept.sum())
        directions = (vectors[:, kept] * np.sqrt(values[kept])).astype(np.float32)
        inside = _standard_normal(-(-rank // 16) * 16, seed)[:rank]
        # The part of the noise orthogonal to every input only adds to its length.
        rest = np.random.default_rng([seed, 1]).chisquare(max(self.samples - 1 - rank, 1), _DRAWS)
        length = np.sqrt(np.sum(np.square(inside), axis=0) + rest)
        projected = directions @ inside
        largest = np.maximum(projected.max(axis=0), -projected.min(axis=0))
        return np.asarray(largest / length, dtype=float)


@functools.lru_cache(maxsize=8)
def _standard_normal(rows: int, seed: int) -> NDArray[np.float32]:
    """(rows, draws), the same in every call."""
    rng = np.random.default_rng([seed, 0])
    return rng.standard_normal((rows, _DRAWS), dtype=np.float32)


__all__ = [
    "ALARM_RATE",
    "CorrelationTest",
    "autocovariance",
    "cross_correlation_test",
    "fit_percentage",
    "max_error",
    "prewhitened",
    "rmse",
    "spread_lags",
    "whiteness_test",
]
