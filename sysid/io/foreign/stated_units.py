"""Units as a heading states them: in brackets, at the end of a name, or in a separate row."""

from __future__ import annotations

import re
from collections.abc import Sequence

from sysid.io.foreign.table import ForeignTable
from sysid.io.unit_text import ratio_of
from sysid.io.units import CANONICAL_UNITS

_BRACKETED = re.compile(r"(?P<name>.*?\S)[\s_]*[\[(](?P<unit>[^\[\]]*)[\])]\s*")
_ENDING = re.compile(r"(?P<name>.*[^_\s])_(?P<unit>[A-Za-z]{2,4})")
_TITLE = re.compile(r"(?i)(?:units?|einheit)\s*[:=]\s*")
_REFERENCE = re.compile(r"\s*\((?:g|a|gauge|abs|absolute)\)$|(?<=bar|psi)[ga]$", re.IGNORECASE)
# Units as headings write them, in lower case.
_LISTED = """
    s sec secs second seconds ms msec millisecond milliseconds us µs μs usec microseconds ns min
    minutes h hours hz khz pa kpa mpa hpa bar mbar psi atm torr mmhg inh2o inhg cmh2o at rad mrad
    deg degree degrees ° grad turn turns rev m cm mm um µm μm inch in ft rad/s deg/s °/s rpm
    1/min u/min min-1 m/s mm/s count counts cnt cts inc incr inkremente % percent nm n*m n.m mnm
    ncm n·m lbf*ft lbf-ft n kn mn newton newtons kgf kp lbf v mv volt volts a ma amp amps ampere
    kg/s g/s l/min nl/min slpm sccm scfm l/s m3/h m³/h k c °c degc degf °f celsius g m/s^2 m/s2
    m/s² w kw
"""
_WORDS = frozenset(_LISTED.split())
# Entries that stand for no unit.
_NONE = frozenset(("", "-", "--", "none", "1", "n/a"))
# Units at the end of a name: shorter ones also distinguish channels (x_m, cmd_a).
_ENDINGS = """
    ms us ns bar mbar psi kpa mpa hpa deg mrad rad mm um cm rpm nm mnm ncm kn mn kgf lbf
    mv
"""
_AT_END = frozenset(_ENDINGS.split())


def unit_in(name: str) -> str | None:
    """The unit that a heading's name states: "kPa" of "P1 [kPa]", "mm" of "x_mm".

    A name of the log format states its SI unit.
    """
    found = _BRACKETED.fullmatch(name)
    if found is not None and is_unit(found["unit"]):
        return found["unit"].strip()
    if name in CANONICAL_UNITS:
        unit = (CANONICAL_UNITS[name] or "").replace("*", "")
        return None if unit in ("", "dimensionless") else unit
    return _ending(name)


def _ending(name: str) -> str | None:
    """The unit at a name's end: "mm" of "x_mm"."""
    found = _ENDING.fullmatch(name)
    return found["unit"] if found is not None and found["unit"].lower() in _AT_END else None


def _parsed_in(name: str) -> str | None:
    """What a name has in brackets, if it can be read as a unit: "kgf/cm2" of "P1 [kgf/cm2]".

    Single letters that are no common unit distinguish channels.
    """
    found = _BRACKETED.fullmatch(name)
    unit = found["unit"].strip() if found is not None else ""
    return unit if len(unit) > 1 and ratio_of(unit, unit) is not None else None


def is_unit(text: str) -> bool:
    """Whether a cell is a unit as people write them, with or without brackets."""
    return _REFERENCE.sub("", _unbracketed(text)).strip().lower() in _WORDS


def are_units(cells: Sequence[str]) -> bool:
    """Whether a row of cells (at least one filled) is one of units."""
    known = [cell for cell in cells if _unbracketed(cell).lower() not in _NONE]
    return bool(known) and all(map(is_unit, known))


def state_units(table: ForeignTable, names: Sequence[str], cells: Sequence[str]) -> None:
    """Put each column's unit into its table: of the row of units, else of the name itself.

    Both are those of the heading, in the order of the table's columns.
    """
    for index, (column, name) in enumerate(zip(table.columns, names, strict=False)):
        cell = _unbracketed(cells[index]) if index < len(cells) else ""
        listed = cell if is_unit(cell) else unit_in(name)
        unit = listed or _parsed_in(name)
        if unit:
            table.units[column] = unit
            ends = unit == _ending(name) and unit != cell and name not in CANONICAL_UNITS
            if ends or not listed:
                table.in_names.add(column)


def _unbracketed(text: str) -> str:
    text = _TITLE.sub("", text.strip())
    closed = {"(": ")", "[": "]"}.get(text[:1])
    return text[1:-1].strip() if closed and text.endswith(closed) else text


__all__ = ["are_units", "is_unit", "state_units", "unit_in"]
