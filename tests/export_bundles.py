"""Bundles with surfaces of every shape, for the tests of the export."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from sysid import __version__
from sysid.io.rig import rig_from_content
from sysid.parameters import Bundle
from sysid.parameters.content import SCHEMA
from sysid.parameters.files import bundle_from_json
from sysid.types import FloatArray

DUTY = (0.5, 0.45)
PRESSURE = (2.05e5, 1.0e5)
FLOW = (1.0e-4, 5.0e-4)

# Flow over scaled duty a and pressure b, kg/s: row i, column j multiplies a^i b^j.
RISING = 1e-4 * np.array([[2.4, -2.3, -0.5], [3.8, -1.0, -1.3], [0.6, 0.1, 0.1]])
VERTEX = 1e-4 * np.array([[0.2, 1.0, 0.0], [1.0, 0.5, 0.0], [0.3, 2.0, 0.0]])
FALLING = 1e-4 * np.array([[1.0, 0.1, 0.0], [-3.0, 0.2, 0.0], [0.2, 0.0, 0.0]])
LINEAR = 1e-4 * np.array([[1.0, -0.5, 0.1], [4.0, 1.0, 0.2], [0.0, 0.0, 0.0]])
FLAT = 1e-4 * np.array([[1.0, -0.5, 0.1], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def estimate(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "std": 0.01 * abs(value), "unit": unit}


def unidentified(reason: str = "no test moves it") -> dict[str, Any]:
    return {"value": None, "identified": False, "reason": reason}


def discrete(scale: float = 1.0) -> dict[str, Any]:
    return {
        "choked_flow_fill_kg_s": estimate(7.8e-4 * scale, "kg/s"),
        "c_fill": estimate(2.27e-6 * scale, "kg/(s Pa^0.5)"),
        "choked_flow_dis_kg_s": estimate(3.5e-4 * scale, "kg/s"),
        "c_dis": estimate(3.95e-9 * scale, "kg/(s Pa)"),
        "on_delay_s": estimate(0.0017, "s"),
        "off_delay_s": estimate(0.0020, "s"),
        "supply_pressure_pa": 300000.0,
    }


def domain() -> dict[str, Any]:
    """25 nodes, limits that vary with the pressure."""
    nodes = np.linspace(PRESSURE[0] - PRESSURE[1], PRESSURE[0] + PRESSURE[1], 25)
    share = np.linspace(0.0, 1.0, 25)
    low, high = DUTY[0] - DUTY[1], DUTY[0] + DUTY[1]
    return {
        "duty": [low, high],
        "pressure_pa": [float(nodes[0]), float(nodes[-1])],
        "nodes": {
            "pressure_pa": nodes.tolist(),
            "duty_low": (low + 0.3 * share**2).tolist(),
            "duty_high": (high - 0.2 * (1.0 - share)).tolist(),
            "flow_low_kg_s": (-3e-4 * share).tolist(),
            "flow_high_kg_s": (6e-4 - 2e-4 * share**2).tolist(),
        },
    }


def bipolynomial(scaled: FloatArray) -> dict[str, Any]:
    """A surface in the bundle's form from flow over scaled duty and pressure (3, 3)."""
    powers = [_powers(*DUTY), _powers(*PRESSURE)]
    c = powers[0].T @ scaled @ powers[1]
    return {
        "kind": "bipolynomial",
        "coefficients": [
            {
                "term": f"u^{i} P^{j}",
                "value": float(c[i, j]),
                "std": 1e-3 * abs(float(c[i, j])),
                "interval": [float(c[i, j]), float(c[i, j])],
                "unit": "kg/s" if j == 0 else f"kg/(s Pa^{j})",
            }
            for i in range(3)
            for j in range(3)
        ],
        "scaling": {"duty": list(DUTY), "pressure_pa": list(PRESSURE)},
        "domain": domain(),
        "rmse_flow_kg_s": 1e-5,
        "n_samples": 100,
        "constrained": False,
        "rmse_duty": 0.03,
        "max_relative_error_duty_percent": 40.0,
    }


def _powers(centre: float, half: float) -> FloatArray:
    """(3, 3): row i holds ((x - centre)/half)^i in powers of x."""
    base = Polynomial([-centre / half, 1.0 / half])
    rows = np.zeros((3, 3))
    for i in range(3):
        coefficients = (base**i).coef
        rows[i, : len(coefficients)] = coefficients
    return rows


def network(rng: np.random.Generator, hidden: int = 10) -> dict[str, Any]:
    def weights(value: Any) -> dict[str, Any]:
        return {"value": value, "std": None, "unit": "1"}

    return {
        "kind": "ann",
        "activation": "tanh",
        "hidden_weights": weights(rng.normal(0.0, 3.0, (hidden, 2)).tolist()),
        "hidden_bias": weights(rng.normal(0.0, 3.0, hidden).tolist()),
        "output_weights": weights(rng.normal(0.0, 0.5, hidden).tolist()),
        "output_bias": weights(float(rng.normal(0.0, 0.3))),
        "scaling": {"flow_kg_s": list(FLOW), "pressure_pa": list(PRESSURE), "duty": list(DUTY)},
        "domain": domain(),
        "rmse_duty": 0.004,
        "held_out_rmse_duty": 0.005,
        "n_samples": 100,
        "training": {"seed": 0, "restart_seeds": [1], "best_restart": 0, "iterations": 10},
    }


