"""The drifts that a cycle's innovations speak for, over the cycles before it.

A cycle gives normal equations A d = b of the drifts d, in their scales. What scatters from cycle to
cycle, by the columns L of the design, is integrated out: M = A - A L (I + L'AL)^-1 L'A is the
information that is left, and m = b - A L (I + L'AL)^-1 L'b. Both are summed with forgetting. The
bundle's own errors, of covariance B, are the same in all cycles, so that m has the covariance
V + M B M under health. So is what the observers themselves make of a motion: quantised positions
and sampled pressures look like a little more or less friction, always the same. The first cycles
teach the monitor both, as the posterior mean d0 of drifts of covariance B and, for friction, as
large as friction itself; from then on m - M d0 is tested. Each drift's statistic is that of its
likelihood ratio (a generalised likelihood ratio over which one it is; Basseville and Nikiforov,
1993, 2.4.3 and 7.2.4).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from sysid.controllers.monitor.drifts import COUNT, DRIFTS, TAILS, TESTED, UNDECIDED
from sysid.types import FloatArray

FORGETTING = 0.8
"""What a cycle counts of the one after it."""
FALSE_ALARMS = 1e-6
"""Share of healthy cycles that may end with an alarm."""
ODDS = 20.0
"""A kind is named where its likelihood is this many times that of any other."""
LEARNING = 10
"""Cycles that the monitor learns from at first: friction is compared with these."""
WITHIN = (1, 10)
"""Numbers of cycles for which the smallest detectable changes are stated."""
EXCITED = 1e-9
"""A direction of which less than this share of its information remains was not excited."""


@cache
def threshold() -> float:
    """The limit of a statistic, in standard deviations; all tests of a cycle together."""
    from scipy.special import ndtri

    return float(-ndtri(FALSE_ALARMS / TAILS))


@dataclass
class Cycle:
    """The normal equations of one cycle: (p, p) and (p,).

    `squares`: of each sensor half the squared differences of neighbouring innovations, `count` how
    many.
    """

    matrix: FloatArray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    vector: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    squares: FloatArray = field(default_factory=lambda: np.zeros(3))
    count: FloatArray = field(default_factory=lambda: np.zeros(3))

    def excess(self) -> float:
        """Variance of the innovations over what the noise gives, of the worst sensor; >= 1."""
        means = self.squares / np.maximum(self.count, 1.0)
        return max(1.0, float(np.max(means)))


def mean_cycle(cycles: Sequence[Cycle]) -> Cycle:
    """A cycle as these are in the mean."""
    n = float(len(cycles))
    return Cycle(
        np.sum([c.matrix for c in cycles], axis=0) / n,
        np.sum([c.vector for c in cycles], axis=0) / n,
        np.sum([c.squares for c in cycles], axis=0),
        np.sum([c.count for c in cycles], axis=0),
    )


@dataclass(frozen=True)
class Verdict:
    """After a cycle: each drift's statistic `z` (p,) and `change` (p,) in SI.

    `kind` empty without an alarm; `drift` the number of the one that is most likely.
    """

    z: FloatArray
    change: FloatArray
    kind: str
    drift: int

    @property
    def alarms(self) -> bool:
        """Whether the machine left its bundle."""
        return self.kind != ""

    @property
    def title(self) -> str:
        """The most likely drift."""
        return DRIFTS[self.drift].title


@dataclass
class Pool:
    """The sums over the cycles; `scatter`, `errors`, `scales` and `learning` are the design's.

    `learning` (p,): variances that drifts have beyond `errors` while the monitor learns; without
    them it does not. `baseline` (p,): the drifts that it has learned.
    """

    scatter: FloatArray
    errors: FloatArray
    scales: FloatArray
    learning: FloatArray | None = None
    baseline: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    matrix: FloatArray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    vector: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    variance: FloatArray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    cycles: int = 0

    def add(self, cycle: Cycle) -> Verdict:
        """One more cycle, and what all of them say."""
        excess = cycle.excess()
        matrix, vector = without_scatter(cycle.matrix / excess, cycle.vector / excess, self.scatter)
        keeps = 1.0 if self.learns else FORGETTING
        self.matrix = keeps * self.matrix + matrix
        self.vector = keeps * self.vector + vector
        self.variance = keeps**2 * self.variance + matrix
        self.cycles += 1
        said = self.verdict()
        if self.learning is not None and self.cycles == LEARNING:
            self._learn()
        return said

    @property
    def learns(self) -> bool:
        """Whether the cycle that comes is one of those that the monitor learns from."""
        return self.learning is not None and self.cycles < LEARNING

    def _learn(self) -> None:
        """The baseline, and sums anew."""
        prior = self._prior()
        covariance = self.variance + self.matrix @ prior @ self.matrix
        white, rows = whitened(covariance, self.vector, self.matrix @ prior)
        self.baseline = rows.T @ white
        self.matrix, self.variance = np.zeros((COUNT, COUNT)), np.zeros((COUNT, COUNT))
        self.vector = np.zeros(COUNT)

    def _prior(self) -> FloatArray:
        """Covariance of what is the same in all cycles and not known."""
        if self.learning is None or self.cycles > LEARNING:
            return self.errors
        return np.asarray(self.errors + np.diag(self.learning))

    def verdict(self) -> Verdict:
        """What the sums say."""
        white, rows = self._whitened()
        score = rows.T @ white
        power = np.einsum("ij,ij->j", rows, rows)
        has = power > 0.0
        root = np.sqrt(np.where(has, power, 1.0))
        z = np.where(has, score / root, 0.0)
        change = np.where(has, score / root**2, 0.0) * self.scales
        return Verdict(z, change, *judged(z))

    def _whitened(self) -> tuple[FloatArray, FloatArray]:
        """G^-1 m and G^-1 M, of G G' = V + M B M."""
        covariance = self.variance + self.matrix @ self._prior() @ self.matrix
        return whitened(covariance, self.vector - self.matrix @ self.baseline, self.matrix)


