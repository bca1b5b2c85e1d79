"""Rows of a log that are not used: whole tests, or spans of one (`docs/reference/log-format.md`).

They are taken out of the table as it was read, before a value, a unit or a time is judged. A span
at an end of a test trims it, one within splits it into parts, each a separate test. Times are
seconds since the test's first row, excluded or not.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid import signals
from sysid.errors import InputError, input_error, shortened, some_of
from sysid.io.channels import DUTIES
from sysid.io.rig import Rig, reject_misspelt
from sysid.io.tables import LogTable
from sysid.io.units import ColumnMap, to_si
from sysid.types import BoolArray, FloatArray, IntArray

OPTION = "--exclude"
_KEYS = ("test", "from_s", "to_s", "why")
_SPAN = re.compile(r"(?P<test>.*)@(?P<span>[^@]*)", re.DOTALL)
_FIX_TABLE = 'write exclude = ["7", {test = "12", from_s = 3.0, to_s = 4.5, why = "..."}]'
_FIX_OPTION = f"write {OPTION} 12 or {OPTION} 12@3:4.5 (s since the test's first row)"


@dataclass(frozen=True)
class Exclusion:
    """A test, or from `from_s` to `to_s` (s since its first row; None: its end) of one.

    `test` is its label, empty for the only test of a file. `given` says where it was asked for.
    """

    test: str
    from_s: float | None = None
    to_s: float | None = None
    why: str = ""
    given: str = OPTION

    @property
    def is_whole(self) -> bool:
        """Whether all of the test is meant."""
        return self.from_s is None and self.to_s is None

    @property
    def span(self) -> str:
        """The times in words; empty for a whole test."""
        return _span_text(self.from_s, self.to_s)

    @property
    def title(self) -> str:
        """Test and times in words."""
        name = f"test {self.test}" if self.test else "the test"
        return f"{name}{'' if self.is_whole else ', ' + self.span}"

    def to_json(self) -> dict[str, Any]:
        """Its entry in a bundle's provenance: what is not None or empty, and the test."""
        given = {"from_s": self.from_s, "to_s": self.to_s, "why": self.why or None}
        return {"test": self.test, **{k: v for k, v in given.items() if v is not None}}


@dataclass(frozen=True)
class Excluded:
    """What was excluded from a log: an exclusion, and its number of rows."""

    exclusion: Exclusion
    rows: int

    def to_json(self) -> dict[str, Any]:
        """Like `Exclusion.to_json`, with its rows."""
        return {**self.exclusion.to_json(), "rows": self.rows}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Excluded:
        """The object that `to_json` wrote."""
        given = {name: value for name, value in content.items() if name in _KEYS}
        return cls(Exclusion(**given), int(content["rows"]))


@dataclass(frozen=True)
class KeptRows:
    """A log's table without its excluded rows.

    `begun`: of each part that does not start with its test, by label, how many s after the test's
    first row it does.
    """

    table: LogTable
    begun: Mapping[str, float]
    excluded: tuple[Excluded, ...] = ()
    notices: tuple[str, ...] = ()


# --- as given -----------------------------------------------------------------------------


def exclusions_of(given: Any, where: str, source: str) -> tuple[Exclusion, ...]:
    """The value of `exclude` in a `[[log]]`. Raises InputError that names the entry.

    `where` is the `[[log]]`, `source` the campaign file.
    """
    if not isinstance(given, list):
        raise input_error(source, f"{where}: exclude is not a list", _FIX_TABLE)
    found = []
    for number, one in enumerate(given, start=1):
        place = f"{where}: exclude[{number}]"
        if isinstance(one, dict):
            found.append(_of_table(one, place, source))
        elif isinstance(one, str | int) and not isinstance(one, bool):
            found.append(Exclusion(str(one), given=f"{source}, {place}"))
        else:
            raise input_error(source, f"{place} is neither a test nor a table", _FIX_TABLE)
    return tuple(found)


