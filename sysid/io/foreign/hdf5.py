"""MATLAB files of version 7.3, and other HDF5 files, by h5py."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from sysid.io.foreign.matlab import OBJECT_REASON
from sysid.io.foreign.table import ForeignTable, ReadOptions, damaged

_MAX_DEPTH = 12


def read(path: Path, raw: bytes, options: ReadOptions) -> ForeignTable:
    """Data sets by name, groups (structs) by dots; see `sysid.io.foreign.matlab.read`."""
    import h5py

    table = ForeignTable(path, "MATLAB 7.3" if raw.startswith(b"MATLAB 7.3") else "HDF5")
    try:
        with h5py.File(io.BytesIO(raw), "r") as file:
            for name in file:
                if not name.startswith("#"):  # #refs#, #subsystem#: MATLAB's internal data
                    _walk(table, file, name, "", file[name], 0)
    except Exception as error:  # h5py raises OSError, KeyError, RuntimeError, ValueError ...
        raise damaged(path, f"an HDF5 ({table.format}) file", error) from None
    return table


def _walk(table: ForeignTable, file: Any, name: str, parent: str, node: Any, depth: int) -> None:
    import h5py

    full = f"{parent}.{name}" if parent else name
    kind = node.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if depth > _MAX_DEPTH or "MATLAB_object_decode" in node.attrs:
        table.skipped[full] = OBJECT_REASON
    elif isinstance(node, h5py.Group):
        for child in node:
            _walk(table, file, child, full, node[child], depth + 1)
    elif node.attrs.get("MATLAB_empty", 0):
        table.skipped[full] = "empty"
    elif h5py.check_ref_dtype(node.dtype) is not None:
        # MATLAB's (n, m) is stored as (m, n): C order here is the order of its elements.
        for index, reference in enumerate(np.asarray(node[()]).ravel()):
            if kind == "cell":
                _walk(table, file, f"{name}{{{index + 1}}}", parent, file[reference], depth + 1)
            else:  # a field of an array of structs
                element = f"{parent}({index + 1})"
                _walk(table, file, name, element, file[reference], depth + 1)
    elif kind == "char" or node.dtype.kind not in "fiub":
        table.skipped[full] = "text" if kind == "char" else f"of type {node.dtype}"
    elif node.shape is None:
        table.skipped[full] = "empty"
    else:
        table.add(full, np.asarray(node[()]).T)
