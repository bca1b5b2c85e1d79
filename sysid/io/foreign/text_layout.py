"""How the lines of a text are cut into cells: delimiter, decimal sign, number of columns."""

from __future__ import annotations

import csv
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sysid.errors import input_error
from sysid.io.bounds import MOST_COLUMNS, check_columns
from sysid.io.foreign.table import ReadOptions

BLANK = " "
COMMENTS = ("#", "%", "//")
_DELIMITER_NAMES = {
    "tab": "\t",
    "\\t": "\t",
    "comma": ",",
    "semicolon": ";",
    "space": BLANK,
    "blank": BLANK,
    "whitespace": BLANK,
    "bar": "|",
}
_SAID = {"\t": "tabs", ",": "commas", ";": "semicolons", BLANK: "blanks", "|": "bars"}
# The first of two equally good ones is used.
_CANDIDATES = (
    (";", "."),
    (";", ","),
    ("\t", "."),
    ("\t", ","),
    ("|", "."),
    (",", "."),
    (BLANK, "."),
    (BLANK, ","),
    (",", ","),  # cells in quotes
)
_WORDS = re.compile(r"\S+")


@dataclass(frozen=True)
class Layout:
    """How the lines are read; `fields` is the number of columns.

    `numeric` are the columns (from 0) whose cells are numbers, `blank` those in which most rows
    have none;
    `ends_empty`: each line ends with a delimiter that starts no column.
    """

    delimiter: str
    decimal: str
    fields: int
    thousands: str | None = None
    numeric: frozenset[int] = frozenset()
    blank: frozenset[int] = frozenset()
    ends_empty: bool = False

    @property
    def said(self) -> str:
        """For a table's format: "text, separated by tabs, decimal comma"."""
        comma = ", decimal comma" if self.decimal == "," else ""
        return f"text, separated by {_SAID.get(self.delimiter, self.delimiter)}{comma}"

    def cells(self, line: str) -> list[str]:
        """A line's cells, one after each delimiter, without blanks around them."""
        return cells_of(line, self.delimiter)

    def is_number(self, cell: str) -> bool:
        """Whether a cell is a number, its digits grouped or not."""
        if self.thousands:
            cell = ungrouped(cell, self.thousands, self.decimal)
        return is_number(cell, self.decimal)

    def fits(self, cells: Sequence[str]) -> bool:
        """Whether there is a cell for each column, and none more."""
        return len(cells) == self.fields or (len(cells) == self.fields + 1 and not cells[-1])


def cells_of(line: str, delimiter: str) -> list[str]:
    """A line cut at each delimiter (blanks: at each run of them)."""
    if delimiter == BLANK:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def is_number(text: str, decimal: str = ".") -> bool:
    """Whether a cell is a number under this decimal sign (NaN and inf are)."""
    if decimal == ",":
        if "." in text:
            return False
        text = text.replace(",", ".", 1)
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def ungrouped(text: str, thousands: str, decimal: str) -> str:
    """The number without the signs that group its digits by thousands (1.003.000 is 1003.000)."""
    group, sign = re.escape(thousands), re.escape(decimal)
    fraction = rf"({sign}\d+)" + ("" if thousands == decimal else "?")
    grouped = re.fullmatch(rf"([+-]?\d{{1,3}}(?:{group}\d{{3}})+){fraction}", text.strip())
    return text if grouped is None else grouped[1].replace(thousands, "") + (grouped[2] or "")


def check_line_lengths(path: Path, lines: Iterable[str], options: ReadOptions) -> None:
    """InputError at a line of more columns than are read, before it is cut into them."""
    signs = ",;|\t" + (options.delimiter or "")
    for line in lines:
        if len(line) > MOST_COLUMNS:
            words = itertools.islice(_WORDS.finditer(line), MOST_COLUMNS + 1)
            check_columns(path, max(sum(1 for _ in words), *(line.count(s) + 1 for s in signs)))


def find_layout(path: Path, lines: Sequence[str], options: ReadOptions) -> Layout:
    """The delimiter and decimal sign under which most cells of most lines are numbers.

    Where only another delimiter cuts out the names asked for, it is that one.
    """
    # Headings and preambles come first, so the last lines decide.
    late = lines[-max(40, len(lines) // 10) :]
    late = late[len(late) // 2 :] if len(late) == len(lines) else late
    late = late[:: max(1, len(late) // 100)]
    tried = [
        _scored(late, Layout(delimiter, decimal, 0, options.thousands))
        for delimiter, decimal in _candidates(path, options)
    ]
    found = [layout for _, layout in sorted(tried, key=lambda one: one[0], reverse=True)]
    asked = {name for name in options.names if not name.startswith("#")}
    heads = [line for line in lines if asked and all(name in line for name in asked)][:1]
    by_name = (one for one in found for line in heads if asked <= set(one.cells(line)))
    return next(by_name, found[0])


def _scored(lines: Sequence[str], layout: Layout) -> tuple[tuple[float, bool], Layout]:
    """How well a delimiter and a decimal sign fit, and the columns that they make."""
    rows = [layout.cells(line) for line in lines]
    width, votes = Counter(map(len, rows)).most_common(1)[0]
    numbers = [[layout.is_number(cell) for cell in row] for row in rows]
    filled = sum(1 for row in rows for cell in row if cell)
    share = sum(map(sum, numbers)) / max(1, filled)
    usual = [(row, is_n) for row, is_n in zip(rows, numbers, strict=True) if len(row) == width]
    # A damaged row may have a cell where all others have none.
    last = sum(bool(row[-1]) for row, _ in usual)
    ends_empty = width > 1 and last <= (len(usual) >= 20)
    fields = width - ends_empty
    # Of short tests, headings and rows of units may be as many lines as rows are.
    counted = [one for one in usual if any(one[1])]
    numeric = frozenset(
        column
        for column in range(fields)
        if 2 * sum(is_n[column] for _, is_n in counted)
        > sum(bool(row[column]) for row, _ in counted)
    )
    blank = frozenset(
        c for c in range(fields) if 2 * sum(bool(r[c]) for r, _ in usual) < len(usual)
    )
    found = replace(layout, fields=fields, numeric=numeric, blank=blank, ends_empty=ends_empty)
    return (round(votes / len(rows) * share, 2), fields > 1), found


def _candidates(path: Path, options: ReadOptions) -> list[tuple[str, str]]:
    decimals = [options.decimal] if options.decimal else [".", ","]
    if options.decimal not in (None, ".", ","):
        raise input_error(path, f"{options.decimal!r} is not a decimal sign", "give . or ,")
    if options.thousands not in (None, ".", ",", "'", " "):
        raise input_error(
            path, f"{options.thousands!r} does not group digits", "give one of . , ' or a blank"
        )
    if options.delimiter is None:
        return [c for c in _CANDIDATES if c[1] in decimals]
    delimiter = _DELIMITER_NAMES.get(options.delimiter, options.delimiter)
    if len(delimiter) != 1 or delimiter.isalnum() or delimiter in ".+-\"'\r\n":
        raise input_error(
            path,
            f"{options.delimiter!r} cannot separate columns",
            f"give one character, or {', '.join(k for k in _DELIMITER_NAMES if k.isalpha())}",
        )
    return [(delimiter, d) for d in decimals if d != delimiter or options.decimal]


__all__ = [
    "BLANK",
    "COMMENTS",
    "Layout",
    "cells_of",
    "check_line_lengths",
    "find_layout",
    "is_number",
    "ungrouped",
]
