"""Bounded nonlinear least squares whose parameters carry their uncertainty.

Named, bounded parameters (lmfit's vocabulary) around `scipy.optimize.least_squares`; standard
errors for white, for autocorrelated and for trial-wise errors; Student's intervals;
and a diagnosis that names the parameter that is stuck at a bound or that the data do not
identify. Standard errors are those of Bates, Watts (1988), Nonlinear Regression Analysis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.autocovariance import correlated_covariance
from sysid.estimation.covariance import Covariance
from sysid.estimation.jackknife import jackknife
from sysid.estimation.linear import NORMAL, RANK_TOLERANCE, Estimate
from sysid.types import FloatArray, IntArray

Residuals = Callable[[FloatArray], FloatArray]
Jacobian = Callable[[FloatArray], FloatArray]

# Step of a central difference that balances rounding against curvature.
_CENTRAL_STEP = float(np.finfo(float).eps) ** (1.0 / 3.0)

# Share of the sum of squares below which a Gauss-Newton step is the last: the residuals change by
# 1e-5 of themselves, and what is of second order by the square of that.
_LAST_STEP = 1e-10

AT_BOUND = 1e-6
"""So near to a bound, as a share of its scale, a parameter is stuck there."""


@dataclass(frozen=True)
class Parameter:
    """One unknown: its start, unit and bounds; `scale` is its typical size if the start is 0.

    With equal bounds it is held at them, and is none of a solver's.
    """

    name: str
    value: float
    unit: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    scale: float | None = None

    @property
    def size(self) -> float:
        """A typical magnitude, in the parameter's own unit; never zero."""
        return abs(self.scale if self.scale else self.value) or 1.0

    def nearest_bound(self, value: float) -> float:
        """The bound that a value is at, or nearest to."""
        return min((self.lower, self.upper), key=lambda bound: abs(bound - value))


@dataclass(frozen=True)
class SolverDiagnosis:
    """What the data do not identify.

    `at_bound` names parameters stuck at a bound, `unidentified` those with no effect on the
    residuals, `tied` those identified only in combination. `condition` is that of the Jacobian
    with columns scaled to unit length.
    """

    at_bound: tuple[str, ...]
    unidentified: tuple[str, ...]
    tied: tuple[str, ...]
    condition: float


