"""Estimates that carry their uncertainty: linear regression and what hangs on it.

Weighted least squares with model-based, group-wise and autocorrelation-consistent
covariance, the nested-model F test, Satterthwaite's degrees of freedom and Fieller's
interval of a ratio. Intervals are 95 % unless a level is given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.errors import NotIdentifiedError
from sysid.estimation.autocovariance import correlated_covariance
from sysid.estimation.covariance import Covariance
from sysid.types import FloatArray

LEVEL = 0.95
NORMAL = NormalDist().inv_cdf(0.5 * (1.0 + LEVEL))
"""Standard errors to each side of a 95 % interval of a normal estimate."""
# Singular values below this share of the largest are linear dependence between columns: of any
# columns, and of columns of equal length, whose dependence is not a matter of units.
RANK_TOLERANCE = 1e-9
_SCALED_RANK_TOLERANCE = 1e-11


@dataclass(frozen=True)
class Estimate:
    """One fitted number, as a bundle holds it (`docs/reference/bundle.md`).

    `interval` is the 95 % interval; a limit that the data do not set is infinite, and of a
    number that a file gives without an interval both are NaN. A parameter that the data do not
    identify has `value` NaN and says why in `reason`.
    """

    value: float
    std: float
    unit: str
    interval: tuple[float, float]
    reason: str | None = None
    _written: Mapping[str, Any] | None = field(default=None, init=False, repr=False, compare=False)

    @classmethod
    def unidentified(cls, unit: str, reason: str) -> Estimate:
        """A parameter that these data do not identify."""
        return cls(math.nan, math.nan, unit, (-math.inf, math.inf), reason)

    @classmethod
    def symmetric(cls, value: float, std: float, unit: str, dof: float) -> Estimate:
        """An estimate with Student's interval of `dof` degrees of freedom."""
        half = t_quantile(dof) * std
        return cls(value, std, unit, (value - half, value + half))

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Estimate:
        """The estimate that a file's object holds; ValueError if the object is not one."""
        if not isinstance(content, Mapping) or "value" not in content:
            raise ValueError("is not an object with a value")
        value, unit = content["value"], content.get("unit", "")
        if not isinstance(unit, str):
            raise ValueError("has a unit that is not text")
        if value is None:
            made = cls.unidentified(unit, str(content.get("reason", "")))
        else:
            limits = content.get("interval", (math.nan, math.nan))
            if not isinstance(limits, list | tuple) or len(limits) != 2:
                raise ValueError("has an interval that is not two limits")
            low, high = limits
            made = cls(
                _number(value),
                _number(content.get("std"), math.nan),
                unit,
                (_number(low, -math.inf), _number(high, math.inf)),
            )
        object.__setattr__(made, "_written", content)
        return made

    @property
    def identified(self) -> bool:
        return self.reason is None

    @property
    def has_interval(self) -> bool:
        """Whether an interval is known, be it open on one side."""
        return self.identified and not math.isnan(self.interval[0])

    @property
    def has_error(self) -> bool:
        """Whether it is a number with a standard error above 0."""
        return self.identified and math.isfinite(self.std) and self.std > 0.0

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom with which its 95 % interval is Student's.

        A bundle keeps no degrees of freedom, but half the interval over the standard error is the
        quantile that they give. Infinite without a finite interval, or with a normal one.
        """
        from scipy.special import stdtridf

        low, high = self.interval
        quantile = 0.5 * (high - low) / self.std
        # So little wider than the normal one, it is that: 1.96 for the quantile, for example.
        if not math.isfinite(quantile) or quantile <= NORMAL * (1.0 + 1e-3):
            return math.inf
        return float(stdtridf(0.5 * (1.0 + LEVEL), quantile))

    def times(self, factor: float) -> Estimate:
        """The estimate of the number times a factor above 0 (unit as it was)."""
        limits = (factor * self.interval[0], factor * self.interval[1])
        return Estimate(factor * self.value, factor * self.std, self.unit, limits, self.reason)

    def shifted(self, by: float) -> Estimate:
        """The estimate of the number plus one that is known exactly."""
        limits = (self.interval[0] + by, self.interval[1] + by)
        return Estimate(self.value + by, self.std, self.unit, limits, self.reason)

    def within(self, lower: float, upper: float) -> Estimate:
        """The estimate of a number that lies within bounds: so does its interval."""
        if not self.has_interval:
            return self
        low, high = (min(max(limit, lower), upper) for limit in self.interval)
        return Estimate(self.value, self.std, self.unit, (low, high), self.reason)

    def covering(self, others: Sequence[Estimate]) -> Estimate:
        """The estimate of a number whose interval covers those of others too, as it may be any of
        them; its standard error is that of so wide an interval."""
        limits = [self.interval, *(other.interval for other in others)]
        low, high = min(own[0] for own in limits), max(own[1] for own in limits)
        std = max(self.std, 0.5 * (high - low) / NORMAL)
        return replace(self, std=std, interval=(low, high))

    def with_error(self, std: float) -> Estimate:
        """The estimate with a further, normal error of this standard deviation."""
        if not (std > 0.0 and self.has_error):
            return self
        total = math.hypot(self.std, std)
        dof = self.degrees_of_freedom * (total / self.std) ** 4
        return replace(self.symmetric(self.value, total, self.unit, dof), reason=self.reason)

    def with_uniform_error(self, reach: float) -> Estimate:
        """The estimate with a further error, uniform within +- `reach`: that of half a count.

        Half the interval is the quantile of the sum of a Student's and a uniform error; with the
        normal quantile, the interval would be wider than all values that a count allows.
        """
        if not (reach > 0.0 and self.identified and math.isfinite(self.std)):
            return self
        total = math.hypot(self.std, reach / math.sqrt(3.0))
        dof = self.degrees_of_freedom if self.std > 0.0 else math.inf
        half = _with_uniform(self.std, dof, reach)
        limits = (self.value - half, self.value + half)
        return Estimate(self.value, total, self.unit, limits, self.reason)

    def holds(self, value: float) -> bool:
        """Whether the interval holds `value`."""
        return self.interval[0] <= value <= self.interval[1]

    def to_json(self) -> dict[str, Any]:
        """The bundle's object; an infinite limit or error becomes null."""
        if self._written is not None:
            return dict(self._written)
        if self.reason is not None:
            return {"value": None, "identified": False, "reason": self.reason}
        written = {"value": self.value, "std": finite_or_none(self.std), "unit": self.unit}
        if self.has_interval:
            return {**written, "interval": [finite_or_none(limit) for limit in self.interval]}
        return written

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Lets a pydantic model have fields of this type (pydantic is not imported for it)."""
        from pydantic_core import core_schema

        def read(value: Any) -> Estimate:
            return value if isinstance(value, Estimate) else cls.from_json(value)

        return core_schema.no_info_plain_validator_function(
            read,
            serialization=core_schema.plain_serializer_function_ser_schema(cls.to_json),
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, source: Any, handler: Any) -> dict[str, Any]:
        return {"x-ref": "parameter"}


def _number(value: Any, absent: float | None = None) -> float:
    """A file's number; `absent` where it is null. ValueError for text and the like."""
    if value is None and absent is not None:
        return absent
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("holds what is not a number")
    return float(value)


