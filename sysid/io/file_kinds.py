"""What a file that is no log is: by the first bytes of it, else by its name."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import BinaryIO

from sysid.errors import input_error

_HEAD_BYTES = 4096
_HDF5 = b"\x89HDF\r\n\x1a\n"
_SIGNATURES = (
    (b"\x93NUMPY", "a NumPy array (.npy)"),
    (_HDF5, "an HDF5 file"),
    (b"MATLAB 5.0", "a MATLAB file"),
    (b"TDSm", "a TDMS file (LabVIEW)"),
    (b"MDF     ", "an MDF measurement file"),
    (b"UnFinMF ", "an MDF measurement file"),
    (b"\x89MCAP0\r\n", "an MCAP recording"),
    (b"#ROSBAG V", "a ROS 1 bag"),
    (b"SQLite format 3\0", "a SQLite database (a ROS 2 bag?)"),
    (b"ULog\x01\x12\x35", "a PX4 log (ULog)"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an old Excel workbook (.xls)"),
    (b"\x1f\x8b", "a compressed file (gzip)"),
)
_BUNDLE = b'"schema": "sysid-bundle/'
_JSON = re.compile(rb"\s*[{\[]\s*([\"{\[\d}\]-]|null|true|false)")
_BY_SUFFIX = {
    ".mat": "a MATLAB file",
    ".xlsx": "an Excel workbook",
    ".xls": "an old Excel workbook (.xls)",
    ".tdms": "a TDMS file (LabVIEW)",
}
FOREIGN_SUFFIXES = (
    *_BY_SUFFIX, ".npz", ".npy", ".json", ".jsonl", ".ndjson", ".h5", ".hdf5", ".mf4", ".mdf",
    ".mcap", ".bag", ".db3", ".ulg",
)  # fmt: skip
"""Names of files that are other programs', and are no logs."""


def in_folder(folder: Path, otherwise: str) -> str:
    """What to give in place of a folder: of a ROS 2 bag one of its files, else `otherwise`."""
    if (folder / "metadata.yaml").is_file():
        return "of a ROS 2 bag, give the .db3 or .mcap file in it, or convert the bag first"
    return otherwise


def reject_foreign(path: Path, file: BinaryIO) -> None:
    """InputError that says what an open file is, where it is neither text nor Parquet; the file's
    place is kept."""
    start = file.tell()
    head = file.read(_HEAD_BYTES)
    what = _by_content(head, file) or _BY_SUFFIX.get(path.suffix.lower())
    file.seek(start)
    if what is None:
        return
    if _BUNDLE in head:
        raise input_error(path, "is a fitted bundle, not a log", "give the path of a log")
    if "gzip" in what:
        raise input_error(path, f"is {what}, not a log", "unpack it with gunzip first")
    raise input_error(
        path,
        f"is {what}, not a log",
        f"convert it first: `sysid convert {path.name} -o {_log_name(path)} --map ...`, or map its "
        "columns here (--map; in a campaign file, [map])",
    )


def _log_name(path: Path) -> str:
    """A name for the log that it becomes."""
    return f"{path.stem}{'_log' if path.suffix.lower() == '.csv' else ''}.csv"


def _by_content(head: bytes, file: BinaryIO) -> str | None:
    for signature, what in _SIGNATURES:
        if head.startswith(signature):
            return what
    if head[512:520] == _HDF5:
        return "a MATLAB file (version 7.3)"
    if head.startswith(b"PK\x03\x04"):
        return _archive(file)
    return "JSON" if _JSON.match(head) else None


def _archive(file: BinaryIO) -> str:
    try:
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError):
        return "a damaged archive (zip)"
    if "xl/workbook.xml" in names:
        return "an Excel workbook"
    if names and all(name.endswith(".npy") for name in names):
        return "a NumPy archive (.npz)"
    return "an archive (zip)"


__all__ = ["FOREIGN_SUFFIXES", "reject_foreign"]
