"""What a diagnosis rests on: one strategy a kind of component, and the verdict from any of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.diagnosis.found import BeforeAfter, FoundEffect
from sysid.diagnosis.search import Round, Step
from sysid.diagnosis.search_record import SearchRecord
from sysid.estimation.linear import Estimate
from sysid.parameters import Bundle
from sysid.plant.effects.entry import CatalogueEffect, Quantity

if TYPE_CHECKING:
    from sysid.refinement.prior import BenchRows


class ComponentEvidence(ABC):
    """How the effects of a component were found: by twins, or by leave-one-test-out prediction."""

    component: str
    """The component's name: `ACTUATOR`, or the kind of test of a part."""

    @property
    @abstractmethod
    def steps(self) -> Sequence[Step]:
        """The effects in the model, in the order in which they were added."""

    @property
    @abstractmethod
    def rounds(self) -> tuple[Round, ...]:
        """What each round tried, the last of which added nothing."""

    @property
    @abstractmethod
    def record(self) -> SearchRecord:
        """What was examined, and what was not: as the budget ended, or as it failed."""

    @property
    def is_linear(self) -> bool:
        """Whether effects are named by forces and positions, as a linear rig has them."""
        return False

    @property
    def own_columns(self) -> Mapping[str, str]:
        """The units by name of the columns of a user's own component; of others empty."""
        return {}

    @property
    def own_effects(self) -> Sequence[type[CatalogueEffect]]:
        """The terms that a user's own component may lack; of others none."""
        return ()

    @property
    @abstractmethod
    def effects(self) -> Sequence[CatalogueEffect]:
        """The steps' effects, all fitted together."""

    @abstractmethod
    def estimates(self, place: int) -> dict[str, Estimate]:
        """An effect's numbers by field."""

    def plain(self, place: int) -> tuple[Quantity, ...]:
        """The shapes of an effect that are known to be those of its plain form."""
        return ()

    @abstractmethod
    def rounds_shown(self) -> list[dict[str, Any]]:
        """Each round for a report: `added`, and `suspects` with their `fate`, in JSON types."""

    @abstractmethod
    def figures(self) -> dict[str, Any]:
        """The numbers behind a report's figures, in JSON types; `curves` at least."""

    @abstractmethod
    def with_base(self, bundle: Bundle) -> Bundle:
        """A bundle with the base model's parameters as they were fitted with the effects."""

    def bench_rows(self) -> BenchRows | None:
        """What bench tests say of friction next to the effects; None: nothing."""
        return None

    def to_json(self) -> dict[str, Any]:
        """What `sysid diagnose --json` prints of this kind of evidence only."""
        return {}

    @property
    def rejected(self) -> tuple[Any, ...]:
        """What the last round tried."""
        return self.rounds[-1].tried

    def found(self, errors: Sequence[Mapping[str, float]]) -> tuple[FoundEffect, ...]:
        """The effects with the improvement by each; `errors` by channel: before, then by step."""
        return tuple(
            FoundEffect(
                effect=self.effects[place],
                estimates=self.estimates(place),
                p_value=step.p_value,
                share=step.share,
                holdout=_before_after(errors[place], errors[place + 1]),
                ambiguous_with=step.ambiguous,
                advice=type(step.effect).tie_breaker if step.is_ambiguous else "",
                suspects=step.tried,
                repeats=step.parts_named,
            )
            for place, step in enumerate(self.steps)
        )


def _before_after(
    before: Mapping[str, float], after: Mapping[str, float]
) -> dict[str, BeforeAfter]:
    """By channel, where both are known."""
    return {
        name: BeforeAfter(before[name], after[name])
        for name in before
        if np.isfinite([before[name], after[name]]).all()
    }


def residual(
    errors: Sequence[Mapping[str, float]], floors: Mapping[str, float]
) -> dict[str, BeforeAfter]:
    """RMSE on held-out tests by channel, before, after and of a correct model, where known."""
    return {
        name: BeforeAfter(errors[0][name], errors[-1][name], floors[name])
        for name in errors[0]
        if np.isfinite([errors[0][name], errors[-1][name], floors[name]]).all()
    }


__all__ = ["ComponentEvidence", "residual"]
