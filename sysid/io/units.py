"""Foreign column names and units: `--map "pressure_a_pa=P1:kPa(g)"` and its TOML table.

An entry is `target=column[:unit]`:

- `target` is a column of the log format (`CANONICAL_UNITS`), which carries its SI unit.
- `column` is the foreign name, or `#3` for the third column of a file without names. The
  last colon separates the unit; a name that holds a colon itself is ended by one (`a:b:`).
- `unit` is anything that pint knows (`sysid.io.unit_text`), preceded by a multiple where one unit
  of the reading is not one unit (`35.15 N` per volt, `0.02 bar(g)` per step), and for pressures
  followed by `(g)` for gauge or `(a)` for absolute (`psig`, `barg`, `bara` mean the same). Without
  a unit the column is in the unit that its file states, else already in SI; without `(g)` a
  pressure is absolute.
- In place of the unit a sensor's range: `0.5..4.5 V -> 0..100 psi(g)` (`sysid.io.sensor_range`).

In TOML an entry is the text "column:unit" or a table of `column`, `unit`, `from` and `to`.
"""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.errors import InputError, input_error, some_of
from sysid.io.channels import LOG_COLUMNS, SWITCHES
from sysid.io.sensor_range import SensorRange, ends_of, is_range, parse_range, range_text
from sysid.io.unit_text import (
    LARGEST,
    StandardState,
    check_unit,
    in_any_capitals,
    meant_by,
    parse_unit,
    per_number,
    ratio_of,
    without_multiple,
)
from sysid.types import FloatArray

_BRACKETED = re.compile(r"(.*?\S)[\s_]*[\[(][^\[\]]*[\])]\s*")


CANONICAL_UNITS = {key: channel.si for key, channel in LOG_COLUMNS.items()}

_COLUMN_NUMBER = re.compile(r"#(\d{1,6})")
_TABLE_KEYS = ("column", "unit", "from", "to")
# Digits of a factor that a person gave, those of a double, and the powers of ten that are exact.
_GIVEN_DIGITS, _DIGITS = 10, sys.float_info.dig
_TENS = np.array([10.0**k for k in range(23)])
# Readings at zero and at the end of common transducers; how far off zero, and beyond the end, in
# parts of the end.
_LIVE_ZEROS = ((0.5, 4.5, "V"), (1.0, 5.0, "V"), (2.0, 10.0, "V"), (4.0, 20.0, "mA"))
_ZERO_WITHIN, _ABOVE = 0.01, 0.05


