"""The rows of a text's table, distinguished from other lines below its heading.

Loggers that append write their heading, a date or a banner again at each start; programs fill up
files with empty lines and close them with a word. Nothing is passed over without a notice.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path

import numpy as np

from sysid.errors import InputError, input_error
from sysid.io.alignment import has_own_rate
from sysid.io.foreign.heading import STAMP, Lines, TableHeading, is_comment
from sysid.io.foreign.text_layout import BLANK, Layout, is_number
from sysid.io.tables import looks_cut
from sysid.types import BoolArray, IntArray

_END = re.compile(
    r"\W*(?:eof|end(?:[ _](?:of[ _](?:file|data|record(?:ing)?|log)|data))?)\W*", re.I
)
# PuTTY's line at each start of a log that it appends to.
_BANNER = re.compile(r"(?:=~)+=? PuTTY log .*")
_SHOWN = 60
_BEGINS = "0123456789+-."
_WORD = re.compile(r"[^\W\d_]{2,}")
# Lines of a footer, each beginning with what its numbers are: the least, the largest, the mean.
LONGEST_FOOTER = 12


@dataclass
class TableRows:
    """The rows (line number, text), and which of them, after the first, begin a recording."""

    lines: list[tuple[int, str]] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)


def rows_below(path: Path, lines: Lines, heading: TableHeading) -> TableRows:
    """The table's rows from `heading.first` on. Raises InputError at another heading amid them."""
    return _Sorting(path, lines, heading).sorted()


