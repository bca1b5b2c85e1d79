"""The friction tests: ramps to breakaway, constant effort, and motion with the valves off.

The operator is taken to know the rig roughly: he picks ramps and levels that move it at sensible
speeds, which is why the levels below are computed from the rig's constants.
"""

from __future__ import annotations

import numpy as np

from datasets.generator.plant import POSITION, VELOCITY, FloatArray, Plant
from datasets.generator.rigs import GeneratedRig
from datasets.generator.runs import (
    Commands,
    GeneratedTest,
    at_atmosphere,
    logged,
    simulated,
)
from datasets.generator.sensors import position_counts, rounded_effort

RAMP_S = 4.2  # from zero to the motor's limit
STATIC_LIMIT = 0.9  # of the half travel, where a ramp is ended at the latest
SLIDING_START, SLIDING_END = 0.76, 0.83
SLIDING_LIMIT_S = 4.0
CLEAR_MOTION = 0.006  # half travels that are not mistaken for elasticity, 10 mrad
FIRMER, MOST_FIRMER = 0.03, 8  # of the limit: raise of a level that stalls, and how often
SPEEDS = (0.25, 0.5, 0.9)  # half travels a second at which the levels aim
KICK_S = 0.06
REST_S = 0.15  # recorded after a trial that comes to rest


def friction_factors(rng: np.random.Generator, scatter: float) -> tuple[float, float]:
    """One trial's static friction, and its Coulomb and viscous friction, over the rig's."""
    static, sliding = 1.0 + scatter * rng.standard_normal(2)
    return float(max(static, 0.5)), float(max(sliding, 0.5))


def factors_truth(static: float, sliding: float) -> dict[str, float]:
    """How a trial's own friction is recorded."""
    return {"static_factor": static, "sliding_factor": sliding}


def hold_angle(rig: GeneratedRig, share: float) -> float:
    """Largest position at which gravity takes no more than `share` of static friction."""
    limit = share * rig.truth.static_friction
    if rig.is_linear or rig.gravity() <= limit:
        return rig.half_travel
    return float(np.arcsin(limit / rig.gravity()))


def pumping_drag(rig: GeneratedRig) -> float:
    """Drag of the air pumped through the exhausts, Nm s/rad or N s/m (slow motion)."""
    air, cylinder = rig.content["air"], rig.content["cylinder"]
    density = air["atmospheric_pressure_pa"] / (
        air["gas_constant_j_per_kg_k"] * air["temperature_k"]
    )
    valves = ((rig.truth.valve_a, "area_a_m2"), (rig.truth.valve_b, "area_b_m2"))
    terms = [(cylinder[key] * rig.radius) ** 2 / valve.c_dis for valve, key in valves]
    return float(density * sum(terms))


