"""Static friction of each test by a scan: the instant of breakaway is not a smooth function of it.

A motor's command is held from sample to sample. A shaft at rest breaks away at one of the command's
steps, so that the simulation is independent of static friction until the next step is the one:
derivatives are zero between, and the cost is a staircase.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from sysid.refinement.problem import Iterate, Problem
from sysid.refinement.settling import settled
from sysid.types import BoolArray, FloatArray

_COARSE, _FINE = np.linspace(-3.0, 3.0, 25), np.linspace(-0.3, 0.3, 31)
# Static friction that the bench tests did not give may be this far off, as a logarithm: by half.
_FAR = np.linspace(-0.8, 0.8, 33)


def scanned(problem: Problem, point: Iterate, tests: BoolArray, *, far: bool) -> Iterate:
    """The point with the static friction of these tests (tests,) where the test's runs cost least.

    Tried on a grid over the scatter's width (with `far` beyond it too), then on a finer one around
    the best; the present value stays where none is better.
    """
    part, numbers = problem.of_tests(tests)
    here = Iterate(point.shared, point.friction[tests], point.starts[numbers])
    first = np.concatenate([_COARSE, _FAR / problem.scatter[1]]) if far else _COARSE
    for offsets in (first, _FINE):
        here = _best(part, here, offsets)
    friction, starts = np.array(point.friction), np.array(point.starts)
    friction[tests], starts[numbers] = here.friction, here.starts
    return Iterate(point.shared, friction, starts)


def _best(problem: Problem, point: Iterate, offsets: FloatArray) -> Iterate:
    static = point.friction[:, 1] + np.concatenate([[0.0], offsets])[:, None]
    points = [
        dataclasses.replace(point, friction=np.column_stack([point.friction[:, 0], own]))
        for own in static
    ]
    costs, moved = settled(problem, points)
    best = costs.argmin(axis=0)
    friction = np.array([moved[b].friction[test] for test, b in enumerate(best)])
    starts = np.array([moved[best[r.test]].starts[i] for i, r in enumerate(problem.runs)])
    return Iterate(point.shared, friction, starts)


__all__ = ["scanned"]
