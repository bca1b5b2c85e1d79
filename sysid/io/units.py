"""Foreign column names and units: `--map "pressure_a_pa=P1:kPa(g)"` and its TOML table.

An entry is `target=column[:unit]`:

- `target` is a column of the log format (`CANONICAL_UNITS`), which carries its SI unit.
- `column` is the foreign name, or `#3` for the third column of a file without names. The
  last colon separates the unit; a name that holds a colon itself is ended by one (`a:b:`).
- `unit` is anything that pint knows, preceded by a multiple where one unit of the reading is
  not one unit (`35.15 N` per volt, `0.02 bar(g)` per step), and for pressures followed by
  `(g)` for gauge or `(a)` for absolute (`psig`, `barg`, `bara` mean the same). Without a unit
  the column is already in SI; without `(g)` a pressure is absolute.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.errors import InputError, input_error

TEST_COLUMN = "test"
_BRACKETED = re.compile(r"(.*?\S)[\s_]*[\[(][^\[\]]*[\])]\s*")

# The log format's columns and their SI units, as pint writes them; a test's label has none.
CANONICAL_UNITS: dict[str, str | None] = {
    "time_s": "s",
    TEST_COLUMN: None,
    "pressure_a_pa": "Pa",
    "pressure_b_pa": "Pa",
    "supply_pressure_pa": "Pa",
    "theta_rad": "rad",
    "velocity_rad_per_s": "rad/s",
    "position_m": "m",
    "encoder_counts": "count",
    "valve_a": "dimensionless",
    "valve_b": "dimensionless",
    "duty_a": "dimensionless",
    "duty_b": "dimensionless",
    "motor_torque_nm": "N*m",
    "motor_force_n": "N",
    "motor_volts": "V",
    "pump_volts": "V",
    "flow_a_kg_s": "kg/s",
    "time_to_pressure_s": "s",
    "pwm_period_s": "s",
    "temperature_k": "K",
}

# The name of each SI unit's quantity in a message, and the units to choose from.
_KINDS = {
    "s": ("a time", "s, ms, us, min"),
    "Pa": ("a pressure", "Pa, kPa, MPa, bar, mbar, psi, with (g) for gauge"),
    "rad": ("an angle", "rad, mrad, deg, turn"),
    "rad/s": ("an angular velocity", "rad/s, deg/s, rpm"),
    "m": ("a length", "m, cm, mm, um, inch"),
    "count": ("a number of encoder counts", "count"),
    "dimensionless": ("a ratio", "percent, or a bare factor such as 0.01"),
    "N*m": ("a torque", "Nm, mNm, Ncm, lbf*ft"),
    "N": ("a force", "N, kN, mN, kgf, lbf"),
    "V": ("a voltage", "V, mV"),
    "kg/s": ("a mass flow", "kg/s, g/s, or the value of one step, such as 2.0e-5 kg/s"),
    "K": ("a temperature", "K, degC, degF"),
}
# Common spellings that pint lacks, or reads as something else ("Nm" as number-metre).
_ALIASES = {
    "Nm": "N*m",
    "mNm": "mN*m",
    "kNm": "kN*m",
    "Ncm": "N*cm",
    "Nmm": "N*mm",
    "ozin": "force_ounce*inch",
    "psig": "psi(g)",
    "psia": "psi(a)",
    "rev": "turn",
    "kp": "kgf",
    "at": "technical_atmosphere",
    "kgf/cm2": "kgf/cm**2",
    "kp/cm2": "kgf/cm**2",
    "N/mm2": "N/mm**2",
}
# What a misspelt unit is compared with.
_COMMON_UNITS = (
    *("s", "ms", "us", "min", "Pa", "kPa", "MPa", "hPa", "bar", "mbar", "barg", "bara"),
    *("psi", "psig", "atm", "torr", "mmHg", "kgf/cm**2", "rad", "mrad", "deg", "turn", "cycle"),
    *("m", "cm", "mm", "um", "inch", "count", "counts", "percent", "Nm", "mNm", "Ncm", "lbf*ft"),
    *("N", "kN", "mN", "kgf", "lbf", "V", "mV", "K", "degC", "degF"),
)

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_REFERENCE = re.compile(r"\s*\(\s*([ga]|gauge|gage|abs|absolute)\s*\)\s*$", re.IGNORECASE)
_OVER_NUMBER = re.compile(r"(?P<unit>[^\d\s/][^/]*)/(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?)")
_ONE_OVER = re.compile(
    r"1\s*/\s*(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?)\s*\*?\s*(?P<unit>[^\d\s/].*)"
)
_COLUMN_NUMBER = re.compile(r"#(\d{1,6})")
_MAX_UNIT_LENGTH = 80
# In SI: no time, pressure, angle, count, force, voltage, flow or temperature of a log is larger.
LARGEST = 1e12


@dataclass(frozen=True)
class ColumnMap:
    """One foreign column that fills one column of the log format.

    SI value = `factor` * reading + `offset`, plus the atmosphere where `gauge` is True.
    `unit` is the unit as written (None: SI already); `gauge` is None where it is
    not given; `source` is where the entry was written, for messages.
    """

    target: str
    column: str
    unit: str | None = None
    gauge: bool | None = None
    factor: float = 1.0
    offset: float = 0.0
    source: str = "--map"

    def __str__(self) -> str:
        """The entry as it would be written on the command line."""
        if self.unit is None:
            return f"{self.target}={self.column}" + (":" if ":" in self.column else "")
        return f"{self.target}={self.column}:{self.unit}"

    def reversed(self) -> str:
        """The entry that reads the column with the other sign: "motor_force_n=F:-1 N"."""
        unit = self.unit or CANONICAL_UNITS[self.target] or ""
        number = re.match(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?(?=\s)", unit)
        factor = number[0] if number else "1"
        other = factor.removeprefix("-") if factor.startswith("-") else f"-{factor.lstrip('+')}"
        unit = unit[number.end() :].strip() if number else unit
        return f"{self.target}={self.column}:{other} {unit}"


def parse_map(texts: Iterable[str], source: str = "--map") -> dict[str, ColumnMap]:
    """Map entries `target=column[:unit]` by target.

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
    return _parse_entries(entries, source)


