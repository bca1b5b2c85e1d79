"""The remainder of a part's law: its strongest regressor, judged on tests left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.selection import folds_of
from sysid.diagnosis.binning import binned_means, bins_of
from sysid.diagnosis.lack_of_fit import (
    PER_DIRECTION,
    Remainder,
    ResidualTable,
    dependences,
    per_direction,
    remainder,
)
from sysid.types import FloatArray

BINS = 16
HOLDING = ("motor", "acceleration")
"""Regressors that hold what is left of a balance: the effort itself, and what it accelerates."""
_PLACES = {"position", "angle"}
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
    """Over every regressor, first that over which the remaining residual repeats most.

    In cells as wide as that needs; without enough tests to say, in bins of equal count.
    """
    table = _table(component, after)
    given = np.concatenate(component.residuals(before, range(len(component.tests))))
    found = []
    known = {d.regressors[0]: d for d in dependences(table) if len(d.regressors) == 1}
    for name, own in known.items():
        found.append((name, own.cell, own.share if own.is_significant else 0.0))
    for name, values in table.columns.items():
        place, count = bins_of(values, BINS, _LEAST_IN_BIN)
        if name not in known and count >= 3:
            found.append((name, place, 0.0))
    pairs = (("before", given), ("after", table.left))
    return [
        BinnedResidual(
            component.channel,
            component.unit,
            name,
            share,
            np.bincount(cell, table.columns[name]) / np.bincount(cell),
            {key: binned_means(cell, values, table.test) for key, values in pairs},
        )
        for name, cell, share in found
    ]


def left_over(
    component: Component, outside: Component | None, law: Law, noise: float
) -> Remainder | None:
    """How much of a law's residual repeats: of held-out tests (`outside`), else of its own tests.

    Each predicted by all others of both. `noise` of the sensors, in the channel's unit.
    """
    table, judged = _table(component, law), None
    if outside is not None:
        own = len(table)
        # What the stretches of one recording share, as its own friction, is no structure.
        are_whole = len(component.recordings) == len(component.tests)
        table = table.next_to(_table(outside, law, by_recording=are_whole))
        judged = np.arange(len(table)) >= own
    found = dependences(table)
    return remainder(table, found, noise, component.channel, component.unit, judged)


def _table(component: Component, law: Law, by_recording: bool = False) -> ResidualTable:
    """Over what does not hold the residual; of the channel itself the law's own prediction.

    `by_recording`: the stretches of a recording are one test.
    """
    every = range(len(component.tests))
    parts = component.residuals(law, every)
    left = np.concatenate(parts)
    columns = {n: v for n, v in component.regressors(every).items() if n not in HOLDING}
    if component.channel in columns:
        columns[component.channel] = columns[component.channel] - left
    direction = _direction(columns)
    if direction is not None:
        for name in _PLACES & columns.keys():
            columns[name + PER_DIRECTION] = per_direction(columns[name], direction)
    test = np.arange(len(parts))
    for number, places in enumerate(component.recordings.values() if by_recording else ()):
        test[places] = number
    if len(left) < 2 * len(parts):
        # Readings that are tests of their own: those that are left out together.
        for number, fold in enumerate(folds_of(component)):
            test[fold] = number
    which = np.repeat(test, [len(part) for part in parts])
    pairs = [(name, "velocity") for name in _PLACES if {name, "velocity"} <= columns.keys()]
    return ResidualTable(columns, left, which, pairs)


def _direction(columns: Mapping[str, FloatArray]) -> FloatArray | None:
    """Which way the part moves, (n,); None where it is not known."""
    found = columns.get("velocity", columns.get("direction"))
    return None if found is None else np.sign(found)


__all__ = ["BINS", "HOLDING", "MOST_CURVES", "BinnedResidual", "curves", "left_over"]
