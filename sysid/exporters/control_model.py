"""The controllers' model on names of the header, and the same in numbers.

The effects of the bundle count in it as they do in Python: the functions of `sysid.controllers` are
evaluated with the effects' own classes. An effect with a state starts it anew at each
prediction, there as here.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sysid.controllers.design_model import DesignModel, design_from_bundle, require_declared
from sysid.controllers.effective_law import averaged_law
from sysid.errors import SysidError
from sysid.exporters.c_constants import read_constants
from sysid.exporters.c_text import Names
from sysid.exporters.control_function import ControlLaw
from sysid.exporters.control_laws import control_laws
from sysid.exporters.effect_laws import on_names
from sysid.exporters.flat import Flat, NumberTable
from sysid.exporters.symbolic import symbol
from sysid.parameters import Bundle
from sysid.plant.base import Parameters, parameter_names
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model

# An effect in numbers, and on the names of its constants.
_Pair = tuple[CatalogueEffect, CatalogueEffect]


@dataclass(frozen=True)
class ControlModel:
    """What the controllers in C know: their laws, the same model in numbers, and on names."""

    design: DesignModel
    laws: tuple[ControlLaw, ...]
    named: DesignModel
    ignored: tuple[str, ...] = ()


def control_model(
    bundle: Bundle,
    flat: Flat,
    constants: NumberTable,
    effects: Sequence[tuple[CatalogueEffect | None, bool]],
    n: Names,
    accept_assumed: bool,
) -> ControlModel | str:
    """The controllers' model of a bundle, or why it cannot be made.

    `constants` are the header's; `effects` the bundle's in its order, None for an invalid entry,
    and whether the header holds their constants.
    """
    if flat.rig.pwm is None:
        return "the rig file has no [pwm], whose period they need"
    try:
        require_declared(bundle, accept_assumed)
        design = design_from_bundle(bundle.replaced(effects=[]))
    except SysidError as reason:
        return str(reason)
    parameters = _on_names(design.parameters, flat, constants, n)
    known = [
        (effect, on_names(effect, place, flat, n) if has_names else effect)
        for place, (effect, has_names) in enumerate(effects)
        if effect is not None
    ]
    kept, laws = known, _laws(design, parameters, known)
    if laws is None:
        kept = [pair for pair in known if _laws(design, parameters, [pair]) is not None]
        laws = _laws(design, parameters, kept)
    assert laws is not None  # each has a form in C, and they act one after the other
    model = Model(design.parameters, tuple(effect for effect, _ in kept))
    ignored = tuple(pair[0].id for pair in known if not any(pair is k for k in kept))
    on_its_names = Model(parameters, tuple(named for _, named in kept))
    named = _with_model(design, on_its_names)
    return ControlModel(_with_model(design, model), laws, named, ignored)


def _with_model(design: DesignModel, model: Model) -> DesignModel:
    """The design with another model of the plant, and the averaged laws of its valves."""
    return dataclasses.replace(
        design,
        model=model,
        inverse_a=averaged_law(model, "a"),
        inverse_b=averaged_law(model, "b"),
    )


def _laws(
    design: DesignModel, parameters: Parameters, effects: Sequence[_Pair]
) -> tuple[ControlLaw, ...] | None:
    """The laws with the second of each pair; None where an effect's code has no form in C."""
    model = Model(parameters, tuple(named for _, named in effects))
    symbolic: Any = _with_model(design, model)
    try:
        return tuple(control_laws(symbolic))
    except Exception:  # whatever an effect's code raises
        if not effects:
            raise
        return None


def _on_names(parameters: Parameters, flat: Flat, constants: NumberTable, n: Names) -> Parameters:
    """Each parameter by the name of the constant that is it; else, and where 0, as a number.

    A constant that an effect has changed is not the parameter: effects act on that here.
    """
    names, found = read_constants(flat), dict[str, Any]()
    for key in parameter_names(parameters):
        value = float(getattr(parameters, key))
        name = names.get(key)
        held = constants[name].value if name in constants else None
        if value != 0.0 and held == value:
            found[key] = symbol(f"{n.lower}{name}")
        else:
            found[key] = math.copysign(1e30, value) if math.isinf(value) else value
    return Parameters(**found)


__all__ = ["ControlModel", "control_model"]
