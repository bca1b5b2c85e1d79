"""A log's rows brought into shape by `sysid convert`: unwrapped, trimmed, on an even period.

Measured signals are interpolated linearly between their own rows, which neither overshoots nor
adds what was not measured; commands hold from their row to the next.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid import signals
from sysid.errors import input_error
from sysid.io.bounds import MOST_CELLS
from sysid.io.channels import TEST_COLUMN, VALVE_COMMANDS
from sysid.io.exclusion import parse_span
from sysid.io.time_breaks import without_own_time
from sysid.types import FloatArray

if TYPE_CHECKING:
    import pandas as pd

HELD_COLUMNS = (*VALVE_COMMANDS, "motor_volts", "motor_torque_nm", "motor_force_n", "pump_volts")
# A log's comment that its samples lie between measured rows.
_BETWEEN = "(measurements linear between rows every {:.6g} s, commands held)"
_SAYS_BETWEEN = re.compile(r"map: (?:resampled|joined) .*rows every ([0-9.e+-]+) s,")
_COUNTS = "encoder_counts"


@dataclass(frozen=True)
class Reshaping:
    """What to do with a log's rows.

    `unwrap` its angle, keep the seconds from `trim_s[0]` to `trim_s[1]` of each test (None: open),
    `period_s` (s) of the rows afterwards. Between rows a column that `held` names is held, any
    other linear.
    """

    unwrap: bool = False
    trim_s: tuple[float | None, float | None] = (None, None)
    period_s: float | None = None
    held: tuple[str, ...] = HELD_COLUMNS

    def lines(self, row_period: float) -> Iterable[str]:
        """The lines on it in a log's header; `row_period` (s) is that of the rows before."""
        if self.unwrap:
            yield "map: angle unwrapped"
        if self.trim_s != (None, None):
            first, last = ("" if s is None else f"{s:g}" for s in self.trim_s)
            yield f"map: trimmed to {first}:{last} s of each test"
        if self.period_s is not None:
            yield f"map: resampled to {self.period_s:g} s {_BETWEEN.format(row_period)}"


def read_trim(text: str | None) -> tuple[float | None, float | None]:
    """Seconds "FROM:TO", either of them optional. Raises InputError."""
    if text is None:
        return None, None
    try:
        first, last = parse_span(text)
    except ValueError:
        first, last = math.inf, -math.inf
    if first is not None and last is not None and first > last:
        raise input_error("--trim", f"{text!r} is not FROM:TO in seconds", "write --trim 0.5:8")
    return first, last


def reshaped(frame: pd.DataFrame, how: Reshaping, where: str) -> pd.DataFrame:
    """The log's columns (SI) after `how`, test by test. Raises InputError, naming `where`."""
    if how == Reshaping(held=how.held):
        return frame
    import pandas as pd

    if how.period_s is not None and not 0.0 < how.period_s < math.inf:
        raise input_error("--resample", f"{how.period_s:g} s is not a period", "give one above 0")
    if TEST_COLUMN not in frame:
        return _one(frame, how, where)
    groups = frame.groupby(TEST_COLUMN, sort=False)
    parts = [_one(group, how, f"{where}, test {label}") for label, group in groups]
    return pd.concat(parts, ignore_index=True)


def _one(frame: pd.DataFrame, how: Reshaping, where: str) -> pd.DataFrame:
    """One test."""
    if how.unwrap:
        _require_angle(frame, where)
        frame = unwrapped(frame)
    first, last = how.trim_s
    since = frame["time_s"] - frame["time_s"].iloc[0]
    kept = (since >= (-math.inf if first is None else first)) & (
        since <= (math.inf if last is None else last)
    )
    if not kept.any():
        raise input_error("--trim", f"keeps no row of {where}", "give seconds within the test")
    frame = frame[kept]
    return frame if how.period_s is None else _resampled(frame, how, how.period_s, where)


def _require_angle(frame: pd.DataFrame, where: str) -> None:
    if "theta_rad" not in frame:
        why = f"{_COUNTS} wrap at a number that the log does not say" if _COUNTS in frame else ""
        raise input_error(where, f"has no theta_rad to unwrap{why and '; ' + why}", "map an angle")


def median_period(time: FloatArray) -> float:
    """Median step (s) between times (n,) s, where they rise; 0 without two."""
    steps = np.diff(time)
    return float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0


def joined_line(row_period: float) -> str:
    """The comment of a log whose columns come from several files; `row_period` (s) the longest."""
    return f"map: joined by time {_BETWEEN.format(row_period)}"


def lines_between(comments: Iterable[str]) -> list[str]:
    """The comments of a log that say that its samples lie between measured rows."""
    return [line for line in comments if _SAYS_BETWEEN.match(line)]


def measured_period(comments: Iterable[str]) -> float | None:
    """The longest period (s) of measured rows that a log's comments say it was made from."""
    found = [float(m[1]) for line in comments if (m := _SAYS_BETWEEN.match(line))]
    return max(found, default=None)


def check_increasing(time: FloatArray, where: str) -> None:
    """InputError where times (n,) s do not rise from row to row."""
    steps = np.diff(time)
    if np.all(steps > 0.0):
        return
    row = int(np.argmax(steps <= 0.0)) + 1
    if steps[row - 1] == 0.0:
        count = int(np.count_nonzero(steps == 0.0))
        stopped = row + count == len(time)
        keep = f"`sysid convert` of this file alone with --rows 0:{row} keeps those before"
        raise input_error(
            where,
            f"time_s repeats {time[row]:.9g} at row {row} of the table, {without_own_time(count)}",
            keep if stopped else "delete these rows, or correct their times",
        )
    raise input_error(
        where,
        f"time_s goes back from {time[row - 1]:.9g} to {time[row]:.9g} at row {row} of the table",
        "sort the rows, or label the tests",
    )


def unwrapped(frame: pd.DataFrame) -> pd.DataFrame:
    """The columns with the angle, if there is one, followed over its turns."""
    if "theta_rad" not in frame:
        return frame
    return frame.assign(theta_rad=np.unwrap(frame["theta_rad"].to_numpy(float)))


def _resampled(frame: pd.DataFrame, how: Reshaping, period: float, where: str) -> pd.DataFrame:
    """Rows every `period` s from the test's first to its last, but for pauses of the recording."""
    import pandas as pd

    time: FloatArray = frame["time_s"].to_numpy(float)
    check_increasing(time, where)
    span = float(time[-1] - time[0])
    # A log holds the time and one channel at least.
    if not period <= span < period * (MOST_CELLS // 2):
        raise input_error(
            "--resample",
            f"{period:g} s does not suit the {span:g} s of {where}",
            "choose another",
        )
    rows = math.floor(span / period + 1e-9) + 1
    grid = time[0] + period * np.arange(rows)
    grid = grid[~signals.in_pauses(time, grid)]
    held = np.clip(np.searchsorted(time, grid + 1e-6 * period, side="right") - 1, 0, None)
    columns = {}
    for name in frame.columns:
        values = frame[name].to_numpy()
        if name == "time_s":
            columns[name] = grid
        elif name == TEST_COLUMN or name in how.held:
            columns[name] = values[held]
        else:
            columns[name] = np.interp(grid, time, values.astype(float))
    return pd.DataFrame(columns)


__all__ = [
    "HELD_COLUMNS",
    "Reshaping",
    "check_increasing",
    "joined_line",
    "measured_period",
    "median_period",
    "read_trim",
    "reshaped",
    "unwrapped",
]
