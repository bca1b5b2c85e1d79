"""The way from the bench tests' values to the estimates: descents, scans, then estimated noise
models."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.estimation.autoregression import Autoregression, autoregression
from sysid.plant.simulator import MAX_STEP
from sysid.refinement.problem import Iterate, Problem
from sysid.refinement.reduction import NO_INFORMATION, ReducedEquations, reduced
from sysid.refinement.runs import Run
from sysid.refinement.scan import scanned
from sysid.refinement.solver import Solution, solve
from sysid.types import BoolArray, FloatArray, Progress, no_progress

_ROUNDS = 5
_ROUND_EVALUATIONS = 25
_FINAL_EVALUATIONS = 30
# Steps at which a descent ends, in standard errors.
_ROUGHLY, CLOSELY = 0.5, 0.05
# First step sizes, one over the damping: bench tests are near enough for long steps, which a
# refusal shortens; the last descent begins near its end.
_HARDLY_DAMPED, UNDAMPED = 300.0, 1e6
# A run whose largest RMSE over the noise is this many times the others' is not followed.
NOT_FOLLOWED = 3.0
# Friction that a scan moves by less (units of the scatter) counts as unchanged.
_SAME = 0.15
# Innovations below this share of the sensor's noise would get too much weight.
_LEAST_SHARE = 0.3
_LEAST_SCATTER = 1e-3
_FEW_RUNS = 20


@dataclass(frozen=True)
class FrictionScatter:
    """Relative standard deviation of friction from test to test: sliding, static; and how many
    tests of the bench it is from.
    """

    sliding: float
    static: float
    tests: float

    @property
    def pair(self) -> tuple[float, float]:
        return self.sliding, self.static


@dataclass(frozen=True)
class Estimated:
    """The last problem and its solution, the runs that the model does not follow, the scatter.

    `shorter`: the first estimate that converged before the runs were joined, `joined` how many
    as one (0: all of a test). `cut_short`: the budget ended before the estimation did. `misfits`
    (runs, 3): of each run before any was left out or joined, its RMSE over the noise by channel.
    """

    problem: Problem
    solution: Solution
    left_out: tuple[Run, ...]
    scatter: FrictionScatter
    evaluations: int
    misfits: FloatArray
    shorter: Estimated | None = None
    joined: int = 1
    cut_short: bool = False

    def error_covariance(self) -> FloatArray:
        """Covariance of the errors of the reduced unknowns (m, m), at least the accuracy
        of the integration. 0 where no residual depends on an unknown (`NO_INFORMATION`).
        """
        larger, shared = self.enlargement(), self.solution.point.shared
        found = self.solution.at.covariance() * np.outer(larger, larger)
        for i, (unknown, at) in enumerate(zip(self.problem.unknowns, shared, strict=True)):
            if found[i, i] > NO_INFORMATION**2:
                found[i, i] += unknown.integration_error(float(at)) ** 2
        return np.asarray(found)

    def enlargement(self) -> FloatArray:
        """Ratio of the errors (m,) to those of the information; few runs show little of
        their scatter, and then it is at least that of the `shorter` runs.
        """
        at, before = self.solution.at, self._shorter_at
        if before is None:
            return at.enlargement()
        return np.maximum(at.enlargement(), before.enlargement())

    def degrees_of_freedom(self) -> FloatArray:
        """Degrees of freedom of these errors (m,): as many as the runs that determine them."""
        at, before = self.solution.at, self._shorter_at
        if before is None:
            return at.degrees_of_freedom()
        larger = before.enlargement() > at.enlargement()
        return np.where(larger, before.degrees_of_freedom(), at.degrees_of_freedom())

    @property
    def _shorter_at(self) -> ReducedEquations | None:
        """The minimum of the shorter runs, if the runs are too few to show their scatter."""
        if self.shorter is None or len(self.problem.runs) >= _FEW_RUNS:
            return None
        return self.shorter.solution.at


def estimate(
    problem: Problem,
    scatter: FrictionScatter,
    point: Iterate | None = None,
    *,
    robust: bool = False,
    progress: Progress = no_progress,
) -> Estimated:
    """Estimate a problem's unknowns from the bundle's values.

    First each run's errors count by their own size; where a test is not followed, its static
    friction is scanned. Then the errors count as they are found to be: whitened, with the tests'
    own scatter; with `robust` by their own size still. Raises OutOfBudgetError where the budget
    ends before the errors count as they are.
    """
    problem = dataclasses.replace(problem, by_differences=True)
    point, evaluations = point or problem.first_point(), 0
    problem = problem.after_run_ups(point)
    if problem.has_unknown_breakaway:
        # The other parameters would compensate, and all segments would fit equally badly.
        progress("breakaway of all tests, of which no test says where it is")
        point = scanned(problem, point, np.ones(problem.tests, dtype=bool), far=True)
    seen, done = np.full(problem.tests, np.nan), np.zeros(problem.tests, dtype=bool)
    for number in range(_ROUNDS):
        progress(f"round {number + 1}: {len(problem.runs)} segments at once")
        solution = solve(
            problem,
            point,
            _ROUND_EVALUATIONS,
            _ROUGHLY,
            first_step=_HARDLY_DAMPED,
            chords=number > 0,
            roughly=True,
        )
        evaluations += solution.evaluations
        problem = problem.after_run_ups(solution.point)
        left = solution.at.residuals
        follows = followed(problem, left, solution.counted)
        # Where every test breaks away at the wrong moment, no test stands out.
        near = follows & _as_noise(problem, left) if number == 0 else follows
        open_tests = np.array(
            [not all(near[i] for i in problem.members(t)) for t in range(problem.tests)]
        )
        open_tests &= ~done
        if not open_tests.any() or number == _ROUNDS - 1:
            break
        progress(f"round {number + 1}: breakaway of {int(open_tests.sum())} tests")
        far = number == 0 and not problem.knows_static
        point = scanned(problem, solution.point, open_tests, far=far)
        static = np.where(open_tests, point.friction[:, 1], seen)
        change = np.abs(static - solution.point.friction[:, 1])
        # A descent may leave what a scan found, and the next scan find it again.
        done |= open_tests & ((np.abs(static - seen) < _SAME) | (change < _SAME))
        seen = static
        if not (open_tests & ~done).any():
            break
    misfits = _error_ratios(problem, solution.at.residuals)
    final, start, left_out, scatter = _final(problem, solution, follows, scatter, robust)
    progress("the errors as they are")
    solution = solve(
        final, start, _FINAL_EVALUATIONS, CLOSELY, first_step=UNDAMPED, chords=True, partly=True
    )
    evaluations += solution.evaluations
    cut_short = solution.cut_short
    return Estimated(final, solution, left_out, scatter, evaluations, misfits, cut_short=cut_short)


def with_slopes(found: Estimated, by_differences: bool) -> Estimated:
    """The estimate with the derivatives at the solution, from which its errors follow: by forward
    mode through the simulator, or by differences as during the descent. Raises OutOfBudgetError.
    """
    solution, problem = found.solution, found.problem
    exact = dataclasses.replace(problem, by_differences=by_differences)
    runs = exact.linearised(solution.point)
    none = np.zeros(len(runs))
    at = reduced(problem, solution.point, runs, none, solution.counted)
    return dataclasses.replace(found, solution=dataclasses.replace(solution, at=at))


def followed(problem: Problem, residuals: Sequence[FloatArray], counted: BoolArray) -> BoolArray:
    """Whether the simulation follows each run (runs,): its errors are like those of the others.

    `residuals` (3, n) each.
    """
    ratio = np.nanmax(_error_ratios(problem, residuals), axis=1)
    return np.asarray(ratio <= NOT_FOLLOWED * max(float(np.median(ratio[counted])), 1.0))


def _as_noise(problem: Problem, residuals: Sequence[FloatArray]) -> BoolArray:
    """Whether each run's errors (runs,) are like the sensors'."""
    return np.asarray(np.nanmax(_error_ratios(problem, residuals), axis=1) <= NOT_FOLLOWED)


def _error_ratios(problem: Problem, residuals: Sequence[FloatArray]) -> FloatArray:
    """Each run's RMSE over the noise by channel (runs, 3); `residuals` (3, n) each."""
    pairs = zip(problem.runs, residuals, strict=True)
    return np.array([np.sqrt(np.mean(left**2, axis=1)) / run.noise for run, left in pairs])


