"""Terminal output: its width, and tables whose cells are never cut."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table
from rich.text import Text

# A pipe or a file has no width of its own; file names are not cut there.
_PIPED_WIDTH = 132


def console() -> Console:
    """Standard output, as wide as the terminal; piped output is never coloured."""
    width = None if sys.stdout.isatty() else _PIPED_WIDTH
    return Console(soft_wrap=False, highlight=False, width=width)


def new_table(title: str, *columns: str) -> Table:
    """A table whose cells are never cut and whose text is never treated as markup."""
    table = Table(
        title=Text(title), title_justify="left", title_style="bold", box=None, pad_edge=False
    )
    for column in columns:
        table.add_column(column, overflow="fold")
    return table