def judged(z: FloatArray) -> tuple[str, int]:
    """The kind that statistics (p,) alarm for, empty for none, and the drift that is most likely.

    "undecided" where another kind is not much less likely.
    """
    sizes = {k: max(z[k], 0.0) if DRIFTS[k].grows_only else abs(z[k]) for k in TESTED}
    best = max(sizes, key=lambda k: sizes[k])
    if not sizes[best] > threshold():
        return "", best
    kind = DRIFTS[best].kind
    other = max(size for k, size in sizes.items() if DRIFTS[k].kind != kind)
    is_clear = 0.5 * (sizes[best] ** 2 - other**2) > math.log(ODDS)
    return (kind if is_clear else UNDECIDED), best


def without_scatter(
    matrix: FloatArray, vector: FloatArray, scatter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Normal equations (p, p), (p,) with what varies from cycle to cycle integrated out."""
    spread = matrix @ scatter
    inner = np.eye(scatter.shape[1]) + scatter.T @ spread
    factor = np.linalg.cholesky(inner)
    half = np.linalg.solve(factor, spread.T)
    taken = np.linalg.solve(factor, scatter.T @ vector)
    return matrix - half.T @ half, vector - half.T @ taken


def whitened(
    covariance: FloatArray, vector: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """G^-1 vector and G^-1 matrix by Cholesky's factor; rows of what was not excited are 0."""
    n = len(vector)
    factor = np.array(covariance)
    white, rows = np.array(vector), np.array(matrix)
    for k in range(n):
        row = factor[k, :k]
        pivot = factor[k, k] - row @ row
        if not pivot > EXCITED * covariance[k, k]:
            factor[k:, k] = 0.0
            white[k], rows[k] = 0.0, 0.0
            continue
        root = math.sqrt(pivot)
        factor[k, k] = root
        factor[k + 1 :, k] = (factor[k + 1 :, k] - factor[k + 1 :, :k] @ row) / root
        white[k] = (white[k] - row @ white[:k]) / root
        rows[k] = (rows[k] - row @ rows[:k]) / root
    return white, rows


@dataclass(frozen=True)
class Detectable:
    """The smallest detectable change of each drift, SI, by the number of cycles within which.

    Of that size a change is found in half of the cases, of twice it practically always. Infinite:
    the motion says nothing of it.
    """

    by_cycles: Mapping[int, FloatArray]


def detectable(
    cycle: Cycle, scatter: FloatArray, errors: FloatArray, scales: FloatArray
) -> Detectable:
    """The smallest changes that show in cycles like this one, by the monitor's own statistics."""
    excess = cycle.excess()
    matrix, _ = without_scatter(cycle.matrix / excess, cycle.vector, scatter)
    pool = Pool(scatter, errors, scales)
    pool.matrix = matrix / (1.0 - FORGETTING)
    pool.variance = matrix / (1.0 - FORGETTING**2)
    _, rows = pool._whitened()
    power = np.sqrt(np.einsum("ij,ij->j", rows, rows))
    found = {}
    for count in WITHIN:
        seen = power * (1.0 - FORGETTING**count)
        with np.errstate(divide="ignore"):
            found[count] = np.where(seen > 0.0, threshold() / seen, np.inf) * scales
    return Detectable(found)


__all__ = [
    "EXCITED",
    "FALSE_ALARMS",
    "FORGETTING",
    "LEARNING",
    "ODDS",
    "WITHIN",
    "Cycle",
    "Detectable",
    "Pool",
    "Verdict",
    "detectable",
    "judged",
    "mean_cycle",
    "threshold",
    "whitened",
    "without_scatter",
]
