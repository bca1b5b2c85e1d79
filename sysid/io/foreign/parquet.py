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
        unread = content.unread()
        counts = Counter(content.schema.names)
        unread |= {name: f"it names {n} columns" for name, n in counts.items() if n > 1}
        table.skipped |= unread
        read = content.read([name for name in counts if name not in unread])
        for name, column in zip(read.column_names, read.columns, strict=True):
            table.columns[name] = column.to_pandas().to_numpy()
    return table
