"""National Instruments' TDMS, by npTDMS."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.errors import InputError, input_error
from sysid.io.bounds import Cells, check_columns
from sysid.io.foreign.table import ForeignTable, ReadOptions, SampleTimes, damaged


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Channels as `group/channel`, scaled; a waveform's own time base goes to `sampling`.

    Raises InputError where the file is damaged or cut off, or declares more cells than are read.
    """
    import nptdms

    table = ForeignTable(path, "TDMS")
    try:
        _check_size(path, nptdms.TdmsFile.read_metadata(file))
        file.seek(0)
        content = nptdms.TdmsFile.read(file)
        incomplete = content.file_status.incomplete_final_segment
        for group in content.groups():
            for channel in group.channels():
                _take(table, f"{group.name}/{channel.name}", channel)
    except InputError:
        raise
    except Exception as error:  # npTDMS passes on what numpy and struct raise
        raise damaged(path, "a TDMS file", error) from None
    if incomplete:
        raise input_error(
            path,
            "ends in the middle of a segment: it was cut off",
            "copy it again, or open it in NI's software and save it again",
        )
    return table


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
