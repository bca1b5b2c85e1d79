"""A round on twins: screen every effect, refit the suspects, add the best."""

from __future__ import annotations

import contextlib
import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.diagnosis.actuator.comparison import (
    RIVAL_SHARE,
    excess_in,
    explained_channels,
    indistinguishable,
    penalty,
    relative_size,
    share_of_excess,
)
from sysid.diagnosis.actuator.equation_error import BREAKAWAY, channels_of, forget
from sysid.diagnosis.actuator.known import Known
from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.oscillation import steady_oscillation
from sysid.diagnosis.actuator.refit import (
    Refit,
    has_threshold,
    own_columns,
    refit,
    standard_errors,
    with_base_refitted,
)
from sysid.diagnosis.actuator.screening import (
    Explained,
    Projected,
    best_by_effect,
    projected,
    scatter_beside,
    screen,
    screen_group,
    starting_points,
)
from sysid.diagnosis.actuator.signatures import Candidate, finer
from sysid.diagnosis.actuator.suspects import Suspect, suspects_of, worth_refitting
from sysid.diagnosis.actuator.threshold_steps import best_near, with_steps
from sysid.diagnosis.actuator.whitening import Frame
from sysid.diagnosis.looked import Book, SearchStage
from sysid.diagnosis.search import MOST_EFFECTS, Round, Rounds, Step, run
from sysid.errors import Failure, SimulationError
from sysid.estimation.linear import Estimate
from sysid.parallel import LATE, attempt, attempt_in_threads, limited
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, overrides
from sysid.types import Progress

# By how much an effect in them may gain more than they exceed the twins.
_MOST_OF_EXCESS = 2.0
# A strength that the tests agree on differs from 0 by this many squared standard errors; of a
# threshold that is the squared z of a sign test (`Refit.wald`).
_CLEAR_WALD = 16.0
# One that explains nearly all of the remainder may show in few tests: a drift in the longest.
_MAIN_SHARE = 0.75
_MAIN_WALD = 4.0
# Share of the remainder beyond noise that an effect must explain to be added.
LEAST_SHARE = 0.35
# A remainder that is small against the effects so far is a misfit of their form, unless a new
# effect explains all of it, or simulates far better, and it is not smaller still.
_LEAST_PART = 0.05
_WHOLE_SHARE = 0.8
_LEAST_WHOLE = 0.004
# A strength below this share of its usual size is beside others a misfit of their forms; alone it
# has to simulate better.
LEAST_SIZE = 0.05
# An effect does not act on a row that it changes by less than this, in its noise.
_NOT_ACTING = 1.0
# An effect whose size changes by this factor when the next is added was not what it seemed.
_MOST_CHANGE = 2.5
# By how much the logarithm of the simulation error may rise with a further effect; by as much it
# has to fall with one that shows only where the others do not act.
_TOLERATED_RISE = 0.01
# By how much it falls with an effect on which the tests do not agree.
_BETTER_BY = 0.1
# Forms of an effect with a shape held that are simulated.
_MOST_FORMS = 3
# One that only the few breakaways show has to simulate better, even as the first.
_LEAST_FALL = -0.05
# By how much the logarithm of the simulation error of one rival is below another's that simulates
# clearly worse.
_CLEARLY_LOWER = 0.2
# Whitened squares: effects that gain the same to within this are one signature in the balances.
_SAME_GAIN = 1.0
# Friction is weighed anew where it scatters by more than this, and beside the effects by less than
# this part of that.
_MUCH_SCATTER = 0.02
_FAR_LESS = 0.5
# A rival of the first effect is tried in its place from this part of what that explains on, and
# stays where less than that part of what was left is left then.
_RIVAL_PART = 0.5
_HARDLY = 0.2


@dataclass(frozen=True)
class RefittedStep(Step):
    """An effect that was added: its fit beside the effects before it, which `model` holds too.

    With the base parameters refitted; `tried` are suspects. `held`: its shapes, by "id/name", that
    stay as they are, since fitted ones simulate worse. `alike`: rivals that are the same signature
    in the balances, as they were fitted. A step whose effect gave way to its plain form has the
    fit and the model from before.
    """

    refit: Refit
    model: Model
    tried: tuple[Suspect, ...]
    held: frozenset[str] = frozenset()
    alike: tuple[Refit, ...] = ()