def parse_map_table(
    table: Mapping[str, Any], source: str, units: Mapping[str, str | None] = CANONICAL_UNITS
) -> dict[str, ColumnMap]:
    """The same from a TOML table {target: "column:unit"}; `source` names file and table.

    `units` of the targets, by name.
    """
    entries: list[tuple[str, str]] = []
    for target, value in table.items():
        if not isinstance(value, str):
            raise input_error(
                source, f"{target} = {value!r} is not text", f'write {target} = "column:unit"'
            )
        entries.append((target, value))
    return _parse_entries(entries, source, units)


def _parse_entries(
    entries: Iterable[tuple[str, str]],
    source: str,
    units: Mapping[str, str | None] = CANONICAL_UNITS,
) -> dict[str, ColumnMap]:
    maps: dict[str, ColumnMap] = {}
    for target, rest in entries:
        entry = _parse_entry(target, rest, source, units)
        if target in maps:
            raise input_error(
                source,
                f"{target} is mapped twice ({maps[target].column!r} and {entry.column!r})",
                "keep one of the two",
            )
        maps[target] = entry
    return maps


def _parse_entry(target: str, rest: str, source: str, units: Mapping[str, str | None]) -> ColumnMap:
    if target not in units:
        close = difflib.get_close_matches(target, units, 1, 0.5)
        mend = f"did you mean {close[0]}?" if close else f"use one of {', '.join(units)}"
        raise input_error(source, f"{target!r} is not a column of the log format", mend)
    column, colon, unit = rest.rpartition(":")
    if not colon:
        column, unit = rest, ""
    column, unit = column.strip(), unit.strip()
    where = f"{source} {target}={rest.strip()}"
    if not column:
        raise input_error(where, "names no column", f'write it as "{target}=column:unit"')
    if not unit:
        return ColumnMap(target, column, source=source)
    si = units[target]
    if si is None:
        raise input_error(
            where, f"{target} is a label and has no unit", f'write "{target}={column}"'
        )
    gauge, factor, offset = parse_unit(unit, si, where)
    return ColumnMap(target, column, unit, gauge, factor, offset, source)


