"""numpy's files, `.npy` and `.npz`."""

from __future__ import annotations

import math
import os
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy

from sysid.io.bounds import Cells, check_columns
from sysid.io.file_kinds import NUMPY_HEAD, read_as
from sysid.io.foreign.table import ForeignTable, ReadOptions

_SUFFIX = ".npy"


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Arrays by their names in the `.npz`, `#1` in an `.npy`; a structured array's fields by dots,
    a matrix' signals as `name#1`, `name#2` (in an `.npy`: `#1`, `#2`).

    Raises InputError where the file is damaged, or declares more cells than are read.
    """
    table = ForeignTable(path, "numpy")
    cells = Cells(path)
    is_one = file.read(len(NUMPY_HEAD)) == NUMPY_HEAD
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    with read_as(path, "a numpy file"):
        if is_one:
            _take(table, cells, "", file, size)
            return table
        with zipfile.ZipFile(file) as archive:
            parts = archive.infolist()
            check_columns(path, len(parts))
            for part in parts:
                name = part.filename.removesuffix(_SUFFIX)
                if name == part.filename:
                    table.skipped[name] = "no array"
                    continue
                with archive.open(part) as packed:
                    _take(table, cells, name, packed, part.file_size)
    return table


def _take(table: ForeignTable, cells: Cells, name: str, file: Any, size: int) -> None:
    """An array: its shape first, its values if they are numbers and no more than are read."""
    version = npy.read_magic(file)
    head = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, by_columns, dtype = head(file)
    shown = name or "the array"
    if dtype.hasobject:
        table.skipped[shown] = "Python objects, which may run code: save plain arrays"
        return
    count = math.prod(shape)
    fields = len(dtype.names or ())
    check_columns(table.path, fields)
    cells.add(count * max(fields, 1) * math.prod(dtype.shape), f"array {shown}")
    if count * dtype.itemsize != size - file.tell():
        raise ValueError(f"{shown} of shape {shape} is not of {size - file.tell():,} bytes")
    values = np.frombuffer(file.read(count * dtype.itemsize), dtype=dtype.base)
    values = values.reshape((*shape, *dtype.shape), order="F" if by_columns else "C")
    if not dtype.names:
        _add(table, name, values)
    for field in dtype.names or ():
        _add(table, f"{name}.{field}" if name else field, values[field].squeeze())


def _add(table: ForeignTable, name: str, values: Any) -> None:
    if values.dtype.kind not in "fiubmMU":
        table.skipped[name or "the array"] = f"of type {values.dtype}"
    elif name or values.squeeze().ndim > 1:
        table.add(name, values)
    else:
        table.add("#1", values)


__all__ = ["read"]
