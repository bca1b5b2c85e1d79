"""What all windows of the workbench share: a campaign's files, its changes, and the job at work.

The files are the truth. They are read again when they have changed, by whomever; another window's
change, an editor's and a restart are the same thing.
"""

from __future__ import annotations

import json
import os
import secrets
import shlex
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from sysid.app import edits
from sysid.app.jobs import Job
from sysid.app.journal import FileChange, Journal
from sysid.errors import Failure, InputError, input_error, on_its_own
from sysid.io.campaign import Campaign, CampaignLog
from sysid.io.files import stamp_of, write_atomic
from sysid.io.rig import Rig
from sysid.io.samples import Log
from sysid.pipeline.check import CheckedLog, check_entry
from sysid.pipeline.diagnosed import read_diagnosis
from sysid.pipeline.explore import ExploredTest, explore, motion_tests
from sysid.pipeline.files import read_bundle, read_campaign, read_rig
from sysid.pipeline.run import DIAGNOSIS_FILE

Result = TypeVar("Result")
# Results that are kept by what they were made from: a campaign's logs, and figures of them; of
# those that hold no samples, such as the check of a log, enough for each log of a long campaign.
_MOST_KEPT = 64
_MOST_SMALL = 4096
_DURATIONS = "seconds by command"


class StepMissingError(InputError):
    """A screen shows nothing before a step on another one, `screen`, has been taken."""

    def __init__(self, said: str, screen: str) -> None:
        super().__init__(said)
        self.screen = screen


NOTHING_FITTED = "Nothing was fitted yet: fit the campaign first."


