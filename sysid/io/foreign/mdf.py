"""ASAM's MDF, versions 3 and 4 (`.mf4`, `.mdf`, `.dat`), by asammdf."""

from __future__ import annotations

import contextlib
import gc
import io
import logging
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.errors import InputError, some_of
from sysid.io.file_kinds import damaged
from sysid.io.foreign.mdf_size import check_size
from sysid.io.foreign.table import ForeignTable, ReadOptions


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Every channel by its name, as `group/name` where groups share one; masters are clocks.

    Conversions of the file are applied, those to text not. Samples that the file marks as
    invalid are skipped, with a notice. Raises InputError where the file is damaged, or declares
    more cells than are read.
    """
    table = ForeignTable(path, "MDF")
    failed: InputError | None = None
    with _silent():
        try:
            check_size(path, file)
            file.seek(0)
            _take_all(table, path, file)
        except (InputError, ModuleNotFoundError):
            raise
        except Exception as error:  # asammdf passes on what numpy, struct and codecs raise
            failed = damaged(path, "an MDF file", error)
        if failed is not None:
            gc.collect()  # asammdf fails once more where what it did not load ends
    if failed is not None:
        raise failed
    return table


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Without what asammdf logs and prints; what it finds wrong is raised."""
    logger = logging.getLogger("asammdf")
    before, logger.disabled = logger.disabled, True
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.disabled, sys.unraisablehook = before, hook


def _take_all(table: ForeignTable, path: Path, file: BinaryIO) -> None:
    import asammdf

    load: Any = asammdf.MDF
    source: Any = io.BytesIO(file.read())  # what is given is closed, and may be written to
    with load(source, process_bus_logging=False) as content:
        table.format = f"MDF {content.version}"
        _set_origin(table, content)
        names, is_four = _names(content), content.version >= "4"
        lost: list[str] = []
        for number, group in enumerate(content.groups):
            wanted = [
                (None, number, index)
                for index, channel in enumerate(group.channels)
                if _is_wanted(table, names[number, index], channel, is_four)
            ]
            if not wanted or not group.channel_group.cycles_nr:
                for _, _, index in wanted:
                    table.skipped[names[number, index]] = "empty"
                continue
            signals = content.select(
                wanted, copy_master=False, ignore_value2text_conversions=True, validate=False
            )
            clocked = _is_time(content, number)
            for (_, _, index), signal in zip(wanted, signals, strict=True):
                _take(table, names[number, index], signal, clocked, lost)
    if lost:
        table.notices.append(
            f"{path}: samples that the file marks as invalid are omitted: "
            + some_of(lost, 8, counted=False)
        )


def _set_origin(table: ForeignTable, content: Any) -> None:
    import pandas as pd

    stamp = pd.Timestamp(content.start_time)
    if stamp.year > 1980:  # else its writer set none
        table.origin = stamp.tz_localize("UTC") if stamp.tz is None else stamp.tz_convert("UTC")


def _names(content: Any) -> dict[tuple[int, int], str]:
    """Each channel's name by (group, index), with its group's where several share it."""
    plain = {
        (number, index): str(channel.name)
        for number, group in enumerate(content.groups)
        for index, channel in enumerate(group.channels)
    }
    counts = Counter(plain.values())
    groups = [_group_name(group) for group in content.groups]
    known = Counter(groups)
    found: dict[tuple[int, int], str] = {}
    for (number, index), name in plain.items():
        group = groups[number]
        if not group or known[group] > 1:
            group = f"{group or 'group'} {number + 1}" if group else f"group{number + 1}"
        found[number, index] = f"{group}/{name}" if counts[name] > 1 else name
    again = Counter(found.values())
    return {
        place: f"{name}#{place[1] + 1}" if again[name] > 1 else name
        for place, name in found.items()
    }


def _group_name(group: Any) -> str:
    """A group's name as its recorder gave it: the acquisition's, or the comment in version 3."""
    about = group.channel_group
    name = getattr(about, "acq_name", None) or getattr(about, "comment", None) or ""
    line = (str(name).strip().splitlines() or [""])[0].strip()
    return "" if line.startswith("<") else line


def _is_wanted(table: ForeignTable, name: str, channel: Any, is_four: bool) -> bool:
    """Whether a channel holds numbers; else the table says why not."""
    from asammdf.blocks.v4_constants import CHANNEL_TYPE_VLSD

    kind = getattr(channel, "dtype_fmt", np.dtype(np.float64))
    if is_four and channel.channel_type == CHANNEL_TYPE_VLSD:
        table.skipped[name] = "text"
        return False
    if kind.names:
        table.skipped[name] = "a structure: its parts are channels of their own"
    elif kind.kind not in "fiub" or kind.shape:
        table.skipped[name] = "text" if kind.kind in "SUV" and not kind.shape else "bytes"
    else:
        return True
    return False


def _is_time(content: Any, number: int) -> bool:
    """Whether a group's master counts time (others: an angle, a distance, an index)."""
    from asammdf.blocks.v4_constants import SYNC_TYPE_TIME  # as in version 3

    index = content.masters_db.get(number)
    if index is None:
        return False
    master = content.groups[number].channels[index]
    return int(getattr(master, "sync_type", SYNC_TYPE_TIME)) == SYNC_TYPE_TIME


def _take(table: ForeignTable, name: str, signal: Any, clocked: bool, lost: list[str]) -> None:
    values, clock = np.asarray(signal.samples), np.asarray(signal.timestamps, dtype=np.float64)
    if values.dtype.names or values.dtype.kind not in "fiub" or values.ndim != 1:
        table.skipped[name] = f"an array of shape {values.shape[1:]}" if values.ndim > 1 else "text"
        return
    invalid = signal.invalidation_bits
    if invalid is not None and np.any(invalid):
        valid = ~np.asarray(invalid, dtype=bool)
        lost.append(f"{int(np.sum(~valid))} of {name}")
        values, clock = values[valid], clock[valid]
    if len(values) == 0:
        table.skipped[name] = "empty"
        return
    table.columns[name] = values
    if signal.unit:
        table.units[name] = str(signal.unit).strip()
    if clocked:
        table.clocks[name] = clock


__all__ = ["read"]
