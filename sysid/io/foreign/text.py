"""Text files: delimiter, decimal sign and heading are detected, or given."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from sysid.errors import InputError, input_error, shortened
from sysid.io.bounds import check_rectangle, check_text
from sysid.io.file_kinds import HEAD_BYTES, wide_encoding
from sysid.io.foreign import lvm, twincat
from sysid.io.foreign.heading import Lines, TableHeading, find_heading, is_comment
from sysid.io.foreign.stated_units import state_units
from sysid.io.foreign.table import ForeignTable, ReadOptions, SampleTimes, take_names
from sysid.io.foreign.table_rows import (
    check_widths,
    reject_cut_off,
    row_ends_early,
    rows_below,
)
from sysid.io.foreign.text_layout import (
    BLANK,
    COMMENTS,
    Layout,
    check_line_lengths,
    find_layout,
    is_number,
)
from sysid.io.foreign.text_parsing import parsed
from sysid.io.units import bare_name

# A sign apart from its number at the start of a cell; Fortran's D; blanks that do not break a line.
_APART = re.compile(r"(?m)(?:^|(?<=[,;\t]))[ ]*([+-]) +(?=[\d.])")
_D_EXPONENT = re.compile(r"(?<=\d)[dD](?=[+-]\d\d(?!\d))")
_EDGES = re.compile(r"(?m)(?:^|(?<=[,;|\t ]))[\u00a0\u202f]+|[\u00a0\u202f]+(?=[,;|\t ]|$)")
# The end of a text shows how all its numbers are written.
_SAMPLE = 20_000
# A quote that opens a cell and is not closed; the lines in which a heading stands, and those that a
# cell of it may have.
_OPENED = re.compile(r"""(?:^|[,;\t|])\s*"[^"]*$""")
_HEADING_LINES, _CELL_LINES = 100, 10
_MONITOR = re.compile(r"\d{1,2}:\d{2}:\d{2}\.\d{3} -> ")


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """A table of text, behind whatever preamble; `options` overrides what is detected.

    LabVIEW's measurement files and TwinCAT Scope's exports have readers of their own.
    """
    table = ForeignTable(path, "text")
    check_text(path, file)
    text = _plain_digits(_decoded(table, file.read()), options)
    lines = _whole_cells(_without_monitor(table, text.splitlines()))
    as_it_is = options.skip_rows == 0 and not options.transpose and options.header is not False
    check_line_lengths(path, lines, options)
    if as_it_is and lvm.is_format(lines):
        return lvm.read(table, lines, text.endswith(("\n", "\r")), options)
    if as_it_is and twincat.is_format(lines):
        return twincat.read(table, lines, options)
    numbered = [
        (number, line)
        for number, line in enumerate(lines, start=1)
        if number > options.skip_rows and line.strip()
    ]
    if options.transpose:
        return _read_transposed(table, numbered, options)
    return _read_lines(table, numbered, text.endswith(("\n", "\r")), options)


def _read_lines(
    table: ForeignTable, lines: Lines, whole: bool, options: ReadOptions
) -> ForeignTable:
    """The table in numbered lines that are not blank; `whole`: the last one is complete."""
    path = table.path
    plain = [line for _, line in lines if not is_comment(line) and line.strip(",;|\t ")]
    if not plain:
        raise input_error(path, "holds no rows", "give another file (or fewer skip_rows)")
    layout = find_layout(path, plain, options)
    heading = find_heading(path, lines, layout, options)
    layout = heading.layout
    table.format = layout.said
    if heading.first >= len(lines):
        raise input_error(path, "has a header but no rows", "give another file")
    rows = rows_below(path, lines, heading)
    body = rows.lines
    _tell_heading(table, lines, heading, options)
    table.notices += rows.notices
    table.starts = tuple(rows.starts)
    check_widths(path, body, layout, whole)
    if not whole:
        reject_cut_off(path, body, layout)
    table.place = lambda row: f"line {body[row][0]}"
    table.explain_gap = lambda row: _short_row(path, body, row, layout)
    check_rectangle(path, len(body), layout.fields)
    names = _names(heading, options)
    take_names(table, names, parsed(path, [line for _, line in body], layout))
    state_units(table, names or (), heading.units or heading.under)
    _take_sampling(table, heading)
    return table


def _decoded(table: ForeignTable, raw: bytes) -> str:
    """The text of a file's bytes, without the zeros that a program filled the file up with."""
    text = _text_of(table, raw)
    end = text[len(text.rstrip("\0 \t\r\n")) :]
    if "\0" not in end:
        return text
    table.notices.append(f"{table.path}: {end.count(chr(0))} zero bytes at its end passed over")
    return text[: len(text) - len(end) + end.index("\0")]


