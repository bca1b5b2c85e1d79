"""A foreign file's columns of different rates on the rows of one (`sysid.io.alignment`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from sysid.errors import input_error
from sysid.io.alignment import has_own_rate, has_value, values_at
from sysid.io.channels import TEST_COLUMN
from sysid.io.foreign import ForeignTable
from sysid.io.foreign.recipe import Recipe
from sysid.io.foreign_tests import Tests
from sysid.io.reshaping import joined_line, median_period
from sysid.io.units import ColumnMap
from sysid.types import BoolArray, FloatArray, IntArray

Sources = Mapping[str, tuple[str, ColumnMap]]


@dataclass
class SlowerColumns:
    """Columns of a table that are empty between their own rows, filled as the recipe says."""

    table: ForeignTable
    recipe: Recipe
    _said: list[str] = field(default_factory=list)
    _omitted: list[tuple[str, BoolArray]] = field(default_factory=list)
    _longest: float = 0.0

    def rows_of(
        self, name: str, target: str, kept: IntArray, time: FloatArray, starts: IntArray
    ) -> IntArray | None:
        """The rows among `kept` (n,), at `time` (n,) s, in which a column is sampled; None: all.

        `starts` are the first rows of the tests.

        None also where cells are missing, which is for the column's reader to name. InputError
        for a column of no value, or one, and where it begins later or ends before the others.
        """
        empty = self.table.empty(name)[kept]
        if not empty.any():
            return None
        rows = np.flatnonzero(~empty)
        said = f"column {name} (for {target})"
        if len(rows) == 0:
            raise input_error(
                self.table.path, f"{said} is empty in every row", "map another, or omit it"
            )
        if len(rows) == 1 and len(kept) > 2:
            place = self.table.place(int(kept[rows[0]]))
            raise input_error(
                f"{self.table.path}, {place}",
                f"{said} holds a single value, {self.table.columns[name][kept[rows[0]]]}",
                f"give it for all rows: --set {target}=VALUE (SI)",
            )
        held = self.recipe.is_held(target)
        if self.recipe.fill is None and not has_own_rate(rows, time, held, starts):
            self._reject_ends(said, rows, kept)
            return None
        share = np.count_nonzero(empty) / len(empty)
        how = f"{100 * share:.0f} %" if share >= 0.01 else f"{np.count_nonzero(empty)}"
        every = median_period(time[rows])
        self._said.append(
            f"{name} is empty in {how} of the rows, {_filled(held)} its own (every {every:.4g} s"
            + self._gap(rows, time, kept)
            + ")"
        )
        if not held:
            self._longest = max(self._longest, every)
        return rows

    def _gap(self, rows: IntArray, time: FloatArray, kept: IntArray) -> str:
        """Where a column of even rate misses one of its samples, perhaps by a lost cell."""
        steps = np.diff(rows)
        usual = float(np.median(steps))
        odd = np.flatnonzero(steps != usual)
        if not 0 < len(odd) <= 0.25 * len(steps):
            return ""
        at = odd[np.argmax(np.abs(steps[odd] - usual))]
        often = "once" if len(odd) == 1 else f"{len(odd)} times otherwise, as in"
        found = f"{float(time[rows[at + 1]] - time[rows[at]]):.4g} s"
        if steps[at] < usual:
            return f", {often} {found}: {self.table.place(int(kept[rows[at + 1]]))}"
        return f", {often} {found}: none in {self.table.place(int(kept[rows[at] + int(usual)]))}"

    def _reject_ends(self, said: str, rows: IntArray, kept: IntArray) -> None:
        """InputError for a column that is full, but for many rows at the table's end or start."""
        first, last = int(rows[0]), int(rows[-1])
        whole = last - first + 1 == len(rows) and np.array_equal(kept, np.arange(len(kept)))
        if whole and max(first, len(kept) - 1 - last) > 1:
            raise input_error(
                f"{self.table.path}, {self.table.place(int(kept[last + 1 if first == 0 else 0]))}",
                f"{said} has values in rows {first} to {last} only, counted from 0",
                f"keep these: --rows {first}:{last + 1}",
            )

    def filled(
        self,
        name: str,
        target: str,
        own: IntArray,
        values: FloatArray,
        time: FloatArray,
        tests: Tests,
        kept: IntArray,
    ) -> tuple[FloatArray, BoolArray]:
        """The column at all rows, and in which it has a value: `values` (k,) are in rows `own`."""
        held = self.recipe.is_held(target)
        out, known = np.full(len(time), np.nan), np.zeros(len(time), dtype=bool)
        for first, last in tests.parts():
            inside = (own >= first) & (own < last)
            if inside.any():
                rows, grid = own[inside], time[first:last]
                self._check_rising(name, rows, time, kept)
                out[first:last] = values_at(grid, time[rows], values[inside], held)
                known[first:last] = has_value(grid, time[rows], held)
                out[rows], known[rows] = values[inside], True
        self._omitted.append((name, ~known))
        return out, known

    def _check_rising(self, name: str, rows: IntArray, time: FloatArray, kept: IntArray) -> None:
        """InputError where time, s, does not rise between the samples of a column."""
        steps = np.flatnonzero(np.diff(time[rows]) <= 0.0)
        if steps.size:
            before, after = rows[steps[0] : steps[0] + 2]
            raise input_error(
                f"{self.table.path}, {self.table.place(int(kept[after]))}",
                f"time_s is {time[after]:.9g}, at the sample of {name} before {time[before]:.9g}",
                "correct the time, or sort the rows",
            )

    def tell(self, kept: IntArray) -> None:
        """What was done: notices, and a line for the log's head."""
        if self._said:
            self.table.notices.append(
                f"{self.table.path}: columns at rates of their own: {'; '.join(self._said)}"
            )
        for name, missing in self._omitted:
            tell_omitted(self.table, name, missing, kept)
        if self._longest:
            self.table.shape.append(joined_line(self._longest))


