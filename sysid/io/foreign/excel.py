"""Excel workbooks (.xlsx), by pandas and openpyxl."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.errors import input_error
from sysid.io.file_kinds import read_as
from sysid.io.foreign.heading import STAMP, find_header
from sysid.io.foreign.stated_units import are_units, state_units
from sysid.io.foreign.table import ForeignTable, ReadOptions, take_names
from sysid.io.foreign.text_layout import is_number
from sysid.io.foreign.workbook_size import check_size
from sysid.io.units import bare_name


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """One sheet: the one asked for, else the first that is not empty (with a notice)."""
    import pandas as pd

    sheets: dict[Any, Any] = {}
    with read_as(path, "an Excel workbook"), warnings.catch_warnings():
        check_size(path, file)
        warnings.simplefilter("ignore")  # openpyxl's, about styles and validation
        sheets = pd.read_excel(file, sheet_name=None, header=None, engine="openpyxl")
    name, frame = _pick(path, sheets, options.sheet)
    table = ForeignTable(path, "Excel")
    others = [s for s, f in sheets.items() if s != name and len(f)]
    if others and options.sheet is None:
        table.notices.append(
            f"{path}: sheet {name!r} was read; not read: {', '.join(map(repr, others))} (--sheet)"
        )
    frame = frame.iloc[options.skip_rows :].dropna(how="all").dropna(how="all", axis="columns")
    if frame.empty:
        raise input_error(path, f"sheet {name!r} holds no rows", "choose another with --sheet")
    if options.transpose:
        frame = _transposed(frame)
    rows = [["" if v is None or v != v else str(v) for v in row] for row in frame.values[:200]]
    above = _rows_above(rows, options.names)
    if above:
        plural = "row" if above == 1 else "rows"
        table.notices.append(f"{path}: {above} {plural} above the names passed over")
        frame, rows = frame.iloc[above:], rows[above:]
    names, _ = find_header(rows, options.header)
    under = [] if names is None else _rows_under(rows)
    units = next(filter(are_units, under), [])
    skipped = len(under)
    if skipped:
        what = "a row of units" if units and skipped == 1 else f"{skipped} rows of words"
        shown = "; ".join(cell for cell in units or under[0] if cell)
        table.notices.append(f"{path}: {what} under the names skipped ({shown[:60]})")
    body = frame.iloc[skipped + (names is not None) :]
    if body.empty:
        raise input_error(
            path, f"sheet {name!r} has a header but no rows", "choose another with --sheet"
        )
    numbers = [int(i) + 1 for i in body.index]
    across = "column" if options.transpose else "row"
    table.place = lambda row: f"sheet {name!r}, {across} {numbers[row]}"
    take_names(table, names, (_values(body[column]) for column in body.columns))
    state_units(table, names or (), units)
    return table


def _rows_above(rows: Sequence[Sequence[str]], asked: Sequence[str]) -> int:
    """How many rows are above the one that holds the names asked for, or else the most names.

    A title above the names, or one for several columns, leaves cells empty.
    """
    names = [name for name in asked if not name.startswith("#")]
    found = [
        sum(name in row or name in map(bare_name, row) for name in names) if names else 0
        for row in rows
    ]
    if any(found):
        return found.index(max(found))
    words = [rows[0], *_rows_under(rows)]
    filled = [0 if are_units(row) else sum(map(bool, row)) for row in words]
    return filled.index(max(filled))


def _rows_under(rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """The rows of words, units among them, between the names and the first row of numbers."""
    for count, row in enumerate(rows[1:]):
        if any(is_number(cell) or STAMP.search(cell) for cell in row):
            return list(rows[1 : count + 1])
    return []


def _transposed(frame: Any) -> Any:
    """Rows that are signals as columns."""
    import pandas as pd

    turned = frame.T.infer_objects()
    turned.index = pd.RangeIndex(len(turned))
    return turned


def _pick(path: Path, sheets: dict[Any, Any], wanted: str | None) -> tuple[str, Any]:
    if wanted is not None:
        if wanted not in sheets:
            raise input_error(
                path, f"has no sheet {wanted!r}", f"its sheets are {', '.join(map(repr, sheets))}"
            )
        return wanted, sheets[wanted]
    for name, frame in sheets.items():
        if len(frame):
            return str(name), frame
    raise input_error(path, "holds no rows in any sheet", "give another file")


def _values(series: Any) -> Any:
    """Numbers as floats, time stamps as such, and mixed columns as objects."""
    values = series.infer_objects().to_numpy()
    return values.astype(np.float64) if values.dtype.kind in "iub" else values
