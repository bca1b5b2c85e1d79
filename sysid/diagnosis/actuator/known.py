"""What a search worked out that the next one, without some of its effects, need not again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from sysid.diagnosis.actuator.refit import Refit
from sysid.diagnosis.actuator.screening import Explained, Projected
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.types import FloatArray

_Residual = tuple[Model, float]


@dataclass
class Known:
    """Results on the same logs, twins and rows, keyed by all else that they depend on.

    `gains` on the twins, by effect; of each residual (its model, and the scatter by which its
    friction is weighed) the forms `screened`, and the effects `fitted`, by effect.
    """

    gains: dict[str, FloatArray] = field(default_factory=dict)
    screened: dict[_Residual, dict[str, list[Explained]]] = field(default_factory=dict)
    fitted: dict[_Residual, dict[str, Refit]] = field(default_factory=dict)

    def all_screened(
        self,
        base: Projected,
        names: Iterable[str],
        screen: Callable[[Sequence[str]], Iterable[Explained]],
    ) -> list[Explained]:
        """The forms of these effects on a residual; `screen` is asked for those not known."""
        known = self.screened.setdefault((base.model, base.frame.scatter), {})
        wanted = list(dict.fromkeys(names))
        for one in screen([name for name in wanted if name not in known]):
            known.setdefault(one.candidate.id, []).append(one)
        return [one for name in wanted for one in known.get(name, ())]

    def all_fitted(
        self,
        base: Projected,
        names: Sequence[str],
        fit: Callable[[Sequence[str]], Iterable[Refit]],
    ) -> list[Refit]:
        """These effects fitted to a residual; `fit` is asked for those not known."""
        known = self.fitted.setdefault((base.model, base.frame.scatter), {})
        known.update((one.id, one) for one in fit([name for name in names if name not in known]))
        return [known[name] for name in names if name in known]


Earlier = dict[tuple[CatalogueEffect, ...], Known]
"""What earlier searches know, by the effects that may move a choked boundary: by their rows."""

__all__ = ["Earlier", "Known"]