def _final(
    problem: Problem, rough: Solution, follows: BoolArray, scatter: FrictionScatter, robust: bool
) -> tuple[Problem, Iterate, tuple[Run, ...], FrictionScatter]:
    """The problem of the runs that are followed, with errors as they are; where to start it."""
    numbers = np.flatnonzero(follows)
    runs = tuple(problem.runs[i] for i in numbers)
    own = [rough.at.residuals[i] for i in numbers]
    found = _scatter_of(problem, rough, scatter)
    final = dataclasses.replace(
        problem,
        runs=runs,
        whitening=(whitening_of(runs, own),) * len(runs),
        scatter=found.pair,
        robust=robust,
        # An encoder resolves more than a simulation in the longest steps does, and flows, found to
        # some 1e-6 of their values, take one as exact (`benchmarks/simulation.py`).
        max_step=MAX_STEP / 2.0,
        fine_step=MAX_STEP / 8.0,
    )
    # Friction keeps its size: its coordinates are in units of the scatter.
    friction = rough.point.friction * (np.array(problem.scatter) / np.array(found.pair))
    start = Iterate(rough.point.shared, friction, rough.point.starts[numbers])
    left_out = tuple(run for run, f in zip(problem.runs, follows, strict=True) if not f)
    return final, start, left_out, found


