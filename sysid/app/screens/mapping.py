"""A file of another program: its channels, and what each of them is in the log format."""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.app import parts
from sysid.app.traces import sparkline
from sysid.blocks.html import block_html, coded
from sysid.errors import InputError
from sysid.io.channels import LOG_COLUMNS, SIDES, Channel
from sysid.io.conversion import convert
from sysid.io.kinds import KINDS, TEST_KINDS
from sysid.io.listing import ListedChannel, Listing
from sysid.io.plausibility import with_maps
from sysid.io.units import CANONICAL_UNITS
from sysid.pipeline.check import check_file

_PRESSURE = "_pa"
# More channels than these are not all shown; those that are mapped are.
_MOST_CHANNELS = 60
_HOW = "How the file is read"
_TIME = re.compile(r"(?i)(time|t|zeit|timestamp|clock|seconds)\b.*")
# What stands for a test's number at the end of a file's name.
_NUMBER = re.compile(r"[\W_]*\d+$")
# What `convert` is told besides, as it is written on the command line, and its name there.
_MORE = (
    ("period_s", "--period", "Sampling period, s, if no column holds the time"),
    ("delimiter", "--delimiter", "Delimiter of a text file"),
    ("decimal", "--decimal", "Decimal separator"),
    ("skip_rows", "--skip-rows", "Lines to skip at the top"),
    ("sheet", "--sheet", "Sheet of a workbook"),
    ("rows", "--rows", "Rows to keep, FIRST:LAST"),
    ("trim", "--trim", "Seconds of each test to keep, FROM:TO"),
    ("resample_s", "--resample", "Even sampling period of the log, s"),
    ("atmosphere_pa", "--atmosphere", "Atmospheric pressure, Pa, for gauge pressures"),
    ("constants", "--set", "What no column holds, such as position_m=0.1"),
)
_READ: dict[str, Any] = {
    **dict.fromkeys(("period_s", "resample_s", "atmosphere_pa"), float),
    "skip_rows": int,
    "constants": str.split,
}


@dataclass(frozen=True)
class Assigned:
    """What a channel is: the log's column, and how its readings become that column's unit.

    `readings` and `values` are the ends of a sensor's range, in order.
    """

    target: str = ""
    unit: str = ""
    is_gauge: bool = False
    is_reversed: bool = False
    readings: tuple[str, str] = ("", "")
    values: tuple[str, str] = ("", "")

    def entry(self, column: str) -> str:
        """The entry of --map. Raises InputError for half a range."""
        si = CANONICAL_UNITS.get(self.target) or ""
        given = [text for text in (*self.readings, *self.values) if text]
        unit = self.unit + ("(g)" if self.is_gauge else "")
        if given:
            if len(given) < 4:
                what = f"{column}: a sensor's range has two readings and their two values"
                raise InputError(f"{what}; fill in all four, or none")
            ends = self.values[::-1] if self.is_reversed else self.values
            return f"{self.target}={column}:{'..'.join(self.readings)} -> {'..'.join(ends)} " + (
                unit if self.unit else f"{si}{unit}"
            )
        if self.is_reversed:
            return f"{self.target}={column}:-1 {unit if self.unit else si + unit}"
        if unit:
            return f"{self.target}={column}:{unit if self.unit else si + unit}"
        return f"{self.target}={column}" + (":" if ":" in column else "")


