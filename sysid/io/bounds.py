"""How much of a file is read: one bound for all formats, checked before a value is.

A small file may hold a table of any size: packed values, a fill value that stands for values which
were never written, a file with holes. So each reader counts the cells that a file declares before
it asks for them.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sysid.errors import InputError, input_error
from sysid.types import IntArray

# Eight channels at 1 kHz for three hours are 86 million.
MOST_CELLS = 100_000_000
VARIABLE = "SYSID_MAX_CELLS"
# A double in decimal digits, -2.2250738585072014e-308, and what separates it from the next.
BYTES_EACH = len(f"-{sys.float_info.min!r},")
# A column costs about as much as a thousand cells, in time and in memory.
MOST_COLUMNS = MOST_CELLS // 1000
MOST_DEPTH = 12
"""Structures, records and messages that are nested deeper hold no table."""
_IS_BLANK = np.isin(np.arange(256), list(b" \t"))
_SEPARATORS = list(b",;|\t")
# All at which `str.splitlines` ends a line; U+0085, U+2028 and U+2029 by their last byte.
_ENDS = list(b"\n\r\v\f\x1c\x1d\x1e\x85\xa8\xa9")


def most_cells() -> int:
    """The bound in force: that of the environment (`SYSID_MAX_CELLS`), else `MOST_CELLS`.

    Raises InputError where the variable is not a whole number above 0.
    """
    text = os.environ.get(VARIABLE, "").strip()
    if not text:
        return MOST_CELLS
    plain = text.replace("_", "")
    if not (plain.isascii() and plain.isdecimal() and int(plain) > 0):
        raise input_error(
            VARIABLE, f"{text!r} is not a number of cells", "give a whole number above 0, or none"
        )
    return int(plain)


def most_bytes() -> int:
    """Bytes of the longest file that is read: every cell in decimal digits."""
    return BYTES_EACH * most_cells()


def chunks(file: BinaryIO) -> Iterator[bytes]:
    """The rest of an open file, a megabyte at a time."""
    return iter(lambda: file.read(1 << 20), b"")


@dataclass
class Cells:
    """Counts the cells of a file; InputError once they are more than the bound."""

    path: Path
    found: int = 0

    def add(self, cells: int, what: str = "") -> None:
        """Count further cells that the file declares; `what` holds them ("data set p")."""
        self.found += cells
        if self.found > (most := most_cells()):
            named = f" up to {what}" if what else ""
            raise _too_many(self.path, f"has {self.found:,} cells{named}", most)


def check_length(path: Path, length: int) -> None:
    """InputError where a file of so many bytes is longer than any that is read."""
    if length > (most := most_bytes()):
        raise too_long(path, f"has {length:,} bytes", most)


def too_long(path: Path, what: str, most: int) -> InputError:
    """The error for a file whose bytes are more than `most`."""
    return input_error(
        path,
        f"{what}, more than the {most:,} that are read",
        f"split it, or raise {VARIABLE} (cells, of {BYTES_EACH} bytes)",
    )


@dataclass
class TextCells:
    """Counts the cells of a text as its bytes come, by the commonest of what may separate them."""

    path: Path
    _counts: IntArray = field(default_factory=lambda: np.zeros(256, dtype=np.intp))
    _runs: int = 0
    _pairs: int = 0
    _in_line: int = 0

    def add(self, chunk: bytes) -> None:
        """Further bytes; a run of blanks separates once. InputError beyond the bound."""
        signs = np.frombuffer(chunk, dtype=np.uint8)
        found = np.bincount(signs, minlength=256)
        if found[0]:  # of UTF-16
            signs = signs[signs != 0]
        blank = _IS_BLANK[signs]
        self._counts += found
        self._runs += int(np.count_nonzero(blank[1:] & ~blank[:-1]))
        self._pairs += chunk.count(b"\r\n")
        lines = int(self._counts[_ENDS].sum()) - self._pairs
        Cells(self.path).add(lines + max(self._runs, int(self._counts[_SEPARATORS].max())))

    def add_to_line(self, chunk: bytes) -> None:
        """Further bytes; InputError where they continue a line of too many columns."""
        if b"\n" in chunk or b"\r" in chunk:
            self._in_line = 0
            return
        self._in_line += max(chunk.count(sign) for sign in _SEPARATORS)
        check_columns(self.path, self._in_line)


def check_text(path: Path, file: BinaryIO) -> None:
    """InputError where a text has more cells than the bound; the file's place is kept.

    No more cells than bytes: those of a file that is short enough are not counted.
    """
    start = file.tell()
    is_long = file.seek(0, os.SEEK_END) - start > most_cells()
    counted = TextCells(path)
    file.seek(start)
    for chunk in chunks(file):
        counted.add_to_line(chunk)
        if is_long:
            counted.add(chunk)
    file.seek(start)


def check_rectangle(path: Path, rows: int, columns: int) -> None:
    """InputError where rows times columns are beyond the bound: short rows are filled up."""
    if rows * columns > (most := most_cells()):
        raise _too_many(path, f"has {rows:,} rows of {columns:,} columns", most)


def _too_many(path: Path, what: str, most: int) -> InputError:
    return input_error(
        path,
        f"{what}, more than the {most:,} cells that are read",
        f"save fewer rows or channels in a file, or raise {VARIABLE}",
    )


def check_columns(path: Path, columns: int) -> None:
    """InputError for more columns than any table has."""
    if columns > MOST_COLUMNS:
        raise input_error(
            path,
            f"has more than {MOST_COLUMNS:,} columns, the most that are read",
            "save the channels that are needed (rows without line ends?)",
        )


def check_device(path: Path, mode: int) -> None:
    """InputError for a device, which may never end; pipes are read."""
    if stat.S_ISBLK(mode) or (stat.S_ISCHR(mode) and not path.samefile(os.devnull)):
        raise input_error(path, "is a device, not a file", "give the path of a file")


__all__ = [
    "BYTES_EACH",
    "MOST_CELLS",
    "MOST_COLUMNS",
    "MOST_DEPTH",
    "VARIABLE",
    "Cells",
    "TextCells",
    "check_columns",
    "check_device",
    "check_length",
    "check_rectangle",
    "check_text",
    "chunks",
    "most_bytes",
    "most_cells",
    "too_long",
]
