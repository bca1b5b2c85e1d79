"""Tables as they are described: a caption, columns with their units and kinds, cells of text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from sysid.blocks.numbers import MISSING, ascii_text, estimate_cells, number, si_cells
from sysid.estimation.linear import Estimate


class NotedCell(str):
    """A cell with a line in small beneath its text: an id, a key. Equal to its text alone.

    `plain` takes its place in a terminal and in `print`: the name or number that other commands
    and files have (the small line where it is not given).
    """

    __slots__ = ("plain", "small")
    plain: str
    small: str

    def __new__(cls, text: str, small: str = "", plain: str = "") -> NotedCell:
        """The text, what is written in small beneath it, and what stands for both."""
        cell = super().__new__(cls, text)
        cell.small = small
        cell.plain = plain or small or text
        return cell


def plain_text(cell: str) -> str:
    """A cell or a heading as terminals and `print` show it, in ASCII where it is ours."""
    return ascii_text(cell.plain if isinstance(cell, NotedCell) else cell)


@dataclass(frozen=True)
class TableColumn:
    """A column's name and unit, and what it holds: numbers, text, or a program's names ("code")."""

    name: str
    kind: Literal["number", "text", "code"] = "number"
    unit: str = ""

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


@dataclass(frozen=True)
class Table:
    """A table for reading; the first cell of each row is its header. `table` makes one.

    `grouped`: rows that begin alike belong together: on a page their first cell is a heading above
    them, and the second one their header. `across`: each row is read by itself, such as a number
    in several models: on a phone, which has no room for them, its cells are below one another.
    """

    caption: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    kind: Literal["table"] = "table"
    grouped: bool = False
    across: bool = False

    @property
    def headings(self) -> tuple[str, ...]:
        """The columns' names with their units."""
        return tuple(column.heading for column in self.columns)

    def without(self, *names: str) -> Table:
        """The table without those of the named columns in which no row has anything."""
        empty = {
            place
            for place, column in enumerate(self.columns)
            if column.name in names and all(row[place] in ("", MISSING) for row in self.rows)
        }
        kept = [place for place in range(len(self.columns)) if place not in empty]
        return replace(
            self,
            columns=tuple(self.columns[place] for place in kept),
            rows=tuple(tuple(row[place] for place in kept) for row in self.rows),
        )


@dataclass(frozen=True)
class ComparedCell:
    """Our figure above the other one and the factor between them; `level` tints the cell.

    -2 to 2: far below, below, near, above, far above.
    """

    ours: str
    other: str
    factor: str
    level: int = 0


@dataclass(frozen=True)
class ComparedTable:
    """A table of our figures and others; `groups` are names and widths above the columns."""

    caption: str
    heading: str
    groups: tuple[tuple[str, int], ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[ComparedCell, ...]], ...]
    id: str = ""
    kind: Literal["compared"] = "compared"

    def plain(self) -> Table:
        """The table as text: `ours / other (factor)`, with a column's group before its name."""
        of = [name for name, width in self.groups for _ in range(width)] or [""] * len(self.columns)
        names = (f"{a}, {b}" if a else b for a, b in zip(of, self.columns, strict=True))
        rows = [
            (label, *(f"{c.ours} / {c.other} {c.factor}".rstrip() for c in cells))
            for label, cells in self.rows
        ]
        return table(self.caption, (self.heading, *names), rows)


def table(
    caption: str,
    columns: Sequence[str | TableColumn],
    rows: Sequence[Sequence[str]],
    *,
    text: Sequence[int] = (),
    code: Sequence[int] = (),
    grouped: bool = False,
    across: bool = False,
) -> Table:
    """A table; columns given by name hold numbers except the first and those in `text` and `code`.

    `text` and `code` are places of columns, from 0; `grouped` and `across` as
    `Table` has them.
    """

    def column(place: int, name: str) -> TableColumn:
        if place in code:
            return TableColumn(name, "code")
        return TableColumn(name, "text" if place == 0 or place in text else "number")

    described = (c if isinstance(c, TableColumn) else column(i, c) for i, c in enumerate(columns))
    shown = tuple(tuple(row) for row in rows)
    return Table(caption, tuple(described), shown, grouped=grouped, across=across)