def _of_table(table: Mapping[str, Any], place: str, source: str) -> Exclusion:
    unknown = reject_misspelt(table, _KEYS, f"{place}: ", source)
    if unknown:
        known = ", ".join(_KEYS)
        raise input_error(source, f"{place} has a key that is none of {known}", _FIX_TABLE)
    test, why = table.get("test", ""), table.get("why", "")
    if isinstance(test, bool) or not isinstance(test, str | int):
        raise input_error(source, f"{place}: test = {test!r} is not a label", _FIX_TABLE)
    if not isinstance(why, str):
        raise input_error(source, f"{place}: why = {why!r} is not text", _FIX_TABLE)
    ends: list[float | None] = []
    for name in ("from_s", "to_s"):
        value = table.get(name)
        wrong = isinstance(value, bool) or not isinstance(value, int | float | None)
        if wrong or (value is not None and not math.isfinite(value)):
            raise input_error(source, f"{place}: {name} = {value!r} is not a time", _FIX_TABLE)
        ends.append(None if value is None else float(value))
    made = Exclusion(str(test), ends[0], ends[1], " ".join(why.split()), f"{source}, {place}")
    return _in_order(made)


def parse_exclusion(text: str) -> Exclusion:
    """`TEST`, or `TEST@FROM:TO` of which one time may be absent. Raises InputError."""
    found = _SPAN.fullmatch(text)
    given = f"{OPTION} {shortened(text)}"
    if found is None:
        return Exclusion(text, given=given)
    try:
        from_s, to_s = parse_span(found["span"])
    except ValueError as error:
        raise input_error(given, str(error), _FIX_OPTION) from None
    return _in_order(Exclusion(found["test"], from_s, to_s, given=given))


def parse_span(text: str) -> tuple[float | None, float | None]:
    """Seconds FROM:TO, one of which may be absent (None). ValueError says what it is instead."""
    parts = text.split(":")
    if len(parts) != 2 or not any(map(str.strip, parts)):
        raise ValueError(f"{text!r} is not FROM:TO")
    from_s, to_s = (_time(part) if part.strip() else None for part in parts)
    return from_s, to_s


def _time(text: str) -> float:
    with contextlib.suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise ValueError(f"{text!r} is not a time in s")


def _in_order(made: Exclusion) -> Exclusion:
    if made.from_s is not None and made.to_s is not None and made.from_s > made.to_s:
        raise input_error(
            made.given, f"its span ends before it begins ({made.span})", "exchange the two times"
        )
    return made


def _span_text(from_s: float | None, to_s: float | None) -> str:
    ends = [None if one is None else f"{one:.10g}" for one in (from_s, to_s)]
    if ends[0] is None:
        return f"to {ends[1]} s"
    return f"from {ends[0]} s" if ends[1] is None else f"from {ends[0]} to {ends[1]} s"


# --- tables -------------------------------------------------------------------------------


def labels_in(table: LogTable, maps: Mapping[str, ColumnMap]) -> tuple[IntArray, list[str]]:
    """(n,) the number of each row's test, and the labels; one empty label without a column."""
    column = table.column_of("test", maps)
    if column is None:
        return np.zeros(len(table.frame), dtype=np.intp), [""]
    return table.labels(column)


def names_test(exclusion: Exclusion, labels: Collection[str]) -> bool:
    """Whether a file with tests of these labels holds the test that is meant."""
    return exclusion.test in labels or (not exclusion.test and len(labels) == 1)


def no_such_test(exclusion: Exclusion, where: str, labels: Sequence[str]) -> InputError:
    """The error of a log without a test of this label, naming those that it holds."""
    if list(labels) == [""]:
        fix = 'the file is one test without a label: write @FROM:TO, or test = ""'
    else:
        fix = f"its tests are {some_of(labels, 20)}"
    name = f"test {exclusion.test!r}" if exclusion.test else "a test without a label"
    return input_error(exclusion.given, f"{where} holds no {name[:80]}", fix)


