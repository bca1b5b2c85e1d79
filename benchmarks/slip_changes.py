"""Changes of a log's columns that slips are made of, for `slips.py` and `slip_catalogue.py`.

A change of a column that the log does not have leaves the log as it is.
"""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd

FrameChange = Callable[[pd.DataFrame], pd.DataFrame]


def scaled(column: str, factor: float, shift: float = 0.0) -> FrameChange:
    def change(frame: pd.DataFrame) -> pd.DataFrame:
        if column not in frame:
            return frame
        return frame.assign(**{column: frame[column] * factor + shift})

    return change


def swapped(first: str, second: str) -> FrameChange:
    def change(frame: pd.DataFrame) -> pd.DataFrame:
        if first not in frame or second not in frame:
            return frame
        return frame.assign(**{first: frame[second], second: frame[first]})

    return change


def spiked(column: str, value: float) -> FrameChange:
    """One sample in the middle of the log at `value`."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        if column not in frame:
            return frame
        frame = frame.copy()
        frame.loc[len(frame) // 2, column] = value
        return frame

    return change


def only_time(frame: pd.DataFrame) -> pd.DataFrame:
    """Every channel but the time held at its first sample."""
    own = {c: frame[c].iloc[0] for c in frame.columns if c not in ("time_s", "test")}
    return frame.assign(**own)
