"""Files: recordings of any format become logs of the campaign; the rig file is a form."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from sysid.app import edits, parts
from sysid.app.jobs import Job
from sysid.app.screens.base import Screen
from sysid.app.screens.mapping import Mapping, Plausible, plausibility
from sysid.blocks import numbers
from sysid.blocks.titles import use_word
from sysid.errors import InputError
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign import USES, Campaign
from sysid.io.conversion import sources_of
from sysid.io.declaration import ChoiceKey, Key, NumberKey, declared_keys
from sysid.io.files import stamp_of
from sysid.io.foreign import names_in
from sysid.io.kinds import KINDS, TEST_KINDS
from sysid.io.listing import channels_of
from sysid.io.rig import constant_in, read_toml
from sysid.io.rig_file import RIG_TABLES
from sysid.io.rig_template import rig_text

_HIDDEN = (".toml", ".py", ".md", ".html", ".h", ".png", ".txt~")
_MOST_FILES = 200
# What was chosen for a file's channels, by their names: another one's with the same are the same.
_MAPPINGS = "channels of files"
_KINDS_OF_CHANNELS = "channels by what they are"
_WOULD_BE = "What this log would be"
_UNITS = (
    "A number is in the unit at its right, or in the one that is written after it: 4.6 cm2, "
    "30 degC, 2.1 bar(g)."
)
_ASSUMED = (
    "What is marked assumed is the reference rig's value: write your rig's over it, or click the "
    "mark where it is right."
)


@dataclass(frozen=True)
class FilesContent:
    """The campaign (or why it has none), files next to it, and the rig file's content."""

    campaign: Campaign | None
    why: str
    files: tuple[str, ...]
    rig: dict[str, Any] | None
    rig_why: str
    converted: frozenset[str]


