"""What the equation error's own approximations do to the numbers, taken out again.

Smoothing, windows and the sensors' undoing bias the estimates a little. Twins of the
extended model, whose numbers are known, take the same way; how far their estimates lie off
is subtracted (indirect inference: Gourieroux, Monfort, Renault 1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sysid.diagnosis.frame import Frame
from sysid.diagnosis.refit import refit, with_base_refitted, with_values
from sysid.diagnosis.screening import projected
from sysid.diagnosis.search import Search
from sysid.diagnosis.signatures import base_parameters
from sysid.model.ports import Model

FloatArray = NDArray[np.float64]

# A correction beyond this share of a number says that the twins went elsewhere.
_MOST = 0.3


def corrected(search: Search, twins: Sequence[Frame]) -> Search:
    """The search with its effects' and base parameters' numbers corrected by twins' frames.

    `twins` are of the extended model as the search left it. A number whose twins lie far off
    stays as it is.
    """
    if search.joint is None or not twins:
        return search
    joint, parameters = search.joint, search.model.parameters
    given = search.first.model.effects
    names = base_parameters(search.model)
    effects, bases = [], []
    for frame in twins:
        base = projected(frame, Model(parameters, given))
        again = refit(base, joint.effects)
        model = with_base_refitted(base, Model(parameters, (*given, *again.effects)))
        effects.append(again.fit.values - joint.fit.values)
        bases.append(
            [float(getattr(model.parameters, n) / getattr(parameters, n)) - 1.0 for n in names]
        )
    moved = _trusted(np.mean(effects, axis=0), np.abs(joint.fit.values))
    lower = np.array([p.lower for p in joint.fit.parameters])
    upper = np.array([p.upper for p in joint.fit.parameters])
    values = np.clip(joint.fit.values - moved, lower, upper)
    relative = _trusted(np.mean(bases, axis=0), np.ones(len(names)))
    changes = {
        n: float(getattr(parameters, n)) * (1.0 - r) for n, r in zip(names, relative, strict=True)
    }
    found = with_values(joint.effects, values)
    model = Model(parameters.replace(**changes), (*given, *found))
    steps = (*search.steps[:-1], replace(search.steps[-1], model=model))
    fit = replace(joint.fit, values=values)
    return replace(search, steps=steps, model=model, joint=replace(joint, effects=found, fit=fit))


def _trusted(moves: FloatArray, sizes: FloatArray) -> FloatArray:
    return np.asarray(np.where(np.abs(moves) <= _MOST * sizes, moves, 0.0))