@dataclass
class Mapping:
    """A file's listing, and what was chosen for each of its channels.

    `alike` are further files of the folder with the same channels, `further` those of them that
    become tests of the same log; `is_asked`: how the file is read has to be said; `by_hand` are
    the menus under the channels that a person has set; `is_guessed`: the channels are what those
    of their names were in another file.
    """

    path: Path
    listing: Listing
    assigned: dict[str, Assigned] = field(default_factory=dict)
    more: dict[str, str] = field(default_factory=dict)
    kind: str = ""
    use: str = "fit"
    valve: str = ""
    alike: tuple[str, ...] = ()
    further: list[str] = field(default_factory=list)
    is_asked: bool = False
    by_hand: set[str] = field(default_factory=set)
    is_guessed: bool = False

    def __post_init__(self) -> None:
        clock = _clock(self.listing.channels)
        for channel in self.listing.channels:
            names = (channel.name, *channel.also)
            own = next((name for name in names if name in CANONICAL_UNITS), "")
            self.assigned[channel.name] = Assigned(own)
        if clock and not any(one.target == "time_s" for one in self.assigned.values()):
            self.assigned[clock] = Assigned("time_s")

    @property
    def names(self) -> tuple[str, ...]:
        """The channels' names."""
        return tuple(channel.name for channel in self.listing.channels)

    @property
    def paths(self) -> list[Path]:
        """The file and the further ones."""
        return [self.path, *(self.path.with_name(name) for name in self.further)]

    @property
    def series(self) -> str:
        """What the file's name is but for a test's number at its end; empty where it has none."""
        return series_of(self.path.name)

    @property
    def output(self) -> str:
        """A name for the log, that of the series where it has several of it; none is replaced."""
        together = all(series_of(path.name) == self.series for path in self.paths)
        stem = self.series if self.further and self.series and together else self.path.stem
        names = (f"{stem}{end}.csv" for end in ("", *(f"-{n}" for n in range(2, 10_000))))
        return next(name for name in names if not self.path.with_name(name).exists())

    def choices(self) -> dict[str, Any]:
        """What was chosen, as plain values."""
        assigned = {name: vars(one) for name, one in self.assigned.items()}
        return {"assigned": assigned, "more": self.more}

    def follow(self, known: dict[str, dict[str, Any]]) -> None:
        """Take what was chosen for other files, by their channels' names, the latest last.

        All of it where one had the same channels; else what channels of the same names are.
        """
        own = known.get(json.dumps(self.names))
        for choices in [own] if own else known.values():
            for name, one in choices.get("assigned", {}).items():
                if name in self.assigned and (own or one["target"]):
                    pairs = {key: tuple(one[key]) for key in ("readings", "values")}
                    self.assigned[name] = Assigned(**{**one, **pairs})
                    self.is_guessed = own is None
        if own:
            self.more.update(own.get("more", {}))

    @property
    def is_in_format(self) -> bool:
        """Whether the file is a log as it stands: all its mapped columns have their own names."""
        named = {name: one for name, one in self.assigned.items() if one.target}
        plain = all(one == Assigned(name) for name, one in named.items())
        return plain and "time_s" in named and self.path.suffix in (".csv", ".parquet")

    def entries(self) -> list[str]:
        """The entries of --map."""
        return [one.entry(name) for name, one in self.assigned.items() if one.target]

    def options(self) -> dict[str, Any]:
        """What `convert` is told besides. Raises InputError for a text that is no number."""
        found: dict[str, Any] = {}
        for name, option, _ in _MORE:
            text = self.more.get(name, "").strip()
            if not text:
                continue
            try:
                found[name] = _READ.get(name, str)(text)
            except ValueError:
                raise InputError(f"{option}: {text!r} is no number; give one, or nothing") from None
        return found

    def words(self, output: str) -> list[str]:
        """The command that converts the file."""
        words = ["convert", *(path.name for path in self.paths), "-o", output]
        for one in self.entries():
            words += ["--map", one]
        for name, option, _ in _MORE:
            text = self.more.get(name, "").strip()
            for one in text.split() if name == "constants" else [text] if text else []:
                words += [option, one]
        return words

    def chosen(self, place: int, key: str, value: Any) -> None:
        """A choice for the channel at `place` of the listing."""
        name = self.listing.channels[place].name
        one = self.assigned[name]
        text: Any = value if isinstance(value, bool) else str(value).strip()
        if key in ("r0", "r1", "v0", "v1"):
            attribute = "readings" if key[0] == "r" else "values"
            pair = list(getattr(one, attribute))
            pair[int(key[1])] = str(text)
            key, text = attribute, tuple(pair)
        given: dict[str, Any] = {key: text}
        self.assigned[name] = replace(one, **given)

    # --- as it is shown -------------------------------------------------------------------

    def form(self) -> str:
        """The channels, each with a menu of what it is."""
        shown = self.listing.channels[:_MOST_CHANNELS]
        empty = {channel.name: "holds no value" for channel in shown if _is_empty(channel)}
        lines = [self._line(i, c) for i, c in enumerate(shown) if c.name not in empty]
        head = ("Channel", "Unit", "Rate", "First values", "", "is", "in unit", "gauge", "reversed",
                "sensor's range: readings → values")  # fmt: skip
        hidden = len(self.listing.channels) - len(shown)
        said = parts.note(f"{hidden} more channels are not shown") if hidden > 0 else ""
        skipped = "".join(
            f"<li>{parts.words(n)}: {parts.words(why)}</li>"
            for n, why in {**self.listing.skipped, **empty}.items()
        )
        listed = parts.fold("not channels", f"<ul>{skipped}</ul>") if skipped else ""
        more = "".join(
            f'<label class="field">{parts.words(text)} '
            f"{parts.entry(f'map-more:{name}', self.more.get(name, ''), text)}</label>"
            for name, _, text in _MORE
        )
        caption = f"{self.path.name}: {self.listing.format}, {len(self.listing.channels)} channels"
        if self.is_guessed:
            guessed = "Filled in as for the last file with such channels: check it."
            said += parts.note(guessed, "warn")
        return (
            f'<div class="mapping">{parts.rows(head, lines, caption)}</div>' + said + listed
            + parts.fold(_HOW, f'<div class="fields">{more}</div>', is_open=self.is_asked)
        )  # fmt: skip

    def _line(self, place: int, channel: ListedChannel) -> list[str]:
        one = self.assigned[channel.name]
        targets = [("", "—"), *((c.key, _named_target(c)) for c in LOG_COLUMNS.values())]
        first = ", ".join("" if v is None else _short(v) for v in channel.first)
        rate = "" if channel.period_s is None else f"{1.0 / channel.period_s:.4g} Hz"
        what = f"map:{place}:"
        ends = "".join(
            parts.entry(f"{what}{key}", text, f"{channel.name}, {label}", size=3)
            + (" → " if key == "r1" else " ")
            for key, text, label in (
                ("r0", one.readings[0], "first reading"), ("r1", one.readings[1], "last reading"),
                ("v0", one.values[0], "value of the first"), ("v1", one.values[1], "of the last"),
            )
        )  # fmt: skip
        return [
            f"<b>{parts.words(channel.name)}</b>", parts.words(channel.unit or ""),
            f"<nobr>{rate}</nobr>" if rate else "", f"<nobr>{parts.words(first)}</nobr>",
            sparkline(channel.values) if np.asarray(channel.values).dtype.kind in "fiu" else "",
            parts.select(f"{what}target", targets, one.target, f"{channel.name} is"),
            parts.entry(f"{what}unit", one.unit, f"{channel.name}, unit", size=5,
                        hint=channel.unit or "SI"),
            parts.tick(f"{what}is_gauge", "", one.is_gauge),
            parts.tick(f"{what}is_reversed", "", one.is_reversed),
            f'<span class="ends">{ends}</span>',
        ]  # fmt: skip


