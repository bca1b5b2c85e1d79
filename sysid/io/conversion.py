"""`sysid convert`: a lab's own file into the log format (`spec/log-format.md`).

The readers are in `sysid.io.foreign`, the units in `sysid.io.units`; here the columns are mapped,
checked and written. The options of the command line may also be given in a TOML file
(`sysid.io.foreign.recipe`).
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import InputError, input_error, one_line, shortened
from sysid.io.foreign import ForeignTable, SampleTimes, read_foreign
from sysid.io.foreign.recipe import Recipe, extended, kept_rows, read_recipe
from sysid.io.joining import TimedColumns, joined
from sysid.io.reshaping import Reshaping, joined_line, median_period, read_trim, reshaped, unwrapped
from sysid.io.rig import nearest_rig_file, read_rig
from sysid.io.tables import FOREIGN_SUFFIXES, read_bytes, write_table
from sysid.io.units import (
    CANONICAL_UNITS,
    LARGEST,
    TEST_COLUMN,
    ColumnMap,
    check_size,
    find_column,
    has_column,
    parse_map,
    to_si,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ForeignSource:
    """One foreign file that went into a log."""

    path: str
    format: str
    sha256: str


@dataclass(frozen=True)
class ConversionReport:
    """What was written, its sources, and notices for the user."""

    output: str
    sources: tuple[ForeignSource, ...]
    rows: int
    columns: tuple[str, ...]
    tests: tuple[str, ...]
    maps: tuple[str, ...]
    unmapped: tuple[str, ...]
    notices: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The report as JSON types."""
        return {
            "output": self.output,
            "sources": [vars(source) for source in self.sources],
            "rows": self.rows,
            "columns": list(self.columns),
            "tests": list(self.tests),
            "map": list(self.maps),
            "unmapped": list(self.unmapped),
            "notices": list(self.notices),
        }


def convert(
    foreign: Path | Sequence[Path],
    output: Path,
    *,
    maps: Iterable[str] = (),
    spec_file: Path | None = None,
    constants: Iterable[str] = (),
    delimiter: str | None = None,
    decimal: str | None = None,
    thousands: str | None = None,
    no_header: bool = False,
    skip_rows: int | None = None,
    rows: str | None = None,
    sheet: str | None = None,
    period_s: float | None = None,
    atmosphere_pa: float | None = None,
    unwrap: bool = False,
    trim: str | None = None,
    resample_s: float | None = None,
    join: Sequence[Path] = (),
    join_maps: Iterable[str] = (),
    join_shift_s: float = 0.0,
) -> ConversionReport:
    """Read foreign file(s), map their columns to SI and write a log (CSV or Parquet).

    `maps` are entries `target=column[:unit]` (`sysid.io.units`), `constants` entries
    `target=value`, `rows` the slices of each file's rows that are kept ("0:500, 900:").
    Several files become the tests of one log, labelled with their file names. `unwrap` follows an
    angle over its turns, `trim` ("FROM:TO", s) keeps a part of each test, `resample_s` gives the
    rows an even period (`sysid.io.reshaping`). The columns of the files `join`, by `join_maps`, are
    put beside those of the one foreign file by time, `join_shift_s` added to theirs
    (`sysid.io.joining`).
    Without maps, columns that already have the log format's names are used; without
    `atmosphere_pa`, gauge pressures use that of the rig file nearest to the files. Raises
    InputError, one line with the place and the fix; the output is complete or absent.
    """
    paths = [foreign] if isinstance(foreign, Path) else list(foreign)
    if output.suffix.lower() in FOREIGN_SUFFIXES:
        raise input_error(
            output, "a log is CSV or Parquet", f"write it as {output.stem or 'log'}.csv or .parquet"
        )
    recipe = extended(
        Recipe() if spec_file is None else read_recipe(spec_file),
        maps,
        constants,
        {
            "delimiter": delimiter,
            "decimal": decimal,
            "thousands": thousands,
            "header": False if no_header else None,
            "skip_rows": skip_rows,
            "sheet": sheet,
        },
        period_s,
        atmosphere_pa,
        rows,
    )
    if len(paths) > 1 and (TEST_COLUMN in recipe.maps or TEST_COLUMN in recipe.constants):
        raise input_error(
            "convert", "several files are several tests, but `test` is given too", "omit it"
        )
    recipe = _with_atmosphere(recipe, paths)
    frames, sources, notices = [], [], list(recipe.notices)
    unmapped: dict[str, None] = {}
    for path, label in zip(paths, _labels(paths), strict=True):
        if path.exists() and output.exists() and path.samefile(output):
            raise input_error(output, "is the file to be converted", "choose another with -o")
        raw = read_bytes(path, "a file to convert")
        table = read_foreign(path, raw, recipe.read)
        frames.append(_convert_table(table, recipe, label))
        sources.append(ForeignSource(str(path), table.format, hashlib.sha256(raw).hexdigest()))
        unmapped.update(dict.fromkeys(_unused(table, recipe)))
        notices += table.notices
    how = Reshaping(unwrap, read_trim(trim), resample_s)
    whole, said = _joined(frames, paths), []
    if join:
        if len(paths) > 1:
            raise input_error(
                "--join", "several files are several tests", "convert them one by one"
            )
        first = TimedColumns(str(paths[0]), unwrapped(whole) if unwrap else whole, table.origin)
        others = _others(join, recipe, parse_map(join_maps, "--join-map"), join_shift_s, unwrap)
        whole, notice = joined(first, [columns for columns, _ in others])
        notices.append(notice)
        sources += [source for _, source in others]
        said = [f"map: {text} (joined)" for text in join_maps]
        clocks = [first, *(columns for columns, _ in others)]
        said.append(joined_line(max(c.row_period for c in clocks)))
    rows_every = median_period(whole["time_s"].to_numpy(float))
    frame = reshaped(whole, how, ", ".join(map(str, paths)))
    if unmapped:
        more = " ..." if len(unmapped) > 30 else ""
        notices.append(
            f"left out, not mapped: {', '.join(map(shortened, list(unmapped)[:30]))}{more}"
        )
    _write(frame, output, sources, recipe, [*said, *how.lines(rows_every)])
    return ConversionReport(
        output=str(output),
        sources=tuple(sources),
        rows=len(frame),
        columns=tuple(frame.columns),
        tests=tuple(dict.fromkeys(map(str, frame[TEST_COLUMN]))) if TEST_COLUMN in frame else (),
        maps=tuple(str(entry) for entry in recipe.maps.values()),
        unmapped=tuple(unmapped),
        notices=tuple(map(one_line, notices)),
    )


