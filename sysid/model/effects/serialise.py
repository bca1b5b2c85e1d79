"""An effect as a bundle's `effects` list holds it, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sysid.errors import InputError, input_error
from sysid.model.effects.entry import SIDE_CHOICES, CatalogueEffect, Quantity

SIDE = "side"
Catalogue = Mapping[str, type[CatalogueEffect]]
Interval = tuple[float | None, float | None]

_MEND = "mend that key, or diagnose again to write the bundle anew"


def effect_to_dict(
    effect: CatalogueEffect,
    stds: Mapping[str, float | None],
    intervals: Mapping[str, Interval] | None = None,
) -> dict[str, Any]:
    """{"id", "parameters"}: each quantity's value, standard error and unit, and the side.

    `stds` and `intervals` (95 %) by quantity, in its unit. A quantity without a standard
    error was not fitted: null, as is a bound that is not finite. Raises ValueError for a
    name that is no quantity of the effect, or a value that is not finite.
    """
    intervals = intervals or {}
    unknown = sorted({*stds, *intervals} - {q.name for q in effect.quantities})
    if unknown:
        raise ValueError(f"{effect.id} has no quantity {', '.join(unknown)}")
    parameters: dict[str, Any] = {}
    for quantity in effect.quantities:
        name = quantity.name
        value = float(getattr(effect, name))
        if not math.isfinite(value):
            raise ValueError(f"{effect.id}: {name} is not finite")
        entry: dict[str, Any] = {
            "value": value,
            "std": _finite_or_none(stds.get(name)),
            "unit": quantity.unit,
        }
        if name in intervals:
            entry["interval"] = [_finite_or_none(bound) for bound in intervals[name]]
        parameters[quantity.label] = entry
    if effect.has_side():
        parameters[SIDE] = getattr(effect, SIDE)
    return {"id": effect.id, "parameters": parameters}


def effect_from_dict(content: Mapping[str, Any], where: str, catalogue: Catalogue) -> Any:
    """The effect that an entry of a bundle's `effects` describes; `where` names the bundle.

    Raises InputError for an id that the catalogue lacks, a parameter that is missing,
    unknown, not identified, in another unit or out of its bounds, and a bad side.
    """
    name = str(content.get("id"))
    place = f"{where}, effect {name}"
    effect = catalogue.get(name)
    if effect is None:
        raise input_error(
            place,
            "is not in the catalogue",
            "see `sysid effects`, and give a user's own effect with --effects FILE",
        )
    given = content.get("parameters", {})
    quantities = {q.label: q for q in effect.quantities}
    known = {*quantities, *([SIDE] if effect.has_side() else [])}
    for key in (*known.difference(given), *set(given).difference(known)):
        what = f"{key} is missing" if key in known else f"has no parameter {key}"
        raise input_error(place, what, f"its parameters are {', '.join(sorted(known))}")
    fields: dict[str, Any] = {
        quantity.name: _value(given[key], quantity, place) for key, quantity in quantities.items()
    }
    if effect.has_side():
        fields[SIDE] = _side(given[SIDE], place)
    return effect(**fields)


def _value(estimate: Any, quantity: Quantity, place: str) -> float:
    where = f"{place}, {quantity.label}"
    if not isinstance(estimate, Mapping) or "value" not in estimate:
        raise input_error(where, 'is not an object with a "value"', _MEND)
    value, unit = estimate["value"], estimate.get("unit", quantity.unit)
    if value is None:
        reason = f" ({estimate['reason']})" if "reason" in estimate else ""
        raise input_error(
            where,
            f"is not identified{reason}: its value is null",
            "diagnose again, or take the effect out of the bundle",
        )
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise input_error(where, f"{str(value)[:40]!r} is not a finite number", _MEND)
    if unit != quantity.unit:
        raise input_error(where, f"is in {unit!r}, not {quantity.unit!r}", _MEND)
    if not quantity.lower <= value <= quantity.upper:
        raise _out_of_bounds(float(value), quantity, where)
    return float(value)


def _out_of_bounds(value: float, quantity: Quantity, where: str) -> InputError:
    bounds = f"{quantity.lower:g} to {quantity.upper:g} {quantity.unit}"
    return input_error(where, f"{value:g} is out of its bounds, {bounds}", _MEND)


def _side(side: Any, place: str) -> str:
    if side not in SIDE_CHOICES:
        choices = ", ".join(f'"{choice}"' for choice in SIDE_CHOICES)
        raise input_error(f"{place}, {SIDE}", f"{str(side)[:40]!r} is no side", f"use {choices}")
    return str(side)


def _finite_or_none(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


__all__ = ["Catalogue", "effect_from_dict", "effect_to_dict"]
