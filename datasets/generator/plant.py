"""The plant's equations, written independently of `sysid.plant`, so that an error in one shows.

Thesis chapter 3 with the corrections of its equations: torque balance (3.3.1-3.3.11), proper
Coulomb and viscous friction with breakaway (3.4.1), adiabatic chambers (3.3.6), and the
two-regime valve law with its jump at the choked boundary (3.6.6, 3.6.7, 3.6.10).

Every law is a small function of the state and the parameters. What is discontinuous (friction's
direction, a valve's position, choked or not) is held in `mode` while a step is taken and changed
only at events, which `integrator` locates; within a step the right-hand side is smooth.

State `x` (4,): position (rad, linear: m), velocity, chamber pressures A and B (Pa, absolute).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

FloatArray = np.ndarray[Any, np.dtype[np.float64]]
IntArray = np.ndarray[Any, np.dtype[np.int64]]

_F = TypeVar("_F", bound=Callable[..., Any])


def compiled(function: _F) -> _F:
    """Compile to machine code at the first call, kept on disk; the type stays as written."""
    return cast(_F, njit(cache=True)(function))


CRITICAL_RATIO = 0.53  # downstream over upstream pressure at which the flow chokes (3.5.1)

# State.
POSITION, VELOCITY, PRESSURE_A, PRESSURE_B = 0, 1, 2, 3
N_STATES = 4

# Mode.
SLIDE = 0  # -1, +1: moving that way; 0: stuck
HELD = 1  # 1: the piston is clamped, as in the valve tests
OPEN_A, OPEN_B = 2, 3  # 1: chamber on the supply, 0: on the exhaust, 2: shut
REGIME_A, REGIME_B = 4, 5
N_MODES = 6

SHUT = 2

# Regime of a chamber's flow.
UNCHOKED, CHOKED, BOUNDARY, ABOVE_SUPPLY = 0, 1, 2, 3

# What can end a step early: the index into the margins.
REVERSAL, BREAKAWAY, END_STOP, FLOW_A, FLOW_B = 0, 1, 2, 3, 4
N_EVENTS = 5


class Chamber(NamedTuple):
    """One chamber and its valve. `direction` is +1 for A (grows with the position), -1 for B."""

    area: float  # m2
    offset: float  # m, at position 0
    direction: float
    choked_fill: float  # kg/s, at the declared supply pressure
    choked_dis: float  # kg/s
    c_fill: float  # kg/(s Pa^0.5)
    c_dis: float  # kg/(s Pa)


class Plant(NamedTuple):
    """All constants of the right-hand side, SI; effort is Nm (linear: N)."""

    inertia: float
    static_friction: float
    coulomb_friction: float
    viscous_friction: float
    gravity: float  # amplitude of gravity's effort
    rotary: float  # 1: gravity goes with sin(position); 0: it is constant
    radius: float  # m of stroke per unit of position
    max_effort: float
    half_travel: float  # end stops at +- this position
    gas_constant: float
    heat_ratio: float
    temperature: float
    atmosphere: float
    supply: float
    declared_supply: float
    a: Chamber
    b: Chamber
    spring_stiffness: float = 0.0  # of a return spring
    spring_effort: float = 0.0  # its effort against positive motion at position 0


@compiled
def static_load(position: float, p: Plant) -> float:
    """Gravity's load (3.3.8-3.3.10); position 0 hangs down. And a return spring's."""
    spring = p.spring_stiffness * position + p.spring_effort
    if p.rotary > 0.0:
        return float(p.gravity * np.sin(position) + spring)
    return p.gravity + spring


@compiled
def cylinder_effort(pressure_a: float, pressure_b: float, p: Plant) -> float:
    """What the piston gives the output (3.3.3), the rod's end in the atmosphere."""
    rod = p.atmosphere * (p.a.area - p.b.area)
    return (pressure_a * p.a.area - pressure_b * p.b.area - rod) * p.radius


@compiled
def motor_effort(command: float, p: Plant) -> float:
    """The motor's effort at the output, clipped at its declared limit (3.3.4)."""
    return min(max(command, -p.max_effort), p.max_effort)


@compiled
def applied_effort(x: FloatArray, command: float, p: Plant) -> float:
    """Everything but friction and the end stops (3.3.7)."""
    cylinder = cylinder_effort(x[PRESSURE_A], x[PRESSURE_B], p)
    return motor_effort(command, p) + cylinder - static_load(x[POSITION], p)


