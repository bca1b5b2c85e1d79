"""Blocks as plain text in ASCII: what `print` shows."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import zip_longest

from sysid.blocks.numbers import ascii_text
from sysid.blocks.tables import Table, plain_text

_GAP = "  "


def table_text(table: Table) -> str:
    """Columns aligned by blanks, the caption and the names of the columns above."""
    lines = [
        line
        for row in (table.headings, *table.rows)
        for line in zip_longest(*(plain_text(cell).split("\n") for cell in row), fillvalue="")
    ]
    widths = [max(len(line[i]) for line in lines) for i in range(len(table.columns))]
    aligned = (
        _GAP.join(c.ljust(w) for c, w in zip(line, widths, strict=True)).rstrip() for line in lines
    )
    caption = ascii_text(table.caption)
    return "\n".join((caption, *aligned) if caption else aligned)


def result_text(headline: str, tables: Iterable[Table], footnotes: Iterable[str]) -> str:
    """A result as `print` shows it; a table without rows is omitted."""
    shown = [table_text(table) for table in tables if table.rows]
    blocks = (ascii_text(headline), *shown, "\n".join(map(ascii_text, footnotes)))
    return "\n\n".join(block for block in blocks if block)


__all__ = ["result_text", "table_text"]
