"""All runs' linearised equations with the start states eliminated: a small square system.

Each run's rows are condensed by an orthogonal factorisation to as many as it has unknowns (Bock's
condensing of multiple shooting, Bock, Plitt 1984). This eliminates its start, which is damped
separately; the remaining rows contain only the shared unknowns and the tests' friction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.estimation.linear import chi_squared_quantile
from sysid.estimation.quality import SIGNIFICANT
from sysid.refinement.factors import triangular
from sysid.refinement.problem import LOCAL, Iterate, Linearised, Problem
from sysid.refinement.runs import STATES
from sysid.refinement.unknowns import MOST_FACTOR
from sysid.types import BoolArray, FloatArray

_S = len(STATES)
# Rows that damp a start need some size even where nothing depends on it.
_LEAST_COLUMN = 1e-6
# Below this slope (errors per unit of scatter) a test's static friction moves by a scan only.
INFORMED = 5.0
NO_INFORMATION = 1e-12
"""A standard error up to this is that of an unknown on which no residual depends."""
# Without the only run that informs an unknown, no information on it remains.
_LEAST_LEFT = 1e-6
_LEAST_SHARE = 1e-12
# A part of the largest column that is rounding: numpy's own for a pseudoinverse.
_ROUNDING = 1e-15


@dataclass(frozen=True)
class ReducedEquations:
    """A problem's equations at a point over its reduced unknowns z: shared, then friction.

    ||r + jacobian dz||^2 is the cost after their step dz, with each start at its best; `r`
    (m + 1,), `jacobian` (m + 1, m). `heads` (runs, 4, k + 1) give the starts' steps. `cost` is all
    of it at the point. Tests that are `held` (tests,) have static friction without a slope; it
    does not step. `own` are the rows (k, m + 1) of each run that counts, `prior` (n, m) the
    prior's.
    """

    point: Iterate
    runs: tuple[Linearised, ...]
    r: FloatArray
    jacobian: FloatArray
    heads: FloatArray
    cost: float
    held: BoolArray
    own: tuple[FloatArray, ...]
    prior: FloatArray

    @property
    def residuals(self) -> list[FloatArray]:
        """Residuals of every run (3, n): rad or m, Pa."""
        return [run.errors.residual for run in self.runs]

    def shared_step(self, problem: Problem) -> FloatArray:
        """The undamped step of each shared unknown (p,), in standard errors by the runs' own
        gradients (White 1982); 0 for one that a bound stops.
        """
        free = ~self.stopped(problem)
        step = -np.linalg.lstsq(self.jacobian * free, self.r, rcond=None)[0] * free
        inverse = self.covariance()
        spread = [rows[:, -1] @ rows[:, :-1] @ inverse for rows in self.own]
        std = np.sqrt(np.diag(self._enlarged(inverse, spread)))
        known = std > NO_INFORMATION
        return np.abs(np.where(known, step / np.where(known, std, 1.0), 0.0))[
            : len(self.point.shared)
        ]

    def stopped(self, problem: Problem) -> BoolArray:
        """The reduced unknowns (m,) at a bound beyond which the cost would fall: no step moves them
        (Bertsekas 1982).
        """
        p = len(self.point.shared)
        downhill = -(self.jacobian.T @ self.r)[:p]
        low, high = problem.limits.T
        found = np.zeros(self.jacobian.shape[1], dtype=bool)
        found[:p] = (self.point.shared <= low) & (downhill < 0.0)
        found[:p] |= (self.point.shared >= high) & (downhill > 0.0)
        return found

    def covariance(self) -> FloatArray:
        """Covariance of the errors of the reduced unknowns (m, m), from the information alone.

        0 where no residual depends on an unknown, but for rounding.
        """
        inverse = np.linalg.pinv(self.jacobian, rcond=_ROUNDING)
        length = np.linalg.norm(self.jacobian, axis=0)
        inverse[length <= _ROUNDING * np.max(length, initial=0.0)] = 0.0
        return np.asarray(inverse @ inverse.T)

    def error_covariance(self) -> FloatArray:
        """The same, larger where the runs scatter more than the whitening predicts."""
        inverse = self.covariance()
        larger = self.enlargement()
        return np.asarray(inverse * np.outer(larger, larger))

    def enlargement(self) -> FloatArray:
        """Ratio of the errors (m,) to those of the information; 1 where chance explains it.

        If the whitening is right, each run's gradient, corrected for its leverage, has the variance
        given by its information (Bell, McCaffrey 2002). Model error makes runs differ by more: then
        their sum of squares exceeds a chi-squared variable with as many degrees of freedom as runs
        inform the unknown (Satterthwaite 1946). The gradients are taken at the minimum of the
        linearised equations: only there does the gradient of a run that alone informs an unknown
        vanish.
        """
        if not self.own:
            return np.ones(self.jacobian.shape[1])
        inverse = self.covariance()
        there = np.append(-np.linalg.lstsq(self.jacobian, self.r, rcond=None)[0], 1.0)
        known = np.maximum(np.diag(inverse), np.finfo(float).tiny)
        steps = np.array([_step_alone(rows[:, :-1], rows @ there, inverse) for rows in self.own])
        total, runs = self._spoken_of(inverse)
        ratio = np.sum(steps**2, axis=0) / known / total
        # A scatter beyond this is real: a strict level, as many tests are made.
        chance = chi_squared_quantile(runs, 1.0 - SIGNIFICANT) / runs
        # The prior's share of the information scatters as its standard errors predict.
        found = 1.0 + np.minimum(total, 1.0) * np.where(ratio > chance, ratio - 1.0, 0.0)
        return np.asarray(np.sqrt(np.maximum(found, 1.0)))

    def degrees_of_freedom(self) -> FloatArray:
        """Degrees of freedom of the errors (m,): the number of runs that inform an unknown, more
        with a prior (Satterthwaite 1946; Bell, McCaffrey 2002).
        """
        if not self.own:
            return np.full(self.jacobian.shape[1], math.inf)
        total, runs = self._spoken_of(self.covariance())
        return np.asarray(np.maximum(runs / np.minimum(total, 1.0) ** 2, 1.0))

    def _spoken_of(self, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The runs' share of the information on each unknown (m,), and from how many runs it is."""
        known = np.maximum(np.diag(inverse), np.finfo(float).tiny)
        shares = np.array([np.sum((rows[:, :-1] @ inverse) ** 2, axis=0) for rows in self.own])
        shares = np.maximum(shares / known, _LEAST_SHARE)
        total = shares.sum(axis=0)
        return total, total**2 / np.sum(shares**2, axis=0)

    def _enlarged(self, inverse: FloatArray, steps: Sequence[FloatArray]) -> FloatArray:
        """A covariance (m, m), no smaller than what steps (m,) of the runs add up to."""
        count = len(steps)
        found = np.sum(np.square([*steps, np.zeros(len(inverse))]), axis=0)
        found *= (count - 1) / max(count, 1)
        found += np.sum((self.prior @ inverse) ** 2, axis=0)
        known = np.maximum(np.diag(inverse), np.finfo(float).tiny)
        larger = np.sqrt(np.maximum(found / known, 1.0))
        return np.asarray(inverse * np.outer(larger, larger))

    def moved(self, problem: Problem, step: FloatArray, counted: BoolArray) -> Iterate:
        """The point after a step (m,) of the reduced unknowns, no further than their bounds; starts
        of runs not counted move for themselves.
        """
        shared, friction = _parts(problem, step)
        there = np.clip(self.point.shared + shared, *problem.limits.T)
        shared = there - self.point.shared
        widest = math.log(MOST_FACTOR) / np.array(problem.scatter)
        tests = np.clip(self.point.friction + friction, -widest, widest)
        friction = tests - self.point.friction
        starts = np.array(self.point.starts)
        for i, (run, head) in enumerate(zip(problem.runs, self.heads, strict=True)):
            right = np.array(head[:, -1])
            if counted[i]:
                right += head[:, _S:LOCAL] @ friction[run.test] + head[:, LOCAL:-1] @ shared
            starts[i] -= np.linalg.solve(head[:, :_S], right)
        return Iterate(there, tests, starts)

    def predicted(self, problem: Problem, to: Iterate) -> FloatArray:
        """What each run's cost (runs,) would be at a point if its equations were linear."""
        found = np.empty(len(self.runs))
        for i, (linearised, run) in enumerate(zip(self.runs, problem.runs, strict=True)):
            step = [
                to.starts[i] - self.point.starts[i],
                to.friction[run.test] - self.point.friction[run.test],
                to.shared - self.point.shared,
                [1.0],
            ]
            left = linearised.factor @ np.concatenate(step)
            found[i] = float(left @ left) + linearised.saturated
        return found


