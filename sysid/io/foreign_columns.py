"""A foreign file's columns in the log format: found, converted to SI, with their times."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import InputError, input_error, some_of
from sysid.io.alignment import has_value, rows_held, values_at
from sysid.io.channels import TEST_COLUMN
from sysid.io.foreign import ForeignTable, SampleTimes
from sysid.io.foreign.matlab_objects import named_objects
from sysid.io.foreign.recipe import Recipe, kept_rows
from sysid.io.foreign_clocks import (
    SlowerColumns,
    Sources,
    grid_of,
    one_clock,
    tell_omitted,
    told,
)
from sysid.io.foreign_tests import (
    Tests,
    found_tests,
    given_tests,
    said_starts,
    without_wraps,
)
from sysid.io.kinds import settled_kind, settled_line
from sysid.io.measured_speed import of_readings, timeless_line
from sysid.io.motion import LINEAR, ROTARY
from sysid.io.reshaping import joined_line, median_period
from sysid.io.rig import nearest_rig_file, read_rig
from sysid.io.time_breaks import wraps_of_seconds
from sysid.io.units import (
    LARGEST,
    ColumnMap,
    bare_name,
    check_size,
    find_column,
    has_column,
    in_stated_unit,
    to_si,
)
from sysid.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pandas as pd

# Words by which recorders call the channels.
_CALLED = {
    "time_s": {"t", "time", "timestamp"},
    "theta_rad": {"theta", "angle", "phi", "position", "pos"},
    "position_m": {"x", "position", "pos", "stroke", "displacement"},
    "encoder_counts": {"encoder", "enc", "counts"},
    "pressure_a_pa": {"p", "pressure", "press"},
    "duty_a": {"duty", "pwm"},
    "valve_a": {"valve"},
    "motor_torque_nm": {"torque", "tau"},
    "motor_force_n": {"f", "force"},
    "motor_volts": {"voltage", "volts", "volt"},
}


def of_nearest_rig(recipe: Recipe, paths: Sequence[Path]) -> Recipe:
    """A recipe with what it needs of the nearest rig files: for gauge pressures the atmosphere,
    for mass flows the gas."""
    files = sorted({file for path in paths if (file := nearest_rig_file(path)) is not None})
    return _with_gas(_with_atmosphere(recipe, files), files)


def _with_gas(recipe: Recipe, files: Sequence[Path]) -> Recipe:
    if not any(recipe.units.get(target) == "kg/s" for target in recipe.maps):
        return recipe
    gases = {read_rig(file).other_gas for file in files}
    return replace(recipe, gas_constant=_the_one(gases, files, "gases", "convert them one by one"))


def _with_atmosphere(recipe: Recipe, files: Sequence[Path]) -> Recipe:
    if recipe.atmosphere_pa is not None or not any(m.gauge for m in recipe.maps.values()):
        return recipe
    airs = [air for file in files if (air := read_rig(file).air) is not None]
    known = {air.atmospheric_pressure_pa for air in airs}
    fix = "convert them one by one, or give --atmosphere PA"
    atmosphere = _the_one(known, files, "atmospheric pressures", fix)
    if atmosphere is None:
        return recipe
    places = ", ".join(map(str, files))
    notice = f"{places}: its atmospheric pressure, {atmosphere:g} Pa, is added to gauge pressures"
    return replace(recipe, atmosphere_pa=atmosphere, notices=(*recipe.notices, notice))


def _the_one(
    known: Collection[float | None], files: Sequence[Path], what: str, fix: str
) -> float | None:
    """What the rigs of files have in common, None where none says it; InputError where they
    differ."""
    if len(known) > 1:
        raise input_error(
            " and ".join(map(str, files)), f"the files' rigs have different {what}", fix
        )
    return next(iter(known), None)


def _sources(table: ForeignTable, recipe: Recipe) -> dict[str, tuple[str, ColumnMap]]:
    """(foreign column, its map) by target: mapped columns and those already named."""
    names = list(table.columns)
    found = {}
    for target, entry in recipe.maps.items():
        if (unread := _unread(table, entry.column)) is not None:
            raise input_error(
                table.path,
                f"{unread} (mapped to {target}) is not a column: {table.skipped[unread]}",
                "map another, by its name or number (#3)",
            )
        matrix = f"{entry.column}#1"
        if entry.column not in names and matrix in names:
            raise input_error(
                table.path,
                f"{entry.column} (mapped to {target}) holds several signals",
                f"choose one: {matrix}, {entry.column}#2 ...",
            )
        found[target] = _named(table, entry), entry
    used = {column for column, _ in found.values()}
    for name in names:
        spoken_for = name in found or name in used or name in recipe.constants
        if name in recipe.units and not spoken_for:
            found[name] = name, ColumnMap(name, name)
    if not set(found) - {"time_s", TEST_COLUMN}:
        raise _nothing_mapped(table, recipe)
    return found


def _named(table: ForeignTable, entry: ColumnMap) -> str:
    """The mapped column's name. InputError without it, which names objects that may hold it."""
    names = list(table.columns)
    objects = named_objects(table.skipped)
    if objects and not has_column(names, entry):
        raise input_error(
            table.path,
            f"has no column {entry.column!r} (mapped to {entry.target}), but {objects}",
            f"export that, or map one of {some_of(names, 20, counted=False)}",
        )
    return names[find_column(names, entry, str(table.path))]


