"""LabVIEW's measurement files (.lvm): a header for the file and one for each segment.

A segment's header states, over each channel's column, its unit, X0 and Delta_X (first time and
period, s) and its number of samples; its heading ends with `Comment`, under which a row need have
no cell. X_Columns says whether the rows hold no times, one for all channels, or each channel's.
Source: National Instruments, Specification for the LabVIEW Measurement File.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sysid.errors import input_error
from sysid.io.bounds import check_rectangle
from sysid.io.foreign.table import (
    Column,
    ForeignTable,
    ReadOptions,
    SampleTimes,
    take_names,
)
from sysid.io.foreign.table_rows import reject_cut_off
from sysid.io.foreign.text_layout import Layout, find_layout, is_number
from sysid.io.foreign.text_parsing import parsed, times_of
from sysid.types import FloatArray

_FIRST = "LabVIEW Measurement"
_END = "***End_of_Header***"
_TIME = "X_Value"
_COMMENT = "Comment"
# What X_Dimension calls time in the languages of LabVIEW.
_OF_TIME = {"", "time", "zeit", "temps", "\u6642\u9593", "\u65f6\u95f4", "\uc2dc\uac04"}
_SEPARATORS = {"Tab": "\t", "Comma": ",", "Semicolon": ";"}


@dataclass
class _Segment:
    """One segment: its header's cells by key, the names of its columns, and its rows."""

    header: dict[str, list[str]]
    names: list[str]
    rows: list[tuple[int, str]] = field(default_factory=list)

    def stated(self, key: str, column: int) -> str:
        """What the header states over a column; empty where it does not."""
        cells = self.header.get(key, [])
        return cells[column] if 0 < column < len(cells) else ""

    def samples(self, column: int) -> int | None:
        """The samples of a column as stated; a channel's column of times is before its own."""
        is_time = self.names[column] == _TIME and column > 0
        stated = self.stated("Samples", column + is_time)
        return int(stated) if stated.isdecimal() else None

    def dimension(self, column: int) -> str:
        """What a column's X values are, as stated; those of a column of X its channel's."""
        return self.stated("X_Dimension", column + (self.names[column] == _TIME))

    def ends_before_others(self, column: int) -> bool:
        """Whether the header states fewer samples of a column than of another."""
        stated = [self.samples(index) for index in range(len(self.names))]
        own = stated[column]
        return own is not None and own < max(count for count in stated if count is not None)


def is_format(lines: Sequence[str]) -> bool:
    """Whether the lines are those of such a file, with both headers, or nothing below the first."""
    if not lines or not lines[0].startswith(_FIRST):
        return False
    ends = [index for index, line in enumerate(lines) if line.startswith(_END)]
    if len(ends) == 1 and not any(map(str.strip, lines[ends[0] + 1 :])):
        return True
    return len(ends) > 1 and any(line.startswith("Channels") for line in lines[: ends[1]])


def read(
    table: ForeignTable, lines: Sequence[str], whole: bool, options: ReadOptions
) -> ForeignTable:
    """The channels of all segments; each segment after the first begins a recording.

    `whole`: the last line is complete.
    """
    path = table.path
    end = next(index for index, line in enumerate(lines) if line.startswith(_END))
    stated = dict(_key_and_value(line) for line in lines[1:end])
    delimiter = _SEPARATORS.get(stated.get("Separator", ""), "\t")
    segments = _segments(path, lines, end + 1, delimiter)
    rows = [row for segment in segments for row in segment.rows]
    if not rows:
        raise input_error(path, "has a header but no rows", "give another file")
    names = segments[0].names
    for segment in segments[1:]:
        if segment.names != names:
            raise input_error(
                f"{path}, line {segment.rows[0][0] if segment.rows else 1}",
                "a segment has other channels than the first",
                "save its segments as files of their own",
            )
    decimal = options.decimal or stated.get("Decimal_Separator", "").strip()
    if decimal not in (".", ","):
        sample = ReadOptions(delimiter=delimiter)
        decimal = find_layout(path, [text for _, text in rows], sample).decimal
    layout = Layout(delimiter, decimal, len(names))
    for segment in segments:
        _check_rows(path, segment, layout)
    if not whole:
        reject_cut_off(path, rows, layout)
    check_rectangle(path, len(rows), len(names))
    columns = parsed(path, [text for _, text in rows], layout)
    table.format = "LabVIEW measurement file"
    table.place = lambda row: f"line {rows[row][0]}"
    table.starts = tuple(np.cumsum([len(s.rows) for s in segments if s.rows])[:-1].tolist())
    _take_channels(table, [s for s in segments if s.rows], columns, stated, decimal)
    return table


def _key_and_value(line: str) -> tuple[str, str]:
    for sign in _SEPARATORS.values():
        key, found, value = line.partition(sign)
        if found:
            return key.strip(), value.strip(sign).strip()
    return line.strip(), ""


def _segments(path: Path, lines: Sequence[str], first: int, delimiter: str) -> list[_Segment]:
    """The segments from line index `first` on. InputError at a malformed row."""
    segments: list[_Segment] = []
    header: dict[str, list[str]] | None = {}
    last_end = max(index for index, line in enumerate(lines) if line.startswith(_END))
    index = first
    while index < len(lines):
        line = lines[index]
        cells = [cell.strip() for cell in line.split(delimiter)]
        index += 1
        if not any(cells):
            continue
        if header is not None and line.startswith(_END):
            index = _heading(path, lines, index, delimiter, header, segments)
            header = None
        elif header is not None:
            header[cells[0]] = cells
        elif cells[0][:1].isalpha() and index <= last_end:
            header = {cells[0]: cells}
        else:
            segments[-1].rows.append((index, line))
    return segments


