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
from sysid.io.foreign.table_rows import LONGEST_FOOTER, is_footer
from sysid.io.foreign.text_layout import Layout, is_number
from sysid.io.foreign.text_parsing import tidied
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
    preamble = rows[:above]
    if above:
        plural = "row" if above == 1 else "rows"
        table.notices.append(f"{path}: {above} {plural} above the names passed over")
        frame, rows = frame.iloc[above:], rows[above:]
    asked = any(name in rows[0] or name in map(bare_name, rows[0]) for name in options.names)
    names, _ = find_header(
        rows, True if asked and options.header is None else options.header, options.decimal or "."
    )
    under = [] if names is None else _rows_under(rows, options.decimal or ".")
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
    if names is not None and not options.transpose:
        body = _table_rows(table, body, names, [row[0] for row in preamble], under)
    numbers = [int(i) + 1 for i in body.index]
    across = "column" if options.transpose else "row"
    table.place = lambda row: f"sheet {name!r}, {across} {numbers[row]}"
    # Numbers that a sheet holds as text are written as in a file of text.
    layout = Layout("", options.decimal or ".", len(body.columns), options.thousands)
    take_names(table, names, (_values(body[column], layout) for column in body.columns))
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


def _rows_under(rows: Sequence[Sequence[str]], decimal: str = ".") -> list[Sequence[str]]:
    """The rows of words, units among them, between the names and the first row of numbers."""
    for count, row in enumerate(rows[1:]):
        if any(is_number(cell, decimal) or STAMP.search(cell) for cell in row):
            return list(rows[1 : count + 1])
    return []


def _table_rows(
    table: ForeignTable,
    body: Any,
    names: Sequence[str],
    labels: Sequence[str],
    under: Sequence[Sequence[str]],
) -> Any:
    """The rows of a sheet, distinguished from a repeated heading, with what stands above and below
    it, and from a footer; `labels` begin the rows above the names, `under` are those below them.

    A repeated heading begins a recording.
    """
    place = next((i for i, name in enumerate(names) if name), None)
    if place is None or body.iloc[:, place].dtype != object:
        return body
    cells = [_text(value) for value in body.iloc[:, place]]
    first = [_text(value) for value in body.iloc[:, 0]]
    whole, above = [_text(name) for name in names], {_text(label) for label in labels}
    below = [[_text(word) for word in words] for words in under]
    other, starts = set[int](), []
    for row in (i for i, cell in enumerate(cells) if cell == whole[place]):
        if [_text(value) for value in body.iloc[row]] != whole:
            continue
        starts.append(row)
        other.add(row)
        at = row - 1
        while at >= 0 and first[at] and first[at] in above:
            other.add(at)
            at -= 1
        for count, words in enumerate(below, start=row + 1):
            if count < len(cells) and [_text(v) for v in body.iloc[count]] == words:
                other.add(count)
    most = min(len(cells) - 2, LONGEST_FOOTER)
    end = next((i for i in range(most) if not is_footer(first[-1 - i])), most)
    if end and is_number(first[-1 - end]):
        other |= set(range(len(cells) - end, len(cells)))
    if not other:
        return body
    at = min(other)
    more = f" and {len(other) - 1} more" if len(other) > 1 else ""
    shown = "; ".join(str(value) for value in body.iloc[at] if value == value)[:60]
    table.notices.append(
        f"{table.path}: row {int(body.index[at]) + 1}{more} passed over, none of the table's rows "
        f"({shown})"
    )
    kept = [row for row in range(len(cells)) if row not in other]
    begins = {next((i for i, row in enumerate(kept) if row > start), 0) for start in starts}
    table.starts = tuple(sorted(begins - {0}))
    return body.iloc[kept]


def _text(value: Any) -> str:
    """A cell's text for comparison, "" of an empty one."""
    return "" if value is None or value != value else str(value).strip().casefold()


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


def _values(series: Any, layout: Layout) -> Any:
    """Numbers as floats, time stamps as such, and mixed columns as objects."""
    values = series.infer_objects().to_numpy()
    if values.dtype == object:
        return tidied(values, layout)
    return values.astype(np.float64) if values.dtype.kind in "iub" else values
