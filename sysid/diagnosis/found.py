"""An effect that was found, and errors before and after it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, estimate_records, estimate_table
from sysid.diagnosis.search import Tried
from sysid.diagnosis.wording import p_text
from sysid.estimation.linear import Estimate
from sysid.plant.effects.entry import CatalogueEffect

Verdict = Literal["adequate", "effects-found", "incomplete", "unexplained"]


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
    """An effect that was added: its numbers, what it explains, and its indistinguishable rivals.

    `share`: of the residual's excess over noise on the fitted logs (of a part: of the mean square
    error in leave-one-test-out prediction); `holdout` by channel, before and after this effect was
    added; `advice` names the test that would decide; `repeats`: what parts of the tests name.
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

    def tables(self) -> Iterable[Table]:
        """The parameters."""
        yield estimate_table("", self.by_label())

    def by_label(self) -> dict[str, Estimate]:
        """The estimates, by the names that files and reports use."""
        labels = {q.name: q.label for q in type(self.effect).quantities}
        return {labels[name]: estimate for name, estimate in self.estimates.items()}

    def to_json(self) -> dict[str, Any]:
        """As `sysid diagnose --json` prints it (`docs/reference/command-line.md`)."""
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


__all__ = ["BeforeAfter", "FoundEffect", "Verdict"]
