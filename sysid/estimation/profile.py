"""Profile intervals, bounded where the minimum over all other parameters becomes too large.

They need no quadratic sum of squares, unlike standard errors, and may be asymmetric.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sysid.estimation.linear import LEVEL, t_quantile
from sysid.estimation.nonlinear import Jacobian, LeastSquaresFit, Residuals, minimise
from sysid.types import FloatArray


def profile_interval(
    residuals: Residuals,
    fit: LeastSquaresFit,
    name: str,
    *,
    jacobian: Jacobian | None = None,
    level: float = LEVEL,
) -> tuple[float, float]:
    """Interval of all values of one parameter that the data do not reject.

    The others are refitted at each value; the rise of the sum of squares over the
    residual variance is compared with Student's t squared (Bates, Watts 1988, 6.1). A
    limit is the parameter's bound where no value on that side is rejected.
    """
    i = fit.names.index(name)
    limit = t_quantile(fit.dof, level)
    std = math.sqrt(max(float(fit.covariance[i, i]), 0.0)) or fit.parameters[i].size
    others = tuple(p for p in fit.parameters if p.name != name)
    keep = [k for k in range(len(fit.values)) if k != i]

    def side(sign: float) -> float:
        warm = fit.values[keep]

        def excess(distance: float) -> float:
            nonlocal warm
            value = float(fit.values[i]) + sign * distance

            def insert(rest: FloatArray) -> FloatArray:
                return np.insert(rest, i, value)

            starts = [replace(p, value=float(v)) for p, v in zip(others, warm, strict=True)]
            if not starts:
                r = residuals(insert(np.empty(0)))
                total = float(r @ r)
            else:
                partial = None if jacobian is None else (lambda x: jacobian(insert(x))[:, keep])
                refit = minimise(lambda x: residuals(insert(x)), starts, jacobian=partial)
                total, warm = refit.sum_of_squares, refit.values
            rise = max(total - fit.sum_of_squares, 0.0)
            return math.sqrt(rise) / fit.residual_std - limit

        bound = fit.parameters[i].upper if sign > 0 else fit.parameters[i].lower
        room = abs(bound - float(fit.values[i]))
        return float(fit.values[i]) + sign * first_root(excess, limit * std, room)

    return side(-1.0), side(1.0)


def first_root(
    excess: Callable[[float], float], guess: float, room: float, precision: float = 1e-6
) -> float:
    """Distance at which `excess` (negative at 0) turns positive; `room` where it never does.

    To a relative `precision`; it is looked for from the distance `guess` on.
    """
    from scipy import optimize

    near, far = 0.0, min(guess, room)
    for _ in range(40):
        if excess(far) > 0.0:
            return float(optimize.brentq(excess, near, far, rtol=precision))
        if far >= room:
            return room
        near, far = far, min(1.5 * far, room)
    return math.inf if math.isinf(room) else room
