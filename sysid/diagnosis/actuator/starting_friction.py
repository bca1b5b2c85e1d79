"""The sliding friction that a search begins with, where the bench's is out of a refit's reach."""

from __future__ import annotations

import numpy as np

from sysid.diagnosis.actuator.equation_error import EFFORT, FRICTION_PARAMETERS, equation_error
from sysid.diagnosis.actuator.samples import Traces
from sysid.diagnosis.actuator.whitening import sliding_windows
from sysid.plant.ports import Model

# Friction of the bench that is this many times that of motion, or less than one over it.
_FAR_OFF = 3.0
# Viscous friction over Coulomb's at a speed that is exceeded a tenth of the time.
_VISCOUS_SHARE, _FAST = 0.3, 0.9


def with_sliding_friction(traces: Traces, model: Model) -> Model:
    """The model, with Coulomb and viscous friction as motion shows them where its are far off.

    Friction tests that an effect distorts may give less than none, which a model takes for 0;
    another effect would then be found in its place, as a refit does not reach so far. Where motion
    shows no viscous friction either, it begins at a usual size, from which a refit reaches others.
    """
    view = sliding_windows(traces, model)
    error = equation_error(traces, model, (EFFORT,))[EFFORT]
    columns = view.average(np.column_stack([traces.direction, traces.velocity]))
    if len(view) <= columns.shape[1]:
        return model
    more = -np.linalg.lstsq(columns, view.average(error), rcond=None)[0]
    changes = {}
    for name, change in zip(FRICTION_PARAMETERS, more.tolist(), strict=True):
        given = float(getattr(model.parameters, name))
        shown = given + change
        if shown > 0.0 and not shown / _FAR_OFF < given < shown * _FAR_OFF:
            changes[name] = shown
    p = model.parameters.replace(**changes)
    if not float(p.viscous) > 0.0 and float(p.coulomb_effort) > 0.0:
        fast = float(np.quantile(np.abs(columns[:, 1]), _FAST))
        changes["viscous"] = _VISCOUS_SHARE * float(p.coulomb_effort) / fast
    return Model(p.replace(**changes), model.effects) if changes else model


__all__ = ["with_sliding_friction"]
