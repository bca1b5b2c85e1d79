"""The page of a table of the thesis' controllers: our figures next to the printed ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.control.thesis_tables import ThesisTable
from sysid.display.numbers import number
from sysid.io.files import write_atomic
from sysid.report import svg
from sysid.report.blocks import Figure, FigureGroup, HtmlTable, Section, table
from sysid.report.html import fill
from sysid.report.svg import COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE = (8.6, 3.2)
# Letters of a name that fits between two dots.
_SHORT = 4


def write_table_page(path: Path, found: ThesisTable, rig: str) -> None:
    """Write the page, whole or not at all. Raises InputError where that is not possible."""
    write_atomic(path, table_page(found, rig))


def table_page(found: ThesisTable, rig: str) -> str:
    """One self-contained HTML page of a table."""
    factors = np.array(
        [[o / p for o, p in zip(r.ours, r.printed, strict=True)] for r in found.rows]
    )
    closest, farthest = float(factors.min()), float(factors.max())
    caption = "RMSE of the position by cell, logarithmic."
    with svg.styled():
        figure = _figure(found)
    section = Section("figure", "Figure", (), (FigureGroup(caption, (figure,)),))
    return fill(
        "control.html",
        name="Thesis",
        subject=found.title,
        facts=[("Rig", rig), ("Computed by", f"sysid control --table {found.name}")],
        level="plain",
        sentence=(
            f"Our errors are {number(closest, 2)} to {number(farthest, 2)} times the printed ones."
        ),
        metrics=_table(found),
        notes=[],
        sections=[section],
    )


def _table(found: ThesisTable) -> HtmlTable:
    columns = [found.heading.capitalize()]
    for column in found.columns:
        columns += [f"{column.capitalize()}, ours", "printed", "factor"]
    rows = []
    for row in found.rows:
        cells = [row.label]
        for ours, theirs in zip(row.ours, row.printed, strict=True):
            cells += [number(1e3 * ours), number(1e3 * theirs), number(ours / theirs, 2)]
        rows.append(cells)
    return table("RMSE in mrad", columns, rows)


def _figure(found: ThesisTable) -> Figure:
    figure, ax = svg.panel("RMSE, ours and printed", _SIZE)
    places, labels = [], []
    for i in range(len(found.columns)):
        for j in range(len(found.rows)):
            places.append(i * (len(found.rows) + 1) + j)
            labels.append(found.rows[j].label)
    cells = [(r.ours[i], r.printed[i]) for i in range(len(found.columns)) for r in found.rows]
    ours, theirs = 1e3 * np.array(cells).T
    for x, pair in zip(places, zip(ours, theirs, strict=True), strict=True):
        ax.plot([x, x], pair, color=COLOUR["grid"], linewidth=2.0)
    ax.plot(places, theirs, "o", color=COLOUR["measured"], label="Printed")
    ax.plot(places, ours, "o", color=COLOUR["model"], label="Ours")
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(lambda value, _: number(value, 1))
    ax.set_ylabel("RMSE (mrad)")
    ax.set_xlim(min(places) - 0.8, max(places) + 0.8)
    _name_places(ax, found, places, labels)
    svg.legend(ax, loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=2)
    said = "; ".join(
        f"{label}: ours {number(float(o))} mrad, printed {number(float(p))} mrad"
        for label, o, p in zip(labels, ours, theirs, strict=True)
    )
    return svg.to_figure(figure, "fig-table", "RMSE, ours and printed", said)


def _name_places(ax: Axes, found: ThesisTable, places: list[int], labels: list[str]) -> None:
    """Each dot's row below it, long names on two lines in turn; each group's column above."""
    is_long = max(map(len, labels)) > _SHORT
    rows = len(found.rows)
    lowered = ["\n" if is_long and i % rows % 2 else "" for i in range(len(labels))]
    ax.set_xticks(places, [start + name for start, name in zip(lowered, labels, strict=True)])
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.15)
    for i, column in enumerate(found.columns):
        centre = i * (rows + 1) + 0.5 * (rows - 1)
        style: Any = {"ha": "center", "va": "top", "weight": "bold"}
        ax.text(centre, 0.99, column.capitalize(), transform=ax.get_xaxis_transform(), **style)


__all__ = ["table_page", "write_table_page"]