def _heading(
    path: Path,
    lines: Sequence[str],
    index: int,
    delimiter: str,
    header: dict[str, list[str]],
    segments: list[_Segment],
) -> int:
    """The line of names after a segment's header; the index of the line after it."""
    while index < len(lines) and not lines[index].strip():
        index += 1
    names = [cell.strip() for cell in lines[index].split(delimiter)] if index < len(lines) else []
    while names and not names[-1]:
        names.pop()
    if not names or names[0] != _TIME:
        raise input_error(
            f"{path}, line {min(index + 1, len(lines))}",
            f"{_TIME} and the channels' names are missing below the header",
            "save the file again",
        )
    segments.append(_Segment(header, names))
    return index + 1


def _check_rows(path: Path, segment: _Segment, layout: Layout) -> None:
    """InputError at a row of too many cells, or that lacks those of a channel still sampled."""
    channels = len(segment.names) - (segment.names[-1] == _COMMENT)
    ends = [segment.samples(i) for i in range(len(segment.names))]
    for row, (number, text) in enumerate(segment.rows):
        found = text.count(layout.delimiter) + 1 if '"' not in text else len(layout.cells(text))
        if found > channels:
            surplus = [cell for cell in layout.cells(text)[channels:] if cell]
            numbers = row > 0 and any(map(layout.is_number, surplus))
            if len(surplus) > len(segment.names) - channels or numbers:
                raise input_error(
                    f"{path}, line {number}",
                    f"{found} fields, but {channels} are of channels and their times",
                    "fix the line (two lines run together, a decimal comma?)",
                )
        for column in range(found, channels):
            end = ends[column]
            if end is None or not segment.ends_before_others(column) or row < end:
                raise input_error(
                    f"{path}, line {number}",
                    f"the row ends early: {found} of {channels} fields",
                    "delete this last line: the recording was cut off there"
                    if row == len(segment.rows) - 1
                    else "complete the row",
                )


def _take_channels(
    table: ForeignTable,
    segments: list[_Segment],
    columns: list[Column],
    stated: dict[str, str],
    decimal: str,
) -> None:
    """Columns by name, with units and times."""
    first = segments[0]
    times = stated.get("X_Columns", "No")
    remarks = len(first.names) - 1 if first.names[-1] == _COMMENT else None
    if remarks is not None and all(cell != cell for cell in columns[remarks]):
        columns = columns[:remarks]
    bases = [_bases(table.path, segment, decimal) for segment in segments]
    if times == "No":
        columns[0] = _counted(segments, bases, 1)
    take_names(table, _called(first.names)[: len(columns)], columns)
    names = list(table.columns)
    for index, name in enumerate(names):
        if index != remarks and (over := first.dimension(index)).casefold() not in _OF_TIME:
            raise input_error(
                table.path,
                f"{name} is over {over}, not over time (X_Dimension)",
                "save the signal itself",
            )
    time = 0
    for index in range(len(names)):
        ends = index > 0 and first.ends_before_others(index)
        if first.names[index] == _TIME:
            time = index
            table.units[names[index]] = "s"
            _take_times(table, names[index], times_of(table, columns[time], _TIME), ends)
        elif index == remarks:
            continue
        elif times == "No":
            _take_times(table, names[index], _counted(segments, bases, index), ends)
        else:
            _take_times(table, names[index], times_of(table, columns[time], _TIME), ends)
        if unit := first.stated("Y_Unit_Label", index):
            table.units[names[index]] = unit


def _called(names: list[str]) -> list[str]:
    """The columns' names: where each channel has a column of times, by the channel."""
    if names.count(_TIME) == 1:
        return names
    return [
        f"{_TIME} of {names[index + 1]}" if name == _TIME and index + 1 < len(names) else name
        for index, name in enumerate(names)
    ]


def _take_times(table: ForeignTable, name: str, times: FloatArray, ends: bool) -> None:
    """A channel's own samples and their times: it may end before others, where `ends` says so."""
    values = table.columns[name]
    filled = ~np.asarray([cell != cell for cell in values], dtype=bool)
    if not filled.any():
        table.skipped[name] = "empty"
        del table.columns[name]
        return
    count = len(values)
    if ends and not table.starts:
        count = int(np.flatnonzero(filled)[-1]) + 1
    if np.isnan(times).all():  # without Delta_X
        return
    missing = np.flatnonzero(np.isnan(times[:count]))
    if missing.size:
        raise input_error(
            f"{table.path}, {table.place(int(missing[0]))}",
            f"{_TIME} is empty",
            "fill in the time, or delete the row",
        )
    table.columns[name] = values[:count]
    table.clocks[name] = times[:count]


def _bases(path: Path, segment: _Segment, decimal: str) -> list[SampleTimes | None]:
    """The time base that a segment's header states for each of its columns."""
    found: list[SampleTimes | None] = []
    for column in range(len(segment.names)):
        period, start = segment.stated("Delta_X", column), segment.stated("X0", column)
        if is_number(period, decimal) and float(period.replace(decimal, ".")) > 0.0:
            first = float(start.replace(decimal, ".")) if is_number(start, decimal) else 0.0
            found.append(SampleTimes(float(period.replace(decimal, ".")), first))
        else:
            found.append(None)
    return found


def _counted(
    segments: list[_Segment], bases: list[list[SampleTimes | None]], column: int
) -> FloatArray:
    """The times (n,) s of a column's samples by each segment's X0 and Delta_X; NaN if unknown."""
    parts = []
    for segment, base in zip(segments, bases, strict=True):
        rows, own = len(segment.rows), base[column] if column < len(base) else None
        parts.append(np.full(rows, np.nan) if own is None else own.ticks(rows))
    return np.concatenate(parts)


__all__ = ["is_format", "read"]
