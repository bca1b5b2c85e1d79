"""Tables of the thesis' controllers: our figures next to the printed ones, and a page of one."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number
from sysid.blocks.sections import FigureGroup, Section
from sysid.blocks.tables import ComparedCell, ComparedTable
from sysid.document import svg
from sysid.document.html import fill
from sysid.document.svg import COLOUR
from sysid.io.files import write_atomic
from sysid.thesis import LOST_RAD, Agreement, Column, ThesisTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE = (8.6, 3.2)
_SQUARE = (5.2, 4.6)
# Cells that a figure names one by one.
_FEW = 20
_SECTIONS = {"4.5": "4.5, simulated", "5.2": "5.2, 5.3, 5.5", "5.3": "5.2, 5.3, 5.5"}
_SECTIONS |= {"5.4": "5.4, payloads", "5.5": "5.2, 5.3, 5.5"}
_NAMES = {"pva": "PVA", "backstepping": "Backstepping", "dvmpc": "DVMPC"}
# Letters of a name that fits between two dots.
_SHORT = 4
# Factors from which on a cell is tinted, and tinted more.
_TINTS = (2.0, 5.0)


def write_table_page(path: Path, found: ThesisTable, rig: str) -> None:
    """Write the page, whole or not at all. Raises InputError where that is not possible."""
    write_atomic(path, table_page(found, rig))


def table_page(found: ThesisTable, rig: str) -> str:
    """One self-contained HTML page of a table."""
    with svg.styled():
        figure = scatter([found], "fig-table") if _is_large(found) else _dots(found)
    caption = "RMSE of the position by cell, logarithmic."
    section = Section("figure", "Figure", (), (FigureGroup(caption, (figure,)),))
    return fill(
        "control.html",
        name="Thesis",
        subject=found.title,
        facts=[("Rig", rig), ("Computed by", f"sysid control --table {found.name}")],
        level="plain",
        sentence=agreement_sentence(Agreement.of([found])),
        metrics=compared(found),
        notes=[],
        sections=[section],
    )


def agreement_sentence(count: Agreement) -> str:
    """The count in words."""
    said = (
        f"Of {count.tracked} printed errors, ours are within a factor of 2 in {count.within}, "
        f"smaller in {count.lower} and larger in {count.higher}."
    )
    if count.lost:
        said += (
            f" Above 0.1 rad, which the thesis calls unstable, are {count.lost} more in print, and "
            f"{count.both} of these in ours."
        )
    return said


# --- the table -----------------------------------------------------------------------------


def shown_error(value: float, column: Column, missing: str = "unstable") -> str:
    """An RMSE in mrad or kPa; `missing` for NaN."""
    return (
        missing
        if math.isnan(value)
        else number(1e3 * value if column.unit == "rad" else 1e-3 * value)
    )


def shown_column(column: Column, found: ThesisTable) -> str:
    """A column's name, with its unit where the table has several."""
    return column.label + _unit(column, found)


def _unit(column: Column, found: ThesisTable) -> str:
    has_one = shown_unit(found).endswith("mrad")
    return "" if has_one else {"rad": ", mrad", "Pa": ", kPa"}[column.unit]


def shown_unit(found: ThesisTable) -> str:
    """What the table holds, with the unit if it is one."""
    return "RMSE" if len({c.unit for c in found.columns}) > 1 else "RMSE in mrad"


def compared(found: ThesisTable) -> ComparedTable:
    """The table for a page, each of our figures above the printed one."""
    groups = [
        (name[:1].upper() + name[1:], len(list(columns)))
        for name, columns in itertools.groupby(c.group for c in found.columns)
    ]
    rows = []
    for row in found.rows:
        cells = zip(found.columns, row.ours, row.printed, strict=True)
        rows.append((_row_name(row.label), tuple(_cell(*cell) for cell in cells)))
    kind = "simulated above measured" if found.is_experiment else "ours above printed"
    return ComparedTable(
        caption=f"{found.title}: {shown_unit(found)}, {kind}",
        heading=found.heading.capitalize(),
        groups=tuple(groups) if any(name for name, _ in groups) else (),
        columns=tuple(c.title[:1].upper() + c.title[1:] + _unit(c, found) for c in found.columns),
        rows=tuple(rows),
        id=f"table-{found.name.replace('.', '-')}",
    )