@dataclass(frozen=True)
class LeastSquaresFit:
    """A minimum of the sum of squared residuals over p parameters.

    `values` (p,) in the parameters' units; `residuals` (n,) and `jacobian` (n, p) there;
    `converged` is false where the evaluations ran out; `taken_out` counts the further numbers that
    were fitted within the residuals, as each test's own start.
    """

    parameters: tuple[Parameter, ...]
    values: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    converged: bool
    message: str
    evaluations: int
    taken_out: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    def holding(self, names: Collection[str]) -> LeastSquaresFit:
        """The same fit with some parameters given, so that they add no uncertainty."""
        keep = [i for i, name in enumerate(self.names) if name not in names]
        return replace(
            self,
            parameters=tuple(self.parameters[i] for i in keep),
            values=self.values[keep],
            jacobian=self.jacobian[:, keep],
        )

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    @property
    def sum_of_squares(self) -> float:
        return float(self.residuals @ self.residuals)

    @property
    def dof(self) -> int:
        return len(self.residuals) - int(np.count_nonzero(self._free)) - self.taken_out

    @property
    def residual_std(self) -> float:
        """Standard deviation of a residual; infinite without degrees of freedom."""
        return math.sqrt(self.sum_of_squares / self.dof) if self.dof > 0 else math.inf

    def next_fall(self) -> float:
        """The share of the sum of squares that a Gauss-Newton step inside the bounds would take."""
        size, total = np.linalg.norm(self.jacobian, axis=0), self.sum_of_squares
        if not np.isfinite(size).all() or total == 0.0:
            return 0.0
        size[size == 0.0] = np.inf
        scaled = self.jacobian / size
        step = -np.linalg.lstsq(scaled, self.residuals, rcond=RANK_TOLERANCE)[0] / size
        bounds = np.array([(p.lower, p.upper) for p in self.parameters]).T
        inside = np.clip(self.values + step, *bounds) - self.values
        left = self.residuals + self.jacobian @ inside
        return 1.0 - float(left @ left) / total

    def at_bound_by_noise(
        self,
        covariance: Callable[[LeastSquaresFit], Covariance],
        attained: Collection[str] = (),
    ) -> Bounded:
        """The parameters whose minimum without bounds lies beyond one by no more than its error.

        Their value is the bound: what cannot be negative is none. `covariance` of a fit without
        these bounds; a parameter that the data drive farther out stays stuck, unless it is one of
        `attained`: there are parts at its bounds, and of those one in forty lies farther out.
        """
        own = set(self.diagnosis.at_bound)
        if not own:
            return Bounded(self, {}, {})
        size = np.linalg.norm(self.jacobian, axis=0)
        size[size == 0.0] = np.inf
        scaled = self.jacobian / size
        moved = -np.linalg.lstsq(scaled, self.residuals, rcond=RANK_TOLERANCE)[0] / size
        # Of the errors without the bounds: what these themselves add is no noise.
        left = self.residuals + self.jacobian @ moved
        free = replace(self._without_bounds(own), residuals=left)
        found, unsure = covariance(free), {*free.diagnosis.unidentified, *free.diagnosis.tied}
        steps, bounds = {}, {}
        for i, name in enumerate(self.names):
            reach = max(NORMAL * found.std(i), AT_BOUND * self.parameters[i].size)
            near = abs(moved[i]) <= reach
            if name in own - unsure and reach < math.inf and (near or name in attained):
                # From farther out the interval would not reach the bound: it begins there.
                steps[name] = float(moved[i]) if near else 0.0
                bounds[name] = self.parameters[i].nearest_bound(self.values[i])
        return Bounded(self._without_bounds(set(steps)), steps, bounds)

    def _without_bounds(self, names: Collection[str]) -> LeastSquaresFit:
        parameters = tuple(
            replace(p, lower=-math.inf, upper=math.inf, scale=p.size) if p.name in names else p
            for p in self.parameters
        )
        return replace(self, parameters=parameters)

    @cached_property
    def _free(self) -> NDArray[np.bool_]:
        """(p,): whether each parameter is off its bounds and has an influence."""
        stuck = set(self.diagnosis.at_bound) | set(self.diagnosis.unidentified)
        return np.array([name not in stuck for name in self.names])

    @cached_property
    def diagnosis(self) -> SolverDiagnosis:
        """Which parameters are stuck, silent or tied together."""
        at_bound = [
            p.name
            for p, v in zip(self.parameters, self.values, strict=True)
            if min(v - p.lower, p.upper - v) <= AT_BOUND * p.size
        ]
        sizes = np.array([p.size for p in self.parameters])
        reach = np.sqrt(np.sum(self.jacobian**2, axis=0)) * sizes
        silent = reach <= RANK_TOLERANCE * max(float(reach.max(initial=0.0)), 1e-300)
        keep = [i for i, n in enumerate(self.names) if not silent[i] and n not in at_bound]
        triangle = np.asarray(np.linalg.qr(self.jacobian[:, keep], mode="r"))
        tied, condition = _dependence(triangle)
        return SolverDiagnosis(
            tuple(at_bound),
            tuple(n for n, s in zip(self.names, silent, strict=True) if s and n not in at_bound),
            tuple(self.names[keep[i]] for i in tied),
            condition,
        )

    @cached_property
    def _unscaled(self) -> FloatArray:
        """(p, p): (J' J)^-1 over the free parameters, zero elsewhere."""
        full = np.zeros((len(self.values), len(self.values)))
        half = _half_inverse(self.jacobian[:, self._free])
        full[np.ix_(self._free, self._free)] = half @ half.T
        return full

    @cached_property
    def covariance(self) -> FloatArray:
        """(p, p), for independent residuals of one variance."""
        return self.residual_std**2 * self._unscaled

    def steps_for(self, errors: FloatArray) -> FloatArray:
        """How far errors (k, n) of what is measured move the parameters, (k, p): to first order."""
        # A residual is the model's value less the measured one.
        return np.asarray(errors @ self.jacobian @ self._unscaled)

    def correlated_covariance(self, groups: NDArray[np.intp] | None = None) -> Covariance:
        """For stationary residuals that are correlated from sample to sample.

        `groups` (n,) numbers the runs of residuals that follow one another in time; runs are
        uncorrelated with each other (`sysid.estimation.autocovariance`).
        """
        free = self._free
        place = np.ix_(free, free)
        found = correlated_covariance(
            self.jacobian[:, free], self.residuals, self._unscaled[place], groups, self.taken_out
        )
        matrix, dof = np.zeros((len(free), len(free))), np.full(len(free), float(self.dof))
        matrix[place], dof[free] = found.matrix, found.dof
        return Covariance(matrix, dof)

    def clustered_covariance(self, groups: NDArray[np.intp]) -> Covariance:
        """For residuals with arbitrary correlation within each of a few groups (tests).

        The sandwich of each group's score (Liang, Zeger 1986), times groups / (groups - 1), with
        groups - 1 degrees of freedom. Unlike `jackknife_covariance` it does not refit without a
        group, which fails where each test is at a different condition.
        """
        free = np.flatnonzero(self._free)
        place = np.ix_(free, free)
        scores = self.jacobian[:, free] * self.residuals[:, None]
        _, own = np.unique(groups, return_inverse=True)
        count = int(own.max()) + 1
        sums = np.zeros((count, len(free)))
        np.add.at(sums, own, scores)
        bread = self._unscaled[place]
        matrix, dof = np.zeros((len(self.values),) * 2), np.zeros(len(self.values))
        if count > 1:
            matrix[place] = count / (count - 1) * bread @ (sums.T @ sums) @ bread
            dof[free] = count - 1.0
        return Covariance(matrix, dof)

    def jackknife_covariance(self, groups: NDArray[np.intp]) -> Covariance:
        """For parameters that differ from group to group (trial to trial).

        Leave-one-group-out jackknife (MacKinnon, White 1985: HC3 by cluster), each step
        linearised at the minimum. A parameter has as many degrees of freedom as there are groups
        that show it (`shown_by`), less one: none where a single group shows it, as nothing is
        known of a scatter then (the matrix holds the residuals' error).
        """
        factors = self._group_factors(groups)
        others = _all_but_each(factors)
        scale = np.linalg.norm(self.jacobian[:, self._free], axis=0)

        def move(i: int) -> FloatArray:
            left, found = others[i], np.zeros(len(self.values))
            step, *_ = np.linalg.lstsq(left[:, :-1], -left[:, -1], rcond=RANK_TOLERANCE)
            found[self._free] = step / scale
            return found

        matrix = jackknife(move, len(factors))
        shown = self._shown_by(factors, others)
        alone = np.flatnonzero(shown <= 1)
        matrix[alone, :] = matrix[:, alone] = 0.0
        matrix[alone, alone] = np.diag(self.covariance)[alone]
        return Covariance(matrix, np.maximum(shown - 1.0, 0.0))

    def shown_by(self, groups: NDArray[np.intp]) -> IntArray:
        """How many groups show each parameter, (p,).

        1 too where it is known by one of them alone: without that, others could make up for it.
        """
        factors = self._group_factors(groups)
        return self._shown_by(factors, _all_but_each(factors))

    def _shown_by(self, factors: Sequence[FloatArray], others: Sequence[FloatArray]) -> IntArray:
        free = np.flatnonzero(self._free)
        found = np.zeros(len(self.values), dtype=np.intp)
        for i, own in enumerate(factors):
            found[free] += np.linalg.norm(own[:, :-1], axis=0) > RANK_TOLERANCE
            _, sizes, ways = np.linalg.svd(others[i][:, :-1])
            lost = ways[len(sizes[sizes > RANK_TOLERANCE]) :]
            # Of a direction that is lost without the group, the parameters that take part in it.
            found[free[np.any(np.abs(lost) > 1e-3, axis=0)]] = -len(factors)
        return np.where(found < 0, 1, found)

    def _group_factors(self, groups: NDArray[np.intp]) -> list[FloatArray]:
        """The triangular factor (k, free + 1) of each group's equations, with the same information.

        Over the free parameters, their columns of unit length in all groups together, and the
        residual.
        """
        columns = self.jacobian[:, self._free]
        columns = np.column_stack([columns / np.linalg.norm(columns, axis=0), self.residuals])
        own = [columns[groups == group] for group in np.unique(groups)]
        return [np.asarray(np.linalg.qr(rows, mode="r")) for rows in own]

    def estimate(self, name: str, covariance: Covariance | None = None) -> Estimate:
        """Value, standard error and Student's 95 % interval of one parameter.

        `covariance`, with its degrees of freedom, replaces that of independent residuals. A
        parameter that is stuck at a bound, or does not affect the residuals, is not identified.
        """
        i = self.names.index(name)
        parameter, d = self.parameters[i], self.diagnosis
        if name in d.at_bound:
            # A solver stops a rounding short of it.
            bound = f"{parameter.nearest_bound(self.values[i]):.4g} {parameter.unit}"
            bound = bound.removesuffix(" -")
            reason = f"{name} is stuck at its bound, {bound}"
            return Estimate.unidentified(parameter.unit, reason.rstrip())
        if name in d.unidentified:
            return Estimate.unidentified(parameter.unit, f"the data do not depend on {name}")
        if name in d.tied:
            others = ", ".join(n for n in d.tied if n != name)
            return Estimate.unidentified(
                parameter.unit, f"the data cannot distinguish {name} from {others}"
            )
        if covariance is None:
            covariance = Covariance(self.covariance, np.full(len(self.values), float(self.dof)))
        dof = float(covariance.dof[i])
        return Estimate.symmetric(float(self.values[i]), covariance.std(i), parameter.unit, dof)

    def report(self) -> str:
        """One line a parameter, and a remark on each that is stuck."""
        lines = [
            f"{len(self.residuals)} residuals, {len(self.values)} parameters, residual "
            f"standard deviation {self.residual_std:.6g}; {self.message}"
        ]
        for parameter in self.parameters:
            e = self.estimate(parameter.name)
            if e.reason is not None:
                lines.append(f"  {parameter.name}: {e.reason}")
                continue
            low, high = e.interval
            lines.append(
                f"  {parameter.name} = {e.value:.8g} +- {e.std:.3g} {parameter.unit} "
                f"({low:.6g} to {high:.6g})"
            )
        return "\n".join(lines)


