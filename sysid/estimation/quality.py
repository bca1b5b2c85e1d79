"""How well a fitted law follows its signal, and the verdict on it: for every kind of fit.

RMSE, its share of the signal's spread, R2, a test for lack of fit, and a verdict in words
("good", "usable", "poor: ...", "impossible: ..."). The verdict goes by what the law misses
*beyond the scatter of the measurement*, where that is known: a true law under noise is never
called poor because of the noise. A lack of fit that is tiny but significant, as in many samples,
does not make a fit poor; nor is such a fit called good. Significant is a test's p-value below
`SIGNIFICANT`, or where the scatter is known, a residual above `SCATTER_TIMES` of it.

The spread is that of the signal about its mean where the law has a constant term, and about zero
where it does not: friction in one direction hardly varies, yet without friction the effort would
be 0.

The verdict covers all data that were given, not only those that the fit used. The fitted law is
also compared with the data that the fit excluded, as far as it applies to them (`ExcludedData`),
and its errors there count as well. A fit of a log that contradicts its rig file is not good,
however well it follows the log.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.estimation.linear import FTest, finite_or_none
from sysid.types import FloatArray

LEAST_EXPLAINED = 0.5
"""Share of a signal's variance that a law has to explain, its scatter apart.

Below it, most is unexplained: the numbers describe something else, and the fit is
refused. True laws are far above it, nonsense mostly far below (benchmarks/fit_quality.py). A law
that lacks an effect may be below too (the time of a pulsed valve without partial opening: 0.33),
so that a campaign keeps friction and parts on a bench with the verdict, for the diagnosis.
"""
GOOD_SHARE = 0.1
"""What a good fit may miss, over the signal's spread: 1 % of the variance. Constant-effort tests
of healthy rigs repeat to a few per cent, on/off valves are followed to less."""
USABLE_SHARE = 0.5
"""What a usable fit may miss: a quarter of the variance. So far a law is a coarse picture of the
signal, and a right one: the nine terms of the bipolynomial miss up to 0.49 of the duty's spread on
healthy valves. Beyond it, what is missed is of the size of the law itself."""
SCATTER_TIMES = 1.3
"""Up to this many times the scatter, a residual is called scatter: the scatter is an estimate
itself, and correlated noise hides part of it from a noise floor."""
SIGNIFICANT = 0.01
"""Chance of calling a fit contradicted by its own data where it is not: a lack of fit, a scatter
between tests beyond their errors, two clusters in what should be one."""
FEWEST_REPEATS = 3
"""Tests with which their scatter shows, and a median that one of them does not move."""
FEWEST_ROWS = 20
"""Residuals that show their variance, to a sixth of their standard deviation."""
MOST_STD = 0.3
"""With a standard error above this share of its size, a number of a flow is not identified."""
DISAGREE = 3.0
"""Standard errors between two estimates of one number that disagree; by chance one pair in 370."""

FEW = 0.1
"""The share of the data that may be excluded without a remark in the verdict."""
MOST_UNASKED = 0.25, 0.5
"""Of the tests given, the share that may be unusable in a good and in a usable fit: what nobody
can ask may say anything."""
CONTRADICTED = "log and rig file contradict each other"

REPEATS, SCATTER, RUNS, NONE = "repeats", "scatter", "runs", "none"
_RANKS = ("good", "usable", "poor")
_LACK_OF_FIT = "lack of fit"
WITH_LACK_OF_FIT = f"usable: {_LACK_OF_FIT}"
"""The verdict of a fit that misses little, and that significantly."""


@dataclass(frozen=True)
class LackOfFit:
    """Whether the residual is more than scatter, by one of four methods.

    `repeats`: F test of the law against the means of repeated conditions (pure error).
    `scatter`: the residual's RMSE over the measurement's own scatter (`statistic`; no p-value).
    `runs`: Wald and Wolfowitz' test of the residual's signs in their order (`statistic` is
    normal; negative: too few changes). `none`: not testable from these tests.
    """

    method: str
    statistic: float | None = None
    p_value: float | None = None

    @property
    def is_significant(self) -> bool:
        """Whether scatter alone gives such a residual in less than one fit of a hundred.

        A scatter that is known leaves no such chance, only its own error (`SCATTER_TIMES`).
        """
        if self.method == SCATTER:
            return self.statistic is not None and self.statistic > SCATTER_TIMES
        return self.p_value is not None and self.p_value < SIGNIFICANT

    def to_json(self) -> dict[str, Any]:
        """The bundle's object, without what is not known."""
        known = {"statistic": self.statistic, "p_value": self.p_value}
        found = {k: v for k, v in known.items() if v is not None and math.isfinite(v)}
        return {"method": self.method, **found}


