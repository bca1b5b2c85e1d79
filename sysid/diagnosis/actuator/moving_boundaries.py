"""Effects that may move a valve's choked boundary, and how far (`choked_boundaries`)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from sysid.diagnosis.actuator.equation_error import BALANCES, EFFORT
from sysid.diagnosis.actuator.screening import Projected, best_by_effect, screen
from sysid.diagnosis.actuator.signatures import Candidate
from sysid.diagnosis.looked import Book
from sysid.model.effects.entry import CatalogueEffect
from sysid.model.ports import overrides

# A balance whose mean whitened square is larger holds more than noise.
_MORE_THAN_NOISE = 1.5
# Whitened squares that an effect which moves a boundary explains: more than noise may, and this
# share of all, which another effect's seldom leave to it.
_CLEAR_GAIN, _CLEAR_SHARE = 500.0, 0.02
# A boundary may be so many times as far off as the effect is estimated, or is usual.
_WIDER, _MOST_USUAL = 1.5, 3.0


def moving_boundaries(bare: Projected, forms: Iterable[Candidate]) -> tuple[CatalogueEffect, ...]:
    """Effects that may move a choked boundary in these logs, each as far as it may move it.

    Of those that move it one way, the ones that explain a clear part of the balances; none where
    these hold no more than noise.
    """
    frame = bare.frame
    rates = [name for name in BALANCES if name != EFFORT]
    squares = [bare.rest[frame.rows(name)] ** 2 for name in rates]
    if not any(len(own) and float(np.mean(own)) > _MORE_THAN_NOISE for own in squares):
        return ()
    least = max(_CLEAR_GAIN, _CLEAR_SHARE * sum(float(np.sum(own)) for own in squares))
    moving = [form for form in forms if _moves_one_way(form.neutral())]
    # Not in the search's book: what cannot be screened here it comes to itself.
    best = best_by_effect(screen(bare, moving, Book()))
    return tuple(
        _as_far_as_it_may(found.candidate.with_strengths(list(found.coefficients)))
        for found in best.values()
        if found.gain > least
    )


def _moves_one_way(effect: CatalogueEffect) -> bool:
    """Whether an effect moves a boundary, and always to the same side; without a state, which
    costs more to follow and moves it less far.
    """
    moves = overrides(effect, "supply_pressure", "exhaust_pressure") and not effect.states
    return moves and all(q.lower >= 0.0 for q in type(effect).strengths())


def _as_far_as_it_may(effect: CatalogueEffect) -> CatalogueEffect:
    """The effect with strengths of usual size, or as estimated, and more."""
    sizes = {}
    for q in type(effect).strengths():
        usual, own = abs(q.typical), abs(float(getattr(effect, q.name)))
        sizes[q.name] = min(_WIDER * min(max(own, usual), _MOST_USUAL * usual), q.upper)
    return replace(effect, **sizes)  # type: ignore[type-var]


__all__ = ["moving_boundaries"]
