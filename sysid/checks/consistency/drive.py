"""How strongly a log's motor and chambers accelerate the declared inertia, and with which sign.

inertia a = g_m motor + g_c cylinder - gravity - coulomb sign(v) - viscous v - offset, with the
inertia of the rig file, is linear in the gains g_m and g_c: both are 1 where units, time and
signs are right. A gain below zero is a sign; a time base that is f times too slow divides both
by f squared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid import signals
from sysid.balance.motion import FilteredMotion, default_cutoff
from sysid.estimation.jackknife import jackknife
from sysid.estimation.linear import t_quantile
from sysid.recording.recording import Recording
from sysid.signals import MIN_SAMPLES
from sysid.types import FloatArray

# Blocks of consecutive rows, deleted one at a time (jackknife).
_BLOCKS = 10
# Least share of the efforts of motor and chambers: below it a drive's gain is not identified.
_LEAST_SHARE = 0.03
# Least share of these efforts that accelerates the inertia: below it, friction determines the gain.
_LEAST_INERTIAL = 0.1
# R2 below which something other than the law moves the shaft, for example bouncing off a stop.
_LEAST_R2 = 0.95
# Share of the gain; a wider interval is too wide for a comparison.
_MOST_SPREAD = 0.25
# Share of the efforts' absolute power: friction takes energy out of a motion.
_TAKEN_OUT = -0.1
MOTOR, CYLINDER = "motor", "cylinder"


@dataclass(frozen=True)
class Gain:
    """The gain of one drive (`motor` or `cylinder`) in a log, with its 95 % interval."""

    drive: str
    value: float
    low: float
    high: float


def gains(trials: Sequence[Recording], inertia: float) -> list[Gain]:
    """The gains that a log's trials identify; `inertia` kg m2, or kg."""
    parts = [_rows(t) for t in trials if len(t) >= MIN_SAMPLES]
    if not parts:
        return []
    table = np.concatenate(parts)
    if len(table) < 2 * MIN_SAMPLES:  # of a shaft that hardly moves
        return []
    columns = [i for i in (0, 1) if _drives(table, i)]
    if not any(t.valves_move for t in trials):
        columns = [i for i in columns if i == 0]  # air that only breathes follows the speed
    inertial = inertia * table[:, 6]
    moved = float(np.std(table[:, :2].sum(axis=1)))
    if not columns:
        return []
    known = [(MOTOR, CYLINDER)[i] for i in columns]
    # The logged effort of a drive that hardly acts is taken as right.
    rest = [i for i in (0, 1) if i not in columns]
    target = inertial + table[:, 2] - table[:, rest].sum(axis=1)
    regressors = table[:, [*columns, 3, 4, 5]]
    values = _solve(regressors, target)
    blocks = np.array_split(np.arange(len(target)), _BLOCKS)

    def without(k: int) -> FloatArray:
        return _solve(np.delete(regressors, blocks[k], axis=0), np.delete(target, blocks[k]))

    errors = np.sqrt(np.diag(jackknife(without, _BLOCKS)))
    if np.var(target - regressors @ values) > (1.0 - _LEAST_R2) * np.var(target):
        return []
    factor = t_quantile(_BLOCKS - 1)
    found = []
    for name, value, error in zip(known, values, errors, strict=False):
        reach = factor * float(error)
        felt = float(np.std(inertial)) > _LEAST_INERTIAL * moved * abs(value)
        if felt and reach < _MOST_SPREAD * abs(value):
            found.append(Gain(name, float(value), float(value) - reach, float(value) + reach))
    return found


def takes_energy_out(trials: Sequence[Recording]) -> bool:
    """Whether the efforts brake the motion on the whole, which nothing then drives."""
    power, size = 0.0, 0.0
    for trial in trials:
        if len(trial) >= MIN_SAMPLES:
            cutoff = signals.usual_cutoff(trial.stride * trial.period)
            products = trial.applied * FilteredMotion(trial, cutoff).speed
            power, size = power + float(products.sum()), size + float(np.abs(products).sum())
    return power < _TAKEN_OUT * size


def _rows(recording: Recording) -> FloatArray:
    """(n, 7): motor, cylinder, gravity, sign of speed, speed, 1 and acceleration, filtered."""
    motion = FilteredMotion(recording, default_cutoff(recording, signals.DEFAULT_CUTOFF_HZ))
    table = np.column_stack(
        [
            motion.smooth(signals.held_about_rows(recording.motor)),
            motion.smooth(recording.cylinder),
            motion.smooth(recording.load_effort),
            motion.way,
            motion.speed,
            np.ones(len(recording)),
            motion.acceleration,
        ]
    )
    return np.asarray(table[motion.rows])


def _drives(table: FloatArray, column: int) -> bool:
    """Whether this drive takes a share in the efforts of the log."""
    sizes = table[:, :2].std(axis=0)
    return bool(sizes[column] > _LEAST_SHARE * sizes.sum() and sizes[column] > 0.0)


def _solve(regressors: FloatArray, target: FloatArray) -> FloatArray:
    solution, *_ = np.linalg.lstsq(regressors, target, rcond=None)
    return np.asarray(solution)


__all__ = ["CYLINDER", "MOTOR", "Gain", "gains", "takes_energy_out"]
