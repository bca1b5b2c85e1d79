"""The parameters that a refinement may move: where each stands, its prior, and its bounds.

A positive unknown is estimated by its logarithm, any other on a linear scale, within its bounds.
(A logit would need no bounds, but if the optimum is at a bound it diverges to infinity, where its
slope vanishes: shares of an effect that are 0 held up all other parameters.) The bench tests'
estimate of an unknown is its prior, in this coordinate, with the standard error and the
correlations of the bundle (`sysid.refinement.prior`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.errors import input_error
from sysid.estimation.linear import Estimate
from sysid.io.channels import SIDES
from sysid.io.motion import FRICTION
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.parameters.declared import declared_of
from sysid.parameters.friction import Friction
from sysid.parameters.table import ParameterTable, effect_names, field_of
from sysid.parameters.valves import ISO_KEYS, LAW_KEYS, VALVE_ALONE
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.iso6358 import HIGHEST_RATIO
from sysid.plant.ports import Model
from sysid.types import FloatArray

Direction = tuple[int, str]
Known = Mapping[str, Estimate]
"""What the bundle says of each parameter, by alias."""
MOST_FACTOR = 20.0
# Relative difference of flows between two integrations of the same equations: long logs at the
# encoder's resolution would resolve less than that (`benchmarks/refinement.py coverage`).
_EXACT = 1e-6
_LEAST_STD = 1e-4
_OFFSET_SHARE = 0.3


@dataclass(frozen=True)
class Unknown:
    """One parameter: its name in files, the number of the model that it is, value and prior.

    `std` is the prior's, in the parameter's unit, NaN without one. `lower`, `upper` as the
    parameter's; `scale` a typical size for one that may be 0 or of either sign. `held_at`: the
    coordinate that it keeps, for a profile. `correlations` of the prior's error with those of
    others, by their names. `sign`: the model's number is this many times the value (a friction fit
    counts an offset against the motion, the model along it), and `added` to it (what the payload
    differs by from the one that an inertia was fitted with).
    """

    name: str
    direction: Direction
    value: float
    std: float
    unit: str
    lower: float
    upper: float
    scale: float
    origin: str
    held_at: float | None = None
    has_prior: bool = True
    correlations: tuple[tuple[str, float], ...] = ()
    sign: float = 1.0
    added: float = 0.0

    @property
    def _is_logarithm(self) -> bool:
        return self.lower == 0.0 < self.value and math.isinf(self.upper)

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the largest coordinate."""
        if self._is_logarithm:
            return -math.log(MOST_FACTOR), math.log(MOST_FACTOR)
        return (self.lower - self.value) / self.scale, (self.upper - self.value) / self.scale

    def coordinate(self, value: float) -> float:
        """The coordinate of a value."""
        if self._is_logarithm:
            return math.log(value / self.value)
        return (value - self.value) / self.scale

    def at(self, coordinate: float) -> float:
        """The value at a coordinate; at a bound beyond it."""
        low, high = self.limits
        inside = min(max(coordinate, low), high)
        if self._is_logarithm:
            return self.value * math.exp(inside)
        return min(max(self.value + self.scale * inside, self.lower), self.upper)

    def slope(self, coordinate: float) -> float:
        """Change of the value with the coordinate."""
        return self.at(coordinate) if self._is_logarithm else self.scale

    def number(self, coordinate: float) -> float:
        """The model's number at a coordinate."""
        return self.sign * self.at(coordinate) + self.added

    def model_slope(self, coordinate: float) -> float:
        """Change of the model's number with the coordinate."""
        return self.sign * self.slope(coordinate)

    def integration_error(self, coordinate: float) -> float:
        """The least standard error of the coordinate, by the accuracy of the integration."""
        return _EXACT * self.at(coordinate) / self.slope(coordinate)

    @property
    def varies_by_test(self) -> bool:
        """Whether each test has its own, about the model's: static and sliding friction."""
        return self.direction in _base(map(field_of, FRICTION))

    @property
    def start(self) -> float:
        """The coordinate of its value."""
        return self.coordinate(self.value)

    @property
    def prior_std(self) -> float:
        """The prior's standard deviation in the coordinate; NaN without a prior."""
        return self.std / self.slope(self.start) if self.has_prior else math.nan


