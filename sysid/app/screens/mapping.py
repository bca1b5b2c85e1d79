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

from sysid.app import edits, parts
from sysid.app.traces import sparkline
from sysid.blocks.html import block_html, coded
from sysid.errors import InputError, together
from sysid.io.channels import LOG_COLUMNS, SIDES, Channel
from sysid.io.conversion import convert
from sysid.io.kinds import KINDS, TEST_KINDS
from sysid.io.listing import ListedChannel, Listing
from sysid.io.plausibility import with_maps
from sysid.io.units import CANONICAL_UNITS
from sysid.parameters.table import in_words
from sysid.pipeline.check import check_file, readable

_PRESSURE = "_pa"
# More channels than these are not all shown; those that are mapped are.
_MOST_CHANNELS = 60
_HOW = "How the file is read"
_TIME = re.compile(r"(?i)(time|t|zeit|timestamp|clock|seconds)\b.*")
# What stands for a test's number at the end of a file's name, any number in it, and a copy's.
_NUMBER = re.compile(r"[\W_]*\d+$")
_ANY_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
_COPY = re.compile(r"\s*\(\d+\)$")
_ANY = "…"
# How a line of the commands says where what is assumed is corrected; a name of files.
_INIT = re.compile(r"\(`sysid init --from [^`]*` writes one to correct\)")
_WORD = re.compile(r"\b[a-z]+(?:_[a-z]+)+\b")
_SET = re.compile(r"`?--set (\w+=[^\s`]+)`?")
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
    ("atmosphere_pa", "--atmosphere", "Atmospheric pressure, for gauge pressures"),
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

    @property
    def says_more(self) -> bool:
        """Whether anything was said of its readings but what they are."""
        return self != Assigned(self.target)

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
    the menus under the channels that a person has set; `is_guessed`: something was filled in as for
    other channels; `known` is what such channels were in other files, the latest first; `ticked` is
    the place among `alike` that was ticked last.
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
    known: list[Assigned] = field(default_factory=list)
    ticked: int | None = None

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
    def families(self) -> dict[str, tuple[str, ...]]:
        """Those of `alike` that seem to belong to the file, by what they are called together.

        The files whose names differ in numbers alone, and of these the ones whose numbers follow
        upon one another.
        """
        own = self.path.name
        family = [n for n in self.alike if family_of(own) and family_of(n) == family_of(own)]
        run = run_of(own, family)
        found = {}
        if run and len(run) < len(family):
            ends = sorted((own, *run), key=_in_order)
            found[f"{len(ends)} from {Path(ends[0]).stem} to {Path(ends[-1]).stem}"] = run
        if family:
            found[f"all {len(family) + 1} of {family_of(own)}"] = tuple(family)
        return found

    @property
    def output(self) -> str:
        """A name for the log, which replaces none: that of its series or file, else of its kind."""
        together = all(series_of(path.name) == self.series for path in self.paths)
        stem = self.series if self.further and self.series and together else self.path.stem
        held = "holdout" if self.use == "holdout" else ""
        kind = "_".join(filter(None, (self.kind, self.valve, held))).replace("-", "_")
        stems = (stem, kind or stem, *(f"{kind or stem}-{n}" for n in range(2, 10_000)))
        names = (f"{stem}.csv" for stem in stems)
        return next(name for name in names if not self.path.with_name(name).exists())

    def tick(self, place: int, on: bool, *, is_span: bool) -> None:
        """Tick one of `alike`, or all from the one that was ticked last, or take them out."""
        first = place if self.ticked is None or not is_span else self.ticked
        names = self.alike[min(first, place) : max(first, place) + 1]
        others = [one for one in self.further if one not in names]
        self.further = sorted((*others, *names), key=_in_order) if on else others
        self.ticked = place

    def choices(self) -> dict[str, Any]:
        """What was chosen, as plain values."""
        assigned = {name: vars(one) for name, one in self.assigned.items()}
        return {"assigned": assigned, "more": self.more}

    def known_with_these(self, known: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """What channels are known to be, one of each kind, as plain values; the latest first."""
        found = {one["target"]: one for one in known}
        own = {one.target: vars(one) for one in self.assigned.values() if one.says_more}
        return list({**own, **{key: one for key, one in found.items() if key not in own}}.values())

    def follow(
        self, known: dict[str, dict[str, Any]], of_kinds: Iterable[dict[str, Any]] = ()
    ) -> None:
        """Take what was chosen for other files, by their channels' names, the latest last.

        All of it where one had the same channels; else what channels of the same names are.
        `of_kinds` is that of `known_with_these`, for the channels that are chosen by hand.
        """
        own = known.get(json.dumps(self.names))
        self.known = [_assigned(one) for one in of_kinds]
        for choices in [own] if own else known.values():
            for name, one in choices.get("assigned", {}).items():
                if name in self.assigned and (own or one["target"]):
                    self.assigned[name] = _assigned(one)
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
        for name, _, shown in _MORE:
            text = self._given(name)
            if not text:
                continue
            try:
                found[name] = _READ.get(name, str)(text)
            except ValueError:
                raise InputError(f"{shown}: {text!r} is no number; give one, or nothing") from None
        return found

    def _given(self, name: str) -> str:
        """What was written into a field, a pressure in Pa; empty where nothing was."""
        text = self.more.get(name, "").strip()
        if not text or name != "atmosphere_pa":
            return text
        return f"{edits.in_si(text, 'Pa', 'Atmospheric pressure', None):.12g}"

    def words(self, output: str) -> list[str]:
        """The command that converts the file."""
        words = ["convert", *(path.name for path in self.paths), "-o", output]
        for one in self.entries():
            words += ["--map", one]
        for name, option, _ in _MORE:
            text = self._given(name)
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
        self.assigned[name] = (
            self._as_target(name, str(text)) if key == "target" else replace(one, **given)
        )

    def _as_target(self, name: str, target: str) -> Assigned:
        """What a channel is from now on: its unit and range stay where they are of this quantity.

        Else they are those of a channel of the same quantity, of this file or of another one.
        """
        one = self.assigned[name]
        si = CANONICAL_UNITS.get(target)
        stays = not target or (not one.target and one.says_more)
        if stays or (one.target and CANONICAL_UNITS.get(one.target) == si and one.says_more):
            return replace(one, target=target)
        others = [other for key, other in self.assigned.items() if key != name]
        # Two times, say a test's and a delay's, are no two of a kind as two pressures are.
        every = [other for other in (*others, *self.known) if other.says_more]
        like = [other for other in every if other.target == target]
        like += [other for other in every if CANONICAL_UNITS.get(other.target) == si]
        if si is None or si == "s" or not like:
            return Assigned(target)
        self.is_guessed = True
        return replace(like[0], target=target, is_reversed=False)

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
            guessed = "Filled in as for the last channels of this kind: check it."
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
        here = _asked(str(error))
        said = parts.note(_here(str(error), chosen), "error") + here
        return Plausible(said, asks=bool(here))
    lines = _lines((*found.contradicts, *found.notices, *made.notices), chosen)
    tables = _SET.sub(r"\1", "".join(block_html(table) for table in found.tables() if table.rows))
    kinds = ", ".join(f"{count} × {kind}" for kind, count in found.kinds.items())
    head = (
        f"{kinds}; {found.rows:,} rows, {found.duration_s:.4g} s, every {found.period_s:.4g} s, "
        f"{found.gaps or 'no'} gaps"
    )
    bad = "warn" if found.contradicts else ""
    kind = next((kind for kind in found.kinds if kind in KINDS), "")
    answer = found.answer_by_itself(kind)
    text = (
        f'<p class="{bad}"><b>{parts.words(head)}</b></p>'
        f"<p>{coded(_here(answer, chosen))}.</p>{_asked(answer)}{parts.listed(lines)}"
        + (parts.fold("what is assumed", parts.listed(_lines(assumed, chosen))) if assumed else "")
        + parts.fold("its channels, and what each parameter needs", tables)
    )
    of_valve = any(one.of_a_valve for one in TEST_KINDS if one.name == kind)
    shown = [item.parameter for item in found.identifies if item.identified and of_valve]
    sides = (side for side in SIDES if any(f"valve {side.upper()}" in name for name in shown))
    return Plausible(text, kind, next(sides, ""), is_log=True, asks=bool(_asked(answer)))


def _asked(text: str) -> str:
    """Where this page has the options that a line of the commands asks for, as markup."""
    asked = (name for _, option, name in _MORE if f"{option} " in text)
    here = "; ".join(f"here: “{name}”, under “{_HOW}”" for name in asked)
    return parts.note(here) if here else ""


def _here(text: str, chosen: Mapping) -> str:
    """A line of the commands as this page says it: of the file that is open, with its fields.

    The log that was checked is another file, which is gone.
    """
    stem = re.escape(chosen.path.stem)
    text = re.sub(rf"\S*sysid-app-\w+[/\\]{stem}\.parquet|{stem}\.parquet", chosen.path.name, text)
    text = text.replace(f"{chosen.path.parent}{os.sep}", "")
    for name, one in chosen.assigned.items():
        if one.target:
            text = text.replace(f"--map {one.entry(name)}", name)
    text = _INIT.sub("(correct them under “Rig” once the log is added)", text)
    text = with_maps(_SET.sub(r"`\1`", text), _in_fields)
    for _, option, shown in _MORE:
        text = re.sub(rf"{option}(?: [A-Z][A-Z:]*)?(?![\w-])", f"“{shown}”", text)
    return in_words(_WORD.sub(lambda found: readable(found[0]), text))


def _in_fields(target: str, unit: str, is_gauge: bool) -> str:
    if " -> " in unit:
        ends = unit.replace("..", ", ").replace("->", "→")
        return f"write {ends} under “sensor's range”"
    gauge = " and tick “gauge”" if is_gauge else ""
    volts = "; if it is a transducer's voltage, give the sensor's range"
    more = volts if target.endswith(_PRESSURE) else ""
    return f"write {unit} under “in unit”{gauge}{more}"


def _lines(texts: Iterable[str], chosen: Mapping) -> Iterator[str]:
    """Lines as this page says them."""
    return together(_here(text, chosen) for text in texts)


def series_of(name: str) -> str:
    """What a file's name is but for a number at its end; empty where it ends with none."""
    stem = Path(name).stem
    found = _NUMBER.search(stem)
    return stem[: found.start()] if found else ""


def family_of(name: str) -> str:
    """What a file's name is but for its numbers, and a copy's; empty where it has none."""
    stem = _COPY.sub("", Path(name).stem)
    family = _ANY_NUMBER.sub(_ANY, stem)
    return family if family != stem else ""


def run_of(name: str, family: Iterable[str]) -> tuple[str, ...]:
    """Those of a file's family whose numbers follow upon its own, in both directions.

    Empty where more than one number of their names varies, or one that counts nothing.
    """
    numbers = {one: _ANY_NUMBER.findall(_COPY.sub("", Path(one).stem)) for one in (name, *family)}
    varying = [i for i, own in enumerate(numbers[name])
               if any(other[i] != own for other in numbers.values())]  # fmt: skip
    if len(varying) != 1:
        return ()
    texts = {one: found[varying[0]].lstrip("-+") for one, found in numbers.items()}
    if not all(text.isdecimal() for text in texts.values()):
        return ()
    places = {one: int(text) for one, text in texts.items()}
    taken, run = set(places.values()), {places[name]}
    for step in (-1, 1):
        place = places[name]
        while place + step in taken:
            place += step
            run.add(place)
    return tuple(sorted((o for o in places if o != name and places[o] in run), key=_in_order))


def _in_order(name: str) -> tuple[str | float, ...]:
    """What names are sorted by, so that 10 comes after 9."""
    texts = re.split(r"(\d+)", name)
    return tuple(float(text) if i % 2 else text for i, text in enumerate(texts))


def _assigned(kept: dict[str, Any]) -> Assigned:
    """What a channel was in another file, as it was kept."""
    pairs = {key: tuple(kept[key]) for key in ("readings", "values")}
    return Assigned(**{**kept, **pairs})


def _named_target(channel: Channel) -> str:
    """A column of the log format in a menu: what it is, and its name in messages and files."""
    said = channel.meaning.partition(",")[0].partition(";")[0]
    return f"{said} ({channel.key})" if said else channel.key


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


__all__ = ["Assigned", "Mapping", "Plausible", "family_of", "plausibility", "run_of", "series_of"]