@dataclass(frozen=True)
class Search:
    """The steps, the resulting model, and its residual next to the base model's.

    `joint` holds all effects fitted together, None where there are none; `base_std` the
    standard errors of the base parameters with them, in the parameters' units; `rounds` what
    each round tried; `null` what is expected of the last residual. `rivals`: the same with another
    effect in the place of one from which the balances do not tell it.
    """

    steps: tuple[RefittedStep, ...]
    model: Model
    first: Projected
    last: Projected
    joint: Refit | None
    base_std: Mapping[str, float]
    rounds: tuple[Round, ...]
    null: Null
    rivals: tuple[Search, ...] = ()

    @property
    def held(self) -> frozenset[str]:
        """The shapes that stay as they are, by "id/name"."""
        return _held_by(self.steps)

    @property
    def base_dof(self) -> int:
        """Degrees of freedom of `base_std`: rows less base parameters and effects' numbers."""
        rows, columns = self.last.basis.shape
        return int(rows - columns)

    def estimates(self, place: int) -> dict[str, Estimate]:
        """An effect's numbers by name, with intervals from leaving out one test at a time."""
        assert self.joint is not None
        fit = self.joint.fit
        effect = self.joint.effects[place]
        covariance = fit.jackknife_covariance(self.first.frame.tests)
        found = {
            q.name: fit.estimate(f"{effect.id}/{q.name}", covariance).within(q.lower, q.upper)
            for q in type(effect).quantities
            if not q.is_choice
        }
        for q in (q for q in type(effect).strengths() if q.is_threshold):
            found[q.name] = with_steps(found[q.name], q, self.first, self.model, self.joint, place)
        return found


def search(
    frame: Frame,
    model: Model,
    candidates: Sequence[Candidate],
    null: Null,
    progress: Progress,
    simulation_error: Callable[[Model], float],
    book: Book,
    known: Known | None = None,
) -> Search:
    """Add effects while one passes the twins' test and explains a fair share of the excess.

    A further effect must not raise `simulation_error`, the logarithm of a model's error on the
    fitted motion logs: one that only absorbs the misfit of the first may raise it. What fails,
    or what the budget ends before, is noted in `book`; the result is then the best so far. What is
    `known` of the same frame is not worked out again.
    """
    with limited():
        first = projected(frame, model)
    rounds = _TwinRounds(first, candidates, null, progress, simulation_error, book, known)
    history = run(rounds, book, progress)
    rounds, history = _exchanged(rounds, history, progress)
    with limited():
        found = rounds.finished(history)
    if book.quick:
        return found
    book.enter(SearchStage.RIVALS)
    rivals = attempt(lambda: tuple(other.finished(own) for other, own in rounds.renamed(history)))
    if isinstance(rivals, Failure):
        book.miss(rivals, decides=False)
        return found
    return replace(found, rivals=rivals)


def _exchanged(
    rounds: _TwinRounds, history: tuple[Round, ...], progress: Progress
) -> tuple[_TwinRounds, tuple[Round, ...]]:
    """The search, or another one that begins with a rival of the first effect, if that leaves
    hardly anything of what is left.

    Of two effects in one balance a third may imitate most: beside it neither of them fits.
    """
    if not rounds.may_give_way():
        return rounds, history
    book, aside = rounds.book, rounds.book.aside()
    book.enter(SearchStage.EXCHANGE)
    other = attempt(lambda: rounds.with_rival_first(aside))
    if isinstance(other, Failure):
        book.miss(other, decides=False)
    if other is None or isinstance(other, Failure):
        return rounds, history
    (step,), first = other.steps, history[0].added
    assert first is not None
    progress(f"{step.id} in place of {first.id}: what is left is searched again")
    begun = (Round(step.tried, step),)
    later = run(other, aside, progress, begun, {first.id})
    if not other.leaves_far_less_than(rounds):
        if any(miss.out_of_budget for miss in aside.missed[len(book.missed) :]):
            book.miss(LATE, decides=False)
        return rounds, history
    book.take(aside)
    others = " and ".join(s.id for s in other.steps)
    book.note(
        f"{first.id} alone explains more than {step.id}, but leaves what no further effect "
        f"explains; with {others} hardly anything is left"
    )
    return other, later


