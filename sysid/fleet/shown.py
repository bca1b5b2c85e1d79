"""A fleet as it is shown: what changed, and the trends of each rig."""

from __future__ import annotations

import datetime
from collections.abc import Sequence

import numpy as np

from sysid.blocks.figures import (
    SMALL_PANEL,
    Figure,
    Intervals,
    Line,
    Mark,
    Panel,
    Role,
    Rule,
    Scale,
)
from sysid.blocks.numbers import estimate_cells, number, span, unit
from sysid.blocks.sections import Block, FigureGroup, Fold, Lines, Section
from sysid.blocks.tables import NotedCell, Table, table
from sysid.estimation.linear import LEVEL, Estimate, t_quantile
from sysid.fleet.changes import Change
from sysid.fleet.rows import LEAKAGE, FleetReading
from sysid.fleet.signs import LeakSign
from sysid.fleet.trend import Trend

_TITLES = {
    "friction.static": "Static friction",
    "friction.coulomb": "Coulomb friction",
    "friction.viscous": "Viscous friction",
    LEAKAGE: "Leakage",
}
_VALVE_TITLES = {
    "on_delay_s": "opening delay",
    "off_delay_s": "closing delay",
    "c_fill": "filling, unchoked",
    "c_dis": "emptying, unchoked",
    "choked_flow_fill_kg_s": "filling, choked",
    "choked_flow_dis_kg_s": "emptying, choked",
}
_COURSES = {"step": "step", "growth": "grows"}
# A trend is drawn in the unit that keeps its numbers readable.
_SHOWN = {
    "s": (1e3, "ms"),
    "kg/s": (1e6, "mg/s"),
    "kg/(s Pa^0.5)": (1e6, "mg/(s·Pa⁰·⁵)"),
    "kg/(s Pa)": (1e9, "µg/(s·Pa)"),
}
_EPOCH = datetime.date(1970, 1, 1)


def changes_table(changes: Sequence[Trend]) -> Table:
    """What changed, since when and by how much."""
    rows = [
        (
            t.rig,
            NotedCell(title_of(t.name), plain=t.name),
            t.since,
            _COURSES[t.change.shape],
            *_sizes(t, t.change),
            number(t.p_adjusted, 2),
        )
        for t in changes
        if t.change
    ]
    columns = ("Rig", "Number", "Since", "Course", "Before", "Change by the last date", "p")
    return table("What changed, most certain first", columns, rows, text=(1, 2, 3))


def monitor_cell(alarm: str | None) -> str:
    """What the monitor of the rig's first campaign says of another."""
    return "" if alarm is None else alarm or "no alarm"


def shown_unit(name: str) -> tuple[float, str]:
    """The scale to the unit that keeps a number readable, and that unit."""
    return _SHOWN.get(name, (1.0, unit(name)))


def reading_cell(reading: FleetReading) -> str:
    """A number in its shown unit, to two digits of its error, as elsewhere."""
    factor, _ = shown_unit(reading.unit)
    value, std = factor * reading.value, factor * reading.std
    return estimate_cells(Estimate.symmetric(value, std, "", np.inf))[0]


def _sizes(trend: Trend, change: Change) -> tuple[str, str]:
    """The level before with its unit; the change and its 95 % limits, in percent of a level."""
    factor, shown = shown_unit(trend.unit)
    half = _half() * change.std
    if trend.has_level:
        factor_of_change, shown_of_change = 100.0 / abs(change.before), "%"
        before = f"{number(factor * change.before)} {shown}"
    else:
        factor_of_change, shown_of_change, before = factor, shown, "0"
    low, high = (factor_of_change * (change.size + way * half) for way in (-1.0, 1.0))
    size = number(factor_of_change * change.size)
    return before, f"{size} {shown_of_change} ({span(low, high)})"


def _half() -> float:
    """Half of a 95 % interval in standard errors."""
    return t_quantile(np.inf, LEVEL)


def title_of(name: str) -> str:
    """A number by what it is, its place in the bundle where it has no title."""
    for start, title in _TITLES.items():
        if name.startswith(start):
            return title
    parts = name.split(".")
    if parts[0] == "valves" and parts[-1] in _VALVE_TITLES:
        return f"Valve {parts[1].upper()}: {_VALVE_TITLES[parts[-1]]}"
    return name


def rig_section(
    rig: str, trends: Sequence[Trend], leaks: Sequence[LeakSign], place: int
) -> Section:
    """The trends of a rig; collapsed where none changed."""
    own = [t for t in trends if t.rig == rig and len(t.values)]
    if not own:
        nothing = (Lines(("No parameter of this rig can be tracked.",)),)
        return Section(f"rig-{place}", rig, (), nothing)
    signs = [f"{sign.sentence()}." for sign in leaks if sign.rig == rig]
    said = (*signs, *(f"{_sentence(t)}." for t in own if t.is_change))
    figures = tuple(trend_figure(t, f"fig-{place}-{i}") for i, t in enumerate(own))
    caption = "Estimates with 95 % intervals over the dates of the campaigns"
    if said:
        caption += "; line: the course of what changed, the vertical line its first date"
    group: Block = FigureGroup(f"{caption}.", figures)
    if not said:
        group = Fold(_unchanged(own), (group,))
    return Section(f"rig-{place}", rig, said, (group,))


def _unchanged(trends: Sequence[Trend]) -> str:
    """How many trends were tested, none of which changed; too few dates are no test."""
    tested = sum(1 for t in trends if t.change)
    if tested:
        return f"No change in {tested} trend{'s' * (tested > 1)}"
    dates = max(len(t.dates) for t in trends)
    numbers = f"{len(trends)} number{'s' * (len(trends) > 1)}"
    return f"{numbers} over {dates} date{'s' * (dates > 1)}, too few for a test of trends"


def _sentence(trend: Trend) -> str:
    return trend.sentence(title_of(trend.name), shown_unit(trend.unit))


def trend_figure(trend: Trend, id: str) -> Figure:
    """Estimates over the dates, and the course of what changed."""
    factor, shown = shown_unit(trend.unit)
    x = np.array([_day(date) for date in trend.dates])
    values, half = factor * trend.values, _half() * factor * trend.std
    role: Role = "model" if trend.is_change else "second"
    marks: list[Mark] = [Intervals(x, values, values - half, values + half, role)]
    if trend.change and trend.is_change:
        course = factor * trend.change.at(trend.days)
        is_step = trend.change.shape == "step"
        marks.append(Line(x, course, role, width=0.8, is_step=is_step))
        marks.append(Rule(_day(trend.since), dash="dotted", is_upright=True))
    title = title_of(trend.name)
    said = _sentence(trend) if trend.is_change else f"no change over {len(x)} dates"
    if trend.change is None:
        said = f"{len(x)} dates, too few for a test"
    panel = Panel(Scale(margin=0.04, is_date=True), Scale(unit=shown or "-"), tuple(marks))
    description = f"{span(float(np.min(values)), float(np.max(values)))} {shown}; {said}."
    return Figure(id, title, description, (panel,), size=SMALL_PANEL)


def _day(date: str) -> float:
    """Days since 1970."""
    return float((datetime.date.fromisoformat(date) - _EPOCH).days)


__all__ = ["changes_table", "monitor_cell", "rig_section", "shown_unit", "title_of", "trend_figure"]
