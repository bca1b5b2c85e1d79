"""A foreign file's columns in the log format: found, converted to SI, with their times."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import InputError, input_error
from sysid.io.foreign import ForeignTable, SampleTimes
from sysid.io.foreign.recipe import Recipe, kept_rows
from sysid.io.rig import nearest_rig_file, read_rig
from sysid.io.units import (
    CANONICAL_UNITS,
    LARGEST,
    TEST_COLUMN,
    ColumnMap,
    check_size,
    find_column,
    to_si,
)

if TYPE_CHECKING:
    import pandas as pd


def with_atmosphere(recipe: Recipe, paths: Sequence[Path]) -> Recipe:
    """A recipe with gauge pressures uses the atmosphere of the nearest rig file."""
    if recipe.atmosphere_pa is not None or not any(m.gauge for m in recipe.maps.values()):
        return recipe
    found = {file for path in paths if (file := nearest_rig_file(path)) is not None}
    rigs = [read_rig(file) for file in sorted(found)]
    known = {rig.air.atmospheric_pressure_pa for rig in rigs if rig.air is not None}
    if not known:
        return recipe
    if len(known) > 1:
        raise input_error(
            " and ".join(map(str, sorted(found))),
            "the files' rigs have different atmospheric pressures",
            "convert them one by one, or give --atmosphere PA",
        )
    atmosphere = known.pop()
    places = ", ".join(map(str, sorted(found)))
    notice = f"{places}: its atmospheric pressure, {atmosphere:g} Pa, is added to gauge pressures"
    return replace(recipe, atmosphere_pa=atmosphere, notices=(*recipe.notices, notice))


def _sources(table: ForeignTable, recipe: Recipe) -> dict[str, tuple[str, ColumnMap]]:
    """(foreign column, its map) by target: mapped columns and those already named."""
    names = list(table.columns)
    found = {}
    for target, entry in recipe.maps.items():
        if entry.column in table.skipped and entry.column not in names:
            raise input_error(
                table.path,
                f"{entry.column} (mapped to {target}) is not a column: "
                f"{table.skipped[entry.column]}",
                "map another, by its name or number (#3)",
            )
        matrix = f"{entry.column}#1"
        if entry.column not in names and matrix in names:
            raise input_error(
                table.path,
                f"{entry.column} (mapped to {target}) holds several signals",
                f"choose one: {matrix}, {entry.column}#2 ...",
            )
        found[target] = names[find_column(names, entry, str(table.path))], entry
    used = {column for column, _ in found.values()}
    for name in names:
        spoken_for = name in found or name in used or name in recipe.constants
        if name in CANONICAL_UNITS and not spoken_for:
            found[name] = name, ColumnMap(name, name)
    if not set(found) - {"time_s", TEST_COLUMN}:
        raise _nothing_mapped(table)
    return found


def _nothing_mapped(table: ForeignTable) -> InputError:
    longest = max(len(values) for values in table.columns.values())
    signals = [name for name, values in table.columns.items() if len(values) == longest]
    time = next((name for name in signals if name.lower().startswith("t")), signals[0])
    other = next((name for name in signals if name != time), "COLUMN")
    return input_error(
        table.path,
        f"no column is mapped to the log format; it has {table.describe()}",
        f'map its columns: --map "time_s={time}:s" --map "pressure_a_pa={other}:kPa(g)"',
    )


def unused_columns(table: ForeignTable, recipe: Recipe) -> list[str]:
    used = {column for column, _ in _sources(table, recipe).values()}
    return [name for name in (*table.columns, *table.skipped) if name not in used]


def log_columns(table: ForeignTable, recipe: Recipe, label: str | None) -> pd.DataFrame:
    """One file's log columns, SI, in the order of the log format."""
    import pandas as pd

    sources = _sources(table, recipe)
    lengths = {name: len(table.columns[name]) for name, _ in sources.values()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise input_error(
            table.path,
            f"the mapped columns differ in length: {told}",
            "map signals of equal length (give a single value with --set)",
        )
    columns: dict[str, Any] = {}
    for target, (name, entry) in sources.items():
        if target == TEST_COLUMN:
            columns[target] = table.labels(name)
        else:
            readings = table.numbers(name, target)
            stamped = name in table.stamped
            values = to_si(readings, entry, recipe.atmosphere_pa, stamped=stamped)
            largest = LARGEST if target == "time_s" else sys.float_info.max
            columns[target] = check_size(str(table.path), target, values, largest)
    rows = next(iter(lengths.values()))
    if "time_s" in columns and recipe.period_s is not None:
        raise input_error(table.path, "has a time_s column of its own", "omit --period")
    if "time_s" not in columns:
        columns["time_s"] = _time(table, recipe, list(lengths), rows)
    columns.update({key: np.full(rows, value) for key, value in recipe.constants.items()})
    rows = _keep_rows(columns, table, recipe, rows)
    if label is not None and TEST_COLUMN in columns:
        inner = columns[TEST_COLUMN]
        columns[TEST_COLUMN] = [f"{label}/{test}" for test in inner]
    elif label is not None:
        columns[TEST_COLUMN] = [label] * rows
    return pd.DataFrame({name: columns[name] for name in CANONICAL_UNITS if name in columns})


def _keep_rows(columns: dict[str, Any], table: ForeignTable, recipe: Recipe, rows: int) -> int:
    """Keep the rows that the recipe asks for; a declared period counts in their direction.

    Returns their number.
    """
    if not recipe.rows:
        return rows
    kept = kept_rows(recipe.rows, rows)
    if not kept:
        raise input_error(
            table.path,
            f"rows = {recipe.rows_text!r} keeps none of its {rows} rows",
            "fix --rows, or rows in the recipe's [options]",
        )
    if recipe.period_s is not None and kept[0] > kept[-1]:
        columns["time_s"] = columns["time_s"][::-1]
    for name, values in columns.items():
        columns[name] = np.asarray(values)[kept]
    return len(kept)


def _time(table: ForeignTable, recipe: Recipe, names: Sequence[str], rows: int) -> Any:
    """Time of each sample, s, where no column holds it: declared, or the file's own base."""
    if recipe.period_s is not None:
        return SampleTimes(recipe.period_s).ticks(rows)
    bases = {table.sampling.get(name) for name in names}
    if len(bases) > 1:
        raise input_error(
            table.path,
            "the mapped channels have different time bases",
            "map a time channel, or give --period",
        )
    base = bases.pop()
    if base is None:
        raise input_error(
            table.path,
            f"time_s is not mapped; it has {table.describe()}",
            'map it (--map "time_s=COLUMN:s"), or give --period SECONDS',
        )
    table.notices.append(
        f"{table.path}: time follows from the file's own period, {base.period_s:g} s"
    )
    return base.ticks(rows)


__all__ = ["log_columns", "unused_columns", "with_atmosphere"]
