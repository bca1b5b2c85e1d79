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
    their scatter: effects that imitate each other share what they gain. Shapes are held: fitted to
    each few of the tests, they would make strengths agree that do not.
    """
    strengths, shapes = _numbers(found)
    fit = replace(found.fit, jacobian=found.chords).holding(shapes)
    places = {name: i for i, name in enumerate(found.fit.names)}
    slopes = found.own_chords()
    own = {name: float(np.linalg.norm(slopes[:, places[name]])) for name in strengths}
    whole = dict(zip(fit.names, np.linalg.norm(fit.jacobian, axis=0), strict=True))
    hidden = {*fit.diagnosis.at_bound, *fit.diagnosis.unidentified}
    # Not what the base parameters make up for.
    strengths = [n for n in strengths if n not in hidden and own[n] > _LEAST * whole[n]]
    kept = [fit.names.index(name) for name in strengths]
    covariance = fit.jackknife_covariance(base.frame.tests)
    known = [float(covariance.dof[i]) for i in kept if covariance.dof[i] >= 1.0]
    if not known:  # nothing is known of a scatter of what a single test shows
        return ()
    scale = np.array([own[name] for name in strengths])
    # Directions in which a step of one changes the squares by one.
    columns = slopes[:, [places[name] for name in strengths]] / scale
    left, sizes, ways = np.linalg.svd(columns, full_matrices=False)
    some = sizes > _LEAST * sizes[0]
    steps = (sizes[some, None] * ways[some]) * scale
    spreads, turned = np.linalg.eigh(steps @ covariance.matrix[np.ix_(kept, kept)] @ steps.T)
    amounts = turned.T @ steps @ fit.values[kept]
    gone = (left[:, some] @ turned * amounts).T
    # Noise alone makes strengths differ by more between tests one time in twenty.
    allowed = float(chi_squared_quantile(min(known), LEVEL)) / min(known)
    most = amounts**2 * allowed / np.maximum(spreads, _LEAST)
    return tuple(
        Support(channel_squares(base, found.rest - part) / weights, float(limit))
        for part, limit in zip(gone, most, strict=True)
    )


def _numbers(found: Refit) -> tuple[list[str], list[str]]:
    """The names of the effects' strengths, and of their shapes, in the fit."""
    kinds = [(e.id, type(e)) for e in found.effects]
    return (
        [f"{id_}/{q.name}" for id_, kind in kinds for q in kind.strengths()],
        [f"{id_}/{q.name}" for id_, kind in kinds for q in kind.shapes()],
    )


__all__ = ["Support", "supports"]
