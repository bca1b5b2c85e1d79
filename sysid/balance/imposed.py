"""The equation of motion along a measured motion: a model's residual effort.

The motion is imposed, so that nothing adds up over time, and effects act on the balance through
the model's ports (thesis 3.4.1, 3.4.2). Both sides go through the same zero-phase filter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid import signals
from sysid.balance.motion import FilteredMotion, default_cutoff
from sysid.balance.residuals import effort_residual
from sysid.plant import plant
from sysid.plant.base import bare_parameters
from sysid.plant.ports import Model, Point, in_rows, overrides
from sysid.recording.recording import Recording
from sysid.types import FloatArray, IntArray

FASTEST_CUTOFF_HZ = 20.0
# Kinematics that nonlinear laws see pass a wider filter than the balance.
_WIDER = 3.0
_LEAST_SCALE = 1e-3
# Lengths of the filter after which nothing is left of an impulse, and what is nothing of it.
_FADED, _SEEN = 2, 1e-2
# Numbers of an array, 8 MB: all models at once are fastest, and a long test needs no more memory.
_AT_ONCE = 2**20


@dataclass(frozen=True)
class ImposedMotion:
    """A recording's motion as points (n,) at which a model's ports are evaluated.

    `seen` is the motion that nonlinear laws see, `balanced` the motion after the balance's filter;
    `rows` are the rows used here: all valid ones, or those of one stretch.
    """

    seen: FilteredMotion
    balanced: FilteredMotion
    point: Point
    rows: IntArray

    @property
    def recording(self) -> Recording:
        return self.seen.recording

    def without_turns(self, left: FloatArray) -> FloatArray:
        """A residual (rows,) less what the motion's turns put into it, as the filter spreads it.

        Whether the shaft rests where it turns, with friction anywhere up to static friction, no
        sensor tells that resolves less than the turn; nor is friction its sign there, as it builds
        up over some way. What is left of each turn is a pulse of unknown form, as long as what the
        filter does not resolve.
        """
        turns = self._turns
        return np.asarray(left - turns @ (turns.T @ left))

    @cached_property
    def _turns(self) -> FloatArray:
        """Orthonormal columns (rows, k) that span the filtered pulses at the turns."""
        way, length = np.sign(self.seen.speed), self.balanced.length
        turns = 1 + np.flatnonzero(way[:-1] * way[1:] < 0.0)
        # Where the shaft rests the sign is noise's: more turns than the filter resolves are one.
        cell = max(1, length // signals.PER_LENGTH)
        turns = turns[np.unique(turns // cell, return_index=True)[1]]
        reach = _FADED * length
        impulse = np.zeros(2 * reach + 1)
        impulse[reach] = 1.0
        spread = self.balanced.smooth(impulse)
        spread /= np.abs(spread).max()
        # Half a length about the turn, half of the fastest wave that passes: any pulse in it is a
        # sum of a few impulses, twice as close as samples that the filter leaves independent.
        count = signals.PER_LENGTH + 1
        places = np.unique(np.round(np.linspace(-cell, cell, count)).astype(int))
        after = self.rows[:, None] - (turns[:, None] + places).ravel()
        near = np.abs(after) <= reach
        columns = np.where(near, spread[np.where(near, after + reach, 0)], 0.0)
        columns = columns[:, np.abs(columns).max(axis=0, initial=0.0) > _SEEN]
        basis, size, _ = np.linalg.svd(columns, full_matrices=False)
        return np.asarray(basis[:, size > _SEEN])


def imposed_motion(recording: Recording) -> ImposedMotion:
    """A recording's motion. Rows are thinned to a filter's length."""
    seen = FilteredMotion(recording, default_cutoff(recording, _WIDER * FASTEST_CUTOFF_HZ))
    balanced = FilteredMotion(recording, seen.cutoff_hz / _WIDER)
    rows = np.flatnonzero(balanced.counts)
    thin = max(1, balanced.length // 4, len(rows) // 4000)
    bare = bare_parameters(recording.rig)
    point = Point(
        time=recording.since_start,
        position=seen.position,
        velocity=seen.speed,
        pressure_a=_pressure(recording, "pressure_a_pa", float(bare.atmosphere)),
        pressure_b=_pressure(recording, "pressure_b_pa", float(bare.atmosphere)),
        motor=signals.held_about_rows(recording.motor),
        open_a=np.zeros(len(recording)),
        open_b=np.zeros(len(recording)),
        direction=np.sign(seen.speed),
        parameters=bare,
    )
    return ImposedMotion(seen, balanced, point, rows[::thin])


def effort_gap(motion: ImposedMotion, model: Model) -> FloatArray:
    """A model's residual effort (n,), Nm or N, filtered, along the whole test.

    As of `effort_gaps`.
    """
    return motion.balanced.smooth(_gap(motion, model)[0])


def effort_gaps(motions: Sequence[ImposedMotion], models: Sequence[Model]) -> list[FloatArray]:
    """`effort_gap` of each of several models of the same effects, (models, n), along each motion.

    The ports and the filter take them at once: on a short test a call takes longer than its work.
    In units of the logged command: otherwise a motor gain of 0, or friction that takes as much as
    the motor gives, would explain everything.
    """
    longest = max((len(motion.recording) for motion in motions), default=1)
    most = max(1, _AT_ONCE // longest)
    parts = [models[k : k + most] for k in range(0, len(models), most)]
    rows = [(in_rows(list(part)), len(part)) for part in parts]
    gaps = [np.concatenate([_gap(motion, *part) for part in rows]) for motion in motions]
    return [m.balanced.smooth(gap.T).T for m, gap in zip(motions, gaps, strict=True)]


def _gap(motion: ImposedMotion, model: Model, count: int = 1) -> FloatArray:
    """`effort_gap` before the filter, (count, n), of a model or of so many in rows."""
    parameters = model.carrying(motion.recording.load).at(motion.point.time)
    point = dataclasses.replace(motion.point, parameters=parameters)
    given = motion.point.motor
    power = float(given @ given)
    arrives = np.atleast_2d(effort_that_arrives(point, model)) @ given
    scale = arrives / power if power > 0.0 else np.ones(1)
    scale = np.where(np.abs(scale) > _LEAST_SCALE, scale, 1.0)
    left = -effort_residual(point, motion.seen.acceleration, model)
    return np.broadcast_to(left / scale[:, None], (count, len(given)))


def effort_that_arrives(point: Point, model: Model) -> FloatArray:
    """What the shaft gets of the motor's effort (n,), or (models, n), Nm or N: less the friction
    that grows with it."""
    if not any(overrides(type(effect), "friction_effort") for effect in model.effects):
        return np.asarray(plant.motor_effort(point, model))
    idle = dataclasses.replace(point, motor=0.0 * point.motor)
    friction = [plant.sliding_friction(at, model) for at in (point, idle)]
    return np.asarray(plant.motor_effort(point, model) - (friction[0] - friction[1]))


def effort_noise(motion: ImposedMotion, model: Model) -> float:
    """Standard deviation of what the sensors' noise leaves of `effort_gap`, Nm or N.

    Of the motor's effort as logged, of the chambers' pressures (as declared in the rig file, else
    as logged), and of the position, through the inertia's and viscous friction's shares.
    """
    own, balanced = motion.recording, motion.balanced
    p = model.carrying(own.load).at(motion.point.time)
    parts = [
        float(np.max(p.inertia)) * balanced.acceleration_noise,
        float(np.max(p.viscous)) * balanced.speed_noise,
    ]
    if own.has_motor:
        stride = own.trial.stride_of(own.rig.effort_channel)
        floor = signals.noise_floor(own.commanded, stride=stride, between_jumps=True)
        parts.append(floor.after(balanced.noise_power))
    cylinder = own.rig.cylinder
    if cylinder is not None:
        areas = {"pressure_a_pa": cylinder.area_a_m2, "pressure_b_pa": cylinder.area_b_m2}
        for name, area in areas.items():
            if name in own:
                declared = own.rig.sensors.pressure_noise_pa
                floor = signals.noise_floor(own[name])
                floor = floor if declared is None else signals.NoiseFloor(declared, 0.0)
                lever = area * cylinder.pitch_radius_m
                parts.append(lever * floor.after(balanced.noise_power))
    return math.hypot(*parts)


def effort_rmse(recordings: Sequence[Recording], model: Model) -> float:
    """RMSE (Nm or N) of the effort along measured motions, pooled; NaN without rows."""
    squares, count = 0.0, 0
    for recording in recordings:
        motion = imposed_motion(recording)
        left = effort_gap(motion, model)[motion.rows]
        squares, count = squares + float(left @ left), count + len(left)
    return math.sqrt(squares / count) if count else math.nan


def _pressure(recording: Recording, channel: str, default: float) -> FloatArray:
    return recording[channel] if channel in recording else np.full(len(recording), default)


__all__ = [
    "FASTEST_CUTOFF_HZ",
    "ImposedMotion",
    "effort_gap",
    "effort_gaps",
    "effort_noise",
    "effort_rmse",
    "effort_that_arrives",
    "imposed_motion",
]
