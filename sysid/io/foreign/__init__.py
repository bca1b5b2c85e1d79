"""Readers of foreign files, one per format; `read_foreign` picks by content, not by name.

Each returns a `ForeignTable` in the file's own names and units; `sysid.io.conversion` maps it.
`text` finds the table of a text: how its lines are cut (`text_layout`), where it begins
(`heading`), which lines are rows (`table_rows`); `lvm` and `twincat` read their own headers.
"""

from __future__ import annotations

import contextlib
import csv
import importlib
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from sysid.errors import input_error, shortened
from sysid.io.foreign.json_text import looks_like_json
from sysid.io.foreign.table import ForeignTable, ReadOptions, SampleTimes, damaged
from sysid.io.tables import open_input, sha256_of

Reader = Callable[[Path, BinaryIO, ReadOptions], ForeignTable]

_EXTRA = "sysid[formats]"
# By their first bytes: which reader, and what the file is.
_SIGNATURES = (
    (b"TDSm", "tdms"),
    (b"PAR1", "parquet"),
    (b"MATLAB 5.0", "matlab"),
    (b"MDF     ", "mdf"),
    (b"UnFinMF ", "mdf"),
    (b"\x89MCAP", "mcap"),
    (b"#ROSBAG V", "rosbag"),
    (b"SQLite format 3\x00", "rosbag"),
    (b"ULog\x01\x12\x35", "ulog"),
    (b"\x93NUMPY", "arrays"),
)
# Readers by libraries of the extra.
_LIBRARIES = {
    "mdf": "an MDF4 file",
    "mcap": "an MCAP file",
    "rosbag": "a ROS bag",
    "ulog": "a ULog file",
}
_HDF5 = b"\x89HDF\r\n\x1a\n"
_HEAD_BYTES = 4096
_OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
_BY_NAME = {
    ".mat": ("matlab", "a MATLAB file"),
    ".xlsx": ("excel", "an Excel workbook"),
    ".xlsm": ("excel", "an Excel workbook"),
    ".tdms": ("tdms", "a TDMS file"),
    ".parquet": ("parquet", "Parquet"),
    ".pq": ("parquet", "Parquet"),
    ".h5": ("hdf5", "an HDF5 file"),
    ".hdf5": ("hdf5", "an HDF5 file"),
    ".mf4": ("mdf", "an MDF4 file"),
    ".mdf": ("mdf", "an MDF file"),
    ".mcap": ("mcap", "an MCAP file"),
    ".bag": ("rosbag", "a ROS 1 bag"),
    ".db3": ("rosbag", "a ROS 2 bag"),
    ".ulg": ("ulog", "a ULog file"),
    ".npy": ("arrays", "a numpy file"),
    ".npz": ("arrays", "a numpy archive"),
}


def read_foreign(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Read an open file that can be searched (`path` is for its suffix and for messages).

    Raises InputError where the format is not known, the file is damaged, or it declares more
    cells than are read (`sysid.io.bounds`).
    """
    file.seek(0)
    kind = _kind(path, file)
    file.seek(0)
    if options.transpose and kind not in ("text", "excel"):
        raise input_error(
            path, "is no table of text or Excel, which --transpose is for", "omit --transpose"
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


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS 2 bag's folder."""
    if not path.is_dir():
        return False
    from sysid.io.foreign import rosbag

    return rosbag.is_bag(path)


def read_any(path: Path, what: str, options: ReadOptions) -> ForeignTable:
    """A file, or a ROS 2 bag's folder, by its path; `what` it is, for the error without one.

    Raises InputError as `read_foreign` does, and where there is no such file.
    """
    if is_bag(path):
        return read_bag(path)[0]
    with open_input(path, what) as file:
        return read_foreign(path, file, options)


def read_bag(folder: Path) -> tuple[ForeignTable, str]:
    """A ROS 2 bag, which is a folder, and the SHA-256 of its files one after the other.

    Raises InputError as `read_foreign` does.
    """
    from sysid.io.foreign import rosbag

    with _installed(folder, "rosbag"), contextlib.ExitStack() as opened:
        paths, packing = rosbag.bag_files(folder)
        files = [(path, opened.enter_context(open_input(path, "a bag's file"))) for path in paths]
        table = _with_columns(rosbag.read_files(folder, files, packing))
        return table, sha256_of(*(file for _, file in files))


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


def _kind(path: Path, file: BinaryIO) -> str:
    """Which reader: by the signature at the head of the file, else by the file's name."""
    raw = file.read(_HEAD_BYTES)
    for signature, kind in _SIGNATURES:
        if raw.startswith(signature):
            return kind
    if raw.startswith(_HDF5) or raw[512:520] == _HDF5:
        return "hdf5"
    if raw.startswith(b"PK\x03\x04"):
        return _kind_of_archive(path, file)
    if raw.startswith(_OLE):
        encrypted = _holds(file, "EncryptedPackage".encode("utf-16-le"))
        raise input_error(
            path,
            "is protected by a password" if encrypted else "is an old Excel file (.xls)",
            "save it from Excel without a password" if encrypted else "save it from Excel as .xlsx",
        )
    if raw.startswith(b"\x1f\x8b"):
        raise input_error(path, "is compressed (gzip)", "unpack it with gunzip first")
    is_text = _looks_like_text(raw)
    if is_text and looks_like_json(path, raw):
        return "json_text"
    kind, what = _BY_NAME.get(path.suffix.lower(), ("text", "text"))
    if kind == "text" or (is_text and path.suffix.lower() == ".mat"):
        if not is_text:
            raise input_error(
                path,
                "is a binary file of an unknown format",
                "save it as one of the formats that `sysid convert --help` lists",
            )
        return "text"
    if kind == "matlab":  # version 4 has no signature
        return kind
    raise damaged(path, what, "its first bytes belong to another format")


def _holds(file: BinaryIO, words: bytes) -> bool:
    """Whether a file holds these bytes."""
    file.seek(0)
    end = b""
    while chunk := file.read(1 << 20):
        if words in end + chunk:
            return True
        end = chunk[-len(words) :]
    return False


def _kind_of_archive(path: Path, file: BinaryIO) -> str:
    try:
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError) as error:
        what = "a numpy archive" if path.suffix.lower() == ".npz" else "an Excel workbook"
        raise damaged(path, what, error) from None
    if "xl/workbook.xml" in names:
        return "excel"
    if any(name.endswith(".npy") for name in names) or path.suffix.lower() == ".npz":
        return "arrays"
    raise input_error(path, "is an archive, not an Excel workbook", "unpack it first")


def _looks_like_text(raw: bytes) -> bool:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf")):
        return True
    # Loggers fill files up with zeros.
    return not any(byte < 32 and byte not in b"\t\n\r\f" for byte in raw.rstrip(b"\0"))


__all__ = [
    "ForeignTable",
    "ReadOptions",
    "SampleTimes",
    "is_bag",
    "read_any",
    "read_bag",
    "read_foreign",
]
