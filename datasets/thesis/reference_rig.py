"""The thesis' rig as a model, for its tables of simulated controllers (chapters 4 and 5).

What the plant is there: friction of section 3.4, the on/off law with the coefficients of Table
3.6.1, the valves' delays; what is not printed is assumed (README.md of the thesis' text,
`datasets.generator.rigs.reference_rig`).
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from datasets.generator.rigs import reference_rig
from sysid.control.design_model import DesignModel, design_model
from sysid.control.duty_inverse import TabulatedInverse, tabulated
from sysid.io.rig import Rig, rig_from_content
from sysid.model.base import ValveParameters, parameters_from_rig
from sysid.model.ports import Model
from sysid.surfaces.averaged import AveragedLaw
from sysid.surfaces.bipolynomial import Bipolynomial


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
    own = design(options, **changes)
    a, b = (_bipolynomial_inverse(AveragedLaw.of(own.parameters, side)) for side in "ab")
    return dataclasses.replace(own, inverse_a=a, inverse_b=b)


def surfaces(law: AveragedLaw) -> tuple[Bipolynomial, Bipolynomial]:
    """Filling and discharging bipolynomial of a law's mean flow, on the grid of 3.7.2.

    Duties by steps of 0.01 (Table 3.7.1), pressures from the atmosphere to the supply.
    """
    duty, pressure = np.meshgrid(np.arange(0.01, 0.96, 0.01), np.linspace(1.0e5, 3.0e5, 81))
    flow = np.asarray(law.flow(duty, pressure))
    fits = []
    for chosen in (flow > 0.0, flow < 0.0):
        x = np.stack([duty[chosen], pressure[chosen]], axis=1)
        fits.append(Bipolynomial().fit(x, flow[chosen]))
    return fits[0], fits[1]


def _bipolynomial_inverse(law: AveragedLaw) -> TabulatedInverse:
    fill, out = surfaces(law)
    grid = np.linspace(1.0e5, 3.0e5, 81)
    return tabulated(
        lambda m, p: fill.duty(m, p)[0],
        lambda m, p: out.duty(m, p)[0],
        (float(np.min(law.closed_flow(grid))), float(np.max(law.open_flow(grid)))),
        (1.0e5, 3.0e5),
    )