NOT_TESTABLE = LackOfFit(NONE)


@dataclass(frozen=True)
class ExcludedData:
    """Data that a fit excluded: `count` of the `given` (`what`: tests, samples).

    The law makes no prediction for `unasked` of these. `rmse` and `spread`: the law's error on,
    and the spread of, all data that it predicts, used or excluded; None where it predicts only
    the data that were used.
    """

    what: str
    count: int
    given: int
    unasked: int = 0
    rmse: float | None = None
    spread: float | None = None

    @property
    def share(self) -> float:
        """Excluded share of the data that were given."""
        return self.count / self.given if self.given else 0.0

    @property
    def text(self) -> str:
        """ "7 of 14 tests", "36 % of the samples"."""
        if self.what == "samples":
            return f"{100.0 * self.share:.0f} % of the samples are excluded"
        verb = "is" if self.count == 1 else "are"
        return f"{self.count} of {self.given} {self.what} {verb} excluded"


@dataclass(frozen=True)
class FitQuality:
    """How well a law follows one signal.

    `signal` says which; `count` samples; `rmse` and `spread` in `unit`. `scatter` is the
    measurement's own, None where it is not known. `impossible`: what cannot be in the
    parameters, one line each. `left_out`: what was given and not used. `contradicted`: whether a
    log contradicts the rig file. `spare`: the number of values less the number of parameters,
    where that may be 0: then nothing shows how large the law's error is. `outdone_by`: the law
    that follows the same data decidedly better, as a sentence names it.
    """

    signal: str
    unit: str
    count: int
    rmse: float
    spread: float
    lack_of_fit: LackOfFit = NOT_TESTABLE
    scatter: float | None = None
    impossible: tuple[str, ...] = ()
    left_out: tuple[ExcludedData, ...] = ()
    contradicted: bool = False
    spare: int | None = None
    outdone_by: str = ""

    @classmethod
    def of(
        cls,
        signal: str,
        unit: str,
        measured: ArrayLike,
        residuals: ArrayLike,
        *,
        has_constant: bool,
        lack_of_fit: LackOfFit = NOT_TESTABLE,
        scatter: float | None = None,
    ) -> FitQuality:
        """The quality of a fit from the measured signal (n,) and the residual of the law (n,)."""
        y, left = np.asarray(measured, dtype=float), np.asarray(residuals, dtype=float)
        return cls(
            signal, unit, len(y), root_mean_square(left),
            spread(y, has_constant), lack_of_fit, scatter,
        )  # fmt: skip

    @property
    def share(self) -> float:
        """RMSE over the signal's spread; infinite for a signal that does not vary."""
        return self.rmse / self.spread if self.spread > 0.0 else math.inf

    @property
    def r2(self) -> float:
        """Share of the signal's variance that the law explains; below 0: worse than none."""
        return 1.0 - self.share**2

    @property
    def missed(self) -> float:
        """Share of the signal's spread that the law misses beyond the scatter."""
        return self._missed(self.rmse, self.spread)

    def _missed(self, rmse: float, spread: float) -> float:
        scatter = self.scatter or 0.0
        if rmse <= SCATTER_TIMES * scatter:
            return 0.0
        return math.sqrt(rmse**2 - scatter**2) / spread if spread else math.inf

    @property
    def explains_too_little(self) -> bool:
        """Whether less than `LEAST_EXPLAINED` of the signal is explained, its scatter apart."""
        return not 1.0 - self.missed**2 >= LEAST_EXPLAINED

    @property
    def verdict(self) -> str:
        """ "good", "usable", "usable: ...", "poor: ..." or "impossible: ..."."""
        if self.impossible:
            return f"impossible: {'; '.join(self.impossible)}"
        # First what says more than the lack of fit that it explains.
        outdone = f"{self.outdone_by} follows these tests better"
        found = [("usable", outdone)] if self.outdone_by else []
        found += [self._of_used(), *map(self._of_excluded, self.left_out)]
        if self.contradicted:
            found.append(("usable", CONTRADICTED))
        if self.spare == 0:
            found.append(("usable", "no test repeats it, so its error is unknown"))
        rank, why = max(found, key=lambda one: (_RANKS.index(one[0]), bool(one[1])))
        return f"{rank}: {why}" if why else rank

    def _of_used(self) -> tuple[str, str]:
        """The rank by what the fit used, and why."""
        if self.missed <= GOOD_SHARE:
            noisy = self.r2 < LEAST_EXPLAINED
            if noisy:
                return "poor", "the scatter is as large as the signal"
            if self.lack_of_fit.is_significant:
                return "usable", _LACK_OF_FIT
            return "good", ""
        return ("usable", "") if self.missed <= USABLE_SHARE else ("poor", self.shortfall)

    def _of_excluded(self, out: ExcludedData) -> tuple[str, str]:
        """The rank by what the fit excluded, and why."""
        if out.share <= FEW:
            return "good", ""
        good, usable = MOST_UNASKED
        unasked = out.unasked / out.given
        found = ["good" if unasked <= good else "usable" if unasked <= usable else "poor"]
        why = out.text
        if out.rmse is not None and out.spread is not None:
            missed = self._missed(out.rmse, out.spread)
            rank = (
                "good" if missed <= GOOD_SHARE else "usable" if missed <= USABLE_SHARE else "poor"
            )
            found.append(rank)
            if rank != "good":
                why += f", with which the law misses {100.0 * missed:.0f} % of the spread"
        rank = max(found, key=_RANKS.index)
        return rank, "" if rank == "good" else why

    @property
    def shortfall(self) -> str:
        """What the law does not explain, in words."""
        if math.isinf(self.share):
            return f"the {self.signal} does not vary"
        beyond = " beyond its scatter" if self.scatter else ""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return (
            f"the law explains {100.0 * max(self.r2, 0.0):.0f} % of the {self.signal} "
            f"(RMSE {self.rmse:.3g}{unit}) and misses {100.0 * self.missed:.0f} % of its "
            f"spread{beyond}"
        )

    def to_json(self) -> dict[str, Any]:
        """The object of a bundle: numbers that are not finite become null."""
        return {
            "signal": self.signal,
            "unit": self.unit,
            "samples": self.count,
            **({"left_out": [out.text for out in self.left_out]} if self.left_out else {}),
            "rmse": finite_or_none(self.rmse),
            "rmse_share": finite_or_none(self.share),
            "r2": finite_or_none(self.r2),
            "scatter": None if self.scatter is None else finite_or_none(self.scatter),
            "lack_of_fit": self.lack_of_fit.to_json(),
            "verdict": self.verdict,
        }