class _TwinRounds(Rounds[RefittedStep]):
    """The rounds of an actuator: `base` is the residual beside the steps, `joint` all of them."""

    stage = SearchStage.SCREENING
    tried: tuple[Suspect, ...]

    def __init__(
        self,
        first: Projected,
        candidates: Sequence[Candidate],
        null: Null,
        progress: Progress,
        simulation_error: Callable[[Model], float],
        book: Book,
        known: Known | None = None,
    ) -> None:
        self.first = self.base = self._begun = first
        self.known = known or Known()
        # What twins of the given model show, and those of the model with the steps' effects.
        self._given, self.null = null, null
        self.candidates, self.book = candidates, book
        self.progress, self.simulation_error = progress, simulation_error
        self.before = null.excess(first)
        self.steps, self.tried = [], ()
        self.joint: Refit | None = None
        # The steps before the next and all effects fitted together, as it was judged.
        self._proposed: tuple[list[RefittedStep], Refit] | None = None
        # Without each step that might be superfluous, the others fitted together.
        self._others: dict[str, Refit] = {}
        # The first round's suspects as they were fitted.
        self._rivals: list[Refit] = []

    def may_give_way(self) -> bool:
        """Whether the first effect has rivals, and structure is left in the end."""
        has_rivals = bool(self._rivals) and not self.book.quick
        return has_rivals and bool(self.null.structured(self.first, self.base))

    def with_rival_first(self, book: Book) -> _TwinRounds | None:
        """Rounds that begin with the best rival of the first effect; None: none is to be added."""
        other = _TwinRounds(
            self._begun, self.candidates, self._given, self.progress, self.simulation_error, book,
            self.known,
        )  # fmt: skip
        other.tried = self.steps[0].tried
        step = other._best(other.before, self._rivals, 1)
        if step is None:
            return None
        other.add(replace(step, tried=other.tried))
        return other

    def leaves_far_less_than(self, other: _TwinRounds) -> bool:
        """Whether hardly anything is left of what another search leaves, and the fitted motion
        logs are simulated clearly better."""
        channels = other.null.structured(self.first, other.base)
        left, before = (excess_in(channels, r.null.excess(r.base)) for r in (self, other))
        return left < _HARDLY * before and _simulates(
            self.simulation_error, other.base.model, self.base.model, -_CLEARLY_LOWER
        )

    def proposal(self, number: int, barred: frozenset[str]) -> RefittedStep | None:
        """The effect that explains most of what is left."""
        base, book = self.base, self.book
        forget()  # what one stage computed the next hardly asks for, and it is much
        open_ones = [c for c in self.candidates if c.id not in barred and _composes(base.model, c)]
        screened = self._screened(open_ones)
        best, starts = best_by_effect(screened), starting_points(screened)
        book.enter(SearchStage.COMPARISON, number)
        forget()
        self.tried = suspects = suspects_of(best, self.null, book)
        others = base.model.effects
        reached = {s.id: frozenset(channels_of(starts[s.id][0], others)) for s in suspects}
        passing = worth_refitting(suspects, reached)
        if not passing or len(self.steps) == MOST_EFFECTS:
            return None
        self.tried = tuple(replace(s, is_fitted=s.id in passing) for s in suspects)
        book.enter(SearchStage.SUSPECTS, number)
        excess = self.null.excess(base)
        forget()
        fitted = self._fitted(passing, starts)
        step = self._best(excess, fitted, number)
        if step is None:
            return None
        if number == 1:
            enough = _RIVAL_PART * step.refit.gain
            self._rivals = [r for r in fitted if r.id != step.id and r.gain > enough]
        unfitted = book.unfinished(SearchStage.SUSPECTS, number)
        near = tuple(sorted({*step.ambiguous, *unfitted} - {step.id}))
        return replace(step, ambiguous=near)

    def _screened(self, forms: Sequence[Candidate]) -> list[Explained]:
        """Every form against what is left, but for those of which that is known."""

        def unknown(names: Sequence[str]) -> list[Explained]:
            self.book.screened += [n for n in dict.fromkeys(f.id for f in forms) if n not in names]
            return screen(self.base, [f for f in forms if f.id in names], self.book)

        return self.known.all_screened(self.base, (f.id for f in forms), unknown)

    def _fitted(
        self, names: Sequence[str], starts: Mapping[str, Sequence[CatalogueEffect]]
    ) -> list[Refit]:
        """Each effect from its starting points, but for those of which that is known."""

        def unknown(some: Sequence[str]) -> list[Refit]:
            self.book.fitted += [name for name in names if name not in some]
            return _refit(self.base, [starts[name] for name in some], self.book)

        return self.known.all_fitted(self.base, names, unknown)

    def _best(
        self, excess: Mapping[str, float], fitted: Sequence[Refit], number: int
    ) -> RefittedStep | None:
        """The step with the fitted suspect that explains most, if it is to be added.

        Where it is not, that of the others. What is left of a balance may be due to the form of an
        effect before: of those that explain the same balances as one that was refused only the
        next is tried, and has to explain nearly all of them and to simulate better. So has one that
        may act where an effect does, but explains what none of them reaches.
        """
        clear = self._clear(fitted, excess)
        judged = {r.id: channels_of(r.effect) for r in clear}
        refused: set[str] = set()
        while clear:
            winner = _likeliest(clear)
            self.progress(f"{winner.id}: tried {', '.join(r.id for r in clear)}")
            winner = self._on_finer_grid(self._simulating_best(winner, clear))
            self.book.enter(SearchStage.TOGETHER, number)
            reached, own = judged[winner.id], explained_channels(winner, self.base.frame)
            again = bool(refused.intersection(reached))
            step = self._step(winner, clear, excess, reached, again=again)
            if step is None and set(own) != set(reached) and self._none_acts(own):
                step = self._step(winner, clear, excess, own, again=True)
            if step is not None:
                return step
            judged = {r.id: explained_channels(r, self.base.frame) for r in clear}
            refused.update(own)
            rest = [r for r in clear if r.id != winner.id]
            same = [r for r in rest if refused.intersection(judged[r.id])]
            other = [r for r in rest if not refused.intersection(judged[r.id])]
            clear = [r for r in other if _is_there(r, judged[r.id], excess)]
            if same and not again:
                later = _likeliest(same)
                if self._is_whole(later, excess, judged[later.id]):
                    clear.append(later)
        return None

    def _none_acts(self, channels: Sequence[str]) -> bool:
        """Whether there are effects, and none of them reaches these balances."""
        reached = {c for step in self.steps for c in channels_of(step.effect)}
        return bool(self.steps) and not reached.intersection(channels)

    def _clear(self, fitted: Sequence[Refit], excess: Mapping[str, float]) -> list[Refit]:
        """Those whose strengths the tests agree on."""
        tests = self.base.frame.tests
        gaining = [r for r in fitted if r.gain > 0.0 and not self._is_hum(r)]
        refits = [r for r in gaining if r.wald(tests) > self._least_wald(r, excess)]
        # Few tests may reach a limit, or rest.
        return refits or [r for r in gaining if self._shows_in_few(r, excess)]

    def _shows_in_few(self, found: Refit, excess: Mapping[str, float]) -> bool:
        """Whether an effect is real though not many tests show it, as the simulation confirms.

        Beside others only one with a threshold, which so many tests may hardly have as a campaign
        does: those that tell have to agree, and be four at least. One that explains nearly all that
        is left hardly changes the sum over all logs, where few show it.
        """
        if not self.steps:
            return self._simulates_better(found)
        if not (has_threshold(found.effect) and found.wald(self.base.frame.tests) >= _MAIN_WALD):
            return False
        own = explained_channels(found, self.base.frame)
        return self._is_whole(found, excess, own) or self._simulates_better(found)

    def _is_hum(self, found: Refit) -> bool:
        """Whether an oscillation that goes on whatever the motion does explains clearly more."""
        other = steady_oscillation(self.base, found)
        if other is None:
            return False
        self.book.note(
            f"not {found.id}: in the torque balance an oscillation of {other.frequency:.1f} Hz "
            "goes on whatever the motion does, as hum of the mains does; log a rest with the "
            "amplifier on"
        )
        return True

    def _least_wald(self, found: Refit, excess: Mapping[str, float]) -> float:
        """How far from 0 the tests must agree that an effect's strengths are."""
        channels = channels_of(found.effect)
        if self.steps:
            channels = explained_channels(found, self.base.frame)
            # A threshold's tests vote, one each, and a campaign has few.
            if not self._none_acts(channels) and not has_threshold(found.effect):
                return _CLEAR_WALD
        return _MAIN_WALD if share_of_excess(found, excess, channels) > _MAIN_SHARE else _CLEAR_WALD

    def _step(
        self,
        winner: Refit,
        refits: Sequence[Refit],
        excess: Mapping[str, float],
        channels: Sequence[str],
        *,
        again: bool,
    ) -> RefittedStep | None:
        """With the best of these refits, if what it explains of these channels is enough.

        `again`: it was refused for other channels, or another one for these.
        """
        gains = {r.id: r.gain for r in refits}
        for form, held, rise in self._forms(winner, excess, channels):
            most = min(rise, -_BETTER_BY) if again else rise
            extended = self._extended(form, held, most)
            if extended is not None:
                return RefittedStep(
                    form.effect,
                    self.null.p_value(form.id, form.gain, len(type(form.effect).strengths())),
                    share_of_excess(form, excess, channels),
                    indistinguishable(form, refits),
                    tuple(replace(s, refitted=gains.get(s.id)) for s in self.tried),
                    form,
                    extended,
                    held,
                    tuple(r for r in refits if _is_alike(r, form)),
                )
        return None

    def _forms(
        self, winner: Refit, excess: Mapping[str, float], channels: Sequence[str]
    ) -> Iterator[tuple[Refit, frozenset[str], float]]:
        """The effect as it was fitted, then beside others with a shape held, as far as they explain
        enough; with each, by how much the logarithm of the simulation error may rise."""
        rise = self._tolerated_rise(winner, excess, channels)
        if rise is None:
            return
        yield winner, frozenset(), rise
        if self.steps:
            for form, held in self._held_forms(winner):
                if self._tolerated_rise(form, excess, channels) is not None:
                    yield form, held, -_BETTER_BY

    def _tolerated_rise(
        self, found: Refit, excess: Mapping[str, float], channels: Sequence[str]
    ) -> float | None:
        """By how much the logarithm of the simulation error may rise with an effect.

        None where it does not explain a fair share of what is left of these channels, nor of what
        is left there where the effects so far do not act.
        """
        if self._is_enough(found, excess, channels):
            rise = _TOLERATED_RISE
        elif self._shows_where_none_acts(found, channels):
            rise = -_TOLERATED_RISE
        elif self.steps and (
            self._is_whole(found, excess, channels)
            or self._is_enough(found, excess, channels, _LEAST_WHOLE)
        ):
            rise = -_CLEARLY_LOWER
        else:
            return None
        if relative_size(found.effect) >= LEAST_SIZE:
            return rise
        return rise if not self.steps and self._simulates_better(found) else None

    def _is_enough(
        self,
        found: Refit,
        excess: Mapping[str, float],
        channels: Sequence[str],
        part: float = _LEAST_PART,
    ) -> bool:
        """Whether an effect explains a fair share of what is left of these channels.

        One that does not explain nearly all of it also at least a `part` of what is gone.
        """
        share = share_of_excess(found, excess, channels)
        least = _LEAST_WHOLE if self._is_whole(found, excess, channels) else part
        # Where the effects so far do not act, nothing can be a misfit of their form. `before` is by
        # twins of the given model, which leave more: that little does not count as gone.
        gone = sum(max(self.before[c] - excess[c], 0.0) for c in channels)
        return share >= LEAST_SHARE and found.gain >= least * gone

    @staticmethod
    def _is_whole(found: Refit, excess: Mapping[str, float], channels: Sequence[str]) -> bool:
        """Whether an effect explains nearly all of what is left of these channels."""
        share = share_of_excess(found, excess, channels)
        return share >= _WHOLE_SHARE and _is_there(found, channels, excess)

    def _shows_where_none_acts(self, found: Refit, channels: Sequence[str]) -> bool:
        """Whether an effect explains a fair share of the rows where the effects so far do not act.

        No row there is a misfit of their form; a fair share of what it explains has to be there.
        """
        if not self.steps:
            return False
        base = self.base
        without = Model(base.model.parameters, self.first.model.effects)
        acting = np.abs(base.frame.residual(base.model) - base.frame.residual(without))
        rows = (acting < _NOT_ACTING) & base.frame.belongs(tuple(channels))
        squares = found.before[rows] ** 2
        gain = float(np.sum(squares - found.rest[rows] ** 2))
        left = float(np.sum(squares - self.null.expected(base)[rows]))
        return LEAST_SHARE * max(found.gain, left) <= gain < _MOST_OF_EXCESS * left

    def _extended(self, winner: Refit, held: frozenset[str], rise: float) -> Model | None:
        """The model with an effect too; None where it does not go with the others, or simulates
        worse: where the logarithm of the error rises by more than `rise`, with the others in their
        plainest form, too, where they have one."""
        joint = _together(self.first, self.steps, winner, held)
        if joint is None:
            return None
        if channels_of(winner.effect) == (BREAKAWAY,):
            rise = min(rise, _LEAST_FALL)
        extended = self._if_it_simulates(self.steps, joint, rise)
        if extended is not None:
            return extended
        # What the balances hardly see of a shape, as of a line's volume behind a supply's
        # resistance, may lead astray in motion.
        plain = [_in_plain_form(*pair) for pair in zip(self.steps, joint.effects, strict=False)]
        if all(other is step for other, step in zip(plain, self.steps, strict=True)):
            return None
        joint = _together(self.first, plain, winner, held)
        return None if joint is None else self._if_it_simulates(plain, joint, rise)

    def _if_it_simulates(
        self, steps: list[RefittedStep], joint: Refit, rise: float
    ) -> Model | None:
        """The model with these steps' effects and a further one as they were fitted together, which
        is proposed then; None where it simulates worse. The first effect may have to as well."""
        extended = self._all_of(joint)
        judged = bool(steps) or rise < 0.0
        if judged and not _simulates(self.simulation_error, self.base.model, extended, rise):
            return None
        self._proposed = steps, joint
        return extended

    def _held_forms(self, winner: Refit) -> list[tuple[Refit, frozenset[str]]]:
        """An effect with one of its shapes held at a usual value, the best of these first.

        What a balance sees of a law may be its tail alone: a shape that is fitted to it may then
        lead anywhere else, as friction that falls with speed does at rest. So may the other shapes
        as they were fitted: each form begins at the best usual ones as well.
        """
        side = getattr(winner.effect, "side", None)
        own = [c for c in self.candidates if c.id == winner.id]
        usual = screen_group(self.base, [c for c in own if dict(c.shape).get("side") == side])
        found = []
        for q in (q for q in type(winner.effect).shapes() if not q.is_choice):
            for value in q.grid:
                like = [f for f in usual if dict(f.candidate.shape)[q.name] == value]
                starts = [replace(winner.effect, **{q.name: value})]  # type: ignore[type-var]
                starts += starting_points(like).get(winner.id, [])
                held = frozenset({f"{winner.id}/{q.name}"})
                forms = [refit(self.base, [start], held) for start in starts]
                found.append((max(forms, key=lambda form: form.gain), held))
        best = sorted(found, key=lambda pair: -pair[0].gain)
        return best[:_MOST_FORMS]

    def _simulating_best(self, winner: Refit, refits: Sequence[Refit]) -> Refit:
        """Of effects that explain as much in the balances, the one that simulates clearly better.

        What the balances average out, as the pulses' ripple, tells them apart there; of those that
        are one signature in the balances a little better will do.
        """
        near = [r for r in refits if r.gain > RIVAL_SHARE * winner.gain]
        if len(near) < 2:
            return winner
        errors = {}
        for rival in near:
            model = with_base_refitted(self.first, self.base.model + rival.effect)
            with contextlib.suppress(SimulationError):
                errors[rival.id] = self.simulation_error(model)
        if len(errors) < 2:
            return winner
        same = [r for r in near if r.gain > winner.gain - _SAME_GAIN]
        for some, margin in ((near, _CLEARLY_LOWER), (same, _TOLERATED_RISE)):
            best = min(some, key=lambda r: errors.get(r.id, math.inf))
            if errors.get(best.id, math.inf) < errors.get(winner.id, math.inf) - margin:
                self.progress(f"{best.id}: simulates better than {winner.id}")
                return best
        return winner

    def _on_finer_grid(self, winner: Refit) -> Refit:
        """An effect with a threshold refitted from the best on a finer grid, if it is better."""
        if not has_threshold(winner.effect):
            return winner
        starts = starting_points(screen_group(self.base, finer(type(winner.effect))))[winner.id]
        if overrides(winner.effect, "pulses"):
            starts = [best_near(start, self.base) for start in starts]
        return max(winner, *(refit(self.base, [s]) for s in starts), key=lambda r: r.gain)

    def _simulates_better(self, found: Refit) -> bool:
        """Whether the fitted motion logs are simulated clearly better with an effect."""
        model = with_base_refitted(self.first, self.base.model + found.effect)
        return _simulates(self.simulation_error, self.base.model, model, -_BETTER_BY)

    def add(self, step: RefittedStep) -> None:
        assert self._proposed is not None
        before, self.joint = self._proposed
        self.steps = [*before, step]
        self._narrow()
        self._look_beside(self.steps[-1].model)

    def _narrow(self) -> None:
        """Weigh friction by the scatter that the effects leave, where it is far less than before.

        All effects are fitted together again then, and are the steps' from there on.
        What an effect does may look like scatter of friction from test to test: as if the friction
        of each test were hardly known, which hides the next effect and leads friction astray.
        """
        frame = self.first.frame
        if self.book.quick or frame.scatter < _MUCH_SCATTER:
            return
        with limited():
            left = scatter_beside(frame, self.steps[-1].model)
            if left > _FAR_LESS * frame.scatter:
                return
            self.progress(f"friction scatters by {100 * left:.1f} % beside the effects")
            self.first = projected(replace(frame, scatter=left), self.first.model)
            self.before = self._given.excess(self.first)
            assert self.joint is not None
            self.joint = refit(self.first, self.joint.effects, _held_by(self.steps))
            model, fitted = self._all_of(self.joint), self.joint.effects
            steps = [replace(s, effect=e) for s, e in zip(self.steps, fitted, strict=True)]
            self.steps = [*steps[:-1], replace(steps[-1], model=model)]

    def superfluous(self) -> RefittedStep | None:
        """The step that explains least beside the others, if that is next to nothing.

        Where the tests do not agree that its strength differs from 0, and without it the others
        explain all but a misfit of their form.
        """
        assert self.joint is not None
        tests, joint = self.base.frame.tests, self.joint
        doubtful = [
            step
            for place, step in enumerate(self.steps[:-1])
            if has_threshold(step.effect) or joint.wald(tests, place) < _CLEAR_WALD
        ]
        without = self._others = {step.id: self._without(step) for step in doubtful}
        least = min(doubtful, key=lambda s: joint.gain - without[s.id].gain, default=None)
        if least is None:
            return None
        lost = joint.gain - without[least.id].gain
        numbers = len(type(least.effect).fitted())
        least_lost = max(_LEAST_PART * without[least.id].gain, penalty(joint, numbers))
        return least if lost < least_lost else None

    def _without(self, step: RefittedStep) -> Refit:
        """All effects but one fitted together."""
        assert self.joint is not None
        others = [e for e in self.joint.effects if e.id != step.id]
        return refit(self.first, others, _held_by([s for s in self.steps if s is not step]))

    def remove(self, step: RefittedStep) -> None:
        place = self.steps.index(step)
        if place == 0:  # it has given way already
            self._rivals = []
        self.joint = self._others[step.id]
        self._follow(self.steps[:place], self.steps[place + 1 :])
        self._look_beside(self.steps[-1].model)

    def _follow(self, before: list[RefittedStep], after: Sequence[RefittedStep]) -> None:
        """Have these steps, those `after` with the models that they are with behind the others."""
        effects = [s.effect for s in before]
        given = self.first.model
        self.steps = before
        with limited():
            for later in after:
                effects.append(later.effect)
                model = Model(given.parameters, (*given.effects, *effects))
                model = with_base_refitted(self.first, model)
                self.steps.append(replace(later, model=model))

    def renamed(
        self, history: tuple[Round, ...]
    ) -> Iterator[tuple[_TwinRounds, tuple[Round, ...]]]:
        """These rounds with a rival in the place of an effect from which the balances do not tell
        it, hardly beside the others either; with their history. Raises OutOfBudgetError."""
        for step in self.steps:
            others = [s for s in self.steps if s is not step]
            for rival in step.alike:
                if rival.id in {s.id for s in others}:
                    continue
                assert self.joint is not None
                effects = [rival.effect if e.id == step.id else e for e in self.joint.effects]
                joint = refit(self.first, effects, _held_by(others))
                if self.joint.gain - joint.gain < (1.0 - RIVAL_SHARE) * step.refit.gain:
                    other, named = self._with_rival(step, rival, joint)
                    rounds = (
                        replace(r, added=named) if r.added and r.added.id == step.id else r
                        for r in history
                    )
                    yield other, tuple(rounds)

    def _with_rival(
        self, step: RefittedStep, rival: Refit, joint: Refit
    ) -> tuple[_TwinRounds, RefittedStep]:
        """A copy with a rival in a step's place, and its step; `joint`: all fitted together."""
        strengths = len(type(rival.effect).strengths())
        named = replace(
            step,
            effect=rival.effect,
            refit=rival,
            p_value=self.null.p_value(rival.id, rival.gain, strengths),
            ambiguous=tuple(sorted({*step.ambiguous, step.id} - {rival.id})),
            held=frozenset(),
            alike=(),
        )
        other, place = copy.copy(self), self.steps.index(step)
        other.joint = joint
        other._follow(self.steps[:place], [named, *self.steps[place + 1 :]])
        other._look_beside(other._all_of(joint))
        return other, other.steps[place]

    def _all_of(self, joint: Refit) -> Model:
        """The model with effects that were fitted together."""
        given = self.first.model
        model = Model(given.parameters, (*given.effects, *joint.effects))
        return with_base_refitted(self.first, model)

    def _look_beside(self, model: Model) -> None:
        with limited():
            extra = own_columns(self.first.frame, model)
            self.base = projected(self.first.frame, model, extra=extra)
        if self.book.quick:
            return
        null = attempt(lambda: self._given.beside(self.base))
        if isinstance(null, Failure):
            self.book.miss(null, decides=False)
            null = self._given  # its twins leave more: what is found by them is there
        self.null = null

    def finished(self, rounds: tuple[Round, ...]) -> Search:
        """All effects as fitted together, from the base model on."""
        first, steps, joint = self.first, self.steps, self.joint
        if joint is None:
            return Search((), first.model, first, self.base, None, {}, rounds, self.null)
        model = self._all_of(joint)
        own = own_columns(first.frame, model)
        last = projected(first.frame, model, extra=own)
        base_std = standard_errors(last, own)
        steps = [*steps[:-1], replace(steps[-1], model=model)]
        return Search(tuple(steps), model, first, last, joint, base_std, rounds, self.null)


