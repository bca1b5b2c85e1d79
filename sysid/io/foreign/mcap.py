"""MCAP (https://mcap.dev/spec), by the mcap library; ROS messages by rosbags, protobuf by its own.

The file is read from its start, without its index, so that what a recorder wrote before it was
stopped is read too.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from sysid.errors import input_error
from sysid.io.bounds import MOST_DEPTH
from sysid.io.file_kinds import read_as
from sysid.io.foreign.messages import Messages
from sysid.io.foreign.ros_types import Decoder, ros_decoder
from sysid.io.foreign.table import ForeignTable, ReadOptions
from sysid.io.foreign.unpacking import unpacked

_MAGIC = b"\x89MCAP0\r\n"
_RECOVER = "run `mcap recover`, or copy it again from where it was recorded"


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Fields of messages as `sysid.io.foreign.messages` names them, topics of one file together.

    Raises InputError where the file is damaged, holds nothing that can be decoded, or more cells
    than are read.
    """
    table = ForeignTable(path, "MCAP")
    messages = Messages(table)
    read_into(table, messages, path, file)
    messages.finish()
    return table


def read_into(table: ForeignTable, messages: Messages, path: Path, file: BinaryIO) -> None:
    """Add a file's messages, and to the table's notices and `skipped` what is not read."""
    from mcap.exceptions import EndOfFile

    content = _Content(messages)
    before = len(messages)
    try:
        with read_as(path, "an MCAP file", _RECOVER, passing=EndOfFile):
            for record in _records(path, file):
                content.take(record)
    except EndOfFile:
        found = len(messages) - before
        if not found:
            raise input_error(
                path, "ends before its first message", "run `mcap recover`, or record it again"
            ) from None
        table.notices.append(
            f"{path}: it was cut off (the recorder was stopped): the {found:,} messages up to "
            "there are read"
        )


class _Exactly:
    """Reads a file as the library asks, but never less: EndOfFile where the file is cut off."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._size = file, file.seek(0, os.SEEK_END)
        file.seek(max(0, self._size - len(_MAGIC)))
        self._is_whole = self._size > 2 * len(_MAGIC) and file.read() == _MAGIC
        file.seek(0)

    def read(self, count: int) -> bytes:
        """The next `count` bytes."""
        from mcap.exceptions import EndOfFile

        if count < 0 or (count > self._size - self._file.tell() and self._is_whole):
            raise ValueError("a record is longer than the file")
        if count > self._size - self._file.tell():
            raise EndOfFile
        return self._file.read(count)


def _records(path: Path, file: BinaryIO) -> Iterator[Any]:
    """The records of a file, those of its chunks among them; EndOfFile where it is cut off."""
    from mcap.exceptions import EndOfFile
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    source: Any = _Exactly(file)
    reader = StreamReader(source, emit_chunks=True, validate_crcs=True, record_size_limit=None)
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        data = unpacked(path, "a chunk", record.data, record.compression, record.uncompressed_size)
        if record.uncompressed_crc and zlib.crc32(data) != record.uncompressed_crc:
            raise ValueError("a chunk's check sum is wrong")
        record.data, record.compression = data, ""
        try:
            yield from breakup_chunk(record)
        except EndOfFile:
            raise ValueError("a chunk ends within a record") from None


class _Content:
    """Takes the records of a file: schemas, channels, and messages as the channels encode them."""

    def __init__(self, messages: Messages) -> None:
        self._messages = messages
        self._schemas: dict[int, Any] = {}
        self._topics: dict[int, tuple[str, Decoder | None]] = {}

    def take(self, record: Any) -> None:
        """The next record."""
        from mcap.records import Channel, Message, Schema

        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            if record.id not in self._topics:
                make = partial(_decoder_of, record, self._schemas.get(record.schema_id))
                decode = self._messages.decoder_of(record.topic, record.message_encoding, make)
                self._topics[record.id] = record.topic, decode
        elif isinstance(record, Message):
            topic, decode = self._topics[record.channel_id]
            self._messages.decode(topic, decode, record.data, record.log_time)


def _decoder_of(channel: Any, schema: Any) -> Decoder:
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding == "protobuf":
        return _protobuf(schema)
    if encoding in ("cdr", "ros1") and schema is not None:
        text = schema.data.decode("utf-8")
        return ros_decoder(schema.name, text, schema.encoding, is_cdr=encoding == "cdr")
    raise ValueError(f"encoded as {encoding!r}; JSON, ROS and protobuf are read")


def _protobuf(schema: Any) -> Decoder:
    """Messages as mappings, by the descriptors that the file holds."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return lambda data: _fields(kind.FromString(data), 0)


def _is_repeated(about: Any) -> bool:
    found = getattr(about, "is_repeated", None)  # protobuf before 6 has only the label
    return bool(about.label == about.LABEL_REPEATED if found is None else found)


def _fields(message: Any, depth: int) -> dict[str, Any]:
    """A protobuf message's fields by name; those that are not set have their default."""
    found: dict[str, Any] = {}
    if depth > MOST_DEPTH:
        return found
    for about in message.DESCRIPTOR.fields:
        value = getattr(message, about.name)
        if _is_repeated(about):
            if about.message_type is None:
                found[about.name] = list(value)
            elif not about.message_type.GetOptions().map_entry:
                found[about.name] = [_fields(part, depth + 1) for part in value]
        elif about.message_type is None:
            found[about.name] = value
        elif message.HasField(about.name):
            found[about.name] = _fields(value, depth + 1)
    return found
