"""What tests left out say of a part tested alone, as a diagnosis' evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.diagnosis.bench import pictures
from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.selection import Addition, Selection
from sysid.diagnosis.bench.unexplained import MOST_CURVES, BinnedResidual
from sysid.diagnosis.evidence import ComponentEvidence
from sysid.diagnosis.search import Round, Tried, mark_removed
from sysid.diagnosis.search_record import SearchRecord
from sysid.diagnosis.thresholds import LEAST_REDUCTION, SIGNIFICANCE
from sysid.estimation.linear import Estimate
from sysid.io.motion import LINEAR
from sysid.parameters import Bundle
from sysid.plant.effects.entry import CatalogueEffect


@dataclass(frozen=True)
class HeldOutEvidence(ComponentEvidence):
    """A selection of a part's effects; `curves` over every regressor, the strongest first.

    `given`: the bundle's law, before; `outside`: the part on held-out tests, None without any.
    """

    component: str
    selection: Selection
    curves: tuple[BinnedResidual, ...]
    given: Law
    outside: Component | None = None

    @property
    def steps(self) -> Sequence[Addition]:
        return self.selection.additions

    @property
    def rounds(self) -> tuple[Round, ...]:
        return self.selection.rounds

    @property
    def record(self) -> SearchRecord:
        return self.selection.record

    @property
    def is_linear(self) -> bool:
        return self.selection.final.component.channel == LINEAR.effort_channel

    @property
    def effects(self) -> Sequence[CatalogueEffect]:
        return self.selection.final.law.effects

    @property
    def own_columns(self) -> Mapping[str, str]:
        return self.selection.final.component.own_columns

    @property
    def own_effects(self) -> Sequence[type[CatalogueEffect]]:
        return self.selection.final.component.effects({}) if self.own_columns else ()

    def estimates(self, place: int) -> dict[str, Estimate]:
        return self.selection.final.estimates(self.effects[place])

    def rounds_shown(self) -> list[dict[str, Any]]:
        """A suspect: `id`, `gain` (share of the error of tests left out), `p_value`, `fate`."""
        shown = [
            {
                "added": None if one.added is None else one.added.id,
                "removed": list(one.removed),
                "suspects": [{**tried.to_json(), "fate": _fate(tried, one)} for tried in one.tried],
            }
            for one in self.rounds
        ]
        mark_removed(shown)
        return shown

    def figures(self) -> dict[str, Any]:
        """`curves`: mean residual over a regressor, before and after, in the channel's unit.

        `shows`: what each effect adds; `over`, `tests` (of `use`): the signal, measured and
        modelled, over regressors and along tests (`sysid.diagnosis.bench.pictures`).
        `law`: the law's parameters; `refitted`: those from what to what.
        """
        final = self.selection.final
        part, law = final.component, final.law
        own = {"own": dict(part.own_columns)}
        return {
            "curves": [c.shown() | own for c in self._drawn()],
            "law": [p.name for p in part.parameters()],
            **pictures.drawn(part, self.outside, self.given, law),
            "shows": [shown | own for shown in pictures.influences(part, law)],
            "refitted": self._refitted(),
        }

    def _drawn(self) -> list[BinnedResidual]:
        """Over the regressors along which the effects change the residual most.

        Without effects, over those that it depends on most.
        """
        if not self.steps:
            return list(self.curves[:MOST_CURVES])
        return sorted(self.curves, key=lambda curve: -curve.removed)[:MOST_CURVES]

    def _refitted(self) -> list[dict[str, Any]]:
        """The law's own parameters, estimated again together with the effects: before and after."""
        if not self.steps:
            return []
        return [
            {
                "name": name,
                "before": float(self.given.values[name]),
                "after": float(estimate.value),
                "std": float(estimate.std),
                "unit": estimate.unit,
            }
            for name, estimate in self.selection.final.base_estimates().items()
            if estimate.identified and name in self.given.values
        ]

    def with_base(self, bundle: Bundle) -> Bundle:
        """The part's law as it was fitted together with the effects."""
        final = self.selection.final
        return final.component.renewed(bundle, final.base_estimates(), final.quality())

    def to_json(self) -> dict[str, Any]:
        """Curves, the effects that parts of the tests name though all of them do not, and the use
        of the tests that the errors are of: training tests were excluded from the fit in turn."""
        return {
            "judged_on": "holdout" if self.outside is not None else "fit",
            "undecided": [{"id": u.id, **u.to_json()} for u in self.selection.undecided],
            "curves": [curve.to_json() for curve in self.curves[:MOST_CURVES]],
        }


def _fate(tried: Tried, one: Round) -> str:
    """Why an effect was added or not, in words."""
    if one.added is not None and tried.id == one.added.id:
        return "added"
    if tried.p_value * len(one.tried) >= SIGNIFICANCE:
        return f"the best of {len(one.tried)} fits as well by chance"
    if tried.reduction <= LEAST_REDUCTION:
        return "does not predict excluded tests well enough"
    if one.added is not None and tried.id in one.added.ambiguous:
        return f"indistinguishable from {one.added.id} in these tests"
    if one.added is not None:
        return f"predicts less well than {one.added.id}, or as well with more numbers"
    return "predicts too few of the tests better, or too many effects were added"


__all__ = ["HeldOutEvidence"]