def _filled(held: bool) -> str:
    return "held between" if held else "linear between"


def tell_omitted(table: ForeignTable, name: str, missing: BoolArray, kept: IntArray) -> None:
    """The notice that rows in which a column has no value are skipped."""
    rows = np.flatnonzero(missing)
    if rows.size:
        table.notices.append(
            f"{table.path}: {rows.size} rows omitted, in which {name} has no value (before its "
            f"first sample, after its last, or in a pause; from {table.place(int(kept[rows[0]]))})"
        )


def one_clock(table: ForeignTable, sources: Sources) -> bool:
    """Whether the mapped columns share their rows, so that no clock need be matched."""
    clocks = [table.clocks.get(name) for name, _ in sources.values()]
    known = [clock for clock in clocks if clock is not None]
    return not known or (
        len(known) == len(clocks) and all(np.array_equal(c, known[0]) for c in known[1:])
    )


def grid_of(table: ForeignTable, recipe: Recipe, sources: Sources) -> str:
    """The column whose samples are the log's rows: the mapped time, else the fastest measured one.

    Raises InputError where a mapped column has no times, or times that do not rise.
    """
    if table.starts:
        raise input_error(
            table.path,
            "holds several recordings of channels with different times",
            "map channels of one rate, or split it into a file for each",
        )
    for target, (name, _) in sources.items():
        clock = table.clocks.get(name)
        if clock is None:
            raise input_error(
                table.path,
                f"{name} (for {target}) has no times of its own, which the other channels have",
                "map another" if target != "time_s" else "omit it: the channels' times are used",
            )
        _check_clock(table, name, target, clock)
    if "time_s" in sources:
        return sources["time_s"][0]
    measured = [name for target, (name, _) in sources.items() if target not in recipe.held]
    candidates = measured or [n for t, (n, _) in sources.items() if t != TEST_COLUMN]
    return min(candidates, key=lambda name: _period(table.clocks[name]))


def _check_clock(table: ForeignTable, name: str, target: str, clock: FloatArray) -> None:
    """InputError where a channel's times are not one to a sample, or go back."""
    said = f"the times of {name} (for {target})"
    if len(clock) != len(table.columns[name]):
        count = f"are {len(clock)} of {len(table.columns[name])} samples"
        raise input_error(table.path, f"{said} {count}", "record it again, or map another")
    back = np.flatnonzero(~(np.diff(clock) >= 0.0))
    if back.size:
        before, after = clock[back[0] : back[0] + 2]
        raise input_error(
            f"{table.path}, {table.place(int(back[0]) + 1)}",
            f"{said} go from {before:.9g} to {after:.9g} s",
            "correct them, or map another channel",
        )


def _period(clock: FloatArray) -> float:
    return median_period(clock) or np.inf


def told(grid: str, parts: Iterable[tuple[str, bool, float]]) -> str:
    """What was done with channels of other clocks: (name, held, period in s) of each."""
    listed = "; ".join(
        f"{name} {_filled(held)} its own samples" + (f" (every {every:.4g} s)" if every else "")
        for name, held, every in parts
    )
    return f"rows are the samples of {grid}: {listed}"


__all__ = ["SlowerColumns", "Sources", "grid_of", "one_clock", "tell_omitted", "told"]
