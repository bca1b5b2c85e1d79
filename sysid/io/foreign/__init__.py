"""Readers of foreign files, one per format; `read_foreign` picks by content, not by name.

Each returns a `ForeignTable` in the file's own names and units; `sysid.io.conversion` maps it.
"""

from __future__ import annotations

import csv
import importlib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from sysid.errors import input_error
from sysid.io.foreign.table import ForeignTable, ReadOptions, SampleTimes, damaged

Reader = Callable[[Path, BinaryIO, ReadOptions], ForeignTable]

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
    module = importlib.import_module(f"sysid.io.foreign.{kind}")
    reader: Reader = module.read
    try:
        table = reader(path, file, options)
    except csv.Error as error:
        raise input_error(
            path, f"cannot be read as text ({error})", "export fewer columns, or another format"
        ) from None
    if not any(len(values) for values in table.columns.values()):
        raise input_error(path, f"holds no columns ({table.format})", "give another file")
    return table


def _kind(path: Path, file: BinaryIO) -> str:
    """Which reader: by the signature at the head of the file, else by the file's name."""
    raw = file.read(_HEAD_BYTES)
    if raw.startswith(b"TDSm"):
        return "tdms"
    if raw.startswith(b"PAR1"):
        return "parquet"
    if raw.startswith(b"MATLAB 5.0"):
        return "matlab"
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
    kind, what = _BY_NAME.get(path.suffix.lower(), ("text", "text"))
    if kind == "text" or (is_text and path.suffix.lower() == ".mat"):
        if not is_text:
            raise input_error(
                path,
                "is a binary file of an unknown format",
                "save it as .mat, .xlsx, .tdms, Parquet or text",
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
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise damaged(path, "an Excel workbook", error) from None
    if "xl/workbook.xml" in names:
        return "excel"
    raise input_error(path, "is an archive, not an Excel workbook", "unpack it first")


def _looks_like_text(raw: bytes) -> bool:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf")):
        return True
    # Loggers fill files up with zeros.
    return not any(byte < 32 and byte not in b"\t\n\r\f" for byte in raw.rstrip(b"\0"))


__all__ = ["ForeignTable", "ReadOptions", "SampleTimes", "read_foreign"]
