"""From wanted flow to duty: the averaged law, or a surface of the thesis.

An inverse is anything with `duty(flow, pressure)`: kg/s and Pa in, 0 to 1 out, (lanes,) or any
shapes that broadcast, for numpy and jax alike.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from sysid.plant.base import Array
from sysid.surfaces.averaged import AveragedLaw
from sysid.surfaces.bipolynomial import Bipolynomial
from sysid.surfaces.hull import ValveLaw


class DutyInverse(Protocol):
    """The duty at which one valve passes a wanted mean flow."""

    def duty(self, flow: Array, pressure: Array) -> Array:
        """Duty, 0 to 1; saturated where the valve cannot pass the flow."""


def bipolynomials(
    law: AveragedLaw, pressures: tuple[float, float]
) -> tuple[Bipolynomial, Bipolynomial]:
    """Filling and discharging bipolynomial of a law's mean flow, on the grid of 3.7.2.

    Duties by steps of 0.01 (Table 3.7.1), pressures (Pa) from the atmosphere to the supply.
    """
    duty, pressure = np.meshgrid(np.arange(0.01, 0.96, 0.01), np.linspace(*pressures, 81))
    flow = np.asarray(law.flow(duty, pressure))
    fits = []
    for chosen in (flow > 0.0, flow < 0.0):
        x = np.stack([duty[chosen], pressure[chosen]], axis=1)
        fits.append(Bipolynomial().fit(x, flow[chosen]))
    return fits[0], fits[1]


def bipolynomial_inverse(law: AveragedLaw, pressures: tuple[float, float]) -> ValveLaw:
    """The thesis' inverse (3.7.3) of a law's mean flow, from bipolynomials fitted to it."""
    return ValveLaw(*(fitted.law for fitted in bipolynomials(law, pressures)))


__all__ = ["DutyInverse", "bipolynomial_inverse", "bipolynomials"]
