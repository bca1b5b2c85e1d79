"""What the sensors make of the states: noise, quantisation, and the commands as written."""

from __future__ import annotations

import numpy as np

from datasets.generator.effects.integrator import (
    N_COLUMNS,
    SENSED_A,
    SENSED_B,
    SENSED_POSITION,
    SENSED_SUPPLY,
)
from datasets.generator.plant import POSITION, PRESSURE_A, PRESSURE_B, FloatArray
from datasets.generator.rigs import GeneratedRig

PRESSURE_COUNT_PA = 26.0  # the pressure channels' least significant bit
EFFORT_DIGITS = 5  # of a motor command, Nm or N
DUTY_DIGITS = 4


def rounded_effort(effort: FloatArray, rig: GeneratedRig) -> FloatArray:
    """Motor commands (n,), clipped at the declared limit, as the log will write them."""
    limited = np.clip(effort, -rig.max_effort, rig.max_effort)
    return np.asarray(np.round(limited, EFFORT_DIGITS) + 0.0)  # + 0.0: no negative zero


def rounded_duty(duty: FloatArray) -> FloatArray:
    """Duty commands (n,) as the log will write them, within 0 to 1."""
    return np.asarray(np.round(np.clip(duty, 0.0, 1.0), DUTY_DIGITS))


def position_counts(position: FloatArray, rig: GeneratedRig) -> FloatArray:
    """Encoder counts (n,), whole numbers; zero at position 0."""
    return np.asarray(np.round(position / rig.position_per_count) + 0.0)


def measured_pressure(
    pressure: FloatArray, noise_pa: float, rng: np.random.Generator
) -> FloatArray:
    """White noise of `noise_pa` (one standard deviation), then the converter's steps."""
    noisy = pressure + noise_pa * rng.standard_normal(pressure.size)
    return np.asarray(np.round(noisy / PRESSURE_COUNT_PA) * PRESSURE_COUNT_PA)


def measured(
    states: FloatArray, rig: GeneratedRig, noise_pa: float, rng: np.random.Generator
) -> dict[str, FloatArray]:
    """The measured columns of states (n, 4; with effects n, 8), under the log format's names."""
    position = "position_m" if rig.is_linear else "theta_rad"
    supply = np.full(len(states), float(rig.content["air"]["supply_pressure_pa"]))
    shown = [states[:, POSITION], states[:, PRESSURE_A], states[:, PRESSURE_B], supply]
    if states.shape[1] == N_COLUMNS:
        shown = [states[:, i] for i in (SENSED_POSITION, SENSED_A, SENSED_B, SENSED_SUPPLY)]
    counts = position_counts(shown[0], rig)
    columns = {
        position: counts * rig.position_per_count,
        "pressure_a_pa": measured_pressure(shown[1], noise_pa, rng),
        "pressure_b_pa": measured_pressure(shown[2], noise_pa, rng),
        "supply_pressure_pa": measured_pressure(shown[3], noise_pa, rng),
    }
    missing = {f"pressure_{side}_pa" for side in "ab" if side not in rig.sides}
    return {name: values for name, values in columns.items() if name not in missing}
