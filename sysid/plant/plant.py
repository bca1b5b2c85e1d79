"""The plant's right-hand side: the equations of `base` combined through the ports.

Pure functions of (point, model) for numpy and jax alike. The discontinuities are not
decided here: which flows are choked and which way the shaft slides is given, so that an
integrator that locates them sees smooth equations in between.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from sysid.io.channels import SIDES
from sysid.plant import base, valve_laws
from sysid.plant.base import Array, array_namespace
from sysid.plant.ports import Model, Point


def displacement(point: Point, model: Model) -> Array:
    """Piston's place y, m."""
    return model.through("displacement", point.parameters.pitch_radius * point.position, point)


def pitch_radius(point: Point, model: Model) -> Array:
    """dy/dposition, m (linear: 1)."""
    return model.through("pitch_radius", point.parameters.pitch_radius, point)


def supply_pressure(side: str, point: Point, model: Model) -> Array:
    """Supply pressure at a valve, Pa."""
    return model.through("supply_pressure", point.parameters.supply, side, point)


def exhaust_pressure(side: str, point: Point, model: Model) -> Array:
    """Pressure that a valve exhausts to, Pa."""
    return model.through("exhaust_pressure", point.parameters.atmosphere, side, point)


def filling_boundary(side: str, point: Point, model: Model) -> Array:
    """Chamber pressure up to which filling is choked, Pa.

    By the supply pressure that choked flow leaves, as into an empty chamber.
    """
    empty: dict[str, Any] = {f"pressure_{side}": 0.0 * point.pressure(side)}
    supply = supply_pressure(side, dataclasses.replace(point, **empty), model)
    return valve_laws.filling_boundary(point.parameters.valve(side), supply)


def exhaust_boundary(side: str, point: Point, model: Model) -> Array:
    """Chamber pressure from which on the exhaust is choked, Pa.

    By the exhaust pressure that choked flow leaves, as out of a chamber at any pressure.
    """
    # A chamber that exhausts choked whatever the back pressure.
    full: dict[str, Any] = {f"pressure_{side}": 0.0 * point.pressure(side) + 1e9}
    exhaust = exhaust_pressure(side, dataclasses.replace(point, **full), model)
    return valve_laws.exhaust_boundary(point.parameters.valve(side), exhaust)


def motor_effort(point: Point, model: Model) -> Array:
    """Motor effort at the output, Nm or N."""
    limited = base.limit_effort(point.motor, point.parameters.max_effort)
    return model.through("motor_effort", limited, point)


def applied_effort(point: Point, model: Model) -> Array:
    """Cylinder + motor - gravity and spring + offset + external: all but friction, Nm or N
    (3.3.7)."""
    p = point.parameters
    cylinder = base.cylinder_effort(
        point.pressure_a,
        point.pressure_b,
        p.area_a,
        p.area_b,
        p.atmosphere,
        pitch_radius(point, model),
    )
    load = base.load_effort(point.position, p)
    effort = cylinder + motor_effort(point, model) - load + p.offset
    return model.through("external_effort", effort, point)


def sliding_friction(point: Point, model: Model) -> Array:
    """Friction while moving in `point.direction`, Nm or N (3.4.1)."""
    p = point.parameters
    friction = base.sliding_friction(point.velocity, point.direction, p.coulomb_effort, p.viscous)
    return model.through("friction_effort", friction, point)


def breakaway_effort(applied: Array, point: Point, model: Model) -> Array:
    """Effort up to which the plant stays at rest, Nm or N (3.4.1).

    Never below the friction at which it would start to slide: otherwise neither law holds.
    """
    xp = array_namespace(applied, point.velocity)
    static = model.through("static_effort", point.parameters.static_effort, point)
    way = xp.where(applied > 0, 1.0, -1.0)
    starting = dataclasses.replace(point, velocity=0.0 * applied, direction=way)
    sliding = sliding_friction(starting, model) * way
    return xp.where(static > sliding, static, sliding)