def _others(
    paths: Sequence[Path],
    recipe: Recipe,
    maps: Mapping[str, ColumnMap],
    shift_s: float,
    unwrap: bool,
) -> list[tuple[TimedColumns, ForeignSource]]:
    """The files to be joined: each with the maps whose columns it has."""
    found, used = [], set()
    for path in paths:
        raw = read_bytes(path, "a file to join")
        table = read_foreign(path, raw, recipe.read)
        own = {t: m for t, m in maps.items() if has_column(list(table.columns), m)}
        used |= set(own)
        plain = replace(recipe, maps=own, constants={}, rows=(), period_s=None)
        frame = _convert_table(table, _with_atmosphere(plain, paths), None)
        frame = unwrapped(frame) if unwrap else frame
        source = ForeignSource(str(path), table.format, hashlib.sha256(raw).hexdigest())
        found.append((TimedColumns(str(path), frame, table.origin, shift_s), source))
    if missing := [m for t, m in maps.items() if t not in used]:
        raise input_error(
            ", ".join(map(str, paths)),
            f"has no column {missing[0].column!r} (--join-map {missing[0]})",
            "give one of the joined files' columns",
        )
    return found


def _with_atmosphere(recipe: Recipe, paths: Sequence[Path]) -> Recipe:
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


def _labels(paths: Sequence[Path]) -> list[str | None]:
    """A test's label for each of several files: its stem, numbered where stems repeat."""
    if len(paths) == 1:
        return [None]
    stems = [path.stem for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{stem}-{stems[:i].count(stem) + 1}"
        for i, stem in enumerate(stems)
    ]


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


def _unused(table: ForeignTable, recipe: Recipe) -> list[str]:
    used = {column for column, _ in _sources(table, recipe).values()}
    return [name for name in (*table.columns, *table.skipped) if name not in used]


def _convert_table(table: ForeignTable, recipe: Recipe, label: str | None) -> pd.DataFrame:
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


def _joined(frames: Sequence[pd.DataFrame], paths: Sequence[Path]) -> pd.DataFrame:
    import pandas as pd

    for frame, path in zip(frames, paths, strict=True):
        if list(frame.columns) != list(frames[0].columns):
            differing = sorted(set(frame.columns) ^ set(frames[0].columns))
            raise input_error(
                path,
                f"{', '.join(differing)} is not in every file (compared with {paths[0].name})",
                "convert only files of the same layout together",
            )
    return pd.concat(frames, ignore_index=True)


def _write(
    frame: pd.DataFrame,
    output: Path,
    sources: Sequence[ForeignSource],
    recipe: Recipe,
    shape: Sequence[str],
) -> None:
    """CSV under comment lines that give its origin, or Parquet with the same metadata."""
    lines = [f"source: {Path(s.path).name} ({s.format}), SHA-256 {s.sha256}" for s in sources]
    lines += [f"map: {entry}" for entry in recipe.maps.values()]
    lines += [f"map: {key}={value} (constant)" for key, value in recipe.constants.items()]
    if recipe.atmosphere_pa is not None:
        lines.append(f"map: atmosphere {recipe.atmosphere_pa:g} Pa")
    if recipe.period_s is not None:
        lines.append(f"map: sampling period {recipe.period_s:g} s")
    if recipe.rows:
        lines.append(f"map: rows {recipe.rows_text}")
    lines += shape
    write_table(frame, output, lines)
