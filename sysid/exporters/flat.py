"""The constants that a controller needs, computed from a bundle: plain numbers and units.

Every format of `sysid.exporters` writes this content. A number that the bundle or its rig file
does not hold is None, and `Flat.missing` says why: an export never invents a number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sysid.errors import InputError, input_error
from sysid.exporters.surface_tables import ExportedSurface, read_surface
from sysid.io.declaration import range_of
from sysid.io.motion import FRICTION
from sysid.io.rig import Rig
from sysid.io.rig_file import RIG_TABLES
from sysid.parameters import Bundle, EffectEntry, Friction, PwmSurfaces, Unread, Valve
from sysid.parameters.friction import StaticAtPosition
from sysid.parameters.possible import impossible
from sysid.parameters.table import ParameterTable
from sysid.parameters.valves import LAW_KEYS, LAW_UNITS, DiscreteLaw
from sysid.plant.base import CRITICAL_RATIO
from sysid.surfaces.kinds import SURFACES

DIRECTIONS = ("fill", "discharge")
FORMAT = "sysid-controller/1"

_AGAIN = "fit again to rewrite the bundle"
_NO_PART = "the bundle does not hold this part"


@dataclass(frozen=True)
class ExportedNumber:
    """One number, or None where it is not known, and its unit."""

    value: float | None
    unit: str


NumberTable = dict[str, ExportedNumber]


@dataclass(frozen=True)
class PwmMap:
    """Surfaces of one valve in one direction by kind, at one PWM period and supply pressure."""

    conditions: NumberTable
    surfaces: dict[str, ExportedSurface | None]


@dataclass(frozen=True)
class ExportedValve:
    """One valve: the on/off law with its delays, and PWM maps by direction."""

    discrete: NumberTable
    pwm: dict[str, PwmMap]


@dataclass(frozen=True)
class ExportedEffect:
    """One effect of the model, as data: parameter values (numbers, text or None) and units."""

    id: str
    values: dict[str, float | str | None]
    units: dict[str, str]


@dataclass(frozen=True)
class Flat:
    """A bundle's content for a controller; SI, absolute pressures.

    `constants`: of the rig, derived ones among them (inertia with payload, gravity moment,
    k R T). `static_by_position`: static friction (unit of effort) at positions (rad or m).
    `missing`: dotted name of what is None -> why. `notices`: other remarks.
    """

    rig: Rig
    constants: NumberTable
    friction: NumberTable
    static_by_position: tuple[tuple[float, float | None], ...]
    valves: dict[str, ExportedValve]
    effects: tuple[ExportedEffect, ...]
    provenance: dict[str, str]
    missing: dict[str, str]
    notices: tuple[str, ...]

    def absences(self, stands_as: str) -> list[str]:
        """One notice for each reason that numbers or parts are missing for.

        The file shows these as `stands_as`.
        """
        by_reason: dict[str, list[str]] = {}
        for name, why in self.missing.items():
            by_reason.setdefault(why, []).append(name)
        return [f"{', '.join(names)}: {stands_as}, {why}" for why, names in by_reason.items()]


def flatten(bundle: Bundle, sha256: str) -> Flat:
    """The content of a checked bundle whose file has this SHA-256.

    Raises InputError where numbers contradict their names' units, the rig's PWM period, or
    each other.
    """
    rig, where = bundle.rig, bundle.source
    missing: dict[str, str] = {}
    notices = impossible(bundle, rig)
    constants = _constants(rig, missing)
    known = bundle.parameters
    friction = _friction(known, rig, missing, where)
    by_position = _by_position(bundle.friction, rig, where)
    _take_identified_inertia(bundle, rig, constants, notices, where)
    valves = {
        side: _valve(known, bundle.valve(side), side, rig, missing, where) for side in rig.sides
    }
    notices += [
        line
        for side, valve in valves.items()
        if (line := _take_declared_delay(valve.discrete, f"valves.{side}.discrete", rig, missing))
    ]
    provenance = {
        "bundle_schema": bundle.schema_id,
        "bundle_created": clean_text(bundle.created),
        "bundle_sysid_version": clean_text(bundle.sysid_version),
        "bundle_sha256": sha256,
    }
    if rig.assumed:
        provenance["assumed"] = ", ".join(rig.assumed)
    return Flat(
        rig=rig,
        constants=constants,
        friction=friction,
        static_by_position=by_position,
        valves=valves,
        effects=tuple(_effect(e, where) for e in bundle.effects),
        provenance=provenance,
        missing=missing,
        notices=tuple(notices),
    )


def clean_text(value: Any) -> str:
    """Text that can be written as UTF-8, whatever a file contained."""
    return str(value).encode("utf-8", "replace").decode("utf-8")


# --- rig -------------------------------------------------------------------------------


def _constants(rig: Rig, missing: dict[str, str]) -> NumberTable:
    """Rig constants (thesis 3.3.3-3.3.10), and those derived from them."""
    table: NumberTable = {"critical_ratio": ExportedNumber(CRITICAL_RATIO, "1")}
    for section, keys in _rig_keys(rig).items():
        part = getattr(rig, section)
        absent = []
        for name, key in keys.items():
            value = None if part is None else getattr(part, key)
            unit = range_of(RIG_TABLES[section], key).unit.replace("count", "counts")
            table[name] = ExportedNumber(value, unit)
            if value is None:
                absent.append(name)
        if part is None:
            missing[", ".join(f"constants.{n}" for n in absent)] = f"the rig has no [{section}]"
        else:
            missing.update(
                {f"constants.{n}": f"the rig's [{section}] has no {keys[n]}" for n in absent}
            )
    if rig.air is not None:
        air = rig.air
        krt = air.heat_capacity_ratio * air.gas_constant_j_per_kg_k * air.temperature_k
        table["k_r_t_j_per_kg"] = ExportedNumber(krt, "J/kg")
    else:
        table["k_r_t_j_per_kg"] = ExportedNumber(None, "J/kg")
        missing["constants.k_r_t_j_per_kg"] = "the rig has no [air]"
    _add_load(table, rig, missing)
    return table


def _rig_keys(rig: Rig) -> dict[str, dict[str, str]]:
    """For each section of the rig file: exported name -> key of the section.

    Each is named: a key that is added to a section is not null in the exports of older bundles.
    """
    u = rig.units

    def same(*keys: str) -> dict[str, str]:
        return {key: key for key in keys}

    return {
        "air": same(
            "gas_constant_j_per_kg_k",
            "heat_capacity_ratio",
            "temperature_k",
            "atmospheric_pressure_pa",
            "supply_pressure_pa",
        ),
        "cylinder": same(
            *(f"area_{side}_m2" for side in rig.sides),
            *(f"offset_{side}_m" for side in rig.sides),
            "stroke_m",
            "pitch_radius_m",
        ),
        "motor": same(u.effort_per_volt, u.max_effort),
        "pwm": {"pwm_period_s": "period_s"},
        "valves": {f"declared_{edge}_delay_s": f"{edge}_delay_s" for edge in ("on", "off")},
        "sampling": {"sampling_period_s": "period_s"},
        "sensors": same(u.encoder_counts, "encoder_zero_counts"),
    }


def inertia_name(rig: Rig) -> tuple[str, str]:
    """Exported name and unit of the whole inertia."""
    return rig.units.key("inertia"), rig.units.inertia_unit


def gravity_name(rig: Rig) -> tuple[str, str]:
    """Exported name and unit of gravity's amplitude."""
    word = "weight" if rig.is_linear else "gravity_moment"
    return f"{word}_{rig.units.suffix}", rig.units.effort


