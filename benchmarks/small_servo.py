"""Motion logs of a small servo at low speed, with bristles (LuGre) and Stribeck friction.

An own simulation, independent of the package's model and of the generator: Canudas de Wit et al.,
IEEE TAC 40(3), 1995. A drive follows slow sines under a PD controller; its torque and the counts
of its encoder are logged at 1 kHz. All runs of all seeds are stepped together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.io.logs import Trial
from sysid.io.rig import Inertia, Rig
from sysid.types import FloatArray

PERIOD, STEPS, SECONDS = 1e-3, 10, 8.0
COUNT = 2.0 * np.pi / 40000
TORQUE_NOISE_NM, TORQUE_STEP_NM = 2e-4, 1e-5
SCATTER = 0.01  # of the friction from run to run

FORMS = ("rigid", "presliding", "presliding and Stribeck")


@dataclass(frozen=True)
class Servo:
    """One servo: Nm, Nm s/rad, kg m2; `span` rad over which Coulomb friction builds up;
    `stiction` is static over Coulomb friction, `stribeck` its speed, rad/s."""

    coulomb: float
    viscous: float
    inertia: float
    span: float
    stiction: float
    stribeck: float

    @staticmethod
    def drawn(seed: int, form: str) -> Servo:
        rng = np.random.default_rng([seed, 15])
        coulomb = rng.uniform(0.015, 0.03)
        viscous = rng.uniform(0.1, 0.3) * coulomb
        inertia, span = rng.uniform(0.5e-4, 2e-4), rng.uniform(0.003, 0.015)
        stiction, stribeck = rng.uniform(1.15, 1.4), rng.uniform(0.05, 0.15)
        if form == "rigid":
            span = 1e-4
        if form != "presliding and Stribeck":
            stiction = 1.0
        return Servo(coulomb, viscous, inertia, span, stiction, stribeck)

    @property
    def rig(self) -> Rig:
        return Rig(
            "small servo", "horizontal", "rotary", inertia=Inertia(equivalent_kg_m2=self.inertia)
        )


def campaigns(seeds: range, form: str, runs: int = 10) -> list[tuple[Servo, list[Trial]]]:
    """Each seed's servo and its runs."""
    servos = [Servo.drawn(seed, form) for seed in seeds]
    rows = {
        key: np.repeat([getattr(s, key) for s in servos], runs)
        for key in ("coulomb", "viscous", "inertia", "span", "stiction", "stribeck")
    }
    rng = np.random.default_rng([seeds.start, 16])
    count = len(servos) * runs
    scatter = 1.0 + SCATTER * rng.standard_normal(count)
    rows["coulomb"] = rows["coulomb"] * scatter
    rows["viscous"] = rows["viscous"] * scatter
    sines = {
        "amplitude": rng.uniform(0.1, 0.5, count),
        "rate": 2.0 * np.pi * rng.uniform(0.3, 0.8, count),
        "phase": rng.uniform(0.0, 2.0 * np.pi, count),
    }
    position, torque = _stepped(rows, sines)
    position = np.round(position / COUNT) * COUNT
    torque = torque + TORQUE_NOISE_NM * rng.standard_normal(torque.shape)
    time = PERIOD * np.arange(len(position))
    found = []
    for k, servo in enumerate(servos):
        trials = [
            Trial(
                str(i + 1),
                time,
                {
                    "theta_rad": position[:, k * runs + i],
                    "motor_torque_nm": torque[:, k * runs + i],
                },
                "small servo",
            )
            for i in range(runs)
        ]
        found.append((servo, trials))
    return found


def _stepped(rows: dict[str, Any], sines: dict[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Position and commanded torque at every row, (n, runs) each."""
    c, j = rows["coulomb"], rows["inertia"]
    stiffness = c / rows["span"]
    damping = np.sqrt(stiffness * j)
    kp, kd = j * 80.0**2, 1.6 * j * 80.0
    h, n = PERIOD / STEPS, round(SECONDS / PERIOD)
    x, v, z = sines["amplitude"] * np.sin(sines["phase"]), np.zeros(len(c)), np.zeros(len(c))
    position, torque = np.empty((n, len(c))), np.empty((n, len(c)))
    for k in range(n):
        angle = sines["rate"] * k * PERIOD + sines["phase"]
        wanted = sines["amplitude"] * np.sin(angle)
        speed = sines["amplitude"] * sines["rate"] * np.cos(angle)
        command = kp * (wanted - x) + kd * (speed - v) + 0.9 * c * np.sign(speed)
        command = np.round(command / TORQUE_STEP_NM) * TORQUE_STEP_NM
        position[k], torque[k] = x, command
        for _ in range(STEPS):
            level = c * (1.0 + (rows["stiction"] - 1.0) * np.exp(-((v / rows["stribeck"]) ** 2)))
            bend = v - stiffness * np.abs(v) / level * z
            friction = stiffness * z + damping * bend + rows["viscous"] * v
            v = v + h * (command - friction) / j
            z = z + h * bend
            x = x + h * v
    return position, torque
