"""Can it identify?: parameters by tests, and of what is missing the test that would give it."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

from sysid.app import parts
from sysid.app.jobs import Job
from sysid.app.screens.base import Screen
from sysid.blocks.html import block_html
from sysid.blocks.titles import capital, use_word
from sysid.errors import Failure, on_its_own
from sysid.io.campaign import Campaign
from sysid.io.files import make_folder, stamp_of
from sysid.pipeline.advise import may_ask
from sysid.pipeline.check import (
    Answer,
    CampaignCheck,
    CheckedLog,
    LogCheck,
    check_campaign,
    listed,
    readable,
)
from sysid.pipeline.pages.next_steps import advised_section

# A matrix of more logs than these is read as a list.
_MOST_LOGS = 16
_ADVICE = "advice"
_HEAD = "<h2>Can it identify?</h2>"


@dataclass(frozen=True)
class IdentifyContent:
    """The campaign, its check once that is known, and the bundle that advice may start from.

    `found` are the answers of its logs by their numbers, as far as they have come; `is_own`:
    whether it is of a component of the user's own, whose logs are checked all at once; `asked`:
    what a test to play may be for (`may_ask`).
    """

    campaign: Campaign
    found: dict[int, CheckedLog | Failure]
    check: CampaignCheck | None
    bundle: Path | None
    is_own: bool
    asked: Mapping[str, tuple[str, str]]


class IdentifyScreen(Screen):
    """Whether the tests are enough, before anything is fitted."""

    title = "Can it identify?"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.aim: list[str] = []
        self.content: IdentifyContent | None = None
        self.answer = parts.html("")
        self.advice = parts.html("")

    def read(self) -> IdentifyContent:
        bench, campaign = self.bench, self.bench.campaign()
        is_own = bench.component is not None
        found = {}
        for number, entry in enumerate(campaign.logs):
            known = None if is_own else bench.known_check(entry)
            if known is not None:
                found[number] = known
        check = self._whole(campaign) if is_own else bench.known(self._key())
        bundle = None if is_own else bench.best_bundle()
        asked = on_its_own(partial(self._asked, campaign, bundle)) if bundle else {}
        # Why there is none, the command says; until then everything may be asked for together.
        asked = {} if isinstance(asked, Failure) else asked
        return IdentifyContent(campaign, found, check, bundle, is_own, asked)

    def _asked(self, campaign: Campaign, bundle: Path) -> Mapping[str, tuple[str, str]]:
        key = ("may ask", self.bench.campaign_key(), stamp_of(bundle))
        read = self.bench.bundle(bundle)
        return self.bench.kept(
            key, lambda: may_ask(campaign, read, self.bench.effects_file()), small=True
        )

    def _key(self) -> tuple[Any, ...]:
        return "check", self.bench.campaign_key()

    def _whole(self, campaign: Campaign) -> CampaignCheck:
        """The check of the campaign, from those of its logs where each was checked before.

        Raises InputError.
        """
        bench = self.bench

        def make() -> CampaignCheck:
            if bench.component is not None:
                return check_campaign(campaign)
            logs = [bench.log(entry) for entry in campaign.logs]
            checked = [bench.checked(entry) for entry in campaign.logs]
            return check_campaign(campaign, logs, [c for c in checked if isinstance(c, CheckedLog)])

        return bench.kept(self._key(), make, small=True)

    def draw(self, content: IdentifyContent) -> list[Any]:
        self.content = content
        if content.check is not None:
            self.answer.object = _answered(content.check)
        else:
            self.answer.object = _so_far(content)
            waiting = [n for n in range(len(content.campaign.logs)) if n not in content.found]
            self.later += [partial(self._check_log, content, number) for number in waiting]
            self.later.append(partial(self._check_all, content))
        self.aim = [name for name in self.aim if name in content.asked]
        self.advice.object = self._advice(content)
        return [self.answer, self.advice, *self._advised(content)]

    async def _check_log(self, content: IdentifyContent, number: int) -> Callable[[], None]:
        entry = content.campaign.logs[number]
        found = await asyncio.to_thread(on_its_own, partial(self.bench.checked, entry))
        content.found[number] = found
        return partial(self._show, content, lambda: _so_far(content))

    async def _check_all(self, content: IdentifyContent) -> Callable[[], None]:
        """What all logs say together, once each has been read."""
        if any(isinstance(one, Failure) for one in content.found.values()):
            return partial(self._show, content, lambda: _so_far(content))
        whole = partial(self._whole, content.campaign)
        check: Any = await asyncio.to_thread(on_its_own, whole)
        is_failed = isinstance(check, Failure)
        said = _HEAD + parts.note(check.reason, "error") if is_failed else _answered(check)
        return partial(self._show, content, lambda: said)

    def _show(self, content: IdentifyContent, said: Callable[[], str]) -> None:
        """Show it, unless the campaign was read again meanwhile."""
        if self.content is content:
            self.answer.object = said()

    def _advice(self, content: IdentifyContent) -> str:
        if content.is_own:
            return ""
        text = "<h2>Which test to run next</h2>"
        if content.bundle is None:
            said = "Fit the campaign first: what a further test would add follows from its model."
            return text + parts.note(said)
        named = self.bench.named(content.bundle)
        text += parts.note(
            f"Predicts what each of a list of further tests would add to {named}, the smallest "
            "effects that they would show, and which test would resolve a tie; takes a minute or "
            "more."
        )
        text += parts.button("Ask for advice", "identify-advise", kind="primary")
        text += parts.note(
            "Or design a test that the rig can play back, within its travel, speed and effort, "
            "and write its commands as a log: for all parameters, or for those that you choose."
        )
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, (group, title) in content.asked.items():
            if name not in self.aim:
                groups.setdefault(group, []).append((name, title))
        first = "and for …" if self.aim else "for all parameters"
        aims = "".join(
            parts.button(f"{content.asked[name][1]} ×", f"identify-not:{name}", kind="small",
                         title="Not for this one") + " "
            for name in self.aim
        )  # fmt: skip
        menu = parts.select_grouped("identify-for", first, groups, "What the test is for")
        play = parts.button("Write a test to play", "identify-play",
                            title="sysid advise -o: a file that the rig can play")  # fmt: skip
        text += f"<div class='bar2'>{aims}{menu} {play}</div>" + self._played()
        return text

    def _advised(self, content: IdentifyContent) -> list[Any]:
        """The advice that was given last, as the report has it."""
        kept = self.bench.journal.kept.get(_ADVICE)
        if content.bundle is None or not isinstance(kept, dict) or "found" not in kept:
            return []
        old = kept.get("of") != list(stamp_of(content.bundle) or ())
        note = [parts.html(parts.note("made from another bundle", "warn"))] if old else []
        section = advised_section(kept["found"])
        lines = (*section.intro, *kept["found"]["notices"])
        said = "".join(f"<p>{parts.message(line)}</p>" for line in lines)
        panes = parts.block_panes(section.blocks, self.window.scheme)
        return [*note, parts.html(f"<h3>Advice</h3>{said}"), *panes]

    def _played(self) -> str:
        """The tests to play that were written, to keep."""
        lines = [
            [f"<b>{parts.words(name)}</b>", f'<a href="files/{quote(name)}" download>download</a>']
            for name in map(self.bench.named, sorted(self.bench.results.glob("play*.csv")))
        ]
        return parts.rows(("Test to play", ""), lines) if lines else ""

    async def do(self, what: str, value: Any) -> None:
        act, _, name = what.partition(":")
        if act in ("identify-for", "identify-not") and self.content is not None:
            self._aim_at(str(value) if act == "identify-for" else name, act == "identify-for")
            self.advice.object = self._advice(self.content)
        elif what in ("identify-advise", "identify-play"):
            self._ask(with_test=what == "identify-play")
        else:
            await super().do(what, value)

    def _aim_at(self, name: str, is_wanted: bool) -> None:
        """A test to play shall be for this parameter or effect too, or not for it."""
        others = [one for one in self.aim if one != name]
        known = self.content is not None and name in self.content.asked
        self.aim = [*others, name] if is_wanted and known else others

    def _ask(self, *, with_test: bool) -> None:
        bundle = self.bench.best_bundle()
        campaign = self.bench.campaign()
        if bundle is None:
            return
        words = ["advise", campaign.path.name, "--bundle", self.bench.named(bundle)]
        if with_test:
            make_folder(self.bench.results)
            words += ["-o", self.bench.named(_unused(self.bench.results))]
            words += [word for name in self.aim for word in ("--for", name)]
        words.append("--json")
        what = "designing a test to play" if with_test else "advising"
        self.window.start(what, [*words, *self.bench.own_words(component=False)])

    async def finished(self, job: Job) -> None:
        if job.words[0] == "advise" and job.code == 0:
            bundle = self.bench.folder / job.words[3]
            found = json.loads(job.output)
            self.bench.journal.keep(_ADVICE, {"found": found, "of": list(stamp_of(bundle) or ())})


def _unused(folder: Path) -> Path:
    """A name for a test to play that no file has: one that was played belongs to its log."""
    names = (folder / f"play{'' if i == 1 else f'_{i}'}.csv" for i in itertools.count(1))
    return next(path for path in names if not path.exists())


def _so_far(content: IdentifyContent) -> str:
    """Every log by its name, with what it identifies by itself as far as that is known."""
    logs, found = content.campaign.logs, content.found
    unread = sum(isinstance(one, Failure) for one in found.values())
    said = f"{len(found)} of {len(logs)} logs are checked."
    if len(found) == len(logs):
        said = "What the logs say together is being compared."
    if unread:
        said = f"{unread} of {len(logs)} logs cannot be checked: fix them, or take them out."
    lines = []
    for number, entry in enumerate(logs):
        one = found.get(number)
        if one is None:
            answer = '<span class="muted">is being checked &hellip;</span>'
        elif isinstance(one, Failure):
            answer = f'<span class="error">{parts.words(one.reason)}</span>'
        else:
            found_by = (item for item in one.check.identifies if item.identified)
            names = [readable(item.parameter) for item in found_by]
            answer = parts.words(listed(names) or "nothing by itself")
        use = use_word(entry.use)
        lines.append([f"<b>{parts.words(entry.file)}</b>", parts.words(entry.kind), use, answer])
    table = parts.rows(("Log", "Kind", "Use", "Identifies by itself"), lines)
    return f"{_HEAD}<p class='sentence'>{parts.words(said)}</p>{table}"


def _answered(check: CampaignCheck) -> str:
    """The campaign's answer: what is missing, and which log identifies what."""
    lacking = [one for one in check.answers if not one.identified]
    said = capital(check.answer)
    if lacking:  # each with the test that would identify it, in a card
        said = f"{len(lacking)} of {len(check.answers)} quantities are not identified"
    head = f"{_HEAD}<p class='sentence'>{parts.words(said)}.</p>"
    if check.contradictions:
        head += parts.card("Contradictions", parts.listed(check.contradictions), "poor")
    missing = "".join(_missing(check.answers))
    if missing:
        head += f'<div class="cards">{missing}</div>'
    is_small = len(check.training) <= _MOST_LOGS
    table = _matrix(check) if is_small else block_html(check.table())
    remarks = parts.listed(f"{entry.file}: {line}" for entry, line in check.remarks())
    quality = parts.fold("Quality of the logs", remarks) if remarks else ""
    logs = "".join(_log(one) for one in check.logs)
    return head + table + quality + parts.fold("Each log by itself", logs)