def spring_names(rig: Rig) -> tuple[str, str]:
    """Exported names of a return spring's stiffness and of its effort at position 0."""
    return f"spring_{rig.units.stiffness}", f"spring_{rig.units.word}_at_0_{rig.units.suffix}"


def _add_load(table: NumberTable, rig: Rig, missing: dict[str, str]) -> None:
    """Inertia with payload (3.3.5), gravity's amplitude (3.3.8-3.3.10) and a return spring."""
    if rig.spring_law is not None:
        u = rig.units
        units = f"{u.effort}/{u.position}", u.effort
        for name, unit, value in zip(spring_names(rig), units, rig.spring_law, strict=True):
            table[name] = ExportedNumber(value, unit)
    name, unit = inertia_name(rig)
    table[name] = ExportedNumber(rig.total_inertia(), unit)
    if table[name].value is None:
        missing[f"constants.{name}"] = "the rig's [inertia] does not give it"
    name, unit = gravity_name(rig)
    try:
        table[name] = ExportedNumber(rig.gravity_moment(), unit)
    except InputError as error:
        table[name] = ExportedNumber(None, unit)
        missing[f"constants.{name}"] = str(error)


def _take_identified_inertia(
    bundle: Bundle, rig: Rig, constants: NumberTable, notices: list[str], where: str
) -> None:
    """An identified inertia that can be replaces the declared one, as in the simulation."""
    name, unit = inertia_name(rig)
    estimate = None if bundle.friction is None else bundle.friction.inertia
    if estimate is None or not estimate.identified or not estimate.value > 0.0:
        return
    declared = constants[name].value
    value = _number(estimate.value, estimate.unit, unit, f"{where}, friction.{name}")
    constants[name] = ExportedNumber(value, unit)
    said = "gives none" if declared is None else f"says {declared:.6g}"
    notices.append(f"{name} is the identified {constants[name].value:.6g}; the rig file {said}")


