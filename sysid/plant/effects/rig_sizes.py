"""How large effects are on a rig of another size or speed than the reference rig.

The catalogue gives usual sizes and ranges as they are on the reference rig. By similarity those in
units of effort grow with what the cylinder gives, those per speed with the time in which its valves
fill it, and so on: so many times the reference rig's, by each number's own unit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

from sysid.plant import base
from sysid.plant.effects.entry import LIKE, PER_FLOW, CatalogueEffect, Quantity
from sysid.plant.effects.linear import REFERENCE_RADIUS_M
from sysid.plant.effects.supply import times_the_usual_flow

# The reference rig: area of the larger chamber and stroke, its supply and the atmosphere.
_AREA_M2, _STROKE_M = 4.524e-4, 0.127
_SUPPLY_PA, _ATMOSPHERE_PA = 3e5, 1e5
_INERTIA = ("kg m2", "kg")
_FACTOR = re.compile(r"([A-Za-z]+)\^?(\d*)")


@dataclass(frozen=True)
class RigSizes:
    """A rig's scales, in those of the reference rig."""

    effort: float = 1.0
    position: float = 1.0
    length: float = 1.0
    pressure: float = 1.0
    flow: float = 1.0
    time: float = 1.0

    @classmethod
    def of(cls, p: base.Parameters) -> RigSizes:
        """Those of a rig with a cylinder."""
        radius = float(p.pitch_radius)
        usual_radius = 1.0 if radius == 1.0 else REFERENCE_RADIUS_M  # a linear rig has no pinion
        area = max(float(p.area_a), float(p.area_b)) / _AREA_M2
        length = float(p.stroke) / _STROKE_M
        supply, atmosphere = float(p.supply), float(p.atmosphere)
        pressure = abs(supply - atmosphere) / (_SUPPLY_PA - _ATMOSPHERE_PA)
        flow = times_the_usual_flow(p)
        filled = max(supply, atmosphere) / _SUPPLY_PA * area * length
        return cls(
            effort=area * pressure * radius / usual_radius,
            position=length * usual_radius / radius,
            length=length,
            pressure=pressure,
            flow=flow,
            time=filled / flow,
        )

    @property
    def slowness(self) -> float:
        """How many times as slow as the reference rig it is; 1 where it is like that."""
        return _unless_alike(self.time)

    def times(self, quantity: Quantity) -> float:
        """How many times as large a number is on the rig; 1 where the rig is like the reference.

        Waves are as long as the position that a log visits has room for, and what a supply loses
        per flow is tried by the rig's flow: both are elsewhere.
        """
        if quantity.is_wave or quantity.is_choice or quantity.unit == PER_FLOW:
            return 1.0
        return _unless_alike(self._times(quantity.unit))

    def _times(self, unit: str) -> float:
        if unit in _INERTIA:
            return self.effort * self.time**2 / self.position
        # A sensor, a tube or an amplifier is as slow as it is, however fast the rig.
        if unit == "s":
            return max(1.0, self.time)
        if unit == "Hz":
            return min(1.0, 1.0 / self.time)
        scales = {
            "N": self.effort,
            "Nm": self.effort,
            "rad": self.position,
            "m": self.length,
            "s": self.time,
            "Pa": self.pressure,
            "kg": self.flow * self.time,
            "W": self.effort * self.position / self.time,
        }
        above, _, below = unit.partition("/")
        found = 1.0
        for part, sign in ((above, 1), (below, -1)):
            for word, power in _FACTOR.findall(part):
                found *= scales.get(word, 1.0) ** (sign * int(power or 1))
        return found


def _unless_alike(times: float) -> float:
    return 1.0 if 1.0 / LIKE < times < LIKE or not 0.0 < times < math.inf else times


def of_size(
    effects: Iterable[type[CatalogueEffect]], sizes: RigSizes
) -> list[type[CatalogueEffect]]:
    """The effects as a rig of these sizes has them: the same ports, with their numbers' usual
    sizes and ranges in its scales. An effect of which no number differs is the same class."""
    return list(_of_size(tuple(effects), sizes))


@lru_cache
def _of_size(
    effects: tuple[type[CatalogueEffect], ...], sizes: RigSizes
) -> tuple[type[CatalogueEffect], ...]:
    """Made once: what is compiled for an effect serves the next diagnosis of the rig."""
    return tuple(_sized(effect, sizes) for effect in effects)


def _sized(effect: type[CatalogueEffect], sizes: RigSizes) -> type[CatalogueEffect]:
    quantities = tuple(_scaled(q, sizes.times(q)) for q in effect.quantities)
    if quantities == effect.quantities:
        return effect

    def as_plain(self: CatalogueEffect) -> Any:
        """To another process, and to a copy, it is the effect itself."""
        return effect, tuple(getattr(self, f.name) for f in fields(effect))  # type: ignore[arg-type]

    content = {
        "quantities": quantities,
        "__doc__": effect.__doc__,
        "__module__": effect.__module__,
        "__reduce__": as_plain,
    }
    return type(effect.__name__, (effect,), content)


def _scaled(quantity: Quantity, times: float) -> Quantity:
    """A number with its usual size, range and grid so many times as large. A range holds what it
    did: the reference rig's sizes are not ruled out. Of frequencies those are tried as well: one
    is found only from nearby, and what swings on a slow rig need not be slow."""
    if times == 1.0:
        return quantity
    grid = tuple(times * value for value in quantity.grid)
    if quantity.unit == "Hz":
        grid = tuple(sorted({*quantity.grid, *grid}))
    return replace(
        quantity,
        typical=times * quantity.typical,
        lower=min(quantity.lower, times * quantity.lower),
        upper=max(quantity.upper, times * quantity.upper),
        grid=grid,
    )


__all__ = ["RigSizes", "of_size"]
