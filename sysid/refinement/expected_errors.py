"""What the errors of a simulation will be like once the parameters are estimated.

A refinement's errors are not the sensors' noise alone: what the model and the integration leave
stands in them as well. The campaign's own logs show how much: their errors at the bundle's values,
less what one linear step of all parameters, start states and the tests' friction takes away.
"""

from __future__ import annotations

import dataclasses
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


def expected_whitening(problem: Problem) -> tuple[Whitening, ...]:
    """Of each channel, from the runs of logged tests, their errors weighted by their own sizes.

    Runs that the model does not follow, or that have no derivative, do not count.
    """
    point = problem.first_point()
    runs = problem.linearised(point)
    has = [i for i, own in enumerate(runs) if np.isfinite(own.factor).all()]
    some = dataclasses.replace(
        problem,
        runs=tuple(problem.runs[i] for i in has),
        whitening=tuple(problem.whitening[i] for i in has),
    )
    if not has:
        return _white(problem.runs)
    every = np.ones(len(has), dtype=bool)
    at = reduced(some, some.first_point(), [runs[i] for i in has], np.zeros(len(has)), every)
    step = np.asarray(-np.linalg.pinv(at.jacobian) @ at.r, dtype=float)
    left = _left(some, at, at.moved(some, step, every))
    sizes = np.array([_size(r, e) for r, e in zip(some.runs, left, strict=True)])
    counted = sizes <= _NOT_FOLLOWED * max(float(np.median(sizes)), 1.0)
    return _fitted(some.runs, [e for e, c in zip(left, counted, strict=True) if c])


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
