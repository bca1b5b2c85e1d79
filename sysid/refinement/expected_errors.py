"""What the errors of a simulation will be like once the parameters are estimated.

A refinement's errors are not the sensors' noise alone: what the model and the integration leave
stands in them as well. The campaign's own logs show how much: their errors at the bundle's values,
less what a few linear steps of all parameters, start states and the tests' friction take away.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from sysid.refinement.estimation import NOT_FOLLOWED, error_ratio, whitening_of
from sysid.refinement.problem import Iterate, Problem
from sysid.refinement.reduction import ReducedEquations, reduced
from sysid.refinement.whitening import Whitening
from sysid.types import BoolArray, FloatArray

# Half of `estimation`'s: the figures of `benchmarks/advice.py` were measured with it.
_FINE_STEP = 2.5e-4
_STEPS = 3
_NO_INFORMATION = 1e-12


class ExpectedErrors(NamedTuple):
    """Whitening by channel, and by how much each unknown's standard error exceeds (p,) what its
    information says.
    """

    whitening: tuple[Whitening, ...]
    enlargement: FloatArray


def expected_errors(problem: Problem) -> ExpectedErrors:
    """From the runs of logged tests, their errors weighted by their own sizes.

    Runs that the model does not follow, or that have no derivative, do not count.
    """
    runs = problem.linearised(problem.first_point())
    has = [i for i, own in enumerate(runs) if np.isfinite(own.factor).all()]
    if not has:
        return ExpectedErrors(whitening_of(problem.runs, []), np.ones(len(problem.unknowns)))
    some = dataclasses.replace(
        problem,
        runs=tuple(problem.runs[i] for i in has),
        whitening=tuple(problem.whitening[i] for i in has),
        max_step=_FINE_STEP,
    )
    left, point = _after_steps(some)
    sizes = np.array([error_ratio(r, e) for r, e in zip(some.runs, left, strict=True)])
    counted = sizes <= NOT_FOLLOWED * max(float(np.median(sizes)), 1.0)
    white = whitening_of(some.runs, [e for e, c in zip(left, counted, strict=True) if c])
    final = dataclasses.replace(some, whitening=(white,) * len(some.runs), robust=False)
    return ExpectedErrors(white, _enlargement(final, point, counted))


def _enlargement(problem: Problem, point: Iterate, counted: BoolArray) -> FloatArray:
    """What leaving out one run after the other says beside the information, a linear step on."""
    runs = problem.linearised(point)
    at = reduced(problem, point, runs, np.zeros(len(runs)), counted).after_its_step()
    p = len(problem.unknowns)
    said, found = np.diag(at.covariance())[:p], np.diag(at.error_covariance())[:p]
    known = said > _NO_INFORMATION**2
    return np.sqrt(np.maximum(np.where(known, found / np.where(known, said, 1.0), 1.0), 1.0))


def _after_steps(problem: Problem) -> tuple[list[FloatArray], Iterate]:
    """Every run's errors (3, n) after a few linear steps, as far as each lowers the cost, and the
    point there.
    """
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
    return left, point


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


__all__ = ["ExpectedErrors", "expected_errors"]
