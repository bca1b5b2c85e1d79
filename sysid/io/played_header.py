"""The comment lines by which a log is known as that of a designed test.

`sysid advise -o` writes them above the commands; a rig that copies them into its log, or a log
that was made from that file, is recognised by them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

_KIND = re.compile(r"^sysid test: (\S+)$")
_FOR = re.compile(r"^for: (\S+) (\S*), expected standard error (\S+), now (\S+)$")
_START = re.compile(r"^test (\S+) starts at (\S+) (\S+)$")


@dataclass(frozen=True)
class PlayedHeader:
    """A designed test's `kind`, and for each thing asked: name, standard error now, after, unit.

    `starts`: where its tests begin that do so off the place where the rig rests, by label, in
    `unit` (rad or m).
    """

    kind: str
    asked: tuple[tuple[str, float, float, str], ...]
    starts: Mapping[str, float] = field(default_factory=dict)
    unit: str = ""

    def lines(self) -> list[str]:
        """The lines that say it."""
        found = [f"sysid test: {self.kind}"]
        for name, now, after, unit in self.asked:
            told = unit.replace(" ", "_") or "1"
            found.append(f"for: {name} {told}, expected standard error {after:.3g}, now {now:.3g}")
        found += [f"test {k} starts at {at:.6g} {self.unit}" for k, at in self.starts.items()]
        return found

    def told(self) -> str:
        """What it is, in words."""
        names = ", ".join(name for name, *_ in self.asked[:3])
        more = f" and {len(self.asked) - 3} more" if len(self.asked) > 3 else ""
        return f"a {self.kind} test that `sysid advise` designed for {names}{more}"


def played_header(comments: Iterable[str]) -> PlayedHeader | None:
    """The header in a log's comments; None without one."""
    kind, asked, starts, unit = None, [], {}, ""
    for line in comments:
        if found := _KIND.match(line):
            kind = found[1]
        elif found := _FOR.match(line):
            name, unit, after, now = found.groups()
            try:
                asked.append((name, float(now), float(after), unit.replace("_", " ")))
            except ValueError:
                continue
        elif found := _START.match(line):
            label, at, unit = found.groups()
            try:
                starts[label] = float(at)
            except ValueError:
                continue
    return None if kind is None else PlayedHeader(kind, tuple(asked), starts, unit)


__all__ = ["PlayedHeader", "played_header"]
