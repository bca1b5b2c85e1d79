"""Rows of text into columns, by pandas."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import input_error
from sysid.io.foreign.table import Column, ForeignTable
from sysid.io.foreign.text_layout import BLANK, Layout, is_number, ungrouped
from sysid.types import FloatArray

# What programs write in cells without a value.
_DASHES = ("-", "--", "---", "----")
# What instruments send where they have no number, and beyond their range (SCPI-99, 7.2.1.4).
_NO_NUMBER, _OVERFLOW = 9.91e37, 9.9e37


def parsed(path: Path, lines: Sequence[str], layout: Layout) -> list[Column]:
    """The columns of rows of text: numbers as the nearest doubles, or text; NaN for no cell."""
    import pandas as pd

    try:
        frame = pd.read_csv(
            io.StringIO("\n".join([_filled_up(lines[0], layout), *lines[1:]])),
            sep=r"\s+" if layout.delimiter == BLANK else layout.delimiter,
            decimal=layout.decimal,
            header=None,
            names=range(layout.fields),
            usecols=range(layout.fields),
            index_col=False,
            skipinitialspace=True,
            **_exact(pd.__version__),
            na_values=_DASHES,
            low_memory=False,
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        reason = str(error).splitlines()[0][:120]
        raise input_error(
            path, f"cannot be read as text ({reason})", "give --delimiter, or fix the file"
        ) from None
    return [tidied(frame[i].to_numpy(copy=True), layout) for i in frame.columns]


def times_of(table: ForeignTable, cells: Column, name: str) -> FloatArray:
    """A column of times (n,), NaN for no cell. InputError at a cell that is no number."""
    if cells.dtype.kind in "fiu":
        return np.asarray(cells, dtype=np.float64)
    for row, cell in enumerate(cells):
        if isinstance(cell, str) and not is_number(cell):
            raise input_error(
                f"{table.path}, {table.place(row)}",
                f"{name} holds {cell[:40]!r}, not a number",
                "fix the cell",
            )
    return np.array([float(cell) for cell in cells])


def _filled_up(line: str, layout: Layout) -> str:
    """The first row with a cell for each column: pandas takes their number from it."""
    missing = layout.fields - len(layout.cells(line))
    return line + layout.delimiter * missing if layout.delimiter != BLANK else line


def _exact(version: str) -> dict[str, Any]:
    """What makes pandas read a decimal as the nearest double; from 3.1 on it always does."""
    major, minor = (int(part) for part in version.split(".")[:2])
    return {} if (major, minor) >= (3, 1) else {"float_precision": "round_trip"}


def tidied(values: Column, layout: Layout) -> Column:
    """Cells that pandas left as text, with what is a number written as Python writes it."""
    if values.dtype.kind == "f":
        values[values == _NO_NUMBER] = np.nan
        values[np.abs(values) == _OVERFLOW] = np.inf
    if values.dtype != object or (layout.thousands is None and layout.decimal == "."):
        return values
    tidy = values.copy()
    for row, cell in enumerate(values):
        if isinstance(cell, str):
            text = cell
            if layout.thousands:
                text = ungrouped(text, layout.thousands, layout.decimal)
            if is_number(text, layout.decimal):
                tidy[row] = text.replace(layout.decimal, ".")
    return tidy


__all__ = ["parsed", "tidied", "times_of"]
