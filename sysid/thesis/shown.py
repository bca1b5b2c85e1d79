"""Tables of the thesis' controllers as they are shown: our figures next to the printed ones."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from sysid.blocks.figures import Figure, Line, Mark, Panel, Points, Role, Scale, Words
from sysid.blocks.numbers import number
from sysid.blocks.tables import ComparedCell, ComparedTable
from sysid.blocks.titles import capital
from sysid.thesis.computed import LOST_RAD, Agreement, ThesisTable
from sysid.thesis.declaration import Column

# Cells that a figure names one by one.
_MOST_NAMED_CELLS = 20
_SECTIONS = {"4.5": "4.5, simulated", "5.2": "5.2, 5.3, 5.5", "5.3": "5.2, 5.3, 5.5"}
_SECTIONS |= {"5.4": "5.4, payloads", "5.5": "5.2, 5.3, 5.5"}
_MEASURED = {"4": "4.5, measured", "6": "6, measured"}
_NAMES = {"pva": "PVA", "backstepping": "Backstepping", "dvmpc": "DVMPC"}
# Letters of a name that fits between two dots.
_SHORT_NAME = 4
_METRICS = ("RMSE", "MAE", "SSE", "SSA")
# Factors from which on a cell is tinted, and tinted more.
_TINTS = (2.0, 5.0)
# The largest group first: the others are drawn over it.
_GROUP_ROLES: tuple[Role, ...] = ("band", "model", "third", "fourth", "second")


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


def _error(value: float, column: Column, missing: str = "unstable") -> str:
    """An RMSE in mrad or kPa; `missing` for NaN."""
    return (
        missing
        if math.isnan(value)
        else number(1e3 * value if column.unit == "rad" else 1e-3 * value)
    )


def _unit(column: Column, found: ThesisTable) -> str:
    has_one = unit_of(found).endswith("mrad")
    return "" if has_one else {"rad": ", mrad", "Pa": ", kPa"}[column.unit]


def unit_of(found: ThesisTable) -> str:
    """The quantity of the table, with its unit if it has one."""
    name = {"RMSE": "RMSE", "error": "errors"}[found.measure]
    return name if len({c.unit for c in found.columns}) > 1 else f"{name} in mrad"


def compared(found: ThesisTable) -> ComparedTable:
    """The table for a page, each of our figures above the printed one."""
    groups = [
        (capital(name), len(list(columns)))
        for name, columns in itertools.groupby(c.group for c in found.columns)
    ]
    rows = []
    for row in found.rows:
        cells = zip(found.columns, row.ours, row.printed, strict=True)
        rows.append((_row_name(row.label), tuple(_cell(*cell) for cell in cells)))
    kind = "simulated above measured" if found.is_experiment else "ours above printed"
    return ComparedTable(
        caption=f"{found.title}: {unit_of(found)}, {kind}",
        heading=found.heading.capitalize(),
        groups=tuple(groups) if any(name for name, _ in groups) else (),
        columns=tuple(capital(c.title) + _unit(c, found) for c in found.columns),
        rows=tuple(rows),
        id=f"table-{found.name.replace('.', '-')}",
    )


def means(tables: Sequence[ThesisTable], letter: str) -> ComparedTable:
    """An appendix's tables as one, a row each: the means of its metrics, ours above measured."""
    rows = []
    for found in tables:
        last = {row.label: (row.ours[-1], row.printed[-1]) for row in found.rows}
        cells = tuple(
            _cell(found.columns[-1], *last[name]) if name in last else ComparedCell("", "", "")
            for name in _METRICS
        )
        rows.append((found.title.removeprefix("Table ").removesuffix(", experiment"), cells))
    return ComparedTable(
        caption=f"Appendix {letter}: means of five tests in mrad, simulated above measured",
        heading="Table",
        groups=(),
        columns=_METRICS,
        rows=tuple(rows),
        id=f"table-{letter}",
    )


def _row_name(label: str) -> str:
    """A row's label as the page writes it."""
    name, *rest = label.split(",")
    return ",".join((_NAMES.get(name, name), *rest))


def _cell(column: Column, ours: float, theirs: float) -> ComparedCell:
    mine, print_ = _error(ours, column), _error(theirs, column, "not legible")
    if math.isnan(theirs):
        return ComparedCell(mine, print_, "")
    if theirs == 0.0:
        return ComparedCell(mine, "0", "")
    if math.isnan(ours):
        return ComparedCell(mine, print_, "", 2)
    factor = ours / theirs
    if column.unit == "rad" and min(ours, theirs) >= LOST_RAD:
        return ComparedCell(mine, print_, f"({_factor(factor)})")
    away = max(factor, 1.0 / factor) if factor > 0.0 else math.inf
    size = sum(away > tint for tint in _TINTS)
    return ComparedCell(mine, print_, f"({_factor(factor)})", size if factor > 1.0 else -size)


