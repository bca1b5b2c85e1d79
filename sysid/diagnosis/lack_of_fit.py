"""Lack of fit: what a residual shows beyond the sensors' noise, and what of it repeats.

What one test's residual has in common with the others', over a quantity that was logged, is
structure: noise repeats nothing. The residual is averaged in cells of a quantity, from coarse ones
to those of the sampling's own distance, and each test is predicted by the means of the others. The
means of the tests are compared as in an analysis of variance with repeated measures (tests are
subjects, cells conditions; Greenhouse, Geisser, Psychometrika 24 (1959) 95-112): cells may be
correlated within a test in any way, and tests may differ in spread. What they have in common is
looked for in the residual as it is, and about each test's own level.

The noise is that of the sensors, which a caller brings; it is never taken from the residual.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnosis.binning import about_means
from sysid.estimation.quality import FEWEST_REPEATS, SIGNIFICANT
from sysid.types import BoolArray, FloatArray, IntArray

LEAST_SHARE = 0.1
"""Share of the squares of the error without effects below which what repeats is not looked into: a
real law, or effect, seldom has the form of ours to the last, as at reversals of the motion."""
LEAST_TOGETHER = 0.5
"""Share of the residual's own squares that two quantities together have to predict: a reversal is a
corner of position and speed, and most laws are a little wrong there."""
OF_THE_NOISE = 0.5
"""Times the noise from which on what repeats counts: it adds 12 % to the error."""
MISFIT = 3.0
"""Times what a correct law would show from which on an error is a lack of fit, whatever repeats:
noise is known from a log within some tens of per cent, friction's scatter from few tests. The
errors of actuators with nothing missing are at most 1.8 times that, and 2.6 with their effects
found."""
PER_DIRECTION = " times direction"
"""Ends the name of a quantity whose two directions of motion are kept apart."""
LEAST_IN_CELL = 2
"""Samples of each test in one of the finest cells, on average: one may be any test's neighbour."""


@dataclass(frozen=True)
class ResidualTable:
    """Residuals (n,), the test of each (n,), and what they may depend on, by name (n,) each.

    No quantity may hold what the residual holds, such as the effort that a balance is of. `pairs`
    of quantities are looked at together too.
    """

    columns: Mapping[str, FloatArray]
    left: FloatArray
    test: IntArray
    pairs: Sequence[tuple[str, str]] = ()

    def __len__(self) -> int:
        return len(self.left)

    def next_to(self, other: ResidualTable) -> ResidualTable:
        """Both, end to end, with tests of their own; the quantities that both have."""
        names = [name for name in self.columns if name in other.columns]
        apart = int(self.test.max()) + 1 if len(self) else 0
        return ResidualTable(
            {n: np.concatenate([self.columns[n], other.columns[n]]) for n in names},
            np.concatenate([self.left, other.left]),
            np.concatenate([self.test, other.test + apart]),
            self.pairs,
        )

    def cells(self) -> Iterator[tuple[tuple[str, ...], Iterator[IntArray]]]:
        """Quantities, and the cell of each row (n,) from coarse to fine."""
        finest = len(self) // (LEAST_IN_CELL * len(np.unique(self.test)))
        for name, values in self.columns.items():
            yield (name,), _ladder(values, finest)
        for pair in self.pairs:
            one, other = (_ladder(self.columns[name], math.isqrt(finest)) for name in pair)
            both = (a * (b.max() + 1) + b for a, b in zip(one, other, strict=False))
            yield pair, (np.unique(cell, return_inverse=True)[1] for cell in both)


@dataclass(frozen=True)
class Dependence:
    """How a residual depends on `regressors`, at the resolution at which tests predict one another.

    One quantity, or two together. `cell` (n,) of each row, `predicted` (n,) by the other tests.
    `share`: of the residual's squares that they predict, 0 to 1. `p_value` of as much in common by
    chance, times the number of quantities and resolutions that were tried.
    """

    regressors: tuple[str, ...]
    cell: IntArray
    predicted: FloatArray
    share: float
    p_value: float

    @property
    def is_significant(self) -> bool:
        """Whether chance is unlikely to give it over any quantity, at any resolution."""
        return self.p_value < SIGNIFICANT


