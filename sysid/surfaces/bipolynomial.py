"""Bipolynomial surface of mean flow over duty and pressure (thesis 3.7.1), and its inverse."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.errors import NotIdentifiedError, input_error
from sysid.estimation.linear import Estimate
from sysid.surfaces.bipolynomial_law import BipolynomialLaw
from sysid.surfaces.domain import Domain
from sysid.surfaces.estimator import (
    ExportedNumbers,
    Regressor,
    checked_samples,
    checked_weights,
    columns,
)
from sysid.surfaces.inverse import FlagArray, evaluated
from sysid.types import FloatArray

N_TERMS = 9
# Thesis 3.7.1: a1 to i1 multiply u^i P^j in this order.
EXPONENTS = tuple((i, j) for i in range(3) for j in range(3))
# Slope that a monotone fit keeps, as a share of its median; pressures at which it is enforced.
_LEAST_SLOPE = 0.05
# Rows: Chebyshev polynomials T0, T1, T2 in powers of their argument.
_CHEBYSHEV = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 2.0]])


class Bipolynomial(Regressor):
    """m(u, P) = sum c_ij u^i P^j, i, j = 0..2, for one valve in one direction.

    X (n, 2) is duty (0 to 1) and absolute chamber pressure [Pa], y (n,) the mean flow
    [kg/s], negative when discharging. Duties to which the flow does not respond (see
    `sysid.surfaces.domain`) are excluded from the fit; beyond the domain the inputs are
    saturated, so that the flow stays at its value at the edge.

    domain: a `Domain` to use in place of the one found in the samples. monotone: where least
    squares alone would let the flow fall with the duty somewhere in the domain, take the
    nearest coefficients (in the sum of squares) with which it rises; no valve does otherwise,
    and the inverse needs it. Standard errors are those of the free fit.

    Learned: `coefficients_` (9,) in the thesis' order and units, kg/(s Pa^j), `std_` (9,),
    `interval_` (9, 2) of 95 %, `covariance_` (9, 9), `scaled_coefficients_` (9,) over
    Chebyshev polynomials of the inputs scaled to [-1, 1] by `scaling_` (2, 2: centre and
    half range of duty and pressure), `condition_` of the scaled normal equations,
    `rmse_flow_` [kg/s], `n_samples_`, `domain_`, `constrained_` (whether `monotone` acted).
    """

    def __init__(self, domain: Domain | None = None, monotone: bool = True) -> None:
        self.domain = domain
        self.monotone = monotone

    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        groups: ArrayLike | None = None,
    ) -> Bipolynomial:
        """Weighted least squares. `sample_weight` (n,): 1/std^2 up to a factor.

        Standard errors take the samples as independent, with the scale of the noise from
        the residual. With `groups` (n,), the test of each sample, they are cluster-robust
        (CR1, t with G - 1 degrees of freedom): samples of one test share their errors, and
        where the surface does not fit the valve exactly only these hold.
        Raises InputError for unusable samples, NotIdentifiedError where they cannot carry
        nine terms.
        """
        duty, pressure, flow = checked_samples(*columns(X, ("duty", "pressure")), y)
        weight = checked_weights(sample_weight, len(flow))
        label = None if groups is None else _codes(groups, len(flow))
        domain = self.domain or Domain.from_samples(duty, pressure, flow)
        inside = domain.holds_duty(duty)
        if not inside.all():
            duty, pressure, flow = duty[inside], pressure[inside], flow[inside]
            weight = None if weight is None else weight[inside]
            label = None if label is None else label[inside]
        if len(flow) <= N_TERMS:
            raise NotIdentifiedError(
                f"nine terms cannot be identified from {len(flow)} samples; valve-pwm tests "
                "at three duties or more over the whole pressure range would"
            )
        self.domain_ = domain
        self.scaling_ = np.array([_scaling(duty), _scaling(pressure)])
        self._solve(duty, pressure, flow, weight, label)
        self.n_features_in_ = 2
        return self

    def _solve(
        self,
        duty: FloatArray,
        pressure: FloatArray,
        flow: FloatArray,
        weight: FloatArray | None,
        label: NDArray[np.intp] | None,
    ) -> None:
        gram, moment, power = _normal_equations(self.scaling_, duty, pressure, flow, weight)
        # Equilibrated first: the condition number then does not depend on the terms' size.
        size = np.sqrt(np.diag(gram))
        if not (size > 0).all():
            raise _not_enough_spread()
        correlation = gram / np.outer(size, size)
        self.condition_ = float(np.linalg.cond(correlation))
        if not self.condition_ < 1e10:
            raise _not_enough_spread()
        inverse = np.linalg.inv(correlation) / np.outer(size, size)
        c = np.linalg.solve(correlation, moment / size) / size
        squares, meat = power - float(c @ moment), np.zeros((N_TERMS, N_TERMS))
        # The difference has lost its digits where the fit is nearly exact.
        if label is not None or squares < 1e-6 * power:
            squares, meat = _residual_sums(self.scaling_, c, duty, pressure, flow, weight, label)
        n = len(flow) if weight is None else int(np.count_nonzero(weight))
        if label is None:
            freedom = n - N_TERMS
            covariance = inverse * (squares / freedom)
        else:
            clusters = len(np.unique(label))
            if clusters < 2:
                raise input_error("groups", "hold one test only", "omit them")
            freedom = clusters - 1
            factor = clusters / freedom * (n - 1) / (n - N_TERMS)
            covariance = factor * inverse @ meat @ inverse
        self.constrained_ = False
        if self.monotone:
            rising = _rising(self.scaling_, self.domain_, c, gram)
            self.constrained_ = rising is not c
            squares += float((rising - c) @ gram @ (rising - c))
            c = rising
        self.scaled_coefficients_ = c
        self.rmse_flow_ = float(np.sqrt(squares / (len(flow) if weight is None else weight.sum())))
        self.n_samples_ = n
        self._set_thesis_units(covariance, freedom)

    def _set_thesis_units(self, scaled_covariance: FloatArray, freedom: int) -> None:
        from scipy.special import stdtrit

        to_powers = _to_powers(self.scaling_)
        self.coefficients_ = to_powers @ self.scaled_coefficients_
        self.covariance_ = to_powers @ scaled_covariance @ to_powers.T
        self.std_ = np.sqrt(np.maximum(np.diag(self.covariance_), 0.0))
        half = float(stdtrit(freedom, 0.975)) * self.std_
        self.interval_ = np.column_stack((self.coefficients_ - half, self.coefficients_ + half))

    def predict(self, X: ArrayLike) -> FloatArray:
        """Mean flow (n,) [kg/s] at X (n, 2): duty, pressure [Pa]; saturated at the domain."""
        self._require_fitted()
        return self.flow(*columns(X, ("duty", "pressure")))[0]

    def flow(self, duty: ArrayLike, pressure: ArrayLike) -> tuple[FloatArray, FlagArray]:
        """Mean flow [kg/s] and `Saturation` flags, in the inputs' common shape.

        Duty is saturated at the domain's duty range, pressure at its pressure range. A
        duty inside that range which was not seen at this pressure is flagged and
        extrapolated.
        """
        return evaluated(self.law.bounded_flow, duty, pressure)

    def duty(self, flow: ArrayLike, pressure: ArrayLike) -> tuple[FloatArray, FlagArray]:
        """Duty for a wanted flow [kg/s] and `Saturation` flags (thesis 3.7.2, 3.7.3).

        All branches, see `inverse.invert_quadratic`; saturated at the duties that were seen
        at this pressure.
        """
        return evaluated(self.law.bounded_duty, flow, pressure)

    @property
    def law(self) -> BipolynomialLaw:
        """The surface as a simulation or a controller takes it."""
        self._require_fitted()
        by_duty = _powers(self.scaling_[0]).T @ self.scaled_coefficients_.reshape(3, 3)
        return BipolynomialLaw(
            **self.domain_.hull(), coefficients=by_duty, pressure_scaling=self.scaling_[1]
        )

    def terms(self) -> dict[str, Estimate]:
        """The coefficients by their terms ("u^1 P^2"), in the thesis' order and units."""
        self._require_fitted()
        return {
            f"u^{i} P^{j}": Estimate(
                float(value),
                float(std),
                "kg/s" if j == 0 else f"kg/(s Pa^{j})",
                (float(interval[0]), float(interval[1])),
            )
            for (i, j), value, std, interval in zip(
                EXPONENTS, self.coefficients_, self.std_, self.interval_, strict=True
            )
        }

    def exported(self) -> tuple[ExportedNumbers, ...]:
        """Its numbers for other programs; C(i, j) of MATLAB multiplies u^(i-1) P^(j-1)."""
        units = [("kg/s", "kg/(s Pa)", "kg/(s Pa^2)")[j] for _, j in EXPONENTS]
        return (
            ExportedNumbers("exponents", [list(pair) for pair in EXPONENTS], "1"),
            ExportedNumbers("coefficients", self.coefficients_, units, "C", (3, 3)),
            ExportedNumbers(
                "scaled_coefficients", self.scaled_coefficients_, "kg/s", "C_scaled", (3, 3)
            ),
        )

    scaled_units: ClassVar = {"duty": "1", "pressure_pa": "Pa"}
    """Unit of each row of `scaling_`, by its name."""

    def to_dict(self) -> dict[str, Any]:
        """JSON-able: coefficients in the thesis' units with std and interval, scaling,
        domain, RMSE of flow. `from_dict` reads it."""
        self._require_fitted()
        terms = [
            {
                "term": term,
                "value": estimate.value,
                "std": estimate.std,
                "interval": list(estimate.interval),
                "unit": estimate.unit,
            }
            for term, estimate in self.terms().items()
        ]
        return {
            "kind": "bipolynomial",
            "coefficients": terms,
            "scaling": {
                "duty": self.scaling_[0].tolist(),
                "pressure_pa": self.scaling_[1].tolist(),
            },
            "domain": self.domain_.to_dict(),
            "rmse_flow_kg_s": self.rmse_flow_,
            "n_samples": self.n_samples_,
            "constrained": self.constrained_,
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Bipolynomial:
        """A surface from `to_dict`'s form, without `covariance_` and `condition_`.

        Raises InputError for a missing key or a wrong number of coefficients.
        """
        surface = cls()
        try:
            terms = content["coefficients"]
            surface.coefficients_ = np.array([t["value"] for t in terms], dtype=float)
            surface.std_ = np.array([t["std"] for t in terms], dtype=float)
            surface.interval_ = np.array([t["interval"] for t in terms], dtype=float)
            scaling = content["scaling"]
            surface.scaling_ = np.array([scaling["duty"], scaling["pressure_pa"]], dtype=float)
            surface.domain_ = Domain.from_dict(content["domain"])
            surface.rmse_flow_ = float(content["rmse_flow_kg_s"])
            surface.n_samples_ = int(content["n_samples"])
            surface.constrained_ = bool(content.get("constrained", False))
        except KeyError as error:
            raise input_error(
                "bipolynomial surface", f"has no {error.args[0]}", "fit the surface again"
            ) from None
        if surface.coefficients_.shape != (N_TERMS,):
            raise input_error(
                "bipolynomial surface", f"holds {len(terms)} coefficients", "give all 9"
            )
        scaled = np.linalg.solve(_to_powers(surface.scaling_), surface.coefficients_)
        surface.scaled_coefficients_ = scaled.astype(float)
        surface.n_features_in_ = 2
        return surface


def _scaling(values: FloatArray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    if high <= low:
        raise _not_enough_spread()
    return 0.5 * (low + high), 0.5 * (high - low)


def _not_enough_spread() -> NotIdentifiedError:
    return NotIdentifiedError(
        "the samples cannot distinguish the nine terms of the surface; valve-pwm tests at "
        "three duties or more over the whole pressure range would"
    )


def _powers(scaling: FloatArray) -> FloatArray:
    """(3, 3): T_i((x - centre)/half) in powers of x."""
    centre, half = scaling
    a, b = -centre / half, 1.0 / half
    shift = np.array([[1.0, 0.0, 0.0], [a, b, 0.0], [a * a, 2.0 * a * b, b * b]])
    return np.asarray(_CHEBYSHEV @ shift)


def _to_powers(scaling: FloatArray) -> FloatArray:
    """(9, 9): from scaled coefficients to those of u^i P^j."""
    return np.asarray(np.kron(_powers(scaling[0]), _powers(scaling[1])).T)


def _basis(
    scaling: FloatArray, duty: FloatArray, pressure: FloatArray, flow: FloatArray
) -> FloatArray:
    """(10, n): the scaled terms in the order of EXPONENTS, and the flow."""
    a = (duty - scaling[0, 0]) / scaling[0, 1]
    b = (pressure - scaling[1, 0]) / scaling[1, 1]
    rows = np.empty((N_TERMS + 1, len(duty)))
    rows[0] = 1.0
    rows[1] = b
    np.multiply(b, b, out=rows[2])
    rows[2] *= 2.0
    rows[2] -= 1.0
    rows[3] = a
    np.multiply(a, rows[1:3], out=rows[4:6])
    np.multiply(a, a, out=rows[6])
    rows[6] *= 2.0
    rows[6] -= 1.0
    np.multiply(rows[6], rows[1:3], out=rows[7:9])
    rows[9] = flow
    return rows


def _rising(scaling: FloatArray, domain: Domain, c: FloatArray, gram: FloatArray) -> FloatArray:
    """`c` itself if dm/du is positive over the hull, else the nearest (9,) with which it is.

    dm/du is linear in c and in u, so the two edges of the hull bound it. The nearest in the
    metric of `gram` is a least-distance problem (Lawson and Hanson 1974, chapter 23).
    """
    pressure = np.linspace(*domain.pressure_range, 101)
    edges = np.concatenate(domain.duty_limits(pressure))
    slope = _slope_rows(scaling, edges, np.tile(pressure, 2))
    least = _LEAST_SLOPE * float(np.median(slope @ c))
    gap = least - slope @ c
    if (
        least <= 0.0 or not (gap > 0).any()
    ):  # a surface that falls throughout is no accident of the fit
        return c
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    factor = np.linalg.cholesky(gram)
    rows = solve_triangular(factor, slope.T, lower=True)
    rows, gap = rows / np.linalg.norm(rows, axis=0), gap / np.linalg.norm(rows, axis=0)
    unit = float(np.abs(gap).max())
    target = np.zeros(N_TERMS + 1)
    target[-1] = 1.0
    matrix = np.vstack((rows, gap[None, :] / unit))
    residual = matrix @ nnls(matrix, target)[0] - target
    move = -residual[:-1] / residual[-1] * unit
    return np.asarray(c + solve_triangular(factor, move, lower=True, trans="T"))


def _slope_rows(scaling: FloatArray, duty: FloatArray, pressure: FloatArray) -> FloatArray:
    """(n, 9): dm/du of each scaled term."""
    a = (duty - scaling[0, 0]) / scaling[0, 1]
    b = (pressure - scaling[1, 0]) / scaling[1, 1]
    in_duty = np.stack((np.zeros_like(a), np.ones_like(a), 4.0 * a)) / scaling[0, 1]
    in_pressure = np.stack((np.ones_like(b), b, 2.0 * b * b - 1.0))
    return np.asarray((in_duty[:, None, :] * in_pressure[None, :, :]).reshape(N_TERMS, -1).T)


def _chunks(n: int) -> list[slice]:
    # Few enough rows at a time that nine of them stay in the cache: 4 times faster.
    return [slice(k, min(k + 8192, n)) for k in range(0, n, 8192)]


def _normal_equations(
    scaling: FloatArray,
    duty: FloatArray,
    pressure: FloatArray,
    flow: FloatArray,
    weight: FloatArray | None,
) -> tuple[FloatArray, FloatArray, float]:
    """Gram matrix of the terms (9, 9), their moments with the flow (9,), and the flow's
    sum of squares, all weighted."""
    sums = np.zeros((N_TERMS + 1, N_TERMS + 1))
    for part in _chunks(len(flow)):
        rows = _basis(scaling, duty[part], pressure[part], flow[part])
        sums += (rows if weight is None else rows * weight[part]) @ rows.T
    return sums[:-1, :-1], sums[:-1, -1], float(sums[-1, -1])


def _residual_sums(
    scaling: FloatArray,
    c: FloatArray,
    duty: FloatArray,
    pressure: FloatArray,
    flow: FloatArray,
    weight: FloatArray | None,
    label: NDArray[np.intp] | None,
) -> tuple[float, FloatArray]:
    """Sums over the weighted residual: its squares, and the clusters' score products (9, 9;
    zeros without `label`)."""
    squares = 0.0
    clusters = 0 if label is None else int(label.max()) + 1
    scores = np.zeros((N_TERMS, clusters))
    for part in _chunks(len(flow)):
        rows = _basis(scaling, duty[part], pressure[part], flow[part])
        residual = flow[part] - c @ rows[:-1]
        weighted = residual if weight is None else residual * weight[part]
        squares += float(residual @ weighted)
        if label is not None:
            for k in range(N_TERMS):
                scores[k] += np.bincount(label[part], rows[k] * weighted, clusters)
    return squares, scores @ scores.T


def _codes(groups: ArrayLike, n: int) -> NDArray[np.intp]:
    labels = np.asarray(groups)
    if labels.shape != (n,):
        raise input_error("groups", f"have shape {labels.shape}", f"give one label a row, {n}")
    return np.unique(labels, return_inverse=True)[1].astype(np.intp)
