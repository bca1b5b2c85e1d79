"""What an actuator's model lacks: the best set of effects, and those that may be there instead.

Balances propose (`finder`): which sets of effects there is evidence for. Where that does not decide
between a set and another, motion does: how well the fitted motion tests are simulated with it.
Those for which motion may speak once its numbers are refined are `rivals`
(`sysid.diagnosis.rivals`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.actuator.equation_error import CHANNELS
from sysid.diagnosis.actuator.finder import Contender, Finder
from sysid.diagnosis.actuator.fitted_set import FittedSet, fit_set, weighed
from sysid.diagnosis.actuator.misfit import weights_of
from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.projection import Projected, channel_squares, projected
from sysid.diagnosis.actuator.refit import (
    Refit,
    own_columns,
    standard_errors,
    with_base_refitted,
)
from sysid.diagnosis.actuator.threshold_steps import with_steps
from sysid.diagnosis.search import Round, Step, Tried
from sysid.diagnosis.search_record import SearchStage
from sysid.errors import Failure, SimulationError
from sysid.estimation.law_evidence import ODDS
from sysid.estimation.linear import Estimate
from sysid.parallel import attempt, limited
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.ports import Model
from sysid.types import FloatArray

# Where the balances' odds are less than this, twice their log, motion decides as well.
_DECIDED = 2.0 * math.log(1e4)
_MOST_JUDGED = 4
# Each takes as long to refine as half a search.
_MOST_RIVALS = 4

Simulated = Callable[[Model], float]
"""Minus twice the log likelihood of the fitted motion tests, simulated with a model."""


@dataclass(frozen=True)
class Suspect(Tried):
    """An effect that a round screened: twice its log `evidence`, and its reduction on `twins`.

    `refitted`: its reduction with its shape fitted; None where it was not fitted.
    """

    evidence: float
    twins: float
    refitted: float | None = None


@dataclass(frozen=True)
class RefittedStep(Step):
    """An effect that was added: its fit together with those before it, which `model` holds too.

    With the base parameters refitted.
    """

    refit: Refit
    model: Model


@dataclass(frozen=True)
class Rival:
    """A set of effects by name for which motion may speak, `behind` the one found by so much of
    twice the log evidence of the balances."""

    names: frozenset[str]
    behind: float


@dataclass(frozen=True)
class Search:
    """The steps, the resulting model, and its residual next to the base model's.

    `joint` holds all effects fitted together, None where there are none; `weights` (channels,) how
    much a square of each balance counted for; `base_std` the standard errors of the base parameters
    with them, in the parameters' units; `rounds` what each round tried; `null` what is expected of
    the last residual. `rivals`: other sets that may be there instead; `behind`: of one of them, as
    its `Rival` has it.
    """

    steps: tuple[RefittedStep, ...]
    model: Model
    first: Projected
    last: Projected
    joint: Refit | None
    weights: FloatArray
    base_std: Mapping[str, float]
    rounds: tuple[Round, ...]
    null: Null
    rivals: tuple[Rival, ...] = ()
    behind: float = 0.0

    @property
    def base_dof(self) -> int:
        """Degrees of freedom of `base_std`: rows less base parameters and effects' numbers."""
        rows, columns = self.last.basis.shape
        return int(rows - columns)

    def estimates(self, place: int) -> dict[str, Estimate]:
        """An effect's numbers by name, with intervals from leaving out one test at a time.

        Without those that show nothing, as gravity on a level rig, and shapes held as `plain`.
        """
        assert self.joint is not None
        fit = self.joint.fit
        effect = self.joint.effects[place]
        covariance = fit.jackknife_covariance(self.first.frame.tests)
        plain = self.plain(place)
        found = {
            q.name: fit.estimate(f"{effect.id}/{q.name}", covariance).within(q.lower, q.upper)
            for q, shows in self._numbers(place)
            if q.is_threshold or (shows and q not in plain)
        }
        base = weighed(self.first, self.weights)
        for q in (q for q in type(effect).strengths() if q.is_threshold):
            found[q.name] = with_steps(found[q.name], q, base, self.model, self.joint, place)
        return found

    def plain(self, place: int) -> tuple[Quantity, ...]:
        """The shapes of an effect that the balances show to be of its plain form: held there."""
        assert self.joint is not None
        fitted = {p.name for p in self.joint.fit.parameters if p.lower < p.upper}
        own = self.joint.effects[place].id
        numbers = self._numbers(place)
        return tuple(q for q, shows in numbers if shows and f"{own}/{q.name}" not in fitted)

    def _numbers(self, place: int) -> list[tuple[Quantity, bool]]:
        """An effect's numbers, save for choices, and whether the balances show them."""
        assert self.joint is not None
        effect, fit = self.joint.effects[place], self.joint.fit
        slopes = zip(fit.parameters, fit.jacobian.T, strict=True)
        shown = {p.name for p, slope in slopes if slope.any()}
        own = (q for q in type(effect).quantities if not q.is_choice)
        return [(q, f"{effect.id}/{q.name}" in shown) for q in own]

    def gains(self, effects: Sequence[CatalogueEffect]) -> FloatArray:
        """By how much each of some effects, with its numbers, lowers the balances' squares next to
        the others, (k,), each balance as it counted; negative where they are smaller without it."""

        def left(some: Sequence[CatalogueEffect]) -> float:
            given = self.first.model
            base = projected(self.first.frame, Model(given.parameters, (*given.effects, *some)))
            return float(self.weights @ channel_squares(base, base.rest))

        whole = left(effects)
        others = ([*effects[:i], *effects[i + 1 :]] for i in range(len(effects)))
        return np.array([left(some) - whole for some in others])


