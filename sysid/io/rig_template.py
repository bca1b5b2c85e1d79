"""The commented rig file that `sysid init` writes, from the declarations of its keys."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from sysid.io.declaration import Motion, TemplateLine, TomlSection, declared_keys
from sysid.io.files import write_new
from sysid.io.rig import ASSUMED
from sysid.io.rig_file import RIG_TABLES, RigFile, SectionComment
from sysid.io.toml_text import toml_value

_HEAD = """\
# What is known about the rig before any test. SI units throughout; pressures are absolute.
# Replace the example values with your own. Delete sections for parts that your rig lacks.
"""


# Before a key's comment: its value is a reference rig's.
_MARK = "ASSUMED"


def rig_template(*, linear: bool) -> str:
    """A rig file with every key explained, as text."""
    motion: Motion = "linear" if linear else "rotary"
    found = [(name, cls, list(_key_lines(cls, motion))) for name, cls in RIG_TABLES.items()]
    sections = (
        f"\n{_commented(f'[{name}]', _section_comment(name, motion))}\n{''.join(lines)}"
        for name, _, lines in found
        if lines
    )
    return _HEAD + "".join(sections)


_HEAD_OF_LOGS = """\
# The rig of {logs}: what the tests show, and else the constants of the reference rig, which
# `assumed` lists. Correct these, and take each that is right out of the list.
# SI units throughout; pressures are absolute.

"""


def rig_text(content: Mapping[str, Any], logs: str) -> str:
    """A rig file of this content, with every key explained; `logs` names where it comes from."""
    assumed = content.get(ASSUMED, ())
    motion: Motion = content["rig"].get("motion", "rotary")
    keys = "".join(f'    "{key}",\n' for key in assumed)
    sections = [f"{ASSUMED} = [\n{keys}]\n"] if assumed else []
    for name, cls in RIG_TABLES.items():
        if name in content:
            head = _commented(f"[{name}]", _section_comment(name, motion))
            lines = _given_lines(cls, content[name], motion, assumed)
            sections.append("\n".join((head, *lines, "")))
    return _HEAD_OF_LOGS.format(logs=logs) + "\n".join(sections)


def _given_lines(
    section: type[TomlSection],
    table: Mapping[str, Any],
    motion: Motion,
    assumed: Collection[str],
) -> Iterator[str]:
    """A section's keys with their values, in the order of the template."""
    for name, key in declared_keys(section).items():
        if name not in table:
            continue
        line = key.line(motion)
        comment = "" if line is None else line.comment.removesuffix("; or instead of it:")
        if f"{section.table}.{name}" in assumed:
            comment = f"{_MARK}; {comment}" if comment else _MARK
        yield _commented(f"{name} = {toml_value(table[name])}", comment)


def unmarked(comment: str) -> str:
    """A key's comment in a file of `rig_text` once its value is no longer assumed."""
    return comment.replace(f"{_MARK}; ", "")


def write_rig_of_logs(path: Path, content: Mapping[str, Any], logs: str, *, force: bool) -> None:
    """Write `rig_text` to `path`; errors as `write_rig_template`."""
    write_new(path, rig_text(content, logs), force=force)


def write_rig_template(path: Path, *, linear: bool, force: bool) -> None:
    """Write it to `path`; InputError where the file exists and `force` is not given."""
    write_new(path, rig_template(linear=linear), force=force)


def _key_lines(section: type[TomlSection], motion: Motion) -> Iterator[str]:
    for name, key in declared_keys(section).items():
        line = key.line(motion)
        if line is not None:
            yield _key_line(name, line) + "\n"


def _key_line(name: str, line: TemplateLine) -> str:
    sign = "# " if line.optional else ""
    return _commented(f"{sign}{name} = {line.value}", line.comment)


def _section_comment(section: str, motion: Motion) -> str:
    marks = RigFile.model_fields[section].metadata
    comments = (m for m in marks if isinstance(m, SectionComment))
    return next((c.text for c in comments if c.motion in (None, motion)), "")


def _commented(text: str, comment: str) -> str:
    return f"{text:<37}# {comment}" if comment else text
