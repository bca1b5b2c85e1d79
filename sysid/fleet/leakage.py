"""How much a rig leaks, one number whatever the law of the leak."""

from __future__ import annotations

import math

from sysid.io.channels import SIDES
from sysid.parameters import Bundle
from sysid.parameters.effects import EffectEntry
from sysid.plant.effects.entry import Catalogue
from sysid.plant.ports import Effect, Model, Point

_WORD = "leakage"


def is_leakage(id: str) -> bool:
    """Whether an effect lets air out of a chamber past its valve, by its id."""
    return _WORD in id


def leakage_effects(bundle: Bundle) -> list[EffectEntry]:
    """The effects of a bundle that let air out of a chamber past its valve."""
    return [effect for effect in bundle.effects if is_leakage(effect.id)]


def leakage_flow(bundle: Bundle, catalogue: Catalogue | None = None) -> tuple[float, float] | None:
    """Air that a chamber at supply pressure loses past its valve, kg/s, and its standard error.

    Of both chambers the larger, the other one at atmospheric pressure. Which law a diagnosis names
    may differ from date to date, where the data cannot distinguish them; their flows compare. The
    error is that of the strengths of this chamber's leaks, in each of which the flow is linear.
    None where the bundle has no leakage, or one without an error. `catalogue` holds the bundle's
    effects (None: the project's own). Raises InputError for an effect that it lacks,
    NotIdentifiedError for a bundle without friction.
    """
    effects = leakage_effects(bundle)
    if not effects:
        return None
    model = bundle.model(catalogue=catalogue)
    leaks = [e for e in model.effects if is_leakage(getattr(e, "id", ""))]
    strengths = [next(iter(e.numbers().values())) for e in effects]
    lost = {side: [_lost(model, leak, side) for leak in leaks] for side in SIDES}
    flows = max(lost.values(), key=sum)
    own = [(flow, e) for flow, e in zip(flows, strengths, strict=True) if flow and e.value]
    if sum(flows) <= 0.0 or not own or not all(e.has_error for _, e in own):
        return None
    return sum(flows), math.hypot(*(flow * e.std / e.value for flow, e in own))


def _lost(model: Model, leak: Effect, side: str) -> float:
    """Flow (kg/s) out of a chamber at supply pressure through one leak."""
    p = model.parameters
    point = Point.at_rest(p, 0.0, **{f"pressure_{side}": p.supply})
    return -float(Model(p, (leak,)).through("chamber_flow", 0.0, side, point))


__all__ = ["is_leakage", "leakage_effects", "leakage_flow"]
