"""How a foreign file becomes a log: maps, constants and options, as given or from TOML.

The options of the command line may also be given in a TOML file (`--spec`); the command
line takes precedence:

    [map]                                # as --map
    time_s = "#1:ms"
    pressure_a_pa = "#6:bar(g)"

    [constants]                          # columns of one value
    temperature_k = 293.15

    [options]
    delimiter = ";"                      # also "tab", "blank"; detected where absent
    decimal = ","
    thousands = "."                      # "." with decimal ".": all but the last dot
    header = false                       # the first row is data: columns #1, #2 ...
    skip_rows = 22                       # lines above the table
    sheet = "Run 3"
    rows = "0::3, 2::3"                  # rows of the table to keep, as Python's slices count
                                         # them; negative steps reverse the table
    transpose = false                    # each line of a text file is a signal, its name first
    fill = "linear"                      # between samples of slower columns: "hold", "linear";
                                         # absent: measurements linear, commands held
    sampling_period_s = 0.001            # where no column holds the time
    atmosphere_pa = 101325.0             # added to gauge pressures
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sysid.errors import input_error
from sysid.io.alignment import FILLS, is_held
from sysid.io.channels import TEST_COLUMN
from sysid.io.foreign.table import ReadOptions
from sysid.io.reshaping import HELD_COLUMNS
from sysid.io.rig import read_toml, reject_misspelt
from sysid.io.units import CANONICAL_UNITS, ColumnMap, parse_map, parse_map_table

_SLICE = re.compile(r"(-?\d{1,9})?:(-?\d{1,9})?(?::(-?\d{1,9})?)?")
_SECTIONS = ("map", "constants", "options")
_OPTIONS: dict[str, tuple[type, ...]] = {
    "delimiter": (str,),
    "decimal": (str,),
    "thousands": (str,),
    "header": (bool,),
    "skip_rows": (int,),
    "sheet": (str,),
    "rows": (str,),
    "transpose": (bool,),
    "fill": (str,),
    "sampling_period_s": (int, float),
    "atmosphere_pa": (int, float),
}


@dataclass(frozen=True)
class Recipe:
    """How foreign columns become a log: maps by target, constants, and how to read.

    `rows` are the slices of rows to keep, `rows_text` as written; none: all. `fill` says how
    every column is filled between samples of its own (`sysid.io.alignment`). `units` are those of
    the columns that may be written, by name: the log format's, or a component's; those that `held`
    names hold from sample to sample. `gas_constant` is that of the gas, J/(kg K); None: air.
    """

    maps: Mapping[str, ColumnMap] = field(default_factory=dict)
    constants: Mapping[str, str | float] = field(default_factory=dict)
    read: ReadOptions = field(default_factory=ReadOptions)
    period_s: float | None = None
    atmosphere_pa: float | None = None
    notices: tuple[str, ...] = ()
    rows: tuple[slice, ...] = ()
    rows_text: str = ""
    fill: str | None = None
    units: Mapping[str, str | None] = field(default_factory=lambda: CANONICAL_UNITS)
    held: tuple[str, ...] = HELD_COLUMNS
    gas_constant: float | None = None

    def is_held(self, target: str) -> bool:
        """Whether a column holds from one of its samples to the next."""
        return is_held(target, self.fill, self.held)


def read_recipe(path: Path, units: Mapping[str, str | None] = CANONICAL_UNITS) -> Recipe:
    """The recipe of a `--spec` TOML file; `units` are those of the columns to be written.

    Raises InputError naming the key and the fix.
    """
    content = read_toml(path, "a TOML file with [map] and [options]")
    notices = reject_misspelt(content, _SECTIONS, "section ", str(path))
    for section in _SECTIONS:
        if not isinstance(content.get(section, {}), dict):
            raise input_error(path, f"{section} is not a section", f"write [{section}]")
    options = content.get("options", {})
    notices += reject_misspelt(options, _OPTIONS, "[options] ", str(path))
    for key, types in _OPTIONS.items():
        value = options.get(key)
        wrong = not isinstance(value, types) or (isinstance(value, bool) and types != (bool,))
        if value is not None and wrong:
            raise input_error(
                path, f"[options] {key} = {value!r} is not {_said(types)}", "fix the value"
            )
    constants = {}
    for key, value in content.get("constants", {}).items():
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise input_error(
                path, f"[constants] {key} = {value!r} is neither a number nor text", "fix the value"
            )
        constants[key] = _constant(key, str(value), f"{path} [constants]", units)
    return Recipe(
        parse_map_table(content.get("map", {}), f"{path} [map]", units),
        constants,
        ReadOptions(**{k: options[k] for k in ReadOptions.__dataclass_fields__ if k in options}),
        options.get("sampling_period_s"),
        options.get("atmosphere_pa"),
        tuple(notices),
        _slices(options.get("rows", ""), f"{path} [options]"),
        options.get("rows", ""),
        _fill(options.get("fill"), f"{path} [options]"),
        units,
    )


def _fill(text: str | None, where: str) -> str | None:
    if text is not None and text not in FILLS:
        raise input_error(where, f"fill = {text!r} is not known", f"write {' or '.join(FILLS)}")
    return text


def _slices(text: str, where: str) -> tuple[slice, ...]:
    """The slices of `0::3, 10:20`, all in one direction; none for an empty text."""
    found = []
    for part in text.split(",") if text.strip() else ():
        match = _SLICE.fullmatch(part.strip())
        if match is None or match.group(3) in ("0", "-0"):
            raise input_error(
                where,
                f"rows = {text!r}: {part.strip()!r} is not a slice of rows",
                'write start:stop:step, such as "0::3" for every third row',
            )
        found.append(slice(*(int(g) if g else None for g in match.groups())))
    if len({(s.step or 1) > 0 for s in found}) > 1:
        raise input_error(
            where, f"rows = {text!r} runs in both directions", "give all steps the same sign"
        )
    return tuple(found)


def kept_rows(rows: tuple[slice, ...], count: int) -> list[int]:
    """The rows of `count` that the slices keep, each once: in order, or backward by their steps."""
    kept = {index for part in rows for index in range(*part.indices(count))}
    return sorted(kept, reverse=bool(rows) and (rows[0].step or 1) < 0)


def _said(types: tuple[type, ...]) -> str:
    return {str: "text", bool: "true or false", int: "a whole number"}.get(types[-1], "a number")


def extended(
    base: Recipe,
    maps: Iterable[str],
    constants: Iterable[str],
    reading: Mapping[str, Any],
    period_s: float | None,
    atmosphere_pa: float | None,
    rows: str | None = None,
    fill: str | None = None,
) -> Recipe:
    """`base` updated by the command line's entries, checked as a whole.

    `reading` holds `ReadOptions` by name, None where not given; `period_s` in s,
    `atmosphere_pa` in Pa; `rows` and `fill` as a recipe writes them. Raises InputError for what is
    implausible or given twice.
    """
    extra = {}
    for text in constants:
        target, equals, value = text.partition("=")
        if not equals:
            raise input_error(f"--set {text!r}", "has no '='", 'write "temperature_k=293.15"')
        extra[target.strip()] = _constant(target.strip(), value.strip(), "--set", base.units)
    recipe = replace(
        base,
        maps={**base.maps, **parse_map(maps, units=base.units)},
        constants={**base.constants, **extra},
        read=with_reading(base.read, reading),
        period_s=base.period_s if period_s is None else period_s,
        atmosphere_pa=base.atmosphere_pa if atmosphere_pa is None else atmosphere_pa,
        rows=base.rows if rows is None else _slices(rows, "--rows"),
        rows_text=base.rows_text if rows is None else rows,
        fill=base.fill if fill is None else _fill(fill, "--fill"),
    )
    for target in recipe.constants:
        if target in recipe.maps:
            raise input_error("convert", f"{target} is both mapped and a constant", "keep one")
    period, atmosphere = recipe.period_s, recipe.atmosphere_pa
    if period is not None and not 1e-7 <= period <= 3600.0:
        raise input_error(
            "--period",
            f"{period:g} s is not a sampling period",
            "give it in seconds: 1 ms is 0.001",
        )
    if period is not None and "time_s" in recipe.maps:
        raise input_error("--period", "is given in addition to a mapped time_s", "omit one of them")
    if atmosphere is not None and not 4e4 <= atmosphere <= 1.2e5:
        raise input_error(
            "--atmosphere",
            f"{atmosphere:g} Pa is not an atmospheric pressure",
            "give Pa: about 101325",
        )
    return recipe


def with_reading(base: ReadOptions, given: Mapping[str, Any]) -> ReadOptions:
    """How to read a file, updated by what the command line gives (None: not given)."""
    found = replace(base, **{key: value for key, value in given.items() if value is not None})
    if found.skip_rows < 0:
        raise input_error("skip_rows", "is negative", "give the number of lines above the table")
    return found


def _constant(target: str, text: str, where: str, units: Mapping[str, str | None]) -> str | float:
    if target not in units or target == "time_s":
        names = ", ".join(name for name in units if name != "time_s")
        raise input_error(where, f"{target!r} cannot be a constant", f"use one of {names}")
    if target == TEST_COLUMN:
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise input_error(where, f"{target} = {text!r} is not a number", "give it in SI units")
    return value
