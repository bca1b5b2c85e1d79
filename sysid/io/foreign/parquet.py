"""Parquet files in foreign names and units, by pyarrow."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from sysid.errors import InputError
from sysid.io.foreign.table import ForeignTable, ReadOptions, damaged
from sysid.io.parquet_columns import ParquetColumns


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """One column per field of the schema; nested ones are skipped."""
    table = ForeignTable(path, "Parquet")
    try:
        content = ParquetColumns.of(path, file)
        table.skipped |= (unread := content.unread())
        read = content.read([name for name in content.schema.names if name not in unread])
        for name, column in zip(read.column_names, read.columns, strict=True):
            table.columns[name] = column.to_pandas().to_numpy()
    except InputError:
        raise
    except Exception as error:  # pyarrow passes on what its decoders of metadata raise
        raise damaged(path, "Parquet", error) from None
    return table
