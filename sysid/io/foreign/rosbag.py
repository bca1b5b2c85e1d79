"""ROS 1 bags, and ROS 2 bags of SQLite (`.db3`), by rosbags; a ROS 2 bag is a folder of files.

The files of a ROS 2 bag are read by themselves, in the order that its `metadata.yaml` gives.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

from sysid.errors import InputError, input_error
from sysid.io.bounds import check_length, chunks
from sysid.io.file_kinds import BAG_METADATA, BAG_SUFFIXES, SQLITE_HEAD, damaged, read_as
from sysid.io.foreign import mcap
from sysid.io.foreign.messages import Messages
from sysid.io.foreign.ros_types import Decoder, ros_decoder
from sysid.io.foreign.table import ForeignTable, ReadOptions
from sysid.io.foreign.unpacking import unpacked

_ZSTD = b"\x28\xb5\x2f\xfd"
_TABLES = ("messages", "topics", "schema", "message_definitions", "metadata")


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """A ROS 1 bag, or one SQLite file of a ROS 2 bag (see `sysid.io.foreign.messages`).

    Raises InputError where it is damaged or not indexed, or holds more cells than are read.
    """
    is_first = file.read(1) == b"#"
    file.seek(0)
    table = ForeignTable(path, "ROS 1 bag" if is_first else "ROS 2 bag")
    messages = Messages(table)
    if is_first:
        _read_first(messages, path, file)
    else:
        _read_second(table, messages, path, file, None)
    messages.finish()
    return table


# --- ROS 1 ---------------------------------------------------------------------------------


class _Kept:
    """An open file in place of a path, for a library that opens and closes what it reads."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def exists(self) -> bool:
        """Whether the file exists."""
        return True

    def open(self, mode: str) -> Any:
        """The open file, from its start; closing it leaves it open."""
        self._file.seek(0)
        return _Open(self._file)


class _Open:
    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = file.seek(0, os.SEEK_END)
        file.seek(0)
        self.seek, self.tell, self.readline = file.seek, file.tell, file.readline

    def read(self, count: int) -> bytes:
        return self._file.read(min(count, self._size))

    def close(self) -> None:
        pass


def _read_first(messages: Messages, path: Path, file: BinaryIO) -> None:
    from rosbags.rosbag1 import Reader

    source: Any = _Kept(file)
    try:
        with Reader(source) as bag:
            for pos, chunk in bag.chunks.items():
                how = chunk.decompressor.__module__.partition(".")[0]
                unpack = partial(_chunk, path, how if how in ("bz2", "_bz2", "lz4") else "")
                bag.chunks[pos] = chunk._replace(decompressor=unpack)
            _take_all(messages, bag, is_cdr=False)
    except (InputError, ModuleNotFoundError):
        raise
    except Exception as error:  # rosbags passes on what struct, bz2, lz4 and asserts raise
        again = f"run `rosbag reindex {path.name}`"
        if "not indexed" in str(error):
            raise input_error(path, "has no index (the recorder was stopped)", again) from None
        fix = f"{again}, or copy it again from where it was recorded"
        raise damaged(path, "a ROS 1 bag", error, fix) from None


def _take_all(
    messages: Messages,
    bag: Any,
    *,
    is_cdr: bool,
    unpack: Callable[[bytes], bytes] = lambda data: data,
) -> None:
    """Decode all messages of a bag of rosbags whose definitions are known."""
    decoders = {
        known.id: messages.decoder_of(known.topic, "ROS", partial(_decoder, known, is_cdr))
        for known in bag.connections
    }
    read = [known for known in bag.connections if decoders[known.id] is not None]
    for known, logged, data in bag.messages(read) if read else ():
        messages.decode(known.topic, decoders[known.id], unpack(data), logged)


def _chunk(path: Path, how: str, packed: bytes) -> bytes:
    return unpacked(path, "a chunk", packed, how.lstrip("_"), None)


def _decoder(known: Any, is_cdr: bool) -> Decoder:
    encoding = {1: "ros2msg", 2: "ros2idl"}.get(int(known.msgdef.format.value), "")
    return ros_decoder(known.msgtype, known.msgdef.data, encoding, is_cdr=is_cdr)


# --- ROS 2 ---------------------------------------------------------------------------------


def _read_second(
    table: ForeignTable, messages: Messages, path: Path, file: BinaryIO, packed: str | None
) -> None:
    """A SQLite file's messages; `packed` is how each is packed, None: not at all."""
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    waiting = path.with_name(f"{path.name}-wal")
    if waiting.is_file() and waiting.stat().st_size:
        table.notices.append(
            f"{path}: {waiting.name} holds messages that are not in it yet and are omitted "
            f"(to include them: sqlite3 {path.name} 'PRAGMA wal_checkpoint')"
        )
    with read_as(path, "a ROS 2 bag"), _named(path, file) as name:
        _check_tables(path, name)
        # The library makes a URI of the path.
        bag = Sqlite3Reader(Path(quote(str(name))))
        bag.open()
        try:
            _take_all(messages, bag, is_cdr=True, unpack=partial(_message, path, packed))
        finally:
            bag.close()