class FilesScreen(Screen):
    """What recordings a campaign has, and what is known about the rig."""

    title = "Files"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.mapping: Mapping | None = None
        self.pending: Mapping | None = None
        self.shown: dict[str, Any] = {}
        self.needs = ""
        self.refused: dict[str, float | str | None] = {}
        self.content: FilesContent | None = None
        self.add = parts.html("")
        self.form = parts.html("")
        self.plausible = parts.html("")
        self.adding = parts.html("")
        self.logs = parts.html("")
        self.rig = parts.html("")
        self._checking: asyncio.Future[None] | None = None
        self._finding: asyncio.Future[None] | None = None
        self._is_stale = self._is_log = False

    # --- reading --------------------------------------------------------------------------

    def read(self) -> FilesContent:
        why, rig_why, rig = "", "", None
        try:
            campaign = self.bench.campaign()
        except InputError as error:
            campaign, why = None, str(error)
        path = self.bench.rig_file
        if path is not None:
            try:
                rig = read_toml(path, "a rig file")
            except InputError as error:
                rig_why = str(error)
        logs = [log.path for log in campaign.logs if log.path.suffix == ".csv"] if campaign else []
        converted = frozenset(name for log in logs for name in sources_of(log))
        return FilesContent(campaign, why, tuple(self._files(campaign)), rig, rig_why, converted)

    def _files(self, campaign: Campaign | None) -> Iterator[str]:
        """Files of the folder that may be recordings and are no logs of the campaign yet."""
        known = {e.path.resolve() for e in campaign.logs} if campaign else set()
        found = sorted(self.bench.folder.iterdir())
        for path in found[:_MOST_FILES]:
            usual = not path.name.startswith(".") and path.suffix not in _HIDDEN
            is_new = usual and path.is_file() and path.resolve() not in known
            if is_new and (path.suffix != ".json" or path not in self.bench.bundles()):
                yield path.name

    # --- drawing --------------------------------------------------------------------------

    def draw(self, content: FilesContent) -> list[Any]:
        self.content = content
        self.add.object = self._add()
        self.logs.object = self._logs()
        self.rig.object = self._rig()
        return [self.add, self.form, self.plausible, self.adding, self.logs, self.rig]

    def _add(self) -> str:
        content = self.content
        assert content is not None
        chosen = self.mapping.path.name if self.mapping else ""
        taken = self._converted
        left = sum(name not in taken for name in content.files)
        count = f"{left}" if left == len(content.files) else f"{left} of {len(content.files)} left"
        files = [("", f"choose a file of the folder ({count})")]
        files += sorted(((f, f"{f} (converted)" if f in taken else f) for f in content.files),
                        key=lambda pair: pair[0] in taken)  # fmt: skip
        menu = parts.select("file", files, chosen, "A file of the folder")
        pick = parts.button("Choose files …", "choose-file", kind="primary")
        return (
            '<h2>Recordings</h2><div class="drop">Drop files here: oscilloscopes, PLC traces, NI, '
            "MATLAB, Excel, Parquet, CSV and what else <code>sysid convert</code> reads. "
            f"They are copied into the campaign's folder. {pick} or {menu}</div>"
        )

    @property
    def _converted(self) -> frozenset[str]:
        """The files of which the campaign's logs were made."""
        return frozenset() if self.content is None else self.content.converted

    def _draw_mapping(self) -> None:
        mapping = self.mapping
        if self.content is not None:
            self.add.object = self._add()
        self.form.object = "" if mapping is None else mapping.form()
        self.adding.object = "" if mapping is None else self._adding(mapping)
        if mapping is None:
            self.plausible.object = ""

    def _adding(self, mapping: Mapping) -> str:
        kinds = [("", "kind of test"), *((k.name, f"{k.name}: {k.content}") for k in TEST_KINDS)]
        uses = [(use, use_word(use)) for use in USES]
        valves = [("", "no valve"), ("a", "valve A"), ("b", "valve B")]
        text = "Add to the campaign" if mapping.is_in_format else "Convert and add to the campaign"
        files = "".join(parts.tick(f"also:{i}", name, name in mapping.further)
                        for i, name in enumerate(mapping.alike))  # fmt: skip
        every = "".join(
            parts.button(f"{title}", f"also-all:{i}", kind="small",
                         off=set(names) <= set(mapping.further)) + " "
            for i, (title, names) in enumerate(mapping.families.items())
        )  # fmt: skip
        hint = "Shift-click ticks all between." if len(mapping.alike) > 2 else ""
        also = (
            f"<p>Further tests of this log, from files with the same channels: {every}{hint}</p>"
            f'<div class="ticks" data-span>{files}</div>'
        )
        return (
            (also if mapping.alike else "")
            + '<div class="bar2">'
            + parts.select("add-kind", kinds, mapping.kind, "Kind of test")
            + parts.select("add-use", uses, mapping.use, "Use")
            + parts.select("add-valve", valves, mapping.valve, "Valve")
            + parts.button(text, "add", kind="primary", off=not (mapping.kind and self._is_log))
            + parts.button("Close", "close-file")
            + "</div>"
        )

    def _logs(self) -> str:
        content = self.content
        assert content is not None
        if content.campaign is None:
            path = self.bench.campaign_file
            if path is None or not path.is_file():
                said = "No campaign yet. Drop or choose a recording: the first one begins it."
                return "<h2>Campaign</h2>" + parts.note(said)
            return "<h2>Campaign</h2>" + parts.note(content.why, "warn")
        lines = []
        for number, entry in enumerate(content.campaign.logs):
            held = entry.use == "holdout"
            valve = f" valve {entry.valve.upper()}" if entry.valve else ""
            maps = ", ".join(map(str, entry.mapping.values()))
            kinds = [(k, k) for k in dict.fromkeys((entry.kind, *KINDS))]
            lines.append([
                f"<b>{parts.words(entry.file)}</b>",
                parts.select(f"log-kind:{number}", kinds, entry.kind, f"Kind of {entry.file}")
                + parts.words(valve),
                parts.button("held out" if held else "training", f"log-use:{number}", kind="small",
                             title="Train on it" if held else "Hold it out"),
                f"{len(entry.exclude)}" if entry.exclude else "",
                f"<code>{parts.words(maps)}</code>" if maps else "",
                parts.button("Remove", f"log-remove:{number}", kind="small",
                             title="Take it out of the campaign; the file stays"),
            ])  # fmt: skip
        head = ("Log", "Kind of test", "Use", "Excluded", "Columns", "")
        notices = parts.listed(content.campaign.notices)
        return "<h2>Campaign</h2>" + parts.rows(head, lines, as_cards=True) + notices

    # --- the rig --------------------------------------------------------------------------

    def _rig(self) -> str:
        content = self.content
        assert content is not None
        if content.rig is None:
            why = content.rig_why or "no rig file yet; it is made with the first log"
            return "<h2>Rig</h2>" + parts.note(why, "warn")
        ask = parts.button("What do the logs show?", "rig-shown")
        given = [n for n in RIG_TABLES if n in content.rig or f"[{n}]" in self.needs]
        rest = [name for name in RIG_TABLES if name not in given]
        cards = "".join(self._section(name, content.rig) for name in given)
        folds = "".join(self._section(name, content.rig) for name in rest)
        said = parts.note(_UNITS)
        said += parts.note(_ASSUMED) if content.rig.get("assumed") else ""
        return (
            f"<h2>Rig</h2>{said}<p>{ask}</p><div class='cards'>{cards}</div>"
            f"<div class='cards'>{folds}</div>"
        )

    def _section(self, name: str, content: dict[str, Any]) -> str:
        keys = declared_keys(RIG_TABLES[name])
        motion: Any = content.get("rig", {}).get("motion", "rotary")
        table = content.get(name, {})
        lines = []
        for key, declared in keys.items():
            if key not in table and declared.line(motion) is None:
                continue
            lines.append(self._field(name, key, declared, content))
        shown = "the logs show" if any(k.startswith(f"{name}.") for k in self.shown) else ""
        inner = parts.rows(("", "", "", shown), lines)
        if name not in content and f"[{name}]" not in self.needs:
            return parts.fold(f"[{name}]: not given", inner)
        return parts.card(f"[{name}]", inner)

    def _field(self, section: str, key: str, declared: Key, content: dict[str, Any]) -> list[str]:
        value = content.get(section, {}).get(key, "")
        assumed = f"{section}.{key}" in content.get("assumed", ())
        mark = parts.button("assumed", f"keep:{section}:{key}", kind="small",
                            title="It is right: no longer assumed") if assumed else ""  # fmt: skip
        if value == "" and key in self.needs:
            mark = '<small class="error">is needed</small>'
        if f"{section}:{key}" in self.refused:
            value = self.refused[f"{section}:{key}"] or ""
            mark = '<small class="error">not taken</small>'
        what, label = f"rig:{section}:{key}", f"[{section}] {key}"
        unit = ""
        if isinstance(declared, ChoiceKey):
            options = [(one, one) for one in declared.allowed]
            field = parts.select(what, options, str(value), label)
        else:
            field = parts.entry(what, value, label, size=11)
        if isinstance(declared, NumberKey):
            limits = declared.range
            reach = f"{limits.lower:g} to {limits.upper:g}"
            unit = f'<small title="{reach}">{parts.words(numbers.unit(limits.unit))}</small>'
        about = parts.message(declared.description)
        name = f'{parts.words(key)} {mark}<small class="about">{about}</small>'
        shown = self.shown.get(f"{section}.{key}")
        take = "" if shown is None else parts.button(
            f"{shown:.6g}" if isinstance(shown, float) else str(shown), f"take:{section}:{key}",
            kind="small", title="Take this value",
        )  # fmt: skip
        return [name, field, unit, take]

    # --- what is done ---------------------------------------------------------------------

    async def do(self, what: str, value: Any) -> None:
        act, _, rest = what.partition(":")
        if act == "file":
            await self._open(str(value))
        elif act in ("map", "map-more") and self.mapping is not None:
            await self._map(act, rest, value)
        elif act in ("add-kind", "add-use", "add-valve") and self.mapping is not None:
            setattr(self.mapping, act.removeprefix("add-"), str(value))
            self.mapping.by_hand.add(act)
            self.adding.object = self._adding(self.mapping)
        elif act == "also" and self.mapping is not None:
            place, _, span = rest.partition(":")
            self.mapping.tick(int(place), bool(value), is_span=bool(span))
            self._check()
        elif act == "also-all" and self.mapping is not None:
            own = list(self.mapping.families.values())[int(rest)]
            chosen = {*self.mapping.further, *own}
            self.mapping.further = [name for name in self.mapping.alike if name in chosen]
            self._check()
        elif act == "add" and self.mapping is not None:
            self._add_log(self.mapping)
        elif act == "close-file":
            self.mapping = None
            self._draw_mapping()
        elif act.startswith("log-"):
            self._change_log(act, int(rest), value)
        elif act == "rig-shown":
            await self._show_what_logs_show()
        elif act in ("rig", "take", "keep"):
            key = rest.replace(":", ".")
            if act != "rig":
                rig = self.content.rig if self.content is not None else None
                value = self.shown.get(key) if act == "take" else constant_in(rig or {}, key)
            self._change_rig(rest, value)

    async def _open(self, name: str) -> None:
        if not name:
            return
        path = self.bench.folder / Path(name).name
        self.mapping = None
        self._draw_mapping()
        listings = await asyncio.to_thread(channels_of, [path])
        self.mapping = Mapping(path, listings[0])
        kept = self.bench.journal.kept
        self.mapping.follow(kept.get(_MAPPINGS, {}), kept.get(_KINDS_OF_CHANNELS, ()))
        self._draw_mapping()
        self._check()
        document: Any = parts.pn.state.curdoc
        self._finding = asyncio.ensure_future(self._find_alike(self.mapping, document))

    async def _find_alike(self, mapping: Mapping, document: Any) -> None:
        """The files like this one, outside of the document's lock: of many each has to be read."""
        found = await asyncio.to_thread(self._alike, mapping)

        def draw() -> None:
            mapping.alike = found
            if mapping is self.mapping:
                self.adding.object = self._adding(mapping)

        document.add_next_tick_callback(draw)

    def _alike(self, mapping: Mapping) -> tuple[str, ...]:
        """Other files of the folder, in no log yet, that have the same channels."""
        files = self.content.files if self.content is not None else ()
        own, found = self._names(mapping.path), []
        for name in files:
            path = self.bench.folder / name
            is_other = path.suffix == mapping.path.suffix and path != mapping.path
            if is_other and name not in self._converted and own and self._names(path) == own:
                found.append(name)
        return tuple(found)

    def _names(self, path: Path) -> tuple[str, ...]:
        """The names of a file's columns; none where it cannot be read."""

        def read() -> tuple[str, ...]:
            try:
                return names_in(path, "a recording")
            except InputError:
                return ()

        return self.bench.kept(("channels", stamp_of(path)), read, small=True)

    async def _map(self, act: str, rest: str, value: Any) -> None:
        assert self.mapping is not None
        if act == "map-more":
            self.mapping.more[rest] = str(value)
        else:
            place, _, key = rest.partition(":")
            assigned, name = self.mapping.assigned, self.mapping.names[int(place)]
            before = assigned[name]
            self.mapping.chosen(int(place), key, value)
            followed = key == "target" and replace(before, target=str(value)) != assigned[name]
            if followed:  # its unit and range, which the page does not show yet
                self.form.object = self.mapping.form()
        self._check()

    def _check(self) -> None:
        """Ask what the log would be, after a choice; choices made meanwhile are asked together."""
        assert self.mapping is not None
        self._is_stale, self._is_log = True, False
        self.plausible.object = parts.card(_WOULD_BE, parts.note("is being checked …"))
        self.adding.object = self._adding(self.mapping)
        if self._checking is None or self._checking.done():
            document: Any = parts.pn.state.curdoc
            self._checking = asyncio.ensure_future(self._check_until_settled(document))

    async def _check_until_settled(self, document: Any) -> None:
        """The answer for the last choices, outside of the document's lock."""
        while self._is_stale and self.mapping is not None:
            self._is_stale = False
            mapping = self.mapping
            found = await asyncio.to_thread(plausibility, mapping, self.bench.rig_file)
            if not self._is_stale:
                document.add_next_tick_callback(partial(self._draw_check, mapping, found))

    def _draw_check(self, mapping: Mapping, found: Plausible) -> None:
        if mapping is not self.mapping or self._is_stale:
            return
        self._is_log = found.is_log
        self.plausible.object = parts.card(_WOULD_BE, found.text)
        if found.asks and not mapping.is_asked:
            mapping.is_asked = True
            self.form.object = mapping.form()
        if found.kind and "add-kind" not in mapping.by_hand:
            mapping.kind = found.kind
        if found.kind and "add-valve" not in mapping.by_hand:
            mapping.valve = found.valve
        self.adding.object = self._adding(mapping)

    def _add_log(self, mapping: Mapping) -> None:
        journal = self.bench.journal
        key = json.dumps(mapping.names)
        known = {k: v for k, v in journal.kept.get(_MAPPINGS, {}).items() if k != key}
        journal.keep(_MAPPINGS, {**known, key: mapping.choices()})  # the latest last
        of_kinds = mapping.known_with_these(journal.kept.get(_KINDS_OF_CHANNELS, ()))
        journal.keep(_KINDS_OF_CHANNELS, of_kinds)
        if mapping.is_in_format:
            for path in mapping.paths:
                self._enter(mapping, path.name)
            return
        self.pending = mapping
        self.window.start(f"converting {mapping.path.name}", mapping.words(mapping.output))

    async def finished(self, job: Job) -> None:
        mapping, self.pending = self.pending, None
        if mapping is not None and job.words[0] == "convert" and job.code == 0:
            self._enter(mapping, job.words[job.words.index("-o") + 1])

    def _enter(self, mapping: Mapping, file: str) -> None:
        """A converted file into the campaign, which is made where there is none."""
        bench = self.bench
        assert bench.campaign_file is not None
        if bench.rig_file is None:
            log = bench.folder / file
            bare = read_bare_logs([log], {})
            text = rig_text(bare.rig.content, log.name)
            name = {"rig:name": bench.folder.name} if bench.folder.name else {}
            text = edits.constants_set(name)(text)
            atmosphere = mapping.options().get("atmosphere_pa")
            if atmosphere is not None:  # as the log was converted with it
                text = edits.constants_set({"air:atmospheric_pressure_pa": atmosphere})(text)
            bench.change(
                bench.folder / "rig.toml", "a rig file of what the log shows", lambda _: text
            )
        edit = edits.log_added(file, mapping.kind, mapping.use, mapping.valve or None)

        def with_rig(text: str) -> str:
            return edit(text or 'rig = "rig.toml"\n')

        bench.change(bench.campaign_file, f"{file} added", with_rig)
        self.mapping = None
        self._draw_mapping()
        try:
            bench.log(bench.campaign().logs[-1])
        except InputError as error:  # a constant that no log shows
            self.needs = str(error)
            self.window.tell(self.needs, is_error=True)

    def _change_log(self, act: str, number: int, value: Any) -> None:
        bench = self.bench
        assert bench.campaign_file is not None
        entry = bench.campaign().logs[number]
        if act == "log-remove":
            edit, said = edits.log_removed(number, entry.file), "taken out"
        elif act == "log-use":
            use = "fit" if entry.use == "holdout" else "holdout"
            edit = edits.log_changed(number, entry.file, "use", use)
            said = "training" if use == "fit" else "held out"
        else:
            edit = edits.log_changed(number, entry.file, "kind", str(value))
            said = str(value)
        bench.change(bench.campaign_file, f"{entry.file}: {said}", edit)

    async def _show_what_logs_show(self) -> None:
        campaign = self.bench.campaign()
        plain = [entry for entry in campaign.logs if not (entry.mapping or entry.shared)]
        if not plain:
            raise InputError("every log has columns of its own names; convert one to see this")
        paths = [entry.path for entry in plain]
        bare = await asyncio.to_thread(read_bare_logs, paths, {})
        self.shown = {key: constant_in(bare.rig.content, key) for key in bare.shown}
        self.rig.object = self._rig()

    def _change_rig(self, rest: str, value: Any) -> None:
        section, _, key = rest.partition(":")
        path = self.bench.rig_file
        declared = declared_keys(RIG_TABLES[section])[key]
        assert path is not None
        given: float | str | None = str(value).strip() or None
        if given is not None and isinstance(declared, NumberKey):
            rig = self.content.rig if self.content is not None else None
            atmosphere: Any = constant_in(rig or {}, "air.atmospheric_pressure_pa")
            given = edits.in_si(str(given), declared.range.unit, f"[{section}] {key}", atmosphere)
        # A length that does not fit another one that is still to be given waits for it.
        together, why = {**self.refused, rest: given}, InputError("")
        for one in (together, {rest: given}):
            said = ", ".join(
                f"[{name.replace(':', '] ')} {'taken out' if v is None else f'= {v}'}"
                for name, v in one.items()
            )
            try:
                self.bench.change(path, said, edits.constants_set(one))
            except InputError as error:
                self.refused, why = together, error
                continue
            self.refused = {n: v for n, v in self.refused.items() if n not in one}
            return
        self.rig.object = self._rig()
        raise why


__all__ = ["FilesScreen"]
