"""The result of a diagnosis: verdict, effects, errors before and after, and its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from sysid.diagnosis.evidence import ComponentEvidence
from sysid.diagnosis.found import BeforeAfter, FoundEffect, Verdict
from sysid.diagnosis.lack_of_fit import Remainder
from sysid.diagnosis.search import Tried
from sysid.diagnosis.search_record import (
    Missed,
    Recorder,
    SearchRecord,
    SearchStage,
    UnexplainedReason,
)
from sysid.errors import Failure
from sysid.refinement.result import RefineResult
from sysid.types import FloatArray


@dataclass(frozen=True)
class Unexplained:
    """Remaining structure: channel (log format), regressor, share of the residual's variance.

    The share is None where it is not known, as of one recording.
    """

    channel: str
    regressor: str
    share: float | None

    def to_json(self) -> dict[str, Any]:
        """As `sysid diagnose --json` prints it (`docs/reference/command-line.md`)."""
        return {"channel": self.channel, "regressor": self.regressor, "share": self.share}


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on a campaign and a bundle, with all its evidence.

    `residual`: pooled RMSE on the held-out logs by channel. `remainder`: of the residuals after the
    last effect, how much repeats from test to test, by balance; none where that cannot be said.
    `reason`: why the verdict is `unexplained`, unless it is `incomplete`.
    `refinement`: of the numbers by simulation error, where they are from it; the errors after each
    effect are those before it. `not_refined`: why its numbers were not taken, empty where they were
    or none was requested. `simulated`: errors (3,) of the training tests with these numbers, where
    a refinement computed them. `misfits`: of each of their segments by channel the RMSE over the
    noise as a refinement left it, whether its numbers were taken or not. `missed`: what was not
    done after the search. `contradicted`: ids of effects that an earlier search found but that have
    no strength in motion, and were barred from this search. `evaluations`: how many were made
    (`sysid.parallel.spend`). `trace`: a held-out test as it is drawn
    (`sysid.diagnosis.actuator.holdout.trace`), None without one.
    """

    effects: tuple[FoundEffect, ...]
    residual: Mapping[str, BeforeAfter]
    unexplained: tuple[Unexplained, ...]
    remainder: tuple[Remainder, ...]
    evidence: ComponentEvidence
    reason: UnexplainedReason | None = None
    seed: int = 0
    refinement: RefineResult | None = None
    not_refined: str = ""
    simulated: FloatArray | None = None
    misfits: FloatArray | None = None
    notices: tuple[str, ...] = ()
    missed: tuple[Missed, ...] = ()
    contradicted: tuple[str, ...] = ()
    evaluations: int = 0
    trace: Mapping[str, Any] | None = None

    @property
    def verdict(self) -> Verdict:
        """What the search says; incomplete where its budget ended first, as the stages that it did
        not reach could change the verdict."""
        if self.record.cut_short:
            return "incomplete"
        if self.reason is not None:
            return "unexplained"
        return "effects-found" if self.effects else "adequate"

    @property
    def component(self) -> str:
        """What was diagnosed: `wording.ACTUATOR`, or the kind of test of a part."""
        return self.evidence.component

    @property
    def record(self) -> SearchRecord:
        """What was examined, and what was not: as the budget ended, or as it failed."""
        record = self.evidence.record
        return replace(record, missed=(*record.missed, *self.missed))

    @property
    def rejected(self) -> tuple[Tried, ...]:
        """What the last round tried, none of which was added."""
        return self.evidence.rejected

    def with_missed(self, stage: SearchStage, why: Failure) -> Diagnosis:
        """The same, which says that a stage after the search was not done, and why."""
        recorder = Recorder(stage)
        recorder.miss(why, decides=False)
        more = recorder.closed()
        notices = (*self.notices, *more.sentences())
        return replace(self, missed=(*self.missed, *more.missed), notices=notices)

    def to_json(self) -> dict[str, Any]:
        """What `sysid diagnose --json` prints (`docs/reference/command-line.md`)."""
        return {
            "verdict": self.verdict,
            "component": self.component,
            "effects": [effect.to_json() for effect in self.effects],
            "residual": {name: errors.to_json() for name, errors in self.residual.items()},
            "unexplained": [entry.to_json() for entry in self.unexplained],
            "because": self.reason if self.verdict == "unexplained" else None,
            "not_done": [miss.not_done() for miss in self.record.cut_short],
            "removed": [
                *self.contradicted,
                *(name for one in self.evidence.rounds for name in one.removed),
            ],
            "rejected": [tried.to_json() for tried in self.rejected],
            "search": self.record.to_json(),
            "evaluations": self.evaluations,
            "remainder": [rest.to_json() for rest in self.remainder],
            "seed": self.seed,
            "refined": self.refinement is not None,
            "not_refined": self.not_refined,
            "notices": list(self.notices),
            **self.evidence.to_json(),
        }


__all__ = ["BeforeAfter", "Diagnosis", "FoundEffect", "Unexplained", "Verdict"]
