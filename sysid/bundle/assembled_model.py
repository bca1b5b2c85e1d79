"""The model that a bundle describes: parameters, and PWM surfaces as the plant reads them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.errors import InputError, NotIdentifiedError, input_error
from sysid.io.channels import SIDES
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.model.base import (
    Array,
    Parameters,
    ValveParameters,
    array_namespace,
    parameters_from_rig,
)
from sysid.model.effects.catalogue import catalogue_with
from sysid.model.effects.linear import for_rig
from sysid.model.effects.serialise import Catalogue, effect_from_dict
from sysid.model.ports import Effect, Model, has_discrete_law
from sysid.model.trials import DISCRETE, simulate_trials
from sysid.types import FloatArray

SURFACE_KINDS = ("bipolynomial", "ann")
DIRECTIONS = ("fill", "discharge")
# Nodes of a surface's table over duty and pressure. Between them the table is bilinear: a
# bipolynomial's flow is then off by less than 1e-4 of its range (tested).
_NODES = 65
_SAME_PERIOD = 1e-6

_TESTS = {
    "static": "friction-static tests (a torque ramp from rest)",
    "coulomb": "friction-sliding tests (constant torques, two levels or more)",
    "viscous": "friction-sliding tests (constant torques, two levels or more)",
}
_VALVE_KEYS = {
    "choked_fill": "choked_flow_fill_kg_s",
    "choked_dis": "choked_flow_dis_kg_s",
    "c_fill": "c_fill",
    "c_dis": "c_dis",
}


@dataclass(frozen=True)
class TabulatedSurfaces:
    """Mean flow of one valve under PWM over duty and pressure: two tables, bilinear.

    `filling` and `discharging` (nodes, nodes) kg/s, rows duty and columns pressure, evenly
    spaced from `..._low` to `..._high` (0 to 1 and Pa). Beyond them the inputs saturate, as
    those of the surfaces themselves do. Arrays of any library; a flat dataclass of numbers,
    as the simulation's compilation needs it.
    """

    filling: Array
    filling_duty_low: Array
    filling_duty_high: Array
    filling_pressure_low: Array
    filling_pressure_high: Array
    discharging: Array
    discharging_duty_low: Array
    discharging_duty_high: Array
    discharging_pressure_low: Array
    discharging_pressure_high: Array

    def fill(self, duty: Array, pressure: Array) -> Array:
        """Mean flow into the chamber while its pressure rises, kg/s."""
        return _bilinear(
            self.filling,
            (duty, self.filling_duty_low, self.filling_duty_high),
            (pressure, self.filling_pressure_low, self.filling_pressure_high),
        )

    def discharge(self, duty: Array, pressure: Array) -> Array:
        """Mean flow (negative: out) while the chamber's pressure falls, kg/s."""
        return _bilinear(
            self.discharging,
            (duty, self.discharging_duty_low, self.discharging_duty_high),
            (pressure, self.discharging_pressure_low, self.discharging_pressure_high),
        )


_Axis = tuple[Array, Array, Array]


def _bilinear(table: Array, rows: _Axis, columns: _Axis) -> Array:
    """`table` at (value, low, high) along its rows and its columns; saturated at its edges."""
    xp = array_namespace(rows[0], columns[0])
    cells, shares = [], []
    for (value, low, high), size in zip((rows, columns), table.shape, strict=True):
        place = xp.clip((value - low) / (high - low), 0.0, 1.0) * (size - 1)
        cell = xp.minimum(xp.floor(place), size - 2)
        cells.append(cell.astype(int))
        shares.append(place - cell)
    (i, j), (s, t) = cells, shares
    lower = (1.0 - t) * table[i, j] + t * table[i, j + 1]
    upper = (1.0 - t) * table[i + 1, j] + t * table[i + 1, j + 1]
    return (1.0 - s) * lower + s * upper


