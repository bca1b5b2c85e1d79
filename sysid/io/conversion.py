"""`sysid convert`: a lab's own file into the log format (`docs/reference/log-format.md`).

The readers are in `sysid.io.foreign`, the units in `sysid.io.units`; here the columns are mapped,
checked and written. The options of the command line may also be given in a TOML file
(`sysid.io.foreign.recipe`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import input_error, one_line, shortened, some_of
from sysid.io.channels import TEST_COLUMN
from sysid.io.file_kinds import FOREIGN_SUFFIXES
from sysid.io.foreign import ForeignFile, ForeignTable, read_any
from sysid.io.foreign.recipe import Recipe, extended, read_recipe
from sysid.io.foreign_columns import log_columns, of_nearest_rig, unused_columns
from sysid.io.joining import TimedColumns, joined
from sysid.io.own_kind import OwnKind
from sysid.io.reshaping import (
    HELD_COLUMNS,
    Reshaping,
    joined_line,
    lines_between,
    median_period,
    read_trim,
    reshaped,
    unwrapped,
)
from sysid.io.rig import name_meant
from sysid.io.tables import write_table
from sysid.io.units import (
    CANONICAL_UNITS,
    ColumnMap,
    has_column,
    parse_map,
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
    transpose: bool = False,
    fill: str | None = None,
    own: OwnKind | None = None,
) -> ConversionReport:
    """Read foreign file(s), map their columns to SI and write a log (CSV or Parquet).

    `maps` are entries `target=column[:unit]` (`sysid.io.units`), `constants` entries
    `target=value`, `rows` the slices of each file's rows that are kept ("0:500, 900:").
    `transpose` reads a text file whose lines are signals; `fill` ("hold", "linear") says how every
    column is filled between its own samples (None: commands held, measurements linear).
    Several files become the tests of one log, labelled with their file names. `unwrap` follows an
    angle over its turns, `trim` ("FROM:TO", s) keeps a part of each test, `resample_s` gives the
    rows an even period (`sysid.io.reshaping`). The columns of the files `join`, by `join_maps`, are
    joined to those of the one foreign file by time, `join_shift_s` added to theirs
    (`sysid.io.joining`).
    `own`: the log is of a component's kind, and the targets are its columns, in their units.
    Without maps, columns that already have the log format's names are used; without
    `atmosphere_pa`, gauge pressures use that of the rig file nearest to the files. Raises
    InputError, one line with the place and the fix; the output is complete or absent.
    """
    paths = [foreign] if isinstance(foreign, Path) else list(foreign)
    if output.suffix.lower() in FOREIGN_SUFFIXES:
        raise input_error(
            output, "a log is CSV or Parquet", f"write it as {output.stem or 'log'}.csv or .parquet"
        )
    units = CANONICAL_UNITS if own is None else own.units
    recipe = extended(
        Recipe(units=units) if spec_file is None else read_recipe(spec_file, units),
        maps,
        constants,
        {
            "delimiter": delimiter,
            "decimal": decimal,
            "thousands": thousands,
            "header": False if no_header else None,
            "skip_rows": skip_rows,
            "sheet": sheet,
            "transpose": transpose or None,
        },
        period_s,
        atmosphere_pa,
        rows,
        fill,
    )
    held = HELD_COLUMNS if own is None else own.held
    recipe = replace(of_nearest_rig(recipe, paths), held=held)
    how = Reshaping(unwrap, read_trim(trim), resample_s, held)
    files = _files_of_tests(paths, output, recipe)
    notices = [*recipe.notices, *(notice for file in files for notice in file.notices)]
    whole = _joined([file.frame for file in files], paths)
    joined_lines: list[str] = []
    if "time_s" not in whole and (join or how != Reshaping(unwrap, held=held)):
        raise input_error(
            ", ".join(map(str, paths)),
            "holds no time, which --join, --trim and --resample need",
            'omit them, or map one (--map "time_s=COLUMN:s")',
        )
    if join:
        others = _others(paths, join, recipe, parse_map(join_maps, "--join-map", units))
        first = files[0].timed(unwrap, held)
        further = [other.timed(unwrap, held, join_shift_s) for other in others]
        whole, notice = joined(first, further, recipe.fill)
        notices += [notice, *(line for other in others for line in other.notices)]
        joined_lines.append(joined_line(max(c.row_period for c in (first, *further))))
        files += others
    rows_every = median_period(whole["time_s"].to_numpy(float)) if "time_s" in whole else 0.0
    frame = reshaped(whole, how, ", ".join(map(str, paths)))
    unmapped = list(dict.fromkeys(name for file in files for name in file.unmapped))
    if unmapped:
        notices.append(_ignored(unmapped, [name for name in units if name not in frame]))
    sources = tuple(file.source for file in files)
    said = [*(line for file in files for line in file.said), *joined_lines]
    _write(frame, output, sources, recipe, [*said, *how.lines(rows_every)])
    return ConversionReport(
        output=str(output),
        sources=sources,
        rows=len(frame),
        columns=tuple(frame.columns),
        tests=tuple(dict.fromkeys(map(str, frame[TEST_COLUMN]))) if TEST_COLUMN in frame else (),
        maps=(*(str(entry) for entry in recipe.maps.values()), *join_maps),
        unmapped=tuple(unmapped),
        notices=tuple(map(one_line, notices)),
    )


@dataclass(frozen=True)
class _MappedFile:
    """A foreign file's columns (SI), and what is to be said of it (`said` in the log)."""

    frame: pd.DataFrame
    origin: Any
    source: ForeignSource
    notices: tuple[str, ...]
    unmapped: tuple[str, ...]
    said: tuple[str, ...]

    def timed(self, unwrap: bool, held: tuple[str, ...], shift_s: float = 0.0) -> TimedColumns:
        """The columns to be joined by time; `unwrap` follows their angle over its turns."""
        frame = unwrapped(self.frame) if unwrap else self.frame
        return TimedColumns(self.source.path, frame, self.origin, shift_s, held)


