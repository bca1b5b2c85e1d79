"""Changes of a campaign or rig file that leave its comments, its order and its spelling alone.

Each function takes the file's text and gives the new one. TOML is kept as it stands by tomlkit.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Mapping
from typing import Any

import tomlkit
from tomlkit.items import AoT

from sysid.errors import InputError, input_error
from sysid.io.rig_template import unmarked
from sysid.io.unit_text import parse_unit

_WITH_UNIT = re.compile(
    r"(?P<number>[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d\s.,+-].*)?"
)

Edit = Callable[[str], str]
"""From a file's text to the changed one."""


def _entries(document: tomlkit.TOMLDocument) -> AoT:
    entries = document.get("log")
    if not isinstance(entries, AoT):
        raise InputError("the campaign file has no [[log]] entries; add a log first")
    return entries


def _entry(document: tomlkit.TOMLDocument, number: int, file: str) -> Any:
    """The entry of this number, which must still be that of the file."""
    entries = _entries(document)
    if number < len(entries) and entries[number].get("file") == file:
        return entries[number]
    raise InputError(f"[[log]] of {file} has moved meanwhile; look again, and repeat the change")


def log_added(
    file: str, kind: str, use: str = "fit", valve: str | None = None,
    columns: Mapping[str, str] | None = None,
) -> Edit:  # fmt: skip
    """A new `[[log]]` at the end."""

    def edit(text: str) -> str:
        document = tomlkit.parse(text)
        if "log" not in document:
            document["log"] = tomlkit.aot()
        table = tomlkit.table()
        table["kind"], table["file"] = kind, file
        if use != "fit":
            table["use"] = use
        if valve:
            table["valve"] = valve
        if columns:
            inline = tomlkit.inline_table()
            inline.update(columns)
            table["map"] = inline
        _entries(document).append(table)
        return tomlkit.dumps(document)

    return edit


def log_removed(number: int, file: str) -> Edit:
    """The campaign without one `[[log]]`."""

    def edit(text: str) -> str:
        document = tomlkit.parse(text)
        _entry(document, number, file)
        del _entries(document)[number]
        return tomlkit.dumps(document)

    return edit


def log_changed(number: int, file: str, key: str, value: str | None) -> Edit:
    """One key of a `[[log]]`, a text; None removes it."""

    def edit(text: str) -> str:
        document = tomlkit.parse(text)
        entry = _entry(document, number, file)
        if value is None:
            entry.pop(key, None)
        else:
            entry[key] = value
        return tomlkit.dumps(document)

    return edit


def excluded(number: int, file: str, test: str, span: tuple[float, float] | None, why: str) -> Edit:
    """A test, or a span of it (s since its first row), that is not used, and why."""

    def edit(text: str) -> str:
        document = tomlkit.parse(text)
        entry = _entry(document, number, file)
        given = tomlkit.inline_table()
        if test:
            given["test"] = test
        if span is not None:
            given["from_s"], given["to_s"] = span
        if why:
            given["why"] = why
        if "exclude" not in entry:
            entry["exclude"] = tomlkit.array()
        entry["exclude"].append(given)
        return tomlkit.dumps(document)

    return edit


def included(number: int, file: str, place: int) -> Edit:
    """Without one of a `[[log]]`'s exclusions: the test or span is used again."""

    def edit(text: str) -> str:
        document = tomlkit.parse(text)
        entry = _entry(document, number, file)
        if place >= len(entry.get("exclude", ())):
            raise InputError(f"[[log]] of {file}: its exclusions have changed; look again")
        del entry["exclude"][place]
        if not entry["exclude"]:
            del entry["exclude"]
        return tomlkit.dumps(document)

    return edit


def in_si(text: str, unit: str, where: str, atmosphere_pa: float | None) -> float:
    """A number as a person writes it, in `unit` or in the one behind it: "0.12", "12,5 cm".

    A gauge pressure is one above `atmosphere_pa`. Raises InputError, which begins with `where`,
    for a text that is neither.
    """
    found = _WITH_UNIT.fullmatch(text)
    if found is None:
        shown = "" if unit == "1" else f", in {unit} or with its unit behind it"
        raise input_error(where, f"{text!r} is not a number", f"give one{shown}")
    number, given = float(found["number"].replace(",", ".")), found["unit"]
    if not given:
        return number
    conversion = parse_unit(given, unit, where)
    value = conversion.factor * number + conversion.offset
    if conversion.gauge:
        if atmosphere_pa is None:
            fix = "give [air] atmospheric_pressure_pa first, or an absolute pressure"
            raise input_error(where, f"{text!r} is a gauge pressure", fix)
        value += atmosphere_pa
    return float(f"{value:.12g}")  # a decimal that was written has no further digits


def constants_set(values: Mapping[str, float | str | None]) -> Edit:
    """Constants of the rig file by "section:key"; None removes one, and a section without any.

    What was assumed of them is no longer.
    """

    def edit(text: str) -> str:
        document = tomlkit.parse(text)
        assumed: Any = document.get("assumed", [])
        for name, value in values.items():
            section, _, key = name.partition(":")
            if section not in document:
                document[section] = tomlkit.table()
            table: Any = document[section]
            if value is None:
                table.pop(key, None)
            else:
                table[key] = value
            if f"{section}.{key}" in assumed:
                assumed.remove(f"{section}.{key}")
                if value is not None:
                    trivia = table[key].trivia
                    trivia.comment = unmarked(trivia.comment)
            if not table:
                del document[section]
        if "assumed" in document and not assumed:
            del document["assumed"]
        return tomlkit.dumps(document)

    return edit


def changed_lines(before: str, after: str) -> str:
    """What a change comes to: lines taken out with "-", new ones with "+"."""
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm="")
    return "\n".join(line for line in lines if line[:2] not in ("--", "++", "@@"))


__all__ = [
    "Edit",
    "changed_lines",
    "constants_set",
    "excluded",
    "included",
    "log_added",
    "log_changed",
    "log_removed",
]
