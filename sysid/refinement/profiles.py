"""Profile-likelihood intervals of refined parameters: the others are estimated again at each value.

They need no quadratic cost, unlike standard errors, and may be asymmetric (Raue et al. 2009).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from sysid.estimation.linear import LEVEL, t_quantile
from sysid.refinement.estimation import Estimated
from sysid.refinement.problem import Iterate
from sysid.refinement.solver import solve
from sysid.types import FloatArray

# Values on either side, in standard errors.
_DISTANCES = (0.7, 1.4, 2.1, 2.8)


@dataclass(frozen=True)
class Profile:
    """The cost's rise (n,) over a parameter's values (n,), the smallest at 0; and the interval.

    The rise is in units of the errors' variance as the segments' spread shows it: 3.84 bounds
    the interval of 95 %.
    """

    values: FloatArray
    rise: FloatArray
    interval: tuple[float, float]


def profile(found: Estimated, number: int, std: float) -> Profile:
    """The profile of one unknown whose standard error, in its coordinate, is `std`."""
    unknown = found.problem.unknowns[number]
    middle = float(found.solution.point.shared[number])
    linear = _linear_steps(found, number)
    information = float(np.sqrt(found.solution.at.covariance()[number, number]))
    scale = (information / std) ** 2
    coordinates, rises = [middle], [0.0]
    steps = std * np.array([*(-d for d in _DISTANCES), *_DISTANCES])
    # The profile ends at a bound, which is its last point.
    for coordinate in np.unique(np.clip(middle + steps, *unknown.limits)):
        if coordinate == middle:
            continue
        start = found.solution.at.moved(
            found.problem, linear * (coordinate - middle), found.solution.counted
        )
        cost = _cost_at(found, number, coordinate, start)
        coordinates.append(coordinate)
        rises.append(max(cost - found.solution.at.cost, 0.0) * scale)
    order = np.argsort(coordinates)
    c, rise = np.array(coordinates)[order], np.array(rises)[order]
    limits = _limits(c - middle, np.sqrt(rise))
    low, high = sorted(unknown.at(middle + limit) for limit in limits)
    return Profile(np.array([unknown.at(x) for x in c]), rise, (low, high))


def _linear_steps(found: Estimated, number: int) -> FloatArray:
    """How all reduced unknowns (m,) move with one of them, by the linearised equations."""
    jacobian = found.solution.at.jacobian
    others = np.delete(jacobian, number, axis=1)
    steps = -np.linalg.lstsq(others, jacobian[:, number], rcond=None)[0]
    return np.insert(steps, number, 1.0)


def _cost_at(found: Estimated, number: int, coordinate: float, start: Iterate) -> float:
    """The least cost with an unknown's coordinate held."""
    unknowns = list(found.problem.unknowns)
    own = unknowns[number]
    unknowns[number] = dataclasses.replace(own, held_at=coordinate)
    problem = dataclasses.replace(found.problem, unknowns=tuple(unknowns))
    # Start states and each test's friction have to follow, whatever the shared unknowns do.
    solution = solve(problem, start, most=8, near=0.1, least=4)
    # The same runs as in the smallest cost, whichever are set aside here.
    pairs = zip(solution.at.runs, found.solution.counted, strict=True)
    cost = sum(run.cost for run, counted in pairs if counted) + problem.prior_cost(solution.point)
    prior = found.problem.prior_residual(solution.point.shared, number)
    return cost + (prior**2 if prior == prior else 0.0)


def _limits(distance: FloatArray, root: FloatArray) -> tuple[float, float]:
    """Where the root of the rise reaches Student's t, on a line through the two nearest values."""
    limit = t_quantile(np.inf, LEVEL)
    found = []
    for side in (distance < 0.0, distance > 0.0):
        far, height = np.abs(distance[side]), root[side]
        if not far.size:
            found.append(0.0)  # a bound
            continue
        order = np.argsort(far)
        far, height = np.append(0.0, far[order]), np.append(0.0, height[order])
        over = np.flatnonzero(height >= limit)
        j = int(over[0]) if over.size else len(far) - 1
        slope = (height[j] - height[j - 1]) / (far[j] - far[j - 1])
        found.append(far[j - 1] + (limit - height[j - 1]) / slope if slope > 0.0 else np.inf)
    return -float(found[0]), float(found[1])


__all__ = ["Profile", "profile"]