def dependences(table: ResidualTable) -> list[Dependence]:
    """Each quantity's: those that are significant first, of these the most predicted first.

    None of fewer than three tests.
    """
    test = np.unique(table.test, return_inverse=True)[1]
    if not len(test) or test.max() + 1 < FEWEST_REPEATS:
        return []
    about = about_means(test, table.left)
    tried = {
        names: [
            _dependence(table, left, names, cell) for cell in ladder for left in (table.left, about)
        ]
        for names, ladder in table.cells()
    }
    family = sum(map(len, tried.values()))
    found = []
    for rungs in filter(None, tried.values()):
        sure = [rung for rung in rungs if family * rung.p_value < SIGNIFICANT]
        best = max(sure or rungs, key=lambda rung: rung.share)
        p_value = min(1.0, family * best.p_value)
        found.append(Dependence(best.regressors, best.cell, best.predicted, best.share, p_value))

    # Two quantities together come after one alone, where they predict too little to count.
    def rank(d: Dependence) -> tuple[bool, bool, float]:
        return not d.is_significant, len(d.regressors) > 1 and d.share < LEAST_TOGETHER, -d.share

    return sorted(found, key=rank)


def per_direction(values: FloatArray, direction: FloatArray) -> FloatArray:
    """A quantity (n,) whose two directions of motion are apart: above 0 forwards, below 0 back."""
    above = values - values.min()
    return np.asarray((above + above.max() / max(len(values), 1)) * np.sign(direction))


def _ladder(values: FloatArray, finest: int) -> Iterator[IntArray]:
    """The cell of each row (n,), in cells ever finer, of half the samples each time, at most so
    many."""
    _, place, held = np.unique(values, return_inverse=True, return_counts=True)
    below, last, count = np.cumsum(held) - held, 1, 2
    while count <= finest:
        # Ties share a cell.
        rank = below * count // len(values)
        cell = np.cumsum(np.diff(rank, prepend=rank[0]) > 0, dtype=np.intp)
        if cell[-1] + 1 > last:
            last = int(cell[-1]) + 1
            yield cell[place]
        count *= 2


def _dependence(
    table: ResidualTable, left: FloatArray, names: tuple[str, ...], cell: IntArray
) -> Dependence:
    """At one resolution, of `left` (n,), the residual or what it is about each test's level;
    `p_value` of this one alone."""
    own, test = np.unique(table.test, return_inverse=True)
    cells = int(cell.max()) + 1
    at = test * cells + cell
    held = np.bincount(at, minlength=len(own) * cells).reshape(len(own), cells)
    sums = np.bincount(at, left, len(own) * cells).reshape(len(own), cells)
    seen = held > 0
    tests = np.count_nonzero(seen, axis=0)
    means = sums / np.maximum(held, 1)
    common = means.sum(axis=0) / np.maximum(tests, 1)
    # A test is predicted by the others that visit its cell, where enough do.
    shared = tests >= FEWEST_REPEATS
    others = (tests * common - means) / np.maximum(tests - 1, 1)
    predicted = np.where(seen & shared, others, 0.0).ravel()[at]
    squares = float(table.left @ table.left)
    share = 1.0 - float(np.sum((table.left - predicted) ** 2)) / squares if squares > 0.0 else 0.0
    # Tests of unlike noise are compared on the scale of each.
    size = np.sqrt(np.bincount(test, table.left**2) / np.bincount(test))
    scaled = means[:, shared] / np.where(size > 0.0, size, 1.0)[:, None]
    p_value = _chance(held[:, shared], scaled)
    return Dependence(names, cell, predicted, max(share, 0.0), p_value)


def _chance(held: IntArray, means: FloatArray) -> float:
    """Probability of as much in common where tests have nothing in common.

    `held`, `means` (tests, cells): samples, and the residual's mean of them. Within a cell all
    tests count alike, so that both mean squares have the same expectation whatever each test's
    spread; a cell counts by the samples behind its means.
    The cells' correlation within a test, and with it the degrees of freedom, is the tests' own.
    """
    if not means.size:
        return 1.0
    seen = held > 0
    tests = np.count_nonzero(seen, axis=0)
    common = means.sum(axis=0) / tests
    off = np.where(seen, means - common, 0.0)
    weight = tests / np.sum(np.where(seen, 1.0 / np.maximum(held, 1), 0.0), axis=0)
    between = float(weight @ (tests * common**2))
    within = float(weight @ (np.sum(off**2, axis=0) / (tests - 1)))
    if within <= 0.0:
        return 1.0 if between <= 0.0 else 0.0
    repeats = float(weight @ (tests - 1) / weight.sum())
    freedom = _freedom(np.sqrt(weight) * off)
    from scipy.special import fdtrc

    return float(fdtrc(freedom, freedom * repeats, between / within))