@compiled
def free_effort(x: FloatArray, command: float, p: Plant) -> float:
    """The applied effort, or 0 where an end stop takes it."""
    effort = applied_effort(x, command, p)
    if x[POSITION] >= p.half_travel and effort > 0.0:
        return 0.0
    if x[POSITION] <= -p.half_travel and effort < 0.0:
        return 0.0
    return effort


@compiled
def sliding_friction(velocity: float, direction: float, p: Plant) -> float:
    """Coulomb and viscous friction while moving in `direction` (3.4.1)."""
    return p.coulomb_friction * direction + p.viscous_friction * velocity


@compiled
def fill_flow(pressure: float, regime: int, c: Chamber, p: Plant) -> float:
    """Flow from the supply into the chamber (3.6.6), kg/s; out of it above the supply."""
    if regime == CHOKED:
        return c.choked_fill * p.supply / p.declared_supply
    difference = p.supply - pressure
    if difference >= 0.0:
        return float(c.c_fill * np.sqrt(difference))
    return float(-c.c_fill * np.sqrt(-difference))


@compiled
def exhaust_flow(pressure: float, regime: int, c: Chamber, p: Plant) -> float:
    """Flow through the exhaust into the chamber (3.6.7, 3.6.10), kg/s: negative above P0."""
    if regime == CHOKED:
        return -c.choked_dis
    return c.c_dis * (p.atmosphere - pressure)


@compiled
def pressure_rate(
    pressure: float,
    position: float,
    velocity: float,
    opened: int,
    regime: int,
    c: Chamber,
    p: Plant,
) -> float:
    """The chamber's energy balance (3.3.6), Pa/s."""
    volume = (c.offset + c.direction * position * p.radius) * c.area
    volume_rate = c.direction * velocity * p.radius * c.area
    if opened == 1:
        flow = fill_flow(pressure, regime, c, p)
    elif opened == SHUT:
        flow = 0.0
    else:
        flow = exhaust_flow(pressure, regime, c, p)
    enthalpy = p.gas_constant * p.temperature * flow
    return p.heat_ratio * (enthalpy - pressure * volume_rate) / volume


@compiled
def derivative(x: FloatArray, mode: IntArray, command: float, p: Plant, dx: FloatArray) -> None:
    """The right-hand side in the mode that holds; writes `dx` (4,)."""
    if mode[HELD] == 1 or mode[SLIDE] == 0:
        velocity = 0.0
        dx[VELOCITY] = 0.0
    else:
        velocity = x[VELOCITY]
        friction = sliding_friction(velocity, float(mode[SLIDE]), p)
        dx[VELOCITY] = (applied_effort(x, command, p) - friction) / p.inertia
    dx[POSITION] = velocity
    dx[PRESSURE_A] = 0.0
    dx[PRESSURE_B] = 0.0
    position = x[POSITION]
    if mode[REGIME_A] != BOUNDARY:
        dx[PRESSURE_A] = pressure_rate(
            x[PRESSURE_A], position, velocity, mode[OPEN_A], mode[REGIME_A], p.a, p
        )
    if mode[REGIME_B] != BOUNDARY:
        dx[PRESSURE_B] = pressure_rate(
            x[PRESSURE_B], position, velocity, mode[OPEN_B], mode[REGIME_B], p.b, p
        )


@compiled
def choked_boundary(opened: int, p: Plant) -> float:
    """Chamber pressure at which the flow chokes, Pa: below it filling, above it discharging."""
    if opened == 1:
        return CRITICAL_RATIO * p.supply
    return p.atmosphere / CRITICAL_RATIO


@compiled
def regime_at(pressure: float, opened: int, p: Plant) -> int:
    """The regime that a pressure is in when a valve has just switched."""
    if opened == SHUT:
        return UNCHOKED
    if opened == 1:
        if pressure <= CRITICAL_RATIO * p.supply:
            return CHOKED
        return ABOVE_SUPPLY if pressure > p.supply else UNCHOKED
    return CHOKED if pressure >= p.atmosphere / CRITICAL_RATIO else UNCHOKED