# --- what was fitted -------------------------------------------------------------------


def _friction(known: ParameterTable, rig: Rig, missing: dict[str, str], where: str) -> NumberTable:
    """Friction (3.4.1)."""
    u = rig.units
    units = {u.key(name): u.unit(name) for name in (*FRICTION, "offset")}
    table = _estimates(known, units, "friction", missing, where)
    for key in map(u.key, FRICTION):
        # As in the simulation, which treats negative friction as zero.
        value = table[key].value
        table[key] = ExportedNumber(None if value is None else max(value, 0.0), units[key])
    return table


def _by_position(
    part: Friction | None, rig: Rig, where: str
) -> tuple[tuple[float, float | None], ...]:
    """Static friction by position."""
    rows = () if part is None else part.static_by_position
    place = f"{where}, friction.static_by_position"
    return tuple(_static_row(row, rig.units.effort, place) for row in rows)


def _static_row(
    row: StaticAtPosition | Unread, unit: str, where: str
) -> tuple[float, float | None]:
    if isinstance(row, Unread):
        raise input_error(where, "a row is not a position and its static friction", _AGAIN)
    found = row.static
    static = _number(found.value, found.unit, unit, where) if found.identified else None
    return _finite(row.position, where), static


def _valve(
    known: ParameterTable, part: Valve, side: str, rig: Rig, missing: dict[str, str], where: str
) -> ExportedValve:
    """One valve's on/off law (3.6.6, 3.6.10, or ISO 6358) and PWM maps."""
    names = _law_names(part.discrete)
    place = f"valves.{side}.discrete"
    for key in names:
        if isinstance(getattr(part.discrete, key, None), Unread):
            raise input_error(f"{where}, {place}.{key}", "is not a parameter", _AGAIN)
    units = {key: unit for key, (_, unit) in names.items()}
    found = _estimates(known, units, place, missing, where)
    discrete = {names[key][0]: value for key, value in found.items()}
    pwm = {}
    for direction in DIRECTIONS:
        name = f"valves.{side}.pwm.{direction}"
        held = part.surfaces(direction)
        if held is None:
            missing[name] = _NO_PART
        pwm[direction] = _pwm_map(held, name, rig, missing, where)
    return ExportedValve(discrete, pwm)


def _take_declared_delay(
    discrete: NumberTable, place: str, rig: Rig, missing: dict[str, str]
) -> str | None:
    """Of a fill and a bleed valve no flow shows when one closes, so that every model of the rig has
    the file's delay: so does the export, and says so."""
    if not rig.bleeds or rig.valves is None or discrete["off_delay_s"].value is not None:
        return None
    if missing.pop(f"{place}.off_delay_s", None) is None:
        return None
    declared = rig.valves.off_delay_s
    discrete["off_delay_s"] = ExportedNumber(declared, "s")
    return f"{place}.off_delay_s is the rig file's {declared:.6g} s: no flow shows it"


