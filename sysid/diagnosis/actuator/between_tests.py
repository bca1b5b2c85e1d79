"""How much of what an effect explains its numbers' scatter from test to test allows.

Noise differs from row to row. What else a model lacks, or a filter adds, is the same along a whole
test: a mean of pulses that every cycle is sampled at the same places, the friction of that day. An
effect that fits this in a few tests explains many rows, as a mean that is known well; in the others
its strength is another. So its evidence is no more than Wald's statistic of its strengths by their
scatter between tests, as far as that exceeds what noise alone makes of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from sysid.diagnosis.actuator.projection import Projected, channel_squares
from sysid.diagnosis.actuator.refit import Refit
from sysid.estimation.covariance import Covariance
from sysid.plant.effects.entry import CatalogueEffect
from sysid.types import FloatArray

# The chance that noise alone makes strengths differ by more between tests.
_LEVEL = 0.05


@dataclass(frozen=True)
class Support:
    """What speaks for an effect of a fitted set.

    `squares` (channels,): what the others leave without it, to first order; `most`: the largest
    fall of minus twice the log likelihood that the scatter of its strengths allows.
    """

    squares: FloatArray
    most: float


def supports(base: Projected, found: Refit, weights: FloatArray) -> tuple[Support, ...]:
    """The support of each effect of a fit to a residual whose channels have weights (channels,)."""
    covariance = found.fit.jackknife_covariance(base.frame.tests)
    return tuple(
        Support(_without(base, found, effect) / weights, _most(found, effect, covariance))
        for effect in found.effects
    )


def _places(found: Refit, effect: CatalogueEffect, *, strengths: bool) -> list[int]:
    """The places of an effect's strengths, or shapes, among those of a fit's numbers that show."""
    kind = type(effect)
    names = {f"{effect.id}/{q.name}" for q in (kind.strengths() if strengths else kind.shapes())}
    shown = np.any(found.fit.jacobian != 0.0, axis=0)
    return [i for i, name in enumerate(found.fit.names) if name in names and shown[i]]


def _without(base: Projected, found: Refit, effect: CatalogueEffect) -> FloatArray:
    """(channels,): squares with an effect's strengths at 0, all numbers but its own at their best.

    Without the effect its shapes have no meaning.
    """
    fit = found.fit
    own = _places(found, effect, strengths=True)
    gone = fit.jacobian[:, own] @ fit.values[own]
    others = np.delete(fit.jacobian, [*own, *_places(found, effect, strengths=False)], axis=1)
    size = np.linalg.norm(others, axis=0)
    others = others[:, size > 0.0] / size[size > 0.0]
    if others.shape[1]:
        gone = gone - others @ np.linalg.lstsq(others, gone, rcond=1e-9)[0]
    return channel_squares(base, found.rest - gone)


def _most(found: Refit, effect: CatalogueEffect, covariance: Covariance) -> float:
    """Wald's statistic of an effect's strengths, its shapes as they are, at the largest that so few
    tests leave possible; infinite where no scatter is known, as of what a single test shows."""
    strengths = _places(found, effect, strengths=True)
    shapes = _places(found, effect, strengths=False)
    strengths, shapes = (
        [i for i in places if covariance.matrix[i, i] > 0.0] for places in (strengths, shapes)
    )
    dof = min((float(covariance.dof[i]) for i in strengths), default=0.0)
    if dof < 1.0:
        return math.inf
    together = [*strengths, *shapes]
    scale = np.sqrt(np.diag(covariance.matrix)[together])
    inverse = np.linalg.pinv(covariance.matrix[np.ix_(together, together)] / np.outer(scale, scale))
    count = len(strengths)
    z = found.fit.values[strengths] / scale[:count]
    return float(z @ inverse[:count, :count] @ z) * float(chdtri(dof, _LEVEL)) / dof


__all__ = ["Support", "supports"]