def without(
    table: LogTable,
    maps: Mapping[str, ColumnMap],
    exclusions: Sequence[Exclusion],
    rig: Rig,
) -> KeptRows:
    """The table of a log without its excluded rows, its parts labelled as separate tests.

    `maps` are those that apply to the file. Raises InputError where a test or a span does not
    exist, or nothing remains.
    """
    if not exclusions:
        return KeptRows(table, {})
    codes, labels = labels_in(table, maps)
    time = _seconds(table, maps) if any(not one.is_whole for one in exclusions) else None
    removed = np.full(len(codes), -1)
    for number, one in enumerate(exclusions):
        rows = _rows_of(one, codes, labels, time, table)
        removed[rows[removed[rows] < 0]] = number
    counts = [int(np.count_nonzero(removed == number)) for number in range(len(exclusions))]
    excluded = tuple(Excluded(e, n) for e, n in zip(exclusions, counts, strict=True))
    notices = [_said(table.path, one) for one in excluded]
    split = _Split(table, maps, rig, exclusions, removed, time, notices, set(labels))
    names = np.array(labels, dtype=object)[codes]
    for code, label in enumerate(labels):
        rows = np.flatnonzero(codes == code)
        if np.any(removed[rows] >= 0):
            split.take(rows, label, names)
    kept = np.flatnonzero(removed < 0)
    if kept.size == 0:
        given = ", ".join(dict.fromkeys(one.given for one in exclusions))
        raise input_error(given, f"all of {table.path} is excluded", "keep at least one test of it")
    left = _with_labels(table, maps, names) if split.is_split else table
    return KeptRows(left.at_rows(kept), split.begun, excluded, tuple(notices))


def _said(path: Path, one: Excluded) -> str:
    why = f" ({one.exclusion.why})" if one.exclusion.why else ""
    return f"{path}: {one.exclusion.title}: {one.rows} rows are excluded{why}"


def _with_labels(table: LogTable, maps: Mapping[str, ColumnMap], names: Any) -> LogTable:
    """The table with these labels (n,) in its column of tests, which is added where it has none."""
    column = table.column_of("test", maps)
    header = table.header if column is not None else (*table.header, "test")
    return replace(table, header=header, frame=table.frame.assign(**{column or "test": names}))


def _seconds(table: LogTable, maps: Mapping[str, ColumnMap]) -> FloatArray:
    """Times of all rows (n,) s, NaN where a cell holds none: excluded rows may hold anything."""
    import pandas as pd

    entry, column = maps.get("time_s"), table.column_of("time_s", maps)
    if column is None:
        raise input_error(table.path, "has no time_s, by which a span is excluded", "map it")
    if table.is_stamped(column):
        values = table.numbers(column)
    else:
        found = pd.to_numeric(table.frame[column], errors="coerce")
        values = np.asarray(found.to_numpy(dtype=np.float64, na_value=np.nan))
    return values if entry is None else to_si(values, entry, stamped=table.is_stamped(column))


def _rows_of(
    one: Exclusion,
    codes: IntArray,
    labels: Sequence[str],
    time: FloatArray | None,
    table: LogTable,
) -> IntArray:
    """The rows that an exclusion means.

    Of a span all from the first row within it to the last: in between time may jump.
    """
    if not names_test(one, labels):
        raise no_such_test(one, str(table.path), labels)
    code = labels.index(one.test) if one.test in labels else 0
    rows = np.flatnonzero(codes == code)
    if one.is_whole or time is None:
        return rows
    since = _since_start(time[rows])
    # Differences of times are rounded as these are.
    slack = 4.0 * np.finfo(float).eps * float(np.nanmax(np.abs(time[rows])))
    within = np.ones(len(rows), dtype=bool)
    if one.from_s is not None:
        within &= since >= one.from_s - slack
    if one.to_s is not None:
        within &= since <= one.to_s + slack
    at = np.flatnonzero(within)
    if at.size == 0:
        raise input_error(
            one.given,
            f"{table.path}: no row of {one.title} exists",
            f"it runs from 0 to {np.nanmax(since):.6g} s",
        )
    again = _entered_again(since, within)
    if again is not None:
        raise input_error(
            f"{table.path}, {table.place(int(rows[again]))}",
            f"time_s of {_title(labels[code])} starts again and runs through {one.span} twice",
            "give what follows each start its own label in the column `test`",
        )
    return rows[at[0] : at[-1] + 1]


