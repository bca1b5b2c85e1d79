"""The commented campaign file that `sysid init` writes: one entry for each kind of test."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sysid.io.channels import SIDES
from sysid.io.files import write_new
from sysid.io.kinds import TEST_KINDS, TestKind

_HEAD = """\
# All tests of a rig, and what each may be used for. Paths are relative to this file.
# Keep the entries whose logs you have and delete the others; a kind may have several entries.
# A log holds any number of tests of its kind, in sequence, distinguished by its column `test`.
rig = "rig.toml"                     # what is known about the rig: `sysid init rig.toml`
# name = "after the service of 2024-03-17"  # for readers; a date in it tells a fleet when

# Columns of your own files, each as "column:unit", (g) for gauge; a log may have its own `map` too.
# map = { time_s = "t:ms", pressure_a_pa = "P1:kPa(g)" }
"""
_USES = {
    "fit": "training: parameters are fitted to it",
    "holdout": "held out: nothing is fitted to it; errors are reported on it",
}


@dataclass(frozen=True)
class TemplateEntry:
    """One `[[log]]` of the template."""

    kind: TestKind
    use: str
    valve: str | None = None

    @property
    def file(self) -> str:
        """The file that it names, to be replaced by the user's own."""
        held_out = "holdout" if self.use == "holdout" else None
        parts = [self.kind.name.replace("-", "_"), self.valve, held_out]
        return "_".join(part for part in parts if part) + ".csv"

    def text(self) -> str:
        """Its lines, commented out where it is optional."""
        lines = ["[[log]]", _line(f'kind = "{self.kind.name}"', self.kind.content)]
        lines.append(f'file = "{self.file}"')
        if self.valve:
            lines.append(_line(f'valve = "{self.valve}"', "the valve that was tested"))
        lines.append(_line(f'use = "{self.use}"', _USES[self.use]))
        sign = "# " if self.kind.optional else ""
        return "".join(f"{sign}{line}\n" for line in lines)


def template_entries() -> tuple[TemplateEntry, ...]:
    """Every kind of the log format: motion for training and held out, valves once a side."""
    found = []
    for kind in TEST_KINDS:
        sides = SIDES if kind.of_a_valve else (None,)
        found += [TemplateEntry(kind, "fit", side) for side in sides]
    return (*found, *(TemplateEntry(k, "holdout") for k in TEST_KINDS if k.group == "motion"))


def campaign_template() -> str:
    """A campaign file with every kind of test explained, as text."""
    return "\n".join([_HEAD, *(entry.text() for entry in template_entries())])


def write_campaign_template(path: Path, *, force: bool) -> None:
    """Write it to `path`; InputError where the file exists and `force` is not given."""
    write_new(path, campaign_template(), force=force)


def _line(text: str, comment: str) -> str:
    return f"{text:<27}# {comment}"


__all__ = ["TemplateEntry", "campaign_template", "template_entries", "write_campaign_template"]
