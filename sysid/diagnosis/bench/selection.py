"""Which effects a part lacks: one after another, judged by predicting tests left out.

Each effect of the catalogue that acts on the part is fitted together with the law and the
effects added before, and predicts tests that it was not fitted on. The one that predicts best
is added if its strength differs significantly from 0, corrected for all that were tried
(Bonferroni), and it removes a substantial share of the prediction error. One with fewer numbers
that predicts about as well goes before it where the BIC is no worse: a shape with many may imitate
a constant, a slope or a product of two channels. It is ambiguous if
parts of the tests would have added another effect (`sysid.diagnosis.bench.stability`); so is
an effect that fits but does not predict, if parts of the tests name it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.fitting import FittedLaw, cross_validated, fit_law
from sysid.diagnosis.bench.stability import Repeats, repeats
from sysid.diagnosis.looked import Book, Looked, SearchStage
from sysid.diagnosis.thresholds import DIGITS, LEAST_GAIN, RIVAL_SHARE, SIGNIFICANCE
from sysid.estimation.nonlinear import LeastSquaresFit
from sysid.model.effects.catalogue import class_of
from sysid.model.effects.entry import CatalogueEffect
from sysid.parallel import Failure, attempt, attempt_all, time_limit
from sysid.types import FloatArray

Kind = type[CatalogueEffect]

MOST_EFFECTS = 3
# Rivals of a winner that are tried on the parts of the tests together with it.
_MOST_RIVALS = 3


@dataclass(frozen=True)
class Attempt:
    """An effect that was tried: its fitted p-value, and the share of the error that it removes.

    `gain`: share of the mean square error of the tests left out, negative if it predicts worse.
    `folds` (k,) the mean square error of each fold with it.
    """

    id: str
    p_value: float
    gain: float
    folds: FloatArray


@dataclass(frozen=True)
class Addition:
    """An effect that was added: the fit with it and all before it, and what else was tried.

    `ambiguous`: ids that these tests, or parts of them (`stability`), put in its place.
    """

    kind: Kind
    fitted: FittedLaw
    attempt: Attempt
    ambiguous: tuple[str, ...]
    repeats: Repeats
    attempts: tuple[Attempt, ...]

    @property
    def is_ambiguous(self) -> bool:
        """Whether other effects fit as well, or parts of the tests do not name this one."""
        return bool(self.ambiguous or self.repeats.sentence)

    @property
    def effect(self) -> CatalogueEffect:
        """The effect with its numbers."""
        return self.fitted.law.effects[-1]


@dataclass(frozen=True)
class Selection:
    """The law without effects, the additions in order, and the last round, which added none.

    `folds` (k,): mean square error of each fold, predicted by the law without effects.
    `undecided`: effects that were not added though parts of the tests name them. `looked`:
    what was looked at, and what not.
    """

    base: FittedLaw
    folds: FloatArray
    additions: tuple[Addition, ...]
    rejected: tuple[Attempt, ...]
    undecided: tuple[Repeats, ...]
    looked: Looked = field(default_factory=Looked)

    @property
    def final(self) -> FittedLaw:
        """The law with all that was added."""
        return self.additions[-1].fitted if self.additions else self.base


def select(
    component: Component,
    catalogue: Mapping[str, Kind],
    progress: Callable[[str], None] = lambda line: None,
) -> Selection:
    """Add effects to a part's law as long as they predict tests that were left out.

    Ends within the time limit in force (`sysid.parallel`), but for the law itself. Raises
    NotIdentifiedError where that is not identified.
    """
    everything, book = range(len(component.tests)), Book()
    folds = folds_of(component)
    with time_limit(None):
        base = fit_law(component, (), everything)
        first = error = cross_validated(component, (), folds, base.law)
    kinds = [kind for kind in component.effects(catalogue) if component.quantities_of(kind)]
    chosen: list[Kind] = []
    additions: list[Addition] = []
    while True:
        book.enter(SearchStage.EFFECTS, len(chosen) + 1)
        open_ones = [k for k in kinds if k not in chosen]
        so_far = additions[-1].fitted if additions else base
        fits = _attempts(component, chosen, open_ones, so_far, folds, error, book)
        attempts = [attempt for attempt, _ in fits]
        fitting = [(a, f) for a, f in fits if a.p_value * len(open_ones) < SIGNIFICANCE]
        passing = [(a, f) for a, f in fitting if _predicts(a, error)]
        if not passing or len(chosen) == MOST_EFFECTS:
            most = [f for _, f in fitting[: 1 + _MOST_RIVALS]]
            named = () if passing else attempt(lambda: _undecided(component, so_far, most))  # noqa: B023
            if isinstance(named, Failure):
                book.miss(named, decides=False)
                named = ()
            looked = book.closed()
            return Selection(base, first, tuple(additions), tuple(attempts), named, looked)
        winner, fitted = simplest(passing)
        chosen.append(next(k for k in open_ones if k.id == winner.id))
        progress(f"{winner.id}: removes {100 * winner.gain:.0f} % of the prediction error")
        rivals = [f for a, f in fits if a.gain > 0.0 and a is not winner]
        unfitted = book.unfinished(SearchStage.EFFECTS, len(chosen))
        book.enter(SearchStage.REPETITION, len(chosen))
        contenders = [fitted, *rivals[:_MOST_RIVALS]]
        again = attempt(partial(repeats, component, so_far, contenders))
        if isinstance(again, Failure):
            book.miss(again, decides=False)
            again = Repeats(winner.id, ())
        near = _ambiguous(winner, [a for a, _ in passing], {k.id for k in kinds})
        ambiguous = tuple(sorted({*near, *again.others, *unfitted}))
        additions.append(Addition(chosen[-1], fitted, winner, ambiguous, again, tuple(attempts)))
        error = winner.folds


def folds_of(component: Component) -> list[list[int]]:
    """Tests that are left out together: each by itself, or as evenly as the parts allow."""
    count = len(component.tests)
    parts = min(count, component.most_folds)
    return [list(range(k, count, parts)) for k in range(parts)] if parts > 1 else []


def _attempts(
    component: Component,
    chosen: Sequence[Kind],
    kinds: Sequence[Kind],
    without: FittedLaw,
    folds: Sequence[Sequence[int]],
    error: FloatArray,
    book: Book,
) -> list[tuple[Attempt, FittedLaw]]:
    """Every open effect with its fit, the best prediction first; computed in parallel.

    What fails, or what time runs out for, is noted.
    """
    everything = range(len(component.tests))
    by_id = {kind.id: kind for kind in kinds}
    tried = attempt_all(
        partial(_attempt, component, [*chosen, kind], without, folds, error) for kind in kinds
    )
    results = book.results(list(by_id), tried)
    book.screened += [name for name, _ in results]
    book.fitted += [name for name, done in results if done is not None]
    found = [
        (done[0], FittedLaw.of(component, [*chosen, by_id[name]], everything, done[1]))
        for name, done in results
        if done is not None
    ]
    # Of two that are equivalent on these tests the catalogue's first counts.
    return sorted(found, key=lambda pair: -round(pair[0].gain, DIGITS))


def _attempt(
    component: Component,
    kinds: Sequence[Kind],
    without: FittedLaw,
    folds: Sequence[Sequence[int]],
    error: FloatArray,
) -> tuple[Attempt, LeastSquaresFit] | None:
    """One effect together with those before it; None if these tests do not identify it."""
    fitted = fit_law(component, kinds, range(len(component.tests)), without.law)
    if not np.isfinite(fitted.fit.sum_of_squares):
        return None
    p_value = fitted.p_value(without)
    if p_value >= SIGNIFICANCE:
        # An insignificant effect needs no prediction.
        return Attempt(kinds[-1].id, p_value, 0.0, error), fitted.fit
    squares = cross_validated(component, kinds, folds, fitted.law)
    gain = 1.0 - float(squares.mean() / error.mean())
    return Attempt(kinds[-1].id, p_value, gain, squares), fitted.fit


def simplest(passing: Sequence[tuple[Attempt, FittedLaw]]) -> tuple[Attempt, FittedLaw]:
    """Of effects that predict, the best first, the one with the fewest numbers that do as well.

    As well: of almost the same gain, and no worse by the BIC.
    """
    best, fitted = passing[0]
    least = RIVAL_SHARE * best.gain
    limit = _bic(fitted, fitted)
    equal = [(a, f) for a, f in passing if a.gain > least and _bic(f, fitted) <= limit]
    return min(equal, key=lambda pair: len(pair[1].fit.values))


def _bic(fitted: FittedLaw, best: FittedLaw) -> float:
    """Schwarz's criterion, with as many samples as the best's correlated residuals are worth."""
    count = max(best.independent_samples, 2.0)
    squares = max(fitted.fit.sum_of_squares, 1e-300)
    return count * math.log(squares) + len(fitted.fit.values) * math.log(count)


def _predicts(attempt: Attempt, error: FloatArray) -> bool:
    better = int(np.count_nonzero(attempt.folds < error))
    return attempt.gain > LEAST_GAIN and 2 * better > len(error)


def _undecided(
    component: Component, without: FittedLaw, fits: Sequence[FittedLaw]
) -> tuple[Repeats, ...]:
    """Which of the effects that fit, but do not predict, parts of the tests still name."""
    if not fits:
        return ()
    named = repeats(component, without, fits).named
    return tuple(Repeats(name, named) for name in sorted({n for n in named if n is not None}))


def _ambiguous(winner: Attempt, passing: Sequence[Attempt], known: set[str]) -> tuple[str, ...]:
    """Members of the winner's class that act here, and rivals that predict as well."""
    near = (class_of(winner.id) & known) - {winner.id}
    near |= {a.id for a in passing if a.id != winner.id and a.gain > RIVAL_SHARE * winner.gain}
    return tuple(sorted(near))


__all__ = ["Addition", "Attempt", "Selection", "folds_of", "select", "simplest"]