def _unread(table: ForeignTable, column: str) -> str | None:
    """The unread item of the file that a mapped column is, or is part of; None: neither."""
    if column in table.columns or column in table.skipped:
        return None if column in table.columns else column
    wholes = (column[:end] for end, sign in enumerate(column) if sign == ".")
    elements = (name for name in table.skipped if name.startswith((f"{column}{{", f"{column}(")))
    return next((whole for whole in wholes if whole in table.skipped), next(elements, None))


def _nothing_mapped(table: ForeignTable, recipe: Recipe) -> InputError:
    longest = max(len(values) for values in table.columns.values())
    signals = [name for name, values in table.columns.items() if len(values) == longest]
    likely = {name: _likely_channel(name, recipe) for name in signals}
    time = next((name for name, channel in likely.items() if channel == "time_s"), signals[0])
    others = [name for name in signals if name != time]
    other = next((name for name in others if likely[name]), next(iter(others), "COLUMN"))
    entry = _example(other, likely.get(other, ""), table.units.get(other), recipe)
    return input_error(
        table.path,
        f"no column is mapped to the log format; it has {table.describe()}",
        f'map its columns: --map "time_s={time}:{table.units.get(time, "s")}" --map "{entry}" '
        f"({_listing(table)})",
    )


def _likely_channel(column: str, recipe: Recipe) -> str:
    """The channel that a foreign name says it is, of those that the log may have; else empty."""
    words = re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", bare_name(column)).lower())
    said = (target for target, own in _CALLED.items() if not own.isdisjoint(words))
    return next((target for target in said if target in recipe.units), "")


def _example(column: str, channel: str, unit: str | None, recipe: Recipe) -> str:
    """A map entry of this column, in its unit if that is known, to the channel that it may be."""
    if not channel and "pressure_a_pa" in recipe.units:
        channel = "pressure_a_pa"
    elif not channel:
        channel = next((t for t in recipe.units if t not in ("time_s", TEST_COLUMN)), "COLUMN")
    usual = "kPa" if channel == "pressure_a_pa" else recipe.units.get(channel) or "percent"
    unit = (unit or usual).replace("*", "")
    gauge = "(g)" if channel == "pressure_a_pa" and not unit.endswith(")") else ""
    return f"{channel}={column}" + (f":{unit}{gauge}" if unit != "dimensionless" else "")


def unused_columns(table: ForeignTable, recipe: Recipe) -> list[str]:
    """The names of what is not mapped; not those of the same values under another name."""
    used = {id(table.columns[column]) for column, _ in _sources(table, recipe).values()}
    unread = [name for name, values in table.columns.items() if id(values) not in used]
    return [*unread, *table.skipped]


