"""The equation of motion along a measured motion: the effort that a model leaves over.

The motion is imposed, so that nothing adds up over time, and effects act on the balance through
the model's ports (thesis 3.4.1, 3.4.2). Both sides go through the same zero-phase filter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sysid.identification.friction.motion_samples import default_cutoff, left_out

from sysid import signals
from sysid.io.logs import Trial
from sysid.io.rig import NO_LOAD, Load, Rig
from sysid.plant import plant
from sysid.plant.base import bare_parameters
from sysid.plant.ports import Model, Point, with_load
from sysid.recording.even import recorded
from sysid.recording.recording import Recording
from sysid.types import FloatArray, IntArray

FASTEST_CUTOFF_HZ = 20.0
# Kinematics that nonlinear laws see pass a wider filter than the balance.
_WIDER = 3.0
_SAMPLES_A_TEST = 4000
_LEAST_SCALE = 1e-3


@dataclass(frozen=True)
class ImposedMotion:
    """A test, or a stretch of one: where the shaft is at every sample, and the rows that count.

    `point`, `acceleration` (rad/s2 or m/s2) and `load` (the cylinder's effort, Nm or N) are the
    whole test's, (n,); `period` in s. `carried`: beyond the rig file's payload.
    """

    label: str
    point: Point
    acceleration: FloatArray
    period: float
    cutoff_hz: float
    rows: IntArray
    load: FloatArray
    carried: Load = NO_LOAD


def imposed_motion(trial: Trial, even: Recording, rig: Rig) -> ImposedMotion:
    """A trial's motion; `even` is the trial on even time. Rows are thinned to a filter's length."""
    wide = default_cutoff(even, _WIDER * FASTEST_CUTOFF_HZ)
    cutoff = wide / _WIDER
    rows = np.flatnonzero(~left_out(even, cutoff))
    thin = max(1, signals.filter_length(even.period, cutoff) // 4, len(rows) // _SAMPLES_A_TEST)
    position = signals.lowpass(even.position, even.period, wide)
    velocity = signals.first_derivative(position, even.period)
    grid = even.time + trial.time[0]
    bare = bare_parameters(rig)
    point = Point(
        time=even.time + trial.begun_s,
        position=position,
        velocity=velocity,
        pressure_a=_channel(trial, "pressure_a_pa", grid, bare.atmosphere),
        pressure_b=_channel(trial, "pressure_b_pa", grid, bare.atmosphere),
        motor=signals.held_about_rows(even.motor),
        open_a=np.zeros(len(even)),
        open_b=np.zeros(len(even)),
        direction=np.sign(velocity),
        parameters=bare,
    )
    acceleration = signals.second_derivative(position, even.period)
    return ImposedMotion(
        trial.title,
        point,
        acceleration,
        even.period,
        cutoff,
        rows[::thin],
        even.cylinder,
        rig.load_of(trial.payload_kg),
    )


def effort_gap(motion: ImposedMotion, model: Model) -> FloatArray:
    """The filtered effort (n,), Nm or N, that a model leaves over along the whole test.

    In the logged command's own units: otherwise a motor gain of 0 would explain everything.
    """
    parameters = with_load(model.at(motion.point.time), motion.carried)
    point = dataclasses.replace(motion.point, parameters=parameters)
    driven = plant.applied_effort(point, model)
    resisted = plant.sliding_friction(point, model) + parameters.inertia * motion.acceleration
    given, taken = motion.point.motor, plant.motor_effort(point, model)
    power = float(given @ given)
    scale = float(taken @ given) / power if power > 0.0 else 1.0
    gap = np.asarray(driven - resisted) / (scale if abs(scale) > _LEAST_SCALE else 1.0)
    return signals.lowpass(gap, motion.period, motion.cutoff_hz)


def effort_rmse(trials: Sequence[Trial], rig: Rig, model: Model) -> float:
    """RMSE (Nm or N) of the effort along the measured motion of trials, pooled; NaN without rows.

    Raises InputError for a trial that cannot be brought onto even time.
    """
    squares, count = 0.0, 0
    for trial in trials:
        motion = imposed_motion(trial, recorded(trial, rig, []), rig)
        left = effort_gap(motion, model)[motion.rows]
        squares, count = squares + float(left @ left), count + len(left)
    return math.sqrt(squares / count) if count else math.nan


def _channel(trial: Trial, name: str, grid: FloatArray, default: Any) -> FloatArray:
    if name not in trial:
        return np.full(len(grid), float(default))
    return np.asarray(signals.resample(trial.time, trial[name], grid))


__all__ = ["FASTEST_CUTOFF_HZ", "ImposedMotion", "effort_gap", "effort_rmse", "imposed_motion"]
