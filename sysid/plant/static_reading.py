"""Static friction as the bench reads it: in the commanded effort of the motor.

A ramp of the motor's effort ends where the shaft breaks away, and the effort commanded then is
taken for static friction (thesis 3.4.2). Where a motor gives another effort than commanded, static
friction is what it gave.
"""

from __future__ import annotations

import numpy as np

from sysid.plant import base, plant
from sysid.plant.ports import Model, Point, overrides

# Ramps begin anywhere in this share of the stroke, within a turn where it has none.
_SHARE, _PLACES, _TURN = 0.8, 9, 2.0 * np.pi


def static_ratio(model: Model, commanded: float) -> float:
    """The motor's effort at breakaway over the commanded effort in excess of gravity's, -.

    `commanded`: the commanded effort, Nm or N, above 0. The mean over both directions and over the
    stroke, as over a bench's tests; 1 for a motor that delivers its command. The states of an
    effect are in equilibrium in a slow ramp.
    """
    effects = tuple(e for e in model.effects if overrides(e, "motor_effort") and not e.states)
    if not effects or not commanded > 0.0:
        return 1.0
    p = model.parameters
    way = 0.5 * _SHARE * min(float(p.stroke) / float(p.pitch_radius), _TURN)
    places, direction = np.meshgrid(np.linspace(-way, way, _PLACES), (-1.0, 1.0))
    load = np.asarray(base.load_effort(places, p))
    point = Point.at_rest(
        p, np.zeros_like(places), position=places, motor=load + direction * commanded
    )
    given, as_commanded = (
        np.asarray(plant.motor_effort(point, Model(p, e))) for e in (effects, ())
    )
    return 1.0 + float(np.mean(direction * (given - as_commanded))) / commanded


def as_read(before: Model, after: Model) -> Model:
    """A model with other effects, and static friction as the same bench reading has it with them.

    `before` has the effects with which its own static friction is what the reading says.
    """
    static = float(before.parameters.static_effort)
    ratio = static_ratio(after, static) / static_ratio(before, static)
    return Model(after.parameters.replace(static_effort=static * ratio), after.effects)


__all__ = ["as_read", "static_ratio"]