def search(finder: Finder, simulated: Simulated, shown: frozenset[str] = frozenset()) -> Search:
    """The set of effects with most evidence, of balances and of motion where they do not decide.

    `shown`: effects that motion spoke for before, next to others: they are a rival.
    What fails, or what the budget ends before, the finder's recorder notes; the result is then the
    best so far.
    """
    names, recorder = finder.run(), finder.recorder
    recorder.enter(SearchStage.RIVALS)
    names, doubtful = _judged(finder, names, simulated, shown)
    with limited():
        found = _result(finder, names)
    if recorder.quick:
        return found
    # Of two laws in one place the balances, whose own bias either may explain, say no more.
    behind = [min(finder.evidence(names) - finder.evidence(n), _DECIDED) for n in doubtful]
    return replace(found, rivals=tuple(map(Rival, doubtful, behind)))


def search_of(finder: Finder, rival: Rival) -> Search:
    """The search that ends with a rival's effects. Raises OutOfBudgetError."""
    return replace(_result(finder, rival.names), behind=rival.behind)


def _judged(
    finder: Finder, best: frozenset[str], simulated: Simulated, shown: frozenset[str]
) -> tuple[frozenset[str], list[frozenset[str]]]:
    """The set with most evidence of balances and motion together, and those that motion with
    refined numbers is to judge.

    Motion decides between sets for which there is evidence; until its numbers are refined it adds
    no effect, as numbers that are a little off move it more than most effects do.
    """
    none: frozenset[str] = frozenset()
    for_it = [n for n in finder.sets if finder.evidence(n) > 0.0 and len(n) <= len(best)]
    ranked = sorted([none, *for_it], key=lambda names: -finder.evidence(names))
    near = [n for n in ranked if finder.evidence(best) - finder.evidence(n) < _DECIDED]
    near = near[:_MOST_JUDGED]
    if len(near) < 2:
        return best, _rivals(finder, best, [], shown)
    evidence = {names: finder.evidence(names) for names in near}
    for names in near:
        own = attempt(lambda: _simulated(finder, names, simulated))  # noqa: B023
        if isinstance(own, Failure):
            finder.recorder.miss(own, decides=False)
            return best, []
        evidence[names] -= own
    winner = max(near, key=lambda names: evidence[names])
    if winner != best:
        better, worse = (" and ".join(sorted(n)) or "no effect" for n in (winner, best))
        finder.progress(f"{better} rather than {worse}: motion is simulated better")
    doubtful = [n for n in near if n not in (winner, none)]
    doubtful = [n for n in doubtful if evidence[winner] - evidence[n] < _DECIDED]
    doubtful.sort(key=lambda names: -evidence[names])
    return winner, _rivals(finder, winner, doubtful, shown)


def _rivals(
    finder: Finder, names: frozenset[str], doubtful: Sequence[frozenset[str]], shown: frozenset[str]
) -> list[frozenset[str]]:
    """The sets that motion with refined numbers is to judge against some effects, in turn.

    What motion spoke for before; the likeliest of the `doubtful` ones; that with a rival in the
    place of one effect; and those with one more that the balances do not rule out.
    """
    if not names:
        return []
    rivals = {effect.id: type(effect).rivals for effect in finder.sets[names].effects}
    swapped, longer = list[frozenset[str]](), list[frozenset[str]]()
    for some in finder.sets:
        gone, new = sorted(names - some), sorted(some - names)
        if len(new) != 1 or finder.evidence(some) <= 0.0:
            continue
        if len(gone) == 1 and new[0] in rivals[gone[0]]:
            swapped.append(some)
        if not gone and finder.evidence(names) - finder.evidence(some) < _DECIDED:
            longer.append(some)
    swapped.sort(key=finder.evidence, reverse=True)
    longer.sort(key=finder.evidence, reverse=True)
    known = [shown] if shown in finder.sets else []
    found = dict.fromkeys([*known, *doubtful[:1], *swapped[:1], *longer])
    return [one for one in found if one != names][:_MOST_RIVALS]


