"""A round on a part tested alone: effects are judged by predicting tests left out.

Each effect of the catalogue that acts on the part is fitted together with the law and the
effects added before, and predicts tests that it was not fitted on. The one that predicts best
is added if its strength differs significantly from 0, corrected for all that were tried
(Bonferroni), and it removes a substantial share of the prediction error. One with fewer numbers
that predicts about as well goes before it where the BIC is no worse: a shape with many may imitate
a constant, a slope or a product of two channels. One whose strength ends at the limit of what
is plausible has another cause's form, and goes behind those that do not; so does one whose shape
ends at a limit of its range behind those that explain about as much. It is ambiguous if
parts of the tests would have added another effect (`sysid.diagnosis.bench.stability`); so is
an effect that fits but does not predict, if parts of the tests name it.

What differs from test to test, as friction, counts as one error of each test
(`Component.whitened`): fits, significance and prediction errors are those of residuals weighed so;
the laws and errors of a `Selection` are shown on the residuals as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.fitting import FittedLaw, cross_validated, fit_law
from sysid.diagnosis.bench.stability import Repeats, repeats
from sysid.diagnosis.search import (
    MOST_EFFECTS,
    Round,
    Rounds,
    Step,
    Tried,
    limit_sentence,
    run,
)
from sysid.diagnosis.search_record import Recorder, SearchRecord, SearchStage
from sysid.diagnosis.thresholds import DIGITS, LEAST_REDUCTION, RIVAL_SHARE, SIGNIFICANCE
from sysid.errors import Failure, NotIdentifiedError
from sysid.estimation.nonlinear import LeastSquaresFit
from sysid.estimation.quality import SIGNIFICANT
from sysid.parallel import attempt, attempt_all, limited
from sysid.parameters.scatter import MOST_SCATTER
from sysid.plant.effects.catalogue import class_of
from sysid.plant.effects.entry import CatalogueEffect
from sysid.types import FloatArray, Progress, no_progress

Kind = type[CatalogueEffect]

# Share of the error that an effect must still remove given those added after it: far less than
# to be added, as what is in the model is not tried against rivals again.
_LEAST_KEPT = 0.05
# Rivals of a winner that are tried on the parts of the tests together with it.
_MOST_RIVALS = 3


@dataclass(frozen=True)
class Attempt(Tried):
    """An effect that was fitted: `reduction` is the share of the error that it removes.

    Of the mean square error of the tests left out; `folds` (k,) that of each fold with it.
    """

    folds: FloatArray


@dataclass(frozen=True)
class Addition(Step):
    """An effect that was added: the fit with it and all before it.

    `ambiguous`: ids that these tests, or parts of them (`stability`), put in its place; `folds`
    (k,) the mean square error of each fold with it.
    """

    fitted: FittedLaw
    folds: FloatArray
    repeats: Repeats

    @property
    def is_ambiguous(self) -> bool:
        """Whether other effects fit as well, or parts of the tests do not name this one."""
        return bool(self.ambiguous or self.repeats.sentence)

    @property
    def parts_named(self) -> dict[str, Any]:
        """What parts of the tests name."""
        return self.repeats.to_json()

    @property
    def limit_sentence(self) -> str:
        """Says that its name is in doubt as a shape ended at a limit; empty where none did."""
        return limit_sentence(self.id, self.fitted.limits, self.ambiguous)


@dataclass(frozen=True)
class Selection:
    """The law without effects, the additions in order, and what each round tried.

    `folds` (k,): mean square error of each fold, predicted by the law without effects.
    `undecided`: effects that were not added though parts of the tests name them. `record`:
    what was examined, and what not.
    """

    base: FittedLaw
    folds: FloatArray
    additions: tuple[Addition, ...]
    rounds: tuple[Round, ...]
    undecided: tuple[Repeats, ...]
    record: SearchRecord = field(default_factory=SearchRecord)

    @property
    def final(self) -> FittedLaw:
        """The law with all that was added."""
        return self.additions[-1].fitted if self.additions else self.base


def select(
    component: Component,
    catalogue: Mapping[str, Kind],
    progress: Progress = no_progress,
    *,
    quick: bool = False,
) -> Selection:
    """Add effects to a part's law as long as they predict tests that were left out.

    Ends within the limit in force (`sysid.parallel`), but for the law itself and the first round.
    Raises NotIdentifiedError where the law is not identified.
    """
    rounds = _HeldOutRounds(component, catalogue, progress)
    rounds.recorder.quick = quick
    history = run(rounds, rounds.recorder, progress)
    record = rounds.recorder.closed()
    found = Selection(
        rounds.base, rounds.first, tuple(rounds.steps), history, rounds.undecided, record
    )
    return _as_measured(found, component) if rounds.has_whitened else found


def _as_measured(found: Selection, component: Component) -> Selection:
    """A selection on whitened residuals, with its laws and errors shown on those as they are."""
    folds = folds_of(component)

    def errors(fitted: FittedLaw) -> FloatArray:
        kinds = [type(effect) for effect in fitted.law.effects]
        return cross_validated(component, kinds, folds, fitted.law)

    with limited():
        additions = tuple(
            replace(a, fitted=replace(a.fitted, component=component), folds=errors(a.fitted))
            for a in found.additions
        )
        base = replace(found.base, component=component)
        return replace(found, base=base, folds=errors(base), additions=additions)


class _HeldOutRounds(Rounds[Addition]):
    """The rounds of a part: `base` is its law without effects, `first` the folds' errors.

    `component` is the part with its residuals as a round weighs them, `measured` as they are;
    `has_whitened`: whether a round weighed them otherwise.
    """

    stage = SearchStage.EFFECTS

    def __init__(
        self, component: Component, catalogue: Mapping[str, Kind], progress: Progress
    ) -> None:
        self.component = self.measured = component
        self.has_whitened = False
        self.progress, self.recorder = progress, Recorder()
        self.folds = folds_of(component)
        with limited():
            self.base = fit_law(component, (), range(len(component.tests)))
            self.first = cross_validated(component, (), self.folds, self.base.law)
        # Of a single test nothing can be left out, so that no effect can be judged.
        tried = component.effects(catalogue) if self.folds else ()
        self.kinds = [kind for kind in tried if component.quantities_of(kind)]
        self.steps, self.tried = [], ()
        self.undecided: tuple[Repeats, ...] = ()
        # Without each step that might be superfluous, the others fitted together.
        self._others: dict[str, tuple[FittedLaw, FloatArray]] = {}

    @property
    def so_far(self) -> FittedLaw:
        """The law with the effects added."""
        return self.steps[-1].fitted if self.steps else self.base

    @property
    def error(self) -> FloatArray:
        """Mean square error of each fold with them, (k,)."""
        return self.steps[-1].folds if self.steps else self.first

    def proposal(self, number: int, barred: frozenset[str]) -> Addition | None:
        """The effect that predicts best, or the simplest that predicts about as well."""
        open_ones = [kind for kind in self.kinds if kind.id not in barred]
        self._whiten(open_ones)
        fits = _attempts(self, open_ones)
        self.tried = attempts = tuple(attempt for attempt, _ in fits)
        fitting = [(a, f) for a, f in fits if a.p_value * len(open_ones) < SIGNIFICANCE]
        passing = [(a, f) for a, f in fitting if _predicts(a, self.error)]
        if not passing:
            self.undecided = self._named([f for _, f in fitting[: 1 + _MOST_RIVALS]])
            return None
        if len(self.steps) == MOST_EFFECTS:
            return None
        winner, fitted = preferred([p for p in passing if p[1].is_plausible] or passing)
        self.progress(
            f"{winner.id}: removes {100 * winner.reduction:.0f} % of the prediction error"
        )
        rivals = [f for a, f in fits if a.reduction > 0.0 and a is not winner]
        unfitted = self.recorder.unfinished(SearchStage.EFFECTS, number)
        contenders = [fitted, *rivals[:_MOST_RIVALS]]
        again = self._repeats(winner.id, contenders, number)
        near = _ambiguous(winner, [a for a, _ in passing], {k.id for k in self.kinds})
        return Addition(
            fitted.law.effects[-1],
            winner.p_value,
            winner.reduction,
            tuple(sorted({*near, *again.others, *unfitted})),
            attempts,
            fitted,
            winner.folds,
            again,
        )

    def _whiten(self, kinds: Sequence[Kind]) -> None:
        """Weigh the residuals by what differs from test to test, and fit the law so far by it.

        As they are where an effect accounts for these differences: friction that goes with a load
        of which each test has its own is no scatter.
        """
        before, self.component = self.component, self.measured
        weighed = self.measured.whitened(self.so_far.law)
        if weighed is self.measured:
            return
        without = self.so_far if before is self.measured else self._again()
        tried = attempt_all(partial(_with_one_more, self.measured, without, k) for k in kinds)
        fits = [one for one in tried if isinstance(one, FittedLaw)]
        # It only decides how residuals count: an effect is judged by what it then predicts.
        if all(between_tests_p_value(one, without) >= SIGNIFICANT for one in fits):
            self.component, self.has_whitened = weighed, True
        if self.component is before:
            return
        fitted = self._again() if self.component is weighed else without
        kinds_so_far = [type(effect) for effect in fitted.law.effects]
        folds = cross_validated(self.component, kinds_so_far, self.folds, fitted.law)
        if self.steps:
            self.steps[-1] = replace(self.steps[-1], fitted=fitted, folds=folds)
        else:
            self.base, self.first = fitted, folds

    def _again(self) -> FittedLaw:
        """The law so far, fitted to the residuals as they are weighed now."""
        law = self.so_far.law
        kinds = [type(effect) for effect in law.effects]
        return fit_law(self.component, kinds, range(len(self.component.tests)), law)

    def _named(self, fits: Sequence[FittedLaw]) -> tuple[Repeats, ...]:
        """Which of the effects that fit, but do not predict, parts of the tests still name."""
        found = attempt(lambda: _undecided(self.component, self.so_far, fits))
        if isinstance(found, Failure):
            self.recorder.miss(found, decides=False)
            return ()
        return found

    def _repeats(self, name: str, contenders: Sequence[FittedLaw], number: int) -> Repeats:
        """Whether parts of the tests name the first of these too; nothing where the budget ends."""
        nothing = Repeats(name, ())
        if self.recorder.quick:
            self.recorder.left_out(SearchStage.REPETITION, number)
            return nothing
        self.recorder.enter(SearchStage.REPETITION, number)
        again = attempt(partial(repeats, self.component, self.so_far, contenders))
        if isinstance(again, Failure):
            self.recorder.miss(again, decides=False)
            return nothing
        return again

    def add(self, step: Addition) -> None:
        self.steps.append(step)

    def superfluous(self) -> Addition | None:
        """The step whose effect the tests left out need least, if they hardly need it.

        Where it is not significant given the others, or hardly improves the prediction; none
        given a last one that is larger than is plausible.
        """
        if not self.so_far.is_plausible:
            return None
        least: tuple[float, Addition] | None = None
        for step in self.steps[:-1]:
            kinds = [type(s.effect) for s in self.steps if s is not step]
            without, folds = self._others[step.id] = self._fitted(kinds)
            reduction = 1.0 - float(self.error.mean() / folds.mean())
            needed = self.so_far.p_value(without) * len(self.kinds) < SIGNIFICANCE
            if (not needed or reduction <= _LEAST_KEPT) and (least is None or reduction < least[0]):
                least = reduction, step
        return None if least is None else least[1]

    def remove(self, step: Addition) -> None:
        with limited():
            place = self.steps.index(step)
            kept, later = self.steps[:place], self.steps[place + 1 :]
            for one in later:
                kinds = [type(s.effect) for s in (*kept, one)]
                is_last = one is later[-1]
                fitted, folds = self._others[step.id] if is_last else self._fitted(kinds)
                kept.append(replace(one, effect=fitted.law.effects[-1], fitted=fitted, folds=folds))
            self.steps = kept

    def _fitted(self, kinds: Sequence[Kind]) -> tuple[FittedLaw, FloatArray]:
        """The law with effects of these kinds on all tests, and the error of each fold, (k,)."""
        found = fit_law(self.component, kinds, range(len(self.component.tests)), self.base.law)
        return found, cross_validated(self.component, kinds, self.folds, found.law)


def folds_of(component: Component) -> list[list[int]]:
    """Tests that are left out together: each by itself, or as evenly as the parts allow."""
    count = len(component.tests)
    parts = min(count, component.most_folds)
    return [list(range(k, count, parts)) for k in range(parts)] if parts > 1 else []


def _with_one_more(component: Component, without: FittedLaw, kind: Kind) -> FittedLaw | None:
    """A law with one more effect; None where these tests do not identify it, or rule it out."""
    kinds = [*map(type, without.law.effects), kind]
    try:
        fitted = fit_law(component, kinds, range(len(component.tests)), without.law)
    except NotIdentifiedError:
        return None
    if not np.isfinite(fitted.fit.sum_of_squares) or not component.is_possible(fitted.law):
        return None
    return fitted


def between_tests_p_value(fitted: FittedLaw, without: FittedLaw) -> float:
    """p-value of how much less tests differ from one another with a law than without it.

    By one number of each test, its share of what differs (`Component.own_shares`): the samples of
    a test say nothing of its differences from others. By the spread that is left (F test), or as
    scatter is `MOST_SCATTER` at most, where that says more, as with few tests.
    """
    # Numbers without influence fit nothing.
    acting = [int(np.count_nonzero(np.any(f.fit.jacobian, axis=0))) for f in (without, fitted)]
    more = acting[1] - acting[0]
    before, after = (
        float(np.sum((shares - shares.mean()) ** 2))
        for shares in (f.component.own_shares(f.law) for f in (without, fitted))
    )
    if more < 1 or not before > after:
        return 1.0
    from scipy.special import chdtrc, fdtrc

    found, free = [chdtrc(more, (before - after) / MOST_SCATTER**2)], len(fitted.tests) - 1 - more
    if free > 0:
        found.append(fdtrc(more, free, (before - after) / more * free / max(after, 1e-300)))
    return min(1.0, len(found) * float(min(found)))


def _attempts(rounds: _HeldOutRounds, kinds: Sequence[Kind]) -> list[tuple[Attempt, FittedLaw]]:
    """Every open effect with its fit, the best prediction first; computed in parallel.

    What fails, or what the budget ends before, is noted.
    """
    component, recorder, without = rounds.component, rounds.recorder, rounds.so_far
    chosen = [type(effect) for effect in without.law.effects]
    by_id = {kind.id: kind for kind in kinds}
    tried = attempt_all(
        partial(_attempt, component, [*chosen, kind], without, rounds.folds, rounds.error)
        for kind in kinds
    )
    results = recorder.results(list(by_id), tried)
    recorder.screened += [name for name, _ in results]
    recorder.fitted += [name for name, done in results if done is not None]
    everything = range(len(component.tests))
    found = [
        (done[0], FittedLaw.of(component, [*chosen, by_id[name]], everything, done[1]))
        for name, done in results
        if done is not None
    ]
    # Of two that are equivalent on these tests the catalogue's first counts.
    return sorted(found, key=lambda pair: -round(pair[0].reduction, DIGITS))


def _attempt(
    component: Component,
    kinds: Sequence[Kind],
    without: FittedLaw,
    folds: Sequence[Sequence[int]],
    error: FloatArray,
) -> tuple[Attempt, LeastSquaresFit] | None:
    """One effect together with those before it.

    None if these tests do not identify it, or a part with it could not have given them.
    """
    fitted = _with_one_more(component, without, kinds[-1])
    if fitted is None:
        return None
    p_value = fitted.p_value(without)
    if p_value >= SIGNIFICANCE:
        # An insignificant effect needs no prediction.
        return Attempt(kinds[-1].id, 0.0, p_value, error), fitted.fit
    squares = cross_validated(component, kinds, folds, fitted.law)
    reduction = 1.0 - float(squares.mean() / error.mean())
    return Attempt(kinds[-1].id, reduction, p_value, squares), fitted.fit


def simplest(passing: Sequence[tuple[Attempt, FittedLaw]]) -> tuple[Attempt, FittedLaw]:
    """Of effects that predict, the best first, the one with the fewest numbers that do as well.

    As well: of almost the same reduction, and no worse by the BIC.
    """
    best, fitted = passing[0]
    least = RIVAL_SHARE * best.reduction
    limit = _bic(fitted, fitted)
    equal = [(a, f) for a, f in passing if a.reduction > least and _bic(f, fitted) <= limit]
    return min(equal, key=lambda pair: len(pair[1].fit.values))


def preferred(passing: Sequence[tuple[Attempt, FittedLaw]]) -> tuple[Attempt, FittedLaw]:
    """The `simplest`; one whose shape ends at a limit of its range gives way to the simplest of
    those that explain about as much within theirs.

    Which of them predicts best depends on the tests: a form beyond the limit imitates the others.
    """
    best, fitted = simplest(passing)
    least = RIVAL_SHARE * best.reduction
    within = [(a, f) for a, f in passing if a.reduction > least and not f.limits]
    return simplest(within) if fitted.limits and within else (best, fitted)


def _bic(fitted: FittedLaw, best: FittedLaw) -> float:
    """Schwarz's criterion, with as many samples as the best's correlated residuals are worth."""
    count = max(best.independent_samples, 2.0)
    squares = max(fitted.fit.sum_of_squares, 1e-300)
    return count * math.log(squares) + len(fitted.fit.values) * math.log(count)


def _predicts(attempt: Attempt, error: FloatArray) -> bool:
    better = int(np.count_nonzero(attempt.folds < error))
    return attempt.reduction > LEAST_REDUCTION and 2 * better > len(error)


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
    least = RIVAL_SHARE * winner.reduction
    near |= {a.id for a in passing if a.id != winner.id and a.reduction > least}
    return tuple(sorted(near))


__all__ = ["Addition", "Attempt", "Selection", "folds_of", "preferred", "select", "simplest"]
