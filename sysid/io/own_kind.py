"""A kind of test that a user defines: its columns, read like those of the log format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sysid.errors import input_error
from sysid.io.channels import TEST_COLUMN
from sysid.io.exclusion import Exclusion, without
from sysid.io.foreign_log import in_log_format
from sysid.io.logs import (
    LogReading,
    check_time_column,
    groups_of,
    log_from,
    log_table,
    missing_time,
    take_column,
    with_own_times,
)
from sysid.io.rig import Rig
from sysid.io.samples import Log
from sysid.io.units import ColumnMap, has_column


@dataclass(frozen=True)
class OwnKind:
    """A kind of log in addition to the log format's, and the unit of each of its columns."""

    kind: str
    columns: Mapping[str, str]

    @property
    def numbers(self) -> Mapping[str, str]:
        """The units of its law's parameters, by name; empty where no law is known."""
        return {}

    @property
    def held(self) -> tuple[str, ...]:
        """Columns that hold from row to row, as a command does; the others are linear."""
        return ()

    @property
    def defined_in(self) -> str:
        """The file that defines it, as `--component` names it; empty without one."""
        return ""

    @property
    def units(self) -> dict[str, str | None]:
        """The unit of each column that a log of this kind may have, in their order."""
        return {"time_s": "s", TEST_COLUMN: None, **self.columns}


def read_own_log(
    path: Path,
    rig: Rig,
    own: OwnKind,
    mapping: Mapping[str, ColumnMap] | None = None,
    shared: Mapping[str, ColumnMap] | None = None,
    exclude: Sequence[Exclusion] = (),
) -> Log:
    """Read a log of a user's own kind: `time_s`, `test` where it is there, and its columns.

    Values are taken in the columns' own units, converted where `mapping`, or `shared` for columns
    that the file has, says so. A column that is missing is missing in the trials, one that is empty
    in a test is so in this test, which is said, and what `exclude` names is missing, too. Raises
    InputError for a file, a cell or a time column that cannot be used.
    """
    units: dict[str, str | None] = {"time_s": "s", **own.columns}
    maps = {t: m for t, m in {**(shared or {}), **(mapping or {})}.items() if t in (*units, "test")}
    table = log_table(path, maps, ("test", *units))
    for target in set(shared or {}) - set(mapping or {}):
        if target in maps and not has_column(table.header, maps[target]):
            del maps[target]
    reading = LogReading(table, rig, maps=maps)
    reading.convert += f" --component {own.defined_in or 'FILE.py'}"
    if table.foreign is not None:
        table, reading.notices = in_log_format(table, maps, rig.atmosphere_pa, own.units, own.held)
        reading.table, maps = table, {}
    if "time_s" not in maps and "time_s" not in table.header:
        raise missing_time(table)
    reading.without_excluded(without(table, maps, exclude, rig))
    table = reading.table
    for name in units:
        column = table.column_of(name, maps)
        if column is not None:
            take_column(reading, name, column, maps, units)
    if len(table.frame) < 2:
        raise input_error(path, "holds one row only", "a test needs at least two samples")
    groups = with_own_times(reading, groups_of(reading, maps))
    check_time_column(reading, groups)
    return log_from(reading, groups)


__all__ = ["OwnKind", "read_own_log"]
