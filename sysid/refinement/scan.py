"""Static friction of each test by a scan: the instant of breakaway is not a smooth function of it.

A motor's command is held from sample to sample. A shaft at rest breaks away at one of the command's
steps, so that the simulation is independent of static friction until the next step is the one:
derivatives are zero between, and the cost is a staircase.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from sysid.parallel import spend
from sysid.refinement.problem import Iterate, Problem
from sysid.refinement.settling import costs_of, settled
from sysid.types import BoolArray, FloatArray, IntArray

_COARSE, _FINE = np.linspace(-3.0, 3.0, 25), np.linspace(-0.3, 0.3, 31)
# Static friction that the bench tests did not give may be this far off, as a logarithm: by half.
_FAR = np.linspace(-0.8, 0.8, 33)
# Static friction, the steps of sliding friction that are tried with each, both in units of the
# scatter, and whether it is about the best so far: narrower and narrower.
_PAIRS = (
    (_COARSE[4:-4:4], np.linspace(-2.0, 2.0, 17), False),
    (_COARSE[::2], np.linspace(-0.3, 0.3, 9), False),
    (_COARSE[::2], np.linspace(-0.06, 0.06, 7), False),
    (np.linspace(-0.4, 0.4, 9), np.linspace(-0.03, 0.03, 7), True),
)


def scanned(problem: Problem, point: Iterate, tests: BoolArray, *, far: bool) -> Iterate:
    """The point with the static friction of these tests (tests,) where the test's runs cost least.

    Tried on a grid over the scatter's width (with `far` beyond it too), then on a finer one around
    the best; the present value stays where none is better. A test that ends outside its scatter is
    scanned in pairs with sliding friction. Raises OutOfBudgetError.
    """
    part, numbers = problem.of_tests(tests)
    here = Iterate(point.shared, point.friction[tests], point.starts[numbers])
    first = np.concatenate([_COARSE, _FAR / problem.scatter[1]]) if far else _COARSE
    for offsets in (first, _FINE):
        here = _best(part, here, _other_static(here, offsets))
    point = _with_tests(point, tests, here, numbers)
    if far:
        return point
    outside = tests & (np.abs(problem.friction_residual(point)[:, 1]) > _COARSE[-1])
    return _in_pairs(problem, point, outside)


def _in_pairs(problem: Problem, point: Iterate, tests: BoolArray) -> Iterate:
    """The point with sliding and static friction of these tests where the test's runs cost least.

    A shaft that sticks and slips many times goes elsewhere by far less than the scatter of sliding
    friction, and has no slope of it that leads there; another static friction makes up for a part
    of that, so that the best pairs lie along a narrow valley.
    """
    for test in np.flatnonzero(tests):
        own = np.arange(problem.tests) == test
        part, numbers = problem.of_tests(own)
        here = Iterate(point.shared, point.friction[own], point.starts[numbers])
        here = _best(part, here, _valley(problem, part, here)[:, None])
        here = _best(part, here, _other_static(here, _FINE))
        point = _with_tests(point, own, here, numbers)
    return point


def _other_static(point: Iterate, offsets: FloatArray) -> FloatArray:
    """A point's friction (k, tests, 2) with static friction off by some offsets (k,)."""
    static = point.friction[:, 1] + offsets[:, None]
    return np.stack([np.broadcast_to(point.friction[:, 0], static.shape), static], axis=-1)


def _valley(problem: Problem, part: Problem, here: Iterate) -> FloatArray:
    """Friction (k, 2) of the one test of `part`, of a problem's: to each static friction about the
    best the sliding friction that costs least with it."""
    static, sliding, best = np.zeros(1), np.zeros(1), 0.0
    for grid, steps, is_about_best in _PAIRS:
        statics = grid + best if is_about_best else grid
        tried = np.interp(statics, static, sliding) + steps[:, None]
        pairs = np.stack([tried, np.broadcast_to(statics, tried.shape)], axis=-1)
        points = [dataclasses.replace(here, friction=pair[None]) for pair in pairs.reshape(-1, 2)]
        spend(math.ceil(len(points) * len(part.runs) / len(problem.runs)))
        costs = costs_of(part, points).reshape(tried.shape)
        static, sliding = statics, tried[costs.argmin(axis=0), np.arange(len(statics))]
        best = float(static[costs.min(axis=0).argmin()])
    return np.stack([sliding, static], axis=-1)


def _with_tests(point: Iterate, tests: BoolArray, own: Iterate, numbers: IntArray) -> Iterate:
    """A point with the friction of some tests, and the starts of their runs (numbers), as found."""
    friction, starts = np.array(point.friction), np.array(point.starts)
    friction[tests], starts[numbers] = own.friction, own.starts
    return Iterate(point.shared, friction, starts)


def _best(problem: Problem, point: Iterate, friction: FloatArray) -> Iterate:
    """The point with each test's best of some friction (k, tests, 2), and of its own."""
    tried = [point, *(dataclasses.replace(point, friction=own) for own in friction)]
    costs, moved = settled(problem, tried)
    best = costs.argmin(axis=0)
    found = np.array([moved[b].friction[test] for test, b in enumerate(best)])
    starts = np.array([moved[best[r.test]].starts[i] for i, r in enumerate(problem.runs)])
    return Iterate(point.shared, found, starts)


__all__ = ["scanned"]