def parse_unit(text: str, si: str, where: str) -> tuple[bool | None, float, float]:
    """(gauge, factor, offset) that turn a reading in unit `text` into the SI unit `si`.

    `si` is one of the units in `CANONICAL_UNITS`; `where` opens the message of an
    InputError. Gauge is True for `(g)`, False for `(a)` and None without either;
    the offset never includes the atmosphere.
    """
    if len(text) > _MAX_UNIT_LENGTH:
        raise _unknown_unit(text[:20] + "...", si, where)
    multiple, unit = _split_multiple(_per_number(text), where)
    unit, gauge = _split_reference(unit)
    if gauge is not None and si != "Pa":
        said = "gauge" if gauge else "absolute"
        raise input_error(
            where,
            f"{text!r} is declared {said}, but {_kind_of(si)[0]} is expected",
            f"omit the {'(g)' if gauge else '(a)'}",
        )
    if not unit:
        if si not in ("dimensionless", "count") and multiple is not None:
            raise input_error(where, f"{text!r} has no unit", f"write {text} {si.replace('*', '')}")
        return gauge, (1.0 if multiple is None else multiple), 0.0
    factor, offset = _pint_factor(unit, si, where)
    return gauge, (factor if multiple is None else multiple * factor), offset


def check_unit(unit: str, where: str) -> None:
    """InputError, that opens with `where`, for a unit that nobody knows; empty: none."""
    try:
        if unit not in ("", "1"):
            _registry().parse_units(_ALIASES.get(unit, unit))
    except Exception:  # pint and its tokenizer raise a dozen kinds
        close = _closest(unit)
        mend = f"did you mean {close}?" if close else "write it as N*m or kg/s; a ratio has none"
        raise input_error(where, f"{unit!r} is not a known unit", mend) from None


def _per_number(text: str) -> str:
    """`V/341.33` and `1/341.33 V`, of a converter's counts, as `0.0029297 V`."""
    over = _OVER_NUMBER.fullmatch(text) or _ONE_OVER.fullmatch(text)
    if over is None or not float(over["number"]):
        return text
    return f"{1.0 / float(over['number'])!r} {over['unit']}"


def _split_multiple(text: str, where: str) -> tuple[float | None, str]:
    """A leading number and the rest; `1/s` is a unit, not a multiple."""
    match = _NUMBER.match(text)
    if match is None or text[match.end() :].lstrip().startswith("/"):
        return None, text
    multiple = float(match.group())
    if not math.isfinite(multiple) or multiple == 0.0:
        raise input_error(where, f"the multiple {match.group()} is unusable", "give another")
    rest = text[match.end() :].lstrip()
    return multiple, rest.removeprefix("*").lstrip()


def _split_reference(unit: str) -> tuple[str, bool | None]:
    """The unit without its `(g)` or `(a)`, and whether it was gauge."""
    unit = _ALIASES.get(unit, unit)
    match = _REFERENCE.search(unit)
    if match is not None:
        bare = unit[: match.start()]
        return _ALIASES.get(bare, bare), match.group(1).lower().startswith("g")
    # barg, kPaa and the like; no pressure unit of pint itself ends like this.
    if re.fullmatch(r"[kMhm]?(?:Pa|bar)[ _]?[ga]", unit):
        return unit[:-1].rstrip(" _"), unit.endswith("g")
    return unit, None


@functools.cache
def _registry() -> Any:
    """Pint's registry; half a second to import, so only where a unit needs it."""
    import pint

    return pint.UnitRegistry()


