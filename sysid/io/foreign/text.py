"""Text files: delimiter, decimal sign and header are detected, or given."""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from sysid.errors import InputError, input_error
from sysid.io.bounds import MOST_COLUMNS, check_columns, check_rectangle, check_text
from sysid.io.foreign.table import Column, ForeignTable, ReadOptions, take_names

BLANK = " "
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
# In this order: of two that fit equally well the first is used.
_CANDIDATES = (
    (";", "."),
    (";", ","),
    ("\t", "."),
    ("\t", ","),
    ("|", "."),
    (",", "."),
    (BLANK, "."),
    (BLANK, ","),
)
_COMMENTS = ("#", "%", "//")
_SAMPLE_LINES = 200
_WORDS = re.compile(r"\S+")


@dataclass(frozen=True)
class _Layout:
    """How the lines are read; `fields` is the number of columns."""

    delimiter: str
    decimal: str
    fields: int
    thousands: str | None = None


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Comment lines (#, %, //) at the top are skipped; `options` overrides what is detected."""
    table = ForeignTable(path, "text")
    check_text(path, file)
    text = _decoded(table, file.read())
    lines = text.splitlines()
    start = options.skip_rows
    while start < len(lines) and (
        not lines[start].strip() or lines[start].lstrip().startswith(_COMMENTS)
    ):
        start += 1
    sample = [line for line in lines[start : start + _SAMPLE_LINES] if line.strip()]
    if not sample:
        raise input_error(path, "holds no rows", "give another file (or fewer skip_rows)")
    _check_columns(path, sample, options)
    layout = _find_layout(path, sample, options)
    rows = [_fields(line, layout.delimiter) for line in sample]
    table.format = f"text, separated by {_SAID.get(layout.delimiter, layout.delimiter)}"
    if layout.decimal == ",":
        table.format += ", decimal comma"
    names, units = find_header(rows, options.header, layout.decimal)
    if units:
        table.notices.append(
            f"{path}: the row under the names was skipped ({'; '.join(rows[1][:8])})"
        )
    numbered = [(n + 1, line) for n, line in enumerate(lines) if n >= start and line.strip()]
    body = numbered[units + (names is not None) :]
    if not body:
        raise input_error(path, "has a header but no rows", "give another file")
    _check_columns(path, lines, options)
    _check_widths(path, names, numbered[0], body, layout)
    _reject_cut_off(path, text, body, layout)
    table.place = lambda row: f"line {body[row][0]}"
    table.explain_gap = lambda row: _short_row(path, body, row, layout)
    check_rectangle(path, len(body), layout.fields)
    _parse(table, [line for _, line in body], layout, names)
    return table


def _decoded(table: ForeignTable, raw: bytes) -> str:
    encodings = ("utf-16",) if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else ("utf-8-sig",)
    for encoding in (*encodings, "cp1252"):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if encoding == "cp1252":
            table.notices.append(f"{table.path}: not UTF-8; read as Windows-1252")
        return text
    raise input_error(table.path, "is text of an unknown encoding", "save it as UTF-8")


def _check_columns(path: Path, lines: Iterable[str], options: ReadOptions) -> None:
    """InputError at a line of more columns than are read, before it is cut into them."""
    signs = ",;|\t" + (options.delimiter or "")
    for line in lines:
        if len(line) > MOST_COLUMNS:
            words = itertools.islice(_WORDS.finditer(line), MOST_COLUMNS + 1)
            check_columns(path, max(sum(1 for _ in words), *(line.count(s) + 1 for s in signs)))


def _find_layout(path: Path, sample: Sequence[str], options: ReadOptions) -> _Layout:
    """The delimiter and decimal sign under which most fields of most lines are numbers."""
    # Headers and preambles come first, so the later half of the lines decides.
    lines = sample[len(sample) // 2 :]
    best: tuple[tuple[float, bool], _Layout] | None = None
    thousands = options.thousands
    for delimiter, decimal in _candidates(path, options):
        rows = [_fields(line, delimiter) for line in lines]
        width, votes = Counter(len(row) for row in rows).most_common(1)[0]
        fields = [f for row in rows for f in row if f]
        if thousands:
            fields = [_ungrouped(f, thousands, decimal) for f in fields]
        numeric = sum(is_number(f, decimal) for f in fields) / max(1, len(fields))
        score = (round(votes / len(rows) * numeric, 2), width > 1)
        if best is None or score > best[0]:
            best = score, _Layout(delimiter, decimal, width, thousands)
    assert best is not None  # always at least one candidate
    return best[1]


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
    return [(delimiter, d) for d in decimals if d != delimiter]


def _ungrouped(text: str, thousands: str, decimal: str) -> str:
    """The number without the signs that group its digits by thousands (1.003.000 is 1003.000)."""
    group, sign = re.escape(thousands), re.escape(decimal)
    fraction = rf"({sign}\d+)" + ("" if thousands == decimal else "?")
    grouped = re.fullmatch(rf"([+-]?\d{{1,3}}(?:{group}\d{{3}})+){fraction}", text.strip())
    return text if grouped is None else grouped[1].replace(thousands, "") + (grouped[2] or "")


def _fields(line: str, delimiter: str) -> list[str]:
    """A line's fields; a delimiter at its very end does not start another field."""
    if delimiter == BLANK:
        return line.split()
    fields = [f.strip() for f in next(csv.reader([line], delimiter=delimiter), [])]
    return fields[:-1] if len(fields) > 1 and not fields[-1] else fields


def is_number(text: str, decimal: str = ".") -> bool:
    """Whether a field is a number under this decimal sign (NaN and inf are)."""
    if decimal == ",":
        if "." in text:
            return False
        text = text.replace(",", ".", 1)
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


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


def _check_widths(
    path: Path,
    names: list[str] | None,
    first: tuple[int, str],
    body: list[tuple[int, str]],
    layout: _Layout,
) -> None:
    """InputError where the header or a row has another number of fields than the rest."""
    if names is not None and len(names) != layout.fields:
        raise input_error(
            f"{path}, line {first[0]}",
            f"{len(names)} column names over {layout.fields} fields",
            "make them agree, or give the number of lines above the table with skip_rows",
        )
    for number, line in body:
        if line.count(layout.delimiter) >= layout.fields or layout.delimiter == BLANK:
            fields = len(_fields(line, layout.delimiter))
            if fields > layout.fields:
                raise input_error(
                    f"{path}, line {number}",
                    f"{fields} fields where the other lines have {layout.fields}",
                    "fix the line (two lines run together, a decimal comma?)",
                )


def _short_row(
    path: Path, body: list[tuple[int, str]], row: int, layout: _Layout
) -> InputError | None:
    line = body[row][1]
    empty_end = layout.delimiter != BLANK and line.rstrip(" ").endswith(layout.delimiter)
    fields = len(_fields(line, layout.delimiter))
    if fields + empty_end >= layout.fields:
        return None
    return input_error(
        f"{path}, line {body[row][0]}",
        f"the row ends early: {fields} of {layout.fields} fields",
        "delete this last line: the recording was cut off there"
        if row == len(body) - 1
        else "complete the row, or give the number of lines above the table with skip_rows",
    )


def _reject_cut_off(path: Path, text: str, body: list[tuple[int, str]], layout: _Layout) -> None:
    """A last line cut off within its last number would silently give a wrong value."""
    if text.endswith(("\n", "\r")) or len(body) < 20:
        return
    lengths = [len(_fields(line, layout.delimiter)[-1]) for _, line in body[-200:]]
    if lengths[-1] < min(lengths[:-1]):
        raise input_error(
            f"{path}, line {body[-1][0]}",
            "the last line has no line end and its last number is shorter than all before it: "
            "it looks cut off",
            "delete the line, or end it with a line break if it is whole",
        )


def _parse(table: ForeignTable, lines: list[str], layout: _Layout, names: list[str] | None) -> None:
    import pandas as pd

    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(lines)),
            sep=r"\s+" if layout.delimiter == BLANK else layout.delimiter,
            decimal=layout.decimal,
            header=None,
            names=range(layout.fields),
            usecols=range(layout.fields),
            index_col=False,
            skipinitialspace=True,
            **_exact(pd.__version__),
            low_memory=False,
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        reason = str(error).splitlines()[0][:120]
        raise input_error(
            table.path, f"cannot be read as text ({reason})", "give --delimiter, or fix the file"
        ) from None
    take_names(table, names, (_tidied(frame[i].to_numpy(), layout) for i in frame.columns))


def _exact(version: str) -> dict[str, Any]:
    """What makes pandas read a decimal as the nearest double; from 3.1 on it always does."""
    major, minor = (int(part) for part in version.split(".")[:2])
    return {} if (major, minor) >= (3, 1) else {"float_precision": "round_trip"}


def _tidied(values: Column, layout: _Layout) -> Column:
    """Cells that pandas left as text, with what is a number written as Python writes it."""
    if values.dtype != object or (layout.thousands is None and layout.decimal == "."):
        return values
    tidy = values.copy()
    for row, cell in enumerate(values):
        if isinstance(cell, str):
            text = cell
            if layout.thousands:
                text = _ungrouped(text, layout.thousands, layout.decimal)
            if is_number(text, layout.decimal):
                tidy[row] = text.replace(layout.decimal, ".")
    return tidy
