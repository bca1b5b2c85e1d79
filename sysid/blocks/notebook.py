"""Blocks as a notebook shows them: HTML without its own style."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from sysid.blocks.tables import Table


def table_html(table: Table) -> str:
    """A `<table>`; the content of the cells is escaped."""
    caption = f"<caption>{escape(table.caption)}</caption>" if table.caption else ""
    head = "".join(f"<th>{escape(c)}</th>" for c in table.headings)
    rows = ("".join(f"<td>{_lines(c)}</td>" for c in row) for row in table.rows)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _lines(cell: str) -> str:
    return "<br>".join(map(escape, cell.split("\n")))


def result_html(headline: str, tables: Iterable[Table], footnotes: Iterable[str]) -> str:
    """A result below a cell; a table without rows is omitted."""
    shown = "".join(table_html(table) for table in tables if table.rows)
    notes = "".join(f"<li>{escape(line)}</li>" for line in footnotes)
    listed = f"<ul>{notes}</ul>" if notes else ""
    return f"<div><p>{escape(headline)}</p>{shown}{listed}</div>"


__all__ = ["result_html", "table_html"]
