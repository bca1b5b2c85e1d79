"""Sets of effects by evidence: all forms as one linear problem, the best sets fitted, and again.

What is linear proposes: every form of every effect, alone, in pairs and in threes. The sets that
are worth it are fitted with their shapes, channel by channel as much as it can be trusted. Given
the best of them everything is proposed again, against what they leave.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.special import chdtrc

from sysid.diagnosis.actuator.columns import Columns, Proposal
from sysid.diagnosis.actuator.equation_error import CHANNELS, EFFORT, forget
from sysid.diagnosis.actuator.fitted_set import FittedSet, fall_on_twin, fit_set
from sysid.diagnosis.actuator.logged_supply import LoggedSupply, acts_on_supply
from sysid.diagnosis.actuator.misfit import ResidualChannel, cost, rise, weights_of
from sysid.diagnosis.actuator.null_distribution import MARGIN, Null
from sysid.diagnosis.actuator.oscillation import steady_oscillation
from sysid.diagnosis.actuator.projection import (
    Projected,
    channel_squares,
    friction_scatter_of,
    projected,
)
from sysid.diagnosis.actuator.refit import own_columns
from sysid.diagnosis.actuator.screened import Bias, Screening, Signed, noise_channels, screened
from sysid.diagnosis.actuator.sets import best_sets, names_of
from sysid.diagnosis.actuator.signatures import Candidate
from sysid.diagnosis.search import MOST_EFFECTS
from sysid.diagnosis.search_record import Recorder, SearchStage
from sysid.errors import Failure
from sysid.estimation.multiple_tests import LEAST_P
from sysid.io.channels import SIDES
from sysid.parallel import attempt, attempt_in_threads, limited
from sysid.plant.effects.catalogue import catalogue, class_of
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.types import FloatArray, Progress

# Sets of each size that are fitted a round.
_FITTED = 3
# Twins on which sets are fitted.
_FITTED_TWINS = 2
_MOST_ROUNDS = 5
# Friction is weighed anew where it scatters by more than this, and with the effects by less than
# this part of that.
_MUCH_SCATTER, _FAR_LESS = 0.02, 0.5


@dataclass(frozen=True)
class Contender:
    """An effect that a round screened: its evidence given the effects before, alone.

    `reduction`: twice the fall of the log likelihood; `twins`: the same where nothing is missing.
    """

    id: str
    evidence: float
    reduction: float
    twins: float


@dataclass(frozen=True)
class FinderRound:
    """What a round screened given the set `before`, and the set that was `best` after it."""

    contenders: tuple[Contender, ...]
    before: frozenset[str]
    best: frozenset[str]


@dataclass(frozen=True)
class _Proposed:
    """A form that was proposed, with the columns that it was proposed from, and their `bias`: what
    twins show of the model that it was to be added to."""

    some: Screening
    form: int
    bias: Bias


@dataclass
class Finder:
    """The search on one residual: `sets` fitted so far by their effects, `rounds` in turn.

    `supply`: the log of the supply, where there is one. `expected`: what twins of the model with
    the best set leave; `none` (channels,) the squares without effects, `channels` their noise as
    the twins show it.
    """

    first: Projected
    forms: Sequence[Candidate]
    null: Null
    recorder: Recorder
    progress: Progress
    supply: LoggedSupply | None = None
    sets: dict[frozenset[str], FittedSet] = field(default_factory=dict)
    rounds: list[FinderRound] = field(default_factory=list)
    barred: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        self.expected = self.null
        self.bias = Bias(self.null.twins)
        # Of each effect, by the set that it was proposed to be added to, its form.
        self._proposed: dict[str, dict[frozenset[str], _Proposed]] = {}
        # Of each effect the signatures without another one.
        self._signed: dict[str, Signed] = {}
        # Given each set, what was screened.
        self._screened: dict[frozenset[str], Screening] = {}
        # What sets gain, fitted, on twins of the model without them.
        self._on_twins: dict[frozenset[str], FloatArray] = {}
        self._most = 1 if self.recorder.quick else MOST_EFFECTS
        # In how many directions the forms show in each channel: known once they are screened.
        self._directions = np.full(len(CHANNELS), math.inf)
        self._take(self.first)

    def bar(
        self, names: Collection[str], recorder: Recorder, found: frozenset[str] = frozenset()
    ) -> None:
        """Go on without these effects, with what is known of the others: those `found` next to
        them are fitted."""
        self.barred |= frozenset(names)
        self._fit_without(found, found - self.barred)
        self.sets = {own: s for own, s in self.sets.items() if not own & self.barred}
        self._screened = {own: s for own, s in self._screened.items() if not own & self.barred}
        recorder.screened += [name for name in self.recorder.screened if name not in self.barred]
        recorder.fitted += [name for name in self.recorder.fitted if name not in self.barred]
        self.recorder, self.rounds, self.expected = recorder, [], self.null
        self.channels = self._channels_of(self.first)

    def _take(self, first: Projected) -> None:
        """A residual without effects, and its noise."""
        self.first, self.sets, self._screened, self._on_twins = first, {}, {}, {}
        self.none = channel_squares(first, first.rest)
        self.channels = self._channels_of(first)

    def _channels_of(self, base: Projected) -> tuple[ResidualChannel, ...]:
        return noise_channels(base, self.expected, self.none, self._directions)

    def evidence(self, names: frozenset[str]) -> float:
        """Twice the log evidence of a fitted set over that of no effect; -inf if not fitted.

        Less what twins gain by its effects, what the best of so many gain by chance, and what they
        gain in few tests. What a smaller set owes to few tests this one owes too, but for as much
        as its further effects gain: so much of that scatter they may explain.
        """
        if not names:
            return 0.0
        if names not in self.sets:
            return -math.inf
        gained = self._gained(names)
        owed = self.sets[names].of_few_tests(self.channels)
        for fewer in [some for some in self.sets if some < names]:
            more = max(gained - self._gained(fewer), 0.0)
            owed = max(owed, self.sets[fewer].of_few_tests(self.channels) - more)
        return gained - owed

    def _gained(self, names: frozenset[str]) -> float:
        """A fitted set's evidence, whatever it owes to few tests."""
        found = self.sets[names]
        alone = found.gained(self.channels, self.none) - self._by_chance(names, found)
        return alone + self._gain_in_supply(found.effects)

    def _gain_in_supply(self, effects: Sequence[CatalogueEffect]) -> float:
        """By how much effects lower minus twice the log likelihood of the supply's log."""
        return 0.0 if self.supply is None else self.supply.gain(effects)

    def _by_chance(self, names: Collection[str], found: FittedSet) -> float:
        """What effects may gain where nothing is missing, and the best of so many by chance.

        Those that were proposed together gain together: one may make up for the other's bias.
        """
        weights = weights_of(self.channels, found.squares)
        tried, together = 0.0, list[tuple[_Proposed, list[int]]]()
        for one in (self._proposal_of(name, frozenset(names)) for name in names):
            tried += float(one.some.columns.tried[one.form])
            forms = next((own for of, own in together if of.some is one.some), None)
            if forms is None:
                together.append((one, [one.form]))
            else:
                forms.append(one.form)
        gained = np.zeros(len(weights))
        for one, forms in together:
            gained += one.bias.gained(one.some, forms, weights)
        known = self._on_twins.get(frozenset(names), gained)
        more = max(gained, known, key=lambda squares: float(weights @ squares))
        return tried + rise(self.channels, found.squares, more)

    def _proposal_of(self, name: str, names: frozenset[str]) -> _Proposed:
        """How an effect of a set was proposed: to be added to as many of the others as it was."""
        known = self._proposed[name]
        fitting = [given for given in known if given <= names - {name}]
        return known[max(fitting or known, key=len)]

    def best(self) -> frozenset[str]:
        """The effects of the set with most evidence."""
        return max([frozenset[str](), *self.sets], key=self.evidence)

    def run(self) -> frozenset[str]:
        """Screen, propose and fit until no set is better; the best set's effects."""
        best: frozenset[str] = frozenset()
        if not self.null.is_of_twins:  # nothing says what is noise
            return best
        for number in range(1, _MOST_ROUNDS + 1):
            self.recorder.enter(SearchStage.SCREENING, number)
            with limited() if number == 1 else nullcontext():
                tried = attempt(lambda: self._proposals(best, number))  # noqa: B023
                if isinstance(tried, Failure):
                    self.recorder.miss(tried)
                    return best
                self._on_both_sides(self.best())
                self._exchanged(self.best())
                self._without_superfluous(self.best())
                better = self._beyond_twins()
            self.rounds.append(FinderRound(tried, best, better))
            if better == best or self.recorder.quick:
                return better
            best = better
            self._narrow(best)
            if len(best) == self._most:
                return best
        return best

    def p_value(self, names: frozenset[str], name: str) -> float:
        """Probability that any form gains as much as this effect of a set where it is missing."""
        one, squares = self._proposal_of(name, names), self.squares(names)
        gained = one.bias.gained(one.some, (one.form,), weights_of(self.channels, squares))
        twins = rise(self.channels, squares, gained)
        return self.by_chance(self._fall(names - {name}, names), twins, name)

    def by_chance(self, reduction: float, twins: float, name: str) -> float:
        """Probability that any form gains as much by noise, beyond what twins gain: Bonferroni."""
        strengths = next(len(f.steps) for f in self.forms if f.id == name)
        beyond = max(reduction - twins, 0.0)
        return min(1.0, max(len(self.forms) * float(chdtrc(strengths, beyond)), LEAST_P))

    def ambiguous(self, names: frozenset[str], name: str, doubt: float) -> tuple[str, ...]:
        """Effects that may be there in the place of one of a set: of its class, with as much
        evidence, to within `doubt`, or such as could not be fitted."""
        others, least = names - {name}, self.evidence(names) - doubt
        rivals = {
            next(iter(some - others))
            for some in self.sets
            if some != names and others < some and len(some) == len(names)
            if self.evidence(some) > least
        }
        unfitted = {m.subject for m in self.recorder.missed if m.stage is SearchStage.SUSPECTS}
        alike = set(class_of(name)) - self._told_apart(names, name, doubt)
        return tuple(sorted((rivals | unfitted | alike) - {*names, ""}))

    def _told_apart(self, names: frozenset[str], name: str, doubt: float) -> set[str]:
        """The effects of its class that the supply's log tells from one of a set: those that leave
        the supply alone, where the log shows what this one does to it."""
        if names not in self.sets:
            return set()
        effects = self.sets[names].effects
        others = [effect for effect in effects if effect.id != name]
        if self._gain_in_supply(effects) - self._gain_in_supply(others) <= doubt:
            return set()
        known = catalogue()
        return {n for n in class_of(name) if n in known and not acts_on_supply(known[n])}

    def round_of(self, names: frozenset[str]) -> int:
        """The number, from 0, of the round that first fitted a set of these effects."""
        for place, one in enumerate(self.rounds):
            if names <= one.best:
                return place
        return len(self.rounds) - 1

    def reduction_by(self, before: frozenset[str], name: str) -> float | None:
        """By how much an effect lowers minus twice the log likelihood; None if not fitted."""
        after = before | {name}
        return self._fall(before, after) if after in self.sets else None

    def squares(self, names: frozenset[str]) -> FloatArray:
        """What a fitted set leaves, (channels,); of a set that is not, what is left without any."""
        return self.sets[names].squares if names in self.sets else self.none

    def _fall(self, before: frozenset[str], after: frozenset[str]) -> float:
        """By how much minus twice the log likelihood falls from one set to another."""
        return float(
            cost(self.channels, self.squares(before)) - cost(self.channels, self.squares(after))
        )

    def model(self, names: frozenset[str]) -> Model:
        """The model with a set's effects."""
        given = self.first.model
        effects = self.sets[names].effects if names else ()
        return Model(given.parameters, (*given.effects, *effects))

    def _residual_given(self, names: frozenset[str]) -> Projected:
        """The residual that a set leaves, its numbers projected out. Raises OutOfBudgetError."""
        forget()
        if not names:
            return self.first
        model = self.model(names)
        base = projected(self.first.frame, model, own_columns(self.first.frame, model))
        if self.recorder.quick:
            return base
        null = attempt(lambda: self.null.given(base))
        if isinstance(null, Failure):
            self.recorder.miss(null, decides=False)
        else:
            self.expected = null
            self.channels = self._channels_of(base)
        return base

    def _narrow(self, names: frozenset[str]) -> None:
        """Weigh friction by the scatter that the effects leave, where it is far less than before.

        What an effect does may look like scatter of friction from test to test: as if the friction
        of each test were hardly known, which hides the next effect.
        """
        frame = self.first.frame
        if not names or self.recorder.quick or frame.scatter < _MUCH_SCATTER:
            return
        with limited():
            left = friction_scatter_of(frame, self.model(names))
            if left > _FAR_LESS * frame.scatter:
                return
            self.progress(f"friction scatters by {100 * left:.1f} % with the effects")
            # What is in doubt stays so.
            others = sorted(self.sets.keys() - {names}, key=self.evidence, reverse=True)
            kept = {own: self.sets[own] for own in (names, *others[:_FITTED])}
            self._take(projected(replace(frame, scatter=left), self.first.model))
            for own, found in kept.items():
                again = fit_set(self.first, self.channels, found.effects, found.squares)
                self.sets[own] = again

    def _proposals(self, names: frozenset[str], number: int) -> tuple[Contender, ...]:
        """Fit the sets that are worth it given a set's effects; what was screened.

        Raises OutOfBudgetError.
        """
        base = self._residual_given(names)
        some = self._screened.get(names)
        if some is None:
            states = {state for e in base.model.effects for state in e.states}
            gone = self.barred | names
            forms = [
                f for f in self.forms if f.id not in gone and not states & set(f.neutral().states)
            ]
            if not forms:
                return ()
            some = screened(base, forms, self.channels, self.recorder, self._signed)
            if not names:
                self._directions = some.columns.directions()
                self.channels = self._channels_of(base)
        if not some.forms:
            return ()
        some = self._screened[names] = some.without(self.barred).among(self.channels)
        # Two that hide each other do so without any other.
        bias = self.bias if self.expected is self.null else Bias(self.expected.twins)
        some, by_size = self._counted(some, bias, 1 if names else self._most)
        self.recorder.enter(SearchStage.SUSPECTS, number)
        self._fit(self.sets.get(names), some, bias, _worth_fitting(some.columns, by_size))
        if bias is not self.bias:
            bias.without_twins()
        self._without_hum(base, names)
        alone = by_size[0] if by_size else []
        return tuple(self._contender(some, p) for p in alone)

    def _without_hum(self, base: Projected, names: frozenset[str]) -> None:
        """Drop sets with an effect whose place an oscillation takes that goes on whatever the
        motion does."""
        before = self.squares(names)
        effort = CHANNELS.index(EFFORT)
        channel = self.channels[effort]
        for other in [own for own in self.sets if names < own and len(own) == len(names) + 1]:
            (name,) = other - names
            found = self.sets[other]
            fall = float(channel.cost(before[effort]) - channel.cost(found.squares[effort]))
            effect = next(e for e in found.effects if e.id == name)
            hum = steady_oscillation(base, channel, effect, fall)
            if hum is None:
                continue
            self.recorder.note(
                f"not {name}: in the torque balance an oscillation of {hum.frequency:.1f} Hz "
                "goes on whatever the motion does, as hum of the mains does; log a rest with the "
                "amplifier on"
            )
            self.sets = {own: s for own, s in self.sets.items() if name not in own}

    def _counted(
        self, some: Screening, bias: Bias, most: int
    ) -> tuple[Screening, list[list[Proposal]]]:
        """The best sets, with what all effects in them gain where nothing is missing counted."""
        while True:
            some = bias.counted(some)
            by_size = best_sets(some.columns, most)
            proposed = {
                name
                for ranked in by_size
                for p in ranked[:_FITTED]
                if p.evidence > 0.0
                for name in names_of(some.columns, p)
            }
            unknown = proposed - set(bias.known)
            bias.ask(unknown, self.forms, self.recorder)
            if not unknown & set(bias.known):
                return some, by_size

    def _fit(
        self,
        before: FittedSet | None,
        some: Screening,
        bias: Bias,
        proposals: Sequence[Proposal],
    ) -> None:
        """Fit proposed sets, each together with the effects before it. Raises OutOfBudgetError."""
        given, base = (before.effects, before.names) if before is not None else ((), frozenset())
        found: dict[frozenset[str], tuple[CatalogueEffect, ...]] = {}
        jobs = []
        for proposal in proposals:
            starts = tuple(some.effects(proposal))
            names = base | {e.id for e in starts}
            for f in proposal.forms:
                known = self._proposed.setdefault(some.forms[f].id, {})
                known.setdefault(base, _Proposed(some, f, bias))
            if names in self.sets or names in found:
                continue
            found[names] = starts
            effects = (*given, *starts)
            jobs.append(partial(fit_set, self.first, self.channels, effects, proposal.squares))
        for (names, starts), own in zip(found.items(), attempt_in_threads(jobs), strict=True):
            if isinstance(own, Failure):
                self.recorder.miss(own, *(e.id for e in starts))
                continue
            self.sets[names] = own
            self.recorder.fitted += [e.id for e in starts]
            self.progress(f"{' and '.join(sorted(names))}: {self.evidence(names):.0f}")

    def _on_both_sides(self, names: frozenset[str]) -> None:
        """Fit a set with its effects of one side on both, where the other's balance holds a misfit.

        A form of both sides that is far off explains less than one of either.
        """
        found = self.sets.get(names)
        if found is None:
            return
        excess = [float(c.excess(s)) for c, s in zip(self.channels, found.squares, strict=True)]
        left = {side for side in SIDES if excess[CHANNELS.index(f"rate_{side}")] > 0.0}
        for place, effect in enumerate(found.effects):
            side = getattr(effect, "side", "both")
            if side == "both" or not left - {side}:
                continue
            both = replace(effect, side="both")  # type: ignore[type-var]
            starts = [*found.effects[:place], both, *found.effects[place + 1 :]]
            own = attempt(lambda: fit_set(self.first, self.channels, starts, found.squares))  # noqa: B023
            if isinstance(own, Failure):
                self.recorder.miss(own, effect.id, decides=False)
                continue
            before = self.evidence(names)
            self.sets[names] = own
            if self.evidence(names) < before:
                self.sets[names] = found

    def _exchanged(self, names: frozenset[str]) -> None:
        """Fit a set with each of its effects exchanged for those that do better in its place in
        every other set; and the best of these again.

        What is proposed together is screened at the shapes of a grid, where one effect may hide the
        right form of the next and leave its place to a relative.
        """
        while len(names) > 1:
            for gone in [effect.id for effect in self.sets[names].effects]:
                for name in sorted(self._instead_of(gone) - names):
                    self._exchange(names, gone, name)
            if self.best() == names:
                return
            names = self.best()

    def _exchange(self, names: frozenset[str], gone: str, name: str) -> None:
        """Fit a set with one effect in the place of another, if it was not."""
        exchanged = names - {gone} | {name}
        if exchanged in self.sets:
            return
        found, alone = self.sets[names], self.sets[frozenset({name})]
        starts = [*(e for e in found.effects if e.id != gone), *alone.effects]
        squares = np.minimum(found.squares, alone.squares)
        own = attempt(lambda: fit_set(self.first, self.channels, starts, squares))
        if isinstance(own, Failure):
            self.recorder.miss(own, name, decides=False)
            return
        self.sets[exchanged] = own
        self.progress(f"{' and '.join(sorted(exchanged))}: {self.evidence(exchanged):.0f}")

    def _instead_of(self, name: str) -> set[str]:
        """Effects that do better than one alone, and in each set that was fitted with either."""
        better = set[str]()
        for (other,) in [own for own in self.sets if len(own) == 1 and name not in own]:
            pairs = [
                (own, own - {name} | {other})
                for own in self.sets
                if name in own and other not in own and own - {name} | {other} in self.sets
            ]
            if pairs and all(self.evidence(two) > self.evidence(one) for one, two in pairs):
                better.add(other)
        return better

    def _without_superfluous(self, names: frozenset[str]) -> None:
        """Fit a set without each of its effects in turn.

        Again, where those that are left have better numbers in the set than on their own: a fit
        that starts far off may end in another minimum, from which a further effect leads out.
        """
        if len(names) < 2:
            return
        for effect in self.sets[names].effects:
            self._fit_without(names, names - {effect.id})

    def _fit_without(self, names: frozenset[str], fewer: frozenset[str]) -> None:
        """Fit fewer effects of a fitted set, from the numbers that they have in it, if those are
        better than what is known of them."""
        found = self.sets.get(names)
        if found is None or not frozenset() < fewer < names:
            return
        others = [e for e in found.effects if e.id in fewer]
        known = self.sets.get(fewer)
        if known is not None and self._cost_of(others) >= cost(self.channels, known.squares):
            return
        own = attempt(lambda: fit_set(self.first, self.channels, others, found.squares))
        if not isinstance(own, Failure):
            self.sets[fewer] = own

    def _cost_of(self, effects: Sequence[CatalogueEffect]) -> float:
        """Minus twice the log likelihood that effects leave with the numbers that they have."""
        given = self.first.model
        base = projected(self.first.frame, Model(given.parameters, (*given.effects, *effects)))
        return float(cost(self.channels, channel_squares(base, base.rest)))

    def _beyond_twins(self) -> frozenset[str]:
        """The best set, by what it gains beyond the same fit on twins."""
        while True:
            best = self.best()
            if not best or best in self._on_twins or self.recorder.quick:
                return best
            self._on_twins[best] = self._gain_on_twins(self.sets[best])
            self.progress(f"{' and '.join(sorted(best))}: {self.evidence(best):.0f} beyond twins")

    def _gain_on_twins(self, found: FittedSet) -> FloatArray:
        """What a set explains, fitted from its numbers, where nothing is missing: as `Bias.gained`.

        A shape may follow the noise of an encoder, which shows only once it is fitted; what is
        linear gains as much as it was screened to. 0 where it cannot be fitted.
        """
        none = np.zeros(len(self.channels))
        if not any(q for e in found.effects for q in type(e).shapes() if not q.is_choice):
            return none
        weights, twins = weights_of(self.channels, found.squares), self.null.twins[:_FITTED_TWINS]
        falls = []
        for fall in attempt_in_threads(
            partial(fall_on_twin, twin, weights, found.effects) for twin in twins
        ):
            if isinstance(fall, Failure):
                self.recorder.miss(fall, *found.names, decides=False)
            else:
                falls.append(fall)
        return np.asarray(MARGIN**2 * np.mean(falls, axis=0)) if falls else none

    def _contender(self, some: Screening, one: Proposal) -> Contender:
        (form,), columns = one.forms, some.columns
        before, after = (cost(columns.channels, c) for c in (columns.squares, one.squares))
        fall, chance = float(before - after), float(columns.chance[form])
        return Contender(some.forms[form].id, one.evidence, fall, chance)


def _worth_fitting(columns: Columns, by_size: Sequence[Sequence[Proposal]]) -> list[Proposal]:
    """Of each size the best sets for which there is more evidence than for smaller ones.

    And the effect that gains most, in all and in each channel whose misfit counts by its logarithm:
    a shape between two that were screened may gain more. What a wave between two frequencies
    explains of such a misfit is outvoted by a little in a channel that is noise.
    """
    if not (by_size and by_size[0]):
        return []
    alone = by_size[0]
    found = [min(alone, key=lambda p: float(cost(columns.channels, p.squares)))]
    for c, channel in enumerate(columns.channels):
        if float(channel.excess(columns.squares[c])) > channel.draws:
            found.append(alone[int(np.argmin([p.squares[c] for p in alone]))])
    least = 0.0
    for ranked in by_size:
        found += [p for p in ranked[:_FITTED] if p.evidence > least]
        least = max([least, *(p.evidence for p in ranked[:1])])
    return found


__all__ = ["Contender", "Finder", "FinderRound"]
