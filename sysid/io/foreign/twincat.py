"""TwinCAT Scope's text exports: a block of lines about each channel, then times and values.

In the line `Name` that word is over each column of times (ms), and the channels' names over the
values that were sampled at them; channels of one rate may share a column. Columns of channels with
fewer samples end earlier, filled with blanks or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sysid.errors import input_error
from sysid.io.bounds import check_rectangle
from sysid.io.foreign.table import Column, ForeignTable, ReadOptions
from sysid.io.foreign.text_layout import Layout, find_layout
from sysid.io.foreign.text_parsing import parsed, times_of

_NAME = "Name"
_STARTED = "Starttime of export"
_END = "EOF"


def is_format(lines: Sequence[str]) -> bool:
    """Whether the lines are those of such an export."""
    head = lines[:12]
    return (
        bool(head)
        and head[0].startswith(_NAME)
        and any(line.lstrip('"').startswith(_STARTED) for line in head)
        and any(line.startswith(head[0][:5]) for line in head[1:])
    )


def read(table: ForeignTable, lines: Sequence[str], options: ReadOptions) -> ForeignTable:
    """The channels with their units and times; the columns are numbered as in the file."""
    path, delimiter = table.path, options.delimiter or lines[0][len(_NAME) : len(_NAME) + 1]
    delimiter = {"tab": "\t", "semicolon": ";", "comma": ","}.get(delimiter, delimiter)
    if delimiter not in ("\t", ";", ",", "|", ":"):
        raise input_error(
            path,
            f"{delimiter!r} separates its columns, and words too",
            "export it from the Scope with tabs",
        )
    top = next(i for i, line in enumerate(lines) if i and line.startswith(_NAME + delimiter))
    names = _cells(lines[top], delimiter)
    index, about = top, dict[str, list[str]]()
    while index < len(lines) and lines[index].strip():
        cells = _cells(lines[index], delimiter)
        about[cells[0]] = cells
        index += 1
    rows = [
        (number, text)
        for number, text in enumerate(lines[index:], start=index + 1)
        if text.strip(delimiter + " \t")
    ]
    if rows and rows[-1][1].strip(delimiter + " \t") == _END:
        rows.pop()
    if not rows:
        raise input_error(path, "has a header but no rows", "give another file")
    found = find_layout(path, [t for _, t in rows], ReadOptions(delimiter, options.decimal))
    layout = Layout(delimiter, found.decimal, len(names))
    _check_rows(path, rows, layout)
    check_rectangle(path, len(rows), len(names))
    columns = parsed(path, [_without_blanks(text, delimiter) for _, text in rows], layout)
    table.format = "TwinCAT Scope"
    table.place = lambda row: f"line {rows[row][0]}"
    _take(table, names, columns, about, rows)
    return table


def _cells(line: str, delimiter: str) -> list[str]:
    cells = [cell.strip() for cell in line.split(delimiter)]
    return cells[:-1] if cells and not cells[-1] else cells


def _without_blanks(text: str, delimiter: str) -> str:
    """A row without the blanks that stand for cells of channels that have ended."""
    return delimiter.join(cell.strip() for cell in text.split(delimiter))


def _check_rows(path: Path, rows: list[tuple[int, str]], layout: Layout) -> None:
    for number, text in rows:
        cells = _cells(text, layout.delimiter)
        if len(cells) > layout.fields:
            raise input_error(
                f"{path}, line {number}",
                f"{len(cells)} fields under {layout.fields} names",
                "fix the line (two lines run together, a decimal comma?)",
            )


def _take(
    table: ForeignTable,
    names: list[str],
    columns: list[Column],
    about: dict[str, list[str]],
    rows: list[tuple[int, str]],
) -> None:
    """Columns by name: of two channels of one name, by their symbols; times by a channel's."""
    time = -1
    for index, (name, values) in enumerate(zip(names, columns, strict=True)):
        if index == 0 or name == _NAME:
            time = index
            first = names[index + 1] if index + 1 < len(names) else "no channel"
            called = f"Time of {first}"
            table.columns[called] = _own(table, first, values, values, rows)
            table.units[called] = "ms"
        else:
            symbol = about.get("SymbolName", [])
            called = name if names.count(name) == 1 else (symbol[index : index + 1] or [name])[0]
            called = called if called and called not in table.columns else f"#{index + 1}"
            table.columns[called] = _own(table, called, values, columns[time], rows)
            _take_unit(table, called, about.get("Unit", [])[index : index + 1])
        times = _own(table, called, columns[time], columns[time], rows)
        table.clocks[called] = times_of(table, times, f"the time of {called}") / 1e3  # from ms


def _take_unit(table: ForeignTable, name: str, cells: list[str]) -> None:
    """ "V (Voltage)" is V; "(None)" is none."""
    unit = cells[0].partition("(")[0].strip() if cells else ""
    if unit:
        table.units[name] = unit


def _own(
    table: ForeignTable, name: str, values: Column, times: Column, rows: list[tuple[int, str]]
) -> Column:
    """The samples of a column, which are the first rows. InputError where a time is missing."""
    empty = np.asarray([cell != cell for cell in times], dtype=bool)
    filled = np.flatnonzero(~empty)
    count = int(filled[-1]) + 1 if filled.size else 0
    if empty[:count].any():
        raise input_error(
            f"{table.path}, line {rows[int(np.flatnonzero(empty)[0])][0]}",
            f"the time of {name} is missing, but later rows have it",
            "complete the row or delete it",
        )
    late = np.asarray([cell == cell for cell in values[count:]], dtype=bool)
    if late.any():
        row = count + int(np.flatnonzero(late)[0])
        raise input_error(
            f"{table.path}, line {rows[row][0]}",
            f"{name} has a value but no time",
            "complete the row or delete it",
        )
    return values[:count]


__all__ = ["is_format", "read"]
