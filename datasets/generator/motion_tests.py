"""The motion tests of the thesis' validation (3.8): motor alone, both PWM, on/off sequences.

Open loop, as logged; inputs are tried until the arm moves well and stays off its stops, which is
what an operator does at the rig.
"""

from __future__ import annotations

import numpy as np

from datasets.generator.effects.simulate import Way
from datasets.generator.friction_tests import (
    clipped_sine,
    factors_truth,
    friction_factors,
    hold_angle,
    motor_sine,
)
from datasets.generator.plant import POSITION, FloatArray, Plant
from datasets.generator.rigs import GeneratedRig
from datasets.generator.runs import (
    Commands,
    GeneratedTest,
    at_atmosphere,
    logged,
    position_after,
    simulated,
)
from datasets.generator.sensors import rounded_duty, rounded_effort

LIMIT = 0.92  # of the half travel, never passed
# Least swing from one extreme to the other, in half travels.
PWM_SWING, DISCRETE_SWING = 0.7, 0.5
TRIES = 400
MORE_DUTY, TRIES_A_LEVEL = 0.04, 30
SEARCH_TOLERANCE = 2.0  # with effects: where to put the next pulse needs no fine steps


def start_position(rig: GeneratedRig, rng: np.random.Generator) -> float:
    """Somewhere near the middle, where friction holds the arm."""
    return float(rng.uniform(-0.15, 0.15) * min(rig.half_travel, hold_angle(rig, 0.9)))


def motor_test(
    rig: GeneratedRig,
    label: str,
    duration: float,
    scatter: float,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """Valves off, chambers open, a clipped sine of the motor (Figure 3.19)."""
    factors, position = friction_factors(rng, scatter), start_position(rig, rng)
    commands, states = motor_sine(rig, rig.plant(*factors), position, duration, rng, True)
    truth = {**factors_truth(*factors), "position": position}
    return logged(label, rig, commands, states, noise_pa, rng, truth)


def pwm_test(
    rig: GeneratedRig,
    label: str,
    duration: float,
    with_motor: bool,
    scatter: float,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """Clipped sines of both duties, with or without the motor (Figure 3.20)."""
    factors, position = friction_factors(rng, scatter), start_position(rig, rng)
    plant, start = rig.plant(*factors), at_atmosphere(rig, position)
    n = round(duration / rig.row_period)
    limit = LIMIT * rig.half_travel
    for attempt in range(TRIES):
        # An effect that swallows pulses makes the operator ask for longer ones.
        more = MORE_DUTY * (attempt // TRIES_A_LEVEL) if rig.effects else 0.0
        commands = _pwm_commands(rig, n, with_motor, rng, more)
        states = simulated(rig, plant, commands, start, (-limit, limit))
        if len(states) == n and _is_lively(states, rig, PWM_SWING):
            truth = {**factors_truth(*factors), "position": position}
            return logged(label, rig, commands, states, noise_pa, rng, truth)
    raise ValueError("no clipped sines of the duties keep this rig off its stops")


def _pwm_commands(
    rig: GeneratedRig, n: int, with_motor: bool, rng: np.random.Generator, more: float
) -> Commands:
    """Duties that change from one PWM period to the next, the two about in antiphase.

    `more` is added to both duties' middle.
    """
    period = float(rig.content["pwm"]["period_s"])
    held = np.floor(np.arange(n) * rig.row_period / period + 1e-6).astype(int)
    frequency, phase = rng.uniform(0.25, 0.6), rng.uniform(0.0, 2.0 * np.pi)
    waves = []
    for side_phase in (phase, phase + np.pi + rng.uniform(-0.5, 0.5)):
        middle, amplitude = rng.uniform(0.14, 0.34), rng.uniform(0.08, 0.20)
        clip = rng.uniform(0.7, 1.0)
        # A slight difference of frequencies lets the phase between the valves wander.
        own = frequency * rng.uniform(0.97, 1.03)
        sine = clipped_sine(held[-1] + 1, period, own, side_phase, amplitude, clip)
        waves.append(rounded_duty(np.clip(middle + more + sine, 0.004, 0.95))[held])
    motor = np.zeros(n)
    if with_motor:
        amplitude = rng.uniform(0.15, 0.5) * rig.max_effort
        clip = rng.uniform(0.6, 0.95)
        motor_phase = rng.uniform(0.0, 2.0 * np.pi)
        motor = clipped_sine(n, rig.row_period, frequency, motor_phase, amplitude, clip)
    return Commands(rounded_effort(motor, rig), duty_a=waves[0], duty_b=waves[1])


def discrete_test(
    rig: GeneratedRig,
    label: str,
    duration: float,
    with_motor: bool,
    scatter: float,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """An on/off sequence of both valves, each pulse chosen by where the arm then is."""
    factors, position = friction_factors(rng, scatter), start_position(rig, rng)
    plant = rig.plant(*factors)
    n = round(duration / rig.row_period)
    for _ in range(TRIES):
        motor = np.zeros(n)
        if with_motor:
            amplitude = rng.uniform(0.1, 0.3) * rig.max_effort
            frequency, phase = rng.uniform(0.3, 0.8), rng.uniform(0.0, 2.0 * np.pi)
            motor = clipped_sine(n, rig.row_period, frequency, phase, amplitude, 0.8)
        found = _sequence(rig, plant, rounded_effort(motor, rig), position, rng)
        if found is not None:
            truth = {**factors_truth(*factors), "position": position}
            return logged(label, rig, *found, noise_pa, rng, truth)
    raise ValueError("no on/off sequence keeps this rig off its stops")


def _sequence(
    rig: GeneratedRig,
    plant: Plant,
    motor: FloatArray,
    position: float,
    rng: np.random.Generator,
) -> tuple[Commands, FloatArray] | None:
    """Pulses one after another, or None if the arm comes near a stop or hardly moves."""
    n, limit = motor.size, LIMIT * rig.half_travel
    valves = np.zeros((2, n))
    start = at_atmosphere(rig, position)
    commands = Commands(motor, valve_a=valves[0], valve_b=valves[1])
    row = round(rng.uniform(0.25, 0.6) / rig.row_period)
    search, way = SEARCH_TOLERANCE if rig.effects else 1.0, Way()
    while row < n:
        # Valve A pushes up, B down: mostly towards the middle, as a careful operator would.
        now = row + 1
        so_far = Commands(motor[:now], valve_a=valves[0, :now], valve_b=valves[1, :now])
        here = position_after(rig, plant, so_far, start, (-limit, limit), search, way)
        if here is None:
            return None
        towards = 1 if here > 0.0 else 0
        valve = towards if rng.random() < 0.8 else 1 - towards
        length = round(_pulse(rng) / rig.row_period)
        valves[valve, row : row + length] = 1.0
        if rng.random() < 0.2:  # the other valve over part of it: both chambers under pressure
            late = row + round(rng.uniform(0.3, 0.9) * length)
            valves[1 - valve, late : late + length] = 1.0
        row += length + round(rng.uniform(0.15, 0.5) / rig.row_period)
    states = simulated(rig, plant, commands, start, (-limit, limit))
    if len(states) < n or not _is_lively(states, rig, DISCRETE_SWING):
        return None
    return commands, states


def _pulse(rng: np.random.Generator) -> float:
    """A pulse's length, s: many short ones, some that fill the chamber."""
    return float(np.exp(rng.uniform(np.log(0.008), np.log(0.15))))


def _is_lively(states: FloatArray, rig: GeneratedRig, swing: float) -> bool:
    return bool(np.ptp(states[:, POSITION]) > swing * rig.half_travel)