def _simulated(finder: Finder, names: frozenset[str], simulated: Simulated) -> float:
    """Minus twice the log likelihood of motion with a set; infinite where it cannot be simulated.

    Raises OutOfBudgetError.
    """
    try:
        return simulated(_with_base(finder, names))
    except SimulationError:
        return math.inf


def _with_base(finder: Finder, names: frozenset[str]) -> Model:
    """The model with a set's effects, its base parameters refitted."""
    return with_base_refitted(finder.first, finder.model(names)) if names else finder.first.model


def _result(finder: Finder, names: frozenset[str]) -> Search:
    """The search that ends with a set: its effects in turn, what explains most first."""
    first, null = finder.first, finder.expected.alone()
    ones = np.ones(len(CHANNELS))
    if not names:
        rounds = tuple(Round(_tried(finder, i)) for i in range(len(finder.rounds))) or (Round(()),)
        return Search((), first.model, first, first, None, ones, {}, rounds, null)
    found = finder.sets[names]
    model = _with_base(finder, names)
    own = own_columns(first.frame, model)
    last = projected(first.frame, model, extra=own)
    steps = _steps(finder, found, model)
    rounds = (*(Round(step.tried, step) for step in steps), Round(_tried(finder, -1)))
    # The steps' order is the joint fit's.
    order = [step.id for step in steps]
    joint = found.refit
    if [e.id for e in joint.effects] != order:
        by_name = {e.id: e for e in joint.effects}
        again = fit_set(first, finder.channels, [by_name[n] for n in order], found.squares)
        joint = again.refit
        model = Model(model.parameters, (*first.model.effects, *joint.effects))
        steps = (*steps[:-1], replace(steps[-1], refit=joint, model=model))
    return Search(
        steps,
        model,
        first,
        last,
        joint,
        weights_of(finder.channels, found.squares),
        standard_errors(last, own),
        rounds,
        null,
    )


def _steps(finder: Finder, found: FittedSet, model: Model) -> tuple[RefittedStep, ...]:
    """The effects of a set one after another: each the one that has most evidence given those
    before it."""
    steps: list[RefittedStep] = []
    before: frozenset[str] = frozenset()
    by_name = {effect.id: effect for effect in found.effects}
    while len(steps) < len(by_name):
        left = sorted(found.names - before)
        fitted = {name: _fitted_with(finder, before | {name}, by_name, found) for name in left}
        name = max(left, key=lambda n: fitted[n].evidence(finder.channels, finder.none))
        own = fitted[name]
        before = before | {name}
        is_last = len(before) == len(by_name)
        others = [e for e in own.effects if e.id != name]
        effect = next(e for e in own.effects if e.id == name)
        own_model = model
        if not is_last:
            given = finder.first.model
            own_model = Model(given.parameters, (*given.effects, *others, effect))
            own_model = with_base_refitted(finder.first, own_model)
        place = finder.round_of(before)
        steps.append(
            RefittedStep(
                effect,
                finder.p_value(before, name),
                _share(finder, own, before - {name}),
                finder.ambiguous(found.names, name, ODDS),
                _tried(finder, place),
                own.refit,
                own_model,
            )
        )
    return tuple(steps)


def _fitted_with(
    finder: Finder, names: frozenset[str], by_name: Mapping[str, object], whole: FittedSet
) -> FittedSet:
    known = finder.sets.get(names)
    if known is None:
        starts = [e for e in whole.effects if e.id in names]
        known = fit_set(finder.first, finder.channels, starts, whole.squares)
        finder.sets[names] = known
    return known


def _share(finder: Finder, after: FittedSet, before: frozenset[str]) -> float:
    """What an effect explained of the squares beyond noise, in the balances that it changed."""
    was = finder.squares(before)
    excess = np.array([float(c.excess(s)) for c, s in zip(finder.channels, was, strict=True)])
    left = np.array(
        [float(c.excess(s)) for c, s in zip(finder.channels, after.squares, strict=True)]
    )
    gone = np.maximum(excess - left, 0.0)
    changed = gone > 0.0
    whole = float(np.sum(np.maximum(excess, gone)[changed]))
    return float(np.sum(gone)) / whole if whole > 0.0 else 0.0


def _tried(finder: Finder, place: int) -> tuple[Suspect, ...]:
    """What a round screened, the most evidence first."""
    if not finder.rounds:
        return ()
    round_ = finder.rounds[place]
    return tuple(
        Suspect(
            one.id,
            one.reduction,
            finder.by_chance(one.reduction, one.twins, one.id),
            one.evidence,
            one.twins,
            finder.reduction_by(round_.before, one.id),
        )
        for one in round_.contenders
    )


__all__ = [
    "Contender",
    "RefittedStep",
    "Rival",
    "Search",
    "Simulated",
    "Suspect",
    "search",
    "search_of",
]
