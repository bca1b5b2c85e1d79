"""What a search for missing effects looked at, and what it did not come to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from sysid.parallel import Failure

_Result = TypeVar("_Result")

SECONDS = 120.0
"""Default of the time for a search; what no verdict can do without is not cut short."""


@dataclass(frozen=True)
class Missed:
    """A stage that did not end, or an effect (`subject`) that it did not come to, and why.

    `decides`: the verdict depends on it.
    """

    stage: str
    subject: str
    reason: str
    out_of_time: bool
    decides: bool = True

    def to_json(self) -> dict[str, Any]:
        """As JSON types: `stage`, `subject` (an effect's id or None), `reason`, `decides`."""
        return {
            "stage": self.stage,
            "subject": self.subject or None,
            "reason": self.reason,
            "decides": self.decides,
        }


@dataclass(frozen=True)
class Looked:
    """The effects that were screened and fitted, by id, and what was missed."""

    screened: tuple[str, ...] = ()
    fitted: tuple[str, ...] = ()
    missed: tuple[Missed, ...] = ()

    @property
    def is_complete(self) -> bool:
        return not self.missed

    @property
    def is_decided(self) -> bool:
        """Whether nothing was missed on which the verdict depends."""
        return not any(miss.decides for miss in self.missed)

    def to_json(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "complete": self.is_complete,
            "screened": list(self.screened),
            "fitted": list(self.fitted),
            "missed": [miss.to_json() for miss in self.missed],
        }

    def sentences(self) -> tuple[str, ...]:
        """Notices: what was missed, stage by stage."""
        found = []
        for stage in dict.fromkeys(miss.stage for miss in self.missed):
            own = [miss for miss in self.missed if miss.stage == stage]
            subjects = ", ".join(dict.fromkeys(m.subject for m in own if m.subject))
            reasons = "; ".join(dict.fromkeys(m.reason for m in own))
            of = f" of {subjects}" if subjects else ""
            late = any(m.out_of_time for m in own)
            mend = " (--budget allows more time)" if late else ""
            found.append(f"not done: {stage}{of}: {reasons}{mend}")
        return tuple(found)


@dataclass
class Book:
    """A `Looked` in the making."""

    stage: str = ""
    screened: list[str] = field(default_factory=list)
    fitted: list[str] = field(default_factory=list)
    missed: list[Missed] = field(default_factory=list)

    def miss(self, failure: Failure, *subjects: str, decides: bool = True) -> None:
        """Note that the present stage failed, as a whole or for these effects."""
        for subject in subjects or ("",):
            entry = Missed(self.stage, subject, failure.reason, failure.out_of_time, decides)
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

    def closed(self) -> Looked:
        """What was looked at, each effect once."""
        screened, fitted = (tuple(dict.fromkeys(ids)) for ids in (self.screened, self.fitted))
        return Looked(screened, fitted, tuple(self.missed))


LATE = Failure("out of time", out_of_time=True)

__all__ = ["LATE", "SECONDS", "Book", "Looked", "Missed"]