def unknowns_of(bundle: Bundle, rig: Rig, model: Model) -> list[Unknown]:
    """Every parameter of a bundle's model that a refinement may move.

    Friction, flows, delays and effects with the bundle's standard errors; the rig file's constants
    with 3 %.
    """
    table = bundle.parameters.fitted()
    known = {row.alias: row.estimate for row in table.rows}
    fitted = [
        *_friction(bundle, rig, model, known),
        *_valves(bundle, model, known),
        *_effects(bundle, model, known),
    ]
    together = _correlations(table)
    taken = {u.direction for u in fitted}
    return [
        *(dataclasses.replace(u, correlations=together.get(u.name, ())) for u in fitted),
        *(u for u in _declared(rig, model) if u.direction not in taken),
    ]


def _correlations(table: ParameterTable) -> dict[str, tuple[tuple[str, float], ...]]:
    """Known correlations of each parameter's error with those of others."""
    names = [row.alias for row in table.rows]
    return {
        own: tuple((n, float(c)) for n, c in zip(names, row, strict=True) if c and n != own)
        for own, row in zip(names, table.correlation, strict=True)
    }


def _friction(bundle: Bundle, rig: Rig, model: Model, known: Known) -> list[Unknown]:
    found: list[Unknown] = []
    if bundle.friction is None:
        return found  # of a shaft that is held
    for name in FRICTION:
        field = field_of(name)
        value = float(getattr(model.parameters, field))
        if value <= 0.0:
            continue  # friction of 0 stays 0: its logarithm has no start value
        place, unit = f"friction.{rig.units.key(name)}", rig.units.unit(name)
        found.append(_positive(place, (0, field), value, known.get(place), "friction", unit))
    return [*found, *_fitted_with_friction(bundle.friction, rig, model)]


def _fitted_with_friction(part: Friction | None, rig: Rig, model: Model) -> list[Unknown]:
    """Inertia or mass, and offset, from the motion of a rig with a motor alone."""
    if part is None or not rig.is_motor_alone:
        return []
    found = []
    inertia, offset = part.inertia, part.offset
    if inertia is not None and inertia.identified:
        name, value = f"friction.{rig.units.key('inertia')}", inertia.value
        own = _positive(name, (0, "inertia"), value, inertia, "friction")
        found.append(dataclasses.replace(own, added=float(model.parameters.inertia) - value))
    if offset is not None and offset.identified:
        scale = _OFFSET_SHARE * float(model.parameters.coulomb_effort) or 1.0
        found.append(
            Unknown(
                f"friction.{rig.units.key('offset')}",
                (0, "offset"),
                offset.value,
                offset.std,
                offset.unit,
                -math.inf,
                math.inf,
                scale,
                "friction",
                sign=-1.0,
            )
        )
    return found


def _positive(
    name: str,
    direction: Direction,
    value: float,
    estimate: Estimate | None,
    origin: str,
    unit: str = "",
) -> Unknown:
    """One above 0; `unit` is that of an estimate without one, as it was not identified."""
    known = estimate is not None and estimate.identified and math.isfinite(estimate.std)
    std = max(estimate.std, _LEAST_STD * abs(value)) if known and estimate else math.nan
    unit = estimate.unit if estimate and estimate.unit else unit
    return Unknown(name, direction, value, std, unit, 0.0, math.inf, abs(value) or 1.0, origin)


def _valves(bundle: Bundle, model: Model, known: Known) -> list[Unknown]:
    found = []
    for side in SIDES:
        law = bundle.valve(side).discrete
        if law is None:
            continue
        for short, key in law.flow_keys().items():
            field, place = field_of(short, side), f"valves.{side}.{key}"
            value = float(getattr(model.parameters, field))
            if short.startswith("subsonic_index"):
                continue  # as it was taken: it and the critical ratio bend the flow alike
            if short in VALVE_ALONE.values():
                continue  # as its own tests have it: motion shows no more than where it chokes
            one = _positive(place, (0, field), value, known[place], "valve")
            if short.startswith("critical_ratio"):
                one = dataclasses.replace(one, upper=HIGHEST_RATIO)
            found.append(one)
    return found