def _freedom(off: FloatArray) -> float:
    """In how many cells, independently, tests (tests, cells) about their common mean differ.

    tr(C)^2 / tr(C^2) of the cells' covariance C within a test. Of the sample's own, which has no
    more than a test less, it is too small (Greenhouse, Geisser); without bias (Bai, Saranadasa,
    Statist. Sinica 6 (1996) 311-329, of m = tests - 1) it scatters, so its lower limit is taken.
    """
    products, m = off @ off.T, len(off) - 1
    total = float(np.trace(products)) ** 2
    own = float(np.sum(products**2))
    least = total / own
    beyond = own - total / m
    parts = (m - 1) * (m + 2) / 2
    if m < FEWEST_REPEATS:
        return least
    from scipy.special import chdtri

    # The part of the products beyond their mean, over 2 tr(C^2), is chi-squared of so many numbers.
    limit = math.inf
    if beyond > 0.0:
        limit = 2.0 * float(chdtri(parts, 1.0 - SIGNIFICANT)) * total / (m**2 * beyond)
    return min(max(least, limit), float(off.shape[1]))


@dataclass(frozen=True)
class Remainder:
    """RMSE of a channel's residual, in its unit, and its parts, whose squares add up to its own.

    `noise`: the sensors'; `repeatable`: what other tests predict over `regressors` (those that were
    tried, where nothing repeats); `scatter`: the remaining part, another in each test. `agreeing`:
    of `tests`, those whose residual the others predict at all.
    """

    channel: str
    unit: str
    rmse: float
    noise: float
    repeatable: float
    scatter: float
    regressors: tuple[str, ...]
    agreeing: int
    tests: int

    def is_structure(self, before: float) -> bool:
        """Whether what repeats is of a size that counts, next to the noise and to `before`.

        `before`: the RMSE of the law without the effects added, in the channel's unit.
        """
        if len(self.regressors) > 1 and self.share < LEAST_TOGETHER:
            return False
        least = math.sqrt(LEAST_SHARE) * before
        return self.repeatable > max(OF_THE_NOISE * self.noise, least)

    @property
    def share(self) -> float:
        """Share of the variance that repeats, 0 to 1."""
        return (self.repeatable / self.rmse) ** 2 if self.rmse > 0.0 else 0.0

    def to_json(self) -> dict[str, Any]:
        """The numbers by name."""
        return {**vars(self), "regressors": list(self.regressors)}


def remainder(
    table: ResidualTable,
    found: Sequence[Dependence],
    noise: float,
    channel: str,
    unit: str,
    judged: BoolArray | None = None,
) -> Remainder | None:
    """The parts of a residual, of the rows `judged` (n,) where only some are; None where too few
    tests or samples are there to say.

    `noise` in the channel's unit, NaN where it is not known. It is no more than what no other test
    predicts: noise cannot be predicted.
    """
    if not found:
        return None
    best = found[0]
    rows = np.ones(len(table), dtype=bool) if judged is None else judged
    left, test = table.left[rows], np.unique(table.test[rows], return_inverse=True)[1]
    off = left - (best.predicted[rows] if best.is_significant else 0.0)
    squares, missed = (np.bincount(test, values**2) for values in (left, off))
    rmse = math.sqrt(float(squares.sum()) / len(left))
    share = max(1.0 - float(missed.sum() / squares.sum()), 0.0) if rmse > 0.0 else 0.0
    unpredicted = rmse * math.sqrt(1.0 - share)
    noise = unpredicted if math.isnan(noise) else min(noise, unpredicted)
    return Remainder(
        channel,
        unit,
        rmse,
        noise,
        rmse * math.sqrt(share),
        math.sqrt(max(unpredicted**2 - noise**2, 0.0)),
        best.regressors if best.is_significant else tuple(table.columns),
        int(np.count_nonzero(missed < squares)),
        len(squares),
    )


def multiples_of_tests(left: FloatArray, modelled: FloatArray, test: IntArray) -> FloatArray:
    """The multiple of an effort `modelled` (n,) that each test's residual `left` (n,) holds.

    (k,) of the tests in which it acts.
    """
    which = np.unique(test, return_inverse=True)[1]
    power = np.bincount(which, modelled**2)
    known = power > 0.0
    return np.asarray(np.bincount(which, left * modelled)[known] / power[known])


__all__ = [
    "LEAST_IN_CELL",
    "LEAST_SHARE",
    "LEAST_TOGETHER",
    "MISFIT",
    "OF_THE_NOISE",
    "PER_DIRECTION",
    "Dependence",
    "Remainder",
    "ResidualTable",
    "dependences",
    "multiples_of_tests",
    "per_direction",
    "remainder",
]
