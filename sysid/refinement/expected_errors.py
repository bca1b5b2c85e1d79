"""What the errors of a simulation will be like once the parameters are estimated.

A refinement's errors are not the sensors' noise alone: what the model and the integration leave
stands in them as well. The campaign's own logs show how much: their errors at the bundle's values,
less what a few linear steps of all parameters, start states and the tests' friction take away.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from sysid.refinement.problem import Iterate, Problem
from sysid.refinement.reduction import ReducedEquations, reduced
from sysid.refinement.runs import Run
from sysid.refinement.whitening import Whitening
from sysid.types import FloatArray

# As in `estimation`: a run with errors so many times the others' is not followed.
_NOT_FOLLOWED = 3.0
_MOST_ORDER = 4
# As there, for what an encoder resolves.
_FINE_STEP = 2.5e-4
_STEPS = 3


def expected_whitening(problem: Problem) -> tuple[Whitening, ...]:
    """Of each channel, from the runs of logged tests, their errors weighted by their own sizes.

    Runs that the model does not follow, or that have no derivative, do not count.
    """
    runs = problem.linearised(problem.first_point())
    has = [i for i, own in enumerate(runs) if np.isfinite(own.factor).all()]
    if not has:
        return _white(problem.runs)
    some = dataclasses.replace(
        problem,
        runs=tuple(problem.runs[i] for i in has),
        whitening=tuple(problem.whitening[i] for i in has),
        max_step=_FINE_STEP,
    )
    left = _after_steps(some)
    sizes = np.array([_size(r, e) for r, e in zip(some.runs, left, strict=True)])
    counted = sizes <= _NOT_FOLLOWED * max(float(np.median(sizes)), 1.0)
    return _fitted(some.runs, [e for e, c in zip(left, counted, strict=True) if c])


def _after_steps(problem: Problem) -> list[FloatArray]:
    """Every run's errors (3, n) after a few linear steps, as far as each lowers the cost."""
    point, cost, left = problem.first_point(), math.inf, []
    every = np.ones(len(problem.runs), dtype=bool)
    for _ in range(_STEPS):
        runs = problem.linearised(point)
        at = reduced(problem, point, runs, np.zeros(len(runs)), every)
        if not at.cost < cost:
            break
        step = np.asarray(-np.linalg.pinv(at.jacobian) @ at.r, dtype=float)
        to = at.moved(problem, step, every)
        left, point, cost = _left(problem, at, to), to, at.cost
    return left


def _size(run: Run, errors: FloatArray) -> float:
    """A run's largest RMSE over the noise among its channels."""
    return float(np.nanmax(np.sqrt(np.mean(errors**2, axis=1)) / run.noise))


def _floors(runs: Sequence[Run]) -> FloatArray:
    return np.asarray(np.nanmedian([run.noise for run in runs], axis=0))


def _white(runs: Sequence[Run]) -> tuple[Whitening, ...]:
    return tuple(Whitening.white(float(n)) for n in _floors(runs))


def _fitted(runs: Sequence[Run], errors: Sequence[FloatArray]) -> tuple[Whitening, ...]:
    found = []
    for channel, floor in enumerate(_floors(runs)):
        logged = [e[channel] for e in errors if not np.isnan(e[channel]).any()]
        white = Whitening.white(float(floor))
        found.append(Whitening.of(logged, float(floor), _MOST_ORDER) if logged else white)
    return tuple(found)


def _left(problem: Problem, at: ReducedEquations, to: Iterate) -> list[FloatArray]:
    """Every run's errors (3, n) after a step, as the slopes foretell them."""
    found = []
    for i, (run, own) in enumerate(zip(problem.runs, at.runs, strict=True)):
        step = np.concatenate(
            [
                to.starts[i] - at.point.starts[i],
                to.friction[run.test] - at.point.friction[run.test],
                to.shared - at.point.shared,
            ]
        )
        found.append(own.errors.residual + np.tensordot(step, own.errors.slopes, axes=1))
    return found


__all__ = ["expected_whitening"]
