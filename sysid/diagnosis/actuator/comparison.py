"""How much refitted effects explain, and which of them nothing tells apart."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from sysid.diagnosis.actuator.equation_error import CHANNELS
from sysid.diagnosis.actuator.refit import Refit
from sysid.diagnosis.actuator.whitening import Frame
from sysid.plant.effects.catalogue import class_of
from sysid.plant.effects.entry import CatalogueEffect

# A smaller part of an effect's gain than this says nothing of the balance that it is in.
_SMALL_PART = 0.1
# A rival that explains almost as much as the winner is indistinguishable from it: the real form
# of an effect is seldom the catalogue's, which costs the right one as much.
RIVAL_SHARE = 0.9
CLEAR_BIC = 10.0


def relative_size(effect: CatalogueEffect) -> float:
    """The largest of an effect's strengths over its usual size."""
    strengths = type(effect).strengths()
    return max(abs(float(getattr(effect, q.name)) / q.typical) for q in strengths)


def share_of_excess(found: Refit, excess: Mapping[str, float], channels: Sequence[str]) -> float:
    """How much an effect explains of the excess over noise in these channels."""
    return found.gain / max(excess_in(channels, excess), found.gain)


def excess_in(channels: Iterable[str], excess: Mapping[str, float]) -> float:
    return sum(max(excess[channel], 0.0) for channel in channels)


def explained_channels(found: Refit, frame: Frame) -> tuple[str, ...]:
    """The channels with more than a small part of an effect's gain."""
    fell = found.before**2 - found.rest**2
    return tuple(c for c in CHANNELS if fell[frame.rows(c)].sum() > _SMALL_PART * found.gain)


def penalty(found: Refit, numbers: int | None = None) -> float:
    """BIC's penalty for so many numbers, by default the effects' own, in whitened squares."""
    own = sum(len(type(effect).fitted()) for effect in found.effects)
    return noise_scale(found) * (own if numbers is None else numbers) * math.log(len(found.rest))


def noise_scale(found: Refit) -> float:
    """Mean of the whitened squares that a fit leaves, at least 1."""
    return max(float(found.rest @ found.rest) / len(found.rest), 1.0)


def indistinguishable(winner: Refit, refits: Sequence[Refit]) -> tuple[str, ...]:
    """Members of the winner's class, and rivals that explain as much within the margins."""
    scale = noise_scale(winner)
    near = {i for i in class_of(winner.id) if i != winner.id}
    for rival in refits:
        if rival.id == winner.id:
            continue
        bic = (winner.gain - penalty(winner) - rival.gain + penalty(rival)) / scale
        if bic < CLEAR_BIC or rival.gain > RIVAL_SHARE * winner.gain:
            near.add(rival.id)
    return tuple(sorted(near))


__all__ = [
    "CLEAR_BIC",
    "RIVAL_SHARE",
    "excess_in",
    "explained_channels",
    "indistinguishable",
    "noise_scale",
    "penalty",
    "relative_size",
    "share_of_excess",
]
