"""The search for what a model lacks: effects are added one after another, and taken out again.

What a round screens, fits and judges is a matter of the evidence (`Rounds`): twins of an actuator
(`actuator.search`), leave-one-test-out prediction (`bench.selection`). Every effect that is
not in the model is tried again in each round; one that those added after it make superfluous is
removed, and not tried again.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from sysid.diagnosis.search_record import Recorder, SearchStage
from sysid.errors import Failure
from sysid.parallel import attempt, limited
from sysid.plant.effects.entry import CatalogueEffect
from sysid.types import Progress

MOST_EFFECTS = 3


@dataclass(frozen=True)
class Tried:
    """An effect that a round tried: what it explains, and how likely as much is by chance.

    `reduction`: of the whitened sum of squares by its signature (twins), or the relative
    reduction of the leave-one-test-out mean square error, negative where it predicts worse.
    """

    id: str
    reduction: float
    p_value: float

    def to_json(self) -> dict[str, Any]:
        """As `sysid diagnose --json` lists what was rejected."""
        return {"id": self.id, "gain": self.reduction, "p_value": self.p_value}


@dataclass(frozen=True)
class Step:
    """An effect that was added, and what else its round tried, in descending order.

    All as it was found then, also where an effect before it was removed since. `share`: what it
    explained of the excess over noise in the balances that it affects, or of the leave-one-test-out
    mean square error. `ambiguous`: ids of effects that the data do not distinguish from it.
    """

    effect: CatalogueEffect
    p_value: float
    share: float
    ambiguous: tuple[str, ...]
    tried: tuple[Tried, ...]

    @property
    def id(self) -> str:
        return self.effect.id

    @property
    def is_ambiguous(self) -> bool:
        """Whether other tests are needed to distinguish it from its rivals."""
        return bool(self.ambiguous)

    @property
    def parts_named(self) -> dict[str, Any] | None:
        """What parts of the tests name, in JSON types; None where the tests were not cut."""
        return None


StepT = TypeVar("StepT", bound=Step)


@dataclass(frozen=True)
class Round:
    """What a round tried, the step that it added (None: the last round), and what that removed."""

    tried: tuple[Tried, ...]
    added: Step | None = None
    removed: tuple[str, ...] = ()


class Rounds(ABC, Generic[StepT]):
    """What one kind of evidence says of effects, round by round.

    `steps` are those in the model, in the order in which they were added; `tried` what the present
    round tried; `stage` what a round begins with.
    """

    stage: SearchStage

    steps: list[StepT]
    tried: tuple[Tried, ...]

    @abstractmethod
    def proposal(self, number: int, barred: frozenset[str]) -> StepT | None:
        """The best effect to be added in a round, of those not in `barred`; None if none passes.

        Raises OutOfBudgetError.
        """

    @abstractmethod
    def add(self, step: StepT) -> None:
        """Take a step into the model."""

    @abstractmethod
    def superfluous(self) -> StepT | None:
        """A step other than the last that the model does without; None: all are needed.

        Raises OutOfBudgetError.
        """

    @abstractmethod
    def remove(self, step: StepT) -> None:
        """Take a step out of the model, and fit the others without it."""


def run(
    rounds: Rounds[StepT],
    recorder: Recorder,
    progress: Progress,
    earlier: Sequence[Round] = (),
    given_up: Collection[str] = (),
) -> tuple[Round, ...]:
    """Add effects, and remove what they make superfluous, until no round adds one.

    Continues after the `earlier` rounds, without the effects `given_up`. Ends within the limit in
    force (`sysid.parallel`), except for the first round; `recorder` notes failures. A quick search
    ends with the first effect.
    """
    history = list(earlier)
    removed = set(given_up)
    while True:
        number = len(history) + 1
        barred = frozenset({step.id for step in rounds.steps} | removed)
        recorder.enter(rounds.stage, number)
        rounds.tried = ()
        with limited() if number == 1 else nullcontext():
            proposed = attempt(lambda: rounds.proposal(number, barred))  # noqa: B023
            if isinstance(proposed, Failure):
                recorder.miss(proposed)
                proposed = None
            if proposed is not None:
                rounds.add(proposed)
        if proposed is None:
            history.append(Round(rounds.tried))
            return tuple(history)
        gone = _removed(rounds, recorder, number, progress)
        removed |= set(gone)
        history.append(Round(proposed.tried, proposed, gone))
        if recorder.quick:
            recorder.left_out(rounds.stage, number + 1)
            history.append(Round(()))
            return tuple(history)


def shapes_at_limits(effect: CatalogueEffect, at_bound: Collection[str]) -> tuple[str, ...]:
    """An effect's shapes that ended at a limit of their range, of the numbers ("id/name") that did.

    What is held at the plain form is at none. A limit that is that form, as no damping, is a value,
    and so is one of the forms that are tried, as a line that is wholly shared, or that has words of
    its own.
    """
    found = []
    for q in type(effect).shapes():
        value = float(getattr(effect, q.name))
        limit = q.lower if value - q.lower < q.upper - value else q.upper
        is_value = q.is_choice or value == q.absent
        is_value |= limit in (q.absent, *q.grid, *dict(q.forms))
        if f"{effect.id}/{q.name}" in at_bound and not is_value:
            found.append(q.label)
    return tuple(found)


def limit_sentence(name: str, limits: Sequence[str], rivals: Sequence[str]) -> str:
    """Says that the shapes `limits` of an effect ended at limits of their ranges, so that its name
    is in doubt; empty where none did."""
    if not limits:
        return ""
    others = f" ({', '.join(rivals)}, for one)" if rivals else ""
    return (
        f"{name}: {' and '.join(limits)} ended at a limit of its range: the form that the tests "
        f"show lies beyond what the effect can take, so that another one may be behind it{others}"
    )


def full_sentence(steps: Sequence[Step]) -> str:
    """Says that a search ended with as many effects as it may add; empty where it did not."""
    if len(steps) < MOST_EFFECTS:
        return ""
    return (
        f"the search adds at most {MOST_EFFECTS} effects, and has added {len(steps)}: no further "
        "one was looked for, so diagnose the extended bundle for what it still lacks"
    )


def mark_removed(shown: Sequence[dict[str, Any]]) -> None:
    """Say of effects that were removed in which round; `shown` as reports show the rounds."""
    for number, one in enumerate(shown, start=1):
        for suspect in (s for other in shown[:number] for s in other["suspects"]):
            if suspect["id"] in one["removed"] and suspect["fate"] == "added":
                suspect["fate"] = f"added, and removed in round {number} as superfluous"


def _removed(
    rounds: Rounds[StepT], recorder: Recorder, number: int, progress: Progress
) -> tuple[str, ...]:
    """The effects taken out again after a round, one by one."""
    found: list[str] = []
    while len(rounds.steps) > 1:
        recorder.enter(SearchStage.REMOVAL, number)
        step = attempt(rounds.superfluous)
        if isinstance(step, Failure):
            recorder.miss(step, decides=False)
            break
        if step is None:
            break
        progress(f"{step.id}: superfluous given {rounds.steps[-1].id}, removed")
        rounds.remove(step)
        found.append(step.id)
    return tuple(found)


__all__ = [
    "MOST_EFFECTS",
    "Round",
    "Rounds",
    "Step",
    "Tried",
    "full_sentence",
    "limit_sentence",
    "mark_removed",
    "run",
    "shapes_at_limits",
]
