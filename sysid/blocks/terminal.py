"""Terminal output: its width, and tables whose cells are never cut."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table as RichTable
from rich.text import Text

from sysid.blocks.tables import Table, plain_text
from sysid.errors import escaped

# A pipe or a file has no width; file names are not cut there.
_PIPED_WIDTH = 132


def console() -> Console:
    """Standard output, as wide as the terminal; piped output is never coloured."""
    width = None if sys.stdout.isatty() else _PIPED_WIDTH
    return _Console(soft_wrap=False, highlight=False, width=width)


class _Console(Console):
    """Shows what files hold (names, labels, units) without its control characters."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            shown = escaped(segment.text, keep="\n")
            same = segment.control is not None or shown == segment.text
            yield segment if same else Segment(shown, segment.style)


class _Table(RichTable):
    """Cells without control characters: escaped before their width is measured."""

    def add_row(self, *cells: RenderableType | None, **options: Any) -> None:
        super().add_row(*map(_plain, cells), **options)


def _plain(cell: RenderableType | None) -> RenderableType | None:
    text = cell.plain if isinstance(cell, Text) else cell
    if not isinstance(text, str) or (shown := escaped(text, keep="\n")) == text:
        return cell
    return Text(shown)


def new_table(title: str, *columns: str) -> RichTable:
    """A table whose cells are never cut and whose text is never treated as markup."""
    table = _Table(
        title=Text(title) if title else None,
        title_justify="left",
        title_style="bold",
        box=None,
        pad_edge=False,
    )
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def terminal_table(table: Table) -> RichTable:
    """A table as a terminal of any alphabet shows it."""
    shown = new_table(plain_text(table.caption), *map(plain_text, table.headings))
    for row in table.rows:
        shown.add_row(*(Text(plain_text(cell)) for cell in row))
    return shown