def log_columns(table: ForeignTable, recipe: Recipe, label: str | None) -> pd.DataFrame:
    """One file's log columns, SI, in the order of the log format.

    Columns of different rates are brought to the rows of one (`sysid.io.alignment`); where the
    recording starts again, a new test begins. Raises InputError naming row and column.
    """
    import pandas as pd

    sources = _sources(table, recipe)
    timeless = _are_readings(table, recipe, sources)
    if timeless:
        recipe = replace(recipe, period_s=1.0)
        table.notices.append(timeless_line(table.path))
    elif (kind := _settled(table, recipe, sources)) is not None:
        recipe = replace(recipe, period_s=1.0)
        table.notices.append(f"{settled_line(table.path, kind)}, and time_s numbers the rows")
    if "time_s" in sources and recipe.period_s is not None:
        raise input_error(table.path, "has a time_s column of its own", "omit --period")
    if "time_s" in sources and _numbers_samples(table, *sources["time_s"]):
        name, _ = sources.pop("time_s")
        table.notices.append(f"{table.path}: {name} numbers the samples and holds no time")
    made = _of_one_clock if one_clock(table, sources) else _of_several_clocks
    columns, tests, has_row = made(table, recipe, sources)
    columns.update({key: np.full(tests.rows, value) for key, value in recipe.constants.items()})
    _label(columns, tests, label)
    has_row = tests.worth_keeping(has_row)
    if not has_row.any():
        raise input_error(
            table.path,
            "has no row in which every mapped column has a value",
            "map columns that were recorded at the same time",
        )
    ordered = [n for n in recipe.units if n in columns and not (timeless and n == "time_s")]
    return pd.DataFrame({name: np.asarray(columns[name])[has_row] for name in ordered})


def _are_readings(table: ForeignTable, recipe: Recipe, sources: Sources) -> bool:
    """Whether a table without any time gives a speed and its effort, and nothing of the air."""
    present = {*sources, *recipe.constants}
    found = any(of_readings(present, units) for units in (LINEAR, ROTARY))
    return found and not _has_time(table, recipe, sources)


def _settled(table: ForeignTable, recipe: Recipe, sources: Sources) -> str | None:
    """`settled_kind` of a table without any time."""
    kind = settled_kind({*sources, *recipe.constants})
    return None if _has_time(table, recipe, sources) else kind


def _has_time(table: ForeignTable, recipe: Recipe, sources: Sources) -> bool:
    """Whether a column, the recipe or the file's own clock says when its rows were."""
    names = [name for name, _ in sources.values()]
    return (
        "time_s" in sources
        or recipe.period_s is not None
        or any(name in table.clocks or table.sampling.get(name) for name in names)
    )


_Made = tuple[dict[str, Any], Tests, BoolArray]


def _of_one_clock(table: ForeignTable, recipe: Recipe, sources: Sources) -> _Made:
    """Columns by target, their tests, and which rows have a value in all."""
    lengths = {name: len(table.columns[name]) for name, _ in sources.values()}
    if len(set(lengths.values())) > 1:
        told_lengths = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise input_error(
            table.path,
            f"the mapped columns differ in length: {told_lengths}",
            "map signals of equal length (give a single value with --set); those of another rate "
            f"are joined by their own time: --join {table.path.name} --join-map ...",
        )
    total = next(iter(lengths.values()))
    kept = _rows_to_keep(table, recipe, total)
    columns: dict[str, Any] = {}
    full = {t: s for t, s in sources.items() if not table.empty(s[0])[kept].any()}
    for target, (name, entry) in full.items():
        if target not in ("time_s", TEST_COLUMN):
            columns[target] = _si_values(table, recipe, target, name, entry, kept)
    columns["time_s"], tests = _timed(table, recipe, sources, kept, total)
    time, has_row = columns["time_s"], np.ones(len(kept), dtype=bool)
    slower = SlowerColumns(table, recipe)
    for target, (name, entry) in sources.items():
        if target in columns or target == TEST_COLUMN:
            continue
        own = slower.rows_of(name, target, kept, time, tests.starts)
        rows = kept if own is None else kept[own]
        columns[target] = _si_values(table, recipe, target, name, entry, rows)
        if own is not None:
            columns[target], known = slower.filled(
                name, target, own, columns[target], time, tests, kept
            )
            has_row &= known
    slower.tell(kept)
    return columns, tests, has_row