@dataclass(frozen=True)
class Bounded:
    """A fit with some of its parameters at bounds that noise alone put them to.

    `fit` has no bounds on these, so that their errors count; `steps` by name, from the bound to the
    minimum without it, and the `bounds` themselves.
    """

    fit: LeastSquaresFit
    steps: Mapping[str, float]
    bounds: Mapping[str, float]

    def estimate(self, name: str, covariance: Covariance) -> Estimate:
        """As the fit's, or the bound; its interval is that of the minimum without the bound."""
        found = self.fit.estimate(name, covariance)
        if name not in self.bounds:
            return found
        (low, high), step = found.interval, self.steps[name]
        return replace(found, value=self.bounds[name], interval=(low + step, high + step))


def _all_but_each(factors: Sequence[FloatArray]) -> list[FloatArray]:
    """For each group the triangular factor (k, columns) of the equations of all others.

    Of those before and of those after a group, each joined on one group at a time: a rotation loses
    nothing of what the equations say.
    """
    ahead, behind = [factors[0][:0]], [factors[0][:0]]
    for own in factors[:-1]:
        ahead.append(np.asarray(np.linalg.qr(np.vstack((ahead[-1], own)), mode="r")))
    for own in factors[:0:-1]:
        behind.append(np.asarray(np.linalg.qr(np.vstack((own, behind[-1])), mode="r")))
    both = zip(ahead, reversed(behind), strict=True)
    return [np.asarray(np.linalg.qr(np.vstack(pair), mode="r")) for pair in both]