def finite_or_none(value: float) -> float | None:
    """The value for a file, which holds null for one that is not finite."""
    return value if math.isfinite(value) else None


def t_quantile(dof: float, level: float = LEVEL) -> float:
    """Two-sided quantile of Student's t; infinite without degrees of freedom."""
    from scipy.special import ndtri, stdtrit

    if not dof > 0.0:
        return math.inf
    share = 0.5 * (1.0 + level)
    return float(ndtri(share) if math.isinf(dof) else stdtrit(dof, share))


def _with_uniform(std: float, dof: float, reach: float, level: float = LEVEL) -> float:
    """What |e + u| stays below in this share: e Student's of scale `std`, u uniform in +- reach."""
    from scipy.optimize import brentq
    from scipy.special import ndtr, stdtr

    if not std > 0.0:
        return level * reach
    widest = t_quantile(dof, level) * std + reach
    # Student's distribution of one degree of freedom has no mean, which the integral below needs;
    # next to an error of a million times the reach, the integral's difference is lost in rounding.
    if dof <= 1.0 or reach < 1e-6 * std:
        return widest

    def integral(z: float) -> float:
        """Of Student's distribution function up to z."""
        if math.isinf(dof):
            return float(z * ndtr(z)) + math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        log = math.lgamma(0.5 * (dof + 1.0)) - math.lgamma(0.5 * dof)
        log -= 0.5 * math.log(dof * math.pi) + 0.5 * (dof - 1.0) * math.log1p(z * z / dof)
        return z * float(stdtr(dof, z)) + dof / (dof - 1.0) * math.exp(log)

    def short(x: float) -> float:
        """By how much less than the level lies within x."""
        above = integral((x + reach) / std) - integral((x - reach) / std)
        return above * std / reach - 1.0 - level

    return float(brentq(short, 0.0, widest, xtol=1e-9 * widest))


