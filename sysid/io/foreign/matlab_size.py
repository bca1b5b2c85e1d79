"""What a MATLAB file of version 5 to 7 declares, read before scipy unpacks it.

Sources: MathWorks, "MAT-File Format" (version 5): elements of a tag (type, bytes) and their data;
an array's flags, dimensions and name come first. A compressed variable is one zlib stream.
"""

from __future__ import annotations

import math
import os
import struct
import zlib
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import BinaryIO

from sysid.io.bounds import Cells, check_columns
from sysid.io.file_kinds import damaged

_HEAD = struct.Struct("116s8sH2s")  # text, subsystem, version, order of bytes
# The longest head of an array that is kept, and how much is unpacked at a time.
_CHUNK = 1 << 16


class _Element(IntEnum):
    """Types of a file's elements (table 1-1)."""

    MATRIX = 14
    COMPRESSED = 15


class _Class(IntEnum):
    """Classes of arrays (table 1-3; the last two are not documented)."""

    CELL = 1
    STRUCT = 2
    OBJECT = 3
    SPARSE = 5
    FUNCTION = 16
    OPAQUE = 17


class _Flags(IntFlag):
    """The flags next to an array's class (figure 1-6)."""

    COMPLEX = 0x0800


def check_size(path: Path, file: BinaryIO) -> dict[str, str]:
    """The variables that are objects of MATLAB, with their classes.

    InputError where the variables have more cells than are read, or hold what is no array. The
    file is read from its start; the arrays of structs and cells count too, and an array's values
    may not take more bytes than its dimensions say.
    """
    file.seek(_HEAD.size - 2)
    order = "<" if file.read(2) == b"IM" else ">"
    size = file.seek(0, os.SEEK_END)
    cells, objects = Cells(path), dict[str, str]()
    at = _HEAD.size
    while at + 8 <= size:
        file.seek(at)
        kind, length = struct.unpack(f"{order}2I", file.read(8))
        at += 8 + length
        if kind == _Element.COMPRESSED:
            source: _Plain | _Unpacked = _Unpacked(path, file, length)
        elif kind == _Element.MATRIX:
            file.seek(at - length - 8)
            source = _Plain(path, file, size)
        else:
            continue
        objects |= _Arrays(path, source, order, cells).variable()
    return objects


class _Plain:
    """The bytes of a variable that is not packed."""

    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self._path, self._file, self._size = path, file, size

    def take(self, count: int) -> bytes:
        """The next bytes; InputError where there are fewer."""
        found = self._file.read(count)
        if len(found) < count:
            raise damaged(self._path, "a MATLAB file", "it ends within a variable")
        return found

    def skip(self, count: int) -> None:
        """Skip the next bytes."""
        if self._file.seek(count, os.SEEK_CUR) > self._size:
            raise damaged(self._path, "a MATLAB file", "it ends within a variable")


class _Unpacked:
    """The bytes of a packed variable, unpacked a little at a time, and only as far as asked."""

    def __init__(self, path: Path, file: BinaryIO, length: int) -> None:
        self._path, self._file, self._remaining = path, file, length
        self._stream = zlib.decompressobj()
        self._ready, self._at = b"", 0

    def take(self, count: int) -> bytes:
        """The next bytes; InputError where there are fewer."""
        end = self._at + count
        while len(self._ready) < end:
            if self._at >= len(self._ready):  # skipped bytes are not kept
                self._at, end = self._at - len(self._ready), end - len(self._ready)
                self._ready = self._more()
            else:
                self._ready += self._more()
        found, self._at = self._ready[self._at : end], end
        return found

    def skip(self, count: int) -> None:
        """Skip the next bytes."""
        self._at += count

    def _more(self) -> bytes:
        packed = self._stream.unconsumed_tail
        if not packed:
            packed = self._file.read(min(_CHUNK, self._remaining))
            self._remaining -= len(packed)
        try:
            found = self._stream.decompress(packed, _CHUNK)
        except zlib.error as error:
            raise damaged(self._path, "a MATLAB file", error) from None
        if not found and not packed:
            raise damaged(self._path, "a MATLAB file", "a packed variable ends early")
        return found


