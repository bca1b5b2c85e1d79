"""The tests of a foreign file: where a recording starts again, and its time without wraps."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.errors import some_of
from sysid.io.foreign import ForeignTable
from sysid.io.repeated_times import spread_evenly
from sysid.io.time_breaks import TimeWraps, time_breaks, without_own_time, wraps_of
from sysid.types import BoolArray, FloatArray, IntArray


@dataclass
class Tests:
    """The tests of a table's rows: `starts` (k,) are their first rows, of `rows` rows.

    `labels` (rows,) is None for one test; `numbered` where they are counted here.
    """

    table: ForeignTable
    rows: int
    starts: IntArray
    labels: NDArray[Any] | None = None
    numbered: bool = False

    def parts(self) -> list[tuple[int, int]]:
        """[first, last) row of each test, in their order."""
        return _parts(self.starts[1:], self.rows)

    def worth_keeping(self, has_row: BoolArray) -> BoolArray:
        """`has_row` (rows,) without the numbered tests of a single row, which is not a test.

        The log says how many they were.
        """
        kept, alone = has_row.copy(), []
        for first, last in self.parts() if self.numbered else ():
            if np.count_nonzero(has_row[first:last]) == 1:
                kept[first:last] = False
                alone.append(first)
        if alone:
            self.table.notices.append(
                f"{self.table.path}: {len(alone)} test{'s' if len(alone) > 1 else ''} of a single "
                f"row omitted ({_listed(self.table, alone)})"
            )
        return kept


def given_tests(table: ForeignTable, labels: NDArray[Any]) -> Tests:
    """The tests of a column of labels (n,)."""
    starts = np.flatnonzero(np.append(True, labels[1:] != labels[:-1]))
    return Tests(table, len(labels), starts, labels)


def _repeated(table: ForeignTable, time: FloatArray, kept: IntArray, stands: IntArray) -> str:
    """The notice of rows `stands` (k,) that have the time of the row before."""
    row = int(stands[0])
    place = f"{table.path}, {table.place(int(kept[row]))}"
    if spread_evenly(time) is not None:
        return (
            f"{place}: time_s repeats {time[row]:.9g}, {without_own_time(stands.size)}: a clock "
            "too coarse for its rows, which are spread evenly where the log is read"
        )
    # A clock that stopped, and not one that is too coarse.
    ends = row + stands.size == len(time)
    fix = f"--rows 0:{kept[row]} keeps those before" if ends else "give each its own time"
    return (
        f"{place}: time_s repeats {time[row]:.9g}, "
        f"{without_own_time(stands.size)}, with which no log is read; {fix}"
    )


def found_tests(table: ForeignTable, time: FloatArray, kept: IntArray, said: IntArray) -> Tests:
    """A test for each start that the file says, in rows `said`, and each at which time restarts.

    `time` (n,) s is that of the rows `kept` (n,) of the file. Notices say what was found, and
    where rows are out of order instead.
    """
    starts = [int(row) for row in said]
    again: list[int] = []
    for first, last in _parts(said, len(time)):
        breaks = time_breaks(time[first:last])
        if breaks.disordered is not None:
            row = first + breaks.disordered
            table.notices.append(
                f"{table.path}, {table.place(int(kept[row]))}: time_s goes back from "
                f"{time[row - 1]:.9g} to {time[row]:.9g}: rows are out of order"
            )
        stands = np.flatnonzero(np.diff(time[first:last]) == 0.0) + first + 1
        if stands.size:
            table.notices.append(_repeated(table, time, kept, stands))
        again += (first + breaks.starts).tolist()
    if again:
        table.notices.append(
            f"{table.path}: time starts again {_listed(table, kept[again])}: "
            f"{len(again) + len(starts) + 1} tests, numbered"
        )
    if starts and not again:
        table.notices.append(
            f"{table.path}: the recording starts again {_listed(table, kept[starts])}: "
            f"{len(starts) + 1} tests, numbered"
        )
    every = np.array(sorted({0, *starts, *again}), dtype=np.intp)
    if len(every) == 1:
        return Tests(table, len(time), every)
    numbers = np.searchsorted(every, np.arange(len(time)), side="right")
    return Tests(table, len(time), every, numbers.astype(str).astype(object), numbered=True)


def said_starts(table: ForeignTable, kept: IntArray) -> IntArray:
    """Where, among the rows `kept` (n,), the file says that the recording starts again."""
    part = np.searchsorted(np.asarray(table.starts, dtype=np.intp), kept, side="right")
    return np.flatnonzero(np.diff(part)) + 1


def without_wraps(
    table: ForeignTable,
    name: str,
    values: FloatArray,
    kept: IntArray,
    starts: IntArray,
    find: Callable[[FloatArray], TimeWraps | None] = wraps_of,
) -> FloatArray:
    """A time column (n,), its counter unwrapped between `starts`.

    In its own unit; with `wraps_of_seconds` times (s) that a program made from a counter.
    """
    out, places, what = values, [], ""
    for first, last in _parts(starts, len(values)):
        wraps = find(values[first:last]) if last - first > 2 else None
        if wraps is not None:
            out = out.copy() if out is values else out
            out[first:last] = wraps.unwrapped(values[first:last])
            places += (first + wraps.rows).tolist()
            what = f"{wraps.name}, {wraps.size:.15g}"
    if places:
        table.notices.append(
            f"{table.path}: {name} wraps ({what}) {_listed(table, kept[places])}: unwrapped"
        )
    return out


def _parts(starts: IntArray, rows: int) -> list[tuple[int, int]]:
    bounds = [0, *starts.tolist(), rows]
    return list(itertools.pairwise(bounds))


def _listed(table: ForeignTable, rows: Any) -> str:
    """The places of the file's rows: "in line 7, line 15"."""
    return f"in {some_of([table.place(int(row)) for row in rows], 5)}"


__all__ = [
    "Tests",
    "found_tests",
    "given_tests",
    "said_starts",
    "without_wraps",
]
