"""Whether a component's law gives numbers where its parameters start, before it is fitted."""

from __future__ import annotations

import numpy as np

from sysid.components.definition import DynamicComponent
from sysid.components.dynamic import DynamicPart
from sysid.components.parts import OwnPart
from sysid.diagnosis.bench.component import Law
from sysid.errors import InputError, input_error

_FIX = "start its parameters where the law holds, or fix the law"
_FIX_RUN = f"{_FIX}; raise substeps if it is stiff"


def check_starts(part: OwnPart) -> None:
    """InputError that names the first output, row and time where the law gives no number.

    Also for a parameter without a finite slope: the fit could not distinguish it from one without
    influence.
    """
    law = Law({p.name: p.value for p in part.parameters()})
    for trial, first, outputs in part.unbounded(law):
        far = part.is_far(outputs)
        if far.any():
            row, column = (int(i) for i in np.argwhere(far)[0])
            name, value = part.definition.outputs[column], outputs[row, column]
            verb = "simulates" if isinstance(part.definition, DynamicComponent) else "predicts"
            place = f"{trial.source}, row {first + row + 1}"
            time = f"time_s = {trial.time[first + row]:g}"
            raise _error(part, f"{verb} {name} as {value:g} at its starts ({place}, {time})")
    if isinstance(part, DynamicPart):
        names = [p.name for p in part.parameters()]
        for name, slopes in zip(names, part.slopes_of(law, names), strict=True):
            known = np.isfinite(slopes)
            if not known.all() and not np.any(slopes[known]):
                what = f"its simulation has no finite derivative by {name} at its starts"
                raise _error(part, what)


def _error(part: OwnPart, what: str) -> InputError:
    loaded = part.loaded
    where = f"{loaded.path}, class {loaded.name}" if loaded.path else f"class {loaded.name}"
    dynamic = isinstance(loaded.definition, DynamicComponent)
    return input_error(where, what, _FIX_RUN if dynamic else _FIX)


__all__ = ["check_starts"]
