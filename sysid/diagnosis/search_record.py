"""What a search for missing effects examined, and what it did not reach."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Literal, TypeVar

from sysid.errors import Failure
from sysid.parallel import Limit, limited

_Result = TypeVar("_Result")

EVALUATIONS = 50_000
"""Bound of a search in evaluations (`sysid.parallel.spend`), the same on any machine.

Over ten times what searches with two missing effects make (2000 to 4000 of a lab's campaign).
"""

UnexplainedReason = Literal["structure", "held-out errors", "unfinished search", "one recording"]
"""Why a verdict is `unexplained`: structure that no effect explains; held-out tests far off though
no balance shows structure; a search of which something failed, and that found nothing; or errors
far above the noise of a single recording, in which nothing can repeat."""


def bounded(budget: float | None) -> AbstractContextManager[Limit]:
    """The limit of a search: so many seconds of processor time, where they are asked for, else
    `EVALUATIONS`. What no verdict can do without is not cut short."""
    return limited(evaluations=EVALUATIONS) if budget is None else limited(seconds=budget)


class SearchStage(StrEnum):
    """What a search is about; those within a round have its number too."""

    TWIN = "simulation of a twin"
    TWINS = "simulation of twins"
    SCREENING = "screening"
    FORMS = "screening of further forms"
    SUSPECTS = "fit of suspects"
    RIVALS = "fit of rivals that the balances do not tell apart"
    EFFECTS = "fit of effects"
    REMOVAL = "removal of superfluous effects"
    REPETITION = "repetition on parts of the tests"
    CORRECTION = "correction of the numbers by twins of the extended model"
    REFINEMENT = "refinement of the numbers by simulation"


@dataclass(frozen=True)
class Missed:
    """A stage that did not end, or an effect (`subject`) that it did not come to, and why.

    `round` from 1, 0 outside the rounds. `decides`: the verdict depends on it.
    """

    stage: SearchStage
    round: int
    subject: str
    reason: str
    out_of_budget: bool
    decides: bool = True

    def not_done(self) -> dict[str, Any]:
        """The stage, its round and the effect's id, None without one, as JSON types."""
        return {
            "stage": self.stage.value,
            "round": self.round or None,
            "effect": self.subject or None,
        }

    def to_json(self) -> dict[str, Any]:
        """As JSON types: None for no round, and for a `subject` that is no effect's id."""
        return {
            "stage": self.stage.value,
            "round": self.round or None,
            "subject": self.subject or None,
            "reason": self.reason,
            "out_of_time": self.out_of_budget,
            "decides": self.decides,
        }


@dataclass(frozen=True)
class SearchRecord:
    """The effects that were screened and fitted, by id, what was missed, and what was noted."""

    screened: tuple[str, ...] = ()
    fitted: tuple[str, ...] = ()
    missed: tuple[Missed, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def is_complete(self) -> bool:
        return not self.missed

    @property
    def is_decided(self) -> bool:
        """Whether nothing was missed on which the verdict depends."""
        return not any(miss.decides for miss in self.missed)

    @property
    def cut_short(self) -> tuple[Missed, ...]:
        """What was missed as the budget ended."""
        return tuple(miss for miss in self.missed if miss.out_of_budget)

    def to_json(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "complete": self.is_complete,
            "screened": list(self.screened),
            "fitted": list(self.fitted),
            "missed": [miss.to_json() for miss in self.missed],
        }

    def sentences(self) -> tuple[str, ...]:
        """Notices: what was noted, and what was missed, stage by stage."""
        found = list(self.notes)
        for stage, number in dict.fromkeys((m.stage, m.round) for m in self.missed):
            own = [m for m in self.missed if (m.stage, m.round) == (stage, number)]
            subjects = ", ".join(dict.fromkeys(m.subject for m in own if m.subject))
            reasons = "; ".join(dict.fromkeys(m.reason for m in own))
            of = f" of {subjects}" if subjects else ""
            late = any(m.out_of_budget for m in own)
            fix = " (--budget SECONDS allows more)" if late else ""
            found.append(f"not done: {stage_text(stage, number)}{of}: {reasons}{fix}")
        return tuple(found)


def why_unexplained(structured: bool, far_off: bool, undecided: bool) -> UnexplainedReason | None:
    """The strongest of the reasons that hold; None: no reason, the verdict is another."""
    if structured:
        return "structure"
    if far_off:
        return "held-out errors"
    return "unfinished search" if undecided else None


def stage_text(stage: str, number: int | None) -> str:
    """A stage in words, with its round if it has one."""
    return f"{stage}, round {number}" if number else stage


@dataclass
class Recorder:
    """A `SearchRecord` under construction; `quick`: only a quick search was requested (`QUICK`)."""

    stage: SearchStage = SearchStage.TWIN
    round: int = 0
    screened: list[str] = field(default_factory=list)
    fitted: list[str] = field(default_factory=list)
    missed: list[Missed] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    quick: bool = False

    def enter(self, stage: SearchStage, number: int = 0) -> None:
        """A stage begins, of a round or (0) outside them."""
        self.stage, self.round = stage, number

    def note(self, sentence: str) -> None:
        """Note a finding of the search that no effect's numbers contain."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def left_out(self, stage: SearchStage, number: int = 0) -> None:
        """Note that a quick search skips a stage: what nobody asked for decides no verdict."""
        self.enter(stage, number)
        self.miss(QUICK, decides=False)

    def unfinished(self, stage: SearchStage, number: int) -> set[str]:
        """The effects that a stage of a round did not come to."""
        return {m.subject for m in self.missed if (m.stage, m.round) == (stage, number)} - {""}

    def miss(self, failure: Failure, *subjects: str, decides: bool = True) -> None:
        """Note that the present stage failed, as a whole or for these effects."""
        for subject in subjects or ("",):
            entry = Missed(
                self.stage, self.round, subject, failure.reason, failure.out_of_budget, decides
            )
            if entry not in self.missed:
                self.missed.append(entry)

    def results(
        self, subjects: Sequence[str], found: Iterable[_Result | Failure]
    ) -> list[tuple[str, _Result]]:
        """The subjects that came to a result; those that came to none are noted."""
        pairs = list(zip(subjects, found, strict=True))
        kept = [(s, result) for s, result in pairs if not isinstance(result, Failure)]
        known = {subject for subject, _ in kept}
        for subject, result in pairs:
            if isinstance(result, Failure) and subject not in known:
                self.miss(result, subject)
        return kept

    def closed(self) -> SearchRecord:
        """What was examined, each effect once."""
        screened, fitted = (tuple(dict.fromkeys(ids)) for ids in (self.screened, self.fitted))
        return SearchRecord(screened, fitted, tuple(self.missed), tuple(self.notes))


QUICK = Failure("left out by --quick")

__all__ = [
    "EVALUATIONS",
    "QUICK",
    "Missed",
    "Recorder",
    "SearchRecord",
    "SearchStage",
    "UnexplainedReason",
    "bounded",
    "stage_text",
    "why_unexplained",
]