@dataclass
class Workbench:
    """A folder with its campaign file, results next to it, and what is done with them.

    `options` are further words for every command that takes them (`--effects`, `--component`):
    code of the user's own, which runs once it has been `allowed`.
    """

    folder: Path
    campaign_file: Path | None
    results: Path
    component: str | None = None
    effects: Path | None = None
    allowed: set[str] = field(default_factory=set)
    job: Job | None = None
    said: str = ""
    lines: str = ""
    changes: int = 0
    _rig_path: Path | None = None
    _kept: OrderedDict[Any, Any] = field(default_factory=OrderedDict)
    _small: OrderedDict[Any, Any] = field(default_factory=OrderedDict)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.journal = Journal.read(self.folder)

    # --- files ----------------------------------------------------------------------------

    def stamp(self) -> tuple[Any, ...]:
        """Changes whenever a file of the campaign or a result does, or a job."""
        paths = [self.campaign_file, self.rig_file, *sorted(self.results.glob("*.json"))]
        job = self.job
        return (self.changes, *map(stamp_of, paths), None if job is None else id(job))

    @property
    def rig_file(self) -> Path | None:
        """The campaign's rig file; without a campaign the folder's, where it has one."""
        campaign = self.campaign_or_none()
        if campaign is not None:
            return Path(campaign.rig.source)
        path = self.folder / "rig.toml"
        return path if path.is_file() else None

    def campaign_or_none(self) -> Campaign | None:
        """The campaign; None where there is none, or it cannot be read."""
        try:
            return self.campaign()
        except InputError:
            return None

    def campaign(self) -> Campaign:
        """The campaign as it stands. Raises InputError."""
        path = self.campaign_file
        if path is None or not path.is_file():
            raise StepMissingError("No campaign yet: add a recording first.", "files")
        if self.component is not None:
            self.check_allowed(self.component)
        files = [path, self._rig_path, *sorted(path.parent.glob("*.toml"))]
        found = self.kept(("campaign", *map(stamp_of, files)), lambda: self._reader(path))
        self._rig_path = Path(found.rig.source)
        return found

    def campaign_key(self) -> tuple[Any, ...]:
        """Changes whenever the campaign file, the rig file or a log does. Raises InputError."""
        campaign = self.campaign()
        paths = [campaign.path, Path(campaign.rig.source), *(e.path for e in campaign.logs)]
        return tuple(map(stamp_of, paths))

    def explored(self, path: Path) -> tuple[ExploredTest, ...]:
        """The training tests of motion as a bundle's model gives them; none without any.

        Raises InputError and NotIdentifiedError as `explore`.
        """
        campaign, bundle = self.campaign(), self.bundle(path)
        motion, files = motion_tests(campaign, "fit"), self.effects_file()
        if not motion:
            return ()
        key = ("explored", self.campaign_key(), stamp_of(path), stamp_of(files))
        return self.kept(key, lambda: tuple(explore(motion, campaign.rig, bundle, effects=files)))

    def rig(self) -> Rig:
        """The rig as it stands. Raises InputError."""
        if self.campaign_file is not None and self.campaign_file.is_file():
            return self.campaign().rig
        path = self.folder / "rig.toml"
        return self.kept(("rig", stamp_of(path)), lambda: read_rig(path))

    def log(self, entry: CampaignLog) -> Log:
        """The log of an entry, read once for as long as nothing of it changes."""
        campaign = self.campaign()
        return self.kept(("log", *self._log_key(entry)), lambda: campaign.read(entry))

    def _log_key(self, entry: CampaignLog) -> tuple[Any, ...]:
        """Changes whenever an entry, its file or the rig file does. Raises InputError."""
        campaign = self.campaign()
        # Whether an effort is a command or a reading, all logs of a rig without a motor say.
        others = self.campaign_key() if campaign.rig.motor is None else None
        return repr(entry), stamp_of(entry.path), stamp_of(Path(campaign.rig.source)), others

    def checked(self, entry: CampaignLog) -> CheckedLog | Failure:
        """What a log is good for by itself, or why it cannot be read. Raises InputError."""
        campaign = self.campaign()

        def check() -> CheckedLog | Failure:
            return on_its_own(lambda: check_entry(entry, self.log(entry), campaign.rig))

        return self.kept(self._check_key(entry), check, small=True)

    def known_check(self, entry: CampaignLog) -> CheckedLog | Failure | None:
        """What `checked` gave, as long as nothing has changed; None where that is not known."""
        known: CheckedLog | Failure | None = self.known(self._check_key(entry))
        return known

    def _check_key(self, entry: CampaignLog) -> tuple[Any, ...]:
        return "check of a log", *self._log_key(entry)

    def bundles(self) -> list[Path]:
        """The bundles among the results, the folder and the folders in it."""
        places = [self.results, self.folder]
        found = [path for place in places for path in sorted(place.glob("*.json"))]
        return [path for path in dict.fromkeys(found) if self._is_bundle(path)]

    def _is_bundle(self, path: Path) -> bool:
        def look() -> bool:
            try:
                with path.open("rb") as file:
                    return b'"sysid-bundle/' in file.read(4096)
            except OSError:
                return False

        return self.kept(("is bundle", stamp_of(path)), look, small=True)

    def best_bundle(self) -> Path | None:
        """The bundle that a run made last, else any; None without one."""
        found = self.bundles()
        named = [self.result(name) for name in ("bundle.json", "fitted.json")]
        return next((path for path in named if path in found), found[0] if found else None)

    def bundle(self, path: Path) -> Any:
        """A bundle, read once for as long as its file stays."""
        return self.kept(("bundle", stamp_of(path)), lambda: read_bundle(path))

    def named(self, path: Path) -> str:
        """A path as the commands of this page name it."""
        try:
            return path.relative_to(self.folder).as_posix()
        except ValueError:
            return str(path)

    def brief(self, text: str) -> str:
        """A line of the library with the files of the folder by their names alone."""
        return text.replace(f"{self.folder}{os.sep}", "")

    def result(self, name: str) -> Path:
        """A file of the results."""
        return self.results / name

    def diagnosis(self) -> dict[str, Any] | None:
        """The diagnosis of the last run, as written; None without one."""
        path = self.result(DIAGNOSIS_FILE)

        def read() -> dict[str, Any] | None:
            try:
                content = json.loads(path.read_text("utf-8"))
            except (OSError, ValueError):
                return None
            return content if isinstance(content, dict) and "verdict" in content else None

        return self.kept(("diagnosis", stamp_of(path)), read)

    def has_diagnosis(self, path: Path) -> bool:
        """Whether the diagnosis of the last run is that of this bundle."""

        def shown() -> Any:
            return read_diagnosis(self.result(DIAGNOSIS_FILE)).shown_with(self.bundle(path))

        return self.diagnosis() is not None and not isinstance(on_its_own(shown), Failure)

    def kept(self, key: Any, make: Callable[[], Result], *, small: bool = False) -> Result:
        """What `make` gives, made once for each key; the least used are forgotten.

        `small` results hold no samples: many of them are kept.
        """
        store, most = (self._small, _MOST_SMALL) if small else (self._kept, _MOST_KEPT)
        with self._lock:
            if key in store:
                store.move_to_end(key)
                return store[key]  # type: ignore[no-any-return]
        made = make()
        with self._lock:
            store[key] = made
            while len(store) > most:
                store.popitem(last=False)
        return made

    def known(self, key: Any) -> Any:
        """A small result that is kept; None where it has not been made yet."""
        with self._lock:
            return self._small.get(key)

    # --- changes --------------------------------------------------------------------------

    def show(self, said: str, lines: str = "") -> None:
        """What was done last: as a command, or as lines of a file."""
        self.said, self.lines = said, lines
        self.changes += 1

    def change(self, path: Path, what: str, edit: edits.Edit) -> None:
        """FileChange a campaign or rig file, if it can be read afterwards. Raises InputError."""
        with self._lock:
            before = path.read_text("utf-8") if path.is_file() else None
            try:
                after = edit(before or "")
            except ValueError as error:  # what tomlkit cannot parse
                raise input_error(path, f"is not TOML: {error}", "fix it in your editor") from None
            if after == before:
                return
            self._check(path, after)
            write_atomic(path, after)
            self.journal.made(FileChange(what, path.name, before, after))
            self.show(f"{self.named(path)}: {what}", edits.changed_lines(before or "", after))

    def _check(self, path: Path, text: str) -> None:
        """Read the new text as the file would be read, next to it. Raises InputError."""
        trial = path.with_name(f".sysid-{secrets.token_hex(6)}.tmp")
        read: Callable[[Path], Any] = read_rig
        if path == self.campaign_file:
            read = self._reader
            if "[[log]]" not in text:  # a campaign's first line is the rig; its first log may wait
                return
        try:
            write_atomic(trial, text)
            read(trial)
        except InputError as error:
            raise InputError(str(error).replace(str(trial), path.name)) from None
        finally:
            trial.unlink(missing_ok=True)

    def _reader(self, path: Path) -> Campaign:
        return read_campaign(path, component=self.component)

    def undo(self) -> str:
        """Take the last change back; what it was."""
        with self._lock:
            step = self.journal.undo()
            lines = edits.changed_lines(step.after, step.before or "")
            self.show(f"{step.file}: undone: {step.what}", lines)
        return step.what

    def redo(self) -> str:
        """Make the change again that was undone last; what it is."""
        with self._lock:
            step = self.journal.redo()
            lines = edits.changed_lines(step.before or "", step.after)
            self.show(f"{step.file}: {step.what}", lines)
        return step.what

    # --- work -----------------------------------------------------------------------------

    def own_words(self, *, effects: bool = True, component: bool = True) -> tuple[str, ...]:
        """The words for the user's own code, where there is any and a command takes it."""
        words: list[str] = []
        if effects and self.effects is not None:
            words += ["--effects", str(self.effects)]
        if component and self.component is not None:
            words += ["--component", self.component]
        return tuple(words)

    def run_words(self, *, quick: bool = False) -> list[str]:
        """The command that runs the whole campaign; what it says is all shown."""
        words = ["run", self.campaign().path.name, "-o", self.named(self.results), "-v"]
        return [*words, *(["--quick"] if quick else []), *self.own_words()]

    def effects_file(self) -> Path | None:
        """The file of further effects, once it may run. Raises InputError before."""
        if self.effects is not None:
            self.check_allowed(str(self.effects))
        return self.effects

    def check_allowed(self, code: str) -> None:
        """Raises InputError for code of the user's own that was not allowed yet."""
        if code not in self.allowed:
            raise InputError(f"{code} is Python code of your own; allow it to run at the top")

    def unasked(self) -> list[str]:
        """The user's own files that wait to be allowed."""
        given = (self.component, None if self.effects is None else str(self.effects))
        return [code for code in given if code is not None and code not in self.allowed]

    def start(self, what: str, words: Sequence[str], expected: Any = None) -> Job:
        """Start a command. Raises InputError while another is at work."""
        with self._lock:
            if self.job is not None and not self.job.is_done:
                raise InputError(f"{self.job.what} is at work; wait for it, or cancel it")
            waiting = self.unasked()
            if any(word in words for word in ("--effects", "--component")) and waiting:
                self.check_allowed(waiting[0])
            durations = self.journal.kept.get(_DURATIONS, {})
            usual = {words[0]: durations[words[0]]} if words[0] in durations else {}
            job = Job(what, tuple(words), self.folder, expected or usual)
            job.start()
            self.job = job
            self.show(job.command)
        return job

    def ended(self, job: Job) -> None:
        """Note how long a command took, for the next one's time left."""
        if job.code == 0 and not job.cancelled:
            durations = self.journal.kept.get(_DURATIONS, {})
            name = job.words[0]
            self.journal.keep(_DURATIONS, {**durations, name: round(job.seconds, 1)})
        self.changes += 1

    def close(self) -> None:
        """End the job at work."""
        if self.job is not None:
            self.job.cancel()


def command_line(words: Sequence[str]) -> str:
    """A command as it is typed."""
    return shlex.join(["sysid", *words])


__all__ = ["Workbench", "command_line"]
