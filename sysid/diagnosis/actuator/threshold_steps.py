"""What acts in steps: where it fits, and the sizes that the balances cannot tell apart.

A dead time forgets the pulses that are shorter; between one length that was commanded and the next
nothing changes, so that a slope says nothing, or what the step of a difference met by chance.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from sysid.diagnosis.actuator.equation_error import channels_of
from sysid.diagnosis.actuator.projection import Projected
from sysid.diagnosis.actuator.refit import THRESHOLD_STEP, Refit
from sysid.estimation.linear import Estimate
from sysid.plant.effects.entry import NEARBY, CatalogueEffect, Quantity
from sysid.plant.ports import Model
from sysid.types import FloatArray

# Rise of the whitened squares, over their mean, at the ends of a 95 % interval of one number.
_RISE = 3.84
# The first step from a size, of it; and how closely an end is found, of its distance.
_FIRST_STEP, _CLOSELY = 1e-4, 1e-3
# How many sizes are tried around one of a grid, and around one at which an effect jumps.
_TRIED, _TRIED_OF_JUMP = 57, 15
# Sums of squares that differ by less are the same.
_ALIKE = 1e-6


def best_near(effect: CatalogueEffect, base: Projected) -> CatalogueEffect:
    """An effect with its threshold where the balances are smallest, near the size that it has."""
    name = next(q.name for q in type(effect).strengths() if q.is_threshold)
    return _best(effect, base, name, np.geomspace(1.0 / NEARBY, NEARBY, _TRIED))


def best_jump(
    effect: CatalogueEffect, base: Projected, most: float = 1.0 + THRESHOLD_STEP
) -> CatalogueEffect | None:
    """An effect with the shape at which it jumps where the balances are smallest, within a factor
    of `most`, the step by which its slope is taken; None: it has none."""
    name = next((q.name for q in type(effect).shapes() if q.jumps), None)
    if name is None or not getattr(effect, name):
        return None
    return _best(effect, base, name, np.geomspace(1.0 / most, most, _TRIED_OF_JUMP))


def _best(
    effect: CatalogueEffect, base: Projected, name: str, factors: FloatArray
) -> CatalogueEffect:
    """The effect with one of its numbers times the factor (n,) by which the balances are least."""
    channels = channels_of(effect, base.model.effects)
    sizes = float(getattr(effect, name)) * factors
    forms = [dataclasses.replace(effect, **{name: float(size)}) for size in sizes]  # type: ignore[type-var]
    found = [squares_in(base, base.model + form, channels) for form in forms]
    # In the middle of those that are alike.
    alike = np.flatnonzero(np.array(found) <= min(found) * (1.0 + _ALIKE))
    return forms[int(alike[len(alike) // 2])]


def with_steps(
    estimate: Estimate, quantity: Quantity, base: Projected, model: Model, joint: Refit, place: int
) -> Estimate:
    """A threshold's estimate, at least as wide as the sizes between which the balances cannot tell.

    Of the effect at `place` of those fitted together in `model`; all other numbers stay as they
    are.
    """
    if not estimate.identified:
        return estimate
    effects, count = list(model.effects), len(base.model.effects)
    effect = effects[count + place]
    channels = channels_of(effect, model.effects)
    scale = max(float(joint.rest @ joint.rest) / len(joint.rest), 1.0)
    size, limit = float(estimate.value), _RISE * scale

    def squares(value: float) -> float:
        effects[count + place] = dataclasses.replace(effect, **{quantity.name: value})  # type: ignore[type-var]
        return squares_in(base, Model(model.parameters, tuple(effects)), channels)

    most = squares(size) + limit

    def end(way: float, bound: float) -> float:
        def excess(distance: float) -> float:
            return squares(size + way * distance) - most

        return size + way * _first_root(excess, _FIRST_STEP * size, abs(bound - size))

    ends = end(-1.0, quantity.lower), end(1.0, quantity.upper)
    low, high = (
        _wider(own, end, way)
        for own, end, way in zip(estimate.interval, ends, (min, max), strict=True)
    )
    std = max(
        estimate.std if math.isfinite(estimate.std) else 0.0, (ends[1] - ends[0]) / math.sqrt(12.0)
    )
    return Estimate(size, std, estimate.unit, (low, high))


def _first_root(excess: Callable[[float], float], guess: float, room: float) -> float:
    """Distance at which `excess` (negative at 0) turns positive; `room` where it never does.

    It is looked for from the distance `guess` on.
    """
    from scipy import optimize

    near, far = 0.0, min(guess, room)
    for _ in range(40):
        if excess(far) > 0.0:
            return float(optimize.brentq(excess, near, far, rtol=_CLOSELY))
        if far >= room:
            return room
        near, far = far, min(1.5 * far, room)
    return math.inf if math.isinf(room) else room


def _wider(own: float, end: float, which: Callable[[float, float], float]) -> float:
    return which(own, end) if math.isfinite(own) else end


def squares_in(base: Projected, model: Model, channels: tuple[str, ...]) -> float:
    """Sum of the whitened squares of a model in these channels."""
    rest = base.frame.residual(model, channels)[base.frame.belongs(channels)]
    return float(rest @ rest)


__all__ = ["best_jump", "best_near", "squares_in", "with_steps"]
