"""Parquet files in foreign names and units, by pyarrow."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import BinaryIO

from sysid.io.file_kinds import read_as
from sysid.io.foreign.table import ForeignTable, ReadOptions
from sysid.io.parquet_columns import ParquetColumns


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """One column per field of the schema; nested ones are skipped."""
    table = ForeignTable(path, "Parquet")
    with read_as(path, "Parquet"):
        content = ParquetColumns.of(path, file)
        names, unread = _read_and_not(content)
        table.skipped |= unread
        read = content.read(names)
        for name, column in zip(read.column_names, read.columns, strict=True):
            table.columns[name] = column.to_pandas().to_numpy()
    return table


def names(path: Path, file: BinaryIO) -> tuple[str, ...]:
    """The names of the columns that `read` gives, from the schema alone."""
    with read_as(path, "Parquet"):
        return tuple(_read_and_not(ParquetColumns.of(path, file))[0])


def _read_and_not(content: ParquetColumns) -> tuple[list[str], dict[str, str]]:
    """The columns that are read, and the others with why they are not."""
    counts = Counter(content.schema.names)
    unread = content.unread()
    unread |= {name: f"it names {n} columns" for name, n in counts.items() if n > 1}
    return [name for name in counts if name not in unread], unread
