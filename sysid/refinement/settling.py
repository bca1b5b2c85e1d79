"""Points with what is local at its best: start states and sliding friction, as linearised there.

Many points are simulated in one batch: what a scan needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.model.differences import simulate_differences
from sysid.model.ports import Model
from sysid.model.simulator import Trajectory, simulate
from sysid.model.tangents import Direction, Tangents
from sysid.parallel import check_time
from sysid.refinement.factors import triangular
from sysid.refinement.problem import SLIDING, Iterate, Problem, RunErrors
from sysid.refinement.runs import STATES
from sysid.types import FloatArray

_S = len(STATES)
_LEAST_SIZE = 1e-3
_DIRECTIONS: tuple[Direction, ...] = tuple((0, n) for n in SLIDING)


def settled(problem: Problem, points: Sequence[Iterate]) -> tuple[FloatArray, list[Iterate]]:
    """Costs (points, tests), with starts and sliding friction at their best, and these points.

    The points differ in static friction alone. Runs that they do not tell apart are linearised
    once. Raises OutOfTimeError.
    """
    check_time()
    inputs = [i for point in points for i in problem.inputs(point)]
    models = [own for point in points for own in problem.models(point)]
    first = _first_alike(simulate(inputs, models), len(problem.runs))
    own = sorted(set(first))
    p = problem.model.parameters
    sizes = [float(getattr(p, name)) or _LEAST_SIZE for name in SLIDING]
    found = simulate_differences(
        [inputs[k] for k in own], [models[k] for k in own], _DIRECTIONS, sizes
    )
    runs = len(problem.runs)
    parts = {
        k: _part(problem, k % runs, points[k // runs], slopes, models[k])
        for k, slopes in zip(own, found, strict=True)
    }
    costs, moved = np.zeros((len(points), problem.tests)), []
    for j, point in enumerate(points):
        own_parts = [parts[k] for k in first[j * runs : (j + 1) * runs]]
        friction, starts = np.array(point.friction), np.array(point.starts)
        misfit = problem.friction_misfit(point)
        for test in range(problem.tests):
            members = problem.members(test)
            step = _best_sliding(float(point.friction[test, 0]), [own_parts[i] for i in members])
            friction[test, 0] += step
            misfit[test, 0] += step
            costs[j, test] = float(misfit[test] @ misfit[test])
            for i in members:
                starts[i] += own_parts[i].start_step(step)
                costs[j, test] += own_parts[i].cost(step)
        moved.append(Iterate(point.shared, friction, starts))
    return costs, moved


def _first_alike(found: Sequence[Trajectory], runs: int) -> list[int]:
    """For each simulation, point after point, the first of its run that is the same."""
    seen: dict[tuple[int, bytes], int] = {}
    return [
        seen.setdefault((k % runs, b"".join(getattr(one, n).tobytes() for n in STATES)), k)
        for k, one in enumerate(found)
    ]


@dataclass(frozen=True)
class _LocalEquations:
    """A run's whitened channels, (n, 6) each: slopes by start and sliding friction, residual.

    `factor` of all of them with the prior of the start, each weighted by its own size.
    """

    channels: tuple[FloatArray, ...]
    start: FloatArray
    factor: FloatArray

    def start_step(self, sliding: float) -> FloatArray:
        """Of the start (4,), after a step of sliding friction."""
        head = self.factor[:_S]
        return np.asarray(-np.linalg.solve(head[:, :_S], head[:, -1] + head[:, -2] * sliding))

    def cost(self, sliding: float) -> float:
        """The run's after both steps, each channel's errors of a size of their own."""
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
    columns = [*errors.slopes, errors.residual]
    channels = tuple(
        whitening(run.independent(channel, np.column_stack([c[channel] for c in columns])))
        for channel, whitening in enumerate(problem.whitening[number])
        if not np.isnan(run.measured[channel]).any()
    )
    start = point.starts[number]
    prior = np.hstack([np.eye(_S), np.zeros((_S, 1)), start[:, None]])
    weighted = [c / math.sqrt(1.0 + float(np.mean(c[:, -1] ** 2))) for c in channels]
    return _LocalEquations(channels, start, triangular([prior, *weighted]))


def _best_sliding(here: float, parts: Sequence[_LocalEquations]) -> float:
    """The step of a test's sliding friction, in units of the scatter."""
    rows = [np.array([[1.0, here]]), *(part.factor[_S:, _S:] for part in parts)]
    slope, residual = np.vstack(rows).T
    return -float(slope @ residual / (slope @ slope))


__all__ = ["settled"]
