"""Logs of the two worked components, integrated by scipy apart from their files: known truth.

    python -m datasets.components.logs servo|cylinder -o DIR --seed N [--nothing-missing]

Friction sticks here by a sharper sign than that of the components, and the integrator chooses its
own steps. Three tests to fit on and one held out, each with its own command.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SERVO = {
    "resistance_ohm": 2.1,
    "back_emf_v_s_per_rad": 0.83,
    "inertia_kg_m2": 0.045,
    "coulomb_nm": 0.22,
    "viscous_nm_s_per_rad": 0.035,
    "unbalance_nm": 0.35,
}
CYLINDER = {
    "conductance_kg_s_pa": 1.6e-9,
    "stiffness_n_per_m": 2200.0,
    "preload_n": 42.0,
    "coulomb_n": 9.0,
    "viscous_n_s_per_m": 55.0,
    "seal_n_per_pa": 8e-5,
}
"""What the logs were made with; the last number is the effect that the base law lacks."""
_TESTS = 4
_SERVO_S, _SERVO_PERIOD = 4.0, 0.004
_CYLINDER_S, _CYLINDER_PERIOD = 4.0, 0.004
_RIG = '[rig]\nname = "{name}"\norientation = "horizontal"\n'


def servo(folder: Path, seed: int, unbalance: bool = True) -> None:
    """A campaign of a geared DC motor: volts in, current and angle out, SI."""
    t = np.arange(0.0, _SERVO_S, _SERVO_PERIOD)
    truth = {**SERVO, "unbalance_nm": SERVO["unbalance_nm"] if unbalance else 0.0}

    def test(rng: np.random.Generator) -> dict[str, FloatArray]:
        volts = _levels(rng, t, 6.0)

        def rates(now: float, x: FloatArray) -> list[float]:
            emf = truth["back_emf_v_s_per_rad"] * x[1]
            amperes = (_held(volts, now, _SERVO_PERIOD) - emf) / truth["resistance_ohm"]
            torque = truth["back_emf_v_s_per_rad"] * amperes
            torque -= truth["coulomb_nm"] * np.tanh(x[1] / 0.005)
            torque -= truth["viscous_nm_s_per_rad"] * x[1] + truth["unbalance_nm"] * np.sin(x[0])
            return [x[1], torque / truth["inertia_kg_m2"]]

        x = _integrated(rates, [0.0, 0.0], t)
        amperes = (volts - truth["back_emf_v_s_per_rad"] * x[1]) / truth["resistance_ohm"]
        return {
            "volts": volts,
            "current_a": amperes + 0.02 * rng.standard_normal(len(t)),
            "angle_rad": np.round((x[0] + 2e-4 * rng.standard_normal(len(t))) / 1e-4) * 1e-4,
        }

    _write(folder, "servo", t, test, seed)


def cylinder(folder: Path, seed: int, seal: bool = True) -> None:
    """A campaign of a spring-return cylinder: valve command in, position and pressure out, SI."""
    t = np.arange(0.0, _CYLINDER_S, _CYLINDER_PERIOD)
    truth = {**CYLINDER, "seal_n_per_pa": CYLINDER["seal_n_per_pa"] if seal else 0.0}
    area, mass, gas, n, ps, p0 = 4.9e-4, 0.4, 287.0 * 293.15, 1.2, 6e5, 1e5

    def flow(up: float, down: float) -> float:
        share = max(down / up - 0.35, 0.0) / 0.65
        return up * (np.sqrt(max(1.0 - min(share, 1.0) ** 2, 0.0) + 1e-4) - 1e-2)

    def test(rng: np.random.Generator) -> dict[str, FloatArray]:
        command = np.clip(_levels(rng, t, 0.6), -1.0, 1.0)

        def rates(now: float, x: FloatArray) -> list[float]:
            y, v, p = x
            u = _held(command, now, _CYLINDER_PERIOD)
            mdot = truth["conductance_kg_s_pa"] * (u * flow(ps, p) if u > 0.0 else u * flow(p, p0))
            friction = truth["coulomb_n"] + truth["seal_n_per_pa"] * (p - p0)
            force = area * (p - p0) - truth["preload_n"] - truth["stiffness_n_per_m"] * y
            force -= friction * np.tanh(v / 5e-4) + truth["viscous_n_s_per_m"] * v
            volume = 1.5e-5 + area * y
            return [v, force / mass, n * (gas * mdot - p * area * v) / volume]

        balance = p0 + (truth["preload_n"] + truth["stiffness_n_per_m"] * 0.02) / area
        x = _integrated(rates, [0.02, 0.0, balance], t)
        return {
            "command": command,
            "position_m": x[0] + 5e-6 * rng.standard_normal(len(t)),
            "pressure_pa": x[2] + 200.0 * rng.standard_normal(len(t)),
        }

    _write(folder, "spring-return", t, test, seed)


def _levels(rng: np.random.Generator, t: FloatArray, reach: float) -> FloatArray:
    """Steps and a slow sine about 0, at rest for the first 0.1 s."""
    holds = np.repeat(rng.uniform(-1.0, 1.0, 1 + len(t) // 75), 75)[: len(t)]
    wave = np.sin(2.0 * np.pi * rng.uniform(0.4, 0.9) * t)
    return np.round(np.where(t < 0.1, 0.0, reach * (0.6 * holds + 0.4 * wave)), 4)


def _held(command: FloatArray, now: float, period: float) -> float:
    return float(command[min(int(now / period + 1e-9), len(command) - 1)])


def _integrated(
    rates: Callable[[float, FloatArray], list[float]], start: list[float], t: FloatArray
) -> FloatArray:
    """States (states, n) at `t`, from row to row: a held command jumps between them."""
    from scipy.integrate import solve_ivp

    states = np.empty((len(start), len(t)))
    states[:, 0] = start
    for k in range(len(t) - 1):
        # Just past the row's own time, so that rounding does not pick the command before it.
        inside = (t[k] + 1e-7, t[k + 1] - 1e-7)
        found = solve_ivp(rates, inside, states[:, k], method="LSODA", rtol=1e-7, atol=1e-10)
        states[:, k + 1] = found.y[:, -1]
    return states


def _write(
    folder: Path,
    kind: str,
    t: FloatArray,
    test: Callable[[np.random.Generator], dict[str, FloatArray]],
    seed: int,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.toml").write_text(_RIG.format(name=kind), "utf-8")
    lines = ['rig = "rig.toml"']
    for k in range(_TESTS):
        columns = {"time_s": t, **test(np.random.default_rng([seed, k]))}
        rows = (",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True))
        text = "\n".join([",".join(columns), *rows, ""])
        (folder / f"test_{k + 1}.csv").write_text(text, "utf-8")
        use = "fit" if k < _TESTS - 1 else "holdout"
        lines += ["", "[[log]]", f'kind = "{kind}"', f'file = "test_{k + 1}.csv"']
        lines += [f'use = "{use}"']
    (folder / "campaign.toml").write_text("\n".join([*lines, ""]), "utf-8")


def main() -> None:
    """Write a campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("which", choices=["servo", "cylinder"])
    parser.add_argument("-o", dest="folder", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--nothing-missing", action="store_true")
    given = parser.parse_args()
    make = servo if given.which == "servo" else cylinder
    make(given.folder, given.seed, not given.nothing_missing)


if __name__ == "__main__":
    main()