def root_mean_square(values: FloatArray) -> float:
    """RMS of values (n,), NaN without any."""
    return math.sqrt(float(np.mean(values**2))) if len(values) else math.nan


def spread(values: FloatArray, has_constant: bool) -> float:
    """RMS of a signal (n,) about its mean, or about zero where the law has no constant."""
    return root_mean_square(values - (np.mean(values) if has_constant else 0.0))


def repeats_lack_of_fit(test: FTest | None) -> LackOfFit:
    """Lack of fit by the F test of a law against the means of its repeats; None: not testable."""
    return LackOfFit(REPEATS, test.statistic, test.p_value) if test else NOT_TESTABLE


@dataclass(frozen=True)
class _Within:
    """Residuals within c repeated conditions: how many and their means, (c,) each; their sum of
    squares about these means (pure error), and its degrees of freedom."""

    count: NDArray[np.intp]
    means: FloatArray
    squares: float
    dof: int

    @classmethod
    def of(cls, residuals: FloatArray, cells: ArrayLike) -> _Within:
        _, place, count = np.unique(cells, return_inverse=True, return_counts=True)
        means = np.bincount(place, residuals) / count
        squares = float(np.sum((residuals - means[place]) ** 2))
        return cls(count, means, squares, len(residuals) - len(count))