def _read(path: Path, what: str, recipe: Recipe) -> ForeignFile:
    wanted = tuple(entry.column for entry in recipe.maps.values())
    return read_any(path, what, replace(recipe.read, names=wanted))


def _mapped(file: ForeignFile, recipe: Recipe, label: str | None = None) -> _MappedFile:
    """Its columns in the log format; `label` is its test's among several files."""
    table = file.table
    return _MappedFile(
        log_columns(table, recipe, label),
        table.origin,
        ForeignSource(str(file.path), table.format, file.sha256),
        tuple(table.notices),
        tuple(unused_columns(table, recipe)),
        # A log that is converted once more keeps what is known of its samples.
        (*lines_between(file.comments), *table.shape),
    )


def _files_of_tests(paths: Sequence[Path], output: Path, recipe: Recipe) -> list[_MappedFile]:
    """The files to be converted, of which several are several tests."""
    if len(paths) > 1 and (TEST_COLUMN in recipe.maps or TEST_COLUMN in recipe.constants):
        raise input_error(
            "convert", "several files are several tests, but `test` is given too", "omit it"
        )
    found = []
    for path, label in zip(paths, _labels(paths), strict=True):
        if path.exists() and output.exists() and path.samefile(output):
            raise input_error(output, "is the file to be converted", "choose another with -o")
        found.append(_mapped(_read(path, "a file to convert", recipe), recipe, label))
    return found


def _others(
    tests: Sequence[Path], paths: Sequence[Path], recipe: Recipe, maps: Mapping[str, ColumnMap]
) -> list[_MappedFile]:
    """The files to be joined to the one of `tests`: each with the maps whose columns it has."""
    if len(tests) > 1:
        raise input_error("--join", "several files are several tests", "convert them one by one")
    found, used = [], set()
    for path in paths:
        file = _read(path, "a file to join", replace(recipe, maps=maps))
        own = {t: m for t, m in maps.items() if has_column(list(file.table.columns), m)}
        used |= set(own)
        plain = replace(recipe, maps=own, constants={}, rows=(), period_s=None, notices=())
        plain = of_nearest_rig(plain, [path])
        _check_joinable(file.table, own, recipe.units)
        mapped = _mapped(file, plain)
        said = [f"map: {entry} (joined)" for entry in own.values()]
        if any(entry.gauge for entry in own.values()) and plain.atmosphere_pa is not None:
            said.append(f"map: atmosphere {plain.atmosphere_pa:g} Pa (joined)")
        notices = (*plain.notices, *mapped.notices)
        found.append(replace(mapped, notices=notices, said=(*said, *mapped.said)))
    if missing := [m for t, m in maps.items() if t not in used]:
        raise input_error(
            ", ".join(map(str, paths)),
            f"has no column {missing[0].column!r} (--join-map {missing[0]})",
            "give one of the joined files' columns",
        )
    return found


def _check_joinable(
    table: ForeignTable, own: Mapping[str, ColumnMap], units: Mapping[str, str | None]
) -> None:
    """InputError where no map gives a joined file its times, or anything else."""
    known = {*own, *(name for name in table.columns if name in units)}
    if "time_s" not in known and not table.sampling and not table.clocks:
        raise input_error(
            table.path,
            f"time_s is not mapped; it has {table.describe()}",
            'map it (--join-map "time_s=COLUMN:s")',
        )
    if not known - {"time_s", TEST_COLUMN}:
        raise input_error(
            table.path,
            f"none of its columns is mapped; it has {table.describe()}",
            'map one (--join-map "theta_rad=COLUMN:deg")',
        )


def _labels(paths: Sequence[Path]) -> list[str | None]:
    """A test's label for each of several files: its stem, numbered where stems repeat."""
    if len(paths) == 1:
        return [None]
    stems = [path.stem for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{stem}-{stems[:i].count(stem) + 1}"
        for i, stem in enumerate(stems)
    ]


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


def _ignored(names: Sequence[str], lacking: Sequence[str]) -> str:
    """The notice of what is not mapped; with the log format's name that one may be meant for."""
    shown = []
    for name in names[:31]:
        meant = name_meant(name, lacking)
        shown.append(shortened(name) + (f" (did you mean {meant}?)" if meant else ""))
    return f"ignored, not mapped: {some_of(shown, 30, counted=False)}"


# The comment line that names a file of which a log was made.
_SOURCE = "source: "


def sources_of(log: Path) -> Iterator[str]:
    """The names of the files that a converted CSV log was made of; none of one that was not."""
    with log.open("rb") as file:
        for line in file:
            if not line.startswith(b"#"):
                return
            text = line.decode("utf-8", "replace").removeprefix("# ")
            if text.startswith(_SOURCE):
                yield text.removeprefix(_SOURCE).rpartition(" (")[0]


def _write(
    frame: pd.DataFrame,
    output: Path,
    sources: Sequence[ForeignSource],
    recipe: Recipe,
    shape: Sequence[str],
) -> None:
    """CSV under comment lines that give its origin, or Parquet with the same metadata."""
    lines = [f"{_SOURCE}{Path(s.path).name} ({s.format}), SHA-256 {s.sha256}" for s in sources]
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
