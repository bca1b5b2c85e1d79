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
1993, 2.4.3 and 7.2.4), of the sums or, but for friction, which scatters, of the last cycle alone,
whichever is larger.

Both alarm for a drift that all of their cycles have. A change begins in the middle of one, and the
sums are then of cycles without it, of one with a part of it, and of cycles with all of it, which is
the signature of no drift, and may resemble another's more. So the kind is named by the cycles after
the one that alarmed, summed by themselves: these have all of the change. They differ from those
that the monitor learned from by the change alone, so that B has no part in it. Their innovations'
variance about the most likely drift takes in what is not linear in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from sysid.controllers.monitor.drifts import COUNT, DRIFTS, FRICTION, TAILS, UNDECIDED
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
ALONE = np.array([drift.kind != FRICTION for drift in DRIFTS])
"""The drifts (p,) that are tested on the last cycle alone, too: friction scatters too much."""
EXCITED = 1e-9
"""A direction of which less than this share of its information remains was not excited."""


@cache
def threshold() -> float:
    """The limit of a statistic, in standard deviations; all tests of a cycle together: of the sums
    and of the cycle alone."""
    from scipy.special import ndtri

    return float(-ndtri(FALSE_ALARMS / (2 * TAILS)))


@dataclass
class Cycle:
    """The normal equations of one cycle: (p, p) and (p,).

    `squares`: of each sensor half the squared differences of neighbouring innovations, `count` how
    many. `energy`: the sum of all innovations' squares, `samples` how many.
    """

    matrix: FloatArray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    vector: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    squares: FloatArray = field(default_factory=lambda: np.zeros(3))
    count: FloatArray = field(default_factory=lambda: np.zeros(3))
    energy: float = 0.0
    samples: float = 0.0

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

    `kind` empty without an alarm; `drift` the number of the one that is most likely. After an alarm
    `change` and `drift` are those of the cycles since.
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
class Since:
    """The cycles since an alarm, each drift by itself, (p,): `score` m - M d0, and M's diagonal.

    `energy`: of the innovations' squares what the baseline does not explain, `samples` how many.
    """

    score: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    power: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    energy: float = 0.0
    samples: float = 0.0

    def add(self, cycle: Cycle, baseline: FloatArray) -> None:
        """One more, without its scatter."""
        score = cycle.vector - cycle.matrix @ baseline
        self.score = self.score + score
        self.power = self.power + np.diag(cycle.matrix)
        self.energy += cycle.energy - float(baseline @ (cycle.vector + score))
        self.samples += cycle.samples

    def statistics(self) -> tuple[FloatArray, FloatArray]:
        """Each drift's statistic (p,) and its size (p,), in its scale."""
        has = self.power > 0.0
        power = np.where(has, self.power, 1.0)
        z = np.where(has, self.score / np.sqrt(power), 0.0)
        explained = float(np.max(detection(z))) ** 2
        misfit = max(1.0, (self.energy - explained) / max(self.samples, 1.0))
        return z / math.sqrt(misfit), np.where(has, self.score / power, 0.0)