def minimise(
    residuals: Residuals,
    parameters: Sequence[Parameter],
    *,
    jacobian: Jacobian | None = None,
    tolerance: float = 1e-10,
    max_evaluations: int = 2000,
    polish: bool = True,
) -> LeastSquaresFit:
    """Least squares of `residuals(values)` (n,) over the bounded parameters (p,).

    `jacobian(values)` (n, p) is taken by central differences where it is not given.
    Trust-region reflective steps with columns scaled as they come (Branch, Coleman, Li
    1999) until the sum falls by less than `tolerance` of itself, then (`polish`) Gauss-Newton
    steps for as long as they lower it: the minimum is found to the last digits that the
    residuals carry. Raises ValueError on a start outside its bounds.
    """
    from scipy import optimize

    start = np.array([p.value for p in parameters], dtype=float)
    lower = np.array([p.lower for p in parameters])
    upper = np.array([p.upper for p in parameters])
    sizes = np.array([p.size for p in parameters])
    if np.any(start < lower) or np.any(start > upper):
        raise ValueError("a parameter's start lies outside its bounds")

    free = upper > lower
    size, bounds = sizes[free], (lower[free] / sizes[free], upper[free] / sizes[free])

    def whole(values: FloatArray) -> FloatArray:
        every = start.copy()
        every[free] = values
        return every

    def scaled(x: FloatArray) -> FloatArray:
        return np.asarray(residuals(whole(x * size)), dtype=float)

    def scaled_jacobian(x: FloatArray) -> FloatArray:
        if jacobian is not None:
            return np.asarray(jacobian(whole(x * size))[:, free] * size)
        found = central_jacobian(
            lambda values: residuals(whole(values)), x * size, size, lower[free], upper[free]
        )
        return np.asarray(found * size)

    # A trial step may overflow the model; its infinite sum is refused, which is the answer.
    with np.errstate(all="ignore"):
        found = optimize.least_squares(
            scaled,
            start[free] / size,
            jac=scaled_jacobian,
            bounds=bounds,
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=None,
            max_nfev=max_evaluations,
        )
        end = FitStart(found.x, np.asarray(found.fun), np.asarray(found.jac))
        if polish:
            end = _polished(scaled, scaled_jacobian, end, *bounds)
    slopes = np.zeros((len(end.residuals), len(start)))
    slopes[:, free] = end.jacobian / size
    return LeastSquaresFit(
        tuple(parameters),
        whole(end.x * size),
        end.residuals,
        slopes,
        bool(found.status > 0),
        str(found.message),
        int(found.nfev),
    )


