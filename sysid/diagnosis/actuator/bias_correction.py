"""Correction of the bias that the equation error's approximations put into the numbers.

Smoothing, windows and undoing the sensors bias the estimates a little. Twins of the extended
model, whose numbers are known, go through the same steps; the deviation of their estimates
is subtracted (indirect inference: Gourieroux, Monfort, Renault 1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.actuator.refit import linear_step, own_columns, reaching_columns
from sysid.diagnosis.actuator.search import Search
from sysid.diagnosis.actuator.signatures import base_parameters
from sysid.diagnosis.actuator.whitening import Frame
from sysid.plant.effects.entry import with_values
from sysid.plant.ports import Model
from sysid.plant.static_reading import as_read
from sysid.types import FloatArray

# A correction beyond this share of a number means that the twins' fits went elsewhere.
_MOST_CORRECTION = 0.3


def corrected(search: Search, twins: Sequence[Frame]) -> Search:
    """The search with its effects' and base parameters' numbers corrected by twins' frames.

    `twins` are of the extended model as the search left it. A number whose twins deviate
    widely is not corrected.
    """
    if search.joint is None or not twins:
        return search
    joint, parameters = search.joint, search.model.parameters
    given = search.first.model.effects
    names = base_parameters(search.model)
    count = sum(len(type(e).quantities) for e in joint.effects)
    fitted = joint.fit.values[:count]
    moves = np.mean([_move(search, frame, count) for frame in twins], axis=0)
    moved = _trusted(moves[:count], np.abs(fitted))
    own = joint.fit.parameters[:count]
    lower, upper = np.array([p.lower for p in own]), np.array([p.upper for p in own])
    values = np.clip(fitted - moved, lower, upper)
    relative = _trusted(moves[count:], np.ones(len(names)))
    changes = {
        n: float(getattr(parameters, n)) * (1.0 - r) for n, r in zip(names, relative, strict=True)
    }
    found = with_values(joint.effects, values)
    model = Model(parameters.replace(**changes), (*given, *found))
    model = as_read(search.first.model, model)
    steps = (*search.steps[:-1], replace(search.steps[-1], model=model))
    fit = replace(joint.fit, values=np.concatenate((values, joint.fit.values[count:])))
    return replace(search, steps=steps, model=model, joint=replace(joint, effects=found, fit=fit))


def _move(search: Search, frame: Frame, count: int) -> FloatArray:
    """How far a fit to a twin of the model would move: effects' numbers, base parameters' shares.

    One linear step: the twin is the model's own. `count`: the effects' numbers.
    """
    residual = frame.residual(search.model)
    own = own_columns(frame, search.model)[:, -count:]
    assert search.joint is not None
    base = reaching_columns(search.first, frame, search.model, residual)
    return linear_step(np.hstack([own, base]), residual)


def _trusted(moves: FloatArray, sizes: FloatArray) -> FloatArray:
    return np.asarray(np.where(np.abs(moves) <= _MOST_CORRECTION * sizes, moves, 0.0))