def _of_several_clocks(table: ForeignTable, recipe: Recipe, sources: Sources) -> _Made:
    """Like `_of_one_clock`, for channels that the file samples at different instants."""
    if recipe.period_s is not None:
        raise input_error(
            table.path, "its channels have times of their own, which differ", "omit --period"
        )
    grid = grid_of(table, recipe, sources)
    kept = _rows_to_keep(table, recipe, len(table.columns[grid]))
    instants = table.clocks[grid][kept]
    if "time_s" in sources:
        time = _si_values(table, recipe, "time_s", *sources["time_s"], kept)
    else:
        time = instants
        table.notices.append(f"{table.path}: time follows from the file's own times of {grid}")
    tests = found_tests(table, time, kept, said_starts(table, kept))
    columns: dict[str, Any] = {"time_s": time}
    has_row, others, longest = np.ones(len(kept), dtype=bool), [], 0.0
    for target, (name, entry) in sources.items():
        clock = table.clocks[name]
        if target == TEST_COLUMN:
            labels = np.asarray(table.labels(name), dtype=object)
            tests = given_tests(table, labels[rows_held(instants, clock)])
        elif target != "time_s" and np.array_equal(clock, table.clocks[grid]):
            columns[target] = _si_values(table, recipe, target, name, entry, kept)
        elif target != "time_s":
            held = recipe.is_held(target)
            values = _si_values(table, recipe, target, name, entry, None)
            columns[target] = values_at(instants, clock, values, held)
            known = has_value(instants, clock, held)
            tell_omitted(table, name, ~known, kept)
            has_row &= known
            others.append((name, held, median_period(clock)))
            longest = max(longest, 0.0 if held else median_period(clock))
    if others:
        table.notices.append(f"{table.path}: {told(grid, others)}")
    if longest:
        table.shape.append(joined_line(longest))
    return columns, tests, has_row


def _si_values(
    table: ForeignTable,
    recipe: Recipe,
    target: str,
    name: str,
    entry: ColumnMap,
    rows: IntArray | None,
) -> FloatArray:
    """A column in SI, in the `rows` that are asked for (None: all)."""
    readings = table.numbers(name, target, rows)
    stamped = name in table.stamped
    entry = entry if stamped else _as_stated(table, name, entry, recipe)
    entry = entry.of_gas(recipe.gas_constant)
    values = to_si(readings, entry, recipe.atmosphere_pa, stamped=stamped)
    at = np.arange(len(readings)) if rows is None else rows
    stated = table.units.get(name, "")
    table.notices += entry.notices(
        readings, str(table.path), lambda i: table.place(int(at[i])), stated
    )
    largest = LARGEST if target == "time_s" else sys.float_info.max
    return check_size(str(table.path), target, values, largest, recipe.units)


def _as_stated(table: ForeignTable, name: str, entry: ColumnMap, recipe: Recipe) -> ColumnMap:
    """A column's map, combined with the unit that the file states; what is done, as a notice."""
    if name not in table.units:
        return entry
    si = recipe.units[entry.target]
    in_name = name in table.in_names
    entry, notice = in_stated_unit(entry, table.units[name], si, str(table.path), in_name)
    table.notices += [] if notice is None else [notice]
    return entry


def _timed(
    table: ForeignTable, recipe: Recipe, sources: Sources, kept: IntArray, total: int
) -> tuple[FloatArray, Tests]:
    """The time of each row kept, s, without a counter's wraps, and the tests."""
    tests, starts = None, said_starts(table, kept)
    if TEST_COLUMN in sources:
        name = sources[TEST_COLUMN][0]
        tests = given_tests(table, np.asarray(table.labels(name, kept), dtype=object))
        starts = tests.starts[1:]
    if "time_s" not in sources:
        time = _time(table, recipe, [name for name, _ in sources.values()], total)
        if recipe.period_s is not None and kept[0] > kept[-1]:
            time = time[::-1]
        time = time[kept]
    else:
        name, entry = sources["time_s"]
        readings = _times_read(table, name, entry, kept)
        stamped = name in table.stamped
        entry = entry if stamped else _as_stated(table, name, entry, recipe)
        counts = readings if stamped else without_wraps(table, name, readings, kept, starts)
        time = to_si(counts, entry, recipe.atmosphere_pa, stamped=stamped)
        time = check_size(str(table.path), "time_s", time, LARGEST)
        if counts is readings:
            time = without_wraps(table, name, time, kept, starts, wraps_of_seconds)
    return time, found_tests(table, time, kept, starts) if tests is None else tests