@dataclass(frozen=True)
class Plausible:
    """What a log would be, as markup; the kind of test, and the valve, that it seems to be of.

    `is_log`: it could be converted and read; `asks`: how the file is read has to be said first.
    """

    text: str
    kind: str = ""
    valve: str = ""
    is_log: bool = False
    asks: bool = False


def plausibility(chosen: Mapping, rig: Path | None) -> Plausible:
    """What the log would be: converted into a folder that is thrown away, and checked."""
    try:
        entries = chosen.entries()
        if not any(one.target not in ("", "time_s") for one in chosen.assigned.values()):
            said = (
                "Say under “is” what the channels are that you need, the time first, and under “in "
                "unit” their units. A transducer's volts become a pressure by its sensor's range, "
                "such as 0.5, 4.5 → 0, 10 in bar."
            )
            return Plausible(parts.note(said))
        with tempfile.TemporaryDirectory(prefix="sysid-app-") as folder:
            output = Path(folder) / f"{chosen.path.stem}.parquet"
            given = chosen.options()
            made = convert(chosen.paths, output, maps=entries, **given)
            found, assumed = check_file(output, rig, {}, ())
    except InputError as error:
        asked = (text for _, option, text in _MORE if option in str(error))
        here = "; ".join(f"here: “{text}”, under “{_HOW}”" for text in asked)
        said = parts.note(_here(str(error), chosen), "error") + (parts.note(here) if here else "")
        return Plausible(said, asks=bool(here))
    lines = _lines((*found.contradicts, *found.notices, *made.notices), chosen)
    tables = "".join(block_html(table) for table in found.tables() if table.rows)
    kinds = ", ".join(f"{count} × {kind}" for kind, count in found.kinds.items())
    head = (
        f"{kinds}; {found.rows:,} rows, {found.duration_s:.4g} s, every {found.period_s:.4g} s, "
        f"{found.gaps or 'no'} gaps"
    )
    bad = "warn" if found.contradicts else ""
    text = (
        f'<p class="{bad}"><b>{parts.words(head)}</b></p>'
        f"<p>{coded(_here(found.answer, chosen))}.</p>{parts.listed(lines)}"
        + (parts.fold("what is assumed", parts.listed(_lines(assumed, chosen))) if assumed else "")
        + parts.fold("its channels, and what each parameter needs", tables)
    )
    kind = next((kind for kind in found.kinds if kind in KINDS), "")
    of_valve = any(one.of_a_valve for one in TEST_KINDS if one.name == kind)
    shown = [item.parameter for item in found.identifies if item.identified and of_valve]
    sides = (side for side in SIDES if any(f"valve {side.upper()}" in name for name in shown))
    return Plausible(text, kind, next(sides, ""), is_log=True)


