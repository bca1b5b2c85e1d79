"""Every number of a model in one table: its path, its meaning and its uncertainty.

`table_of` makes it from a bundle; whoever lists, compares, refines, exports or shows parameters
reads it. `Bundle.with_estimates` is the way back.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.blocks.tables import NotedCell, Table, estimate_table
from sysid.blocks.titles import within
from sysid.estimation.linear import Estimate
from sysid.io.channels import SIDES
from sysid.io.motion import LINEAR, ROTARY
from sysid.parameters.base import Part
from sysid.parameters.content import BundleContent
from sysid.parameters.correlation import CorrelatedPart
from sysid.parameters.effects import SIDE, EffectEntry
from sysid.parameters.friction import Friction
from sysid.parameters.valves import ISO_KEYS, LAW_KEYS, LAW_UNITS, Valve
from sysid.types import FloatArray

Origin = Literal["friction", "valve", "effect", "component", "rig"]
Status = Literal["fitted", "declared", "assumed", "check", "alternative"]
DELAYS = ("on_delay", "off_delay")
_FRICTION = {key: name for units in (ROTARY, LINEAR) for name, key in units.keys.items()}
# A friction parameter by its key, with its factor in a sum.
_KEYED = re.compile(rf"(?:\b([0-9.e+-]+) )?\b({'|'.join(sorted(_FRICTION))})\b")
# What a fit of an on/off law gives in addition to the law: checks, and what follows from it.
_CHECKS = ("jump_", "critical_ratio_", "control_c_")
_TITLES = {
    "static": "Static friction",
    "coulomb": "Coulomb friction",
    "viscous": "Viscous friction",
    "offset": "Offset",
    "inertia": "Inertia",
    "mass_kg": "Mass",
    "choked_fill": "Choked filling flow",
    "c_fill": "Unchoked filling coefficient",
    "choked_dis": "Choked exhaust flow",
    "c_dis": "Unchoked exhaust coefficient",
    "sonic_conductance.fill": "Sonic conductance, filling",
    "sonic_conductance.exhaust": "Sonic conductance, exhaust",
    "critical_ratio.fill": "Critical ratio, filling",
    "critical_ratio.exhaust": "Critical ratio, exhaust",
    "subsonic_index.fill": "Subsonic index, filling",
    "subsonic_index.exhaust": "Subsonic index, exhaust",
    "valve_c_fill": "Filling coefficient, valve alone",
    "valve_c_dis": "Exhaust coefficient, valve alone",
    "control_c_fill": "Filling coefficient, flow control alone",
    "control_c_dis": "Exhaust coefficient, flow control alone",
    "adiabatic_share": "Share of the expansion that the wall leaves adiabatic",
    "wall_conductance_w_per_k": "Conductance of the tank's wall",
    "on_delay": "Delay, on",
    "off_delay": "Delay, off",
    "delay_difference_s": "Closing delay less opening delay",
    "critical_ratio_fill": "Critical ratio, filling",
    "critical_ratio_dis": "Critical ratio, exhaust",
    "jump_fill_percent": "Jump at the boundary, filling",
    "jump_dis_percent": "Jump at the boundary, exhaust",
}
_FIELDS = {"static": "static_effort", "coulomb": "coulomb_effort"}
# The name inside of a number, by its key in a part or its name in the plant's parameters.
_NAMES = (
    {own: name for name, own in (LAW_KEYS | ISO_KEYS | _FIELDS).items()}
    | {f"{d}_s": d for d in DELAYS}
    | _FRICTION
)


@dataclass(frozen=True)
class ParameterRow:
    """One number: value, standard error, unit, interval, or why it is not identified.

    `part` is the place of its part ("friction", "valves.a.discrete", "effect backlash"), `key` its
    key there, `name` what it is called inside, whatever its unit and valve (`coulomb`, `c_fill`).
    `status`: fitted, declared in the rig file, assumed because undeclared, a fit's check that no
    model has, or an alternative to what was fitted, by other tests. `alias` is the name under which
    a refinement lists and takes it, `side` its valve's.
    """

    part: str
    key: str
    name: str
    estimate: Estimate
    origin: Origin
    alias: str
    side: str = ""
    status: Status = "fitted"

    @property
    def path(self) -> str:
        """Its place, dotted."""
        return f"{self.part}.{self.key}"

    @property
    def title(self) -> str:
        """Its name for readers."""
        return title_of_key(self.key) or title_of_key(self.name) or self.key

    @property
    def field(self) -> str:
        """Its name in the plant's parameters."""
        return field_of(self.name, self.side)


def title_of_key(key: str) -> str:
    """The title of a number by its key in a part, or by its name inside; empty without any."""
    return _TITLES.get(key) or _TITLES.get(_NAMES.get(key, key), "")