@dataclass(frozen=True)
class ColumnMap:
    """One foreign column that fills one column of the log format.

    SI value = `factor` * reading + `offset`, plus the atmosphere where `gauge` is True.
    `unit` is the unit or range as written (None: SI already); `gauge` is None where it is
    not given; `source` is where the entry was written, for messages; `sensor` is the range of the
    readings where one was given; `remark` says what the unit was taken for; `standard` is the state
    at which a volume flow is counted.
    """

    target: str
    column: str
    unit: str | None = None
    gauge: bool | None = None
    factor: float = 1.0
    offset: float = 0.0
    source: str = "--map"
    sensor: SensorRange | None = None
    remark: str = ""
    standard: StandardState | None = None

    def of_gas(self, gas_constant: float | None) -> ColumnMap:
        """The entry of a volume flow of a gas that is not air, by its constant, J/(kg K): its mass
        is that of this gas at the same state. None: of air."""
        if self.standard is None or gas_constant is None:
            return self
        density, air = self.standard.density_of(gas_constant), self.standard.density
        state = (
            f"{self.standard.temperature - 273.15:.3g} degC, {self.standard.pressure / 1e3:g} kPa"
        )
        remark = (
            f"{self.unit} is taken as that of the rig file's gas ({gas_constant:g} J/(kg K)) at "
            f"{state}: {density:.4g} kg/m3, where air has {air:g}; if the meter counts air, give "
            "the mass of one unit in kg/s"
        )
        worth = density / air
        return replace(
            self,
            factor=self.factor * worth,
            offset=self.offset * worth,
            remark=remark,
            standard=None,
        )

    def __str__(self) -> str:
        """The entry as it would be written on the command line."""
        if self.unit is None:
            return f"{self.target}={self.column}" + (":" if ":" in self.column else "")
        return f"{self.target}={self.column}:{self.unit}"

    def reversed(self) -> str:
        """The entry that reads the column with the other sign: "motor_force_n=F:-1 N"."""
        si = CANONICAL_UNITS[self.target] or ""
        if self.sensor is not None:
            ends = (self.sensor.start, self.sensor.end)
            first, last = (f"{-(self.factor * end + self.offset):.12g}" for end in ends)
            readings = f"{ends[0]:.12g}..{ends[1]:.12g}"
            return f"{self.target}={self.column}:{readings} -> {first}..{last} {si}"
        unit = per_number(self.unit or si)
        number = re.match(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?(?=\s)", unit)
        factor = number[0] if number else "1"
        other = factor.removeprefix("-") if factor.startswith("-") else f"-{factor.lstrip('+')}"
        unit = unit[number.end() :].strip() if number else unit
        return f"{self.target}={self.column}:{other} {unit}"

    def notices(
        self, readings: FloatArray, where: str, place: Callable[[int], str], stated: str = ""
    ) -> list[str]:
        """Notices on readings (n,) as this entry converts them, at `place(row)`.

        `stated` is the readings' unit as the file has it.
        """
        said = [f"{where}: {self.column}: {self.remark}"] if self.remark else []
        found = None if self.sensor is None else self.sensor.beyond(readings)
        if found is not None:
            said.append(f"{where}, {place(found[0])}: {self.column}: {found[1]}")
        if (zero := self._live_zero(readings)) is not None and _may_be_electrical(stated):
            said.append(f"{where}: {zero}")
        return said

    def _live_zero(self, readings: FloatArray) -> str | None:
        """What to say of a pressure that is a multiple of volts or of a loop's mA, which begins at
        zero, where the readings begin as a transducer with a live zero does."""
        if CANONICAL_UNITS.get(self.target) != "Pa" or self.sensor is not None:
            return None
        finite = readings[np.isfinite(readings)]
        if self.unit is None or without_multiple(self.unit) is None or not finite.size:
            return None
        if self.gauge is not True and _is_atmosphere(self.factor * finite.min()):
            return None
        low, high = float(finite.min()), float(finite.max())
        for zero, end, unit in _LIVE_ZEROS:
            if abs(low - zero) <= _ZERO_WITHIN * end and zero < high <= (1.0 + _ABOVE) * end:
                return (
                    f"{self.column} begins at {low:.3g}, as a sensor of {zero:g} to {end:g} {unit} "
                    f"does, but {self.unit!r} counts from zero: if it is one, give its range, "
                    f'--map "{self.target}={self.column}:{zero:g}..{end:g} {unit} -> 0..10 bar(g)"'
                )
        return None


def _may_be_electrical(stated: str) -> bool:
    """Whether readings of a stated unit may be volts or a current, as those of none may."""
    if not stated or ratio_of(stated, stated) is None:
        return True
    return any(ratio_of(stated, one) is not None for one in ("V", "A"))


def _is_atmosphere(pressure_pa: float) -> bool:
    """Whether a pressure is one that a weather map has."""
    return 8.5e4 <= pressure_pa <= 1.09e5


def parse_map(
    texts: Iterable[str],
    source: str = "--map",
    units: Mapping[str, str | None] = CANONICAL_UNITS,
) -> dict[str, ColumnMap]:
    """Map entries `target=column[:unit]` by target; `units` of the targets, by name.

    Raises InputError for an entry of another form, an unknown or repeated target, an unknown
    unit, and a unit of another quantity than the target's.
    """
    entries: list[tuple[str, str]] = []
    for text in texts:
        target, equals, rest = text.partition("=")
        if not equals:
            raise input_error(
                f"{source} {text!r}", "has no '='", 'write it as "pressure_a_pa=P1:kPa(g)"'
            )
        entries.append((target.strip(), rest))
    return _parse_entries(entries, source, units)


def parse_map_table(
    table: Mapping[str, Any], source: str, units: Mapping[str, str | None] = CANONICAL_UNITS
) -> dict[str, ColumnMap]:
    """The same from a TOML table {target: "column:unit"}; `source` names file and table.

    A target's value may be a table as well: {column, unit, from, to}.
    """
    entries: list[tuple[str, str | Mapping[str, Any]]] = []
    for target, value in table.items():
        if not isinstance(value, str | Mapping):
            raise input_error(
                source,
                f"{target} = {value!r} is not text",
                f'write {target} = "column:unit", or {{ column = ..., unit = ... }}',
            )
        entries.append((target, value))
    return _parse_entries(entries, source, units)


def _parse_entries(
    entries: Iterable[tuple[str, str | Mapping[str, Any]]],
    source: str,
    units: Mapping[str, str | None],
) -> dict[str, ColumnMap]:
    maps: dict[str, ColumnMap] = {}
    for target, rest in entries:
        if target not in units:
            raise _no_target(target, source, units)
        entry = (
            _parse_entry(target, rest, source, units[target])
            if isinstance(rest, str)
            else _table_entry(target, rest, source, units[target])
        )
        if target in maps:
            raise input_error(
                source,
                f"{target} is mapped twice ({maps[target].column!r} and {entry.column!r})",
                "keep one of the two",
            )
        maps[target] = entry
    return maps


def _no_target(target: str, source: str, units: Mapping[str, str | None]) -> InputError:
    close = difflib.get_close_matches(target, units, 1, 0.5)
    fix = f"did you mean {close[0]}?" if close else f"use one of {', '.join(units)}"
    format_ = "the log format" if set(CANONICAL_UNITS) <= set(units) else "the component's logs"
    return input_error(source, f"{target!r} is not a column of {format_}", fix)


def _parse_entry(target: str, rest: str, source: str, si: str | None) -> ColumnMap:
    column, colon, unit = rest.rpartition(":")
    if not colon:
        column, unit = rest, ""
    column, unit = column.strip(), unit.strip()
    where = f"{source} {target}={rest.strip()}"
    if not column:
        raise input_error(where, "names no column", f'write it as "{target}=column:unit"')
    return _with_unit(ColumnMap(target, column, source=source), unit, si, where)


def _with_unit(entry: ColumnMap, unit: str, si: str | None, where: str) -> ColumnMap:
    """The entry in this unit or range ("": none)."""
    if not unit:
        return entry
    if si is None:
        raise input_error(
            where,
            f"{entry.target} is a label and has no unit",
            f'write "{entry.target}={entry.column}"',
        )
    sensor = None
    if is_range(unit):
        sensor, found = parse_range(unit, si, where)
    else:
        found = parse_unit(unit, si, where)
    return replace(
        entry,
        unit=unit,
        gauge=found.gauge,
        factor=found.factor,
        offset=found.offset,
        sensor=sensor,
        remark=found.remark,
        standard=found.standard,
    )


def _table_entry(target: str, table: Mapping[str, Any], source: str, si: str | None) -> ColumnMap:
    """An entry from a TOML table {column, unit, from, to}."""
    where = f"{source} {target}"
    for key in table:
        if key not in _TABLE_KEYS:
            close = difflib.get_close_matches(str(key), _TABLE_KEYS, 1, 0.5)
            known = f"did you mean {close[0]}?" if close else f"use {', '.join(_TABLE_KEYS)}"
            raise input_error(where, f"{key} is not a key of a column's table", known)
    for key in ("column", "unit"):
        value = table.get(key, "")
        if not isinstance(value, str):
            raise input_error(where, f"{key} = {value!r} is not text", "put it in quotes")
    column, unit = table.get("column", "").strip(), table.get("unit", "").strip()
    if not column:
        raise input_error(where, "names no column", 'write { column = "NAME", unit = ... }')
    entry = ColumnMap(target, column, source=source)
    given = [key for key in ("from", "to") if key in table]
    if not given:
        return _with_unit(entry, unit, si, where)
    if len(given) == 1:
        lacking = "to" if given == ["from"] else "from"
        raise input_error(
            where,
            f"{given[0]} is given without {lacking}",
            "give both ends: from = [0.5, 4.5], to = [0, 100]",
        )
    if is_range(unit):
        raise input_error(where, f"unit = {unit!r} holds a range of its own", "omit from and to")
    ends = [range_text(ends_of(table[key], key, where)) for key in ("from", "to")]
    return _with_unit(entry, f"{' -> '.join(ends)} {unit}".strip(), si, where)


def in_stated_unit(
    entry: ColumnMap, stated: str, si: str | None, where: str, in_name: bool = False
) -> tuple[ColumnMap, str | None]:
    """An entry, completed by the unit that the file states for its column; and a notice, or None.

    An entry without a unit takes the stated one if it fits its quantity (`si`); otherwise it keeps
    its own. `in_name`: the unit is part of the column's name, and is ignored if it is of another
    quantity.
    """
    stated = stated.strip().strip("[]").strip()
    if si is None or stated in ("", "-", "1", "?", "none", "None", "n/a", "N/A"):
        return entry, None
    sensor = entry.sensor
    quantity = si if sensor is None else sensor.unit or stated
    stated = in_any_capitals(stated, quantity)
    if in_name and (entry.column == entry.target or ratio_of(stated, quantity) is None):
        return entry, None
    if entry.unit is None:
        return _stated_alone(entry, stated, si, where)
    if sensor is not None:
        return _stated_with_range(entry, stated, where)
    bare = without_multiple(entry.unit)
    said = f"{where}: {entry.column} is in {stated!r} by the file, mapped as {entry.unit!r}"
    try:
        own = parse_unit(stated, si, where)
    except InputError:
        if bare is not None or ratio_of(stated, stated) is None:
            return entry, None
        return entry, f"{said}: the map is used"
    gauge = own.gauge is not None and own.gauge != bool(entry.gauge)
    same = math.isclose(own.factor, entry.factor, rel_tol=1e-6)
    # A sign or a gear's ratio in front of the file's own unit.
    scaled = bare is not None and math.isclose(ratio_of(bare, stated) or 0.0, 1.0)
    if (same or scaled) and not gauge:
        return entry, None
    return entry, f"{said}: the map is used"


def _stated_alone(
    entry: ColumnMap, stated: str, si: str, where: str
) -> tuple[ColumnMap, str | None]:
    named = f"{where}: {entry.column} (for {entry.target})"
    try:
        found = _with_unit(entry, stated, si, where)
    except InputError:
        worth = _shown(si).replace("dimensionless", "")
        taken = f"taken as {worth}" if worth else "taken as it stands"
        example = f"0.5..4.5 -> 0..100 {worth}" if worth else "0..24 -> 0..1"
        what = "a unit or a range"
        if (meant := meant_by(stated, si)) is not None:
            example, what = meant, "a unit"
        return entry, (
            f"{named} is in {stated!r} by the file; {taken}, as the map has no unit: give {what}, "
            f'--map "{entry.target}={entry.column}:{example}"'
        )
    if found.factor == 1.0 and found.offset == 0.0 and not found.gauge:
        return entry, None
    absolute = ", absolute" if si == "Pa" and found.gauge is None else ""
    return found, f"{named} is in {stated}{absolute}, as the file states"


def _stated_with_range(entry: ColumnMap, stated: str, where: str) -> tuple[ColumnMap, str | None]:
    """Readings in another unit than that of the range's left side are brought to it."""
    sensor = entry.sensor
    if sensor is None or not sensor.unit:
        return entry, None
    worth = ratio_of(stated, sensor.unit)
    if worth is None:
        if None in (ratio_of(stated, stated), ratio_of(sensor.unit, sensor.unit)):
            return entry, None
        said = f"{where}: {entry.column} is in {stated!r} by the file, mapped from {sensor.unit!r}"
        return entry, f"{said}: the map is used"
    if math.isclose(worth, 1.0, rel_tol=1e-9):
        return entry, None
    moved = SensorRange(sensor.start / worth, sensor.end / worth, stated)
    return (
        replace(entry, factor=entry.factor * worth, sensor=moved),
        f"{where}: {entry.column} is in {stated} by the file, its range in {sensor.unit}: "
        "converted",
    )


def _shown(si: str) -> str:
    return (si or "").replace("*", "")


def to_si(
    values: ArrayLike,
    column_map: ColumnMap,
    atmosphere_pa: float | None = None,
    *,
    stamped: bool = False,
) -> NDArray[np.float64]:
    """Readings (any shape) in SI; a gauge pressure gets `atmosphere_pa` (Pa) added.

    A valve that is on or off is, of a coil's voltage, what the nearer end of its range says.
    `stamped`: they come from time stamps, already in seconds. Raises InputError for these
    with a unit, and for a gauge pressure without an atmosphere.
    """
    if stamped and column_map.factor != 1.0:
        raise input_error(
            f"{column_map.source} {column_map}",
            f"column {column_map.column} holds time stamps, which need no unit",
            f'write "{column_map.target}={column_map.column}"',
        )
    readings = np.asarray(values, dtype=np.float64)
    factor, offset = column_map.factor, column_map.offset
    if column_map.gauge:
        if atmosphere_pa is None:
            raise input_error(
                f"{column_map.source} {column_map}",
                "a gauge pressure needs the atmospheric pressure",
                "give --atmosphere PA, or [air] atmospheric_pressure_pa in a rig.toml next to it",
            )
        offset += atmosphere_pa
    if column_map.sensor is not None and column_map.target in SWITCHES:
        opened = readings * factor + offset
        return np.where(np.isnan(opened), opened, opened > 0.5)
    # 273 ms is 0.273 s to the last digit if divided by 1000, not if multiplied by 0.001.
    inverse = round(1.0 / factor) if 1e-15 < abs(factor) < 1.0 else 0
    with np.errstate(over="ignore"):  # `check_size` finds it
        divides = bool(inverse) and 1.0 / inverse == factor
        scaled = readings / inverse if divides else readings * factor
        if offset:
            size = np.maximum(np.abs(scaled), abs(offset))
            return _decimal(readings, scaled + offset, size, factor, offset)
        exact = divides or factor == 1.0
        return scaled if exact else _decimal(readings, scaled, np.abs(scaled), factor)


def _decimal(
    readings: NDArray[np.float64],
    values: NDArray[np.float64],
    size: NDArray[np.float64],
    *numbers: float,
) -> NDArray[np.float64]:
    """Values without what rounding left of decimal readings: 1.46 - 1 is 0.46, not 0.45999...96.

    The decimals of 15 digits, counted from `size`, of the largest term, that lie within the
    rounding; the values themselves where none does, or where the readings or `numbers` are no
    short decimals.
    """
    if not all(map(_is_short, numbers)) or np.any(_rounded(readings, np.abs(readings)) != readings):
        return values
    rounded = _rounded(values, size)
    with np.errstate(invalid="ignore"):
        close = np.abs(rounded - values) <= 2.0 * np.spacing(size)
    return np.asarray(np.where(close, rounded, values))


def _rounded(values: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at 15 digits, counted from `size`."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        places = _DIGITS - np.ceil(np.log10(size))
        tens = _TENS[np.clip(np.nan_to_num(places), 0, len(_TENS) - 1).astype(np.intp)]
        return np.asarray(np.rint(values * tens) / tens)


def _is_short(number: float) -> bool:
    """Whether a number has few decimal digits: then readings of few have results of few."""
    return len(repr(number).partition("e")[0].strip("-0.").replace(".", "")) <= _GIVEN_DIGITS


def check_size(
    where: str,
    target: str,
    values: NDArray[np.float64],
    largest: float = LARGEST,
    units: Mapping[str, str | None] = CANONICAL_UNITS,
) -> NDArray[np.float64]:
    """Values in SI as they are; InputError where one is beyond what can be measured.

    Squares and ratios of such values leave the range of numbers.
    """
    found = float(np.max(np.abs(values), initial=0.0))
    if found <= largest:
        return values
    unit = units.get(target) or ""
    raise input_error(
        where,
        f"{target} reaches {found:.3g} {unit.replace('*', '')}, beyond anything measured "
        f"({largest:g})",
        f'fix the values, or give the unit with --map "{target}=COLUMN:UNIT"',
    )


def bare_name(name: str) -> str:
    """A heading's name without its unit in brackets."""
    found = _BRACKETED.fullmatch(name)
    return found[1] if found is not None else name


def has_column(columns: Sequence[str], column_map: ColumnMap) -> bool:
    """Whether `find_column` would find the mapped column."""
    return _index_of(columns, column_map.column) is not None


def _index_of(columns: Sequence[str], name: str) -> int | None:
    """Index of a column by its name, else by its number (`#3` is 2); None if it is missing.

    A name may be given without its unit in brackets, "P1" for "P1 [kPa]", if it is then the only
    one.
    """
    if name in columns:
        return list(columns).index(name)
    bare = [i for i, column in enumerate(columns) if bare_name(column) == name]
    if len(bare) == 1:
        return bare[0]
    number = _COLUMN_NUMBER.fullmatch(name)
    index = int(number.group(1)) if number is not None else 0
    return index - 1 if 1 <= index <= len(columns) else None


def find_column(columns: Sequence[str], column_map: ColumnMap, where: str) -> int:
    """Index of the mapped column among `columns`: by name, else by number (`#3` is 2).

    Raises InputError, with the names nearest to it or all of them, if it is missing.
    """
    name = column_map.column
    index = _index_of(columns, name)
    if index is not None:
        return index
    if _COLUMN_NUMBER.fullmatch(name) is not None:
        raise input_error(
            where,
            f"has no column {name} (mapped to {column_map.target})",
            f"give one of #1 to #{len(columns)}",
        )
    close = difflib.get_close_matches(name, columns, 3, 0.6)
    listed = some_of(close or columns, 20, counted=False)
    raise input_error(
        where,
        f"has no column {name!r} (mapped to {column_map.target})",
        f"did you mean {listed}?" if close else f"its columns are {listed}",
    )


__all__ = [
    "CANONICAL_UNITS",
    "LARGEST",
    "ColumnMap",
    "check_size",
    "check_unit",
    "find_column",
    "has_column",
    "in_stated_unit",
    "parse_map",
    "parse_map_table",
    "parse_unit",
    "to_si",
]
