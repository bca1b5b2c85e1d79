"""The catalogue: every effect by its id, the classes that data cannot separate, user effects."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sysid.errors import input_error
from sysid.io.user_code import run_file
from sysid.plant.effects import (
    bench,
    chamber,
    friction,
    linkage,
    motor,
    sensor,
    stroke,
    supply,
    valve,
)
from sysid.plant.effects.entry import Catalogue, CatalogueEffect, Quantity

AMBIGUOUS_CLASSES: tuple[frozenset[str], ...] = (
    frozenset(
        {
            "torque-offset",
            "ambient-pressure-error",
            "asymmetric-coulomb-friction",
            "mounting-tilt",
            "area-error",
        }
    ),
    frozenset({"pressure-lag", "time-skew", "tube-lag"}),
    frozenset({"torque-constant-error", "pitch-eccentricity"}),
    frozenset({"pressure-offset", "pressure-gain"}),
    frozenset({"polytropic-exponent", "dead-volume-error"}),
    frozenset(
        {
            "subsonic-flow-shape",
            "choked-exhaust-scaling",
            "supply-droop",
            "atmosphere-leakage",
        }
    ),
)
"""Effects that ordinary data cannot distinguish."""

_MODULES = (friction, linkage, stroke, motor, chamber, valve, bench, supply, sensor)
_ATTRIBUTES = ("id", "title", "subsystem", "quantities", "signature", "source")


def catalogue() -> dict[str, type[CatalogueEffect]]:
    """Every effect of the project's own catalogue, by id, subsystem by subsystem."""
    return {effect.id: effect for module in _MODULES for effect in module.EFFECTS}


def class_of(effect: str) -> frozenset[str]:
    """The ids that ordinary data cannot distinguish from this one, itself included."""
    for members in AMBIGUOUS_CLASSES:
        if effect in members:
            return members
    return frozenset({effect})


def load_user_effects(path: Path) -> dict[str, type[CatalogueEffect]]:
    """The effects that a user's Python file defines, by id. Runs the file.

    Each is a frozen dataclass derived from `CatalogueEffect`; docs/how-to/own-effect.md shows one.
    Its ports (`sysid.plant.ports.Effect`) get arrays of numpy and of jax, so they are written
    without branches on values; `sysid.plant.base.array_namespace` gives the module to call.

    Raises InputError where the file does not run, defines none, or defines one that is not
    complete or takes the id of another.
    """
    module = run_file(path, "effects")
    found = [
        value
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, CatalogueEffect)
        and value.__module__ == module.__name__
    ]
    if not found:
        raise input_error(
            path, "defines no effect", "derive one from sysid.plant.effects.CatalogueEffect"
        )
    return _checked(found, f"{path}, ", "another class of this file")


def _checked(
    found: Iterable[type[CatalogueEffect]], where: str, others: str
) -> dict[str, type[CatalogueEffect]]:
    """A user's effects by id. Raises InputError for an incomplete effect or an id that is taken."""
    effects: dict[str, type[CatalogueEffect]] = {}
    own = catalogue()
    for effect in found:
        place = f"{where}class {effect.__name__}"
        _check_entry(place, effect)
        if effect.id in own or effect.id in effects:
            of = "the catalogue" if effect.id in own else others
            raise input_error(place, f"takes the id {effect.id} of {of}", "choose another id")
        effects[effect.id] = effect
    return effects