def discrete_flow(side: str, choked: Array, point: Point, model: Model) -> Array:
    """Flow into a chamber by the discrete law, kg/s; on where `is_open`.

    Of two valves a chamber, `choked` is that of the one that fills where both are open.
    """
    xp = array_namespace(point.pressure_a, point.position)
    if point.parameters.bleeds:
        opened = point.is_open(side) > 0
        boundary = exhaust_boundary(side, point, model)
        empties = xp.where(opened, point.pressure(side) >= boundary, choked)
        filling = _filling(side, choked, point, model)
        emptying = _exhausting(side, empties, point, model)
        flow = xp.where(opened, filling, 0.0) + xp.where(point.vents(side) > 0, emptying, 0.0)
        return model.through("chamber_flow", flow, side, point)
    flow = xp.where(
        point.is_open(side) > 0,
        _filling(side, choked, point, model),
        _exhausting(side, choked, point, model),
    )
    return model.through("chamber_flow", flow, side, point)


def shared_flow(side: str, share: Array, point: Point, model: Model) -> Array:
    """Mean flow into a chamber whose valve is on for a share (0 to 1) of the time, kg/s.

    The law is taken at both; the other valve is as open as the point says.
    """
    pressure = point.pressure(side)
    # A port reads both valves: where one effect couples the sides, the other keeps its share.
    on: dict[str, Any] = {f"open_{side}": 1.0 + 0.0 * pressure}
    off: dict[str, Any] = {f"open_{side}": 0.0 * pressure}
    if point.parameters.bleeds:
        on["open_b"], off["open_b"] = 0.0 * pressure, 1.0 + 0.0 * pressure
    opened, closed = dataclasses.replace(point, **on), dataclasses.replace(point, **off)
    fills = pressure <= filling_boundary(side, opened, model)
    empties = pressure >= exhaust_boundary(side, closed, model)
    # In each direction the half of `discrete_flow` that applies there.
    filling = _filling(side, fills, opened, model)
    exhausting = _exhausting(side, empties, closed, model)
    if point.parameters.bleeds:
        flow = share * filling + point.vents(side) * exhausting
        return model.through("chamber_flow", flow, side, point)
    return share * model.through("chamber_flow", filling, side, opened) + (
        1.0 - share
    ) * model.through("chamber_flow", exhausting, side, closed)


def _filling(side: str, choked: Array, point: Point, model: Model) -> Array:
    """Flow through an open valve (3.6.6 or ISO 6358), kg/s, before it reaches the chamber."""
    p = point.parameters
    flow = valve_laws.filling_flow(
        p.valve(side),
        point.pressure(side),
        supply_pressure(side, point, model),
        p.supply_reference,
        choked,
        p.temperature,
    )
    return model.through("filling_flow", flow, side, point)


def _exhausting(side: str, choked: Array, point: Point, model: Model) -> Array:
    """Flow through a valve that is off (3.6.10 or ISO 6358), kg/s, before the chamber."""
    p = point.parameters
    flow = valve_laws.exhaust_flow(
        p.valve(side),
        point.pressure(side),
        exhaust_pressure(side, point, model),
        choked,
        p.temperature,
    )
    return model.through("exhaust_flow", flow, side, point)


def knows_pulses(surfaces: tuple[Any, ...]) -> bool:
    """Whether mean flows know how far the pulses lift the pressure (`pulse_ripple`)."""
    return all(hasattr(s, "pulse") or hasattr(s, "span") for s in surfaces)


def takes_shares(surface: Any) -> bool:
    """Whether a mean flow takes the share of the period that the valve is open, not the duty."""
    return hasattr(surface, "pulse")


def own_delays(surface: Any) -> tuple[float, float] | None:
    """Delays of opening and closing, s, that a mean flow was identified with; None: none."""
    return (float(surface.on_delay), float(surface.off_delay)) if takes_shares(surface) else None


