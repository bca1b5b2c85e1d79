"""PX4's ULog, by pyulog."""

from __future__ import annotations

import contextlib
import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.io.bounds import MOST_DEPTH, Cells, check_columns
from sysid.io.file_kinds import read_as
from sysid.io.foreign.table import ForeignTable, ReadOptions

# The head of a message: its size and kind.
_HEAD = struct.Struct("<HB")


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Fields as `topic.field`, of a further instance as `topic[1].field`; the clock is `timestamp`.

    Times count from the first message. Raises InputError where the file is damaged, or declares
    more columns or cells than are read.
    """
    from pyulog import ULog

    with read_as(path, "a ULog file"):
        # pyulog prints what it finds damaged.
        with contextlib.redirect_stdout(io.StringIO()):
            _check_formats(path, ULog(_Reading(file), parse_header_only=True).message_formats)
            file.seek(0)
            whole = _Reading(file)
            content = ULog(whole)
        table = _table(path, content)
    if content.file_corruption:
        table.notices.append(f"{path}: parts of it are damaged; their messages are omitted")
    elif whole.is_cut:
        rows = max(map(len, table.columns.values()), default=0)
        table.notices.append(
            f"{path}: ends within a message: the recording was cut off after {rows} rows"
        )
    if lost := sum(dropout.duration for dropout in content.dropouts):
        table.notices.append(
            f"{path}: the logger lost messages {len(content.dropouts)} times, for {lost} ms in all"
        )
    return table


@dataclass
class _Reading:
    """A file that stays open. `is_cut`: the last message, of head and content, is not whole."""

    file: BinaryIO
    is_cut: bool = False

    def read(self, size: int = -1) -> bytes:
        data = self.file.read(size)
        is_end = not data and size == _HEAD.size
        self.is_cut = len(data) < size and not is_end
        return data

    def seek(self, place: int, whence: int = 0) -> int:
        return self.file.seek(place, whence)

    def tell(self) -> int:
        return self.file.tell()

    def close(self) -> None:
        """pyulog closes what it is given."""


def _check_formats(path: Path, formats: dict[str, Any]) -> None:
    """InputError where a message, with all that is nested in it, has too many fields."""
    known: dict[str, int] = {}

    def width(name: str, depth: int) -> int:
        if name in known or name not in formats:
            return known.get(name, 1)
        if depth > MOST_DEPTH:
            raise ValueError(f"messages {name!r} are nested too deep")
        fields = formats[name].fields
        found = sum(max(int(n), 1) * width(kind, depth + 1) for kind, n, _ in fields)
        check_columns(path, found)
        known[name] = found
        return found

    for name in formats:
        width(name, 0)


def _table(path: Path, content: Any) -> ForeignTable:
    table, cells = ForeignTable(path, "ULog"), Cells(path)
    timed = {id(topic) for topic in content.data_list if "timestamp" in topic.data}
    begun = min((_first(topic) for topic in content.data_list if id(topic) in timed), default=0)
    unset = 0
    check_columns(path, sum(len(topic.field_data) for topic in content.data_list))
    for topic in content.data_list:
        name = topic.name if topic.multi_id == 0 else f"{topic.name}[{topic.multi_id}]"
        if id(topic) not in timed:
            table.skipped[name] = "it has no timestamp"
            continue
        stamps = topic.data["timestamp"]
        is_set = stamps != 0
        unset += int(np.sum(~is_set))
        clock = (stamps[is_set].astype(np.int64) - begun) / 1e6  # from us
        if not len(clock):
            table.skipped[name] = "its timestamp is not set"
            continue
        for field in topic.field_data:
            full = f"{name}.{field.field_name}"
            if field.type_str == "char":
                table.skipped[full] = "text"
                continue
            cells.add(len(clock), f"topic {name}")
            table.columns[full] = topic.data[field.field_name][is_set]
            table.clocks[full] = clock
        table.units[f"{name}.timestamp"] = "us"
    if unset:
        table.notices.append(f"{path}: {unset} messages have no timestamp and are omitted")
    return table


def _first(topic: Any) -> int:
    """The first timestamp of a topic that is set, us."""
    stamps = topic.data["timestamp"]
    return int(np.min(stamps, where=stamps != 0, initial=np.iinfo(np.int64).max))


__all__ = ["read"]