@dataclass
class Pool:
    """The sums over the cycles; `scatter`, `errors`, `scales` and `learning` are the design's.

    `learning` (p,): variances that drifts have beyond `errors` while the monitor learns; without
    them it does not. `baseline` (p,): the drifts that it has learned. `since`: the cycles after the
    one that alarmed; None without an alarm.
    """

    scatter: FloatArray
    errors: FloatArray
    scales: FloatArray
    learning: FloatArray | None = None
    baseline: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    matrix: FloatArray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    vector: FloatArray = field(default_factory=lambda: np.zeros(COUNT))
    variance: FloatArray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    since: Since | None = None
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
        own = Cycle(matrix, vector, energy=cycle.energy / excess, samples=cycle.samples)
        said = self._verdict(own)
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
        self.vector, self.since = np.zeros(COUNT), None

    def _prior(self) -> FloatArray:
        """Covariance of what is the same in all cycles and not known."""
        if self.learning is None or self.cycles > LEARNING:
            return self.errors
        return np.asarray(self.errors + np.diag(self.learning))

    def statistics(self, last: Cycle) -> tuple[FloatArray, FloatArray]:
        """Each drift's statistic (2, p) and size (2, p), SI: of the sums, and of the last cycle."""
        pooled = self._tested(self.matrix, self.vector, self.variance)
        alone = self._tested(last.matrix, last.vector, last.matrix)
        return np.array([pooled[0], alone[0]]), np.array([pooled[1], alone[1]])

    def _verdict(self, last: Cycle) -> Verdict:
        """What the sums and the last cycle say."""
        both, sizes = self.statistics(last)
        if self.learning is not None and self.cycles == LEARNING + 1:
            both[0, ~ALONE] = 0.0  # the sums are this one cycle alone
        is_alone = (np.abs(both[1]) > np.abs(both[0])) & ALONE
        z, change = (np.where(is_alone, v[1], v[0]) for v in (both, sizes))
        kind, drift = "", likeliest(z)
        if not detection(z)[drift] > threshold():
            self.since = None
        elif self.since is None:
            kind, self.since = UNDECIDED, Since()
        else:
            self.since.add(last, self.baseline)
            after, change = self.since.statistics()
            change = change * self.scales
            kind, drift = named(after)
        return Verdict(z, change, kind, drift)

    def _tested(
        self, matrix: FloatArray, vector: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Each drift's statistic and its size, SI, by normal equations and their variance."""
        white, rows = self._whitened(matrix, vector, variance)
        score = rows.T @ white
        power = np.einsum("ij,ij->j", rows, rows)
        has = power > 0.0
        root = np.sqrt(np.where(has, power, 1.0))
        return np.where(has, score / root, 0.0), np.where(has, score / root**2, 0.0) * self.scales

    def _whitened(
        self, matrix: FloatArray, vector: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """G^-1 m and G^-1 M, of G G' = V + M B M."""
        covariance = variance + matrix @ self._prior() @ matrix
        return whitened(covariance, vector - matrix @ self.baseline, matrix)


def detection(z: FloatArray) -> FloatArray:
    """The sizes (p,) of statistics in the direction in which they alarm; of nuisances 0."""
    grows = np.array([drift.grows_only for drift in DRIFTS])
    tested = np.array([bool(drift.kind) for drift in DRIFTS])
    return np.where(tested, np.where(grows, np.maximum(z, 0.0), np.abs(z)), 0.0)


def likeliest(z: FloatArray) -> int:
    """The drift that statistics (p,) speak for most."""
    return int(np.argmax(detection(z)))


def named(z: FloatArray) -> tuple[str, int]:
    """The kind that statistics (p,) speak for, and the drift that is most likely.

    "undecided" where another kind is not much less likely.
    """
    sizes, best = detection(z), likeliest(z)
    kind = DRIFTS[best].kind
    others = np.array([drift.kind != kind for drift in DRIFTS])
    other = float(np.max(np.where(others, sizes, 0.0)))
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
    pool, none = Pool(scatter, errors, scales), np.zeros(COUNT)
    sums, variance = matrix / (1.0 - FORGETTING), matrix / (1.0 - FORGETTING**2)
    pooled, alone = (
        np.sqrt(np.sum(pool._whitened(own, none, spread)[1] ** 2, axis=0))
        for own, spread in ((sums, variance), (matrix, matrix))
    )
    found = {}
    for count in WITHIN:
        seen = np.maximum(pooled * (1.0 - FORGETTING**count), np.where(ALONE, alone, 0.0))
        with np.errstate(divide="ignore"):
            found[count] = np.where(seen > 0.0, threshold() / seen, np.inf) * scales
    return Detectable(found)


__all__ = [
    "ALONE",
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
    "detection",
    "likeliest",
    "mean_cycle",
    "named",
    "threshold",
    "whitened",
    "without_scatter",
]