@dataclass
class _Sorting:
    """The lines below a heading while they are sorted into rows and others."""

    path: Path
    lines: Lines
    heading: TableHeading
    rows: TableRows = field(default_factory=TableRows)
    comments: list[int] = field(default_factory=list)
    empty: list[int] = field(default_factory=list)
    passed: list[int] = field(default_factory=list)
    aside: list[int] = field(default_factory=list)
    is_new: bool = False

    def sorted(self) -> TableRows:
        layout, again = self.heading.layout, None
        if self.heading.line is not None:
            again = _heading_cells(self.lines[self.heading.line][1], layout)
        nothing = layout.delimiter + " \t\0"
        stamped = any(
            STAMP.search(text)
            for _, text in self.lines[self.heading.first :][:100]
            if layout.fits(layout.cells(text))
        )
        # With blanks as delimiters the first cell of a date is a number, too.
        numbered = layout.delimiter == BLANK or (again is not None and again[0][:1] in _BEGINS)
        begins = "" if numbered else _BEGINS
        above = set() if again is None else self._preambles(again, begins)
        for index in range(self.heading.first, len(self.lines)):
            text = self.lines[index][1]
            # Nearly all lines: a row whose first cell is a number.
            plain = text[0] in begins and not self.is_new
            if index in above:
                self.aside.append(index)
            elif plain and layout.is_number(text.split(layout.delimiter, 1)[0]):
                self._take(index, stamped)
            elif not text.strip(nothing):
                self.empty.append(index)
            elif again is not None and _heading_cells(text, layout) == again:
                self._start()
            elif is_comment(text):
                self.comments.append(index)
            elif self._is_row(text, stamped):
                self._take(index, stamped)
            else:
                self.aside.append(index)
        # What is below the last row is a footer.
        self.passed += self._head() + self._footer() + self.aside
        self._tell()
        return self.rows

    def _preambles(self, again: list[str], begins: str) -> set[int]:
        """The lines above each repeated heading that are those above the first, once more.

        They may resemble rows: "Serial;4711;2". Each begins as one of the first does, or has a
        date as the one in its place. No heading begins with one of `begins`.
        """
        lines, layout = self.lines, self.heading.layout
        top = self.heading.line or 0
        first = [_heading_cells(text, layout)[0] for _, text in lines[:top]]
        labels = {cell for cell in first if _WORD.search(cell)}
        found: set[int] = set()
        if not labels:
            return found
        for index in range(self.heading.first, len(lines)):
            text = lines[index][1]
            if text[0] in begins or again[0] not in text.casefold():
                continue
            if _heading_cells(text, layout) != again:
                continue
            for back in range(1, min(top, index - self.heading.first) + 1):
                other = lines[index - back][1]
                dated = STAMP.search(lines[top - back][1]) and STAMP.search(other)
                if _heading_cells(other, layout)[0] not in labels and not dated:
                    break
                found.add(index - back)
        return found

    def _head(self) -> list[int]:
        """Takes the first rows that begin with a word: settings between names and rows."""
        count = self._labelled(self.rows.lines)
        if count and self.rows.starts and self.rows.starts[0] <= count:
            return []
        self.rows.starts = [start - count for start in self.rows.starts]
        return self._taken(slice(0, count))

    def _footer(self) -> list[int]:
        """Takes the last rows that begin with a word where all others have a number."""
        rows = self.rows.lines
        count = self._labelled(rows[: -LONGEST_FOOTER - 2 : -1])
        return self._taken(slice(len(rows) - count, len(rows)))

    def _taken(self, which: slice) -> list[int]:
        """Takes these rows away; the indices of their lines, which are in order of number."""
        numbers = [number for number, _ in self.rows.lines[which]]
        del self.rows.lines[which]
        return [bisect.bisect_left(self.lines, n, key=itemgetter(0)) for n in numbers]

    def _labelled(self, rows: Sequence[tuple[int, str]]) -> int:
        """How many of the first of these rows begin with a word, and the next with a number."""
        layout = self.heading.layout
        if 0 not in layout.numeric or layout.delimiter == BLANK:
            return 0
        for count, (_, text) in enumerate(rows[: LONGEST_FOOTER + 1]):
            cell = layout.cells(text)[0]
            if not is_footer(cell):
                return count if layout.is_number(cell) else 0
        return 0

    def _start(self) -> None:
        """The heading once more: the lines set aside belong to the start."""
        self.passed += self.aside
        self.aside = []
        self.is_new = True

    def _take(self, index: int, stamped: bool) -> None:
        """A row; lines set aside are not part of a table that continues."""
        for other in self.aside:
            self._pass_amid(other, stamped)
        self.aside = []
        if self.is_new and self.rows.lines:
            self.rows.starts.append(len(self.rows.lines))
        self.is_new = False
        self.rows.lines.append(self.lines[index])

    def _pass_amid(self, index: int, stamped: bool) -> None:
        number, text = self.lines[index]
        layout = self.heading.layout
        if _BANNER.fullmatch(text.strip()) or (not stamped and STAMP.search(text)):
            self.is_new = True
        elif not self.is_new and layout.fits(layout.cells(text)):
            raise input_error(
                f"{self.path}, line {number}",
                f"words amid the rows ({text.strip()[:_SHOWN]!r}): another heading, or a damaged "
                "row",
                "delete the line if its columns are those above; else split the file there",
            )
        self.passed.append(index)

    def _is_row(self, text: str, stamped: bool) -> bool:
        """Whether a line belongs to the table, be it whole or damaged."""
        layout = self.heading.layout
        cells = layout.cells(text)
        is_date = not stamped and STAMP.search(text) is not None and not layout.fits(cells)
        if not layout.numeric or (layout.is_number(cells[0]) and not is_date):
            return True
        if _BANNER.fullmatch(text.strip()) or _END.fullmatch(text.strip(layout.delimiter + " \t")):
            return False
        if layout.fits(cells):
            filled = [cells[i] for i in layout.numeric if i < len(cells) and cells[i]]
            return not filled or any(map(layout.is_number, filled))
        return not is_date and any(map(layout.is_number, cells))

    def _tell(self) -> None:
        for indices, what in (
            (self.comments, "a comment"),
            (self.empty, "without values"),
            (self.passed, "none of the table's rows"),
        ):
            if indices:
                number, text = self.lines[indices[0]]
                more = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
                shown = f" ({text.strip()[:_SHOWN]})" if what != "without values" else ""
                self.rows.notices.append(
                    f"{self.path}: line {number}{more} passed over, {what}{shown}"
                )


def is_footer(cell: str) -> bool:
    """Whether a row's first cell, where others have a number, says what its numbers are: "Mean"."""
    return (
        _WORD.search(cell) is not None and not is_number(cell) and not any(map(str.isdigit, cell))
    )