def _pint_factor(unit: str, si: str, where: str) -> tuple[float, float]:
    if unit in (si, si.replace("*", "")):
        return 1.0, 0.0
    registry = _registry()
    try:
        # Brackets belong to Python's expressions, never to a unit that a person writes.
        if re.search(r"[\[\]{}=;,'\"]", unit):
            raise ValueError(unit)
        parsed = registry.parse_units(_ALIASES.get(unit, unit))
        same = _is_same_kind(unit, si)
    except Exception:  # pint and its tokenizer raise a dozen kinds
        raise _unknown_unit(unit, si, where) from None
    if not same:
        raise _wrong_kind(unit, parsed, si, where)
    offset = float(registry.Quantity(0.0, parsed).to(si).magnitude)
    if offset == 0.0:
        return float(registry.Quantity(1.0, parsed).to(si).magnitude), 0.0
    delta = registry.parse_units(f"delta_{parsed}")
    return float(registry.Quantity(1.0, delta).to(si).magnitude), offset


def _unknown_unit(unit: str, si: str, where: str) -> InputError:
    kind, examples = _kind_of(si)
    close = _closest(unit)
    mend = f"did you mean {close}?" if close else f"give a unit of {kind}: {examples}"
    return input_error(where, f"{unit!r} is not a known unit", mend)


def _kind_of(si: str) -> tuple[str, str]:
    """The name of a unit's quantity, and units to choose from."""
    return _KINDS.get(si, (f"a quantity in {si}", si))


def _closest(unit: str) -> str | None:
    for known in _COMMON_UNITS:
        if known.lower() == unit.lower() and known != unit:
            return known
    close = difflib.get_close_matches(unit, _COMMON_UNITS, 1, 0.6)
    return close[0] if close and close[0] != unit else None


def _wrong_kind(unit: str, parsed: Any, si: str, where: str) -> InputError:
    registry = _registry()
    root = registry.get_root_units(parsed)[1]
    found = next(
        (kind for known, (kind, _) in _KINDS.items() if registry.get_root_units(known)[1] == root),
        f"{parsed}",
    )
    kind, examples = _kind_of(si)
    meant = {"C": "degC", "F": "degF"}.get(unit) or next(
        (known for known in _COMMON_UNITS if known.lower() == unit.lower() != known), None
    )
    if meant is not None and _is_same_kind(meant, si):
        return input_error(where, f"{unit!r} is {found}, not {kind}", f"did you mean {meant}?")
    worth = "0.001" if si == "dimensionless" else f"0.5 {si.replace('*', '')}"
    return input_error(
        where,
        f"{unit!r} is {found}, not {kind}",
        f"give a unit such as {examples}; for a raw reading, the value of one unit of it "
        f"(such as {worth})",
    )


def _is_same_kind(unit: str, si: str) -> bool:
    """Compares root units: by dimension an angle, a ratio and a count are the same."""
    registry = _registry()
    parsed = registry.parse_units(_ALIASES.get(unit, unit))
    return bool(registry.get_root_units(parsed)[1] == registry.get_root_units(si)[1])


def to_si(
    values: ArrayLike,
    column_map: ColumnMap,
    atmosphere_pa: float | None = None,
    *,
    stamped: bool = False,
) -> NDArray[np.float64]:
    """Readings (any shape) in SI; a gauge pressure gets `atmosphere_pa` (Pa) added.

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
    # 273 ms is 0.273 s to the last digit if divided by 1000, not if multiplied by 0.001.
    inverse = round(1.0 / factor) if 1e-15 < abs(factor) < 1.0 else 0
    with np.errstate(over="ignore"):  # `check_size` finds it
        if inverse and 1.0 / inverse == factor:
            readings = readings / inverse
        elif factor != 1.0:
            readings = readings * factor
        return readings + offset if offset else readings.copy()


def check_size(
    where: str, target: str, values: NDArray[np.float64], largest: float = LARGEST
) -> NDArray[np.float64]:
    """Values in SI as they are; InputError where one is beyond all that is measured.

    Squares and ratios of such values leave the range of numbers.
    """
    found = float(np.max(np.abs(values), initial=0.0))
    if found <= largest:
        return values
    unit = CANONICAL_UNITS[target] or ""
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
    listed = ", ".join(close or columns[:20]) + (" ..." if len(columns) > 20 and not close else "")
    raise input_error(
        where,
        f"has no column {name!r} (mapped to {column_map.target})",
        f"did you mean {listed}?" if close else f"its columns are {listed}",
    )
