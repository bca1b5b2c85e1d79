"""The header's constants, and which of them each parameter of the model is."""

from __future__ import annotations

import math
from dataclasses import replace

from sysid.exporters.flat import (
    ExportedNumber,
    Flat,
    NumberTable,
    gravity_name,
    inertia_name,
    spring_names,
)
from sysid.io.channels import SIDES
from sysid.io.motion import FRICTION
from sysid.parameters.table import field_of
from sysid.parameters.valves import ISO_KEYS, LAW_KEYS, VALVE_ALONE
from sysid.plant.base import PARAMETER_NAMES, SPRING_NAMES

GAS = ("gas_constant", "heat_capacity_ratio", "temperature")
"""The parameters whose product is k R T."""

K_R_T = "k_r_t_j_per_kg"

SAME_NAMES = {
    "area_a": "area_a_m2",
    "area_b": "area_b_m2",
    "offset_a": "offset_a_m",
    "offset_b": "offset_b_m",
    "stroke": "stroke_m",
    "pitch_radius": "pitch_radius_m",
    "gas_constant": "gas_constant_j_per_kg_k",
    "heat_capacity_ratio": "heat_capacity_ratio",
    "temperature": "temperature_k",
    "atmosphere": "atmospheric_pressure_pa",
    "pwm_period": "pwm_period_s",
}
# Several parameters are one constant of the rig: it is read for each, and changed for none.
_SHARED = {
    "supply": "supply_pressure_pa",
    "supply_reference": "supply_pressure_pa",
    **{f"{edge}_delay_{s}": f"declared_{edge}_delay_s" for s in SIDES for edge in ("on", "off")},
}


def header_constants(flat: Flat) -> NumberTable:
    """All scalars by C name without prefix: the rig's, friction, and each valve's law."""
    table = dict(flat.constants)
    table |= {f"friction_{name}": quantity for name, quantity in flat.friction.items()}
    for side in flat.valves:
        law = flat.valves[side].discrete
        table |= {f"valve_{side}_{name}": quantity for name, quantity in law.items()}
    return table


def own_constants(flat: Flat) -> dict[str, str]:
    """Parameter of the model -> the constant that is it alone, which an effect may change."""
    found = dict(SAME_NAMES)
    found |= {field_of(name): f"friction_{flat.rig.units.key(name)}" for name in FRICTION}
    found["inertia"] = inertia_name(flat.rig)[0]
    found["weight" if flat.rig.is_linear else "gravity_moment"] = gravity_name(flat.rig)[0]
    found["max_effort"] = flat.rig.units.max_effort
    if flat.rig.spring_law is not None:
        found |= zip(SPRING_NAMES, spring_names(flat.rig), strict=True)
    for side in SIDES:
        held = flat.valves[side].discrete if side in flat.valves else LAW_KEYS.values()
        keys = {**LAW_KEYS, **{name: name for name in (*ISO_KEYS, *VALVE_ALONE.values())}}
        found |= {field_of(n, side): f"valve_{side}_{k}" for n, k in keys.items() if k in held}
    return found


def read_constants(flat: Flat) -> dict[str, str]:
    """Parameter of the model -> constant that holds its value, changed by effects or not."""
    return {**own_constants(flat), **_SHARED}


def parameter_values(flat: Flat, table: NumberTable) -> dict[str, float]:
    """Every parameter of the model: its constant's value, NaN where unknown, 0 where it has none.

    None has the constant offset, and that of gravity which the rig's motion does not have. A
    spring's are there where the rig has one.
    """
    names, found = read_constants(flat), dict.fromkeys(PARAMETER_NAMES, 0.0)
    for key, name in names.items():
        value = table[name].value if name in table else None
        found[key] = math.nan if value is None else value
    return found


def with_parameters(flat: Flat, table: NumberTable, changed: dict[str, float]) -> NumberTable:
    """The constants with some parameters changed, and k R T worked out again where it depends."""
    names, found = own_constants(flat), dict(table)
    for key, value in changed.items():
        found[names[key]] = replace(found[names[key]], value=value)
    if any(key in changed for key in GAS) and found[K_R_T].value is not None:
        product = math.prod(found[names[key]].value or 0.0 for key in GAS)
        found[K_R_T] = ExportedNumber(product, found[K_R_T].unit)
    return found


__all__ = [
    "GAS",
    "K_R_T",
    "SAME_NAMES",
    "header_constants",
    "own_constants",
    "parameter_values",
    "read_constants",
    "with_parameters",
]
