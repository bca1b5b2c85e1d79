"""Where the shaft breaks away from rest, slowly enough that its effort then can be read.

The balances leave rests out. What acts on static friction alone shows here: one reading each
time that the shaft begins to move, of the effort that it took.
"""

from __future__ import annotations

import numpy as np

from sysid import signals
from sysid.diagnosis.actuator.samples import Rows, TestRun, Traces, Windows, is_slow
from sysid.diagnosis.actuator.states import point_of
from sysid.plant import plant
from sysid.plant.ports import Model
from sysid.types import BoolArray, FloatArray

# At least so long at rest, and then in motion, as it is on the reference rig.
_REST_S, _MOTION_S = 0.03, 0.02
# So much at either end of a rest is not counted as calm.
_EDGE_S = 0.15 * _REST_S
# The shaft is at rest up to this share of the way that it goes in `_MOTION_S`, or so many times
# the position's spread at rest.
_WAY_SHARE, _SPREADS = 0.02, 6.0
# The effort that broke it away is the largest of this time before.
_BEFORE_S = 0.01
# It may have changed by this share of static friction meanwhile: else the instant matters.
_MOST_CHANGE = 0.15
# Below this share of sliding friction nothing breaks away, and something else has moved.
_LEAST_EFFORT = 0.9


def breakaways(traces: Traces, model: Model, usable: BoolArray) -> Windows:
    """The rows (m,) at which the shaft breaks away, as windows of one row each.

    Only after a rest that follows motion in its own test (how long it had rested before a log,
    nobody knows), where all rows are `usable` (n,).
    """
    from scipy.sparse import csr_array

    applied = np.asarray(plant.applied_effort(point_of(traces, model), Model(model.parameters)))
    p = model.parameters
    limits = _LEAST_EFFORT * float(p.coulomb_effort), _MOST_CHANGE * float(p.static_effort)
    slow = is_slow(traces.runs, traces.velocity)
    rows, of_run = [], []
    for index, run in enumerate(traces.runs):
        if not run.moves:
            continue
        for rest in signals.runs(slow[run.rows]):
            row = _reading(traces, applied, usable, run, rest, limits)
            if row is not None:
                rows.append(row)
                of_run.append(index)
    count = len(rows)
    place = np.arange(count, dtype=np.intp)
    chosen = np.array(rows, dtype=np.intp)
    matrix = csr_array((np.ones(count), (place, place)), shape=(count, count))
    return Windows(matrix, Rows(chosen), np.array(of_run, dtype=np.intp), place, chosen)


def rest_before(traces: Traces) -> FloatArray:
    """How long the shaft has been at rest, s (n,), since it moved or its test began."""
    found = np.empty(len(traces))
    for run in traces.runs:
        time, moves = traces.time[run.rows], traces.direction[run.rows] != 0.0
        found[run.rows] = time - np.maximum.accumulate(np.where(moves, time, time[0]))
    return found


def _reading(
    traces: Traces,
    applied: FloatArray,
    usable: BoolArray,
    run: TestRun,
    rest: tuple[int, int],
    limits: tuple[float, float],
) -> int | None:
    """The row of the effort that ended a rest; None where it cannot be read.

    `rest`: its first row in the test, and the first of motion. `limits`: the least effort, and its
    largest change just before, Nm or N.
    """
    (first, stop), (least_effort, most_change) = rest, limits
    before, way = run.count(_BEFORE_S), run.count(_MOTION_S)
    calm = run.count(_EDGE_S)
    last = stop - 1
    end = run.rows.stop - run.rows.start
    if first == 0 or stop == end:
        return None
    rested, least_rest = (last - first) * run.period, _REST_S * run.time_scale
    if rested < least_rest or last + way >= end or first < before:
        return None
    own = slice(run.rows.start + first, run.rows.start + last + way + 1)
    if not usable[own].all():
        return None
    position, effort = traces.position[own], applied[own]
    still = position[calm : last - first - calm]
    away = position - np.median(still)
    least = max(_WAY_SHARE * abs(away[-1]), _SPREADS * float(np.std(still)))
    if abs(away[-1]) <= 2.0 * least:
        return None
    # Rows from the last that is still at rest on have left it for good.
    at = int(np.flatnonzero(np.abs(away) <= least)[-1])
    if at < 2 * before:
        return None
    pushing = np.sign(away[-1]) * effort[at - before : at + 1]
    if abs(pushing[-1] - pushing[0]) > most_change or pushing.max() < least_effort:
        return None
    return int(own.start + at - before + int(np.argmax(pushing)))


__all__ = ["breakaways", "rest_before"]
