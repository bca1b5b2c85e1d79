"""MATLAB files of versions 4 to 7 (7.3 is HDF5: `sysid.io.foreign.hdf5`), by scipy."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.io.bounds import MOST_DEPTH, Cells
from sysid.io.file_kinds import read_as
from sysid.io.foreign.elements import gather_elements
from sysid.io.foreign.matlab_objects import only_objects, reason
from sysid.io.foreign.matlab_size import check_size
from sysid.io.foreign.table import ForeignTable, ReadOptions


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Variables by name; a struct's fields by dots (`rec.Y.pressure`), its elements by
    `rec(2)`, a cell's by `c{2}`, a matrix' signals by `name#2` (all from 1, as in MATLAB), a
    complex variable's parts by `name.real` and `name.imag`; elements of one number each are one
    column.

    Raises InputError where the file is damaged, or declares more cells than are read."""
    from scipy.io import loadmat

    with read_as(path, "a MATLAB file"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        objects = _check_size(path, file)
        file.seek(0)
        content = loadmat(file, struct_as_record=True)
    table = ForeignTable(path, "MATLAB")
    for name, value in content.items():
        # An object of MATLAB has no name here: scipy calls it None.
        if not name.startswith("__") and not (name == "None" and objects):
            _walk(table, name, value, 0)
    gather_elements(table)
    table.skipped |= {name: reason(name, kind, path) for name, kind in objects.items()}
    if objects and not table.columns:
        raise only_objects(path, objects)
    return table


def _check_size(path: Path, file: BinaryIO) -> dict[str, str]:
    """The objects of MATLAB among the variables; InputError beyond the bound of cells."""
    from scipy.io import whosmat
    from scipy.io.matlab import matfile_version

    version, _ = matfile_version(file)
    if version == 1:
        return check_size(path, file)
    if version == 0:
        cells = Cells(path)
        file.seek(0)
        for name, shape, _ in whosmat(file):
            cells.add(math.prod(map(int, shape)), f"variable {name}")
    return {}


def _walk(table: ForeignTable, name: str, value: Any, depth: int) -> None:
    from scipy.io.matlab import MatlabFunction, MatlabOpaque

    array = value.toarray() if hasattr(value, "toarray") else np.asarray(value)
    if isinstance(value, MatlabOpaque | MatlabFunction) or depth > MOST_DEPTH:
        table.skipped[name] = reason(name, _class_of(value), table.path)
    elif array.dtype.names:
        for index, element in enumerate(array.ravel(order="F")):
            which = f"({index + 1})" if array.size > 1 else ""
            for field in array.dtype.names:
                _walk(table, f"{name}{which}.{field}", element[field], depth + 1)
    elif array.dtype == object:
        for index, element in enumerate(array.ravel(order="F")):
            _walk(table, f"{name}{{{index + 1}}}", element, depth + 1)
    elif array.dtype.kind in "fiub":
        table.add(name, array)
    elif array.dtype.kind == "c":
        table.add(f"{name}.real", array.real)
        table.add(f"{name}.imag", array.imag)
        table.skip_complex(name)
    else:
        table.skipped[name] = "text" if array.dtype.kind in "US" else f"of type {array.dtype}"


def _class_of(value: Any) -> str:
    """The class of an object of MATLAB, "" where it is not known."""
    names = value.dtype.names or ()
    kind = value["s2"].ravel()[0] if "s2" in names and value.size else b""
    return kind.decode("latin-1") if isinstance(kind, bytes) else ""