@dataclass(frozen=True)
class FitStart:
    """Parameters `x` (p,), with the residuals (n,) and the Jacobian (n, p) there."""

    x: FloatArray
    residuals: FloatArray
    jacobian: FloatArray


def _polished(
    residuals: Residuals,
    jacobian: Jacobian,
    start: FitStart,
    lower: FloatArray,
    upper: FloatArray,
) -> FitStart:
    """Gauss-Newton steps inside the bounds for as long as the sum of squares falls."""
    here = start
    for _ in range(20):
        trial, fall = _gauss_newton(here, lower, upper)
        # A step that would lower the sum of squares by less than this share is rounding.
        if trial is None or not fall > 1e-18:
            return here
        new = residuals(trial)
        if not new @ new < here.residuals @ here.residuals:
            return here
        here = FitStart(trial, new, jacobian(trial))
    return here


def _gauss_newton(
    here: FitStart, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray | None, float]:
    """Where a Gauss-Newton step leads, (p,), and by what share it would lower the sum of squares.

    None where it leaves the bounds, or a parameter does not show.
    """
    norm = np.sqrt(np.sum(here.jacobian**2, axis=0))
    if not np.all(np.isfinite(norm)) or np.any(norm == 0.0):
        return None, 0.0
    q, triangle = np.linalg.qr(here.jacobian / norm)
    along = -(q.T @ here.residuals)
    step, *_ = np.linalg.lstsq(triangle, along, rcond=1e-14)
    trial = here.x + step / norm
    if np.any(trial <= lower) or np.any(trial >= upper):
        return None, 0.0
    total = float(here.residuals @ here.residuals)
    return trial, float(along @ along) / total if total > 0.0 else 0.0