def _without_monitor(table: ForeignTable, lines: list[str]) -> list[str]:
    """Lines without the time of day that Arduino's serial monitor puts before each."""
    head = [line for line in lines[:20] if line.strip()]
    times = sum(_MONITOR.match(line) is not None for line in head)
    if not head or 4 * times < 3 * len(head):  # a line may be damaged
        return lines
    table.notices.append(f"{table.path}: the serial monitor's times before -> passed over")
    return [_MONITOR.sub("", line) for line in lines]


def _whole_cells(lines: list[str]) -> list[str]:
    """Lines in which a quoted cell of the heading, of several lines, is in one; the others of it
    are left empty, so that all lines keep their numbers."""
    for index, line in enumerate(lines[:_HEADING_LINES]):
        if line.count('"') % 2 == 0 or not _OPENED.search(line):
            continue
        for end in range(index + 1, min(index + _CELL_LINES, len(lines))):
            if '"' in lines[end]:
                break
        else:
            continue
        whole = " ".join(lines[index : end + 1])
        while whole.count('"') % 2 and end + 1 < min(index + _CELL_LINES, len(lines)):
            end += 1
            whole = f"{whole} {lines[end]}"
        if whole.count('"') % 2 == 0:
            lines[index : end + 1] = [whole] + [""] * (end - index)
    return lines


def _plain_digits(text: str, options: ReadOptions) -> str:
    """Numbers with the signs of the keyboard: a minus, and what groups digits by thousands.

    Fortran's exponents become E, a blank between a sign and its number is dropped; so are blanks
    that do not break a line around cells, and marks of the byte order where files were joined.
    """
    if _D_EXPONENT.search(text, len(text) - _SAMPLE):
        text = _D_EXPONENT.sub("E", text)
    if _APART.search(text, len(text) - _SAMPLE):
        text = _APART.sub(r"\1", text)
    if text.isascii():
        return text
    text = _EDGES.sub(" ", text.replace("\ufeff", ""))
    text = re.sub(r"\u2212(?=[\d.,])", "-", text)
    if options.thousands == " ":
        return re.sub(r"(?<=\d)[\u00a0\u202f\u2009](?=\d)", " ", text)
    return re.sub(r"(?<=\d)\u2019(?=\d)", "'", text) if options.thousands == "'" else text


def _text_of(table: ForeignTable, raw: bytes) -> str:
    for encoding in (wide_encoding(raw[:HEAD_BYTES]) or "utf-8-sig", "cp1252"):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if encoding == "cp1252":
            table.notices.append(f"{table.path}: not UTF-8; read as Windows-1252")
        return text
    raise input_error(table.path, "is text of an unknown encoding", "save it as UTF-8")


def _tell_heading(
    table: ForeignTable, lines: Lines, heading: TableHeading, options: ReadOptions
) -> None:
    """Notices of the lines above the table and of those between its names and its rows."""
    path, top = table.path, heading.first if heading.line is None else heading.line
    above = [number for number, text in lines[:top] if not is_comment(text)]
    if above:
        where = f"line {lines[top][0]}"
        table.notices.append(
            f"{path}: the table begins in {where}; what is above was passed over "
            f"(--skip-rows {lines[top][0] - 1})"
        )
    if heading.under:
        table.notices.append(
            f"{path}: the row under the names was skipped "
            f"({'; '.join(heading.under[:8]).rstrip('; ')})"
        )
    if heading.passed:
        number, text = lines[heading.passed[0]]
        more = f" and {len(heading.passed) - 1} more" if len(heading.passed) > 1 else ""
        table.notices.append(
            f"{path}: line {number}{more} passed over, none of the table's rows "
            f"({text.strip()[:60]})"
        )