def _message(path: Path, packed: str | None, data: bytes) -> bytes:
    # A message begins with its encapsulation header; a packed one does not.
    how = "zstd" if data[: len(_ZSTD)] == _ZSTD else packed
    return data if how is None else unpacked(path, "a message", data, how, None)


@contextmanager
def _named(path: Path, file: BinaryIO) -> Iterator[Path]:
    """A path under which SQLite opens the file: its own, or a copy's of what has none."""
    if getattr(file, "name", None) == str(path):
        yield path.absolute()
        return
    with tempfile.TemporaryDirectory(prefix="sysid-") as folder:
        copy = Path(folder) / "bag.db3"
        with copy.open("wb") as whole:
            shutil.copyfileobj(file, whole)
        yield copy


def _check_tables(path: Path, name: Path) -> None:
    """InputError where a table of a bag is missing, or is computed: it might have no end."""
    opened = sqlite3.connect(f"file:{quote(str(name))}?mode=ro&immutable=1", uri=True)
    try:
        kinds = dict(opened.execute("SELECT name, type FROM sqlite_master").fetchall())
        for table in _TABLES:
            if table not in kinds:
                continue
            columns = opened.execute(f"PRAGMA table_xinfo({table})").fetchall()
            if kinds[table] != "table" or any(column[6] for column in columns):
                raise input_error(path, f"its {table} are computed, not stored", "record it again")
    finally:
        opened.close()
    if not {"messages", "topics"} <= set(kinds):
        raise input_error(
            path, "is an SQLite file, not a ROS 2 bag", "export the table that is needed as CSV"
        )


@contextmanager
def _plain(path: Path, packed: BinaryIO, packing: Packing) -> Iterator[BinaryIO]:
    """A file of a bag, unpacked where it is packed as a whole."""
    if packing.mode != "file":
        yield packed
        return
    if packing.how != "zstd":
        raise input_error(path, f"is packed by {packing.how!r}", "unpack it, and reindex the bag")
    import zstandard

    with tempfile.TemporaryFile() as plain:
        try:
            with zstandard.ZstdDecompressor().stream_reader(packed, closefd=False) as stream:
                for chunk in chunks(stream):
                    check_length(path, plain.tell() + len(chunk))
                    plain.write(chunk)
        except zstandard.ZstdError as error:
            raise damaged(path, "packed by zstd", error) from None
        plain.seek(0)
        yield plain


@dataclass(frozen=True)
class Packing:
    """What of a ROS 2 bag is packed ("file", "message", else nothing), and how ("zstd")."""

    mode: str = ""
    how: str = ""


def bag_files(folder: Path) -> tuple[list[Path], Packing]:
    """The files of a ROS 2 bag in their order, and how they are packed.

    Raises InputError where `metadata.yaml` is damaged, or names a file that is missing.
    """
    about = folder / BAG_METADATA
    if not about.is_file():
        return _files_in(folder), Packing()
    try:
        if about.stat().st_size > 1 << 24:
            raise ValueError("it is too long")
        from ruamel.yaml import YAML

        content = YAML(typ="safe").load(about.read_text("utf-8"))["rosbag2_bagfile_information"]
        names = [Path(str(name)).name for name in content["relative_file_paths"]]
        how = str(content.get("compression_format") or "zstd")
        mode = str(content.get("compression_mode") or "").lower()
    except ModuleNotFoundError:
        raise
    except Exception as error:  # YAML's parser raises errors of its own
        raise damaged(about, "the description of a ROS 2 bag", error) from None
    paths = [folder / name for name in names]
    for path in paths:
        if not path.is_file():
            raise input_error(about, f"{path.name} is missing", "copy the whole folder again")
    return paths, Packing(mode, how)


def _files_in(folder: Path) -> list[Path]:
    return sorted(
        path for path in folder.iterdir() if path.suffix in BAG_SUFFIXES and path.is_file()
    )


def read_files(folder: Path, files: list[tuple[Path, BinaryIO]], packing: Packing) -> ForeignTable:
    """The messages of a ROS 2 bag's files (see `bag_files`). Raises InputError as `read` does."""
    table = ForeignTable(folder, "ROS 2 bag")
    messages = Messages(table)
    if not (folder / BAG_METADATA).is_file():
        table.notices.append(
            f"{folder}: it has no {BAG_METADATA} (the recorder was stopped): its files are read by "
            "their names"
        )
    for path, packed in files:
        with _plain(path, packed, packing) as file:
            head = file.read(len(SQLITE_HEAD))
            file.seek(0)
            if head == SQLITE_HEAD:
                each = packing.how if packing.mode == "message" else None
                _read_second(table, messages, path, file, each)
            else:
                mcap.read_into(table, messages, path, file)
    messages.finish()
    return table


__all__ = ["Packing", "bag_files", "read", "read_files"]