def _law_names(law: DiscreteLaw | None) -> dict[str, tuple[str, str]]:
    """The numbers of an on/off law: key in the bundle -> name in an export, and unit."""
    held = LAW_KEYS if law is None else law.thesis_keys()
    found = {key: (key, unit) for key, unit in LAW_UNITS.items() if key in held.values()}
    if law is not None:
        for name, key in law.iso_keys().items():
            found[key] = (name, "m3/(s Pa)" if name.startswith("sonic") else "-")
        for key in law.series_keys():
            found[key] = (key, LAW_UNITS[key.removeprefix("valve_")])
    return found | {key: (key, "s") for key in ("on_delay_s", "off_delay_s")}


def _pwm_map(
    found: PwmSurfaces | None,
    name: str,
    rig: Rig,
    missing: dict[str, str],
    where: str,
) -> PwmMap:
    part = found or PwmSurfaces()
    place = f"{where}, {name}"
    period, supply = (
        None if value is None else _finite(value, place)
        for value in (part.pwm_period_s, part.supply_pressure_pa)
    )
    declared = rig.pwm.period_s if rig.pwm else None
    if period is not None and declared and abs(period / declared - 1.0) > 1e-6:
        raise input_error(
            place,
            f"was fitted at a PWM period of {period:g} s, but the rig file gives {declared:g} s",
            "fit valve-pwm tests at the rig's period",
        )
    conditions = {
        "pwm_period_s": ExportedNumber(period, "s"),
        "supply_pressure_pa": ExportedNumber(supply, "Pa"),
    }
    surfaces: dict[str, ExportedSurface | None] = {}
    for kind in SURFACES:
        held = getattr(part, kind)
        surfaces[kind] = None if held is None else read_surface(held, f"{place}.{kind}")
        if held is None and found is not None:
            missing[f"{name}.{kind}"] = _NO_PART
    return PwmMap(conditions, surfaces)


def _effect(effect: EffectEntry, where: str) -> ExportedEffect:
    name = clean_text(effect.id)
    place = f"{where}, effect {name}"
    values: dict[str, float | str | None] = {}
    units: dict[str, str] = {}
    numbers = effect.numbers()
    for key, content in effect.parameters.items():
        if not key.isidentifier() or not key.isascii() or key.startswith("_"):
            raise input_error(place, f"{key!r} is not a parameter's name", _AGAIN)
        if key in numbers:
            number = numbers[key]
            known = number.identified
            values[key] = _finite(number.value, f"{place}, {key}") if known else None
            units[key] = clean_text(number.unit)
        else:
            values[key], units[key] = clean_text(content), ""
    return ExportedEffect(name, values, units)


def _estimates(
    known: ParameterTable,
    units: Mapping[str, str],
    name: str,
    missing: dict[str, str],
    where: str,
) -> NumberTable:
    """The parameters in `units` of one part, None where they are absent or not identified."""
    table: NumberTable = {key: ExportedNumber(None, unit) for key, unit in units.items()}
    if not any(row.part == name for row in known.rows):
        missing[name] = _NO_PART
        return table
    for key, unit in units.items():
        place = f"{name}.{key}"
        if place not in known:
            missing[place] = "the bundle does not hold it"
        elif not (estimate := known[place].estimate).identified:
            missing[place] = f"not identified ({clean_text(estimate.reason)})"
        else:
            value = _number(estimate.value, estimate.unit, unit, f"{where}, {place}")
            table[key] = ExportedNumber(value, unit)
    return table


def _number(value: float, unit: str, wanted: str, where: str) -> float:
    """A finite value, whose unit must be the one that its name implies."""
    if unit != wanted:
        raise input_error(where, f"is in {unit!r}, not {wanted!r}", _AGAIN)
    return _finite(value, where)


def _finite(value: Any, where: str) -> float:
    value = value.value if isinstance(value, Unread) else value
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise input_error(where, f"{str(value)[:40]!r} is not a finite number", _AGAIN)
    return float(value)


def values(table: NumberTable) -> dict[str, float | None]:
    """The numbers of a table by name."""
    return {name: quantity.value for name, quantity in table.items()}


def units(table: NumberTable) -> dict[str, str]:
    """The units of a table by name."""
    return {name: quantity.unit for name, quantity in table.items()}