def valves(shapes: list[FloatArray], seed: int = 0) -> dict[str, Any]:
    """Both valves; four shapes: A filling, A discharging, B filling, B discharging."""
    rng = np.random.default_rng(seed)
    content: dict[str, Any] = {}
    for k, side in enumerate("ab"):
        content[side] = {"discrete": discrete(1.0 + 0.3 * k), "pwm": {}}
        for m, direction in enumerate(("fill", "discharge")):
            content[side]["pwm"][direction] = {
                "pwm_period_s": 0.005,
                "supply_pressure_pa": 300000.0,
                "bipolynomial": bipolynomial(shapes[2 * k + m]),
                "ann": network(rng),
            }
    return content


def whole_bundle(rig_text: str, shapes: list[FloatArray] | None = None, seed: int = 0) -> Bundle:
    """A bundle that holds everything, for the rig of this text."""
    return as_bundle(whole_content(rig_text, shapes, seed))


def as_bundle(content: dict[str, Any]) -> Bundle:
    """The bundle of a file with this content."""
    return bundle_from_json(content, Path("bundle.json"))


def whole_content(
    rig_text: str, shapes: list[FloatArray] | None = None, seed: int = 0
) -> dict[str, Any]:
    """The file of a bundle that holds everything, for the rig of this text."""
    rig = rig_from_content(tomllib.loads(rig_text), "rig")
    friction: dict[str, Any] = {
        "static_nm": estimate(0.333, "Nm"),
        "coulomb_nm": estimate(0.208, "Nm"),
        "viscous_nm_s_per_rad": estimate(0.0488, "Nm s/rad"),
        "offset_nm": estimate(0.002, "Nm"),
        "static_by_position": [
            {"position": -1.1, "tests": 6, "static": estimate(0.368, "Nm")},
            {"position": 0.0, "tests": 6, "static": unidentified()},
            {"position": 1.1, "tests": 6, "static": estimate(0.278, "Nm")},
        ],
    }
    if rig.is_linear:
        friction = {
            "static_n": estimate(9.0, "N"),
            "coulomb_n": estimate(5.5, "N"),
            "viscous_n_s_per_m": estimate(34.0, "N s/m"),
        }
    shapes = [RISING, VERTEX, FALLING, LINEAR] if shapes is None else shapes
    log = {"file": "run.csv", "sha256": "ab" * 32, "use": "fit", "kind": "friction"}
    return {
        "schema": SCHEMA,
        "created": "2026-01-02T03:04:05+00:00",
        "sysid_version": __version__,
        "rig": rig.content,
        "friction": friction,
        "valves": valves(shapes, seed),
        "effects": [],
        "provenance": {"logs": [log], "seeds": {}, "options": {}},
    }


_VERTICAL = """
arm_mass_kg = 0.3
arm_length_m = 0.46
payload_mass_kg = 0.5
payload_length_m = 0.37
"""


def upright(rig_text: str) -> str:
    """The rig upright with a payload, so that gravity is not zero."""
    text = rig_text.replace("horizontal", "vertical")
    return text.replace("equivalent_kg_m2 = 0.02368\n", "equivalent_kg_m2 = 0.02368" + _VERTICAL)


LINEAR_RIG = """\
[rig]
name = "slide"
orientation = "vertical"
motion = "linear"

[air]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
temperature_k = 293.15
atmospheric_pressure_pa = 101325.0
supply_pressure_pa = 600000.0

[cylinder]
area_a_m2 = 4.909e-4
area_b_m2 = 4.123e-4
offset_a_m = 0.11
offset_b_m = 0.11
stroke_m = 0.2

[inertia]
mass_kg = 1.5
payload_mass_kg = 0.5

[motor]
force_per_volt_n = 4.0

[pwm]
period_s = 0.005
"""


def iso_law(**changes: Any) -> dict[str, Any]:
    """A bundle's on/off law in both directions; `changes` of its keys."""
    none = {"value": None, "identified": False, "reason": "the direction obeys ISO 6358"}
    thesis = ("choked_flow_fill_kg_s", "c_fill", "choked_flow_dis_kg_s", "c_dis")
    return {
        **dict.fromkeys(thesis, none),
        "on_delay_s": estimate(0.0017, "s"),
        "off_delay_s": estimate(0.0020, "s"),
        "law": dict.fromkeys(("fill", "exhaust"), "iso6358"),
        "sonic_conductance": {
            "fill": estimate(2.2e-9, "m3/(s Pa)"),
            "exhaust": estimate(1.7e-9, "m3/(s Pa)"),
        },
        "critical_ratio": {"fill": estimate(0.3, "-"), "exhaust": estimate(0.22, "-")},
        "subsonic_index": {
            way: {"value": 0.5, "std": 0.0, "unit": "-"} for way in ("fill", "exhaust")
        },
    } | changes
