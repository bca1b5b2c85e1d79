"""How much of what effects explain the scatter of their strengths from test to test allows.

Noise differs from row to row. What else a model lacks, or a filter adds, is the same along a whole
test: a mean of pulses that every cycle is sampled at the same places, the friction of that day. An
effect that fits this in a few tests explains many rows, as a mean that is known well; in the others
its strength is another. So its evidence is no more than Wald's statistic of its strengths by their
scatter between tests, as far as that exceeds what noise alone makes of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.actuator.projection import Projected, channel_squares
from sysid.diagnosis.actuator.refit import Refit
from sysid.estimation.linear import LEVEL, chi_squared_quantile
from sysid.types import FloatArray

# Below this share of the largest a direction of the strengths is none.
_LEAST = 1e-9


@dataclass(frozen=True)
class Support:
    """What speaks for one direction of a fitted set's strengths.

    `squares` (channels,): what would be left without it, to first order; `most`: the largest fall
    of minus twice the log likelihood that the scatter along it allows.
    """

    squares: FloatArray
    most: float


def supports(base: Projected, found: Refit, weights: FloatArray) -> tuple[Support, ...]:
    """The support of a fit to a residual whose channels have weights (channels,).

    In the directions in which the strengths of all effects are uncorrelated by the noise and by
    their scatter: effects that imitate each other share what they gain. All else is as it is: by
    shapes fitted to each few of the tests strengths would agree that do not, and by base parameters
    of which those say little others would differ that agree.
    """
    names = [f"{e.id}/{q.name}" for e in found.effects for q in type(e).strengths()]
    columns = np.zeros_like(found.fit.jacobian)
    own, whole = found.own_chords(), np.linalg.norm(found.chords, axis=0)
    # Not what the base parameters make up for.
    shown = np.linalg.norm(own, axis=0) > _LEAST * whole[: own.shape[1]]
    columns[:, : own.shape[1]][:, shown] = own[:, shown]
    fit = replace(found.fit, jacobian=columns)
    fit = fit.holding([name for name in fit.names if name not in names])
    hidden = {*fit.diagnosis.at_bound, *fit.diagnosis.unidentified}
    fit = fit.holding(hidden)
    covariance = fit.jackknife_covariance(base.frame.tests) if fit.names else None
    known = [] if covariance is None else [float(dof) for dof in covariance.dof if dof >= 1.0]
    if covariance is None or not known:
        return ()  # nothing is known of a scatter of what a single test shows
    scale = np.linalg.norm(fit.jacobian, axis=0)
    # Directions in which a step of one changes the squares by one.
    left, sizes, ways = np.linalg.svd(fit.jacobian / scale, full_matrices=False)
    some = sizes > _LEAST * sizes[0]
    steps = (sizes[some, None] * ways[some]) * scale
    spreads, turned = np.linalg.eigh(steps @ covariance.matrix @ steps.T)
    amounts = turned.T @ steps @ fit.values
    gone = (left[:, some] @ turned * amounts).T
    # Noise alone makes strengths differ by more between tests one time in twenty.
    allowed = float(chi_squared_quantile(min(known), LEVEL)) / min(known)
    most = amounts**2 * allowed / np.maximum(spreads, _LEAST)
    return tuple(
        Support(channel_squares(base, found.rest - part) / weights, float(limit))
        for part, limit in zip(gone, most, strict=True)
    )


__all__ = ["Support", "supports"]