def _held_by(steps: Sequence[RefittedStep]) -> frozenset[str]:
    """The shapes that stay as they are."""
    return frozenset().union(*(step.held for step in steps))


def _in_plain_form(step: RefittedStep, fitted: CatalogueEffect) -> RefittedStep:
    """A step with the shapes that its effect may do without left out, and held there; the other
    numbers as `fitted`. The step itself where there are none."""
    kind = type(step.effect)
    free = [q for q in kind.shapes() if not q.is_choice and f"{step.id}/{q.name}" not in step.held]
    shapes = {q.name: q.absent for q in free if q.absent is not None}
    shapes = {n: v for n, v in shapes.items() if getattr(fitted, n) != v}
    if not shapes:
        return step
    names = {f"{step.id}/{name}" for name in shapes}
    plain = replace(fitted, **shapes)  # type: ignore[type-var]
    return replace(step, effect=plain, held=step.held | names)


def _likeliest(refits: Sequence[Refit]) -> Refit:
    """Of effects the one that explains most; of those which explain as much, one of usual size."""
    winner = max(refits, key=lambda r: r.gain - penalty(r))
    near = [r for r in refits if r.gain > RIVAL_SHARE * winner.gain]
    usual = [r for r in near if relative_size(r.effect) >= LEAST_SIZE]
    return max(usual or [winner], key=lambda r: r.gain - penalty(r))


