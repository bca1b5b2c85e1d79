"""Readers of foreign files, one per format; `read_foreign` picks by content, not by name.

Each returns a `ForeignTable` in the file's own names and units; `sysid.io.conversion` maps it.
`text` finds the table of a text: how its lines are cut (`text_layout`), where it begins
(`heading`), which lines are rows (`table_rows`); `lvm` and `twincat` read their own headers.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import importlib
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NoReturn

from sysid.errors import InputError, input_error, shortened
from sysid.io.bounds import chunks
from sysid.io.file_kinds import (
    DAMAGED_ARCHIVE,
    HEAD_BYTES,
    OLD_EXCEL,
    FileKind,
    damaged,
    is_bag,
    kind_by_content,
    kind_by_name,
    wide_encoding,
)
from sysid.io.foreign.table import ForeignTable, ReadOptions, SampleTimes
from sysid.io.tables import comments_in, open_input, sha256_of

Reader = Callable[[Path, BinaryIO, ReadOptions], ForeignTable]

_EXTRA = "sysid[formats]"
# Bytes of a text in which its heading and some rows stand.
_FIRST_ROWS = 1 << 17
# Readers by libraries of the extra.
_LIBRARIES = {
    "mdf": "an MDF4 file",
    "mcap": "an MCAP file",
    "rosbag": "a ROS bag",
    "ulog": "a ULog file",
}


def read_foreign(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Read an open file that can be searched (`path` is for its suffix and for messages).

    Raises InputError where the format is not known, the file is damaged, or it declares more
    cells than are read (`sysid.io.bounds`).
    """
    file.seek(0)
    kind = _reader_of(path, file)
    file.seek(0)
    if options.transpose and kind not in ("text", "excel"):
        raise input_error(
            path, "is not a table of text or Excel, which --transpose is for", "omit --transpose"
        )
    with _installed(path, kind):
        reader: Reader = importlib.import_module(f"sysid.io.foreign.{kind}").read
        try:
            table = reader(path, file, options)
        except csv.Error as error:
            raise input_error(
                path,
                f"cannot be read as text ({error})",
                "export fewer columns, or another format",
            ) from None
    return _with_columns(table)


def names_in(path: Path, what: str) -> tuple[str, ...]:
    """The names of a file's columns; of a long text by its first rows, of Parquet by its schema.

    Other formats are read whole. `what` it is, for the error where it cannot be read (InputError).
    """
    with open_input(path, what) as file:
        kind = _reader_of(path, file)
        file.seek(0)
        if kind == "parquet":
            from sysid.io.foreign import parquet

            return parquet.names(path, file)
        head = file.read(_FIRST_ROWS + 1) if kind == "text" else b""
        is_cut = len(head) > _FIRST_ROWS and not wide_encoding(head)
        if is_cut:
            rows = io.BytesIO(head[: head.rfind(b"\n") + 1])
            # What does not end in these rows, such as one long line, is read whole.
            with contextlib.suppress(InputError):
                return tuple(read_foreign(path, rows, ReadOptions()).columns)
        return tuple(read_foreign(path, file, ReadOptions()).columns)


def digest_of(path: Path, what: str) -> str:
    """The SHA-256 of a file, or of a ROS 2 bag's files one after the other; `what` it is.

    Raises InputError where it cannot be opened.
    """
    with contextlib.ExitStack() as opened:
        paths = [path]
        if is_bag(path):
            from sysid.io.foreign import rosbag

            opened.enter_context(_installed(path, "rosbag"))
            paths, what = rosbag.bag_files(path)[0], "a bag's file"
        return sha256_of(*(opened.enter_context(open_input(one, what)) for one in paths))


@dataclass(frozen=True)
class ForeignFile:
    """A foreign file (a ROS 2 bag: a folder) as read, its SHA-256 (a folder's: of its files one
    after the other), and its comments, if `sysid.io.tables.write_table` wrote it."""

    path: Path
    table: ForeignTable
    sha256: str
    comments: tuple[str, ...] = ()


