"""Constants of the rig file that a refinement freed, and what it says where they are wrong."""

from __future__ import annotations

from collections.abc import Iterable

from sysid.blocks.numbers import estimate_cells, number, unit
from sysid.estimation.linear import Estimate
from sysid.io.rig import Rig
from sysid.parameters.refinement import RefinedValue

# A constant that moved by more of its own standard errors is not what the rig file says.
_CONTRADICTED = 3.0
_MASSES = "the masses and lengths under [inertia]"
_KEYS = {
    "area_a": "[cylinder] area_a_m2",
    "area_b": "[cylinder] area_b_m2",
    "dead_length_a": "[cylinder] offset_a_m",
    "dead_length_b": "[cylinder] offset_b_m",
    "supply_pressure": "[air] supply_pressure_pa",
    "gravity_moment": _MASSES,
    "weight": "[inertia] mass_kg",
    "on_delay_a": "[valves] on_delay_s",
    "off_delay_a": "[valves] off_delay_s",
    "on_delay_b": "[valves] on_delay_s",
    "off_delay_b": "[valves] off_delay_s",
}


def contradictions(values: Iterable[RefinedValue], rig: Rig) -> list[str]:
    """A line for each freed constant whose estimate is far from what the rig file says."""
    return [
        _line(value, _key(value.name.removeprefix("rig."), rig))
        for value in values
        if value.name.startswith("rig.") and _is_contradicted(value)
    ]


def _is_contradicted(value: RefinedValue) -> bool:
    return abs(value.after.value - float(value.before)) > _CONTRADICTED * value.after.std


def _key(name: str, rig: Rig) -> str:
    """Where the rig file says it."""
    if name != "inertia":
        return _KEYS.get(name, name)
    if rig.is_linear:
        return "[inertia] mass_kg"
    whole = rig.inertia is not None and rig.inertia.equivalent_kg_m2 is not None
    return "[inertia] equivalent_kg_m2" if whole else _MASSES


def _line(value: RefinedValue, key: str) -> str:
    after: Estimate = value.after
    found, std, _, _ = estimate_cells(after)
    declared = number(float(value.before), 5)
    return (
        f"{value.name}: the rig file says {declared}, the motion tests say {found} with a standard "
        f"error of {std} {unit(after.unit)}: correct {key} and fit again (the bundle keeps the "
        "rig file's value)"
    )


__all__ = ["contradictions"]