def _is_alike(rival: Refit, winner: Refit) -> bool:
    """Whether another effect is the same signature in the balances."""
    return rival.id != winner.id and abs(rival.gain - winner.gain) < _SAME_GAIN


def _is_there(found: Refit, channels: Sequence[str], excess: Mapping[str, float]) -> bool:
    """Whether what an effect explains is there: these channels exceed the twins' by as much."""
    return found.gain < _MOST_OF_EXCESS * excess_in(channels, excess)


def _together(
    first: Projected, steps: Sequence[RefittedStep], winner: Refit, held: frozenset[str]
) -> Refit | None:
    """The effects so far and another one fitted together; None where they change their size.

    Two effects that grow against each other are not real: together they imitate a curve.
    """
    if not steps:
        return winner
    before = [step.effect for step in steps]
    joint = refit(first, [*before, winner.effect], _held_by(steps) | held)
    for old, new in zip(before, joint.effects, strict=False):
        names = [q.name for q in type(old).quantities if q.is_strength]
        was = np.array([getattr(old, n) for n in names])
        now = np.array([getattr(new, n) for n in names])
        size = float(was @ was)
        kept = float(was @ now) / size if size > 0.0 else 0.0
        if not 1.0 / _MOST_CHANGE < kept < _MOST_CHANGE:
            return None
    return joint


def _simulates(
    simulation_error: Callable[[Model], float], before: Model, after: Model, rise: float
) -> bool:
    """Whether a model simulates the fitted motion logs with at most this rise of the error's
    logarithm over that without its last effect."""
    try:
        return simulation_error(after) <= simulation_error(before) + rise
    except SimulationError:
        return False


def _composes(model: Model, candidate: Candidate) -> bool:
    return not set(model.state_names).intersection(candidate.neutral().states)


def _refit(base: Projected, starts: Sequence[Sequence[CatalogueEffect]], book: Book) -> list[Refit]:
    """Each effect from its starting points; the best of each. What fails is noted."""
    flat = [start for points in starts for start in points]
    tried = attempt_in_threads(partial(refit, base, [start]) for start in flat)
    found = book.results([start.id for start in flat], tried)
    book.fitted += [name for name, _ in found]
    best: dict[str, Refit] = {}
    for name, one in found:
        if name not in best or one.gain > best[name].gain:
            best[name] = one
    return list(best.values())
