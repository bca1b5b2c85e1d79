"""The remainder of a part's law: its strongest regressor, judged on tests left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.selection import folds_of
from sysid.types import FloatArray

BINS = 16
LEAST_SHARE = 0.1
"""Share of the residual's variance that a curve must predict to count as structure."""
_LEAST_IN_BIN = 4
_CURVES = 3


@dataclass(frozen=True)
class BinnedResidual:
    """Mean residual over a regressor, in bins of equal count, before and after: (bins,) each.

    `share`: how much of the remaining variance of a test's residual the curve through the
    other tests predicts, 0 to 1.
    """

    channel: str
    unit: str
    regressor: str
    share: float
    centres: FloatArray
    before: FloatArray
    after: FloatArray

    def to_json(self) -> dict[str, Any]:
        """The numbers by name."""
        arrays = {"centres": self.centres, "before": self.before, "after": self.after}
        return {
            "channel": self.channel,
            "unit": self.unit,
            "regressor": self.regressor,
            "share": self.share,
            **{name: values.tolist() for name, values in arrays.items()},
        }


def curves(component: Component, before: Law, after: Law) -> list[BinnedResidual]:
    """Those over which the remaining residual is most predictable, at most three."""
    everything = range(len(component.tests))
    parts = component.residuals(after, everything)
    left = np.concatenate(parts)
    given = np.concatenate(component.residuals(before, everything))
    test = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    folds = folds_of(component)
    found = []
    for name, regressor in component.regressors(everything).items():
        place, count = _bins(regressor)
        if count < 3:
            continue
        share = max(_predicted(left, place, count, test, folds), 0.0)
        held = np.bincount(place, minlength=count)
        centres, first, last = (
            np.bincount(place, values, count) / held for values in (regressor, given, left)
        )
        found.append(
            BinnedResidual(component.channel, component.unit, name, share, centres, first, last)
        )
    return sorted(found, key=lambda curve: -curve.share)[:_CURVES]


def _bins(regressor: FloatArray) -> tuple[NDArray[np.intp], int]:
    """The bin of every sample and how many there are; ties share a bin."""
    values, place = np.unique(regressor, return_inverse=True)
    if len(values) <= BINS:
        return place, len(values)
    count = max(1, min(BINS, len(regressor) // _LEAST_IN_BIN))
    edges = np.unique(np.quantile(regressor, np.linspace(0.0, 1.0, count + 1)))
    place = np.searchsorted(edges[1:-1], regressor, side="right")
    return np.unique(place, return_inverse=True)[1], len(np.unique(place))


def _predicted(
    left: FloatArray,
    place: NDArray[np.intp],
    count: int,
    test: NDArray[np.intp],
    folds: Sequence[Sequence[int]],
) -> float:
    """Share of the squares explained by the other tests' bin means, over all tests."""
    taken = total = 0.0
    for fold in folds:
        out = np.isin(test, list(fold))
        held = np.bincount(place[~out], minlength=count)
        means = np.bincount(place[~out], left[~out], count) / np.maximum(held, 1)
        taken += float(np.sum((left[out] - means[place[out]]) ** 2))
        total += float(np.sum(left[out] ** 2))
    return 1.0 - taken / total if total > 0.0 else 0.0


__all__ = ["BINS", "LEAST_SHARE", "BinnedResidual", "curves"]