def _factor(value: float) -> str:
    if value < 0.01:
        return "< 0.01"
    return "> 100" if value > 100.0 else number(value, 2)


# --- figures -------------------------------------------------------------------------------


def figure(found: ThesisTable) -> Figure:
    """RMSE of the position in every cell, ours and printed; a cloud where the cells are many."""
    if len(found.columns) * len(found.rows) > _MOST_NAMED_CELLS:
        return scatter([found], "fig-table")
    return _dots(found)


def scatter(tables: list[ThesisTable], id: str, title: str = "RMSE, ours over printed") -> Figure:
    """Ours over the printed figure, a dot a position; between the lines they are within 2."""
    groups: dict[str, list[tuple[float, float]]] = {}
    for table in reversed(tables):
        for column, pair in _pairs(table):
            groups.setdefault(_group(table, column, len(tables) > 1), []).append(pair)
    limits = np.array([1e-1, 1.5e3])
    marks: list[Mark] = [
        Line(limits, factor * limits, "muted", width=width)
        for factor, width in ((0.5, 0.6), (1.0, 1.0), (2.0, 0.6))
    ]
    largest = sorted(groups.items(), key=lambda item: -len(item[1]))
    for (name, pairs), role in zip(largest, _GROUP_ROLES, strict=False):
        ours, theirs = 1e3 * np.array(pairs).T
        marks.append(Points(theirs, ours, role, name, size=3.2, is_filled=True))
    low = 0.7 * min(1e3 * min(o, p) for pairs in groups.values() for o, p in pairs)
    reach = (low, float(limits[1]))
    x, y = (Scale(name, "mrad", reach, "log") for name in ("Printed", "Ours"))
    said = agreement_sentence(Agreement.of(tables))
    return Figure(id, title, said, (Panel(x, y, tuple(marks)),), size=(5.2, 4.6))


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
        return _MEASURED[table.name[0]]
    return _SECTIONS.get(table.name[:3], table.name[:3])


def _dots(found: ThesisTable) -> Figure:
    """A dot each for ours and the printed figure, cell by cell."""
    rows = len(found.rows)
    places = np.array([i * (rows + 1) + j for i in range(len(found.columns)) for j in range(rows)])
    labels = [_row_name(row.label) for _ in found.columns for row in found.rows]
    cells = [(r.ours[i], r.printed[i]) for i in range(len(found.columns)) for r in found.rows]
    ours, theirs = 1e3 * np.array(cells).T
    marks: list[Mark] = [
        Line(np.full(2, x), np.array(pair), "grid", width=2.0)
        for x, pair in zip(places.astype(float), zip(ours, theirs, strict=True), strict=True)
    ]
    marks.append(Points(places, theirs, "measured", "Printed", size=6.0, is_filled=True))
    marks.append(Points(places, ours, "model", "Ours", size=6.0, is_filled=True))
    low, high = np.nanmin([ours, theirs]), np.nanmax([ours, theirs])
    top = float(high * (high / low) ** 0.15)
    marks += [
        Words(i * (rows + 1) + 0.5 * (rows - 1), top, column.label.capitalize())
        for i, column in enumerate(found.columns)
    ]
    # Each dot's row below it, long names on two lines in turn.
    is_long = max(map(len, labels)) > _SHORT_NAME
    lowered = ["\n" if is_long and i % rows % 2 else "" for i in range(len(labels))]
    named = zip(places, lowered, labels, strict=True)
    ticks = tuple((float(place), start + name) for place, start, name in named)
    x = Scale(limits=(float(places.min()) - 0.8, float(places.max()) + 0.8), ticks=ticks)
    y = Scale("RMSE", "mrad", (float(low) / 1.3, top * 1.2), "log")
    said = "; ".join(
        f"{label}: ours {number(float(o))} mrad, printed {number(float(p))} mrad"
        for label, o, p in zip(labels, ours, theirs, strict=True)
    )
    panel = Panel(x, y, tuple(marks), legend="over")
    return Figure("fig-table", "RMSE, ours and printed", said, (panel,), size=(8.6, 3.2))


__all__ = ["agreement_sentence", "compared", "figure", "means", "scatter", "unit_of"]
