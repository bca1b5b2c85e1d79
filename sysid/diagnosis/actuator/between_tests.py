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
from sysid.estimation.linear import LEVEL, RANK_TOLERANCE, chi_squared_quantile
from sysid.types import FloatArray


@dataclass(frozen=True)
class Support:
    """What speaks for one direction of a fitted set's strengths.

    `squares` (channels,): what would be left without it, to first order; `most`: the largest fall
    of minus twice the log likelihood that the scatter along it allows.
    """

    squares: FloatArray
    most: float


def supports(
    base: Projected, found: Refit, slopes: FloatArray, weights: FloatArray
) -> tuple[Support, ...]:
    """The support of a fit to a residual whose channels have weights (channels,); `slopes` are the
    fit's `own_slopes` (rows, k).

    In the directions in which the strengths of all effects are uncorrelated by the noise and by
    their scatter: effects that imitate each other share what they gain. All else is as it is: by
    shapes fitted to each few of the tests strengths would agree that do not, and by base parameters
    of which those say little others would differ that agree.
    """
    own = found.own_chords(slopes)
    length, whole = (np.linalg.norm(m, axis=0) for m in (own, found.chords))
    numbers = [q for e in found.effects for q in type(e).quantities]
    # Not what the base parameters make up for.
    kept = [
        i for i, q in enumerate(numbers) if q.is_strength and length[i] > RANK_TOLERANCE * whole[i]
    ]
    fit = found.fit.holding([n for i, n in enumerate(found.fit.names) if i not in kept])
    fit = replace(fit, jacobian=own[:, kept])
    fit = fit.holding({*fit.diagnosis.at_bound, *fit.diagnosis.unidentified})
    if not fit.names:
        return ()
    covariance = fit.jackknife_covariance(base.frame.tests)
    known = [float(dof) for dof in covariance.dof if dof >= 1.0]
    if not known:  # nothing is known of a scatter of what a single test shows
        return ()
    scale = np.linalg.norm(fit.jacobian, axis=0)
    # Directions in which a step of one changes the squares by one.
    left, sizes, ways = np.linalg.svd(fit.jacobian / scale, full_matrices=False)
    some = sizes > RANK_TOLERANCE * sizes[0]
    steps = (sizes[some, None] * ways[some]) * scale
    spreads, turned = np.linalg.eigh(steps @ covariance.matrix @ steps.T)
    amounts = turned.T @ steps @ fit.values
    gone = (left[:, some] @ turned * amounts).T
    # Noise alone makes strengths differ by more between tests one time in twenty.
    allowed = float(chi_squared_quantile(min(known), LEVEL)) / min(known)
    most = amounts**2 * allowed / np.maximum(spreads, RANK_TOLERANCE)
    return tuple(
        Support(channel_squares(base, found.rest - part) / weights, float(limit))
        for part, limit in zip(gone, most, strict=True)
    )


__all__ = ["Support", "supports"]