def whitening_of(
    runs: Sequence[Run], residuals: Sequence[FloatArray]
) -> tuple[Autoregression, ...]:
    """Each channel's noise model by the runs' residuals (3, n), else by their noise."""
    found = []
    for channel, floor in enumerate(np.nanmedian([run.noise for run in runs], axis=0)):
        logged = [
            run.independent(channel, r[channel][:, None])[:, 0]
            for run, r in zip(runs, residuals, strict=bool(residuals))
            if not np.isnan(r[channel]).any()
        ]
        found.append(
            autoregression(logged, 4).with_innovation((_LEAST_SHARE * floor) ** 2)
            if logged
            else Autoregression.white(float(floor) ** 2)
        )
    return tuple(found)


def _scatter_of(problem: Problem, solution: Solution, bench: FrictionScatter) -> FrictionScatter:
    """The tests' spread of friction: the bench tests' and the motion tests', by their numbers."""
    p, at = len(problem.unknowns), solution.at
    variance = np.minimum(np.diag(at.covariance())[p:].reshape(-1, 2), 1.0)
    # Static friction found by a scan is kept; where neither a slope nor a scan determined it, the
    # test carries no information on it.
    variance[at.held, 1] = 0.0
    speaks = np.ones_like(variance)
    speaks[at.held & (solution.point.friction[:, 1] == 0.0), 1] = 0.0
    deviation: FloatArray = problem.friction_residual(solution.point)
    squares = np.sum(speaks * (deviation**2 + variance), axis=0) * np.square(problem.scatter)
    total = bench.tests + np.sum(speaks, axis=0)
    known = bench.tests * np.square(bench.pair)
    sliding, static = np.maximum(np.sqrt((known + squares) / total), _LEAST_SCATTER)
    return FrictionScatter(float(sliding), float(static), float(total.min()))


__all__ = [
    "NOT_FOLLOWED",
    "Estimated",
    "FrictionScatter",
    "estimate",
    "followed",
    "whitening_of",
    "with_slopes",
]