def title_of_field(field: str) -> str:
    """The title of a number by its name in the plant's parameters; empty without any."""
    if title := title_of_key(field):
        return title
    name, _, side = field.rpartition("_")
    title = title_of_key(name) if side in SIDES else ""
    return f"Valve {side.upper()}, {within(title)}" if title else ""


def unit_of_field(field: str, *, is_linear: bool) -> str:
    """The unit of a number by its name in the plant's parameters; empty where none is known."""
    units = LINEAR if is_linear else ROTARY
    efforts = dict.fromkeys(("static", "coulomb", "offset"), units.effort)
    laws = {name: LAW_UNITS[own] for name, own in LAW_KEYS.items()}
    known = laws | efforts | {"viscous": units.viscous_unit}
    name, _, side = field.rpartition("_")
    key = name if side in SIDES else field
    return known.get(_NAMES.get(key, key), "")


def in_words(text: str) -> str:
    """A text with friction's keys by their titles: "only Coulomb friction + 0.01 m/s × viscous
    friction is identified".
    """
    return _KEYED.sub(_in_words, text)


def in_words_of(estimate: Estimate) -> Estimate:
    """An estimate with the reason why it is not identified in words."""
    reason = estimate.reason
    return estimate if reason is None else replace(estimate, reason=in_words(reason))


def _in_words(found: re.Match[str]) -> str:
    factor, key = found.groups()
    name = _FRICTION[key]
    title = within(title_of_key(name))
    if factor is None:
        return title
    # By a speed viscous friction becomes an effort, as the rest of a sum is.
    speed = "" if name != "viscous" else " rad/s" if key.endswith("rad") else " m/s"
    return f"{factor}{speed} \N{MULTIPLICATION SIGN} {title}"


def field_of(name: str, side: str = "") -> str:
    """The name of a valve's parameter in the plant's parameters (`sysid.plant.base.Parameters`)."""
    return f"{name}_{side}" if side else _FIELDS.get(name, name)