def _entered_again(since: FloatArray, within: BoolArray) -> int | None:
    """The row with which a running clock (n,) comes into a span for the second time; None: never.

    A clock that jumps within a span comes back by a jump.
    """
    steps = np.diff(since)
    rising = steps[steps > 0.0]
    usual = float(np.median(rising)) if rising.size else 0.0
    entered = within[1:] & ~within[:-1] & (steps > 0.0) & (steps < signals.SAMPLE_MISSING * usual)
    again = np.flatnonzero(entered & (np.cumsum(within)[:-1] > 0))
    return int(again[0]) + 1 if again.size else None


def _since_start(time: FloatArray) -> FloatArray:
    """Times (n,) from the first that is a number."""
    known = time[np.isfinite(time)]
    return time - known[0] if known.size else time


@dataclass
class _Split:
    """Tests of a table while they are cut into parts; `removed` (n,): which exclusion, or -1."""

    table: LogTable
    maps: Mapping[str, ColumnMap]
    rig: Rig
    exclusions: Sequence[Exclusion]
    removed: IntArray
    time: FloatArray | None
    notices: list[str]
    named: set[str]
    begun: dict[str, float] = field(default_factory=dict)
    is_split: bool = False

    def take(self, rows: IntArray, label: str, names: Any) -> None:
        """Name the parts of one test, given by its rows, and when they begin."""
        if self.time is None:  # whole tests alone
            return
        since = _since_start(self.time[rows])
        self._check_order(rows, since, label)
        parts = []
        for first, last in self._runs(rows):
            start = self._first_usable(rows, since, first, last, label)
            if last - start < 2:
                self.removed[rows[first:last]] = len(self.exclusions)
                place = self.table.place(int(rows[first]))
                self.notices.append(
                    f"{self.table.path}, {place}: fewer than two rows of {_title(label)} "
                    f"remain there; they are excluded"
                )
                continue
            self.removed[rows[first:start]] = len(self.exclusions)
            parts.append((first, start, last))
        for first, start, last in parts:
            name = label
            if len(parts) > 1:
                name = _unique(self._name(rows, label, first, last), self.named)
                self.named.add(name)
                names[rows[start:last]] = name
                self.is_split = True
            if start > 0:
                self.begun[name] = float(since[start])

    def _runs(self, rows: IntArray) -> Iterator[tuple[int, int]]:
        """[first, last) of each run of a test's rows that are not excluded."""
        yield from signals.runs(self.removed[rows] < 0)

    def _name(self, rows: IntArray, label: str, first: int, last: int) -> str:
        """A part's label: the test's and the times between which it lies, as they were given."""
        before = self.removed[rows[first - 1]] if first else -1
        after = self.removed[rows[last]] if last < len(rows) else -1
        begin = self.exclusions[before].to_s if before >= 0 else None
        end = self.exclusions[after].from_s if after >= 0 else None
        return f"{label} {_span_text(begin, end)}".strip()

    def _check_order(self, rows: IntArray, since: FloatArray, label: str) -> None:
        """InputError where time goes back across what is excluded: a part would begin unknown."""
        runs = list(self._runs(rows))
        for (_, stop), (start, _) in itertools.pairwise(runs):
            if since[start] <= since[stop - 1]:
                raise input_error(
                    f"{self.table.path}, {self.table.place(int(rows[start]))}",
                    f"time_s of {_title(label)} goes back across the excluded rows before, from "
                    f"{since[stop - 1]:.9g} to {since[start]:.9g} s after its start",
                    "give what follows its own label in the column `test`",
                )

    def _first_usable(
        self, rows: IntArray, since: FloatArray, first: int, last: int, label: str
    ) -> int:
        """Where a part may begin: under PWM at the start of a period, which go on as before."""
        if first == 0 or self.rig.pwm is None or not self._is_pulsed(rows[first:last]):
            return first
        period = self.rig.pwm.period_s
        within = since[first:last]
        row_s = float(np.median(np.diff(within))) if len(within) > 1 else period
        off = np.abs(within - np.round(within / period) * period)
        # As near to the start of a period as decimal times allow.
        near = np.flatnonzero(off <= signals.JITTER_IGNORED * row_s)
        if near.size:
            return first + int(near[0])
        # The log's rows drift against the periods: the nearest of the next few is taken.
        few = within - within[0] <= 4.0 * max(period, row_s)
        best = int(np.argmin(off[few]))
        self.notices.append(
            f"{self.table.path}: {_title(label)}: no row after the excluded ones lies at the start "
            f"of a PWM period; they are counted from one {off[best]:.3g} s away from it"
        )
        return first + best

    def _is_pulsed(self, rows: IntArray) -> bool:
        import pandas as pd

        for name in DUTIES:
            column = self.table.column_of(name, self.maps)
            if column in self.table.frame:
                values = pd.to_numeric(self.table.frame[column].iloc[rows], errors="coerce")
                if bool((values.fillna(0.0) != 0.0).any()):
                    return True
        return False


