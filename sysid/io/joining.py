"""Columns of separate files brought together by time, for `sysid convert --join`.

Each joined column is taken at the first file's time stamps: measured signals on the line between
their own rows, commands held. Only what all files cover is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import InputError, input_error
from sysid.io.alignment import is_held, values_at, within
from sysid.io.channels import TEST_COLUMN
from sysid.io.reshaping import HELD_COLUMNS, check_increasing, median_period
from sysid.types import FloatArray

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class TimedColumns:
    """A file's columns (SI) with `time_s`; `origin` is the time stamp of second 0, if it has one.

    `shift_s` is added to its times; columns that `held` names hold from row to row.
    """

    where: str
    frame: pd.DataFrame
    origin: Any = None
    shift_s: float = 0.0
    held: tuple[str, ...] = HELD_COLUMNS

    @property
    def row_period(self) -> float:
        """Median period of its rows, s."""
        return median_period(self.frame["time_s"].to_numpy(float))

    def times(self, first: TimedColumns) -> FloatArray:
        """The file's times (n,) s on the clock of the first file. Raises InputError."""
        own = self.frame["time_s"].to_numpy(float) + self.shift_s
        if self.origin is None and first.origin is None:
            return own
        if self.origin is None or first.origin is None:
            if self.shift_s:
                return own
            raise input_error(
                self.where,
                f"one of it and {first.where} holds time stamps, the other seconds: their clocks "
                "have an unknown offset",
                "give that time with --join-shift SECONDS",
            )
        try:
            return np.asarray(own + (self.origin - first.origin).total_seconds(), dtype=float)
        except TypeError:
            raise input_error(
                self.where,
                f"its time stamps and those of {first.where} are not of one kind (time zone)",
                "write both with the same time zone",
            ) from None


def joined(
    first: TimedColumns, others: Sequence[TimedColumns], fill: str | None = None
) -> tuple[pd.DataFrame, str]:
    """The first file's rows with the others' columns, and a notice of what was kept.

    `fill` overrules whether columns are held or linear (`sysid.io.alignment`). Raises InputError
    where files have a column in common, hold several tests, do not increase in time, or do not
    overlap.
    """
    for one in (first, *others):
        # The rows' label is the first file's, where they have one.
        if TEST_COLUMN in one.frame and (one is not first or _is_of_several(one.frame)):
            fix = "keep one with --rows FIRST:LAST"
            if one is not first:
                fix = (
                    "--rows cuts the first file only: convert this one first, with --rows, and "
                    "join the result"
                )
            raise input_error(one.where, "holds several tests", fix)
    time = first.times(first)
    check_increasing(time, first.where)
    clocks = [other.times(first) for other in others]
    inside = np.ones(len(time), dtype=bool)
    for clock, other in zip(clocks, others, strict=True):
        check_increasing(clock, other.where)
        inside &= within(time, clock)
        if np.count_nonzero(inside) < 2:
            raise _apart(time, clock, first.where, other.where)
    frame = first.frame[inside].reset_index(drop=True)
    for clock, other in zip(clocks, others, strict=True):
        _add(frame, time[inside], clock, other, first.where, fill)
    kept = time[inside]
    return frame, (
        f"{first.where}: joined with {', '.join(o.where for o in others)} by time, where all have "
        f"samples: {kept[0]:.6g} to {kept[-1]:.6g} s, {len(kept)} of {len(time)} rows"
    )


def _is_of_several(frame: pd.DataFrame) -> bool:
    return frame[TEST_COLUMN].nunique() > 1


def _apart(time: FloatArray, clock: FloatArray, first: str, other: str) -> InputError:
    """The error where fewer than two of the first file's rows are within the other's times."""
    own = f"its time, {clock[0]:.6g} to {clock[-1]:.6g} s,"
    span = f"{time[0]:.6g} to {time[-1]:.6g} s of {first}"
    if clock[-1] < time[0] or time[-1] < clock[0]:
        return input_error(
            other,
            f"{own} does not overlap with {span}",
            "give the difference of their clocks with --join-shift SECONDS",
        )
    return input_error(
        other,
        f"{own} lies between rows of {span}, which are {np.median(np.diff(time)):.4g} s apart",
        "check the unit of either time, or give the difference of their clocks with --join-shift "
        "SECONDS",
    )


def _add(
    frame: pd.DataFrame,
    time: FloatArray,
    clock: FloatArray,
    other: TimedColumns,
    where: str,
    fill: str | None,
) -> None:
    """Put the other file's columns at `time` (n,) s into the frame, in place."""
    for name in other.frame.columns:
        if name == "time_s":
            continue
        if name in frame:
            raise input_error(
                other.where, f"has {name}, and so has {where}", "remove one of them from the maps"
            )
        values = other.frame[name].to_numpy(float)
        frame[name] = values_at(time, clock, values, is_held(name, fill, other.held))


__all__ = ["TimedColumns", "joined"]