def parameters_from_bundle(
    bundle: Mapping[str, Any], rig: Rig, where: str = "bundle"
) -> Parameters:
    """The base model's parameters: what was fitted from `bundle`, the rest from `rig`.

    `where` names the bundle in messages. A valve without a discrete law gets NaN flows, so
    that it cannot be used by mistake; see `has_discrete_law`. The offset that a friction fit
    estimates beside friction is left out: the base model has none, and an offset that is
    only noise would push an open-loop position away (the effect `torque-offset` is for a
    real one). Negative friction is taken for 0 (`negative_friction` says so). Raises InputError
    where the rig file lacks a section, NotIdentifiedError where the bundle has no friction.
    """
    inertia_key = "mass_kg" if rig.is_linear else "inertia_kg_m2"
    friction = bundle.get("friction")
    if friction is None:
        raise NotIdentifiedError(
            f"{where}: holds no friction; fit friction-static and friction-sliding tests into it"
        )
    values = {
        name: max(_identified(friction, key, f"{where}, friction", _TESTS[name]), 0.0)
        for name, key in friction_keys(rig.is_linear).items()
    }
    parameters = parameters_from_rig(
        rig,
        static_effort=values["static"],
        coulomb_effort=values["coulomb"],
        viscous=values["viscous"],
        valve_a=_discrete_law(bundle, "a", where),
        valve_b=_discrete_law(bundle, "b", where),
    )
    inertia = _value_or(friction.get(inertia_key), math.nan)
    return parameters if math.isnan(inertia) else parameters.replace(inertia=inertia)


def friction_keys(is_linear: bool) -> dict[str, str]:
    """The bundle's key of each friction parameter: static, Coulomb and viscous."""
    effort, viscous = ("n", "n_s_per_m") if is_linear else ("nm", "nm_s_per_rad")
    return {
        "static": f"static_{effort}",
        "coulomb": f"coulomb_{effort}",
        "viscous": f"viscous_{viscous}",
    }


def negative_friction(bundle: Mapping[str, Any], where: str = "bundle") -> list[str]:
    """Notices of friction that tests gave a negative value, and that models take for 0."""
    friction = bundle.get("friction", {})
    values = {
        key: _value_or(friction.get(key), 0.0) for key in friction_keys(_is_linear(bundle)).values()
    }
    return [
        f"{where}: {key} is {value:.3g}, which no friction is: the model takes 0; the friction "
        "tests hold an effect that it lacks"
        for key, value in values.items()
        if value < 0.0
    ]


def model_from_bundle(
    bundle: Mapping[str, Any],
    rig: Rig,
    where: str = "bundle",
    catalogue: Catalogue | None = None,
) -> Model:
    """The model with a bundle's parameters and effects, these in the bundle's order.

    `catalogue` maps ids to effects; None is the project's own. Raises as
    `parameters_from_bundle` and `effects_from_bundle` do.
    """
    effects = effects_from_bundle(bundle, where, catalogue)
    return Model(parameters_from_bundle(bundle, rig, where), effects)


def effects_from_bundle(
    bundle: Mapping[str, Any], where: str = "bundle", catalogue: Catalogue | None = None
) -> tuple[Effect, ...]:
    """The effects that a bundle lists, in its order.

    Raises InputError for an effect that `catalogue` lacks, one whose parameters are not its
    own (`effect_from_dict`), and two that need the same state.
    """
    content = bundle.get("effects", [])
    if not content:
        return ()
    if catalogue is None:
        catalogue = catalogue_with(None)
    catalogue = for_rig(catalogue, _is_linear(bundle))
    effects: list[Effect] = []
    for entry in content:
        effect = effect_from_dict(entry, where, catalogue)
        taken = {state for other in effects for state in other.states}
        if taken.intersection(effect.states):
            raise input_error(
                f"{where}, effect {effect.id}", "is listed twice for one side", "take one out"
            )
        effects.append(effect)
    return tuple(effects)


def _is_linear(bundle: Mapping[str, Any]) -> bool:
    return bool(bundle.get("rig", {}).get("rig", {}).get("motion") == "linear")


def surfaces_from_bundle(
    bundle: Mapping[str, Any], rig: Rig, kind: str, where: str = "bundle"
) -> tuple[TabulatedSurfaces, TabulatedSurfaces] | None:
    """Valve A's and B's PWM surfaces of a kind ("bipolynomial" or "ann"), for `simulate`.

    None where the bundle lacks one of the four. Raises InputError where they were fitted at
    another PWM period than the rig's, at which they do not hold.
    """
    found = []
    for side in SIDES:
        pwm = bundle.get("valves", {}).get(side, {}).get("pwm", {})
        parts = [pwm.get(direction, {}) for direction in DIRECTIONS]
        if any(kind not in part for part in parts):
            return None
        for direction, part in zip(DIRECTIONS, parts, strict=True):
            _check_period(part, rig, f"{where}, valves.{side}.pwm.{direction}")
        fill, discharge = (part[kind] for part in parts)
        found.append(_tabulated(fill, discharge, f"{where}, valves.{side}"))
    return found[0], found[1]