def _title(label: str) -> str:
    return f"test {label}" if label else "the test"


def _unique(name: str, taken: Collection[str]) -> str:
    """The name, numbered where another test has it."""
    found, number = name, 1
    while found in taken:
        number += 1
        found = f"{name} ({number})"
    return found


# --- several logs -------------------------------------------------------------------------


def shared_out(
    texts: Iterable[str], logs: Sequence[tuple[Collection[str], Sequence[str]]]
) -> list[tuple[Exclusion, ...]]:
    """Each log's own of what `--exclude` gives; `logs`: the names of each, and its tests' labels.

    `TEST` means every log that has a test of this label, `LOG/TEST` that log alone. Raises
    InputError where no log has it.
    """
    found: list[list[Exclusion]] = [[] for _ in logs]
    for text in texts:
        one = parse_exclusion(text)
        named = [
            (i, replace(one, test=one.test[len(name) + 1 :]))
            for i, (names, _) in enumerate(logs)
            for name in dict.fromkeys(names)
            if one.test.startswith(f"{name}/")
        ]
        chosen = [*((i, one) for i in range(len(logs))), *named]
        mine = [(i, own) for i, own in chosen if names_test(own, logs[i][1])]
        if not mine:
            raise _in_no_log(one, named, logs)
        for i, own in mine:
            found[i].append(own)
    return [tuple(own) for own in found]


def _in_no_log(
    one: Exclusion,
    named: Sequence[tuple[int, Exclusion]],
    logs: Sequence[tuple[Collection[str], Sequence[str]]],
) -> InputError:
    if named or len(logs) == 1:
        i, own = named[0] if named else (0, one)
        return no_such_test(own, next(iter(logs[i][0])), logs[i][1])
    told = "; ".join(
        f"{next(iter(names))}: {', '.join(labels[:20]) or '-'}" for names, labels in logs[:5]
    )
    more = " ..." if len(logs) > 5 else ""
    return input_error(one.given, f"no log holds a test {one.test!r}", f"tests are {told}{more}")


__all__ = [
    "OPTION",
    "Excluded",
    "Exclusion",
    "KeptRows",
    "exclusions_of",
    "labels_in",
    "parse_exclusion",
    "parse_span",
    "shared_out",
    "without",
]