def _read_transposed(table: ForeignTable, lines: Lines, options: ReadOptions) -> ForeignTable:
    """A text whose lines are signals: the name, perhaps a unit, and the values."""
    plain = [line for _, line in lines if not is_comment(line)]
    if not plain:
        raise input_error(table.path, "holds no rows", "give another file")
    layout = find_layout(table.path, plain, options)
    signals = [layout.cells(line) for line in plain]
    if options.header is not False:
        heads = sum(not layout.is_number(cells[0]) for cells in signals)
        second = [cells[1] for cells in signals if len(cells) > 1]
        stated = heads == len(signals) and not any(map(layout.is_number, second))
    else:
        heads, stated = 0, False
    if heads not in (0, len(signals)):
        wrong = next(i for i, cells in enumerate(signals) if layout.is_number(cells[0]))
        raise input_error(
            f"{table.path}, {shortened(plain[wrong])}",
            "the line has no name, but others have",
            "write it, or give --no-header where the first cells are values",
        )
    return _of_signals(table, signals, layout, bool(heads), stated)


def _of_signals(
    table: ForeignTable, signals: list[list[str]], layout: Layout, named: bool, stated: bool
) -> ForeignTable:
    """The table of signals (cells of each line), with names and units in their first cells."""
    first = named + stated
    longest = max(map(len, signals))
    ends_empty = all(not cells[-1] for cells in signals if len(cells) == longest)
    count = longest - first - ends_empty
    check_rectangle(table.path, count, len(signals))
    values = [[*cells[first : first + count], *[""] * count][:count] for cells in signals]
    sheet = io.StringIO()
    sign = ";" if layout.delimiter == BLANK else layout.delimiter
    csv.writer(sheet, delimiter=sign, lineterminator="\n").writerows(zip(*values, strict=True))
    turned = replace(layout, delimiter=sign, fields=len(signals))
    names = [cells[0] for cells in signals] if named else None
    columns = parsed(table.path, sheet.getvalue().splitlines(), turned)
    if any(len(column) != count for column in columns):
        raise input_error(table.path, "holds values that are empty in every line", "fix the file")
    take_names(table, names, columns)
    table.format = f"{layout.said}, transposed"
    table.place = lambda row: f"value {row + 1} of the line"
    units = [cells[1] if stated else "" for cells in signals]
    state_units(table, names or (), units)
    return table


def _names(heading: TableHeading, options: ReadOptions) -> list[str] | None:
    """The columns' names: those asked for may also be cells of the lines around the heading."""
    if heading.names is None:
        return None
    names = list(heading.names)
    for wanted in options.names:
        if wanted.startswith(COMMENTS) and wanted.lstrip("#%/ ") == names[0] and names[0]:
            names[0] = wanted
        if wanted in names or wanted in map(bare_name, names):
            continue
        for cells in (heading.under, heading.above):
            places = [i for i, cell in enumerate(cells[: len(names)]) if cell == wanted]
            if len(places) == 1:
                names[places[0]] = wanted
                break
    return names


def _take_sampling(table: ForeignTable, heading: TableHeading) -> None:
    """A scope's period and first instant, which stand as numbers in the row of units."""
    names = [name.strip().lower() for name in (*(heading.names or ()), *heading.beyond)]
    stated = {
        name: float(cell)
        for name, cell in zip(names, heading.under, strict=False)
        if name in ("start", "increment") and is_number(cell)
    }
    if len(stated) == 2 and stated["increment"] > 0.0:
        base = SampleTimes(stated["increment"], stated["start"])
        table.sampling.update(dict.fromkeys(table.columns, base))


def _short_row(
    path: Path, body: list[tuple[int, str]], row: int, layout: Layout
) -> InputError | None:
    if len(layout.cells(body[row][1])) >= layout.fields + layout.ends_empty:
        return None
    return row_ends_early(path, body, row, layout)