def _pulse(side: str, surface: Any, point: Point, model: Model) -> Any:
    """`PulseFlows` of a valve's averaged law, at the lines' pressures in force."""
    p = point.parameters
    volume = chamber_volume(side, displacement(point, model), p)
    relative = volume_rate(side, point, model) / volume
    swept = -(p.heat_capacity_ratio * point.pressure(side) * relative * p.pwm_period)
    rates = _per_flow(side, point, model), swept
    lines = _lines_in_phase(side, point, model)
    return surface.pulse(point.is_open(side), point.pressure(side), lines, rates)


def _lines_in_phase(side: str, point: Point, model: Model) -> tuple[Array, Array]:
    """Supply pressure while a valve is open and exhaust pressure while it is not, Pa.

    Both valves' pulses begin together: the other one is open for a larger part of this one's
    pulse, and shut for a larger part of its pause, than of the period.
    """
    other = SIDES[1 - SIDES.index(side)]
    own, other_open = point.is_open(side), point.is_open(other)
    xp = array_namespace(own, other_open)
    during = xp.minimum(other_open / xp.maximum(own, base.LEAST_DIVISOR), 1.0)
    shut = xp.minimum((1.0 - other_open) / xp.maximum(1.0 - own, base.LEAST_DIVISOR), 1.0)
    pulse: dict[str, Any] = {f"open_{other}": during}
    pause: dict[str, Any] = {f"open_{other}": 1.0 - shut}
    return (
        supply_pressure(side, dataclasses.replace(point, **pulse), model),
        exhaust_pressure(side, dataclasses.replace(point, **pause), model),
    )


def _pulse_parts(
    side: str, flows: Any, mean: Array | None, point: Point, model: Model
) -> tuple[Array, Array]:
    """Filling and exhaust part (kg/s) of a pulse's flows through the effects.

    These see the mean pressure, `mean` shares of a period above the point's.
    """
    share = point.is_open(side)
    ripple = 0.0 if mean is None else mean * _swing(side, flows.open - flows.closed, point, model)
    at: dict[str, Any] = {f"pressure_{side}": point.pressure(side) + ripple}
    middle = dataclasses.replace(point, **at)
    return (
        model.through("filling_flow", share * flows.open, side, middle),
        model.through("exhaust_flow", (1.0 - share) * flows.closed, side, middle),
    )


def _per_flow(side: str, point: Point, model: Model) -> Array:
    """k R T / V of a chamber, Pa/kg."""
    p = point.parameters
    volume = chamber_volume(side, displacement(point, model), p)
    return p.heat_capacity_ratio * p.gas_constant * p.temperature / volume


def pulse_ripple(
    side: str, surface: Any, phase: tuple[Array, Array], point: Point, model: Model
) -> tuple[Array, Array, Array]:
    """Ripple of a chamber in a PWM period: the swing, Pa, and where the ramp in force bends.

    `phase`: whether the pressure rises, and the ripple's mean in shares of a period. The swing
    is what an open valve would add to the pressure in a period over a closed one. The bend:
    height on a straight ramp (0 to 1) and in truth, of the ramp in force.
    """
    rises, mean = phase
    if not takes_shares(surface):
        swing, half = _swing(side, surface.span(point.pressure(side)), point, model), 0.5
        return swing, half + 0.0 * swing, half + 0.0 * swing
    flows = _pulse(side, surface, point, model)
    fill, exhaust = _pulse_parts(side, flows, mean, point, model)
    xp = array_namespace(rises)
    share = point.is_open(side)
    span = fill / xp.maximum(share, base.LEAST_DIVISOR) - exhaust / xp.maximum(
        1.0 - share, base.LEAST_DIVISOR
    )
    straight = xp.where(rises, flows.rise[0], 1.0 - flows.fall[0])
    true = xp.where(rises, flows.rise[1], 1.0 - flows.fall[1])
    return _swing(side, span, point, model), straight, true


def _swing(side: str, span: Array, point: Point, model: Model) -> Array:
    """Pa that a flow (kg/s) adds to a chamber's pressure in a PWM period."""
    return _per_flow(side, point, model) * point.parameters.pwm_period * span