def chi_squared_quantile(dof: FloatArray | float, level: float) -> FloatArray:
    """What chi-squared with these degrees of freedom, (n,) or one, stays below in this share."""
    from scipy.special import gammaincinv

    return np.asarray(2.0 * gammaincinv(np.asarray(dof) / 2.0, level))


def t_p_value(statistic: float, dof: float) -> float:
    """Two-sided p-value of Student's t."""
    from scipy.special import stdtr

    return float(2.0 * stdtr(dof, -abs(statistic)))


def mean_estimate(values: FloatArray, unit: str) -> Estimate:
    """Mean of independent values (n,) with Student's interval; n = 1 has no error."""
    n = len(values)
    std = float(np.std(values, ddof=1) / math.sqrt(n)) if n > 1 else math.inf
    return Estimate.symmetric(float(np.mean(values)), std, unit, n - 1)


@dataclass(frozen=True)
class LinearFit:
    """Weighted least squares of a target (n,) on regressors (n, p).

    `residuals` (n,) are target less prediction; `unscaled` (p, p) is (X' W X)^-1;
    `variance` is the weighted residual variance, `dof` n - p. `regressors` and `weights`
    are kept for the other covariances.
    """

    coefficients: FloatArray
    residuals: FloatArray
    unscaled: FloatArray
    regressors: FloatArray
    weights: FloatArray

    @property
    def dof(self) -> int:
        return len(self.residuals) - len(self.coefficients)

    @property
    def variance(self) -> float:
        if self.dof <= 0:
            return math.inf
        return float(self.weights @ self.residuals**2) / self.dof

    @property
    def covariance(self) -> FloatArray:
        """(p, p), for independent errors of variance proportional to 1/weight."""
        return self.variance * self.unscaled

    def correlated_covariance(self, groups: NDArray[np.intp] | None = None) -> Covariance:
        """For errors that follow one another in time, relative to 1/sqrt(weight).

        `groups` (n,) numbers the runs of rows that follow one another
        (`sysid.estimation.autocovariance`).
        """
        root = np.sqrt(self.weights)
        return correlated_covariance(
            self.regressors * root[:, None], self.residuals * root, self.unscaled, groups
        )

    @property
    def influence(self) -> FloatArray:
        """(p, n): change of each coefficient with each value of the target."""
        return np.asarray(self.unscaled @ (self.regressors.T * self.weights))

    @property
    def leverage(self) -> FloatArray:
        """(n,): change of each prediction with its own value of the target."""
        return np.asarray(np.einsum("ij,ji->i", self.regressors, self.influence))