def _numbers_samples(table: ForeignTable, name: str, entry: ColumnMap) -> bool:
    """Whether a column mapped as seconds counts rows whose period the file states elsewhere."""
    base, cells = table.sampling.get(name), table.columns[name]
    if base is None or entry.factor != 1.0 or base.period_s == 1.0 or cells.dtype.kind not in "if":
        return False
    return len(cells) > 1 and bool(np.all(np.diff(cells) == 1.0))


def _times_read(table: ForeignTable, name: str, entry: ColumnMap, kept: IntArray) -> FloatArray:
    """The readings (n,) of a time column; whole numbers beyond a double's digits from the first.

    Nanoseconds since 1970 are of this kind.
    """
    import pandas as pd

    cells = table.columns[name][kept]
    if cells.dtype.kind != "i" or np.max(np.abs(cells)) <= 2**sys.float_info.mant_dig:
        return table.numbers(name, "time_s", kept)
    table.origin = pd.Timedelta(int(cells[0]) * entry.factor, unit="s")
    table.notices.append(f"{table.path}: {name}: time counts from {cells[0]}")
    return np.asarray(cells - cells[0], dtype=np.float64)


def _label(columns: dict[str, Any], tests: Tests, label: str | None) -> None:
    """Put the tests' labels into the columns, after what the user calls them all."""
    called = columns.pop(TEST_COLUMN, None)
    label = label if called is None or label is not None else str(called[0])
    if tests.labels is not None:
        inner = tests.labels
        columns[TEST_COLUMN] = inner if label is None else [f"{label}/{test}" for test in inner]
    elif label is not None:
        columns[TEST_COLUMN] = [label] * tests.rows


def _rows_to_keep(table: ForeignTable, recipe: Recipe, rows: int) -> IntArray:
    """The rows that the recipe asks for, in its direction."""
    if not recipe.rows:
        return np.arange(rows)
    kept = kept_rows(recipe.rows, rows)
    if not kept:
        raise input_error(
            table.path,
            f"rows = {recipe.rows_text!r} keeps none of its {rows} rows",
            "fix --rows, or rows in the recipe's [options]",
        )
    return np.asarray(kept, dtype=np.intp)


def _time(table: ForeignTable, recipe: Recipe, names: Sequence[str], rows: int) -> FloatArray:
    """Time of each sample, s, where no column holds it: declared, or the file's own base."""
    if recipe.period_s is not None:
        _tell_other_period(table, names[0], recipe.period_s)
        return SampleTimes(recipe.period_s).ticks(rows)
    if (clock := table.clocks.get(names[0])) is not None:
        period = median_period(clock)
        table.notices.append(
            f"{table.path}: time follows from the file's own times, {period:.6g} s apart"
        )
        return clock
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
            f'map it (--map "time_s=COLUMN:s"), or give --period SECONDS ({_listing(table)})',
        )
    table.notices.append(
        f"{table.path}: time follows from the file's own period, {base.period_s:g} s"
    )
    return base.ticks(rows)


def _tell_other_period(table: ForeignTable, name: str, period_s: float) -> None:
    """The notice where a period that was given is not the file's own."""
    clock, base = table.clocks.get(name), table.sampling.get(name)
    own = None if base is None else base.period_s
    if clock is not None and len(clock) > 1:
        own = median_period(clock)
    if own is not None and not math.isclose(own, period_s, rel_tol=1e-3):
        table.notices.append(
            f"{table.path}: its samples are {own:.6g} s apart by the file; --period {period_s:g} "
            "is used: omit it unless the file is wrong"
        )


def _listing(table: ForeignTable) -> str:
    """Where all columns of a file are to be seen, for a message."""
    return f"all columns: sysid convert {table.path.name} --list"


__all__ = ["log_columns", "of_nearest_rig", "unused_columns"]
