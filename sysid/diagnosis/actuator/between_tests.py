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
    their scatter: effects that imitate each other share what they gain. Shapes are as they are.
    """
    fit, slopes = replace(found.fit, jacobian=found.chords), found.own_chords()
    strengths, shapes = _places(found)
    whole, own = (np.linalg.norm(m, axis=0) for m in (fit.jacobian, slopes))
    # Not what the base parameters make up for.
    strengths = [i for i in strengths if own[i] > _LEAST * whole[i]]
    scale = own[strengths]
    covariance = fit.jackknife_covariance(base.frame.tests)
    known = [float(covariance.dof[i]) for i in strengths if covariance.dof[i] >= 1.0]
    if not known:  # nothing is known of a scatter of what a single test shows
        return ()
    # Directions in which a step of one changes the squares by one.
    columns = slopes[:, strengths] / scale
    left, sizes, ways = np.linalg.svd(columns, full_matrices=False)
    kept = sizes > _LEAST * sizes[0]
    steps = (sizes[kept, None] * ways[kept]) * scale
    scatter = steps @ _given_shapes(covariance.matrix, strengths, shapes) @ steps.T
    spreads, turned = np.linalg.eigh(scatter)
    amounts = turned.T @ steps @ fit.values[strengths]
    gone = (left[:, kept] @ turned * amounts).T
    # Noise alone makes strengths differ by more between tests one time in twenty.
    allowed = float(chi_squared_quantile(min(known), LEVEL)) / min(known)
    most = amounts**2 * allowed / np.maximum(spreads, _LEAST)
    return tuple(
        Support(channel_squares(base, found.rest - part) / weights, float(limit))
        for part, limit in zip(gone, most, strict=True)
    )


def _places(found: Refit) -> tuple[list[int], list[int]]:
    """The places of the effects' strengths, and of their shapes, among the numbers that show."""
    fit = found.fit
    held = {*fit.diagnosis.at_bound, *fit.diagnosis.unidentified}
    shown = {name: i for i, name in enumerate(fit.names) if name not in held}
    kinds = [(e.id, type(e)) for e in found.effects]
    strengths = [f"{id_}/{q.name}" for id_, kind in kinds for q in kind.strengths()]
    shapes = [f"{id_}/{q.name}" for id_, kind in kinds for q in kind.shapes()]
    return [shown[n] for n in strengths if n in shown], [shown[n] for n in shapes if n in shown]


def _given_shapes(matrix: FloatArray, strengths: list[int], shapes: list[int]) -> FloatArray:
    """The strengths' covariance (k, k) with the shapes as they are: a block of the inverse."""
    together = [*strengths, *shapes]
    scale = np.sqrt(np.maximum(np.diag(matrix)[together], 1e-300))
    whole = matrix[np.ix_(together, together)] / np.outer(scale, scale)
    count = len(strengths)
    if not shapes:
        return np.asarray(matrix[np.ix_(strengths, strengths)])
    inverse = np.linalg.pinv(whole, hermitian=True)[:count, :count]
    own = np.linalg.pinv(inverse, hermitian=True)
    return np.asarray(own * np.outer(scale[:count], scale[:count]))


__all__ = ["Support", "supports"]