def _here(text: str, chosen: Mapping) -> str:
    """A line of the commands as this page says it: of the file that is open, with its fields.

    The log that was checked is another file, which is gone.
    """
    stem = re.escape(chosen.path.stem)
    text = re.sub(rf"\S*sysid-app-\w+[/\\]{stem}\.parquet|{stem}\.parquet", chosen.path.name, text)
    text = text.replace(f"{chosen.path.parent}{os.sep}", "")
    return with_maps(text, _in_fields)


def _in_fields(target: str, unit: str, is_gauge: bool) -> str:
    gauge = " and tick “gauge”" if is_gauge else ""
    volts = "; if it is a transducer's voltage, give the sensor's range"
    more = volts if target.endswith(_PRESSURE) else ""
    return f"write {unit} under “in unit”{gauge}{more}"


def _lines(texts: Iterable[str], chosen: Mapping) -> Iterator[str]:
    """Lines as this page says them; what is said of several files is said once."""
    places: dict[str, list[str]] = {}
    for text in texts:
        place, _, said = _here(text, chosen).partition(": ")
        places.setdefault(said, []).append(place)
    for said, found in places.items():
        names = list(dict.fromkeys(found))
        place = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
        yield f"{place}: {said}" if said else place


def series_of(name: str) -> str:
    """What a file's name is but for a number at its end; empty where it ends with none."""
    stem = Path(name).stem
    found = _NUMBER.search(stem)
    return stem[: found.start()] if found else ""


def _named_target(channel: Channel) -> str:
    """A column of the log format in a menu: its name, and what it is."""
    said = channel.meaning.partition(",")[0].partition(";")[0]
    return f"{channel.key}: {said}" if said else channel.key


def _clock(channels: Sequence[ListedChannel]) -> str:
    """The channel that holds the time: it grows from row to row, and is no count of the rows.

    One that counts may be a time in its own sampling period, if its name says so. Of several that
    with a unit; none where the file states its period.
    """
    found = []
    for channel in channels:
        values = np.asarray(channel.values)
        if channel.period_s is None and values.dtype.kind in "fiu" and len(values) > 1:
            steps = np.diff(values)
            counts = bool((steps == 1.0).all()) and not _TIME.fullmatch(channel.name)
            if bool((steps > 0.0).all()) and not counts:
                found.append(channel)
    return next((c.name for c in sorted(found, key=lambda c: c.unit is None)), "")


def _is_empty(channel: ListedChannel) -> bool:
    values = np.asarray(channel.values)
    return values.dtype.kind == "f" and not np.isfinite(values).any()


def _short(value: float | str) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)[:24]


__all__ = ["Assigned", "Mapping", "Plausible", "plausibility", "series_of"]
