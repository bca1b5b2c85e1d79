"""Samples whose friction is not yet, or no longer, that of sliding, and their exclusion on
evidence.

After a reversal the contacts deform before they slide (presliding), and at low speed friction may
be above Coulomb friction (Stribeck). Both bias Coulomb and viscous friction, which are the law of
sliding. Lack of fit alone is no evidence of either: it must have the characteristic shape.

Presliding has memory: friction is lower after a reversal than before it, at the same place and
speed. An effect of the place or the speed is the same before and after, along the motion or
against it, so that a deficit after a reversal counts only as far as it exceeds that before it.
Presliding also ends within a distance that is small against that between two reversals.
Stribeck friction is friction above the law of the faster motion, at the lower speeds.

The samples are ordered by the way since the last reversal, then by speed, and cut into bins of
equal number; the lowest bin is excluded as long as it deviates in this way from the law fitted to
the bins above, by more than a share of the friction and its own scatter over trials (or stretches
of one). If this does not end, the samples are kept: the lack of fit then has another cause, which
belongs in the interval and in the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.balance.samples import COULOMB, MotionSamples
from sysid.estimation.linear import t_quantile
from sysid.estimation.quality import SIGNIFICANT
from sysid.types import FloatArray

BINS = 20
# Presliding ends within this share of the travel between reversals; else it is something else.
_PRESLIDING = 0.25
# The law has to hold for most of the samples; otherwise none is excluded for its speed.
_MOST_EXCLUDED = 0.5
# Share of the friction by which a bin may deviate from the law of the others.
_TOLERATED = 0.03
_STRETCHES = 8

RULE = (
    "samples shortly after a reversal are excluded while their friction is below the law fitted "
    "to the others by more than the samples before the reversal deviate from it, and samples at "
    "low speed while their friction is above it: in each case as long as the mean of the lowest "
    f"of {BINS} bins deviates by more than {100.0 * _TOLERATED:g} % of the friction and its own "
    f"scatter; they are kept where that does not end within {100.0 * _PRESLIDING:g} % of the way "
    f"between reversals, or {100.0 * _MOST_EXCLUDED:g} % of the samples"
)

Fit = Callable[[Sequence[MotionSamples]], FloatArray]
Order = Callable[[MotionSamples], FloatArray]
_Shows = Callable[[Sequence[MotionSamples], float, float, FloatArray], bool]


@dataclass(frozen=True)
class SlidingLimits:
    """The travel since the last reversal (rad or m) and the speed (rad/s or m/s) below which
    samples are excluded, 0 where none are, and the share of the samples that is."""

    travel: float = 0.0
    speed: float = 0.0
    left_out: float = 0.0

    def text(self, position: str, speed: str) -> str:
        """What is excluded and why, empty where nothing is."""
        parts = []
        if self.travel:
            parts.append(
                f"within {self.travel:.2g} {position} after a reversal (presliding: their friction "
                "falls short)"
            )
        if self.speed:
            parts.append(f"below {self.speed:.2g} {speed} (their friction is above the law)")
        if not parts:
            return ""
        return (
            f"friction from motion: samples {' and '.join(parts)} are excluded "
            f"({100.0 * self.left_out:.0f} %)"
        )


def sliding_only(
    samples: Sequence[MotionSamples], fit: Fit, separates: Callable[[Sequence[MotionSamples]], bool]
) -> tuple[list[MotionSamples], SlidingLimits]:
    """The samples in which the contacts slide as the law has it, and the limits.

    `fit` gives the four coefficients (4,) of samples; `separates` whether samples still identify
    them.
    """
    total = sum(len(s.effort) for s in samples)
    found = list(samples)
    if fit(found)[COULOMB] <= 0.0:
        # Excluding samples does not correct an effect other than friction.
        return found, SlidingLimits()
    way = _between_reversals(found)
    search = _Search(_since, _falls_short, _from_reversals, fit, separates, _PRESLIDING * way)
    travel, found = search.raised(found)
    fastest = float(np.quantile(np.concatenate([_speed(s) for s in found]), _MOST_EXCLUDED))
    speed, found = _Search(_speed, _exceeds, _speed, fit, separates, fastest).raised(found)
    left = 1.0 - sum(len(s.effort) for s in found) / total
    return found, SlidingLimits(travel, speed, left)


def _since(chosen: MotionSamples) -> FloatArray:
    return chosen.since


def _from_reversals(chosen: MotionSamples) -> FloatArray:
    return np.asarray(np.minimum(chosen.since, chosen.until))


def _speed(chosen: MotionSamples) -> FloatArray:
    return np.asarray(np.abs(chosen.speed))


def _between_reversals(samples: Sequence[MotionSamples]) -> float:
    """The median way from one reversal to the next, 0 where the motion has no two."""
    ways = np.concatenate([s.since + s.until for s in samples])
    ways = ways[np.isfinite(ways)]
    return float(np.median(ways)) if len(ways) else 0.0


@dataclass(frozen=True)
class _Search:
    """One ordering of the samples, what its lowest bin has to show, and the highest limit.

    The law is fitted on the samples above a bin by `clear`: both sides of the reversals alike, so
    that an effect of the place, present before them, does not bias it.
    """

    order: Order
    shows: _Shows
    clear: Order
    fit: Fit
    separates: Callable[[Sequence[MotionSamples]], bool]
    most: float

    def raised(self, samples: list[MotionSamples]) -> tuple[float, list[MotionSamples]]:
        """The limit, raised bin by bin, and the samples above it; 0 and all where it has no end."""
        values = np.concatenate([self.order(s) for s in samples])
        values = values[np.isfinite(values)]
        if len(values) < BINS:
            return 0.0, samples
        edges = np.quantile(values, np.arange(BINS) / BINS)
        limit, ended = 0.0, 0
        for low, high in pairwise(edges):
            # So many bins in a row that are predicted end the search.
            if ended == 2:
                break
            rest = self._above(samples, high)
            if rest is None:
                return 0.0, samples
            law = self.fit(rest)
            # Where friction rises and falls again, one bin on the way is predicted by chance.
            if law[COULOMB] <= 0.0 or not self.shows(samples, low, high, law):
                ended += 1
            elif high > self.most:
                return 0.0, samples
            else:
                ended, limit = 0, float(high)
        # A deviation of the lowest bin alone is left to the interval: it may be the filter's.
        if limit <= edges[1]:
            return 0.0, samples
        return limit, [s.kept(self.order(s) >= limit) for s in samples]

    def _above(self, samples: list[MotionSamples], limit: float) -> list[MotionSamples] | None:
        """Samples that the law is fitted to, if they identify it; else all above; else None."""
        for order in (self.clear, self.order):
            found = [s.kept(order(s) >= limit) for s in samples]
            if self.separates(found):
                return found
        return None


def _falls_short(
    samples: Sequence[MotionSamples], low: float, high: float, law: FloatArray
) -> bool:
    """Whether friction after reversals is below the law by more than before them."""
    after = _mean_along([s.kept((s.since >= low) & (s.since < high)) for s in samples], law)
    before = _mean_along([s.kept((s.until >= low) & (s.until < high)) for s in samples], law)
    if after is None or before is None:
        return False
    scatter = t_quantile(min(after.dof, before.dof), 1.0 - SIGNIFICANT) * math.hypot(
        after.std, before.std
    )
    return -after.mean - abs(before.mean) > max(_tolerated(law), scatter)


def _exceeds(samples: Sequence[MotionSamples], low: float, high: float, law: FloatArray) -> bool:
    """Whether friction at these speeds is above the law."""
    slow = [s.kept((_speed(s) >= low) & (_speed(s) < high)) for s in samples]
    found = _mean_along(slow, law)
    if found is None:
        return False
    return found.mean > max(_tolerated(law), t_quantile(found.dof, 1.0 - SIGNIFICANT) * found.std)


def _tolerated(law: FloatArray) -> float:
    return _TOLERATED * abs(float(law[COULOMB]))


@dataclass(frozen=True)
class _Mean:
    """The mean residual along the motion, its standard error and its degrees of freedom."""

    mean: float
    std: float
    dof: int


def _mean_along(samples: Sequence[MotionSamples], law: FloatArray) -> _Mean | None:
    """Over trials, or stretches of a few; None without values to average."""
    parts = [s for s in samples if len(s.effort)]
    along = [np.sign(s.speed) * (s.effort - s.regressors @ law) for s in parts]
    pieces = along
    if len(parts) < _STRETCHES:
        pieces = [p for one in along for p in np.array_split(one, _STRETCHES) if len(p)]
    if len(pieces) < 2:
        return None
    means = np.array([float(np.mean(piece)) for piece in pieces])
    weights = np.array([float(len(piece)) for piece in pieces])
    mean = float(weights @ means / weights.sum())
    spread = float(weights**2 @ (means - mean) ** 2) / weights.sum() ** 2
    error = math.sqrt(spread * len(means) / (len(means) - 1))
    return _Mean(mean, error, len(means) - 1)


def bins_of_speed(samples: Sequence[MotionSamples], count: int) -> list[NDArray[np.intp]]:
    """The bin of speed of each sample, (n,) for each trial, bins of equal number."""
    edges = np.quantile(
        np.concatenate([np.abs(s.speed) for s in samples]), np.arange(count) / count
    )
    return [np.searchsorted(edges, np.abs(s.speed), side="right") - 1 for s in samples]