def averaged_flow(
    side: str, surfaces: Any, point: Point, model: Model, ripple_mean: Array | None = None
) -> Array:
    """Flow into a chamber averaged over a PWM period, kg/s, from surfaces (3.7).

    `surfaces` maps (duty, pressure) to flow by `fill` and `discharge`. The first is what a
    chamber below its equilibrium receives and the second what one above it loses, so each
    counts with its own sign only. They hold at the mean pressure, which is `ripple_mean`
    shares of a period above the point's. A surface with a `pulse` gives what the open and the
    closed valve pass from the point's pressure on, by the share that the valve is open.
    """
    duty, pressure = point.is_open(side), point.pressure(side)
    if takes_shares(surfaces):
        flows = _pulse(side, surfaces, point, model)
        parts = _pulse_parts(side, flows, ripple_mean, point, model)
        return model.through("chamber_flow", parts[0] + parts[1], side, point)
    if ripple_mean is not None:
        span = surfaces.span(pressure)
        pressure = pressure + ripple_mean * _swing(side, span, point, model)
    xp = array_namespace(pressure, duty)
    fill = xp.maximum(surfaces.fill(duty, pressure), 0.0)
    exhaust = xp.minimum(surfaces.discharge(duty, pressure), 0.0)
    flow = model.through("filling_flow", fill, side, point) + model.through(
        "exhaust_flow", exhaust, side, point
    )
    return model.through("chamber_flow", flow, side, point)


def chamber_volume(side: str, y: Array, parameters: base.Parameters) -> Array:
    """Volume of a chamber with the piston at y, m3."""
    if side == "a":
        return base.chamber_volume_a(y, parameters.area_a, parameters.offset_a, 1.0)
    return base.chamber_volume_b(y, parameters.area_b, parameters.offset_b, 1.0)


def volume_rate(side: str, point: Point, model: Model) -> Array:
    """dV/dt of a chamber, m3/s."""
    p = point.parameters
    speed = pitch_radius(point, model) * point.velocity
    return speed * p.area_a if side == "a" else -(speed * p.area_b)


def pressure_rate(side: str, flow: Array, point: Point, model: Model) -> Array:
    """dP/dt of a chamber, Pa/s (3.3.6)."""
    p = point.parameters
    rate = base.pressure_rate(
        point.pressure(side),
        flow,
        chamber_volume(side, displacement(point, model), p),
        volume_rate(side, point, model),
        p.heat_capacity_ratio,
        p.gas_constant,
        p.temperature,
    )
    return model.through("pressure_rate", rate, side, flow, point)


def acceleration(applied: Array, point: Point, model: Model) -> Array:
    """Acceleration, rad/s2 or m/s2 (3.3.2); zero where `point.direction` is 0 (sticking)."""
    xp = array_namespace(applied, point.direction)
    moving = applied - sliding_friction(point, model)
    return xp.where(point.direction == 0, 0.0, moving / point.parameters.inertia)


def state_rates(point: Point, flows: Mapping[str, Array], model: Model) -> dict[str, Array]:
    """Derivatives of the extra states, by name."""
    rates: dict[str, Array] = {}
    for effect in model.effects:
        rates.update(effect.state_rates(point, flows))
    return rates


def initial_states(point: Point, model: Model) -> dict[str, Array]:
    """The extra states at the start, by name."""
    states: dict[str, Array] = {}
    for effect in model.effects:
        states.update(effect.initial_states(point))
    return states


__all__ = [
    "SIDES",
    "acceleration",
    "applied_effort",
    "averaged_flow",
    "breakaway_effort",
    "chamber_volume",
    "discrete_flow",
    "displacement",
    "exhaust_pressure",
    "initial_states",
    "motor_effort",
    "pitch_radius",
    "pressure_rate",
    "shared_flow",
    "sliding_friction",
    "state_rates",
    "supply_pressure",
    "volume_rate",
]