def _effects(bundle: Bundle, model: Model, known: Known) -> list[Unknown]:
    found = []
    for number, (name, effect) in enumerate(
        zip(effect_names(bundle.effects), model.effects, strict=True)
    ):
        if not isinstance(effect, CatalogueEffect):
            continue
        for q in effect.fitted():
            value = float(getattr(effect, q.name))
            estimate = known.get(f"{name}.{q.label}")
            std = math.nan if estimate is None else estimate.std
            found.append(
                Unknown(
                    f"{name}.{q.label}",
                    (number + 1, q.name),
                    value,
                    std if std > 0.0 else math.nan,
                    q.unit,
                    *q.around(value),
                    abs(q.typical) or 1.0,
                    "effect",
                    # Effects are estimated on motion logs: these would count twice.
                    has_prior=False,
                )
            )
    return found


def _declared(rig: Rig, model: Model) -> list[Unknown]:
    found = []
    for row in declared_of(rig, model.parameters):
        known, value = row.estimate, row.estimate.value
        limits = (0.0, math.inf, value)
        found.append(
            Unknown(row.alias, (0, row.field), value, known.std, known.unit, *limits, "rig")
        )
    size = float(model.parameters.coulomb_effort) or 1.0
    unit = rig.units.effort
    value = float(model.parameters.offset)
    scale = _OFFSET_SHARE * size
    found.append(
        Unknown("offset", (0, "offset"), value, scale, unit, -math.inf, math.inf, scale, "rig")
    )
    return found


def without_own_data(
    unknowns: Sequence[Unknown], bundle: Bundle, notices: list[str]
) -> list[Unknown]:
    """The unknowns without a prior where their numbers came from the motion logs themselves.

    A refinement's, a diagnosis' (it refits sliding friction and flows), and friction from motion:
    the logs would count twice.
    """
    if bundle.refinement is not None:
        notices.append(
            f"{bundle.source}: was refined already: its numbers are starting values, "
            "but not a prior"
        )
        own = {"friction", "valve"}
        return [
            dataclasses.replace(u, has_prior=u.has_prior and u.origin not in own) for u in unknowns
        ]
    refitted: set[str] = set()
    if bundle.friction is not None and bundle.friction.source == "friction-motion":
        refitted |= {"coulomb_effort", "viscous", "inertia", "offset"}
    if "diagnosis" in bundle.provenance.options and bundle.effects:
        refitted |= {"coulomb_effort", "viscous", "inertia", "offset"}
        refitted |= {field_of(law, side) for law in (LAW_KEYS | ISO_KEYS) for side in SIDES}
    return [
        dataclasses.replace(
            u,
            has_prior=u.has_prior and (u.origin == "rig" or u.direction not in _base(refitted)),
        )
        for u in unknowns
    ]


def _base(names: Iterable[str]) -> set[Direction]:
    return {(0, name) for name in names}


def chosen(
    unknowns: Sequence[Unknown],
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    *,
    prior: bool = True,
) -> list[Unknown]:
    """The unknowns to estimate: those fitted, with `free` and without `fix`; a name or its start.

    Without `prior` none of them has one. Raises InputError for an unknown name.
    """
    free, fix = list(free), list(fix)
    numbers_of(unknowns, [*free, *fix])
    found = [
        u
        for u in unknowns
        if (u.origin != "rig" or any(_matches(u, n) for n in free))
        and not any(_matches(u, n) for n in fix)
    ]
    return found if prior else [dataclasses.replace(u, has_prior=False) for u in found]


def numbers_of(unknowns: Sequence[Unknown], names: Iterable[str]) -> list[int]:
    """Indices of the unknowns with these names. Raises InputError for an unknown name."""
    found: dict[int, None] = {}
    for name in names:
        own = [i for i, u in enumerate(unknowns) if _matches(u, name)]
        if not own:
            known = ", ".join(u.name for u in unknowns)
            raise input_error(f"parameter {name!r}", "is unknown", f"use one of {known}")
        found |= dict.fromkeys(own)
    return list(found)


def _matches(unknown: Unknown, name: str) -> bool:
    return (
        unknown.name == name
        or unknown.name.startswith(name + ".")
        or (unknown.name.split(".")[-1] == name)
    )


def model_at(model: Model, unknowns: Sequence[Unknown], values: FloatArray) -> Model:
    """The model with these values (p,) of the unknowns."""
    parameters: dict[str, Any] = {}
    effects: list[Any] = list(model.effects)
    for unknown, value in zip(unknowns, values, strict=True):
        part, name = unknown.direction
        if part == 0:
            parameters[name] = unknown.sign * float(value) + unknown.added
        else:
            effects[part - 1] = dataclasses.replace(effects[part - 1], **{name: float(value)})
    return Model(model.parameters.replace(**parameters), tuple(effects))
