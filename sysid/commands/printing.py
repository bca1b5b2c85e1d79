"""What the commands print: short tables for people, one JSON object with `--json`.

Output of a single command is in that command's file.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from sysid.blocks.numbers import ascii_text, known
from sysid.blocks.progress import stage_bar
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table
from sysid.blocks.terminal import console, terminal_table
from sysid.errors import grouped, one_line
from sysid.types import Progress, no_progress


def notices(lines: Iterable[str]) -> None:
    """Each notice once, on standard error."""
    error = Console(stderr=True, soft_wrap=True, highlight=False)
    for line in dict.fromkeys(lines):
        error.print(Text(f"sysid: notice: {one_line(line)}"))


def grouped_notices(lines: Iterable[str], *, named: bool = False) -> None:
    """Notices that differ only in numbers, tests, files and sides as one, with what differs.

    `named`: also those that differ in the name before their first colon, of a campaign.
    """
    notices(grouped(lines, named=named, rest="-v shows them"))


def unasked_notices(count: int) -> None:
    """How many notices on what an export lacks are not printed."""
    if count:
        line = f"{count} notice{'s' * (count > 1)} on what the exports omit: -v shows them"
        notices([line])


@contextmanager
def stage_progress(
    expected: Mapping[str, float], verbose: bool = False
) -> Iterator[tuple[Progress, Progress]]:
    """Messages on standard error for each step, and for each stage as it starts.

    On a terminal a bar with the remaining time, by the seconds `expected` of each stage; a line
    for each step elsewhere, and with `verbose`.
    """
    if verbose or not sys.stderr.isatty():
        yield progress(), no_progress
        return
    with stage_bar(expected) as both:
        yield both


def progress(doing: str = "") -> Progress:
    """A function that reports progress on standard error."""
    error = Console(stderr=True, soft_wrap=True, highlight=False)

    def say(what: str) -> None:
        error.print(Text(f"sysid: {doing}{what}"))

    return say


def print_json(content: Any) -> None:
    """One JSON object on standard output and nothing else; null for a number that is not known."""
    print(json.dumps(known(content), indent=2, allow_nan=False, ensure_ascii=False))


class Strong(str):
    """A line that stands out: the answer, the name of what follows."""


Printed = str | Table
"""A line, or a table; what has no rows is not printed."""


def print_blocks(blocks: Iterable[Printed]) -> None:
    """Lines as they are, tables as a terminal of any alphabet shows them.

    A line is folded by whatever shows it, a table to the width.
    """
    out = console()
    for block in blocks:
        if isinstance(block, str):
            style = "bold" if isinstance(block, Strong) else ""
            out.print(Text(block, style=style), soft_wrap=True)
        elif block.rows:
            out.print(terminal_table(block))


def headline(found: Shown) -> Strong:
    """A result in one line, as a terminal of any alphabet shows it."""
    return Strong(ascii_text(found.headline()))


def remarks(found: Shown) -> list[str]:
    """A result's footnotes but for the notices, which are on standard error."""
    noted = {f"notice: {line}" for line in getattr(found, "notices", ())}
    return [ascii_text(line) for line in found.footnotes() if line not in noted]


def print_result(found: Shown, written: Iterable[Path] = ()) -> None:
    """A result as `print` shows it, and the files that were written."""
    tables = (block for one in found.tables() if one.rows for block in ("", one))
    print_blocks((headline(found), *tables))
    said = remarks(found)
    print_blocks(("", *said, *written_lines(written)))


def written_lines(paths: Iterable[Path]) -> list[str]:
    """Where the results are, one line per file."""
    return [f"written: {path}" for path in paths]
