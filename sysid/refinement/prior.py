"""The joint prior of the unknowns from the bench tests, whose errors are correlated.

A fit of Coulomb and viscous friction determines their sum at the speeds of its tests better than
either; likewise a valve's choked flows, coefficients and delays. The bundle keeps this correlation
with each part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.refinement.unknowns import Direction, Unknown
from sysid.types import FloatArray

# Where rounding makes numbers exactly collinear, this share of their variance is left independent.
_LEAST_EIGENVALUE = 1e-6


@dataclass(frozen=True)
class BenchRows:
    """What bench tests say of several numbers of a model together: their whitened errors, linear.

    `left` (n,) are the errors at the `values` (k,) of the numbers `directions`, `slopes` (n, k)
    their change with these.
    """

    directions: tuple[Direction, ...]
    values: FloatArray
    slopes: FloatArray
    left: FloatArray

    def over(self, unknowns: Sequence[Unknown], shared: FloatArray) -> FloatArray:
        """Rows (n, p + 1): slopes over the unknowns' coordinates, and the errors at `shared` (p,).

        A number that is no unknown stays as it is.
        """
        places = {direction: i for i, direction in enumerate(self.directions)}
        rows = np.zeros((len(self.left), len(unknowns) + 1))
        rows[:, -1] = self.left
        for i, (unknown, at) in enumerate(zip(unknowns, shared.tolist(), strict=True)):
            place = places.get(unknown.direction)
            if place is not None:
                own = self.slopes[:, place]
                rows[:, i] = own * unknown.model_slope(at)
                rows[:, -1] += own * (unknown.number(at) - self.values[place])
        return rows


def prior_factor(unknowns: Sequence[Unknown]) -> FloatArray:
    """(p, p): W with W' W the inverse of the priors' covariance in the unknowns' coordinates.

    Zero rows and columns for unknowns without a prior. Fixed parameters are not among them: the
    others keep their marginal standard errors. The row of a held unknown contains only itself;
    those of the others are conditional on it.
    """
    std = np.array([u.prior_std for u in unknowns])
    places = [i for i, s in enumerate(std) if s > 0.0]
    places.sort(key=lambda i: unknowns[i].held_at is None)
    factor = np.zeros((len(unknowns), len(unknowns)))
    if places:
        triangle = np.linalg.cholesky(_correlation([unknowns[i] for i in places]))
        white = np.linalg.inv(triangle)
        factor[np.ix_(places, places)] = white / std[places]
    return factor


def _correlation(unknowns: Sequence[Unknown]) -> FloatArray:
    """The correlation (k, k), with no direction known exactly."""
    rows = [dict(u.correlations) for u in unknowns]
    matrix = np.array([[row.get(u.name, 0.0) for u in unknowns] for row in rows])
    np.fill_diagonal(matrix, 1.0)
    least = float(np.linalg.eigvalsh(matrix)[0])
    share = max((_LEAST_EIGENVALUE - least) / (1.0 - least), 0.0) if least < 1.0 else 0.0
    matrix *= 1.0 - share
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


__all__ = ["BenchRows", "prior_factor"]
