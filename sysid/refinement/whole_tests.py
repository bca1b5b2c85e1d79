"""Whole tests simulated open loop with a model, and their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sysid.plant.ports import Model
from sysid.recording.motion_tests import MotionTest
from sysid.recording.simulation import simulate_segments
from sysid.types import BoolArray, FloatArray

# If whole training tests are simulated this much worse (mean over the channels), the estimation
# found a wrong optimum; a smaller change is due to the friction of single tests.
_MUCH_WORSE = 1.1


def whole_residuals(tests: Sequence[MotionTest], model: Model, position: str) -> list[FloatArray]:
    """Measured less simulated (3, n) of each test's rows that count, NaN where not logged.

    Position in rad or m, pressures in Pa. All of a test is NaN that is not simulated, as its
    simulation switches without end or does not stay finite (`simulated`).
    """
    segments = [(t, t.whole) for t in tests]
    runs = simulate_segments(segments, model, (), position, nan_if_endless=True)
    return [t.residual_of(t.whole, run) for t, run in zip(tests, runs, strict=True)]


def simulated(residuals: Sequence[FloatArray]) -> BoolArray:
    """(tests,): whether each test has been simulated."""
    return np.array([bool(np.isfinite(one).any()) for one in residuals])


def in_both(
    before: Sequence[FloatArray], after: Sequence[FloatArray]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Residuals of the tests that both models simulate; all, where there are none."""
    shared = np.flatnonzero(simulated(before) & simulated(after)).tolist()
    kept = shared or range(len(before))
    return [before[i] for i in kept], [after[i] for i in kept]


def times_worse(before: Sequence[FloatArray], after: Sequence[FloatArray]) -> float:
    """`times` of the errors of the tests that were simulated before; infinite where one of these
    no longer is."""
    own, other = simulated(before), simulated(after)
    if np.any(own & ~other):
        return math.inf
    kept = np.flatnonzero(own).tolist() or range(len(own))
    return times(rmse([before[i] for i in kept]), rmse([after[i] for i in kept]))


def rmse(residuals: Sequence[FloatArray]) -> FloatArray:
    """Pooled RMSE (3,); NaN where no test logs the channel."""
    joined = np.concatenate(residuals, axis=1)
    found = [
        math.sqrt(float(np.mean(row[np.isfinite(row)] ** 2)))
        if np.isfinite(row).any()
        else math.nan
        for row in joined
    ]
    return np.array(found)


def correlation(residuals: Sequence[FloatArray]) -> FloatArray:
    """Pooled lag-one autocorrelation (3,)."""
    found = []
    for channel in range(len(residuals[0])):
        rows = [r[channel] for r in residuals if np.isfinite(r[channel]).all()]
        power = sum(float(r @ r) for r in rows)
        found.append(sum(float(r[1:] @ r[:-1]) for r in rows) / power if power else math.nan)
    return np.array(found)


def much_worse(before: FloatArray, after: FloatArray) -> str:
    """How much worse tests are simulated, in words, by their errors (3,); empty if they are not."""
    worse = times(before, after)
    if worse <= _MUCH_WORSE:
        return ""
    return f"{worse:.2g} times worse" if math.isfinite(worse) else "no more"


def times(before: FloatArray, after: FloatArray) -> float:
    """Errors (3,) after over before: geometric mean of the logged channels.

    0 where they could not be simulated before and can be now; infinite where they cannot.
    """
    ratio: FloatArray = after / before
    if not np.isfinite(ratio).any():
        return 0.0 if np.isfinite(after).any() else math.inf
    return float(np.exp(np.nanmean(np.log(ratio))))


__all__ = [
    "correlation",
    "in_both",
    "much_worse",
    "rmse",
    "simulated",
    "times",
    "times_worse",
    "whole_residuals",
]
