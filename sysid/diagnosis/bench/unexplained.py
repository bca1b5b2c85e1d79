"""The remainder of a part's law: its strongest regressor, judged on tests left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.selection import folds_of
from sysid.diagnosis.binning import binned_means, bins_of, predicted_share
from sysid.diagnosis.remainder import Remainder, ResidualTable, remainder
from sysid.types import FloatArray

BINS = 16
LEAST_SHARE = 0.1
"""Share of the residual's variance that a curve must predict to count as structure."""
_LEAST_IN_BIN = 4
MOST_CURVES = 3
"""Curves of a diagnosis that are written and drawn."""


@dataclass(frozen=True)
class BinnedResidual:
    """Mean residual over a regressor, in bins of equal count, before and after: (bins,) each.

    `parts`: those means by `before` and `after`, with their errors (`binned_means`). `share`: how
    much of the remaining variance of a test's residual the curve through the other tests
    predicts, 0 to 1.
    """

    channel: str
    unit: str
    regressor: str
    share: float
    centres: FloatArray
    parts: Mapping[str, Mapping[str, Any]]

    @property
    def removed(self) -> float:
        """How much less of the residual's mean square lies in the curve after than before."""
        return float(self.parts["before"]["power"] - self.parts["after"]["power"])

    @property
    def before(self) -> FloatArray:
        """Means of the law's residual without the effects."""
        return np.array(self.parts["before"]["means"])

    @property
    def after(self) -> FloatArray:
        """Means of the law's residual with them."""
        return np.array(self.parts["after"]["means"])

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

    def shown(self) -> dict[str, Any]:
        """As a report draws a residual's curve: means and standard errors, before and after."""
        return {
            "channel": self.channel,
            "unit": self.unit,
            "regressor": self.regressor,
            "share": self.share,
            "fine": None,
            "centres": self.centres.tolist(),
            **self.parts,
        }


def curves(component: Component, before: Law, after: Law) -> list[BinnedResidual]:
    """Over every regressor, first that over which the remaining residual is most predictable."""
    everything = range(len(component.tests))
    residuals = component.residuals(after, everything)
    left = np.concatenate(residuals)
    given = np.concatenate(component.residuals(before, everything))
    test = np.repeat(np.arange(len(residuals)), [len(part) for part in residuals])
    folds = folds_of(component)
    found = []
    for name, regressor in component.regressors(everything).items():
        place, count = bins_of(regressor, BINS, _LEAST_IN_BIN)
        if count < 3:
            continue
        share = predicted_share(left, place, test, folds)
        centres = np.bincount(place, regressor) / np.bincount(place)
        pairs = (("before", given), ("after", left))
        parts = {key: binned_means(place, values, test) for key, values in pairs}
        found.append(BinnedResidual(component.channel, component.unit, name, share, centres, parts))
    return sorted(found, key=lambda curve: -curve.share)


def left_over(
    component: Component, outside: Component | None, law: Law, noise: float
) -> Remainder | None:
    """How much of a law's residual repeats: held-out tests (`outside`), or tests left out in turn.

    `noise` in the channel's unit.
    """
    own = _table(component, law)
    other = None if outside is None else _table(outside, law)
    return remainder(own, other, folds_of(component), noise, component.channel, component.unit)


def _table(component: Component, law: Law) -> ResidualTable:
    every = range(len(component.tests))
    parts = component.residuals(law, every)
    test = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return ResidualTable.of(component.regressors(every), np.concatenate(parts), test)


__all__ = ["BINS", "LEAST_SHARE", "MOST_CURVES", "BinnedResidual", "curves", "left_over"]
