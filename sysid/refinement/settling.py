"""Points with their local unknowns optimised: start states and sliding friction, linearised there.

Many points are simulated in one batch: what a scan needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.parallel import spend
from sysid.plant.differences import simulate_differences
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs
from sysid.plant.simulator import Trajectory, simulate
from sysid.plant.tangents import Direction, Tangents
from sysid.refinement.factors import triangular
from sysid.refinement.problem import SLIDING, Iterate, Problem, RunErrors
from sysid.refinement.runs import STATES
from sysid.types import FloatArray

_S = len(STATES)
_DIRECTIONS: tuple[Direction, ...] = tuple((0, n) for n in SLIDING)


def settled(problem: Problem, points: Sequence[Iterate]) -> tuple[FloatArray, list[Iterate]]:
    """Costs (points, tests), with starts and sliding friction at their best, and these points.

    The points differ in friction alone. Only the best points of each test before this adjustment,
    and the first point, are adjusted; the others cost infinitely much. Runs that are the same for
    several points are linearised once. Raises OutOfBudgetError.
    """
    spend(len(points))
    simulated = _simulated(problem, points)
    kept = _kept(problem, points, simulated.costs)
    first, runs = simulated.first, len(problem.runs)
    own = sorted({first[j * runs + i] for j, test in kept for i in problem.members(test)})
    sizes = problem.sizes(points[0], _DIRECTIONS)
    slopes = simulate_differences(
        [simulated.inputs[k] for k in own], [simulated.models[k] for k in own], _DIRECTIONS, sizes
    )
    parts = {
        k: _part(problem, k % runs, points[k // runs], found, simulated.models[k])
        for k, found in zip(own, slopes, strict=True)
    }
    costs = np.full((len(points), problem.tests), math.inf)
    moved = [Iterate(p.shared, np.array(p.friction), np.array(p.starts)) for p in points]
    for j, test in kept:
        point, members = points[j], problem.members(test)
        own_parts = [parts[first[j * runs + i]] for i in members]
        step = _best_sliding(float(point.friction[test, 0]), own_parts)
        moved[j].friction[test, 0] += step
        friction = problem.friction_residual(moved[j])[test]
        costs[j, test] = float(friction @ friction) + sum(part.cost(step) for part in own_parts)
        for i, part in zip(members, own_parts, strict=True):
            moved[j].starts[i] += part.start_step(step)
    return costs, moved


def costs_of(problem: Problem, points: Sequence[Iterate]) -> FloatArray:
    """Costs (points, tests) as the points are; whoever calls it counts them (`spend`)."""
    return _of_tests(problem, points, _simulated(problem, points).costs)


@dataclass(frozen=True)
class _Simulated:
    """Points' runs, point after point: `first` of each run that is the same, and `costs` (points,
    runs) of the runs' errors."""

    inputs: list[Inputs]
    models: list[Model]
    first: list[int]
    costs: FloatArray


def _simulated(problem: Problem, points: Sequence[Iterate]) -> _Simulated:
    """All runs of all points, in one batch."""
    runs = len(problem.runs)
    inputs = [i for point in points for i in problem.inputs(point)]
    models = [own for point in points for own in problem.models(point)]
    found = simulate(inputs, models, nan_if_endless=True)
    first = _first_alike(found, runs)
    known = {k: _cost(problem, k % runs, found[k], models[k]) for k in set(first)}
    costs = np.reshape([known[k] for k in first], (len(points), runs))
    return _Simulated(inputs, models, first, costs)


def _of_tests(problem: Problem, points: Sequence[Iterate], costs: FloatArray) -> FloatArray:
    """Costs (points, tests) of each test's runs, by those of runs (points, runs), with the prior
    of its friction."""
    deviation = np.array([problem.friction_residual(point) for point in points])
    members = [problem.members(test) for test in range(problem.tests)]
    own = np.stack([costs[:, some].sum(axis=1) for some in members], axis=1)
    return np.asarray(np.sum(np.square(deviation), axis=2) + own)


def _first_alike(found: Sequence[Trajectory], runs: int) -> list[int]:
    """For each simulation, point after point, the first of its run that is the same."""
    seen: dict[tuple[int, bytes], int] = {}
    return [seen.setdefault((k % runs, one.states.tobytes()), k) for k, one in enumerate(found)]


def _cost(problem: Problem, number: int, found: Trajectory, model: Model) -> float:
    """Cost of a run's errors as simulated, with each channel's error size free."""
    errors = problem.errors_alone(problem.runs[number], found, model)
    channels = problem.whitened(number, errors)
    return sum(len(c) * math.log1p(float(np.mean(c[:, -1] ** 2))) for c in channels)


def _kept(problem: Problem, points: Sequence[Iterate], costs: FloatArray) -> list[tuple[int, int]]:
    """Points, by number, and tests: each test's best as they are, and the first point; by the costs
    of runs (points, runs)."""
    kept = []
    for test, own in enumerate(_of_tests(problem, points, costs).T):
        # Points of a test whose starts and sliding friction are moved.
        best = np.argsort(own, kind="stable")[:8]
        kept += [(int(j), test) for j in sorted({0, *best})]
    return kept


@dataclass(frozen=True)
class _LocalEquations:
    """A run's whitened channels, (n, 6) each: slopes by start and sliding friction, residual.

    `factor` of all of them with the prior of the start, each weighted by its own size.
    """

    channels: tuple[FloatArray, ...]
    start: FloatArray
    factor: FloatArray

    def start_step(self, sliding: float) -> FloatArray:
        """Step of the start (4,), after a step of sliding friction."""
        head = self.factor[:_S]
        return np.asarray(-np.linalg.solve(head[:, :_S], head[:, -1] + head[:, -2] * sliding))

    def cost(self, sliding: float) -> float:
        """Cost of the run after both steps, with each channel's error size free."""
        step = self.start_step(sliding)
        total = float(np.sum((self.start + step) ** 2))
        for channel in self.channels:
            left = channel[:, -1] + channel[:, :-1] @ np.append(step, sliding)
            total += len(left) * math.log1p(float(np.mean(left**2)))
        return total


def _part(
    problem: Problem, number: int, point: Iterate, found: Tangents, model: Model
) -> _LocalEquations:
    run, p = problem.runs[number], model.parameters
    states, slopes = problem.shown(run, found, model, _DIRECTIONS)
    coulomb, viscous = slopes[_S:]
    sliding = (coulomb * p.coulomb_effort + viscous * p.viscous) * problem.scatter[0]
    local = np.array([*(slopes[:_S] * run.start_std[:, None, None]), sliding])
    errors = RunErrors(states - run.measured, local).kept(run)
    channels = tuple(problem.whitened(number, errors))
    start = point.starts[number]
    prior = np.hstack([np.eye(_S), np.zeros((_S, 1)), start[:, None]])
    weighted = [c / math.sqrt(1.0 + float(np.mean(c[:, -1] ** 2))) for c in channels]
    return _LocalEquations(channels, start, triangular([prior, *weighted]))


def _best_sliding(here: float, parts: Sequence[_LocalEquations]) -> float:
    """The step of a test's sliding friction, in units of the scatter."""
    rows = [np.array([[1.0, here]]), *(part.factor[_S:, _S:] for part in parts)]
    slope, residual = np.vstack(rows).T
    return -float(slope @ residual / (slope @ slope))


__all__ = ["costs_of", "settled"]