def repeats_test(residuals: FloatArray, cells: ArrayLike, parameters: int) -> LackOfFit:
    """F test of residuals (n,) against pure error; `cells` (n,) numbers repeated conditions.

    Not testable without repeats, or with no more conditions than `parameters`.
    """
    from scipy.special import fdtrc

    within = _Within.of(residuals, cells)
    more, left = len(within.count) - parameters, within.dof
    if more < 1 or left < 1 or not within.squares > 0.0:
        return NOT_TESTABLE
    f = float(within.count @ within.means**2) / more / (within.squares / left)
    return LackOfFit(REPEATS, f, float(fdtrc(more, left, max(f, 0.0))))


def repeated_scatter(residuals: FloatArray, cells: ArrayLike) -> float | None:
    """Standard deviation of residuals (n,) within repeated conditions (n,); None without any."""
    within = _Within.of(residuals, cells)
    return math.sqrt(within.squares / within.dof) if within.dof >= 1 else None


def scatter_test(rmse: float, scatter: float) -> LackOfFit:
    """The residual over the measurement's scatter; not testable where that is not known."""
    if not scatter > 0.0 or not math.isfinite(rmse / scatter):
        return NOT_TESTABLE
    return LackOfFit(SCATTER, rmse / scatter)


def runs_test(residuals: Sequence[NDArray[np.float64]]) -> LackOfFit:
    """Runs of equal sign in several series of residuals, pooled (Wald and Wolfowitz 1940)."""
    from scipy.special import ndtr

    gap = variance = 0.0
    for series in residuals:
        up = series > 0.0
        n, a = len(up), float(np.count_nonzero(up))
        b = n - a
        if a < 1.0 or b < 1.0 or n < 3:
            continue
        expected = 1.0 + 2.0 * a * b / n
        gap += 1.0 + float(np.count_nonzero(up[1:] != up[:-1])) - expected
        variance += (expected - 1.0) * (expected - 2.0) / (n - 1.0)
    if not variance > 0.0:
        return NOT_TESTABLE
    z = gap / math.sqrt(variance)
    return LackOfFit(RUNS, z, float(2.0 * ndtr(-abs(z))))


def lack_of_fit_text(found: Mapping[str, Any]) -> str:
    """A bundle's `lack_of_fit` in words."""
    statistic, p_value = found.get("statistic"), found.get("p_value")
    if found.get("method") == SCATTER and statistic is not None:
        as_large = f"{statistic:.3g} times"
        if as_large == "1 times":
            return "residual as large as the scatter"
        return f"residual {as_large} the scatter"
    if statistic is None or p_value is None:
        return "not testable from these tests"
    seen = "significant" if p_value < SIGNIFICANT else "none"
    p = f"p = {p_value:.2g}" if p_value >= 1e-20 else "p < 1e-20"
    name = "repeats" if found.get("method") == REPEATS else "runs"
    return f"{seen} ({name}, {p})"


__all__ = [
    "CONTRADICTED",
    "DISAGREE",
    "FEWEST_REPEATS",
    "FEWEST_ROWS",
    "GOOD_SHARE",
    "LEAST_EXPLAINED",
    "MOST_STD",
    "NOT_TESTABLE",
    "SCATTER_TIMES",
    "SIGNIFICANT",
    "USABLE_SHARE",
    "WITH_LACK_OF_FIT",
    "ExcludedData",
    "FitQuality",
    "LackOfFit",
    "lack_of_fit_text",
    "repeated_scatter",
    "repeats_lack_of_fit",
    "repeats_test",
    "root_mean_square",
    "runs_test",
    "scatter_test",
    "spread",
]