class _Arrays:
    """Reads the heads of a variable's arrays, and counts their cells."""

    def __init__(self, path: Path, source: _Plain | _Unpacked, order: str, cells: Cells) -> None:
        self._path, self._source, self._order, self._cells = path, source, order, cells
        self._name, self._elements_found = "", 0
        self._object: dict[str, str] = {}

    def variable(self) -> dict[str, str]:
        """A variable of the file: its name and class where it is an object."""
        self._nested()
        return self._object

    def _nested(self) -> None:
        kind, length, short = self._tag()
        if kind != _Element.MATRIX or short is not None:
            raise damaged(self._path, "a MATLAB file", f"an element of type {kind} for an array")
        self._array(length)

    def _array(self, length: int) -> None:
        if length == 0:  # an empty array
            return
        flags, _ = struct.unpack(f"{self._order}2I", self._short_data(8))
        kind, is_complex = flags & 0xFF, bool(flags & _Flags.COMPLEX)
        if kind == _Class.OPAQUE:
            name, _, kind = (self._short_data().decode("latin-1") for _ in range(3))
            if name:  # within a struct or a cell it has none
                self._object = {name: kind}
            self._nested()
            return
        sizes = self._short_data()
        count = math.prod(size for (size,) in struct.iter_unpack(f"{self._order}I", sizes))
        name = self._short_data().decode("latin-1")
        self._name = self._name or name
        if kind in (_Class.CELL, _Class.STRUCT, _Class.OBJECT):
            self._elements(kind, count)
            return
        self._add(count)
        if kind == _Class.FUNCTION:
            self._nested()
            return
        if kind == _Class.SPARSE:
            for _ in range(3 + is_complex):  # row indices, column starts, values
                self._skip_data(None)
            return
        for _ in range(1 + is_complex):
            self._skip_data(count)

    def _elements(self, kind: int, count: int) -> None:
        if kind == _Class.OBJECT:
            self._short_data()
        fields = 1
        if kind in (_Class.STRUCT, _Class.OBJECT):
            (width,) = struct.unpack(f"{self._order}I", self._short_data(4))
            names = self._short_data()
            fields = len(names) // width if width else 0
        self._add(count * max(fields, 1))
        self._elements_found += count * fields
        check_columns(self._path, self._elements_found)  # each will be a column of its own
        for _ in range(count * fields):
            self._nested()

    def _add(self, count: int) -> None:
        self._cells.add(count, f"variable {self._name}")

    def _tag(self) -> tuple[int, int, bytes | None]:
        """Type and length of the next element, its data where they are in the tag."""
        first, second = struct.unpack(f"{self._order}2I", head := self._source.take(8))
        if first >> 16:  # a small element: length and type in four bytes, four of data
            return first & 0xFFFF, first >> 16, head[4 : 4 + (first >> 16)]
        return first, second, None

    def _short_data(self, wanted: int | None = None) -> bytes:
        """An element's data: flags, dimensions, names."""
        _, length, short = self._tag()
        if short is not None:
            found = short
        else:
            if length > _CHUNK:
                raise damaged(self._path, "a MATLAB file", "an array's head is too long")
            found = self._source.take(length)
            self._source.skip(-length % 8)
        if wanted is not None and len(found) != wanted:
            raise damaged(self._path, "a MATLAB file", "an array's head has another length")
        return found

    def _skip_data(self, count: int | None) -> None:
        """An element's values; `count` None: of a sparse array, which count themselves."""
        _, length, short = self._tag()
        if count is None:
            self._add(length // struct.calcsize("d"))
        elif length > struct.calcsize("d") * count:
            raise damaged(self._path, "a MATLAB file", "values beyond an array's dimensions")
        if short is None:
            self._source.skip(length + -length % 8)


__all__ = ["check_size"]