def _row_name(label: str) -> str:
    """A row's label as the page writes it."""
    name, *rest = label.split(",")
    return ",".join((_NAMES.get(name, name), *rest))


def _cell(column: Column, ours: float, theirs: float) -> ComparedCell:
    mine, print_ = shown_error(ours, column), shown_error(theirs, column, "not legible")
    if math.isnan(theirs):
        return ComparedCell(mine, print_, "")
    if math.isnan(ours):
        return ComparedCell(mine, print_, "", 2)
    factor = ours / theirs
    if column.unit == "rad" and min(ours, theirs) >= LOST_RAD:
        return ComparedCell(mine, print_, f"({_factor(factor)})")
    size = sum(max(factor, 1.0 / factor) > tint for tint in _TINTS)
    return ComparedCell(mine, print_, f"({_factor(factor)})", size if factor > 1.0 else -size)


def _factor(value: float) -> str:
    if value < 0.01:
        return "< 0.01"
    return "> 100" if value > 100.0 else number(value, 2)


# --- figures -------------------------------------------------------------------------------


def _is_large(found: ThesisTable) -> bool:
    return len(found.columns) * len(found.rows) > _FEW


def scatter(tables: list[ThesisTable], id: str, title: str = "RMSE, ours over printed") -> Picture:
    """Ours over the printed figure, a dot a position; between the lines they are within 2."""
    figure, ax = svg.panel(title, _SQUARE)
    limits = np.array([1e-1, 1.5e3])
    for factor, width in ((0.5, 0.6), (1.0, 1.0), (2.0, 0.6)):
        ax.plot(limits, factor * limits, color=COLOUR["muted"], linewidth=width)
    groups: dict[str, list[tuple[float, float]]] = {}
    for table in reversed(tables):
        for column, pair in _pairs(table):
            groups.setdefault(_group(table, column, len(tables) > 1), []).append(pair)
    # The largest group first: the others are drawn over it.
    largest = sorted(groups.items(), key=lambda item: -len(item[1]))
    styles = zip(largest, ("band", "model", "third", "fourth", "second"), strict=False)
    for (name, pairs), role in styles:
        ours, theirs = 1e3 * np.array(pairs).T
        ax.plot(theirs, ours, "o", color=COLOUR[role], markersize=3.2, label=name)
    ax.set_xscale("log")
    ax.set_yscale("log")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(lambda value, _: number(value, 1))
    ax.set_xlabel("Printed (mrad)")
    ax.set_ylabel("Ours (mrad)")
    low = min(1e3 * min(o, p) for pairs in groups.values() for o, p in pairs)
    ax.set_xlim(0.7 * low, limits[1])
    ax.set_ylim(0.7 * low, limits[1])
    svg.legend(ax, loc="lower right")
    said = agreement_sentence(Agreement.of(tables))
    return svg.to_figure(figure, id, title, said)


def _pairs(table: ThesisTable) -> list[tuple[Column, tuple[float, float]]]:
    """Ours and printed, rad, of every cell of a position that has both."""
    return [
        (column, (ours, theirs))
        for row in table.rows
        for column, ours, theirs in zip(table.columns, row.ours, row.printed, strict=True)
        if column.unit == "rad" and not math.isnan(ours / theirs)
    ]


def _group(table: ThesisTable, column: Column, by_table: bool) -> str:
    if not by_table:
        return (column.group or column.title).capitalize()
    if table.is_experiment:
        return "4.5, measured"
    return _SECTIONS.get(table.name[:3], table.name[:3])


def _dots(found: ThesisTable) -> Picture:
    figure, ax = svg.panel("RMSE, ours and printed", _SIZE)
    places, labels = [], []
    for i in range(len(found.columns)):
        for j in range(len(found.rows)):
            places.append(i * (len(found.rows) + 1) + j)
            labels.append(_row_name(found.rows[j].label))
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
        ax.text(
            centre, 0.99, column.label.capitalize(), transform=ax.get_xaxis_transform(), **style
        )


__all__ = [
    "agreement_sentence",
    "compared",
    "scatter",
    "shown_column",
    "shown_error",
    "shown_unit",
    "table_page",
    "write_table_page",
]
