"""Parquet files in foreign names and units, by pyarrow."""

from __future__ import annotations

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
        table.skipped |= (unread := content.unread())
        read = content.read([name for name in content.schema.names if name not in unread])
        for name, column in zip(read.column_names, read.columns, strict=True):
            table.columns[name] = column.to_pandas().to_numpy()
    return table
