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


@dataclass(frozen=True)
class _Most:
    """Bounds of a workbook.

    `cells` of the rectangle from A1 to a sheet's last one, and `rows` (Excel has no more);
    `other_bytes` of XML that is not a sheet (texts, styles), unpacked; of a sheet's XML
    `free_bytes`, and `bytes_each` of its elements, of which a cell has up to four.
    """

    cells: int = 20_000_000
    rows: int = 1_048_576
    other_bytes: int = 100_000_000
    free_bytes: int = 10_000_000
    bytes_each: int = 300

    @property
    def elements(self) -> int:
        return 4 * self.cells


MOST = _Most()
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
            return f"more than {MOST.other_bytes:,} bytes" if read > MOST.other_bytes else None
        if self.elements > MOST.elements:
            return f"more than {MOST.elements:,} elements"
        if self.rows > MOST.rows or self._listed > MOST.rows:
            return f"more than {MOST.rows:,} rows"
        if self.rows * self.columns > MOST.cells:
            return (
                f"{self.rows:,} rows and {self.columns:,} columns up to its last cell, more than "
                f"{MOST.cells:,} cells"
            )
        if read > MOST.free_bytes + MOST.bytes_each * self.elements:
            found = f"{read:,} bytes for {self.elements:,} elements"
            return f"{found}, more than {MOST.bytes_each} for each"
        return None


def _number(letters: str) -> int:
    """A column's number from 1: A is 1, XFD 16384."""
    found = 0
    for letter in letters:
        found = 26 * found + ord(letter) - ord("A") + 1
    return found


def check_size(path: Path, file: BinaryIO) -> None:
    """InputError where a part of a workbook is beyond the bounds; its XML is not kept.

    Damage is left to the reader itself.
    """
    with zipfile.ZipFile(file) as archive:
        for part in archive.infolist():
            if part.file_size > MOST.free_bytes or part.filename.startswith("xl/worksheets/"):
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


__all__ = ["MOST", "check_size"]
