"""Where the table of a text begins: its heading, behind whatever a program writes above it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sysid.errors import InputError, input_error, shortened
from sysid.io.foreign.stated_units import are_units
from sysid.io.foreign.table import ReadOptions
from sysid.io.foreign.text_layout import BLANK, COMMENTS, Layout, is_number
from sysid.io.units import CANONICAL_UNITS, bare_name

# Lines, each with its number in the file.
Lines = Sequence[tuple[int, str]]

STAMP = re.compile(r"\d{1,2}:\d{2}|\b\d{4}-\d{2}-\d{2}\b|\b\d{1,2}[./]\d{1,2}[./]\d{2,4}\b")
_COMMENT_COLUMN = re.compile(r"(?i)comments?|remarks?|notes?|kommentar|bemerkung")
_SETTING = re.compile(r"\w+ *= *[+-]?[\d.]+(?:[eE][+-]?\d+)?\w*")
_WORD = re.compile(r"[^\W\d_]{2,}")


# Lines around a heading among which a scope's settings stand.
_PREAMBLE = 40


@dataclass
class TableHeading:
    """The names (None: the file has none), the line that holds them, and the first row's index.

    `under` are the cells of the row under the names that is none of the table's, `units` those of
    the row of units, which may be another; `above` further cells that may name columns, of the
    line above; `beyond` names of settings, whose values are in `under` and in none of the rows;
    `passed` the other lines between names and rows.
    """

    names: list[str] | None
    line: int | None
    first: int
    layout: Layout
    under: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    above: list[str] = field(default_factory=list)
    beyond: list[str] = field(default_factory=list)
    passed: list[int] = field(default_factory=list)


def is_comment(text: str) -> bool:
    """Whether a line is a comment."""
    return text.lstrip().startswith(COMMENTS)


def find_heading(path: Path, lines: Lines, layout: Layout, options: ReadOptions) -> TableHeading:
    """The heading above the first rows of a text; `lines` are those that are not blank.

    It is the line that holds the names asked for, else the one above the rows whose number of
    cells has settled. Raises InputError where neither says which line it is.
    """
    search = _HeadingSearch(path, lines, layout, options)
    first = search.first_row()
    if options.header is False:
        return TableHeading(None, None, first, layout)
    by_name = search.by_name(first)
    if by_name is None:
        search.check_rows_are_no_signals()
    by_place = by_name if by_name is not None else search.by_place(first)
    if by_place is None and options.header and search.width_of(first):
        by_place = search.heading(first)
    if by_place is None:
        return TableHeading(None, None, first, layout)
    return search.below(by_place, first)


@dataclass
class _HeadingSearch:
    """The search for one file's heading."""

    path: Path
    lines: Lines
    layout: Layout
    options: ReadOptions

    def cells(self, index: int) -> list[str]:
        """A line's cells, those of a heading that is a comment too."""
        text = self.lines[index][1]
        if is_comment(text):
            text = text.lstrip().lstrip("#%/")
            text = text.lstrip(" ") if self.layout.delimiter != "\t" else text
        cells = self.layout.cells(text)
        if self.layout.delimiter == BLANK and len(cells) > self.layout.fields:
            return _with_units(cells)
        return cells

    def has_numbers(self, cells: Sequence[str]) -> bool:
        return any(map(self.layout.is_number, cells))

    def is_row(self, index: int) -> bool:
        """Whether a line has a cell for each column and numbers where the columns hold numbers."""
        if not 0 <= index < len(self.lines) or is_comment(self.lines[index][1]):
            return False
        cells = self.cells(index)
        numeric = self._over_numbers(cells)
        return (
            self.layout.fits(cells) and bool(numeric) and all(map(self.layout.is_number, numeric))
        )

    def first_row(self) -> int:
        """The index of the first row: damaged ones belong to the table that they are above."""
        count = len(self.lines)
        found = next(
            (
                i
                for i in range(count)
                if self.is_row(i)
                and (i + 1 >= count or self.is_row(i + 1) or self.is_row(i + 2))
                and not self._is_caption(i + 1)
            ),
            None,
        )
        if found is None:
            return self._first_of_any()
        found = self._below_settings(found)
        while found > 0 and self._continues_up(found - 1):
            found -= 1
        return found

    def _below_settings(self, index: int) -> int:
        """The first line below settings, some of which resemble rows: "BlockSize",241,241.

        Each begins with its name, in a column in which the rows have nothing; some hold words.
        Those of numbers alone below these are rows only where further rows have such a word.
        """
        first, below, end, has_words = index, index, index, False
        while first and self._is_labelled(self.cells(index)) and self._is_setting(first - 1):
            first -= 1
        # One of these has the columns' names: the word in it may be that of a column of remarks.
        words = sum(
            not self.has_numbers(self._over_numbers(self.cells(at))) for at in range(first, index)
        )
        for at in range(index, len(self.lines)):
            cells = self.cells(at)
            if not self._is_labelled(cells):
                break
            end = at + 1
            over = self._over_numbers(cells)
            if over and not self.has_numbers(over):
                below = at + 1
                # A damaged number has digits.
                has_words |= not any(map(str.isdigit, "".join(over)))
        if not has_words and words < 2:
            return index
        later = (self.cells(at) for at in range(end, len(self.lines)))
        return below if any(map(self._is_labelled, later)) else end

    def _is_setting(self, index: int) -> bool:
        """Whether a line has a word where the rows have nothing, and a cell for each column."""
        cells = self.cells(index)
        return self._is_labelled(cells) and self.layout.fits(cells)

    def _is_labelled(self, cells: Sequence[str]) -> bool:
        """Whether a line has a word where the rows have nothing."""
        words = (cells[i] for i in self.layout.blank if i < len(cells))
        return any(cell and not self.layout.is_number(cell) for cell in words)

    def _over_numbers(self, cells: Sequence[str]) -> list[str]:
        """The filled cells of the columns that hold numbers."""
        return [cells[i] for i in sorted(self.layout.numeric) if i < len(cells) and cells[i]]

    def _is_caption(self, index: int) -> bool:
        """Whether a line holds words alone: "data:". Lines above it are not part of the table."""
        if index >= len(self.lines) - 1 or is_comment(self.lines[index][1]):
            return False
        cells = self.cells(index)
        return not self.layout.fits(cells) and not self.has_numbers(cells)

    def _continues_up(self, index: int) -> bool:
        number, text = self.lines[index]
        if is_comment(text) or number + 1 != self.lines[index + 1][0]:
            return False
        cells = self.cells(index)
        if 0 not in self.layout.numeric or not cells:
            return False
        if not self.layout.is_number(cells[0]):
            return self._is_damaged_row(cells)
        return STAMP.search(text) is None or self.layout.fits(cells)

    def _is_damaged_row(self, cells: Sequence[str]) -> bool:
        """Whether only the first cell of a line is no number, but was one: it has digits."""
        others = [cells[i] for i in self.layout.numeric if 0 < i < len(cells)]
        numbers = self.layout.fits(cells) and all(map(self.layout.is_number, others))
        return numbers and bool(others) and any(map(str.isdigit, cells[0]))

    def _first_of_any(self) -> int:
        """Where no line is a row: after a line of names, if it is one."""
        plain = [i for i, (_, text) in enumerate(self.lines) if not is_comment(text)]
        rows = [self.cells(i) for i in plain[:40]]
        if not rows:
            return len(self.lines)
        names, _ = find_header(rows, self.options.header, self.layout.decimal)
        return plain[0] + (names is not None)

    def by_name(self, first: int) -> TableHeading | None:
        """The heading that holds the names asked for, as cells; the best of several."""
        asked = [name for name in self.options.names if not name.startswith("#")]
        wanted = asked or list(CANONICAL_UNITS)
        found = [
            (bool(self.width_of(i)), matches, i)
            for i in range(min(first, len(self.lines)))
            if (matches := self.matches(i, wanted))
        ]
        if not found and asked:  # a table of numbers is above
            found = [
                (True, len(asked), i)
                for i in range(first, min(first + 5000, len(self.lines)))
                if self.matches(i, asked) == len(asked) and self.width_of(i)
            ][:1]
        if not found:
            return None
        fitting, matches, index = max(found)
        if not fitting:
            if self.by_place(first, strict=False) is not None or 2 * matches < len(asked):
                return None
            raise self.disagrees(index)
        self._check_upper(index, matches, wanted)
        return self.heading(index)

    def _check_upper(self, index: int, matches: int, wanted: Sequence[str]) -> None:
        """InputError where the same names head another table, of more or fewer columns, above."""
        for upper in range(index):
            if self.matches(upper, wanted) < matches or not self._heads_numbers(upper):
                continue
            above, number = self.lines[upper][0], self.lines[index][0]
            raise input_error(
                f"{self.path}, line {number}",
                f"a second heading, of other columns than that of the rows from line {above} on",
                f"split the file there; --skip-rows {number - 1} reads the lower table alone",
            )

    def _heads_numbers(self, index: int) -> bool:
        """Whether two rows of numbers are under a line, each with a cell for each of its own."""
        named = self.cells(index)
        under = [self.cells(i) for i in (index + 1, index + 2) if i < len(self.lines)]
        return len(under) == 2 and all(
            len(cells) == len(named) and all(map(self.layout.is_number, filter(None, cells)))
            for cells in under
        )

    def check_rows_are_no_signals(self) -> None:
        """InputError where all names that are asked for are the first cells of lines."""
        asked = {name for name in self.options.names if not name.startswith("#")}
        first = [(self.cells(i) or [""])[0] for i in range(min(1000, len(self.lines)))]
        if len(asked) < 2 or not asked <= set(first):
            return
        index = next(i for i, cell in enumerate(first) if cell in asked)
        raise input_error(
            f"{self.path}, line {self.lines[index][0]}",
            f"{shortened(first[index])!r} names the line, not a column: each line is a signal",
            "give --transpose (in a recipe: transpose = true)",
        )

    def matches(self, index: int, wanted: Sequence[str]) -> int:
        """How many of the names asked for a line holds as cells; none where all are numbers."""
        if not any(name in self.lines[index][1] for name in wanted):
            return 0
        cells = self.cells(index)
        if all(map(self.layout.is_number, filter(None, cells))):
            return 0
        names = {*cells, *map(bare_name, cells)}
        if is_comment(self.lines[index][1]):
            names |= {sign + cells[0] for sign in COMMENTS}
        return sum(name in names for name in wanted)

    def width_of(self, index: int) -> int:
        """The number of columns under a line of names; 0 where it does not fit the rows."""
        cells, layout = self.cells(index), self.layout
        named = len(cells) - (len(cells) > 1 and not cells[-1])
        if named == layout.fields or len(cells) == layout.fields:
            return layout.fields
        if named == layout.fields + 1:
            if self._is_shifted(index):
                return layout.fields
            if layout.ends_empty or self._has_wider_row(named):
                return named
            if _COMMENT_COLUMN.fullmatch(cells[named - 1]):
                return layout.fields
        elif named > layout.fields and self._has_wider_row(named):
            return named
        return layout.fields if self._has_settings(index, named) else 0

    def _is_shifted(self, index: int) -> bool:
        """Whether a line's first cell labels the line and the names follow, one to each column.

        Settings above or below show it: "BlockSize",400,400 under "TraceName","CH1","CH2", where
        rows have two cells.
        """
        count = self.layout.fields + 1
        cells = _filled(self.cells(index))
        is_named = cells[0] in self.options.names or _COMMENT_COLUMN.fullmatch(cells[-1])
        if self.layout.delimiter == BLANK or len(cells) != count or is_named:
            return False
        near = range(max(0, index - _PREAMBLE), min(len(self.lines), index + _PREAMBLE))
        others = [_filled(self.cells(i)) for i in near]
        alike = [one for one in others if len(one) == count and one != cells]
        if any(self.layout.is_number(one[0]) for one in alike):
            return False
        return any(all(map(self.layout.is_number, one[1:])) for one in alike)

    def _has_settings(self, index: int, named: int) -> bool:
        """Whether the names beyond the rows' cells are of numbers in the row of units alone.

        So a scope notes its period: "X,CH1,Start,Increment" over "Sequence,VOLT,-5.0E-2,1.0E-3",
        or in the heading itself: "Time(s),CH1(V),t0 = -1.0e-3, tInc = 2.0e-6".
        """
        fields = self.layout.fields
        if named <= fields or index + 1 >= len(self.lines):
            return False
        cells = self.cells(index + 1)
        if all(map(_SETTING.fullmatch, self.cells(index)[fields:named])):
            return True
        return (
            len(cells) >= named
            and all(map(self.layout.is_number, cells[fields:named]))
            and _is_of_words(cells, self.layout)
        )

    def _has_wider_row(self, fields: int) -> bool:
        """Whether lines have that many cells although most have fewer: the last are empty.

        One is enough for one more cell; a line of several more may be two that run together.
        """
        needed = 1 if fields == self.layout.fields + 1 else 3
        for _, text in self.lines:
            if text.count(self.layout.delimiter) + 1 >= fields and not is_comment(text):
                cells = self.layout.cells(text)
                needed -= len(cells) == fields and self.layout.is_number(cells[0] or cells[-1])
                if needed == 0:
                    return True
        return False

    def heading(self, index: int) -> TableHeading:
        """The heading of a line that fits."""
        width = self.width_of(index)
        if self._is_shifted(index):
            return TableHeading(self.cells(index)[1 : width + 1], index, index + 1, self.layout)
        cells = self.cells(index)[:width]
        layout = replace(self.layout, fields=width)
        if width > self.layout.fields:
            more = () if layout.ends_empty else range(self.layout.fields, width)
            layout = replace(layout, ends_empty=False, numeric=layout.numeric.union(more))
        above = self.cells(index - 1) if index > 0 else []
        above = above[:width] if self.layout.fits(above) else []
        beyond = [name for name in self.cells(index)[width:] if name]
        names = [name.strip() for name in cells]
        return TableHeading(names, index, index + 1, layout, above=above, beyond=beyond)

    def by_place(self, first: int, strict: bool = True) -> TableHeading | None:
        """The heading by its place above the rows, or None: InputError where it does not fit."""
        above = [i for i in range(first) if not is_comment(self.lines[i][1])][-2:]
        if not above:
            return self._commented(first)
        index = above[-1]
        if len(above) == 2 and self._is_over_units(*above):
            index = above[0]
        if self._names_columns(index):
            return self.heading(index)
        commented = self._commented(first)
        cells = self.cells(index)
        numbered = bool(self.options.names) and all(n.startswith("#") for n in self.options.names)
        touches = self.lines[index][0] + 1 == self.lines[first][0] if first < len(self.lines) else 1
        disagrees = len(cells) > 1 and not self.has_numbers(cells) and all(cells[:-1])
        if strict and commented is None and disagrees and touches and not numbered:
            raise self.disagrees(index)
        if self.options.header and commented is None:
            return self.heading(index) if self.width_of(index) else None
        return commented

    def _is_over_units(self, index: int, below: int) -> bool:
        """Whether a line names the columns and the next one holds their units.

        A scope's row of units has its settings' numbers too: "Sequence,Volt,-1.2E-3,4.0E-6".
        """
        cells = self.cells(below)
        settings = self.has_numbers(cells) and not self.has_numbers(self.cells(index))
        units = are_units(cells) or (settings and _is_of_words(cells, self.layout))
        return units and self._names_columns(index)

    def _names_columns(self, index: int) -> bool:
        """Whether a line has words where the columns hold numbers, and a cell for each."""
        cells = self.cells(index)
        words = [cells[i] for i in self.layout.numeric if i < len(cells) and cells[i]]
        return bool(self.width_of(index)) and any(not self.layout.is_number(c) for c in words)

    def _commented(self, first: int) -> TableHeading | None:
        """A comment directly above the rows that is a heading."""
        index = first - 1
        if index < 0 or not is_comment(self.lines[index][1]) or self.layout.fields < 2:
            return None
        cells = self.cells(index)
        if self.has_numbers(cells) or not all(cells[:-1]) or not self.width_of(index):
            return None
        return self.heading(index)

    def below(self, heading: TableHeading, first: int) -> TableHeading:
        """The heading with what is between it and the first row: units, a date, settings."""
        assert heading.line is not None
        if are_units(self._over_numbers(heading.above)):
            heading.units = heading.above
        shifted = self._is_shifted(heading.line)
        for index in range(heading.line + 1, len(self.lines)):
            heading.first = index
            text = self.lines[index][1]
            cells = self.cells(index)
            if is_comment(text):
                continue
            if shifted and index < first:
                heading.passed.append(index)
                if are_units(_filled(cells)[1:]) and not heading.units:
                    heading.units = cells[1:]
            elif self._is_under(cells, heading):
                self._take_under(heading, cells, index)
            elif self._is_other(index, cells, heading, first):
                heading.passed.append(index)
            else:
                return heading
        heading.first = len(self.lines)
        return heading

    def _is_under(self, cells: Sequence[str], heading: TableHeading) -> bool:
        """Whether a line has words for the columns."""
        named = len(heading.names or ()) + len(heading.beyond)
        whole = heading.layout.fits(cells) or len(cells) - (not cells[-1]) == named
        if not whole and len(cells) != named:
            return False
        return not self.has_numbers(cells) or _is_of_words(cells, heading.layout)

    def _take_under(self, heading: TableHeading, cells: list[str], index: int) -> None:
        """The first row of words under the names, and the first of units."""
        if not heading.under:
            heading.under = cells
        else:
            heading.passed.append(index)
        if are_units(self._over_numbers(cells)) and heading.units in ([], heading.above):
            heading.units = cells

    def _is_other(
        self, index: int, cells: Sequence[str], heading: TableHeading, first: int
    ) -> bool:
        """Whether a line between names and rows is not part of the table."""
        if heading.layout.fits(cells) or len(cells) == len(heading.names or ()):
            is_none = index < first and self._is_labelled(cells)
        else:
            is_none = not self.has_numbers(cells) or STAMP.search(self.lines[index][1]) is not None
        return is_none or self._is_caption(index + 1)

    def disagrees(self, index: int) -> InputError:
        number = self.lines[index][0]
        cells = self.cells(index)
        named = len(cells) - (len(cells) > 1 and not cells[-1])
        fields = "1 field" if self.layout.fields == 1 else f"{self.layout.fields} fields"
        if self.layout.delimiter == "," and self.layout.fields == 2 * named:
            return input_error(
                f"{self.path}, line {number}",
                f"{named} column names over {fields}: the numbers have decimal commas, and commas "
                "separate them too",
                "export with semicolons or tabs between the cells, or with decimal points",
            )
        return input_error(
            f"{self.path}, line {number}",
            f"{named} column names over {fields}",
            f"make them agree; if the names are others, --skip-rows {number} starts below this "
            "line, and with --no-header the columns are #1, #2 ... (in a recipe: skip_rows)",
        )


