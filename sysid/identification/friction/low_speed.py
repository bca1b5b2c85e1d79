"""Samples whose friction is not yet, or no longer, that of sliding: left out as the residual says.

After a reversal the contacts deform before they slide (presliding), and at low speed friction may
be above Coulomb friction (Stribeck). Both bias Coulomb and viscous friction, which are the law of
sliding. The samples are ordered by the travel since the last reversal, then by speed, and cut into
bins of equal number; the lowest bin is left out as long as the law fitted on the bins above does
not predict it: its mean residual along the motion exceeds a share of the friction and its own
scatter over trials (or stretches of one).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.linear import t_quantile
from sysid.identification.friction.motion_samples import COULOMB, MotionSamples
from sysid.types import FloatArray

BINS = 20
# Of the bins, the most that may be left out by travel, and again by speed.
_MOST_OUT = 14
# A deviation of the lowest bin alone is left to the interval: it may be the filter's.
_FEWEST_OUT = 2
# So many bins in a row that are predicted end the search.
_SETTLED = 2
# Share of the friction by which a bin may deviate from the law of the others.
_TOLERATED = 0.03
_LEVEL = 0.99
_STRETCHES = 8

RULE = (
    "samples at low speed, and those shortly after a reversal, are left out as long as the law "
    "fitted on the others does not predict them: as long as the mean residual of the lowest of "
    f"{BINS} bins exceeds {100.0 * _TOLERATED:g} % of the friction and its own scatter"
)

Fit = Callable[[Sequence[MotionSamples]], FloatArray]


@dataclass(frozen=True)
class SlidingLimits:
    """The travel since the last reversal (rad or m) and the speed (rad/s or m/s) below which
    samples are left out, 0 where none are, and the share of the samples that is."""

    travel: float = 0.0
    speed: float = 0.0
    left_out: float = 0.0

    def text(self, position: str, speed: str) -> str:
        """What is left out and why, empty where nothing is."""
        parts = []
        if self.travel:
            parts.append(f"within {self.travel:.2g} {position} after a reversal")
        if self.speed:
            parts.append(f"below {self.speed:.2g} {speed}")
        if not parts:
            return ""
        return (
            f"friction from motion: samples {' and '.join(parts)} are left out "
            f"({100.0 * self.left_out:.0f} %): the law of the others does not predict them "
            "(presliding, or friction that falls with speed)"
        )


def sliding_only(
    samples: Sequence[MotionSamples], fit: Fit, separates: Callable[[Sequence[MotionSamples]], bool]
) -> tuple[list[MotionSamples], SlidingLimits]:
    """The samples that the law predicts from those above them, and the limits.

    `fit` gives the four coefficients (4,) of samples; `separates` whether samples still identify
    them.
    """
    total = sum(len(s.effort) for s in samples)
    found = list(samples)
    if fit(found)[COULOMB] <= 0.0:
        # What is not friction is not mended by leaving samples out.
        return found, SlidingLimits()
    travel, found = _raised(found, lambda s: s.travel, fit, separates)
    speed, found = _raised(found, lambda s: np.abs(s.speed), fit, separates)
    left = 1.0 - sum(len(s.effort) for s in found) / total
    return found, SlidingLimits(travel, speed, left)


def _raised(
    samples: list[MotionSamples],
    order: Callable[[MotionSamples], FloatArray],
    fit: Fit,
    separates: Callable[[Sequence[MotionSamples]], bool],
) -> tuple[float, list[MotionSamples]]:
    """The limit of one ordering, raised bin by bin, and the samples above it."""
    values = np.concatenate([order(s) for s in samples])
    edges = np.quantile(values, np.arange(BINS) / BINS)
    limit, kept, predicted = 0.0, samples, 0
    for low, high in pairwise(edges[: _MOST_OUT + 1]):
        above = _above(samples, order, high)
        if not separates(above):
            break
        own = [s.kept((order(s) >= low) & (order(s) < high)) for s in samples]
        # Where friction rises and falls again, one bin on the way is predicted by chance.
        predicted = predicted + 1 if _predicted(own, fit(above)) else 0
        if predicted == _SETTLED:
            break
        if not predicted:
            limit, kept = float(high), above
    return (limit, kept) if limit > edges[_FEWEST_OUT - 1] else (0.0, samples)


def _above(
    samples: Sequence[MotionSamples], order: Callable[[MotionSamples], FloatArray], limit: float
) -> list[MotionSamples]:
    return [s.kept(order(s) >= limit) for s in samples]


def _predicted(samples: Sequence[MotionSamples], law: FloatArray) -> bool:
    """Whether the mean residual along the motion is small, or within its scatter."""
    parts = [s for s in samples if len(s.effort)]
    if not parts:
        return True
    along = [np.sign(s.speed) * (s.effort - s.regressors @ law) for s in parts]
    pieces = along
    if len(parts) < _STRETCHES:
        pieces = [p for one in along for p in np.array_split(one, _STRETCHES) if len(p)]
    means = np.array([float(np.mean(piece)) for piece in pieces])
    weights = np.array([float(len(piece)) for piece in pieces])
    mean = float(weights @ means / weights.sum())
    if len(means) < 2:
        return True
    spread = float(weights**2 @ (means - mean) ** 2) / weights.sum() ** 2
    error = math.sqrt(spread * len(means) / (len(means) - 1))
    scatter = t_quantile(len(means) - 1, _LEVEL) * error
    return abs(mean) <= max(_TOLERATED * abs(float(law[COULOMB])), scatter)


def bins_of_speed(samples: Sequence[MotionSamples], count: int) -> list[NDArray[np.intp]]:
    """The bin of speed of each sample, (n,) for each trial, bins of equal number."""
    edges = np.quantile(
        np.concatenate([np.abs(s.speed) for s in samples]), np.arange(count) / count
    )
    return [np.searchsorted(edges, np.abs(s.speed), side="right") - 1 for s in samples]
