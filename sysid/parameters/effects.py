"""An entry of a bundle's `effects`: an effect that was added to the model, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, WithJsonSchema

from sysid.errors import input_error
from sysid.estimation.linear import Estimate
from sysid.parameters.base import Absent, Number, Part

if TYPE_CHECKING:
    from sysid.plant.effects.entry import Catalogue, CatalogueEffect, Quantity

SIDE = "side"
# Times the catalogue's largest strength, which is that of a rig like the reference rig.
_LARGEST_RIG = 1e3
_FIX = "fix that key, or diagnose again to rewrite the bundle"

_PARAMETERS: dict[str, Any] = {
    "type": "object",
    "properties": {"side": {"enum": ["a", "b", "both"]}},
    "additionalProperties": {"x-ref": "effect_parameter"},
}
_SHARE = {"type": ["number", "null"], "minimum": 0, "maximum": 1}
_ERROR = {"type": ["number", "null"], "minimum": 0}

Side = Literal["a", "b", "both"]


def _require_within(least: float, most: float, *values: Any) -> None:
    """ValueError for a number of a file beyond these limits."""
    numbers = [value for value in values if isinstance(value, int | float)]
    if not all(least <= value <= most for value in numbers):
        raise ValueError(f"is not from {least:g} to {most:g}")


class HeldOutError(Part):
    """RMSE on the held-out logs without and with an effect, in the channel's unit."""

    before: Annotated[Number | None, WithJsonSchema(_ERROR)]
    after: Annotated[Number | None, WithJsonSchema(_ERROR)]

    @classmethod
    def _check_form(cls, data: Mapping[str, Any]) -> None:
        super()._check_form(data)
        _require_within(0.0, math.inf, *data.values())


class EffectEntry(Part):
    """An effect of the model by its id, its parameters by name (and `side`), and its evidence.

    `chosen_by`: "user" where a person chose it and no diagnosis did.
    """

    id: str
    parameters: Annotated[dict[str, Estimate | Side], WithJsonSchema(_PARAMETERS)]
    p_value: Annotated[Number | None, WithJsonSchema(_SHARE)] = None
    holdout_rmse: Absent[dict[str, HeldOutError]] = None
    ambiguous_with: list[str] = Field(default_factory=list)
    chosen_by: Absent[Literal["user"]] = None

    @classmethod
    def _check_form(cls, data: Mapping[str, Any]) -> None:
        super()._check_form(data)
        _require_within(0.0, 1.0, data.get("p_value"))
        held = data.get("parameters")
        given = held if isinstance(held, Mapping) else {}
        # Which of the two a parameter is follows from its name, which a type does not say.
        if isinstance(given.get(SIDE), Mapping):
            raise ValueError("is a number, not a side")
        stds = [one.get("std") for one in given.values() if isinstance(one, Mapping)]
        _require_within(0.0, math.inf, *stds)

    def numbers(self) -> dict[str, Estimate]:
        """The parameters that are numbers, in the file's order."""
        return {k: v for k, v in self.parameters.items() if isinstance(v, Estimate)}


def entry_of(
    effect: CatalogueEffect, estimates: Mapping[str, Estimate] | None = None
) -> EffectEntry:
    """An effect as listed in a bundle: each quantity with its standard error, and the side.

    `estimates` by the name of a quantity, in its unit: their errors and intervals are kept. A
    quantity without one was not fitted. Raises ValueError for a name that is not a quantity of
    the effect, or a value that is not finite.
    """
    estimates = estimates or {}
    unknown = sorted(set(estimates) - {q.name for q in effect.quantities})
    if unknown:
        raise ValueError(f"{effect.id} has no quantity {', '.join(unknown)}")
    parameters: dict[str, Any] = {
        q.label: _with_error(effect, q, estimates.get(q.name)) for q in effect.quantities
    }
    if effect.has_side():
        parameters[SIDE] = getattr(effect, SIDE)
    return EffectEntry(id=effect.id, parameters=parameters)


def _with_error(effect: CatalogueEffect, quantity: Quantity, known: Estimate | None) -> Estimate:
    value = float(getattr(effect, quantity.name))
    if not math.isfinite(value):
        raise ValueError(f"{effect.id}: {quantity.name} is not finite")
    if known is None or not known.identified:
        return Estimate(value, math.nan, quantity.unit, (math.nan, math.nan))
    return Estimate(value, known.std, quantity.unit, known.interval)


def effect_from_entry(entry: EffectEntry, where: str, catalogue: Catalogue) -> Any:
    """The effect that an entry of a bundle's `effects` describes; `where` names the bundle.

    A parameter that is newer than the bundle has the value of the effect's older form
    (`Quantity.absent`). Raises InputError for an id that the catalogue lacks, a parameter that
    is missing, unknown, not identified, in another unit or out of its bounds, and a bad side.
    """
    place = f"{where}, effect {entry.id}"
    effect = catalogue.get(entry.id)
    if effect is None:
        raise input_error(
            place,
            "is not in the catalogue",
            "see `sysid effects`, and give further effects with --effects FILE",
        )
    older = {q.label: q.absent for q in effect.quantities if q.absent is not None}
    given = {**older, **entry.parameters}
    quantities = {q.label: q for q in effect.quantities}
    known = {*quantities, *([SIDE] if effect.has_side() else [])}
    for key in (*known.difference(given), *set(given).difference(known)):
        what = f"{key} is missing" if key in known else f"has no parameter {key}"
        raise input_error(place, what, f"its parameters are {', '.join(sorted(known))}")
    fields: dict[str, Any] = {
        q.name: _value(given[key], q, f"{place}, {key}") for key, q in quantities.items()
    }
    if effect.has_side():
        fields[SIDE] = given[SIDE]
    return effect(**fields)


def _value(estimate: Estimate | Side | float, quantity: Quantity, where: str) -> float:
    if isinstance(estimate, float):
        return estimate
    if not isinstance(estimate, Estimate):
        raise input_error(where, 'is not an object with a "value"', _FIX)
    if not estimate.identified:
        reason = f" ({estimate.reason})" if estimate.reason else ""
        raise input_error(
            where,
            f"is not identified{reason}: its value is null",
            "diagnose again, or remove the effect from the bundle",
        )
    unit = estimate.unit or quantity.unit
    if unit != quantity.unit:
        raise input_error(where, f"is in {unit!r}, not {quantity.unit!r}", _FIX)
    lower, upper = _readable(quantity)
    if not lower <= estimate.value <= upper:
        bounds = f"{lower:g} to {upper:g} {quantity.unit}"
        raise input_error(where, f"{estimate.value:g} is out of its bounds, {bounds}", _FIX)
    if quantity.is_choice and estimate.value not in quantity.grid:
        choices = ", ".join(f"{value:g}" for value in quantity.grid)
        raise input_error(where, f"{estimate.value:g} is none of {choices}", _FIX)
    return estimate.value


def _readable(quantity: Quantity) -> tuple[float, float]:
    """Its bounds in a file: far beyond the catalogue's where a rig may have any size."""
    low, high = quantity.anywhere
    beyond = _LARGEST_RIG * max(abs(quantity.lower), abs(quantity.upper))
    return (
        -beyond if math.isinf(low) else low,
        beyond if math.isinf(high) else high,
    )


__all__ = ["EffectEntry", "HeldOutError", "Side", "effect_from_entry", "entry_of"]
