"""What a file is, by the first bytes of it, else by its name; and which reader reads it."""

from __future__ import annotations

import codecs
import re
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

from sysid.errors import InputError, input_error

HEAD_BYTES = 4096
BAG_METADATA, BAG_SUFFIXES = "metadata.yaml", (".db3", ".mcap")


class FileKind(NamedTuple):
    """`what` a file is, in words, and the module of `sysid.io.foreign` that reads it ("": none);
    `fix`: what to do with a file that none reads."""

    what: str
    reader: str = ""
    fix: str = "unpack it first"


OLD_EXCEL = FileKind("an old Excel workbook (.xls)")
GZIP = FileKind("a compressed file (gzip)", fix="unpack it with gunzip first")
ARCHIVE = FileKind("an archive (zip)")
DAMAGED_ARCHIVE = FileKind("a damaged archive (zip)")
_ARRAY = FileKind("a NumPy array (.npy)", "arrays")
_ARRAYS = FileKind("a NumPy archive (.npz)", "arrays")
_EXCEL = FileKind("an Excel workbook", "excel")
_HDF5 = FileKind("an HDF5 file", "hdf5")
_JSON = FileKind("JSON", "json_text")
_MATLAB = FileKind("a MATLAB file", "matlab")
_MATLAB_7_3 = FileKind("a MATLAB file (version 7.3)", "hdf5")
_MCAP = FileKind("an MCAP recording", "mcap")
_MDF = FileKind("an MDF measurement file", "mdf")
_PARQUET = FileKind("Parquet", "parquet")
_ROS_1 = FileKind("a ROS 1 bag", "rosbag")
_ROS_2 = FileKind("a SQLite database (a ROS 2 bag?)", "rosbag")
_TDMS = FileKind("a TDMS file (LabVIEW)", "tdms")
_ULOG = FileKind("a PX4 log (ULog)", "ulog")

NUMPY_HEAD, PARQUET_HEAD, TDMS_HEAD = b"\x93NUMPY", b"PAR1", b"TDSm"
SQLITE_HEAD = b"SQLite format 3\0"
# Bytes that a program may put before an HDF5 file; MATLAB's are 512.
_USER_BLOCKS = (512, 1024, 2048)
_HDF5_HEAD = b"\x89HDF\r\n\x1a\n"
_OTHER_FILE = "give the recording itself"
_SIGNATURES = (
    (TDMS_HEAD, _TDMS),
    (PARQUET_HEAD, _PARQUET),
    (b"MATLAB 5.0", _MATLAB),
    (b"MDF     ", _MDF),
    (b"UnFinMF ", _MDF),
    (b"\x89MCAP", _MCAP),
    (b"#ROSBAG V", _ROS_1),
    (SQLITE_HEAD, _ROS_2),
    (b"ULog\x01\x12\x35", _ULOG),
    (NUMPY_HEAD, _ARRAY),
    (_HDF5_HEAD, _HDF5),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", OLD_EXCEL),
    (b"\x1f\x8b", GZIP),
    (b"BZh", FileKind("a compressed file (bzip2)", fix="unpack it with bunzip2 first")),
    (b"\xfd7zXZ\0", FileKind("a compressed file (xz)", fix="unpack it with unxz first")),
    (b"\x28\xb5\x2f\xfd", FileKind("a compressed file (zstd)", fix="unpack it with unzstd first")),
    (b"7z\xbc\xaf\x27\x1c", FileKind("an archive (7z)")),
    (b"Rar!\x1a\x07", FileKind("an archive (rar)")),
    (b"ARROW1\0\0", FileKind("an Arrow file (Feather)", fix="save it as Parquet")),
    (b"PARE", FileKind("an encrypted Parquet file", fix="save it without encryption")),
    (b"\x80\x04\x95", FileKind("a Python pickle", fix="save it as Parquet or CSV")),
    (b"\x80\x05\x95", FileKind("a Python pickle", fix="save it as Parquet or CSV")),
    (b"%PDF-", FileKind("a PDF document", fix=_OTHER_FILE)),
    (b"\x89PNG", FileKind("a picture (PNG)", fix=_OTHER_FILE)),
    (b"\xff\xd8\xff", FileKind("a picture (JPEG)", fix=_OTHER_FILE)),
    (
        b"version https://git-lfs",
        FileKind("a pointer of Git LFS in place of the file", fix="fetch it: git lfs pull"),
    ),
    (
        b"# Created by Octave",
        FileKind("a text file of Octave", fix="save it in Octave with save -v7 FILE.mat"),
    ),
)
# Of text that is no table, whatever its capitals and what stands above it.
_MARKUP = (
    (
        re.compile(rb"\s*(?:<!--.*?-->\s*)?<(?:!doctype html|html|table)\b", re.I | re.S),
        FileKind(
            "a web page (HTML)", fix="download the file itself, or save it from Excel as .xlsx"
        ),
    ),
    (re.compile(rb"\s*<\?xml\b", re.I), FileKind("an XML file", fix="export it as CSV")),
)
_BY_SUFFIX = {
    ".mat": _MATLAB,
    ".xlsx": _EXCEL,
    ".xlsm": _EXCEL,
    ".xls": OLD_EXCEL,
    ".tdms": _TDMS,
    ".npz": _ARRAYS,
    ".npy": _ARRAY,
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mf4": _MDF,
    ".mdf": _MDF,
    ".mcap": _MCAP,
    ".bag": _ROS_1,
    ".db3": _ROS_2,
    ".ulg": _ULOG,
}
_JSON_SUFFIXES = (".json", ".jsonl", ".ndjson")
FOREIGN_SUFFIXES = (*_BY_SUFFIX, *_JSON_SUFFIXES)
"""Names of files that are other programs', and are no logs."""
PARQUET_SUFFIXES = (".parquet", ".pq")
_JSON_HEAD = re.compile(rb"\s*(?:\{\s*[\"}]|\[\s*[\[{])")
_BUNDLE = b'"schema": "sysid-bundle/'


