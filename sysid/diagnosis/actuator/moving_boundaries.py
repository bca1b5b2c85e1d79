"""Effects that may move a valve's choked boundary, and how far (`choked_boundaries`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.actuator.equation_error import CHANNELS, RATES
from sysid.diagnosis.actuator.misfit import ResidualChannel
from sysid.diagnosis.actuator.projection import Projected, channel_squares
from sysid.diagnosis.actuator.screened import screened
from sysid.diagnosis.actuator.signatures import Candidate
from sysid.diagnosis.search_record import Recorder
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import overrides
from sysid.types import FloatArray

_RATES = [CHANNELS.index(name) for name in RATES]
# A balance whose mean whitened square is larger holds more than noise.
_MORE_THAN_NOISE = 1.5
# Whitened squares of a balance that an effect which moves a boundary explains: more than noise may,
# and this share of all, which another effect's seldom leave to it.
_CLEAR_GAIN, _CLEAR_SHARE = 500.0, 0.02
# A boundary may be so many times as far off as the effect is estimated, or is usual.
_WIDER, _MOST_USUAL = 1.5, 3.0


def moving_boundaries(
    bare: Projected,
    forms: Iterable[Candidate],
    away: Callable[[Sequence[CatalogueEffect]], Projected],
) -> tuple[CatalogueEffect, ...]:
    """Effects that may move a choked boundary in these logs, each as far as it may move it.

    Those that explain a clear part of a chamber's balance, whatever the other lacks, and of those
    that move it both ways, as a wave does that may imitate any, the one that explains most; none
    where there is no more than noise.

    `away` gives the residual of the samples away from where effects may take a boundary. Next to
    one that has moved the base law jumps by far more than what moved it explains elsewhere, and
    nothing follows that.
    """
    if not _holds_more_than_noise(bare):
        return ()
    moving = [form for form in forms if _moves(form.neutral())]
    if not moving:
        return ()
    usual = dict.fromkeys(effect for form in moving if _is_one_way(effect := form.neutral()))
    clear = away([far for effect in usual for far in _as_far_as_it_may(effect)])
    none = channel_squares(clear, clear.rest)
    least = np.maximum(_CLEAR_GAIN, _CLEAR_SHARE * none[_RATES])
    white = tuple(ResidualChannel.of_noise(len(clear.frame.windows[name])) for name in CHANNELS)
    # Not in the search's recorder: what cannot be screened here it comes to itself.
    some = screened(clear, moving, white, Recorder())
    best: dict[str, tuple[float, bool, CatalogueEffect]] = {}
    for one in some.columns.proposals([(f,) for f in range(len(some.forms))]):
        (effect,), explained = some.effects(one), none - one.squares
        reduction, is_clear = float(np.sum(explained)), bool(np.any(explained[_RATES] > least))
        if effect.id not in best or reduction > best[effect.id][0]:
            best[effect.id] = reduction, is_clear, effect
    most = max((reduction for reduction, _, _ in best.values()), default=0.0)
    return tuple(
        far
        for reduction, is_clear, effect in best.values()
        if is_clear and (_is_one_way(effect) or reduction == most)
        for far in _as_far_as_it_may(effect)
    )


def _holds_more_than_noise(base: Projected) -> bool:
    """Whether a chamber's balance does."""
    balances = (base.rest[base.frame.rows(name)] for name in RATES)
    return any(float(np.mean(own**2)) > _MORE_THAN_NOISE for own in balances if len(own))


def _moves(effect: CatalogueEffect) -> bool:
    """Whether an effect moves a boundary; without a state, which costs more to follow and moves it
    less far.
    """
    return overrides(effect, "supply_pressure", "exhaust_pressure") and not effect.states


def _is_one_way(effect: CatalogueEffect) -> bool:
    """Whether a moved boundary is always to the same side."""
    return all(q.lower >= 0.0 for q in type(effect).strengths())


def _as_far_as_it_may(effect: CatalogueEffect) -> list[CatalogueEffect]:
    """The effect with strengths as estimated, and more.

    Of usual size at least, where it moves a boundary one way. Where it moves it both ways, to
    either side and by each of its strengths alone: of a wave, whatever its phase is at a time.
    """
    strengths = type(effect).strengths()
    usual = np.array([abs(q.typical) for q in strengths])
    own = np.abs([float(getattr(effect, q.name)) for q in strengths])
    if _is_one_way(effect):
        return [_with(effect, _WIDER * np.clip(own, usual, _MOST_USUAL * usual))]
    size = _WIDER * min(float(np.linalg.norm(own / usual)), _MOST_USUAL)
    alone = np.diag(size * usual)
    return [_with(effect, sign * row) for row in alone for sign in (1.0, -1.0)]


def _with(effect: CatalogueEffect, strengths: FloatArray) -> CatalogueEffect:
    """The effect with these strengths, within their range."""
    pairs = zip(type(effect).strengths(), strengths, strict=True)
    sizes = {q.name: float(np.clip(value, q.lower, q.upper)) for q, value in pairs}
    return replace(effect, **sizes)  # type: ignore[type-var]


__all__ = ["moving_boundaries"]