def _step_alone(slopes: FloatArray, residual: FloatArray, inverse: FloatArray) -> FloatArray:
    """Step (m,) of the reduced unknowns by a run's rows: its slopes (k, m) and its residual (k,),
    as if it had no leverage.
    """
    influence = slopes @ inverse
    left, vectors = np.linalg.eigh(np.eye(len(slopes)) - influence @ slopes.T)
    scaled = (vectors.T @ residual) / np.sqrt(np.maximum(left, _LEAST_LEFT))
    return np.asarray((vectors @ scaled) @ influence)


def _parts(problem: Problem, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    p = len(problem.unknowns)
    return values[:p], values[p:].reshape(-1, 2)


def reduced(
    problem: Problem,
    point: Iterate,
    runs: Sequence[Linearised],
    damping: FloatArray,
    counted: BoolArray,
) -> ReducedEquations:
    """The equations at a point, of the runs that are counted, starts damped by (runs,)."""
    p, tests = len(problem.unknowns), problem.tests
    m = p + 2 * tests
    heads = np.empty((len(runs), _S, runs[0].factor.shape[1]))
    tails: list[list[FloatArray]] = [[] for _ in range(tests)]
    for i, (linearised, run) in enumerate(zip(runs, problem.runs, strict=True)):
        own = _damped(linearised.factor, float(damping[i]))
        heads[i] = own[:_S]
        if counted[i]:
            tails[run.test].append(own[_S:, _S:])
    rows, held = [], np.zeros(tests, dtype=bool)
    for test, own_tails in enumerate(tails):
        if not own_tails:
            continue
        factor = triangular(own_tails)
        if np.linalg.norm(factor[:, 1]) < INFORMED:
            held[test], factor[:, 1] = True, 0.0
        rows.append(_wide(factor, test, p, m))
    alone = [_wide(own, test, p, m) for test, many in enumerate(tails) for own in many]
    for own in alone:
        own[:, p + 1 + 2 * np.flatnonzero(held)] = 0.0
    prior = _prior_rows(problem, point, held)
    rows.append(prior)
    factor = triangular(rows)
    cost = problem.prior_cost(point) + sum(
        run.cost for run, c in zip(runs, counted, strict=True) if c
    )
    r, jacobian = np.array(factor[:, -1]), factor[:, :-1]
    # A cost that no step can lower still counts when two points are compared.
    r[-1] = math.sqrt(max(cost - float(r[:-1] @ r[:-1]), 0.0))
    return ReducedEquations(
        point, tuple(runs), r, jacobian, heads, cost, held, tuple(alone), prior[:, :-1]
    )


def _wide(tail: FloatArray, test: int, p: int, m: int) -> FloatArray:
    """Rows (k, m + 1) over all reduced unknowns of a test's, over its friction and the shared."""
    wide = np.zeros((len(tail), m + 1))
    wide[:, p + 2 * test : p + 2 * test + 2] = tail[:, :2]
    wide[:, :p], wide[:, -1] = tail[:, 2:-1], tail[:, -1]
    return wide


def _damped(factor: FloatArray, damping: float) -> FloatArray:
    if damping == 0.0:
        return factor
    extra = np.zeros((_S, factor.shape[1]))
    sizes = np.maximum(np.linalg.norm(factor[:, :_S], axis=0), _LEAST_COLUMN)
    extra[:, :_S] = math.sqrt(damping) * np.diag(sizes)
    return triangular([factor, extra])


def _prior_rows(problem: Problem, point: Iterate, held: BoolArray) -> FloatArray:
    """Rows (k, m + 1); a test's static friction that is held has no step."""
    p, m = len(problem.unknowns), len(problem.unknowns) + 2 * problem.tests
    prior = problem.prior(point.shared)
    shared = np.zeros((len(prior), m + 1))
    shared[:, :p], shared[:, -1] = prior[:, :p], prior[:, -1]
    own, still = np.zeros((m - p, m + 1)), np.zeros((problem.tests, m + 1))
    own[:, p:m], own[:, -1] = np.eye(m - p), problem.friction_residual(point).ravel()
    tests = np.arange(problem.tests)
    static = 2 * tests + 1
    # A test whose static friction has no slope and was not found by a scan carries no information.
    silent = held & (point.friction[:, 1] == 0.0)
    if problem.static_number is not None:
        own[static, problem.static_number] = -1.0 / problem.scatter[1]
        own[static[silent], :] = 0.0
    own[static[held], p + static[held]] = 0.0
    still[tests[held], p + static[held]] = 1.0
    return np.vstack([shared, own, still])


__all__ = ["ReducedEquations", "reduced"]
