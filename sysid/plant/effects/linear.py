"""The catalogue for a linear rig: N, m and kg in place of Nm, rad and kg m2.

The equations are the same in either unit; what differs is what numbers are called, their
usual sizes, their bounds, and the shapes that are tried. Sizes are brought over at the
pitch radius of the reference rig: a torque of 1 Nm there is a force of 1 / 0.0375 N.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sysid.io.rig import Rig
from sysid.plant.effects.entry import CatalogueEffect, Quantity

REFERENCE_RADIUS_M = 0.0375
ROTARY_ONLY = ("pitch-eccentricity", "mounting-tilt")
"""A linear axis has no pinion, and its weight is the same everywhere: an offset."""

# Power of the pitch radius by which a unit is converted from rotary to linear.
_POWERS = {"Nm": -1, "rad": 1, "rad2": 2, "kg m2": -2}
_UNITS = {"Nm": "N", "rad": "m", "rad2": "m2", "kg m2": "kg"}
_NAMES = {"nm": "n", "rad": "m", "rad2": "m2", "torque": "force"}


def linear_name(name: str) -> str:
    """A parameter's name on a linear rig: `stribeck_torque_nm` is `stribeck_force_n`."""
    words = name.replace("_kg_m2", "_kg").split("_")
    return "_".join(_NAMES.get(word, word) for word in words)


_MADE: dict[type[CatalogueEffect], type[CatalogueEffect]] = {}


def linear_form(effect: type[CatalogueEffect]) -> type[CatalogueEffect]:
    """The effect as a linear rig has it: the same ports, its quantities in N, m and kg, and its
    texts of forces and positions.
    """
    if effect not in _MADE:
        own: dict[str, Any] = {name: _worded(getattr(effect, name)) for name in _TEXTS}
        own["quantities"] = tuple(map(_linear, effect.quantities))
        content = own | {"__doc__": effect.__doc__, "__module__": __name__}
        is_same = all(getattr(effect, name) == value for name, value in own.items())
        _MADE[effect] = effect if is_same else type(_PREFIX + effect.__name__, (effect,), content)
    return _MADE[effect]


def for_rig(
    effects: Mapping[str, type[CatalogueEffect]], is_linear: bool
) -> dict[str, type[CatalogueEffect]]:
    """Effects by id as a rotary or a linear rig has them."""
    return {k: linear_form(v) for k, v in effects.items()} if is_linear else dict(effects)


def possible_on(
    effects: Mapping[str, type[CatalogueEffect]], rig: Rig
) -> dict[str, type[CatalogueEffect]]:
    """Effects by id as a rig has them, without those of a chamber that it lacks."""
    own = {k: v for k, v in effects.items() if v.is_of(rig.sides)}
    return for_rig(own, rig.is_linear)


def _linear(quantity: Quantity) -> Quantity:
    power = quantity.radius_power
    scale = float(REFERENCE_RADIUS_M ** (_power(quantity.unit) if power is None else power))
    name = linear_name(quantity.name)
    if scale == 1.0 and name == quantity.name:
        return quantity
    return replace(
        quantity,
        key=name,
        unit=_unit(quantity.unit),
        typical=_scaled(quantity.typical, scale),
        lower=_scaled(quantity.lower, scale),
        upper=_scaled(quantity.upper, scale),
        grid=tuple(_scaled(value, scale) for value in quantity.grid),
        meaning=_worded(quantity.meaning),
        caption=_worded(quantity.caption),
        forms=tuple((value, _worded(said)) for value, said in quantity.forms),
        absent=None if quantity.absent is None else _scaled(quantity.absent, scale),
    )


_TEXTS = ("title", "signature", "tie_breaker")
_LINEAR_WORDS = {
    "torque": "force",
    "torques": "forces",
    "Torque": "Force",
    "angle": "position",
    "angles": "positions",
    "arm": "axis",
    "Nm": "N",
}
_WORDS = re.compile(rf"\b({'|'.join(_LINEAR_WORDS)})\b")


def _worded(text: str) -> str:
    return _WORDS.sub(lambda found: _LINEAR_WORDS[found[0]], text)


def _scaled(value: float, scale: float) -> float:
    """Rounded to four digits, so that a bound is a readable number."""
    scaled = value * scale
    return scaled if scaled == 0.0 or not math.isfinite(scaled) else float(f"{scaled:.4g}")


_TOKEN = re.compile(r"kg m2|Nm|rad2|rad")


def _power(unit: str) -> int:
    above, _, below = unit.partition("/")
    return sum(_POWERS[t] for t in _TOKEN.findall(above)) - sum(
        _POWERS[t] for t in _TOKEN.findall(below)
    )


def _unit(unit: str) -> str:
    return _TOKEN.sub(lambda match: _UNITS[match.group()], unit)


_PREFIX = "Linear"


def __getattr__(name: str) -> Any:
    """A class made by `linear_form`, found by its name, as worker processes unpickle it."""
    from sysid.plant.effects.catalogue import catalogue

    for kind in catalogue().values():
        for effect in (kind, *kind.__subclasses__()):
            if name == f"{_PREFIX}{effect.__name__}":
                return linear_form(effect)
    raise AttributeError(name)


__all__ = ["REFERENCE_RADIUS_M", "for_rig", "linear_form", "linear_name"]