def _tabulated(
    fill: Mapping[str, Any], discharge: Mapping[str, Any], where: str
) -> TabulatedSurfaces:
    from sysid.surfaces import surface_from_dict

    fields: dict[str, Any] = {}
    for name, content in (("filling", fill), ("discharging", discharge)):
        surface = surface_from_dict(dict(content), f"{where}, {name}")
        duties = np.linspace(*surface.domain_.duty_range, _NODES)
        pressures = np.linspace(*surface.domain_.pressure_range, _NODES)
        fields[name] = surface.flow(duties[:, None], pressures[None, :])[0]
        fields[f"{name}_duty_low"], fields[f"{name}_duty_high"] = duties[[0, -1]]
        fields[f"{name}_pressure_low"], fields[f"{name}_pressure_high"] = pressures[[0, -1]]
    return TabulatedSurfaces(**fields)


def _check_period(part: Mapping[str, Any], rig: Rig, where: str) -> None:
    fitted = part.get("pwm_period_s")
    period = rig.pwm.period_s if rig.pwm else None
    if fitted is None or period is None or abs(fitted / period - 1.0) < _SAME_PERIOD:
        return
    raise input_error(
        where,
        f"was fitted at a PWM period of {fitted:g} s, and {rig.source} says {period:g} s",
        "fit valve-pwm tests at the rig's period",
    )


def _discrete_law(bundle: Mapping[str, Any], side: str, where: str) -> ValveParameters:
    law = bundle.get("valves", {}).get(side, {}).get("discrete")
    if law is None:
        return ValveParameters(math.nan, math.nan, math.nan, math.nan)
    place = f"{where}, valves.{side}.discrete"
    test = f"valve-discrete tests of valve {side} (on and off again, piston held) would identify it"
    values = {name: _identified(law, key, place, test) for name, key in _VALVE_KEYS.items()}
    return ValveParameters(**values)


def _identified(part: Mapping[str, Any], key: str, where: str, test: str) -> float:
    estimate = part.get(key)
    if estimate is None:
        raise _missing(where, key)
    if estimate["value"] is None:
        raise NotIdentifiedError(f"{where}: {key} is not identified ({estimate['reason']}); {test}")
    return float(estimate["value"])


def _missing(where: str, key: str) -> InputError:
    return input_error(where, f"{key} is missing", "fit again to write the bundle anew")


def _value_or(estimate: Mapping[str, Any] | None, default: float) -> float:
    value = None if estimate is None else estimate["value"]
    return default if value is None else float(value)


VALVE_MODELS = (DISCRETE, "bipolynomial", "ann")


def surfaces_for(
    bundle: Mapping[str, Any], rig: Rig, valve_model: str, where: str = "bundle"
) -> tuple[Any, ...]:
    """The surfaces of a valve model ("discrete": none) out of a bundle, for simulate_trials.

    Raises InputError for an unknown name, NotIdentifiedError where the bundle lacks one.
    """
    if valve_model not in VALVE_MODELS:
        raise input_error(
            f"valve model {valve_model!r}", "is unknown", f"use {', '.join(VALVE_MODELS)}"
        )
    if valve_model == DISCRETE:
        return ()
    surfaces = surfaces_from_bundle(bundle, rig, valve_model, where)
    if surfaces is None:
        raise NotIdentifiedError(
            f"{where}: holds no {valve_model} surfaces for both valves and directions; "
            "fit valve-pwm tests into it"
        )
    return surfaces


def first_valve_model(
    bundle: Mapping[str, Any], rig: Rig, parameters: Parameters, where: str
) -> str:
    """The discrete law where the bundle has it, else the first kind of surface that it has.

    Raises NotIdentifiedError where it holds no model of both valves.
    """
    if has_discrete_law(parameters):
        return DISCRETE
    for name in VALVE_MODELS[1:]:
        if surfaces_from_bundle(bundle, rig, name, where) is not None:
            return name
    raise NotIdentifiedError(
        f"{where}: holds no model of both valves; fit valve-discrete tests of both into it"
    )


def simulate_bundle(
    trials: Sequence[Trial],
    rig: Rig,
    bundle: Mapping[str, Any],
    valve_model: str = DISCRETE,
    where: str = "bundle",
    catalogue: Catalogue | None = None,
) -> list[dict[str, FloatArray]]:
    """simulate_trials with what a bundle holds; raises as it, surfaces_for and the bundle do."""
    surfaces = surfaces_for(bundle, rig, valve_model, where)
    return simulate_trials(trials, rig, model_from_bundle(bundle, rig, where, catalogue), surfaces)


__all__ = [
    "SURFACE_KINDS",
    "TabulatedSurfaces",
    "effects_from_bundle",
    "first_valve_model",
    "friction_keys",
    "model_from_bundle",
    "negative_friction",
    "parameters_from_bundle",
    "surfaces_from_bundle",
]