def _filled(cells: Sequence[str]) -> list[str]:
    """A line's cells without one that is empty at its end."""
    return list(cells[:-1] if len(cells) > 1 and not cells[-1] else cells)


def _with_units(cells: Sequence[str]) -> list[str]:
    """Names between blanks, each with the unit that is in brackets after it."""
    found: list[str] = []
    for cell in cells:
        if found and cell[:1] in "([":
            found[-1] += f" {cell}"
        else:
            found.append(cell)
    return found


def _is_of_words(cells: Sequence[str], layout: Layout) -> bool:
    """A row of units in which a scope notes numbers too: "Sequence,Volt,-1.2E-3,4.0E-6"."""
    over = [cells[column] for column in layout.numeric if column < len(cells)]
    return bool(over) and all(_WORD.search(cell) and not layout.is_number(cell) for cell in over)


def find_header(
    rows: Sequence[Sequence[str]], wanted: bool | None, decimal: str = "."
) -> tuple[list[str] | None, int]:
    """The column names, or None; and 1 where a row of units follows them, else 0.

    Names are text where the rows below hold numbers. `wanted` True or False overrides.
    """
    first, below = rows[0], rows[1:]
    if wanted is False:
        return None, 0
    if not below and not any(is_number(field, decimal) for field in first):
        return [name.strip() for name in first], 0
    if wanted is None and not any(
        field
        and not is_number(field, decimal)
        and any(is_number(row[i], decimal) for row in below[:20] if i < len(row))
        for i, field in enumerate(first)
    ):
        return None, 0
    has_units = len(below) > 1 and not any(is_number(f, decimal) for f in below[0])
    numbers_follow = has_units and any(is_number(f, decimal) for f in below[1])
    return [name.strip() for name in first], int(numbers_follow)


__all__ = ["STAMP", "Lines", "TableHeading", "find_header", "find_heading", "is_comment"]