def _heading_cells(text: str, layout: Layout) -> list[str]:
    """The cells of a line without their capitals, and without those at its end that are empty."""
    cells = layout.cells(text.strip(" ").casefold())
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _widths(rows: Sequence[tuple[int, str]], layout: Layout) -> tuple[IntArray, BoolArray]:
    """The number of cells (n,) of each row, and whether its last is empty.

    Where all lines end with a delimiter, what follows it is no cell.
    """
    sign = layout.delimiter
    if sign == BLANK:
        counts = [len(text.split()) for _, text in rows]
        return np.array(counts, dtype=np.intp), np.zeros(len(rows), dtype=bool)
    counts = [
        text.count(sign) + 1 if '"' not in text else len(layout.cells(text)) for _, text in rows
    ]
    ends = np.array([text.rstrip(" ").endswith(sign) for _, text in rows], dtype=bool)
    return np.array(counts, dtype=np.intp) - (ends & layout.ends_empty), ends


def check_widths(path: Path, rows: Sequence[tuple[int, str]], layout: Layout, whole: bool) -> None:
    """InputError at a row of too many cells, or of too few where rows are not cut at their end.

    Programs that write no delimiters after a row's last value omit those of slower columns,
    and of remarks; a row that lacks any other cell is damaged, for its values may have moved.
    `whole`: the text ends with a line end.
    """
    cells, ends = _widths(rows, layout)
    surplus = np.flatnonzero(cells > layout.fields)
    if surplus.size:
        row = int(surplus[0])
        raise input_error(
            f"{path}, line {rows[row][0]}",
            f"{cells[row]} fields where the other lines have {layout.fields}",
            "fix the line (two lines run together, a decimal comma?)",
        )
    short = np.flatnonzero(cells < layout.fields)
    if short.size == 0:
        return
    # Between blanks a cell that is missing leaves no trace.
    drops_ends = layout.delimiter != BLANK and not layout.ends_empty
    drops_ends = drops_ends and not np.any(ends & (cells == layout.fields))
    is_cut = not whole and np.count_nonzero(cells == cells[-1]) == 1
    drops_ends = drops_ends and not is_cut
    if not drops_ends or not _may_lack(rows, layout, cells):
        raise row_ends_early(path, rows, int(short[0]), layout)


def _may_lack(rows: Sequence[tuple[int, str]], layout: Layout, counts: IntArray) -> bool:
    """Whether each column that short rows lack is one that need not be filled in every row."""
    order = np.arange(len(rows), dtype=float)
    for column in range(int(np.min(counts)), layout.fields):
        filled = np.flatnonzero(counts > column)
        is_remark = bool(filled.size) and not any(
            layout.is_number(layout.cells(rows[row][1])[column]) for row in filled[:100].tolist()
        )
        if not is_remark and not has_own_rate(filled, order, held=False):
            return False
    return True


def row_ends_early(
    path: Path, rows: Sequence[tuple[int, str]], row: int, layout: Layout
) -> InputError:
    """The error for a row of fewer cells than there are columns."""
    fields = int(_widths([rows[row]], layout)[0][0])
    fix = "complete the row, or give the number of lines above the table with skip_rows"
    if row == len(rows) - 1:
        fix = "delete this last line: the recording was cut off there"
    elif layout.delimiter == BLANK:
        fix += " (between blanks an empty cell leaves no trace: export it with tabs or commas)"
    return input_error(
        f"{path}, line {rows[row][0]}",
        f"the row ends early: {fields} of {layout.fields} fields",
        fix,
    )


def reject_cut_off(path: Path, body: Sequence[tuple[int, str]], layout: Layout) -> None:
    """InputError at a last line that is cut off within its last number, which would be wrong."""
    if len(body) < 20:
        return
    late = [layout.cells(line) for _, line in body[-200:]]
    last = [cells[-1] for cells in late if len(cells) == len(late[-1])]
    if len(last) > 1 and looks_cut(last, layout.decimal):
        raise input_error(
            f"{path}, line {body[-1][0]}",
            "the last line has no line end and its last number is shorter than all before it: "
            "it looks cut off",
            "delete the line, or end it with a line break if it is whole",
        )


__all__ = [
    "LONGEST_FOOTER",
    "TableRows",
    "check_widths",
    "is_footer",
    "reject_cut_off",
    "row_ends_early",
    "rows_below",
]
