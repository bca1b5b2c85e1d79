"""`sysid convert FILE --list`: what a foreign file of any format holds, channel by channel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.io.foreign import ForeignTable, ReadOptions, read_any
from sysid.io.foreign.recipe import read_recipe, with_reading
from sysid.io.reshaping import median_period

# First values that are shown of each channel.
FIRST = 3


@dataclass(frozen=True)
class ListedChannel:
    """A channel: its name and others for the same values, its unit as the file states it, the
    median period of its own clock (s), how many values it has, the first of them, and all of them
    (n,)."""

    name: str
    also: tuple[str, ...]
    unit: str | None
    period_s: float | None
    rows: int
    first: tuple[float | str | None, ...]
    values: Any = field(repr=False, compare=False)

    def to_json(self) -> dict[str, Any]:
        """The channel as JSON types, of its values the first; `rate_hz` is the period's inverse."""
        rate = None if self.period_s is None else 1.0 / self.period_s
        own = {key: value for key, value in vars(self).items() if key != "values"}
        return {**own, "also": list(self.also), "first": list(self.first), "rate_hz": rate}


@dataclass(frozen=True)
class Listing:
    """A file's channels, what in it is not a channel and why, and its reader's notices."""

    path: str
    format: str
    channels: tuple[ListedChannel, ...]
    skipped: dict[str, str]
    notices: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The listing as JSON types."""
        return {
            "path": self.path,
            "format": self.format,
            "channels": [channel.to_json() for channel in self.channels],
            "skipped": self.skipped,
            "notices": list(self.notices),
        }


def channels_of(
    paths: Sequence[Path], *, spec_file: Path | None = None, **reading: Any
) -> list[Listing]:
    """What each file holds, read as `sysid.io.conversion.convert` reads it.

    `reading` is as `sysid.io.foreign.ReadOptions` has it, None where not given. Raises InputError
    where a file cannot be read.
    """
    base = ReadOptions() if spec_file is None else read_recipe(spec_file).read
    options = with_reading(base, reading)
    return [_listing(path, read_any(path, "a file to list", options).table) for path in paths]


def _listing(path: Path, table: ForeignTable) -> Listing:
    periods: dict[int, float | None] = {}
    names: dict[int, list[str]] = {}
    for name, values in table.columns.items():
        names.setdefault(id(values), []).append(name)
    channels = []
    for name, values in table.columns.items():
        others = names[id(values)]
        # The last of several names says most: position[elbow] for position[0].
        if name != others[-1]:
            continue
        clock = table.clocks.get(name)
        period: float | None = None
        if name in table.sampling:
            period = table.sampling[name].period_s
        elif clock is not None:
            if id(clock) not in periods:
                periods[id(clock)] = median_period(clock) or None
            period = periods[id(clock)]
        first = tuple(_value(value) for value in values[:FIRST])
        unit = table.units.get(name)
        also = tuple(others[:-1])
        channels.append(ListedChannel(name, also, unit, period, len(values), first, values))
    return Listing(
        str(path), table.format, tuple(channels), dict(table.skipped), tuple(table.notices)
    )


def _value(value: Any) -> float | str | None:
    """A value as it is listed: a finite number, None where it is empty, else its text."""
    if value is None:
        return None
    if isinstance(value, bool | int | float | np.number | np.bool_):
        number = float(value)
        return number if math.isfinite(number) else None if math.isnan(number) else str(number)
    text = str(value)
    return None if text in ("NaT", "<NA>") else text


__all__ = ["FIRST", "ListedChannel", "Listing", "channels_of"]
