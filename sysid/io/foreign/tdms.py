"""National Instruments' TDMS, by npTDMS."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.errors import input_error
from sysid.io.bounds import Cells, check_columns
from sysid.io.file_kinds import TDMS_HEAD, damaged, read_as
from sysid.io.foreign.table import ForeignTable, ReadOptions, SampleTimes

# A segment's lead-in: tag, flags, version, the bytes up to the next segment and to its raw data.
_LEAD_IN = struct.Struct("<4sIIQQ")


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Channels as `group/channel`, scaled; a waveform's own time base goes to `sampling`.

    Raises InputError where the file is damaged or cut off, or declares more cells than are read.
    """
    import nptdms

    table = ForeignTable(path, "TDMS")
    _check_segments(path, file)
    with read_as(path, "a TDMS file"):
        _check_size(path, nptdms.TdmsFile.read_metadata(file))
        file.seek(0)
        content = nptdms.TdmsFile.read(file)
        incomplete = content.file_status.incomplete_final_segment
        for group in content.groups():
            for channel in group.channels():
                _take(table, f"{group.name}/{channel.name}", channel)
    if incomplete:
        raise input_error(
            path,
            "ends in the middle of a segment: it was cut off",
            "copy it again, or open it in NI's software and save it again",
        )
    return table


def _check_segments(path: Path, file: BinaryIO) -> None:
    """InputError where the segments, each of which states its length, do not follow one another.

    npTDMS stops there without a word.
    """
    from nptdms.common import toc_properties

    size, at = file.seek(0, os.SEEK_END), 0
    while at < size:
        file.seek(at)
        head = file.read(_LEAD_IN.size)
        if not head.startswith(TDMS_HEAD):
            raise damaged(path, "a TDMS file", f"no segment begins at byte {at:,}")
        if len(head) < _LEAD_IN.size:
            break
        sign = ">" if head[4] & toc_properties["kTocBigEndian"] else "<"
        at += _LEAD_IN.size + int(struct.unpack(f"{sign}Q", head[12:20])[0])
    file.seek(0)


def _check_size(path: Path, content: Any) -> None:
    cells = Cells(path)
    channels = [channel for group in content.groups() for channel in group.channels()]
    check_columns(path, len(channels))
    for channel in channels:
        cells.add(len(channel), f"channel {channel.group_name}/{channel.name}")


def _take(table: ForeignTable, name: str, channel: Any) -> None:
    values = np.asarray(channel[:])
    if len(values) == 0:
        table.skipped[name] = "empty"
        return
    table.columns[name] = values
    unit = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
    if isinstance(unit, str) and unit.strip():
        table.units[name] = unit.strip()
    period = channel.properties.get("wf_increment")
    if isinstance(period, float | int | np.number) and np.isfinite(period) and period > 0:
        start = channel.properties.get("wf_start_offset", 0.0)
        table.sampling[name] = SampleTimes(float(period), float(start))
