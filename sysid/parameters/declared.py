"""The constants of a model that were not fitted, and notices where a refinement contradicts
them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from sysid.blocks.numbers import estimate_cells, number, unit
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import DISAGREE
from sysid.io.rig import Rig
from sysid.parameters.refinement import RefinedValue
from sysid.parameters.table import ParameterRow, Status
from sysid.plant.base import Parameters

DECLARED_ERROR = 0.03
"""Relative standard error of a constant that a rig file declares, and of any without one."""
_MASSES = "the masses and lengths under [inertia]"
# What the plant's parameters call each, its key, its unit, and where the rig file says it.
_MECHANICS = (
    ("inertia", "inertia", "", ""),
    ("gravity_moment", "gravity_moment", "Nm", _MASSES),
    ("weight", "weight", "N", "[inertia] mass_kg"),
)
_CONSTANTS = (
    _MECHANICS[0],
    ("area_a", "area_a", "m2", "[cylinder] area_a_m2"),
    ("area_b", "area_b", "m2", "[cylinder] area_b_m2"),
    ("offset_a", "dead_length_a", "m", "[cylinder] offset_a_m"),
    ("offset_b", "dead_length_b", "m", "[cylinder] offset_b_m"),
    ("supply", "supply_pressure", "Pa", "[air] supply_pressure_pa"),
    *_MECHANICS[1:],
    ("on_delay_a", "on_delay_a", "s", "[valves] on_delay_s"),
    ("off_delay_a", "off_delay_a", "s", "[valves] off_delay_s"),
    ("on_delay_b", "on_delay_b", "s", "[valves] on_delay_s"),
    ("off_delay_b", "off_delay_b", "s", "[valves] off_delay_s"),
)
_PLACES = {f"rig.{key}": place for _, key, _, place in _CONSTANTS}


def declared_of(rig: Rig, parameters: Parameters) -> Iterator[ParameterRow]:
    """The rig file's constants in a model, with 3 % for a standard error."""
    for field, key, named, _ in _MECHANICS if rig.is_motor_alone else _CONSTANTS:
        value = float(getattr(parameters, field))
        if value > 0.0 and math.isfinite(value):
            std, alias = DECLARED_ERROR * value, f"rig.{key}"
            known = Estimate(value, std, named or rig.units.inertia_unit, (math.nan, math.nan))
            section = _place(alias, rig).rpartition("[")[2].partition("]")[0]
            status: Status = "assumed" if rig.assumes(section) else "declared"
            yield ParameterRow("rig", key, field, known, "rig", alias, status=status)


def contradictions(values: Iterable[RefinedValue], rig: Rig) -> list[str]:
    """A line for each freed constant whose estimate is far from what the rig file says."""
    return [
        _line(value, _place(value.name, rig))
        for value in values
        if value.name.startswith("rig.") and _is_contradicted(value)
    ]


def _is_contradicted(value: RefinedValue) -> bool:
    return abs(value.after.value - float(value.before)) > DISAGREE * value.after.std


def _place(alias: str, rig: Rig) -> str:
    """The place in the rig file that states it."""
    if alias != "rig.inertia":
        return _PLACES.get(alias, alias)
    whole = rig.inertia is not None and rig.inertia.equivalent_kg_m2 is not None
    return f"[inertia] {rig.units.rig_inertia}" if rig.is_linear or whole else _MASSES


def _line(value: RefinedValue, key: str) -> str:
    after: Estimate = value.after
    found, std, _, _ = estimate_cells(after)
    declared = number(float(value.before), 5)
    return (
        f"{value.name}: the rig file says {declared}, the motion tests say {found} with a standard "
        f"error of {std} {unit(after.unit)}: correct {key} and fit again (the bundle keeps the "
        "rig file's value)"
    )


__all__ = ["contradictions", "declared_of"]