def without_rows(fit: LeastSquaresFit, start: FitStart, residuals: Residuals) -> FloatArray | None:
    """The parameters (p,) of a fit of some of `fit`'s rows only, by Gauss-Newton steps from it.

    `start`: the fit's values, with `residuals` and their Jacobian of these rows alone. They end
    with a step whose error, of second order, is rounding. None where that leads out of the bounds,
    or nowhere: `minimise` then finds them.
    """
    sizes = np.array([p.size for p in fit.parameters])
    lower = np.array([p.lower for p in fit.parameters])
    upper = np.array([p.upper for p in fit.parameters])
    here = start
    for _ in range(10):
        trial, fall = _gauss_newton(here, lower, upper)
        if trial is None or fall <= _LAST_STEP:
            return trial
        new = np.asarray(residuals(trial))
        if not new @ new < here.residuals @ here.residuals:
            return None
        here = FitStart(trial, new, central_jacobian(residuals, trial, sizes, lower, upper))
    return None


def central_jacobian(
    function: Residuals,
    values: FloatArray,
    sizes: FloatArray,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
) -> FloatArray:
    """(n, p) by central differences; one-sided where a bound is nearer than the step.

    `sizes` (p,) are the parameters' typical magnitudes, for values that are zero.
    """
    return central_jacobian_of_all(
        lambda points: map(function, points), values, sizes, lower, upper
    )


def central_jacobian_of_all(
    function: Callable[[Sequence[FloatArray]], Iterable[FloatArray]],
    values: FloatArray,
    sizes: FloatArray,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
) -> FloatArray:
    """`central_jacobian` of a function that takes all its points, (p,) each, at once."""
    points = central_points(values, sizes, lower, upper)
    return central_slopes(points, list(function(points)))


def central_points(
    values: FloatArray,
    sizes: FloatArray,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
) -> list[FloatArray]:
    """The points, (p,) each, of central differences at `values`: ahead and behind, by number."""
    points: list[FloatArray] = []
    for i, value in enumerate(values):
        step = _CENTRAL_STEP * max(abs(value), 1e-3 * sizes[i])
        ahead, behind = np.array(values), np.array(values)
        ahead[i] = min(value + step, np.inf if upper is None else upper[i])
        behind[i] = max(value - step, -np.inf if lower is None else lower[i])
        points += [ahead, behind]
    return points


def central_slopes(points: Sequence[FloatArray], answers: Sequence[FloatArray]) -> FloatArray:
    """Slopes (n, p) by a function's `answers`, (n,) each, at `central_points`."""
    pairs = enumerate(zip(points[::2], points[1::2], answers[::2], answers[1::2], strict=True))
    columns = [(there - back) / (a[i] - b[i]) for i, (a, b, there, back) in pairs]
    return np.stack(columns, axis=1)


def _dependence(jacobian: FloatArray) -> tuple[list[int], float]:
    """Columns that only act together, and the condition of the scaled Jacobian."""
    if jacobian.shape[1] == 0:
        return [], 1.0
    norm = np.sqrt(np.sum(jacobian**2, axis=0))
    _, s, vt = np.linalg.svd(jacobian / norm, full_matrices=False)
    condition = float(s[0] / s[-1]) if s[-1] > 0.0 else math.inf
    if len(s) < jacobian.shape[1]:
        return list(range(jacobian.shape[1])), math.inf
    tied: set[int] = set()
    for value, vector in zip(s, vt, strict=True):
        if value < RANK_TOLERANCE * s[0]:
            tied |= {int(i) for i in np.flatnonzero(np.abs(vector) > 0.1)}
    return sorted(tied), condition


def _half_inverse(jacobian: FloatArray) -> FloatArray:
    """H (p, p) with H H' = (J' J)^-1, by QR of the scaled Jacobian."""
    p = jacobian.shape[1]
    if p == 0 or len(jacobian) < p:
        return np.full((p, p), np.inf)
    norm = np.sqrt(np.sum(jacobian**2, axis=0))
    r = np.linalg.qr(jacobian / norm, mode="r")
    try:
        inverse = np.linalg.solve(r, np.eye(p))
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(r)
    return np.asarray(inverse / norm[:, None])