def damaged(
    path: Path,
    what: str,
    error: BaseException | str,
    fix: str = "copy it again from where it was recorded",
) -> InputError:
    """The error for a file that its own library cannot read."""
    reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:120]
    return input_error(path, f"is damaged or not {what} ({reason})", fix)


@contextmanager
def read_as(
    path: Path, what: str, fix: str = "", passing: type[Exception] = InputError
) -> Iterator[None]:
    """Whatever a format's library raises in the block means that the file is `damaged`.

    Libraries pass on what numpy, struct, zlib and their other codecs raise. InputError passes, and
    so do `passing` and what says that a library is not installed.
    """
    try:
        yield
    except (InputError, ModuleNotFoundError, passing):
        raise
    except Exception as error:
        raise damaged(path, what, error, *filter(None, [fix])) from None


def decoded(path: Path, raw: bytes, encoding: str = "utf-8") -> str:
    """A file's bytes as text; InputError that names the line where they are not text."""
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise input_error(f"{path}, line {line}", "is not UTF-8 text", "save it as UTF-8") from None


def wide_encoding(head: bytes) -> str | None:
    """The encoding of text whose signs are of two or four bytes each, by its mark or, without one,
    by the zeros of plain signs; None of another."""
    for mark, name in ((codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32")):
        if head.startswith(mark):
            return name
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    first, second = head[:HEAD_BYTES:2], head[1:HEAD_BYTES:2]
    for name, signs, zeros in (("utf-16-le", first, second), ("utf-16-be", second, first)):
        plain = sum(sign > 0 and zero == 0 for sign, zero in zip(signs, zeros, strict=False))
        if len(zeros) > 1 and 0 not in signs and 10 * plain > 9 * len(zeros):
            return name
    return None


def kind_by_content(path: Path, file: BinaryIO) -> FileKind | None:
    """The kind of a file by its first bytes; None for text, and for files without a signature.

    The file's place is kept.
    """
    start = file.tell()
    head = file.read(HEAD_BYTES)
    try:
        for signature, kind in _SIGNATURES:
            if head.startswith(signature):
                return kind
        for before in _USER_BLOCKS:
            if head.startswith(_HDF5_HEAD, before):
                return _MATLAB_7_3 if before == _USER_BLOCKS[0] else _HDF5
        for pattern, kind in _MARKUP:
            if pattern.match(head.removeprefix(codecs.BOM_UTF8)):
                return kind
        if head.startswith(b"PK\x03\x04"):
            return _kind_of_archive(path, file)
        return _JSON if _looks_like_json(path, head) else None
    finally:
        file.seek(start)


def kind_by_name(path: Path) -> FileKind | None:
    """The kind of a file by its suffix; None for those of text files."""
    suffix = path.suffix.lower()
    return _PARQUET if suffix in PARQUET_SUFFIXES else _BY_SUFFIX.get(suffix)


def _kind_of_archive(path: Path, file: BinaryIO) -> FileKind:
    try:
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError):
        return DAMAGED_ARCHIVE
    if "xl/workbook.xml" in names:
        return _EXCEL
    is_named = path.suffix.lower() == ".npz"
    return _ARRAYS if is_named or any(n.endswith(".npy") for n in names) else ARCHIVE


def _looks_like_json(path: Path, head: bytes) -> bool:
    if b"\0" in head:
        return False
    text = head.removeprefix(b"\xef\xbb\xbf")
    named = path.suffix.lower() in _JSON_SUFFIXES and text.lstrip()[:1] in (b"{", b"[")
    return named or _JSON_HEAD.match(text) is not None


def is_bag(path: Path) -> bool:
    """Whether a path is the folder of a ROS 2 bag."""
    if not path.is_dir():
        return False
    return (path / BAG_METADATA).is_file() or any(
        one.suffix in BAG_SUFFIXES and one.is_file() for one in path.iterdir()
    )


def reject_bag(path: Path) -> None:
    """InputError where a path is the folder of a ROS 2 bag."""
    if is_bag(path):
        raise _is_no_log(path, "a ROS 2 bag")


def reject_foreign(path: Path, file: BinaryIO) -> None:
    """InputError that says what an open file is, where it is neither text nor Parquet; the file's
    place is kept."""
    kind = kind_by_content(path, file) or kind_by_name(path)
    if kind is None or kind == _PARQUET:
        return
    start = file.tell()
    is_bundle = _BUNDLE in file.read(HEAD_BYTES)
    file.seek(start)
    if is_bundle:
        raise input_error(path, "is a fitted bundle, not a log", "give the path of a log")
    if not kind.reader and kind not in (OLD_EXCEL, DAMAGED_ARCHIVE):
        raise input_error(path, f"is {kind.what}, not a log", kind.fix)
    raise _is_no_log(path, kind.what)


def _is_no_log(path: Path, what: str) -> InputError:
    return input_error(
        path,
        f"is {what}, not a log",
        f"convert it first: `sysid convert {path.name} -o {_log_name(path)} --map ...`, or map its "
        "columns here (--map; in a campaign file, [map])",
    )


def _log_name(path: Path) -> str:
    """A name for the log that it becomes."""
    return f"{path.stem}{'_log' if path.suffix.lower() == '.csv' else ''}.csv"


__all__ = [
    "ARCHIVE",
    "BAG_METADATA",
    "BAG_SUFFIXES",
    "DAMAGED_ARCHIVE",
    "FOREIGN_SUFFIXES",
    "GZIP",
    "HEAD_BYTES",
    "NUMPY_HEAD",
    "OLD_EXCEL",
    "PARQUET_HEAD",
    "PARQUET_SUFFIXES",
    "SQLITE_HEAD",
    "TDMS_HEAD",
    "FileKind",
    "damaged",
    "decoded",
    "is_bag",
    "kind_by_content",
    "kind_by_name",
    "read_as",
    "reject_bag",
    "reject_foreign",
    "wide_encoding",
]