def _missing(answers: Iterable[Answer]) -> Iterator[str]:
    """A card for each test that would identify something that no log does."""
    lacking: dict[str, list[str]] = {}
    for one in answers:
        if not one.identified:
            # Where a kind of test is missing, what its law lacks says no more.
            lacking.setdefault(one.needs or one.reason, []).append(readable(one.parameter))
    for why, names in lacking.items():
        inner = f"<p>{parts.words(capital(why))}.</p>"
        yield parts.card(f"Not identified: {listed(names)}", inner, "fair")


def _matrix(check: CampaignCheck) -> str:
    """Parameters by training logs."""
    files = [entry.file for entry in check.training]
    names = [PurePath(file).stem for file in files]
    lines = []
    for one in check.answers:
        cells = ['<span aria-label="yes">●</span>' if f in one.logs else "" for f in files]
        if one.together and not one.logs:
            said = f"by all together: {one.reason}" if one.reason else "by all together"
        elif one.identified and not one.logs:
            said = one.reason
        else:
            said = "" if one.identified else "not identified"
        kind = "class:" if one.identified else "class:broken"
        named = parts.words(readable(one.parameter))
        lines.append([kind, f"<b>{named}</b>", *cells, parts.words(said)])
    text = parts.rows(("", *names, ""), lines, "Which log identifies which parameter by itself")
    return f'<div class="matrix">{text}</div>'


def _log(check: LogCheck) -> str:
    tables = "".join(block_html(table) for table in check.tables() if table.rows)
    notes = parts.listed((*check.contradicts, *check.notices, *check.left_out()))
    headline = check.headline().replace(check.file, PurePath(check.file).name, 1)
    return parts.fold(headline, f'<div class="each">{notes}{tables}</div>')


__all__ = ["IdentifyScreen"]
