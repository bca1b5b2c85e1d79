"""What the commands print: short tables for people, one JSON object with `--json`.

Output of a single command is in that command's file.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from sysid.blocks.numbers import ascii_text
from sysid.blocks.progress import stage_bar
from sysid.blocks.quality import QUALITY_COLUMNS, quality_cells, quality_name
from sysid.blocks.tables import Table
from sysid.blocks.terminal import console, new_table, terminal_table
from sysid.errors import one_line
from sysid.estimation.linear import Estimate
from sysid.parallel import Failure, on_its_own
from sysid.parameters import Validation
from sysid.parameters.quality import QualityRecord
from sysid.types import Progress, no_progress

Result = TypeVar("Result")
Other = TypeVar("Other")

# Digits of a parameter, and how many it takes at most to tell an interval's ends apart.
_FOUR, _MOST_DIGITS = ".4g", 9


def unless_failed(not_done: str, work: Callable[[], Result], otherwise: Other) -> Result | Other:
    """What a page shows beside what was asked for; `otherwise`, with a notice, where it fails."""
    found = on_its_own(work)
    if not isinstance(found, Failure):
        return found
    notices([f"{not_done}: {found.reason}"])
    return otherwise


def notices(lines: Iterable[str]) -> None:
    """Each notice once, on standard error."""
    error = Console(stderr=True, soft_wrap=True, highlight=False)
    for line in dict.fromkeys(lines):
        error.print(Text(f"sysid: notice: {one_line(line)}"))


def grouped_notices(lines: Iterable[str], *, named: bool = False) -> None:
    """Notices that differ only in numbers, tests, files and sides as one, with their count.

    `named`: also those that differ in the name before their first colon, of a campaign.
    """
    groups: dict[str, list[str]] = {}
    for line in dict.fromkeys(lines):
        said = line.partition(": ")[2] if named else line
        groups.setdefault(_shape(said), []).append(line)
    notices(
        own[0] + (f" (and {len(own) - 1} more like it: -v shows them)" if len(own) > 1 else "")
        for own in groups.values()
    )


_VARIES = re.compile(
    r"[^\s,;:]*[/\\][^\s,;:]*|[^\s,;:]+\.(?:csv|parquet|toml|json)\b|\b[ABab]\b"
    r"|\d+(?:\.\d+)?(?:e[+-]?\d+)?"
)
_SEVERAL = re.compile(r"#(?:, #)+")


def _shape(line: str) -> str:
    """A notice without what differs between notices of one kind."""
    return _SEVERAL.sub("#", _VARIES.sub("#", line))


def unasked_notices(count: int) -> None:
    """How many notices on what an export lacks are not printed."""
    if count:
        line = f"{count} notice{'s' * (count > 1)} on what the exports leave out: -v shows them"
        notices([line])


@contextmanager
def stage_progress(
    expected: Mapping[str, float], verbose: bool = False
) -> Iterator[tuple[Progress, Progress]]:
    """What is told of each step, and of each stage as it is entered, on standard error.

    On a terminal a bar with the time that is left, by the seconds `expected` of each stage; a line
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
    """One JSON object on standard output and nothing else."""
    print(json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False))


def print_tables(tables: Iterable[Table]) -> None:
    """The tables that have rows, as a terminal of any alphabet shows them."""
    out = console()
    for shown in filter(lambda table: table.rows, tables):
        out.print(terminal_table(shown))


def print_written(paths: Iterable[Path]) -> None:
    """Where the results are, one line per file."""
    out = console()
    for path in paths:
        out.print(Text(f"written: {path}"), soft_wrap=True)


def estimate_cells(estimate: Estimate) -> tuple[str, str, str]:
    """Value, 95 % interval and unit of a parameter, as text."""
    if estimate.reason is not None:
        return "not identified", estimate.reason, ""
    low, high = estimate.interval
    if not (math.isfinite(low) and math.isfinite(high)):
        return f"{estimate.value:.4g}", "", estimate.unit
    form = _form(low, high)
    interval = f"{low:{form}} to {high:{form}}"
    return f"{estimate.value:{form}}", interval, estimate.unit


def _form(low: float, high: float) -> str:
    """How numbers are written so that an interval's ends differ: with four digits, or more."""
    forms = (_FOUR, *(f"#.{digits}g" for digits in range(5, _MOST_DIGITS)))
    return next((f for f in forms if f"{low:{f}}" != f"{high:{f}}"), _FOUR)


def parameter_table(title: str, parameters: Mapping[str, Estimate]) -> RichTable:
    """One row per parameter."""
    table = new_table(title, "parameter", "value", "95 % interval", "unit")
    for name, estimate in parameters.items():
        table.add_row(Text(name), *(Text(c) for c in estimate_cells(estimate)))
    return table


def quality_table(found: Mapping[str, QualityRecord]) -> RichTable:
    """One row per fitted law: how well it follows its tests, and the verdict."""
    table = new_table("How well the laws follow their tests", *QUALITY_COLUMNS)
    for place, one in found.items():
        cells = (quality_name(place), *quality_cells(one))
        table.add_row(*(Text(ascii_text(cell)) for cell in cells))
    return table


def validation_table(validation: Validation | None) -> RichTable:
    """One row per log, valve model and channel of a bundle's `validation`."""
    table = new_table(
        "Open-loop validation",
        "log",
        "use",
        "valve model",
        "channel",
        "RMSE",
        "fit, %",
        "sensor noise",
    )
    for log in [] if validation is None else validation.validated():
        for name, channel in log.channels.items():
            table.add_row(
                Text(log.file),
                log.use,
                log.valve_model,
                name,
                f"{channel.rmse:.4g}",
                "-" if channel.fit_percent is None else f"{channel.fit_percent:.1f}",
                f"{channel.noise_floor:.3g}",
            )
    return table
