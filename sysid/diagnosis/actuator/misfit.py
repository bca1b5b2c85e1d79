"""The likelihood of a residual that is noise of a known size, and a misfit of an unknown one.

A model that still lacks something leaves a misfit that is the same along a whole test, and that is
much the same in all: however many rows there are, it is a few draws, no more than tests, and no
more than there are directions in which anything that a model may lack would show. With E the
squares beyond the noise, in its variances, and N draws, the misfit's variance is estimated by
E / N, and minus twice the logarithm of the likelihood is N log(1 + E / N): E itself where noise is
all there is, and the logarithm of the misfit where that is all. So a channel that the model hardly
describes does not outvote one that it describes well, and what explains a part of it by chance is
no evidence.

The law of an effect is a form of what the rig does, and holds to a few per cent: as much of what it
explained is misfit, even where less seems to be left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.types import FloatArray

RELATIVE_MODEL_ERROR = 0.05
"""Prior relative error of an effect's law: a model of engineering holds to a few per cent."""

# Draws of a misfit that is noise.
_MANY = 1e12


@dataclass(frozen=True)
class ResidualChannel:
    """A channel's residual: its rows, the `draws` of its misfit; `square` the noise's mean square.

    `origin`: the sum of squares that the model without effects leaves. All in the residual's unit,
    squared.
    """

    rows: int
    draws: float
    square: float
    origin: float

    @classmethod
    def of_noise(cls, rows: int) -> ResidualChannel:
        """A channel without misfit, its noise of unit variance: costs are sums of squares."""
        return cls(rows, _MANY, 1.0, 0.0)

    def excess(self, squares: FloatArray | float) -> FloatArray:
        """Sums of squares (k,) beyond the noise's, in its variances; negative where below."""
        return np.asarray(squares) / self.square - self.rows

    @property
    def misfit(self) -> float:
        """The least squares that are misfit where most of those without effects are explained, in
        the noise's variances."""
        return RELATIVE_MODEL_ERROR**2 * max(float(self.excess(self.origin)), 0.0)

    def cost(self, squares: FloatArray | float) -> FloatArray:
        """Minus twice the log likelihood (k,) of sums of squares (k,), up to a constant."""
        n, excess = self.draws, self.excess(squares)
        beyond = np.maximum(excess, self.misfit)
        below = np.minimum(excess - self.misfit, 0.0)
        return np.asarray(n * np.log1p(beyond / n) + below / (1.0 + self.misfit / n))

    def weight(self, squares: FloatArray | float) -> FloatArray:
        """Slope (k,) of the cost: how much a square of the residual counts for."""
        beyond = np.maximum(self.excess(squares), self.misfit)
        return np.asarray(1.0 / (self.square * (1.0 + beyond / self.draws)))


def cost(channels: Sequence[ResidualChannel], squares: FloatArray) -> FloatArray:
    """Minus twice the log likelihood (...,) of the remainders of all channels, (..., channels)."""
    costs = [c.cost(own) for c, own in zip(channels, np.moveaxis(squares, -1, 0), strict=True)]
    return np.asarray(np.sum(costs, axis=0))


def rise(channels: Sequence[ResidualChannel], squares: FloatArray, gained: FloatArray) -> float:
    """By how much the cost of a remainder (channels,) rises with the squares (channels,) that it
    would have gained where nothing is missing: they are as little explained as misfit is.

    What it would have lost in a channel counts by its slope: the remainder holds it already.
    """
    more, less = np.maximum(gained, 0.0), np.minimum(gained, 0.0)
    unexplained = float(cost(channels, squares + more) - cost(channels, squares))
    return unexplained + float(weights_of(channels, squares) @ less)


def weights_of(channels: Sequence[ResidualChannel], squares: FloatArray) -> FloatArray:
    """How much a square of each channel counts for where so many are left, (..., channels)."""
    pairs = zip(channels, np.moveaxis(squares, -1, 0), strict=True)
    return np.stack([channel.weight(own) for channel, own in pairs], axis=-1)


__all__ = ["RELATIVE_MODEL_ERROR", "ResidualChannel", "cost", "rise", "weights_of"]
