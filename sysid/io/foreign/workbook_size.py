"""Bounds of an Excel workbook, checked before it is read: a small file may hold a huge one."""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from xml.parsers import expat

from sysid.errors import InputError, input_error
from sysid.io.bounds import chunks

# Cells of the rectangle from A1 to the last one; a sheet has at most 1,048,576 rows.
MOST_CELLS = 20_000_000
_MOST_ROWS = 1_048_576
# Bytes of XML that are not a sheet (texts, styles), unpacked.
MOST_BYTES = 100_000_000
# Bytes of a sheet's XML: this, and for each cell and row so much.
_FREE_BYTES, _BYTES_EACH = 10_000_000, 300
_MOST_ELEMENTS = 4 * MOST_CELLS
_CELL = re.compile(r"([A-Z]{1,3})(\d{1,7})")


@dataclass
class _Sheet:
    """What a sheet's XML was found to span so far."""

    rows: int = 0
    columns: int = 0
    elements: int = 0
    is_sheet: bool | None = None
    _column: int = 0
    _listed: int = 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """An element's start, as expat reports it."""
        kind = name.rpartition(":")[2]
        if self.is_sheet is None:
            self.is_sheet = kind == "worksheet"
        self.elements += 1
        if kind == "row":
            number = attributes.get("r", "")
            self._column, self._listed = 0, self._listed + 1
            self.rows = max(self.rows + 1, int(number) if number.isdecimal() else 0)
        elif kind == "c":
            place = _CELL.fullmatch(attributes.get("r", ""))
            self._column = self._column + 1 if place is None else _number(place[1])
            self.columns = max(self.columns, self._column)
            self.rows = max(self.rows, int(place[2]) if place else 0)

    def fault(self, read: int) -> str | None:
        """What is beyond the bounds after so many bytes; None while nothing is."""
        if not self.is_sheet:
            return f"more than {MOST_BYTES:,} bytes" if read > MOST_BYTES else None
        if self.elements > _MOST_ELEMENTS:
            return f"more than {_MOST_ELEMENTS:,} elements"
        if self.rows > _MOST_ROWS or self._listed > _MOST_ROWS:
            return f"more than {_MOST_ROWS:,} rows"
        if self.rows * self.columns > MOST_CELLS:
            return (
                f"{self.rows:,} rows and {self.columns:,} columns up to its last cell, more than "
                f"{MOST_CELLS:,} cells"
            )
        if read > _FREE_BYTES + _BYTES_EACH * self.elements:
            return (
                f"{read:,} bytes for {self.elements:,} elements, more than {_BYTES_EACH} for each"
            )
        return None


def _number(letters: str) -> int:
    """A column's number from 1: A is 1, XFD 16384."""
    found = 0
    for letter in letters:
        found = 26 * found + ord(letter) - ord("A") + 1
    return found


def check_size(path: Path, file: BinaryIO) -> None:
    """InputError where a part of a workbook is beyond the bounds; its XML is not kept.

    What is damaged is left to the reader itself.
    """
    with zipfile.ZipFile(file) as archive:
        for part in archive.infolist():
            if part.file_size > _FREE_BYTES or part.filename.startswith("xl/worksheets/"):
                with archive.open(part) as packed:
                    _check_part(path, part.filename, packed)


def _check_part(path: Path, name: str, file: Any) -> None:
    sheet, parser, read = _Sheet(), expat.ParserCreate(), 0
    parser.StartElementHandler = sheet.start
    for chunk in chunks(file):
        read += len(chunk)
        try:
            parser.Parse(chunk, False)
        except expat.ExpatError:
            return
        fault = sheet.fault(read)
        if fault is not None:
            raise _too_large(path, name, fault)


def _too_large(path: Path, name: str, fault: str) -> InputError:
    return input_error(
        path,
        f"unpacks to more than is read: {name} has {fault}",
        "delete stray cells and formats, or save the sheet as CSV",
    )


__all__ = ["MOST_BYTES", "MOST_CELLS", "check_size"]