def read_any(path: Path, what: str, options: ReadOptions) -> ForeignFile:
    """A file, or a ROS 2 bag's folder, by its path; `what` it is, for the error without one.

    Raises InputError as `read_foreign` does, and where the file does not exist.
    """
    if is_bag(path):
        return _read_bag(path)
    with open_input(path, what) as file:
        table = read_foreign(path, file, options)
        return ForeignFile(path, table, sha256_of(file), comments_in(file))


def _read_bag(folder: Path) -> ForeignFile:
    from sysid.io.foreign import rosbag

    with _installed(folder, "rosbag"), contextlib.ExitStack() as opened:
        paths, packing = rosbag.bag_files(folder)
        files = [(path, opened.enter_context(open_input(path, "a bag's file"))) for path in paths]
        table = _with_columns(rosbag.read_files(folder, files, packing))
        return ForeignFile(folder, table, sha256_of(*(file for _, file in files)))


@contextlib.contextmanager
def _installed(path: Path, kind: str) -> Iterator[None]:
    """InputError, with what to install, where a library of the extra is not there."""
    try:
        yield
    except ModuleNotFoundError as error:
        if kind not in _LIBRARIES or (error.name or "").startswith("sysid"):
            raise
        raise input_error(
            path,
            f"is {_LIBRARIES[kind]}, and {error.name} is not installed",
            f'install its reader: pip install "{_EXTRA}"',
        ) from None


def _with_columns(table: ForeignTable) -> ForeignTable:
    if any(len(values) for values in table.columns.values()):
        return table
    found = [f"{shortened(name)} is {reason}" for name, reason in table.skipped.items()][:4]
    more = ", ..." if len(table.skipped) > len(found) else ""
    told = f": {', '.join(found)}{more}" if found else ""
    raise input_error(table.path, f"holds no columns ({table.format}){told}", "give another file")


def _reader_of(path: Path, file: BinaryIO) -> str:
    """The reader by the head of the file, else by its name. Raises InputError."""
    kind = kind_by_content(path, file)
    if kind is not None:
        return kind.reader or _unread(path, file, kind)
    raw = file.read(HEAD_BYTES)
    is_text = _looks_like_text(raw)
    named = kind_by_name(path)
    is_matlab = named is not None and named.reader == "matlab"
    if is_text and (named is None or is_matlab):
        return "text"
    if named is None:
        raise input_error(
            path,
            "is a binary file of an unknown format",
            "save it as one of the formats that `sysid convert --help` lists",
        )
    if is_matlab:  # version 4 has no signature
        return named.reader
    raise damaged(path, named.what, "its first bytes belong to another format")


def _unread(path: Path, file: BinaryIO, kind: FileKind) -> NoReturn:
    """InputError for a kind of file that no reader reads."""
    if kind == OLD_EXCEL:
        encrypted = _holds(file, "EncryptedPackage".encode("utf-16-le"))
        raise input_error(
            path,
            "is protected by a password" if encrypted else f"is {kind.what}",
            "save it from Excel without a password" if encrypted else "save it from Excel as .xlsx",
        )
    if kind == DAMAGED_ARCHIVE:
        named = kind_by_name(path)
        what = "an Excel workbook" if named is None else named.what
        raise damaged(path, what, "its list of contents cannot be read")
    raise input_error(path, f"is {kind.what}", kind.fix)


def _holds(file: BinaryIO, words: bytes) -> bool:
    """Whether a file holds these bytes."""
    file.seek(0)
    end = b""
    for chunk in chunks(file):
        if words in end + chunk:
            return True
        end = chunk[-len(words) :]
    return False


def _looks_like_text(raw: bytes) -> bool:
    if raw.startswith(codecs.BOM_UTF8) or wide_encoding(raw):
        return True
    # Loggers fill files up with zeros.
    return not any(byte < 32 and byte not in b"\t\n\r\f" for byte in raw.rstrip(b"\0"))


__all__ = [
    "ForeignFile",
    "ForeignTable",
    "ReadOptions",
    "SampleTimes",
    "digest_of",
    "names_in",
    "read_any",
    "read_foreign",
]