def linear_fit(
    regressors: FloatArray,
    target: FloatArray,
    weights: FloatArray | None = None,
    names: Sequence[str] = (),
) -> LinearFit:
    """Fit target (n,) = regressors (n, p) @ coefficients, weights (n,) = 1/variance.

    Raises NotIdentifiedError, naming the columns (`names`), when a column is a linear
    combination of the others or there are fewer rows than columns.
    """
    x = np.asarray(regressors, dtype=float)
    w = np.ones(len(target)) if weights is None else np.asarray(weights, dtype=float)
    scale = np.sqrt(w @ x**2)
    scale[scale == 0.0] = 1.0
    root = np.sqrt(w)
    u, s, vt = np.linalg.svd(root[:, None] * x / scale, full_matrices=False)
    if len(s) < x.shape[1] or s[-1] < _SCALED_RANK_TOLERANCE * s[0]:
        null = np.abs(vt[-1]) if len(vt) == x.shape[1] else np.ones(x.shape[1])
        tied = [name for name, part in zip(names, null, strict=False) if part > 0.1]
        raise NotIdentifiedError(
            f"the data cannot distinguish {', '.join(tied) or 'the regressors'}"
        )
    coefficients = _refined(root[:, None] * x / scale, root * target, u, s, vt) / scale
    half = (vt.T / s) / scale[:, None]
    return LinearFit(coefficients, target - x @ coefficients, half @ half.T, x, w)


def _refined(
    x: FloatArray, target: FloatArray, u: FloatArray, s: FloatArray, vt: FloatArray
) -> FloatArray:
    """Coefficients by the singular values `u`, `s`, `vt` of x (n, p), refined once.

    The step solves for coefficients and residuals together, with their defects in extended
    precision (Bjorck, BIT 7, 1967): what large residuals lose in nearly dependent columns
    comes back.
    """
    found = (vt.T / s) @ (u.T @ target)
    long, right = x.astype(np.longdouble), target.astype(np.longdouble)
    residual = (right - long @ found).astype(float)
    defect = (right - residual - long @ found).astype(float)
    slope = (long.T @ residual).astype(float)
    return np.asarray(found + (vt.T / s) @ (u.T @ defect + (vt @ slope) / s))


@dataclass(frozen=True)
class FTest:
    """F test of nested linear models."""

    statistic: float
    dof_numerator: int
    dof_denominator: int
    p_value: float


def nested_f_test(full: FloatArray, reduced: FloatArray, target: FloatArray) -> FTest | None:
    """Whether the columns that `full` (n, p) has beyond `reduced` (n, q) matter.

    Columns may be dependent (indicator variables): ranks count, not columns. None where
    nothing can be tested: the rank does not increase, or no degrees of freedom remain.
    """
    from scipy.special import fdtrc

    (rss_full, rank_full), (rss_reduced, rank_reduced) = (
        _residual_sum(x, target) for x in (full, reduced)
    )
    more, left = rank_full - rank_reduced, len(target) - rank_full
    if more < 1 or left < 1 or rss_full <= 0.0:
        return None
    f = (rss_reduced - rss_full) / more / (rss_full / left)
    return FTest(f, more, left, float(fdtrc(more, left, max(f, 0.0))))


def _residual_sum(x: FloatArray, target: FloatArray) -> tuple[float, int]:
    coefficients, _, rank, _ = np.linalg.lstsq(x, target, rcond=RANK_TOLERANCE)
    return float(np.sum((target - x @ coefficients) ** 2)), int(rank)


def indicator(labels: Sequence[Any] | NDArray[Any]) -> FloatArray:
    """One column of 0 and 1 for each distinct label, (n, k)."""
    values = np.asarray(labels)
    return np.asarray(values[:, None] == np.unique(values)[None, :], dtype=float)


@dataclass(frozen=True)
class Variance:
    """An estimated variance and its degrees of freedom, 0 where nothing is known of it."""

    value: float = 0.0
    dof: float = 0.0

    @classmethod
    def of(cls, values: FloatArray) -> Variance:
        """That of values (n,), unknown of fewer than two."""
        return cls(float(np.var(values, ddof=1)), len(values) - 1.0) if len(values) > 1 else cls()

    def pooled(self, other: Variance) -> Variance:
        """Two estimates of the same variance as one."""
        dof = self.dof + other.dof
        return Variance((self.dof * self.value + other.dof * other.value) / max(dof, 1.0), dof)


