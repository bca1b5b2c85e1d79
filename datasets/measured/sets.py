"""A measured set as its folder describes it: `set.toml` and the files next to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.errors import input_error
from sysid.io.rig import read_toml, reject_misspelt

SETS_FOLDER = Path(__file__).resolve().parent
PROJECT = SETS_FOLDER.parent.parent
SET_FILE = "set.toml"
_SET_KEYS = ("title", "source", "licence", "folder", "question", "data", "convert", "campaign")
_TEXTS = ("title", "source", "licence", "folder", "question")
_CONVERT_KEYS = ("source", "recipe", "log", "folder", "test", "rows")
_CAMPAIGN_KEYS = ("file", "name", "repeat", "of", "known")
# Where `folder` is searched: next to the project, or in it (the project's own tables).
_PLACES = ("shared", "project")


@dataclass(frozen=True)
class Conversion:
    """One `[[convert]]`: foreign files under `folder` that become `log` by `recipe`.

    `rows`: those of the files that are taken, as `sysid convert --rows` has them; None: all
    that the recipe takes.
    """

    sources: tuple[str, ...]
    recipe: str
    log: str
    folder: str
    test: str | None = None
    rows: str | None = None


@dataclass(frozen=True)
class SetCampaign:
    """One `[[campaign]]`. A repeat checks whether the verdict of the campaign `of` recurs.

    `known`: what is known of errors that remain far above a correct model's; empty without.
    """

    file: str
    name: str
    repeat: bool = False
    of: str | None = None
    known: str = ""


@dataclass(frozen=True)
class MeasuredSet:
    """A measured set; `path` is its folder in the project, `data` one of shared, project."""

    path: Path
    title: str
    source: str
    licence: str
    folder: str
    question: str
    data: str
    conversions: tuple[Conversion, ...]
    campaigns: tuple[SetCampaign, ...]
    notices: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The folder's name, by which `--only` picks it."""
        return self.path.name


def set_folders(root: Path = SETS_FOLDER) -> list[Path]:
    """Folders of `root` that hold a set.toml, sorted by name."""
    return sorted(path.parent for path in root.glob(f"*/{SET_FILE}"))


def read_set(path: Path) -> MeasuredSet:
    """The set of a folder. Raises InputError naming the key of its set.toml and the fix."""
    file = path / SET_FILE
    content = read_toml(file, "a measured set's file")
    notices = reject_misspelt(content, _SET_KEYS, "", str(file))
    texts = {key: _text(content, key, str(file)) for key in _TEXTS}
    data = content.get("data", "shared")
    if data not in _PLACES:
        raise input_error(file, f"data = {data!r}", f"write one of {', '.join(_PLACES)}")
    conversions = tuple(
        _conversion(table, where, texts["folder"], notices)
        for where, table in _tables(content, "convert", file)
    )
    campaigns: list[SetCampaign] = []
    for where, table in _tables(content, "campaign", file):
        campaigns.append(_campaign(table, where, campaigns, notices))
    return MeasuredSet(
        path,
        **texts,
        data=str(data),
        conversions=conversions,
        campaigns=tuple(campaigns),
        notices=tuple(notices),
    )


def _tables(content: Mapping[str, Any], key: str, file: Path) -> list[tuple[str, dict[str, Any]]]:
    """The entries of an array of tables, each with where it stands."""
    entries = content.get(key)
    if not isinstance(entries, list) or not entries:
        raise input_error(file, f"no [[{key}]] entry", f"add at least one [[{key}]]")
    found = []
    for number, table in enumerate(entries, start=1):
        where = f"{file}: [[{key}]] entry {number}"
        if not isinstance(table, dict):
            raise input_error(where, "is not a table", f"write [[{key}]] and its keys below")
        found.append((where, table))
    return found


def _conversion(
    table: Mapping[str, Any], where: str, folder: str, notices: list[str]
) -> Conversion:
    notices += reject_misspelt(table, _CONVERT_KEYS, f"{where}: ", where)
    source = table.get("source")
    sources = [source] if isinstance(source, str) else source
    if not isinstance(sources, list) or not sources or not all(map(_is_text, sources)):
        raise input_error(where, f"source = {source!r}", 'write source = "file" (or a list)')
    test = None if "test" not in table else str(table["test"])
    own = _text(table, "folder", where) if "folder" in table else folder
    rows = _text(table, "rows", where) if "rows" in table else None
    recipe, log = _text(table, "recipe", where), _text(table, "log", where)
    if Path(log).name != log:
        raise input_error(where, f"log = {log!r}", "name a file without a folder")
    return Conversion(tuple(sources), recipe, log, own, test, rows)


def _campaign(
    table: Mapping[str, Any], where: str, before: Sequence[SetCampaign], notices: list[str]
) -> SetCampaign:
    notices += reject_misspelt(table, _CAMPAIGN_KEYS, f"{where}: ", where)
    file, name = _text(table, "file", where), _text(table, "name", where)
    if file in [entry.file for entry in before]:
        raise input_error(where, f"file = {file!r} occurs twice", "keep one of the two")
    repeat = table.get("repeat", False)
    if not isinstance(repeat, bool):
        raise input_error(where, f"repeat = {repeat!r}", "write true or false")
    if not repeat:
        if "of" in table:
            raise input_error(where, "of is given without repeat = true", "add it, or drop of")
        known = _text(table, "known", where) if "known" in table else ""
        return SetCampaign(file, name, known=known)
    mains = [entry.file for entry in before if not entry.repeat]
    of = table.get("of", mains[-1] if mains else None)
    if of not in mains:
        known = ", ".join(mains) or "none"
        raise input_error(
            where,
            f"repeats {of!r}, which is no campaign before it",
            f"put that first (there are: {known})",
        )
    return SetCampaign(file, name, True, str(of))


def _text(table: Mapping[str, Any], key: str, where: str) -> str:
    value = table.get(key)
    if not _is_text(value):
        what = f"{key} is missing" if value is None else f"{key} = {value!r} is not text"
        raise input_error(where, what, f'write {key} = "..."')
    return str(value)


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip())


__all__ = [
    "PROJECT",
    "SETS_FOLDER",
    "SET_FILE",
    "Conversion",
    "MeasuredSet",
    "SetCampaign",
    "read_set",
    "set_folders",
]