def _check_entry(where: str, effect: type[CatalogueEffect]) -> None:
    missing = [name for name in _ATTRIBUTES if not hasattr(effect, name)]
    if missing:
        raise input_error(where, f"has no {', '.join(missing)}", "add it")
    made = vars(effect).get("__dataclass_params__")
    if made is None or not made.frozen:
        raise input_error(
            where, "is not a frozen dataclass", "put @dataclass(frozen=True) above it"
        )
    if not isinstance(effect.quantities, tuple) or not all(
        isinstance(q, Quantity) for q in effect.quantities
    ):
        raise input_error(
            where, "quantities is not a tuple of Quantity", "make it one: (Quantity(),)"
        )
    if not effect.strengths():
        raise input_error(where, "has no strength", "make one quantity 0 where the effect vanishes")
    fields = {f.name: f for f in dataclasses.fields(effect)}  # type: ignore[arg-type]
    for quantity in effect.quantities:
        if quantity.name not in fields:
            raise input_error(
                where, f"has no field {quantity.name}", "every quantity names a field"
            )
        if quantity.is_choice and (quantity.is_strength or len(quantity.grid) < 2):
            fix = "give it is_strength=False and a grid of its values"
            raise input_error(where, f"{quantity.name} is a choice without values", fix)
        default = fields[quantity.name].default
        if quantity.is_strength and default != 0.0:
            what = (
                "has no default" if default is dataclasses.MISSING else f"is {default} by default"
            )
            fix = "make it 0, where the effect vanishes: it is a strength"
            raise input_error(where, f"{quantity.name} {what}", fix)
    named = {q.name for q in effect.quantities} | {"side"}
    unnamed = [f.name for f in fields.values() if f.name not in named]
    if unnamed:
        raise input_error(where, f"no quantity names {', '.join(unnamed)}", "add a Quantity")
    _check_ports(where, effect)


def _check_ports(where: str, effect: type[CatalogueEffect]) -> None:
    """An effect without a port does nothing: a misspelt one would pass for an effect of no size."""
    above = effect.__mro__[: effect.__mro__.index(CatalogueEffect)]
    own = {name for kind in above for name, value in vars(kind).items() if callable(value)}
    ports = {name for name in dir(CatalogueEffect) if not name.startswith("_")}
    if own & ports:
        return
    near = [n for name in sorted(own) for n in difflib.get_close_matches(name, ports, 1)]
    hint = f"did you mean {near[0]}?" if near else "define a method of sysid.plant.ports.Effect"
    raise input_error(where, "acts through no port", hint)


def catalogue_with(path: Path | None) -> Catalogue:
    """The catalogue of effects, together with those of a user's file (None: no file).

    Runs the file. Raises InputError where it cannot be used.
    """
    return catalogue() if path is None else {**catalogue(), **load_user_effects(path)}


EffectSource = str | Path | Iterable[type[CatalogueEffect]] | None
"""User-defined effects: the Python file that defines them, or the classes themselves."""


def catalogue_from(effects: EffectSource) -> Catalogue:
    """The catalogue together with user-defined effects, from a file or as classes.

    Raises InputError where they cannot be used.
    """
    if effects is None or isinstance(effects, str | Path):
        return catalogue_with(None if effects is None else Path(effects))
    return {**catalogue(), **_checked(effects, "effects, ", "another class")}


def effect_named(name: str, effects: Catalogue) -> type[CatalogueEffect]:
    """The effect of an id; InputError, which names the nearest one, for an unknown id."""
    if name in effects:
        return effects[name]
    near = difflib.get_close_matches(name, effects, 1)
    hint = f"did you mean {near[0]}?" if near else "`sysid effects` lists them"
    raise input_error(f"effect {name}", "is not in the catalogue", hint)


def catalogue_entry(effect: type[CatalogueEffect]) -> dict[str, Any]:
    """An effect's entry in the catalogue, as JSON holds it."""
    parameters = [
        {
            "name": q.label,
            "unit": q.unit,
            "typical": q.typical,
            "bounds": [q.lower, q.upper],
            "is_strength": q.is_strength,
            "meaning": q.meaning,
        }
        for q in effect.quantities
    ]
    return {
        "id": effect.id,
        "title": effect.title,
        "subsystem": effect.subsystem,
        "law": _law(effect),
        "parameters": parameters,
        "has_side": effect.has_side(),
        "signature": effect.signature,
        "rivals": list(effect.rivals),
        "tie_breaker": effect.tie_breaker,
        "ambiguous_with": sorted(class_of(effect.id) - {effect.id}),
        "source": effect.source,
    }


def _law(effect: type[CatalogueEffect]) -> str:
    """The class's docstring; empty where Python generated it."""
    text = (effect.__doc__ or "").partition("\n\n")[0]
    return "" if text.startswith(f"{effect.__name__}(") else " ".join(text.split())


__all__ = [
    "AMBIGUOUS_CLASSES",
    "EffectSource",
    "catalogue",
    "catalogue_entry",
    "catalogue_from",
    "catalogue_with",
    "class_of",
    "effect_named",
    "load_user_effects",
]
