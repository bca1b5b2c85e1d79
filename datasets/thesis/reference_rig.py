"""The thesis' rig as a model, for its tables of simulated controllers (chapters 4 and 5).

What the plant is there: friction of section 3.4, the on/off law with the coefficients of Table
3.6.1, the valves' delays; what is not printed is assumed (README.md of the thesis' text,
`datasets.generator.rigs.reference_rig`). `python -m datasets.thesis.reference_rig` writes it as
the bundle `reference_bundle.json`.
"""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from typing import Any

from datasets.generator.rigs import reference_rig
from sysid import __version__
from sysid.controllers.design_model import DesignModel, design_model, with_bipolynomials
from sysid.io.bundled import REFERENCE_BUNDLE
from sysid.io.rig import Rig, rig_from_content
from sysid.parameters.content import SCHEMA
from sysid.plant.base import ValveParameters, parameters_from_rig
from sysid.plant.ports import Model


def rig(**options: Any) -> Rig:
    """The rig file's content; `options` of `datasets.generator.rigs.reference_rig`."""
    return rig_from_content(reference_rig(**options).content, "rig.toml")


def plant(options: dict[str, Any] | None = None, **changes: Any) -> Model:
    """The rig with the printed friction and valve laws, some parameters changed."""
    truth = reference_rig().truth
    a, b = (
        ValveParameters(v.choked_flow_fill_kg_s, v.choked_flow_dis_kg_s, v.c_fill, v.c_dis)
        for v in (truth.valve_a, truth.valve_b)
    )
    parameters = parameters_from_rig(
        rig(**(options or {})),
        static_effort=truth.static_friction,
        coulomb_effort=truth.coulomb_friction,
        viscous=truth.viscous_friction,
        valve_a=a,
        valve_b=b,
    )
    return Model(parameters.replace(**changes))


def design(options: dict[str, Any] | None = None, **changes: Any) -> DesignModel:
    """A controller's model that is the plant's, with the averaged law's inverse."""
    return design_model(plant(options, **changes), rig=rig(**(options or {})))


def bipolynomial_design(options: dict[str, Any] | None = None, **changes: Any) -> DesignModel:
    """The same with the thesis' inverse: bipolynomials fitted to the mean flow (3.7.3)."""
    return with_bipolynomials(design(options, **changes))


def bundle_content() -> dict[str, Any]:
    """The rig as a bundle's content, for `sysid control --table`: values without intervals."""
    made = reference_rig()
    truth = made.truth
    valves = {}
    for side, valve in (("a", truth.valve_a), ("b", truth.valve_b)):
        units = {
            "c_fill": "kg/(s Pa^0.5)",
            "c_dis": "kg/(s Pa)",
            "choked_flow_fill_kg_s": "kg/s",
            "choked_flow_dis_kg_s": "kg/s",
        }
        law = {key: _value(getattr(valve, key), unit) for key, unit in units.items()}
        valves[side] = {"discrete": law}
    return {
        "schema": SCHEMA,
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "sysid_version": __version__,
        "rig": _rig_content(made.content),
        "friction": {
            "static_nm": _value(truth.static_friction, "Nm"),
            "coulomb_nm": _value(truth.coulomb_friction, "Nm"),
            "viscous_nm_s_per_rad": _value(truth.viscous_friction, "Nm s/rad"),
        },
        "valves": valves,
        "effects": [],
        "provenance": {
            "logs": [],
            "seeds": {},
            "options": {"made_by": "datasets.thesis.reference_rig"},
        },
    }


def _rig_content(made: dict[str, Any]) -> dict[str, Any]:
    """The horizontal rig with the arm that gravity needs in the tables of the vertical one."""
    arm = reference_rig("vertical").content["inertia"]
    name = {"name": "thesis rig", "orientation": "horizontal"}
    return made | {"rig": name, "inertia": arm}


def _value(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "std": None, "unit": unit}


if __name__ == "__main__":
    text = json.dumps(bundle_content(), indent=2) + "\n"
    (Path(__file__).parent / REFERENCE_BUNDLE).write_text(text, encoding="utf-8")