@compiled
def boundary_rates(x: FloatArray, opened: int, c: Chamber, p: Plant) -> tuple[float, float]:
    """Rates at the choked boundary by either law, positive away from the choked side."""
    pressure, position, velocity = choked_boundary(opened, p), x[POSITION], x[VELOCITY]
    away = 1.0 if opened == 1 else -1.0
    choked = pressure_rate(pressure, position, velocity, opened, CHOKED, c, p)
    unchoked = pressure_rate(pressure, position, velocity, opened, UNCHOKED, c, p)
    return away * choked, away * unchoked


@compiled
def regime_margin(
    x: FloatArray, channel: int, opened: int, regime: int, c: Chamber, p: Plant
) -> float:
    """Positive while the regime holds, Pa (on the boundary: Pa/s)."""
    if opened == SHUT:
        return 1.0
    pressure = float(x[channel])
    boundary = choked_boundary(opened, p)
    if regime == BOUNDARY:
        choked, unchoked = boundary_rates(x, opened, c, p)
        return min(choked, -unchoked)
    if opened == 1:
        if regime == CHOKED:
            return boundary - pressure
        if regime == ABOVE_SUPPLY:
            return pressure - p.supply
        return min(pressure - boundary, p.supply - pressure)
    return pressure - boundary if regime == CHOKED else boundary - pressure


@compiled
def next_regime(x: FloatArray, channel: int, opened: int, regime: int, c: Chamber, p: Plant) -> int:
    """The regime after its margin ran out; puts the pressure exactly on what it crossed.

    Where both laws push the pressure back onto the choked boundary, it stays there (Filippov).
    """
    boundary = choked_boundary(opened, p)
    if opened == 1 and (regime == ABOVE_SUPPLY or (regime == UNCHOKED and x[channel] > boundary)):
        x[channel] = p.supply
        return UNCHOKED if regime == ABOVE_SUPPLY else ABOVE_SUPPLY
    x[channel] = boundary
    choked, unchoked = boundary_rates(x, opened, c, p)
    if choked > 0.0 and unchoked < 0.0 and regime != BOUNDARY:
        return BOUNDARY
    if regime == BOUNDARY:
        return CHOKED if choked <= 0.0 else UNCHOKED
    return UNCHOKED if regime == CHOKED else CHOKED


@compiled
def margins(x: FloatArray, mode: IntArray, command: float, p: Plant, out: FloatArray) -> float:
    """The margin before each event, negative once it has passed; returns the least."""
    out[:] = 1.0
    if mode[HELD] == 0:
        if mode[SLIDE] == 0:
            out[BREAKAWAY] = p.static_friction - abs(free_effort(x, command, p))
        else:
            out[REVERSAL] = mode[SLIDE] * x[VELOCITY]
            out[END_STOP] = p.half_travel - mode[SLIDE] * x[POSITION]
    out[FLOW_A] = regime_margin(x, PRESSURE_A, mode[OPEN_A], mode[REGIME_A], p.a, p)
    out[FLOW_B] = regime_margin(x, PRESSURE_B, mode[OPEN_B], mode[REGIME_B], p.b, p)
    return float(out.min())


@compiled
def stick_or_slide(x: FloatArray, mode: IntArray, command: float, p: Plant) -> None:
    """At zero velocity: stuck unless the effort exceeds static friction (3.4.1)."""
    x[VELOCITY] = 0.0
    effort = free_effort(x, command, p)
    if abs(effort) <= p.static_friction:
        mode[SLIDE] = 0
    else:
        mode[SLIDE] = 1 if effort > 0.0 else -1


@compiled
def apply_events(
    x: FloatArray, mode: IntArray, command: float, p: Plant, margin: FloatArray
) -> None:
    """Carry out every event whose margin is negative; changes `x` and `mode`."""
    if margin[END_STOP] < 0.0:
        x[POSITION] = mode[SLIDE] * p.half_travel
        stick_or_slide(x, mode, command, p)
    elif margin[REVERSAL] < 0.0:
        stick_or_slide(x, mode, command, p)
    elif margin[BREAKAWAY] < 0.0:
        mode[SLIDE] = 1 if free_effort(x, command, p) > 0.0 else -1
    if margin[FLOW_A] < 0.0:
        mode[REGIME_A] = next_regime(x, PRESSURE_A, mode[OPEN_A], mode[REGIME_A], p.a, p)
    if margin[FLOW_B] < 0.0:
        mode[REGIME_B] = next_regime(x, PRESSURE_B, mode[OPEN_B], mode[REGIME_B], p.b, p)