def static_test(
    rig: GeneratedRig,
    label: str,
    share: float,
    direction: int,
    scatter: float,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """A slow ramp from zero until the shaft moves and 0.3 to 0.5 s beyond (Table 3.4.1).

    `share` places the piston, in half travels (in the vertical: within what friction holds).
    """
    factors = friction_factors(rng, scatter)
    reach = min(rig.half_travel, hold_angle(rig, 0.6) / 0.65)
    position = (share + rng.uniform(-0.012, 0.012)) * reach
    n = round(RAMP_S / rig.row_period)
    ramp = direction * rig.max_effort / RAMP_S * rig.row_period * np.arange(n)
    commands = Commands(rounded_effort(np.asarray(ramp, dtype=np.float64), rig))
    limit = STATIC_LIMIT * rig.half_travel
    states = simulated(
        rig, rig.plant(*factors), commands, at_atmosphere(rig, position), (-limit, limit)
    )
    counts = position_counts(states[:, POSITION], rig)
    # Bristles and gaps yield slightly before the shaft moves: there the operator waits for more.
    least = CLEAR_MOTION * rig.half_travel / rig.position_per_count if rig.effects else 0.0
    moved = np.flatnonzero(np.abs(counts - counts[0]) > least)
    if moved.size == 0:
        raise ValueError("the motor is too weak to break this rig away")
    beyond = round(rng.uniform(0.3, 0.5) / rig.row_period)
    states = states[: int(moved[0]) + beyond]
    truth = {
        **factors_truth(*factors),
        "direction": direction,
        "position": position,
        "breakaway_effort": direction * rig.truth.static_friction * factors[0],
    }
    return logged(label, rig, commands, states, noise_pa, rng, truth)


def sliding_level(rig: GeneratedRig, speed: float) -> float:
    """The effort that keeps the rig moving at `speed`, Nm or N, without gravity."""
    drag = rig.truth.viscous_friction + pumping_drag(rig)
    return rig.truth.coulomb_friction + drag * speed


def sliding_test(
    rig: GeneratedRig,
    label: str,
    speed_share: float,
    direction: int,
    scatter: float,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """A kick, then constant effort across the stroke (Table 3.4.2).

    In the vertical a pendulum is driven from one side of its lowest point up the other, as far as
    the effort carries it without a stall.
    """
    factors = friction_factors(rng, scatter)
    speed = speed_share * rig.half_travel
    level = sliding_level(rig, speed)
    start, end = SLIDING_START * rig.half_travel, SLIDING_END * rig.half_travel
    if rig.is_vertical and not rig.is_linear:
        climb = (0.25 + 0.35 * speed_share) * rig.max_effort
        start = min(start, hold_angle(rig, 0.6))
        end = min(end, float(np.arcsin(min(1.0, 0.8 * climb / rig.gravity()))))
        level = rig.truth.coulomb_friction + climb
    weight = rig.gravity() if rig.is_linear else 0.0
    kick = max(1.8 * rig.truth.static_friction, level + 0.6 * rig.truth.static_friction)
    n = round(SLIDING_LIMIT_S / rig.row_period)
    kick_rows = round(_kick_time(rig, kick, speed) / rig.row_period)
    position = -direction * start + rng.uniform(-0.012, 0.012) * rig.half_travel
    band = (-np.inf, end) if direction > 0 else (-end, np.inf)
    for firmer in range(MOST_FIRMER):
        more = firmer * FIRMER * rig.max_effort
        effort = np.full(n, weight + direction * (level + more))
        effort[:kick_rows] = weight + direction * (kick + more)
        commands = Commands(rounded_effort(effort, rig))
        states = simulated(rig, rig.plant(*factors), commands, at_atmosphere(rig, position), band)
        # An effect that the operator does not know may stall the arm at its usual level.
        if not rig.effects or len(states) < n or abs(states[-1, VELOCITY]) > 0.05 * speed:
            break
    truth = {**factors_truth(*factors), "direction": direction, "position": position}
    return logged(label, rig, commands, states, noise_pa, rng, truth)


def rest_test(
    rig: GeneratedRig,
    label: str,
    speed_share: float,
    direction: int,
    scatter: float,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """Constant effort from rest to rest, without a kick, recorded until 0.15 s after the stop.

    What stops it is gravity, or an effect such as a spring; without one it runs to its end stop.
    """
    factors = friction_factors(rng, scatter)
    climb = (0.25 + 0.35 * speed_share) * rig.max_effort
    swings = rig.is_vertical and not rig.is_linear
    level = sliding_level(rig, speed_share * rig.half_travel)
    if swings:
        level = rig.truth.coulomb_friction + climb
    level = max(level, 1.08 * rig.truth.static_friction * factors[0])
    weight = rig.gravity() if rig.is_linear and rig.is_vertical else 0.0
    start = SLIDING_START * rig.half_travel
    position = -direction * start + rng.uniform(-0.012, 0.012) * rig.half_travel
    n = round(SLIDING_LIMIT_S / rig.row_period)
    commands = Commands(rounded_effort(np.full(n, weight + direction * level), rig))
    end = STATIC_LIMIT * rig.half_travel
    band = (-np.inf, end) if direction > 0 else (-end, np.inf)
    states = simulated(rig, rig.plant(*factors), commands, at_atmosphere(rig, position), band)
    moving = np.flatnonzero(np.abs(states[:, VELOCITY]) > 1e-3 * rig.half_travel)
    last = (int(moving[-1]) if moving.size else 0) + round(REST_S / rig.row_period)
    truth = {**factors_truth(*factors), "direction": direction, "position": position}
    return logged(label, rig, commands, states[:last], noise_pa, rng, truth)


def _kick_time(rig: GeneratedRig, kick: float, speed: float) -> float:
    """About as long as the kick needs to bring the rig to `speed`, s."""
    spare = min(kick, rig.max_effort) - rig.truth.coulomb_friction
    return float(np.clip(rig.inertia() * speed / spare, 0.01, 3.0 * KICK_S))


def clipped_sine(
    n: int, period: float, frequency: float, phase: float, amplitude: float, clip: float
) -> FloatArray:
    """`amplitude` sin(2 pi f t + phase), clipped at `clip` of the amplitude; (n,)."""
    angle = 2.0 * np.pi * frequency * period * np.arange(n) + phase
    return np.asarray(amplitude * np.clip(np.sin(angle), -clip, clip))


def motor_sine(
    rig: GeneratedRig,
    plant: Plant,
    position: float,
    duration: float,
    rng: np.random.Generator,
    valves: bool,
) -> tuple[Commands, FloatArray]:
    """A clipped sine of the motor that moves the arm well, off its stops; valves off.

    Amplitudes and frequencies are tried until one does, as an operator would.
    """
    n = round(duration / rig.row_period)
    offset = rig.gravity() if rig.is_linear else 0.0
    limit = 0.9 * rig.half_travel
    for _ in range(400):
        amplitude = rng.uniform(0.6, 1.25) * rig.max_effort
        sine = clipped_sine(
            n,
            rig.row_period,
            rng.uniform(0.35, 0.9),
            rng.uniform(0.0, 2.0 * np.pi),
            amplitude,
            rng.uniform(0.6, 0.95),
        )
        closed = np.zeros(n) if valves else None
        commands = Commands(rounded_effort(offset + sine, rig), closed, closed)
        states = simulated(rig, plant, commands, at_atmosphere(rig, position), (-limit, limit))
        swing = np.ptp(states[:, POSITION])
        if len(states) == n and swing > 0.25 * rig.half_travel:
            return commands, states
    raise ValueError("no clipped sine moves this rig off its stops")


def motion_test(
    rig: GeneratedRig,
    label: str,
    duration: float,
    scatter: float,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """Friction from motion: a clipped sine of the motor with the valves off, reversals in it."""
    factors = friction_factors(rng, scatter)
    position = rng.uniform(-0.15, 0.15) * min(rig.half_travel, hold_angle(rig, 0.9))
    commands, states = motor_sine(rig, rig.plant(*factors), position, duration, rng, False)
    truth = {**factors_truth(*factors), "position": position}
    return logged(label, rig, commands, states, noise_pa, rng, truth)
