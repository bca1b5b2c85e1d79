"""What a fitted model lacks, and the bundle extended by it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import Panel, Rule, Scale, grouped_bars
from sysid.blocks.progress import progress_or_shown
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table
from sysid.diagnosis import content, wording
from sysid.diagnosis.campaign import extended_bundle
from sysid.diagnosis.looked import Looked
from sysid.diagnosis.result import BeforeAfter, Diagnosis, FoundEffect, Verdict
from sysid.diagnosis.tables import summary
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.pipeline.subject import subject_of
from sysid.plant.effects.catalogue import EffectSource
from sysid.types import Progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class CampaignDiagnosis(Shown):
    """The result of `diagnose`: `verdict`, `effects`, errors before and after, extended `bundle`.

    `detail` holds the evidence.
    """

    detail: Diagnosis
    bundle: Bundle
    notices: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        """ "adequate", "effects-found", "incomplete" or "unexplained"."""
        return self.detail.verdict

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """The effects that were added, in turn, each with its estimates."""
        return self.detail.effects

    @property
    def residual(self) -> Mapping[str, BeforeAfter]:
        """RMSE on the held-out logs by channel, in its unit: before, after, of a correct model."""
        return self.detail.residual

    @property
    def looked(self) -> Looked:
        """What was looked at, and what was missed: as the budget ended, or as it failed."""
        return self.detail.looked

    def headline(self) -> str:
        """The verdict in one sentence."""
        return wording.sentence(self.detail.to_json())

    def records(self) -> list[dict[str, Any]]:
        """One record per parameter of an effect: value, std, limits of the 95 % interval, unit."""
        return [record for effect in self.effects for record in effect.records()]

    def tables(self) -> Iterable[Table]:
        """The effects, their parameters, the errors on held-out logs, and what was tried."""
        return summary({**self.detail.to_json(), "figures": content.names(self.detail)})

    def footnotes(self) -> Iterable[str]:
        """What the remaining errors consist of, what to do next, and the notices."""
        found = self.detail.to_json()
        return (*wording.left(found), *wording.advice(found), *super().footnotes())

    def plot(self, ax: Axes | None = None) -> Axes:
        """RMSE on held-out logs over that of a correct model, before and after each effect."""
        found = self.detail.to_json()
        errors = wording.errors_by_step(found)
        floors = {name: self.residual[name].noise_floor or math.nan for name in errors}
        heights: dict[str, Sequence[float]] = {
            step: [errors[name][i] / floors[name] for name in errors]
            for i, step in enumerate(["original bundle", *wording.steps(found)])
        }
        shown, ticks = grouped_bars(list(errors), heights)
        y = Scale("RMSE / RMSE of a correct model", kind="log")
        panel = Panel(Scale(ticks=ticks), y, (*shown, Rule(1.0)), legend="beside")
        return plot_panels((panel,), ax)[0]

    def content(self) -> dict[str, Any]:
        """Its content as the report shows it, in JSON types."""
        return content.content(self.detail)


def diagnose(
    campaign: Campaign,
    bundle: Bundle,
    *,
    effects: EffectSource = None,
    refine: bool = True,
    seed: int = 0,
    budget: float | None = None,
    quick: bool = False,
    progress: Progress | None = None,
) -> CampaignDiagnosis:
    """What a bundle's model lacks, from a campaign's training logs; errors on held-out ones.

    `effects`: effects in addition to the catalogue's, a Python file or the classes; `refine`:
    whether all parameters are estimated together by simulation error at the end, where an actuator
    lacked something; `seed` of the simulated twins. Takes from seconds (a part tested alone) to
    minutes; `quick`: a first look in about a fifth of it. It ends after a number of
    evaluations, the same on any machine, or in its place after `budget` seconds of processor time
    (of this process and its workers), with the best so far: `verdict` is "incomplete" then, and
    `looked` says what was missed or left out. One that ends by itself finds the same whatever the
    budget. Raises InputError for logs that cannot be used or
    have changed since the fit, NotIdentifiedError where the bundle or the campaign is
    insufficient.

    >>> part = si.read_campaign("bench/campaign.toml")
    >>> found = si.diagnose(part, si.fit(part))
    >>> found.verdict, [effect.id for effect in found.effects]
    ('effects-found', ['valve-dead-band'])
    >>> sorted(found.residual["flow_a_kg_s"].to_json())
    ['after', 'before', 'noise_floor']
    """
    with progress_or_shown(progress, "diagnosing") as tell:
        options = {"effects": effects, "refine": refine, "seed": seed, "quick": quick}
        found, notices = subject_of(campaign).diagnose(bundle, budget, tell, options)
    longer = extended_bundle(bundle, found, campaign)
    said = tuple(dict.fromkeys((*notices, *found.notices)))
    return CampaignDiagnosis(found, longer, said)


__all__ = ["CampaignDiagnosis", "diagnose"]
