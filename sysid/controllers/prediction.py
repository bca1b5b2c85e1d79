"""The controller's model at work: efforts and rates at measured or predicted points.

Everything goes through `sysid.plant.plant`, so that the effects in a bundle count in the
controller's model as in a simulation. Array-library agnostic; shapes broadcast.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from sysid.controllers.design_model import DesignModel
from sysid.controllers.interface import StateEstimate
from sysid.io.rig import GRAVITY_M_PER_S2
from sysid.plant import plant
from sysid.plant.base import Array, array_namespace
from sysid.plant.ports import Model, Point, overrides
from sysid.plant.sensors import without_errors


class Motion(NamedTuple):
    """Position rad or m, velocity, pressures Pa: what a prediction carries on."""

    position: Array
    velocity: Array
    pressure_a: Array
    pressure_b: Array


def point_at(
    motion: Motion, model: Model, time: Array, motor: Array, friction_velocity: Array
) -> Point:
    """The model's point at a motion, both valves off, friction by `friction_velocity`.

    States that effects add start where they start at rest there: a controller has no
    measurement of them.
    """
    xp = array_namespace(motion.pressure_a, motion.position)
    point = Point(
        time=time,
        position=motion.position,
        velocity=motion.velocity,
        pressure_a=motion.pressure_a,
        pressure_b=motion.pressure_b,
        motor=motor,
        open_a=0.0 * motion.pressure_a,
        open_b=0.0 * motion.pressure_b,
        direction=xp.sign(friction_velocity),
        parameters=model.at(time),
    )
    return _at_rest(point, model)


def _at_rest(point: Point, model: Model) -> Point:
    """The point with the states of its effects where they start."""
    if not model.state_names:
        return point
    return dataclasses.replace(point, extra=plant.initial_states(point, model))


def sliding_friction(point: Point, model: Model, velocity: Array) -> Array:
    """Friction at a velocity (rad/s or m/s) other than the point's own, Nm or N; 0 at 0."""
    xp = array_namespace(velocity)
    return plant.sliding_friction(
        dataclasses.replace(point, velocity=velocity, direction=xp.sign(velocity)), model
    )


def cylinder_effort(point: Point, model: Model) -> Array:
    """(Pa Aa - Pb Ab - P0 (Aa - Ab)) times the lever, Nm or N (4.4.6 corrected)."""
    p = point.parameters
    force_a = (point.pressure_a - p.atmosphere) * p.area_a
    force_b = (point.pressure_b - p.atmosphere) * p.area_b
    return (force_a - force_b) * plant.pitch_radius(point, model)


def motor_command(effort: Array, point: Point, model: Model) -> Array:
    """The motor's command, Nm or N, at which it gives an effort, by its effects in the model."""
    if not any(overrides(e, "motor_effort") for e in model.effects):
        return effort

    def error(given: dict[str, Array]) -> dict[str, Array]:
        command = given["motor"]
        moved = plant.motor_effort(dataclasses.replace(point, motor=command), model)
        return {"motor": moved - command}

    return without_errors({"motor": effort}, error)["motor"]


def corrected(estimate: StateEstimate, model: Model) -> StateEstimate:
    """The estimate of a rotary rig without the known errors of its sensors.

    Those of a single sample: offsets, gains, an eccentric encoder. A lag and a delay stay.
    """
    known = [e for e in model.effects if overrides(e, "measure", "sense")]
    known = [e for e in known if not overrides(e, "start_sensing")]
    names = {"theta_rad": "position", "pressure_a_pa": "pressure_a", "pressure_b_pa": "pressure_b"}
    measured = {channel: getattr(estimate, field) for channel, field in names.items()}

    def error(true: dict[str, Array]) -> dict[str, Array]:
        shown = dict(true)
        for effect in known:
            shown, _ = effect.sense(shown, (), 0.0 * estimate.position, 1e-3)
        return {name: shown[name] - value for name, value in true.items()}

    true = without_errors(measured, error) if known else measured
    return estimate._replace(**{field: true[channel] for channel, field in names.items()})


def opposing_effort(point: Point, model: Model) -> Array:
    """The effort opposing positive motion except friction: gravity, offset, external; Nm or N."""
    still = dataclasses.replace(point, motor=0.0 * point.position)
    return cylinder_effort(point, model) - plant.applied_effort(still, model)


def euler_step(
    motion: Motion,
    shares: tuple[Array, Array],
    point: Point,
    model: Model,
    step: float,
    trapezoidal: bool = False,
) -> Motion:
    """One explicit Euler step of `step` s (4.4.2, steps 4 to 10), from the point of `motion`.

    `shares`: of the step in which valves A and B are open. The point's direction and
    velocity are those of friction; the motion's own velocity moves the piston. `trapezoidal`:
    the position advances by the mean of the old and the new velocity, which is exact for a
    constant acceleration, where Euler's lags by half a step.
    """
    friction = plant.sliding_friction(point, model)
    applied = plant.applied_effort(point, model)
    moving = dataclasses.replace(
        point, velocity=motion.velocity, open_a=shares[0], open_b=shares[1]
    )
    rates = [
        plant.pressure_rate(side, plant.shared_flow(side, share, moving, model), moving, model)
        for side, share in zip("ab", shares, strict=True)
    ]
    velocity = motion.velocity + step * (applied - friction) / point.parameters.inertia
    moved = 0.5 * (motion.velocity + velocity) if trapezoidal else motion.velocity
    return Motion(
        motion.position + step * moved,
        velocity,
        motion.pressure_a + step * rates[0],
        motion.pressure_b + step * rates[1],
    )


def loaded(design: DesignModel, payload_inertia: Array) -> Model:
    """The controller's model with a payload of this inertia (kg m2).

    It takes the place of the model's own. Effects have no states, which no controller measures:
    they are as where these have settled.
    """
    return with_payload(design, payload_inertia).settled()


def with_payload(design: DesignModel, payload_inertia: Array) -> Model:
    """The design's model with a payload of this inertia (kg m2) in place of its own.

    Its weight counts where the rig is in the vertical.
    """
    p = design.parameters
    own = design.payload_mass * design.payload_length**2
    lever = _at_least(design.payload_length)
    extra = (payload_inertia - own) / lever
    weight = design.gravity * GRAVITY_M_PER_S2 * extra
    changed = p.replace(
        inertia=p.inertia + (payload_inertia - own), gravity_moment=p.gravity_moment + weight
    )
    return dataclasses.replace(design.model, parameters=changed)


def _at_least(length: Array, least: float = 1e-3) -> Array:
    xp = array_namespace(length)
    return xp.where(length > least, length, least)


__all__ = [
    "Motion",
    "corrected",
    "cylinder_effort",
    "euler_step",
    "loaded",
    "motor_command",
    "opposing_effort",
    "point_at",
    "sliding_friction",
    "with_payload",
]
