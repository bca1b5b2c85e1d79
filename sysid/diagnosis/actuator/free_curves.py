"""One free curve over a logged quantity, as the rival of effects that imitate an unknown law.

Several effects may follow together a law that the catalogue lacks, none of them well: an eddy
brake, whose torque falls again above a speed, as a drag, a power law and a seal's friction. A curve
without any form that predicts each test from the others far better than those effects, fitted on
all of them, describe it says that it is one law, and over which quantity: what one test alone
shows, and what a finer curve gains by chance, predicts no other test.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from sysid.diagnosis.actuator.projection import Projected
from sysid.diagnosis.binning import equal_count_edges
from sysid.diagnosis.lack_of_fit import LEAST_IN_CELL
from sysid.estimation.quality import FEWEST_REPEATS
from sysid.types import FloatArray, IntArray

_COARSEST = 4
# Of columns of unit length: a knot that no other test reaches stays at 0.
_RIDGE = 1e-9


@dataclass(frozen=True)
class FreeCurve:
    """The curve over a quantity by which tests predict one another best.

    `squares`: the sum of what it leaves of the channel's whitened residual, of each test as the
    others predict it.
    """

    regressor: str
    squares: float


def best_curve(
    base: Projected, channel: str, columns: Mapping[str, FloatArray], known: FloatArray
) -> FreeCurve | None:
    """Of the curves over quantities of the samples, (n,) each by name, the best of a channel.

    Piecewise linear, with knots at equal counts of windows, at every resolution that the tests
    suffice for; fitted together with the base parameters, and with `known` (rows, k), what
    something else shows in the vector of all channels. None of fewer than three tests.
    """
    frame = base.frame
    view, rows = frame.windows[channel], frame.rows(channel)
    if len(np.unique(view.run)) < FEWEST_REPEATS:
        return None
    beside = np.hstack([base.basis[rows], known[rows]])
    curves = (
        FreeCurve(
            name,
            _left_by_others(
                np.hstack([beside, frame.whitened(channel, hats)]), base.residual[rows], view.run
            ),
        )
        for name, values in columns.items()
        for hats in _hats(view.average(values), view.run)
    )
    return min(curves, key=lambda curve: curve.squares, default=None)


def _hats(values: FloatArray, run: IntArray) -> Iterator[FloatArray]:
    """(rows, knots) of piecewise linear curves over values (rows,), ever finer."""
    finest, known = len(values) // (LEAST_IN_CELL * len(np.unique(run))), 1
    pieces = _COARSEST
    while pieces <= finest:
        knots = equal_count_edges(values, pieces)
        if len(knots) > known:
            known = len(knots)
            yield np.column_stack([np.interp(values, knots, unit) for unit in np.eye(known)])
        pieces *= 2


def _left_by_others(columns: FloatArray, values: FloatArray, run: IntArray) -> float:
    """The squares of values (rows,) that least squares on the other tests leave of each test's.

    `columns` (rows, k), `run` (rows,): each row's test.
    """
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    tests = [np.flatnonzero(run == test) for test in np.unique(run)]
    grams = np.array([scaled[own].T @ scaled[own] for own in tests])
    slopes = np.array([scaled[own].T @ values[own] for own in tests])
    others = np.sum(grams, axis=0) - grams + _RIDGE * np.eye(scaled.shape[1])
    found = np.linalg.solve(others, (np.sum(slopes, axis=0) - slopes)[:, :, None])[:, :, 0]
    left = (values[own] - scaled[own] @ numbers for own, numbers in zip(tests, found, strict=True))
    return sum(float(of_test @ of_test) for of_test in left)


__all__ = ["FreeCurve", "best_curve"]