def cell(value: Any) -> str:
    """A plain value as text: numbers with four significant digits, None as a dash."""
    if value is None or isinstance(value, float):
        return number(value, 4)
    return str(value)


def record_table(caption: str, records: Sequence[Mapping[str, Any]]) -> Table:
    """Records as a table; a record that lacks a column has an empty cell there."""
    columns = tuple(dict.fromkeys(name for record in records for name in record))
    rows = [[cell(record[c]) if c in record else "" for c in columns] for record in records]
    return table(caption, columns, rows)


Reader = Literal["page", "print", "command"]
# What a reader sees of an estimate: on a page, in `print` and notebooks, from a command.
_SEEN: dict[Reader, tuple[str, ...]] = {
    "page": ("Parameter", "Value", "Std. error", "95 % interval", "Unit"),
    "print": ("parameter", "value", "std. error", "unit", "95 % interval"),
    "command": ("parameter", "value", "95 % interval", "unit"),
}


def estimate_table(
    caption: str,
    estimates: Mapping[str, Estimate],
    reader: Reader = "print",
    *,
    named: TableColumn | None = None,
    more: tuple[TableColumn, Sequence[str]] | None = None,
) -> Table:
    """One row per estimate: value, standard error, unit and 95 % interval.

    A command's are in SI, as the files have them, without the standard error. `named`: the
    first column, where the rows are no parameters; `more`: a last one with its cells.
    """
    first, *seen = _SEEN[reader]
    columns = [named or TableColumn(first, "text")]
    # A command's units are set as its numbers are.
    columns += [
        TableColumn(name, "text" if name in ("Unit", "unit") and reader != "command" else "number")
        for name in seen
    ]
    rows = []
    for name, estimate in estimates.items():
        value, std, interval, symbol = estimate_cells(estimate)
        if reader == "command":
            value, interval, symbol = si_cells(estimate)
        cells = {"value": value, "std. error": std, "95 % interval": interval, "unit": symbol}
        rows.append((name, *(cells[column.lower()] for column in seen)))
    if more is not None:
        columns.append(more[0])
        rows = [(*row, last) for row, last in zip(rows, more[1], strict=True)]
    return table(caption, columns, rows)


def estimate_row(estimate: Estimate) -> tuple[str, str, str, str]:
    """Value, standard error, 95 % interval and unit: readable on a page, in SI in a terminal."""
    value, std, interval, unit = estimate_cells(estimate)
    plain, between, symbol = si_cells(estimate)
    has_error = estimate.identified and not math.isnan(estimate.std)  # a choice has none
    error = f"{estimate.std:.2g}" if has_error else MISSING if estimate.identified else ""
    return (
        NotedCell(value, plain=plain),
        NotedCell(std, plain=error),
        NotedCell(interval, plain=between),
        NotedCell(unit, plain=symbol),
    )


def estimate_records(estimates: Mapping[str, Estimate], **labels: Any) -> list[dict[str, Any]]:
    """One record per estimate, after `labels`: value, std, limits `low` and `high`, unit."""
    return [
        {
            **labels,
            "parameter": name,
            "value": e.value,
            "std": e.std,
            "low": e.interval[0],
            "high": e.interval[1],
            "unit": e.unit,
            "reason": e.reason or "",
        }
        for name, e in estimates.items()
    ]


__all__ = [
    "ComparedCell",
    "ComparedTable",
    "NotedCell",
    "Table",
    "TableColumn",
    "cell",
    "estimate_records",
    "estimate_row",
    "estimate_table",
    "plain_text",
    "record_table",
    "table",
]
