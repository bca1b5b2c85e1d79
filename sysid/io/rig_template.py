"""The commented rig file that `sysid init` writes, from the declarations of its keys."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from sysid.errors import input_error
from sysid.io.declaration import Motion, TemplateLine, TomlSection, declared_keys
from sysid.io.files import write_atomic
from sysid.io.rig_file import RIG_TABLES, RigFile, SectionComment

_HEAD = """\
# What is known about the rig before any test. SI units throughout; pressures are absolute.
# Replace the example values with your own. Delete sections for parts that your rig lacks.
"""
_COMMENT_COLUMN = 37


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


def write_rig_template(path: Path, *, linear: bool, force: bool) -> None:
    """Write it to `path`; InputError where the file exists and `force` is not given."""
    if path.exists() and not force:
        raise input_error(path, "exists already", "choose another file, or give --force")
    write_atomic(path, rig_template(linear=linear))


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
    return f"{text:<{_COMMENT_COLUMN}}# {comment}" if comment else text
