"""The result of a diagnosis: verdict, effects, errors before and after, and what was tried."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from sysid.diagnosis.looked import Because, Looked, Missed
from sysid.diagnosis.remainder import Remainder
from sysid.diagnosis.search import Tried
from sysid.diagnosis.wording import p_text
from sysid.display.tables import Shown, ShownTable, estimate_records, estimate_table
from sysid.estimation.linear import Estimate
from sysid.model.effects.entry import CatalogueEffect
from sysid.refinement.result import RefineResult

if TYPE_CHECKING:
    from sysid.diagnosis.evidence import Evidence

Verdict = Literal["adequate", "effects-found", "unexplained"]


@dataclass(frozen=True)
class BeforeAfter:
    """RMSE on the held-out logs, in the channel's unit; `noise_floor`: that of a correct model."""

    before: float
    after: float
    noise_floor: float | None = None

    def to_json(self) -> dict[str, float]:
        """The known numbers by name."""
        return {k: v for k, v in vars(self).items() if v is not None}


@dataclass(frozen=True, repr=False)
class FoundEffect(Shown):
    """An effect that was added: its numbers, its gain, and what is indistinguishable from it.

    `share`: of the residual's excess over noise on the fitted logs (of a part: of the mean square
    error of tests left out); `holdout` by channel,
    before and after this effect was added; `advice` names the test that would decide; `repeats`:
    what parts of the tests name.
    """

    effect: CatalogueEffect
    estimates: Mapping[str, Estimate]
    p_value: float
    share: float
    holdout: Mapping[str, BeforeAfter]
    ambiguous_with: tuple[str, ...]
    advice: str
    suspects: tuple[Tried, ...]
    repeats: Mapping[str, Any] | None = None

    @property
    def id(self) -> str:
        return self.effect.id

    def headline(self) -> str:
        """Its id, and the effects indistinguishable from it."""
        rivals = ", ".join(self.ambiguous_with)
        return f"{self.id}{f' (or {rivals})' if rivals else ''}, p {p_text(self.p_value)}"

    def records(self) -> list[dict[str, Any]]:
        """One row per parameter: its value, std, limits of the 95 % interval and unit."""
        return estimate_records(self.by_label(), effect=self.id)

    def tables(self) -> Iterable[ShownTable]:
        """The parameters."""
        yield estimate_table("", self.by_label())

    def by_label(self) -> dict[str, Estimate]:
        """The estimates, by the names that files and reports use."""
        labels = {q.name: q.label for q in type(self.effect).quantities}
        return {labels[name]: estimate for name, estimate in self.estimates.items()}

    def to_json(self) -> dict[str, Any]:
        """As `sysid diagnose --json` prints it (spec/cli.md)."""
        parameters: dict[str, Any] = {k: e.to_json() for k, e in self.by_label().items()}
        if type(self.effect).has_side():
            parameters["side"] = getattr(self.effect, "side")  # noqa: B009
        return {
            "id": self.id,
            "parameters": parameters,
            "p_value": self.p_value,
            "share": self.share,
            "holdout_rmse": {name: errors.to_json() for name, errors in self.holdout.items()},
            "ambiguous_with": list(self.ambiguous_with),
            "advice": self.advice,
            **({} if self.repeats is None else {"repeats": dict(self.repeats)}),
        }


@dataclass(frozen=True)
class Unexplained:
    """Remaining structure: channel (log format), regressor, share of the residual's variance."""

    channel: str
    regressor: str
    share: float

    def to_json(self) -> dict[str, Any]:
        """As `sysid diagnose --json` prints it (spec/cli.md)."""
        return {"channel": self.channel, "regressor": self.regressor, "share": self.share}


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on a campaign and a bundle, with all its evidence.

    `residual`: pooled RMSE on the held-out logs by channel. `remainder`: of the residuals after the
    last effect, how much repeats from test to test, by balance; none where that cannot be said.
    `because`: why the verdict is `unexplained`, None where it is not. `refinement`: of the numbers
    by simulation error, where they are from it; the errors after each effect are those before it.
    `not_refined`: why its numbers were not taken, empty where they were or none was asked for.
    `missed`: what was not done after the search.
    """

    verdict: Verdict
    effects: tuple[FoundEffect, ...]
    residual: Mapping[str, BeforeAfter]
    unexplained: tuple[Unexplained, ...]
    remainder: tuple[Remainder, ...]
    evidence: Evidence
    because: Because | None = None
    seed: int = 0
    refinement: RefineResult | None = None
    not_refined: str = ""
    notices: tuple[str, ...] = ()
    missed: tuple[Missed, ...] = ()

    @property
    def component(self) -> str:
        """What was diagnosed: `evidence.ACTUATOR`, or the kind of test of a part."""
        return self.evidence.component

    @property
    def looked(self) -> Looked:
        """What was looked at, and what was not: for want of time, or as it failed."""
        looked = self.evidence.looked
        return replace(looked, missed=(*looked.missed, *self.missed))

    @property
    def rejected(self) -> tuple[Tried, ...]:
        """What the last round tried, none of which was added."""
        return self.evidence.rejected

    def to_json(self) -> dict[str, Any]:
        """What `sysid diagnose --json` prints (spec/cli.md)."""
        return {
            "verdict": self.verdict,
            "component": self.component,
            "effects": [effect.to_json() for effect in self.effects],
            "residual": {name: errors.to_json() for name, errors in self.residual.items()},
            "unexplained": [entry.to_json() for entry in self.unexplained],
            "because": self.because,
            "removed": [name for one in self.evidence.rounds for name in one.removed],
            "rejected": [tried.to_json() for tried in self.rejected],
            "search": self.looked.to_json(),
            "remainder": [rest.to_json() for rest in self.remainder],
            "seed": self.seed,
            "refined": self.refinement is not None,
            "not_refined": self.not_refined,
            "notices": list(self.notices),
            **self.evidence.to_json(),
        }


__all__ = ["BeforeAfter", "Diagnosis", "FoundEffect", "Unexplained", "Verdict"]
