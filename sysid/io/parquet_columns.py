"""Columns of a Parquet file, by pyarrow, within the bounds that its metadata are held to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from sysid.io.bounds import Cells, check_columns, most_bytes, too_long

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class ParquetColumns:
    """An open Parquet file and its schema."""

    path: Path
    schema: pa.Schema
    _file: Any

    @classmethod
    def of(cls, path: Path, file: BinaryIO) -> ParquetColumns:
        """Reads the metadata only. Raises InputError beyond the bounds; else as pyarrow does."""
        import pyarrow.parquet as parquet

        metadata = parquet.read_metadata(file)
        check_columns(path, metadata.num_columns)
        schema = metadata.schema.to_arrow_schema()
        # A text that recurs is kept once, as it is in the file.
        texts = [field.name for field in schema if _is_text(field.type)]
        return cls(
            path, schema, parquet.ParquetFile(file, metadata=metadata, read_dictionary=texts)
        )

    def unread(self) -> dict[str, str]:
        """Columns of the file that are not columns of a table, with the reason."""
        import pyarrow as pa

        reasons = {}
        for field in self.schema:
            if pa.types.is_nested(field.type):
                reasons[field.name] = f"nested ({field.type})"
            elif pa.types.is_fixed_size_binary(field.type):
                reasons[field.name] = f"of type {field.type}"
        return reasons

    def read(self, names: Sequence[str]) -> pa.Table:
        """The table of these columns. Raises InputError beyond the bounds."""
        self._check(set(names))
        table = self._file.read(columns=list(names))
        length = sum(_text_bytes(column) for column in table.columns)
        if length > (most := most_bytes()):
            raise too_long(self.path, f"holds {length:,} bytes of text", most)
        return table

    def _check(self, names: set[str]) -> None:
        """Counts what the pages hold, not what the file's head says of them all."""
        metadata = self._file.metadata
        paths = (metadata.schema.column(n).path for n in range(metadata.num_columns))
        # A field's name may have dots, and a nested one has columns whose paths begin with it.
        asked = [n for n, path in enumerate(paths) if not names.isdisjoint(_heads(path))]
        cells, unpacked = Cells(self.path), 0
        for group in range(metadata.num_row_groups):
            rows = metadata.row_group(group)
            for number in asked:
                column = rows.column(number)
                cells.add(max(rows.num_rows, column.num_values))
                unpacked += column.total_uncompressed_size
        if unpacked > (most := most_bytes()):
            raise too_long(self.path, f"unpacks to {unpacked:,} bytes", most)


def _is_text(kind: Any) -> bool:
    import pyarrow as pa

    is_kind = (
        pa.types.is_string,
        pa.types.is_large_string,
        pa.types.is_string_view,
        pa.types.is_binary,
        pa.types.is_large_binary,
        pa.types.is_binary_view,
    )
    return any(kind_is(kind) for kind_is in is_kind)


def _text_bytes(column: Any) -> int:
    """Bytes of a column of texts that are kept once, if each were kept by itself."""
    import pyarrow as pa
    import pyarrow.compute as compute

    if not (pa.types.is_dictionary(column.type) and _is_text(column.type.value_type)):
        return 0
    length = 0
    for chunk in column.chunks:
        each = compute.binary_length(chunk.dictionary).to_numpy(zero_copy_only=False)
        uses = chunk.indices.drop_null().to_numpy(zero_copy_only=False)
        length += int(np.bincount(uses, minlength=len(each)) @ np.nan_to_num(each))
    return length


def _heads(path: str) -> list[str]:
    parts = path.split(".")
    return [".".join(parts[: length + 1]) for length in range(len(parts))]


__all__ = ["ParquetColumns"]
