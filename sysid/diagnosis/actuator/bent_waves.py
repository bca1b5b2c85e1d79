"""Waves that may be more than a sine: where a fit of their shape begins.

Screening tries such a shape at one value. A sine whose phase made up for a wrong frequency is a
minimum of its own, where strokes would follow the data, and so is one that follows the first
harmonic of peaks far apart.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Iterator

from sysid.diagnosis.actuator.equation_error import channels_of
from sysid.diagnosis.actuator.projection import Projected
from sysid.diagnosis.actuator.threshold_steps import squares_in
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model

# Phases that are tried: half a step is within reach of a fit.
_PHASES = 16


def bent_waves(
    first: Projected, effects: tuple[CatalogueEffect, ...], place: int
) -> Iterator[CatalogueEffect]:
    """The wave at `place` of fitted effects at the best phase, bent halfway to each limit of such a
    shape, of its own length and of twice that; none where it is no wave."""
    effect, given = effects[place], (*effects[:place], *effects[place + 1 :])
    for q in type(effect).shapes() if _has_phase(effect) else ():
        if q.is_choice or q.is_smooth or len(q.grid) != 1:
            continue
        value = float(getattr(effect, q.name))
        model = Model(first.model.parameters, (*first.model.effects, *given))
        base = dataclasses.replace(first, model=model)
        for limit in (q.lower, q.upper):
            bent = dataclasses.replace(effect, **{q.name: 0.5 * (value + limit)})  # type: ignore[type-var]
            for wave in (bent, *_twice_as_long(bent)):
                yield _best_phase(wave, base)


def _twice_as_long(effect: CatalogueEffect) -> Iterator[CatalogueEffect]:
    """A wave of half the wave number or frequency, which is the shape that is tried at several
    values; none where that is out of its range."""
    for q in type(effect).shapes():
        half = 0.5 * float(getattr(effect, q.name))
        if not q.is_choice and len(q.grid) > 1 and half >= q.lower:
            yield dataclasses.replace(effect, **{q.name: half})  # type: ignore[type-var]


def _has_phase(effect: CatalogueEffect) -> bool:
    """Whether an effect's two strengths are a wave's sine and cosine: of one unit, and of one range
    to either side of 0."""
    strengths = type(effect).strengths()
    alike = len({(q.unit, q.lower, q.upper) for q in strengths}) == 1
    return len(strengths) == 2 and alike and strengths[0].lower == -strengths[0].upper


def _best_phase(effect: CatalogueEffect, base: Projected) -> CatalogueEffect:
    """A wave at the phase of `_PHASES` with which the balances are smallest."""
    strengths = type(effect).strengths()
    sine, cosine = (float(getattr(effect, q.name)) for q in strengths)
    channels = channels_of(effect, base.model.effects)

    def turned(angle: float) -> CatalogueEffect:
        wave = complex(cosine, sine) * cmath.rect(1.0, angle)
        values = zip(strengths, (wave.imag, wave.real), strict=True)
        return dataclasses.replace(effect, **{q.name: value for q, value in values})  # type: ignore[type-var]

    forms = [turned(2.0 * math.pi * k / _PHASES) for k in range(_PHASES)]
    return min(forms, key=lambda form: squares_in(base, base.model + form, channels))


__all__ = ["bent_waves"]