UNKNOWN = Variance()


def satterthwaite(variances: FloatArray, dofs: FloatArray) -> float:
    """Degrees of freedom of a sum of independent variance estimates (Satterthwaite 1946)."""
    v, d = np.asarray(variances, dtype=float), np.asarray(dofs, dtype=float)
    total, known = float(v.sum()), v > 0.0
    if total <= 0.0:
        return float(d.sum())
    return total**2 / float(np.sum(v[known] ** 2 / d[known]))


def group_covariances(
    fit: LinearFit, influence: FloatArray, residuals: FloatArray, groups: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Covariance of linear estimates whose groups of observations differ in variance.

    `influence` (m, n) maps errors to the m estimates, `residuals` (m, n) are the errors as
    each estimate sees them, relative to 1/sqrt(weight); `groups` (n,) numbers from 0.
    Returns (g, m, m) and the degrees of freedom of each group's variance, (g,): its trials
    less its share of the fitted coefficients (the sum of its leverages).
    """
    count = int(groups.max()) + 1
    scale = np.sqrt(fit.weights)
    relative, reach = residuals * scale, influence / scale
    shares = np.empty((count, len(influence), len(influence)))
    dofs = np.empty(count)
    for g in range(count):
        rows = groups == g
        dofs[g] = max(float(rows.sum() - fit.leverage[rows].sum()), 1e-12)
        spread = relative[:, rows] @ relative[:, rows].T / dofs[g]
        shares[g] = spread * (reach[:, rows] @ reach[:, rows].T)
    return shares, dofs


def fieller_interval(
    numerator: float,
    denominator: float,
    shares: FloatArray,
    dofs: FloatArray,
    level: float = LEVEL,
) -> tuple[float, float]:
    """Interval of numerator/denominator, both normal and correlated (Fieller 1954).

    `shares` (g, 2, 2) are the covariance's independent parts, each estimated with `dofs`
    (g,). The interval holds every ratio r that the contrast numerator - r denominator does
    not reject; Satterthwaite's degrees of freedom are taken of that very contrast, so at r.
    A limit is infinite where no ratio on that side is rejected.
    """

    above, across, below = shares[:, 0, 0], shares[:, 0, 1], shares[:, 1, 1]

    def rejected(ratio: float) -> float:
        variances = above - 2.0 * ratio * across + ratio**2 * below
        variance = float(variances.sum())
        if variance <= 0.0:
            return math.inf
        t = abs(numerator - ratio * denominator) / math.sqrt(variance)
        return t - t_quantile(satterthwaite(variances, dofs), level)

    ratio = numerator / denominator
    contrast = np.array([1.0, -ratio])
    spread = math.sqrt(max(float(contrast @ shares.sum(axis=0) @ contrast), 0.0))
    step = spread / abs(denominator)
    if step == 0.0:
        return ratio, ratio
    # As |r| grows the test becomes that of the denominator alone, which settles both sides.
    if rejected(ratio + 1e6 * step) <= 0.0 and rejected(ratio - 1e6 * step) <= 0.0:
        return -math.inf, math.inf
    return _edge(rejected, ratio, -step), _edge(rejected, ratio, step)


def _edge(rejected: Callable[[float], float], start: float, step: float) -> float:
    """First change of sign of `rejected` from `start` on, in growing steps, then halved."""
    inside, outside = start, start + step
    while rejected(outside) <= 0.0:
        step *= 1.3
        inside, outside = outside, outside + step
        if abs(outside - start) > 1e9 * max(abs(start), abs(step) * 1e-9):
            return math.copysign(math.inf, step)
    for _ in range(45):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if rejected(middle) <= 0.0 else (inside, middle)
    return 0.5 * (inside + outside)
