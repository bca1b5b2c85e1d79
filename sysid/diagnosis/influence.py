"""What an effect does, as found: its own contribution along the logged tests, over a regressor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid.diagnosis.binning import BINS, bins_of
from sysid.types import FloatArray

_LEAST_IN_BIN = 4
_AS_WELL = 0.01


def strongest(
    contribution: FloatArray, regressors: Mapping[str, FloatArray]
) -> dict[str, Any] | None:
    """A contribution (n,) over the regressor, (n,) each, that determines it best.

    `regressor`, `centres` of bins, `means` and the middle 90 % of the contribution in each bin,
    `low` to `high`; None for a contribution of nothing, or of too few samples.
    """
    if len(contribution) < 3 * _LEAST_IN_BIN or not np.any(contribution):
        return None
    found = []
    for name, x in regressors.items():
        place, count = bins_of(x, BINS, _LEAST_IN_BIN)
        if count < 3:
            continue
        means = np.bincount(place, contribution) / np.bincount(place)
        left = float(np.sum((contribution - means[place]) ** 2))
        found.append((left, name, place))
    if not found:
        return None
    # Of several that determine it as well, the first.
    least = min(left for left, *_ in found) + _AS_WELL * float(contribution @ contribution)
    _, name, place = next(item for item in found if item[0] <= least)
    return {"regressor": name, **_binned(contribution, regressors[name], place)}


def _binned(values: FloatArray, x: FloatArray, place: Any) -> dict[str, list[float]]:
    inside = [values[place == k] for k in range(int(place.max()) + 1)]
    low, high = (np.array([np.percentile(v, q) for v in inside]) for q in (5.0, 95.0))
    centres = np.bincount(place, x) / np.bincount(place)
    columns = {"centres": centres, "means": np.array([v.mean() for v in inside])}
    return {k: rounded(v) for k, v in (columns | {"low": low, "high": high}).items()}


def rounded(values: Sequence[float] | FloatArray) -> list[float]:
    """Numbers for a figure: five significant digits."""
    return [float(f"{v:.5g}") for v in np.asarray(values, dtype=float)]


__all__ = ["rounded", "strongest"]
