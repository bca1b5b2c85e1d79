"""What every reader of a foreign file returns: named columns, and how messages refer to them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.errors import InputError, input_error, shortened
from sysid.io.foreign.stamps import clock_seconds, dates_in
from sysid.types import IntArray

if TYPE_CHECKING:
    import pandas as pd

Column = NDArray[Any]

_LISTED = 24


@dataclass(frozen=True)
class ReadOptions:
    """How to read a file where it does not specify this itself; None: detected by the reader.

    `header` False: the first row is data and columns are named #1, #2 ...; `skip_rows`
    lines or rows are above the table; `decimal` is `.` or `,`;
    `thousands` groups digits (equal to `decimal`: all but the last one do); `sheet` is an
    Excel sheet; `transpose`: each line is a signal, its name first. `names` are the columns that
    are asked for, by which a heading is found.
    """

    delimiter: str | None = None
    decimal: str | None = None
    thousands: str | None = None
    header: bool | None = None
    skip_rows: int = 0
    sheet: str | None = None
    transpose: bool | None = None
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class SampleTimes:
    """Time base that a file states for a column: period and time of the first sample, s."""

    period_s: float
    start_s: float = 0.0

    def ticks(self, rows: int) -> NDArray[np.float64]:
        """Time of each sample (rows,) s; divided where that gives the expected decimal."""
        inverse = round(1.0 / self.period_s)
        ticks = np.arange(rows)
        exact = inverse >= 1 and 1.0 / inverse == self.period_s
        return np.asarray(self.start_s + (ticks / inverse if exact else ticks * self.period_s))


@dataclass
class ForeignTable:
    """A foreign file as read, in its own names and units.

    `columns` maps each name to a (n,) array of numbers, text or time stamps; their lengths
    may differ (.mat, TDMS). `skipped` gives the reason why other contents are not columns;
    `units` is each column's unit as the file states it (`in_names`: of these columns by letters
    of their names that may mean something else), `clocks` the times (n,) s of a column's own
    samples on the file's one clock, where its channels are sampled at different instants;
    `starts` are the rows, after the first, at which the recording says that it starts again;
    `shape` are lines for the log's head that say how its rows were made.
    `stamped` names the columns that were read as time stamps or durations, in seconds.
    `origin` is the time stamp of second 0. `place` describes a row of the file for messages
    (row 0 is the first sample).
    """

    path: Path
    format: str
    columns: dict[str, Column] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    sampling: dict[str, SampleTimes] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    in_names: set[str] = field(default_factory=set)
    clocks: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    starts: tuple[int, ...] = ()
    notices: list[str] = field(default_factory=list)
    shape: list[str] = field(default_factory=list)
    stamped: set[str] = field(default_factory=set)
    origin: Any = None
    place: Callable[[int], str] = lambda row: f"row {row + 1}"
    explain_gap: Callable[[int], InputError | None] = lambda row: None

    def add(self, name: str, values: Column) -> None:
        """Add an array: signals run along its longer side and are named name#1, name#2 ..."""
        array = np.squeeze(np.asarray(values))
        if array.size == 0:
            self.skipped[name] = "empty"
        elif array.ndim <= 1:
            self.columns[name] = np.atleast_1d(array)
        elif array.ndim == 2:
            by_column = array if array.shape[0] >= array.shape[1] else array.T
            for index in range(by_column.shape[1]):
                self.columns[f"{name}#{index + 1}"] = by_column[:, index]
        else:
            self.skipped[name] = f"an array of shape {array.shape}"

    def skip_complex(self, name: str) -> None:
        """Say of a complex variable which columns its parts are."""
        self.skipped[name] = f"complex: its parts are {name}.real and {name}.imag"

    def describe(self) -> str:
        """The columns, each with its length and first value, for a message."""
        parts = [
            f"{shortened(name)} ({len(values)} values, first {_shown(values[0])})"
            for name, values in list(self.columns.items())[:_LISTED]
        ]
        more = len(self.columns) - _LISTED
        if more > 0:
            parts.append(f"and {more} more")
        return ", ".join(parts) if parts else "none"

    def numbers(
        self, name: str, target: str, rows: NDArray[np.intp] | None = None
    ) -> NDArray[np.float64]:
        """A column as finite floats (n,); time stamps give seconds from the first (`time_s`).

        `rows` (n,) are those that are asked for; None: all. Raises InputError at the first cell
        that is not a finite number.
        """
        import pandas as pd

        values = cells = self.columns[name] if rows is None else self.columns[name][rows]
        if values.dtype.kind not in "fiub":
            series = pd.Series(values).infer_objects()
            if series.dtype.kind in "mM":
                return self._seconds(name, target, series, rows)
            values = pd.to_numeric(series, errors="coerce").to_numpy(np.float64, na_value=np.nan)
            bad = np.flatnonzero(np.isnan(values) & series.notna().to_numpy())
            if bad.size and target == "time_s":
                stamps = dates_in(self.path, name, series)
                if stamps is not None:
                    self._all_stamps(name, series, np.flatnonzero(stamps.isna()), rows)
                    return self._seconds(name, target, stamps, rows)
                clock = clock_seconds(cells.tolist())
                if clock is not None:
                    self._all_stamps(name, series, np.flatnonzero(np.isnan(clock)), rows)
                    self.stamped.add(name)
                    self._counts_from(name, str(cells[0]).strip())
                    return clock
            if bad.size:
                raise self._not_a_number(name, target, int(bad[0]), series, rows)
        array = values.astype(np.float64)
        finite = np.isfinite(array)
        if not finite.all():
            first = int(np.flatnonzero(~finite)[0])
            raise self._not_finite(name, target, _row(first, rows), bool(np.isinf(array[first])))
        return array

    def empty(self, name: str) -> NDArray[np.bool_]:
        """Which cells (n,) of a column hold nothing."""
        import pandas as pd

        return np.asarray(pd.isna(self.columns[name]), dtype=bool)

    def _not_a_number(
        self, name: str, target: str, at: int, cells: pd.Series, rows: NDArray[np.intp] | None
    ) -> InputError:
        return input_error(
            f"{self.path}, {self.place(_row(at, rows))}",
            f"column {name} (for {target}) holds {_shown(cells[at])}, not a number",
            "fix the cell or map another column (a decimal comma: --decimal; digits "
            "grouped by thousands: --thousands)",
        )

    def _all_stamps(
        self, name: str, cells: pd.Series, others: IntArray, rows: NDArray[np.intp] | None
    ) -> None:
        """InputError at the first of the cells that are no time stamps, although most are."""
        if not others.size:
            return
        first = int(others[0])
        if bool(cells.isna()[first]):
            raise self._not_finite(name, "time_s", _row(first, rows))
        raise input_error(
            f"{self.path}, {self.place(_row(first, rows))}",
            f"column {name} (for time_s) holds {_shown(cells[first])}, not a time like the others",
            "fix the cell, or delete the row",
        )

    def _counts_from(self, name: str, first: str) -> None:
        self.notices.append(f"{self.path}: {name}: time counts from {first}")

    def _seconds(
        self, name: str, target: str, series: pd.Series, rows: NDArray[np.intp] | None
    ) -> NDArray[np.float64]:
        """Seconds (n,) from the first time stamp, or of each duration; for `time_s` only."""
        if target != "time_s":
            raise input_error(
                self.path, f"column {name} holds time stamps, not {target}", "map another column"
            )
        gaps = np.flatnonzero(series.isna().to_numpy())
        if gaps.size:
            raise self._not_finite(name, target, _row(int(gaps[0]), rows))
        self.stamped.add(name)
        if series.dtype.kind == "m":
            return np.asarray(series.dt.total_seconds(), dtype=np.float64)
        self.origin = series.iloc[0]
        self._counts_from(name, str(series.iloc[0]))
        return np.asarray((series - series.iloc[0]).dt.total_seconds(), dtype=np.float64)

    def labels(self, name: str, rows: NDArray[np.intp] | None = None) -> list[str]:
        """A column as text labels; whole numbers without `.0`. InputError at a gap.

        `rows` (n,) are those that are asked for; None: all.
        """
        import pandas as pd

        values = self.columns[name] if rows is None else self.columns[name][rows]
        missing = np.flatnonzero(np.asarray(pd.isna(values)))
        if missing.size:
            raise self._not_finite(name, "test", _row(int(missing[0]), rows))
        if values.dtype.kind == "f":
            return [repr(int(v)) if float(v).is_integer() else repr(float(v)) for v in values]
        return [str(v).strip() for v in values]

    def _not_finite(self, name: str, target: str, row: int, infinite: bool = False) -> InputError:
        explained = self.explain_gap(row)
        if explained is not None:
            return explained
        what = "infinite" if infinite else "empty or not a number (NaN)"
        return input_error(
            f"{self.path}, {self.place(row)}",
            f"column {name} (for {target}) is {what}",
            "delete the row, or fill in the value",
        )


def _row(index: int, rows: NDArray[np.intp] | None) -> int:
    """The row of the file that an index into the rows asked for stands for."""
    return index if rows is None else int(rows[index])


def _shown(value: Any) -> str:
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    text = str(value)
    if isinstance(value, str):
        return repr(text if len(text) <= 24 else text[:24] + "...")
    return shortened(text)


def take_names(table: ForeignTable, names: Sequence[str] | None, columns: Iterable[Column]) -> None:
    """Name the columns of a table: by its header, or #1, #2 ... without one.

    Columns that share a name are known by their numbers only.
    """
    named: Mapping[int, str] = dict(enumerate(names or ()))
    counts = Counter(named.values())
    doubled = {n for n, count in counts.items() if n and count > 1}
    for index, values in enumerate(columns):
        name = named.get(index, "")
        table.columns[name if name and name not in doubled else f"#{index + 1}"] = values
    numbers: dict[str, list[str]] = {name: [] for name in sorted(doubled)}
    for index, name in named.items():
        if name in doubled:
            numbers[name].append(f"#{index + 1}")
    for name, its in numbers.items():
        more = " ..." if len(its) > _LISTED else ""
        table.skipped[name] = f"it names {' and '.join(its[:_LISTED])}{more}"
