"""Parquet files in foreign names and units, by pyarrow."""

from __future__ import annotations

import io
from pathlib import Path

from sysid.io.foreign.table import ForeignTable, ReadOptions, damaged


def read(path: Path, raw: bytes, options: ReadOptions) -> ForeignTable:
    """One column per field of the schema; nested ones are skipped."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    table = ForeignTable(path, "Parquet")
    try:
        content = parquet.ParquetFile(io.BytesIO(raw)).read()
        for name, column in zip(content.column_names, content.columns, strict=True):
            if pa.types.is_nested(column.type):
                table.skipped[name] = f"nested ({column.type})"
            else:
                table.columns[name] = column.to_pandas().to_numpy()
    except Exception as error:  # pyarrow passes on what its decoders of metadata raise
        raise damaged(path, "Parquet", error) from None
    return table