@dataclass(frozen=True)
class ParameterTable(Mapping[str, ParameterRow]):
    """Parameters by path, in the order of their parts; `correlation` (p, p) of their errors.

    Errors with no known correlation are independent: they are from separate fits.
    """

    rows: tuple[ParameterRow, ...]
    correlation: FloatArray

    def __getitem__(self, path: str) -> ParameterRow:
        for row in self.rows:
            if row.path == path:
                return row
        raise KeyError(path)

    def __iter__(self) -> Iterator[str]:
        return (row.path for row in self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def where(self, holds: Callable[[ParameterRow], bool]) -> ParameterTable:
        """The rows for which this holds."""
        kept = [i for i, row in enumerate(self.rows) if holds(row)]
        rows = tuple(self.rows[i] for i in kept)
        return ParameterTable(rows, self.correlation[np.ix_(kept, kept)])

    def fitted(self) -> ParameterTable:
        """The rows from fits, without their checks."""
        return self.where(lambda row: row.status == "fitted")

    def parts(self) -> dict[str, ParameterTable]:
        """The tables of each part, by its place."""
        places = dict.fromkeys(row.part for row in self.rows)
        return {place: self.where(lambda row, own=place: row.part == own) for place in places}  # type: ignore[misc]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The numbers by key, of a table of one part."""
        return {row.key: row.estimate for row in self.rows}

    def shown(self, caption: str) -> Table:
        """One row per parameter of one part, with its interval, and its key there beneath it."""
        titled: dict[str, Estimate] = {}
        for row in self.rows:
            titled[NotedCell(row.title, row.key)] = in_words_of(row.estimate)
        return estimate_table(caption, titled, "page")

    def covariance(self, keys: Collection[str]) -> FloatArray:
        """Covariance (k, k) of the errors of these keys, in a table of one part."""
        own = [row.key for row in self.rows]
        places = [own.index(key) for key in keys]
        std = np.array([self.rows[i].estimate.std for i in places])
        return np.asarray(self.correlation[np.ix_(places, places)] * np.outer(std, std))

    def unidentified(self) -> Iterator[tuple[str, str]]:
        """Path and reason of what the data do not identify."""
        for row in self.rows:
            if not row.estimate.identified:
                yield row.path, str(row.estimate.reason)


def table_of(bundle: BundleContent) -> ParameterTable:
    """The parameters of a bundle: friction, valves, a component of the user's own, effects."""
    rows = [*_friction(bundle.friction)]
    for side in SIDES:
        rows += _valve(bundle.valve(side), side)
    if (own := bundle.component) is not None:
        place = f"component {own.name}"
        rows += [
            ParameterRow(place, key, key, estimate, "component", f"{place}.{key}")
            for key, estimate in own.estimates().items()
        ]
    rows += _effects(bundle.effects)
    return ParameterTable(tuple(rows), _correlation(bundle, rows))


def _friction(part: Friction | None) -> Iterator[ParameterRow]:
    if part is None:
        return
    found = part.estimates()
    for key, name in zip(found, part.units.named(found), strict=True):
        path = f"friction.{key}"
        yield ParameterRow("friction", key, name, found[key], "friction", path)
    checked = part.cross_check if isinstance(part.cross_check, dict) else {}
    for key, name in zip(checked, part.units.named(checked), strict=True):
        place = "friction.cross_check"
        path, estimate = f"{place}.{key}", checked[key]
        yield ParameterRow(place, key, name, estimate, "friction", path, status="alternative")


def _valve(valve: Valve, side: str) -> Iterator[ParameterRow]:
    for law in valve.given():
        part = getattr(valve, law)
        place = f"valves.{side}.{law}"
        if law == "pwm":
            for direction, held in valve.pwm.directions().items() if valve.pwm else ():
                if held.identified is False:
                    nothing = Estimate.unidentified("", str(held.reason))
                    yield _of_valve(place, direction, nothing, side, "alternative")
            if (averaged := valve.averaged()) is not None:
                for key, estimate in averaged.estimates().items():
                    yield _of_valve(f"{place}.averaged", key, estimate, side, "alternative")
        elif isinstance(part, Part):
            for key, estimate in part.estimates().items():
                status: Status = "check" if key.startswith(_CHECKS) else "fitted"
                if key in (getattr(part, "declared", None) or ()):
                    status = "declared"
                yield _of_valve(place, key, estimate, side, status)


def _of_valve(place: str, key: str, estimate: Estimate, side: str, status: Status) -> ParameterRow:
    name, alias = _NAMES.get(key, key), f"{place.replace('.discrete', '')}.{key}"
    return ParameterRow(place, key, name, estimate, "valve", alias, side, status)


def _effect_place(effect: EffectEntry) -> str:
    """An effect's id, with the side where it has one: `atmosphere-leakage (a)`."""
    side = effect.parameters.get(SIDE)
    return f"{effect.id} ({side})" if isinstance(side, str) else effect.id


def effect_names(effects: Sequence[EffectEntry]) -> list[str]:
    """The prefix of the aliases of each effect's numbers: its id, numbered where there are two
    of it."""
    ids = [effect.id for effect in effects]
    return [
        name if ids.count(name) == 1 else f"{name}-{ids[: number + 1].count(name)}"
        for number, name in enumerate(ids)
    ]


def _effects(effects: Sequence[EffectEntry]) -> Iterator[ParameterRow]:
    """The numbers of each effect; effects of one name are numbered, in the bundle's order."""
    count = Counter[str]()
    for effect, alias in zip(effects, effect_names(effects), strict=True):
        called = _effect_place(effect)
        count[called] += 1
        place = f"effect {called}" + (f" {count[called]}" if count[called] > 1 else "")
        for key, estimate in effect.numbers().items():
            yield ParameterRow(place, key, key, estimate, "effect", f"{alias}.{key}")


def _correlation(bundle: BundleContent, rows: Collection[ParameterRow]) -> FloatArray:
    """(p, p): correlations within each fit, and those of a refinement across all its numbers."""
    found = np.eye(len(rows))
    parts: dict[str, CorrelatedPart | None] = {"friction": bundle.friction}
    parts |= {f"valves.{side}.discrete": bundle.valve(side).discrete for side in SIDES}
    for place, part in parts.items():
        if part is not None and (own := part.correlation) is not None:
            paths = [f"{place}.{key}" for key in own.names]
            _fill(found, [row.path for row in rows], paths, own.array())
    if bundle.refinement is not None and (whole := bundle.refinement.correlations()):
        names = [value.name for value in bundle.refinement.values()]
        _fill(found, [row.alias for row in rows], names, np.array(whole))
    return found


def _fill(found: FloatArray, known: list[str], names: list[str], matrix: FloatArray) -> None:
    """Enter the correlations off the diagonal of `names` (k,) where these are known."""
    pairs = [(known.index(name), at) for at, name in enumerate(names) if name in known]
    for i, own in pairs:
        for j, other in pairs:
            if i != j:
                found[i, j] = matrix[own, other]


__all__ = [
    "DELAYS",
    "Origin",
    "ParameterRow",
    "ParameterTable",
    "Status",
    "effect_names",
    "field_of",
    "in_words",
    "in_words_of",
    "table_of",
    "title_of_field",
    "title_of_key",
]
