"""Time stamps and times of day in text, as programs and countries write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.errors import input_error
from sysid.types import FloatArray

if TYPE_CHECKING:
    import pandas as pd

# 14:59:58.001, 2:59:58,001 PM, 14:59:58:001; of a part of an hour 59:58.001, with its decimals.
_CLOCK = re.compile(
    r"\s*(?:(?P<hour>\d{1,2}):(?=\d{2}:)|(?=[\d:]+[.,]))(?P<minute>\d{1,2}):"
    r"(?P<second>\d{2}(?:[.,]\d+|:\d{3})?)(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?\s*"
)
_DATE = re.compile(
    r"(?P<one>\d{1,2})(?P<sign>[./-])(?P<two>\d{1,2})(?P=sign)(?P<year>\d{4}|(?<=\.)\d{2}),?[ T]+"
    r"(?P<hour>\d{1,2})(?P<rest>:\d{2}(?::\d{2}(?:[.,]\d+)?)?)(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
)


def dates_in(path: Path, name: str, cells: pd.Series) -> pd.Series | None:
    """Time stamps (n,) in UTC, NaT in cells that are not; None where most cells are not.

    ISO 8601, or day, month and year: day first between dots, and else where a day beyond 12 says
    it. Raises InputError where nothing does, and the seconds between rows depend on it.
    """
    import pandas as pd

    texts = [str(cell).strip() for cell in cells]
    found = [_DATE.fullmatch(text) for text in texts]
    if 2 * sum(match is not None for match in found) > len(texts):
        day_first = _is_day_first(path, name, [match for match in found if match])
        written = ["" if match is None else _as_iso(match, day_first) for match in found]
        return pd.Series(pd.to_datetime(written, format="ISO8601", errors="coerce", utc=True))
    stamps = pd.to_datetime(cells, format="ISO8601", errors="coerce", utc=True)
    return stamps if 2 * stamps.notna().sum() > len(texts) else None


def _is_day_first(path: Path, name: str, dates: Sequence[re.Match[str]]) -> bool:
    if dates[0]["sign"] == ".":
        return True
    days = [sum(int(date[part]) > 12 for date in dates) for part in ("one", "two")]
    if days[0] != days[1]:
        return days[0] > days[1]
    if len({(date["one"], date["two"], date["year"]) for date in dates}) > 1:
        raise input_error(
            path,
            f"column {name} (for time_s): in {dates[0].group()!r} either number may be the day",
            "write dates as 2024-05-14",
        )
    return True  # of one date alone the seconds are the same


def _as_iso(date: re.Match[str], day_first: bool) -> str:
    day, month = (date["one"], date["two"]) if day_first else (date["two"], date["one"])
    year = date["year"] if len(date["year"]) > 2 else f"20{date['year']}"
    hour = int(date["hour"])
    if date["half"] is not None:
        hour = hour % 12 + 12 * (date["half"] in "Pp")
    return f"{year}-{month:0>2}-{day:0>2}T{hour:02}{date['rest'].replace(',', '.')}"


def clock_seconds(cells: Sequence[object]) -> FloatArray | None:
    """Seconds (n,) from the first of times of day, 14:59:58.001, over midnight too.

    NaN in cells that are not; None where most cells are not.
    """
    found = [_CLOCK.fullmatch(str(cell)) for cell in cells]
    if 2 * sum(match is not None for match in found) <= len(found):
        return None
    time = np.array([_second_of_day(match) if match else np.nan for match in found])
    day = timedelta(days=1).total_seconds()
    midnights = np.cumsum(np.diff(time, prepend=time[:1]) < -0.5 * day)
    return np.asarray(np.round(time + day * midnights - time[0], 9))


def _second_of_day(clock: re.Match[str]) -> float:
    hour = float(clock["hour"] or 0)
    if clock["half"] is not None:
        hour = hour % 12 + 12 * (clock["half"] in "Pp")
    second = float(re.sub("[,:]", ".", clock["second"]))
    return 3600.0 * hour + 60.0 * float(clock["minute"]) + second


__all__ = ["clock_seconds", "dates_in"]
