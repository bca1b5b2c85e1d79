"""A log in a lab's own format, read with maps as `sysid convert` would convert it.

What is in the log format itself, with a lab's column names at most, is read as a log
(`sysid.io.tables`), which is quicker and names lines; everything else goes to the readers of
foreign files. How such a file is to be read is detected; where that does not do, it is converted
first.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from sysid.errors import InputError, shortened, some_of
from sysid.io.file_kinds import FOREIGN_SUFFIXES, PARQUET_HEAD, PARQUET_SUFFIXES, is_bag
from sysid.io.foreign import ReadOptions, read_any
from sysid.io.foreign.recipe import Recipe
from sysid.io.foreign_columns import log_columns, unused_columns
from sysid.io.reshaping import HELD_COLUMNS
from sysid.io.tables import HEAD_BYTES, LogTable, is_number, open_input
from sysid.io.units import ColumnMap

_MARKS = (b"\xff\xfe", b"\xfe\xff")
# Options that commands which read logs do not have.
_OF_CONVERT = re.compile(
    r"--(decimal|thousands|delimiter|sheet|period|no-header|header|set|fill|rows|transpose"
    r"|atmosphere|trim|unwrap|resample|join)\b|skip.rows"
)


def is_in_log_format(path: Path, maps: Mapping[str, ColumnMap], names: Collection[str]) -> bool:
    """Whether a file is CSV as the log format has it, or Parquet, but for its columns' names.

    Its header holds a column of `maps` or one of `names`, separated by commas, and numbers are
    below it. Raises InputError where it cannot be opened.
    """
    if path.suffix.lower() in FOREIGN_SUFFIXES or is_bag(path):
        return False
    with open_input(path, "a log") as file:
        head = file.read(HEAD_BYTES)
    if head.startswith(PARQUET_HEAD) or path.suffix.lower() in (*PARQUET_SUFFIXES, ".toml"):
        return True
    if b"\0" in head or head.startswith(_MARKS):
        return False
    text = head.decode("utf-8-sig", errors="replace").splitlines()
    lines = [line for line in text if line.strip()]
    while lines and lines[0].lstrip().startswith("#"):
        del lines[0]
    if len(lines) < 2:
        return True  # which the reader of logs answers
    try:
        header, first = (next(csv.reader([line])) for line in lines[:2])
    except (csv.Error, StopIteration):
        return False
    own = {name.strip() for name in header}
    numbered = any(entry.column.startswith("#") for entry in maps.values())
    known = bool(own & ({entry.column for entry in maps.values()} | set(names))) or numbered
    return known and len(first) == len(header) and any(map(is_number, first))


def foreign_log(path: Path, maps: Mapping[str, ColumnMap]) -> LogTable:
    """A lab's own file, read to be mapped by `maps`, as a table to be brought `in_log_format`.

    Its header is the file's own, its frame empty. Raises InputError as `read_any` does.
    """
    import pandas as pd

    with _converted_first():
        wanted = tuple(entry.column for entry in maps.values())
        file = read_any(path, "a log", ReadOptions(names=wanted))
    header, none = tuple(file.table.columns), pd.DataFrame()
    return LogTable(
        path, file.sha256, header, none, None, comments=file.comments, foreign=file.table
    )


def in_log_format(
    table: LogTable,
    maps: Mapping[str, ColumnMap],
    atmosphere_pa: float | None,
    units: Mapping[str, str | None],
    held: tuple[str, ...] = HELD_COLUMNS,
    gas_constant: float | None = None,
) -> tuple[LogTable, list[str]]:
    """The table of a `foreign_log` with the log format's columns in SI, and notices.

    `units` are those of the columns that it may have, by name, of which `held` hold from sample to
    sample; `atmosphere_pa` (Pa) is added to gauge pressures, `gas_constant` (J/(kg K), None: of
    air) is that of the gas whose volume is counted. Raises InputError as `sysid convert`
    does.
    """
    if table.foreign is None:
        raise TypeError("the table is no foreign file's")
    # A file that is read once more, with another rig, says all of it again.
    file = replace(
        table.foreign,
        notices=list(table.foreign.notices),
        stamped=set(),
        shape=list(table.foreign.shape),
    )
    recipe = Recipe(maps=dict(maps), atmosphere_pa=atmosphere_pa, units=units, held=held)
    recipe = replace(recipe, gas_constant=gas_constant)
    with _converted_first():
        frame = log_columns(file, recipe, None)
        unused = unused_columns(file, recipe)
    notices = list(dict.fromkeys(file.notices))
    if unused:
        notices.append(unknown_line(table.path, unused))
    is_whole = len(frame) == max(len(values) for values in file.columns.values())
    placed = file.place if is_whole else lambda row: f"row {row + 1} of those that are read"
    made = replace(
        table,
        header=tuple(map(str, frame.columns)),
        frame=frame,
        comments=(*table.comments, *file.shape),
        place_of=placed,
        foreign=None,
    )
    return made, notices


def unknown_line(path: Path, names: Sequence[str]) -> str:
    """The notice of unknown columns."""
    return f"{path}: ignored, unknown: {some_of([*map(shortened, names)], 30)}"


@contextmanager
def _converted_first() -> Iterator[None]:
    """Errors in the block say of options that only `sysid convert` has that it has them."""
    try:
        yield
    except InputError as error:
        if _OF_CONVERT.search(str(error)) is None:
            raise
        raise InputError(
            f"{error} (options of `sysid convert`: convert it first, and give what it writes)"
        ) from None


__all__ = ["foreign_log", "in_log_format", "is_in_log_format", "unknown_line"]
