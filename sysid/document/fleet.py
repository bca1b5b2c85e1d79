"""The page of a fleet: every campaign with its report, and the trends of each rig."""

from __future__ import annotations

import datetime
import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number, unit
from sysid.blocks.sections import Block, FigureGroup, Fold, Lines, Section
from sysid.blocks.tables import Table, table
from sysid.document import svg
from sysid.document.html import fill
from sysid.document.standing import section_or_why
from sysid.document.svg import COLOUR
from sysid.fleet.changes import Change
from sysid.fleet.rows import LEAKAGE, FleetRow
from sysid.fleet.trends import Fleet, Trend
from sysid.io.files import write_atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_REPORT = "report.html"
_LEVELS = {
    "adequate": "good", "effects-found": "fair", "incomplete": "fair", "unexplained": "poor",
}  # fmt: skip
_VERDICTS = {
    "adequate": "adequate",
    "effects-found": "effects found",
    "incomplete": "incomplete",
    "unexplained": "unexplained",
    None: "not diagnosed",
}
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
_KEY = ("friction.static", "friction.coulomb", "friction.viscous", LEAKAGE)
# A trend is drawn in the unit that keeps its numbers readable.
_SHOWN = {
    "s": (1e3, "ms"),
    "kg/s": (1e6, "mg/s"),
    "kg/(s Pa^0.5)": (1e6, "mg/(s·Pa⁰·⁵)"),
    "kg/(s Pa)": (1e9, "µg/(s·Pa)"),
}


@dataclass(frozen=True)
class CampaignCells:
    """A row of the table of campaigns; `report` is a link within the fleet's folder."""

    rig: str
    date: str
    verdict: str
    level: str
    failed: bool
    effects: str
    cells: tuple[str, ...]
    report: str


def write_fleet_page(path: Path, fleet: Fleet) -> None:
    """Write the page, whole or not at all. Raises InputError where that is not possible."""
    write_atomic(path, fleet_page(fleet))


def fleet_page(fleet: Fleet) -> str:
    """One self-contained HTML page; the reports that it links to lie in folders next to it."""
    names = _key_names(fleet)
    with svg.styled():
        changed = set(fleet.changed_rigs())
        shown = sorted(fleet.rigs, key=lambda rig: rig not in changed)
        trends = (
            section_or_why(f"rig-{i}", rig, partial(_rig, fleet, rig, i))
            for i, rig in enumerate(shown)
        )
        sections = [_campaigns(), *filter(None, trends)]
    dates = [row.origin.date for row in fleet.rows if row.origin]
    span = f"{min(dates)} to {max(dates)}" if dates else "none"
    return fill(
        "fleet.html",
        name="Fleet",
        subject=f"{_count(len(fleet.rigs), 'rig')}, {_count(len(fleet.rows), 'campaign')}",
        facts=[("Dates", span), ("Trends tested", str(sum(1 for t in fleet.trends if t.change)))],
        level=_level(fleet),
        sentence=_sentence(fleet),
        changes=_changes(fleet),
        notes=[f"{line}." for line in fleet.notices],
        columns=["Rig", "Date", "Verdict", "Effects", *names.values()],
        campaigns=[_cells(row, list(names)) for row in fleet.rows],
        sections=sections,
    )


def _count(number: int, of: str) -> str:
    return f"{number} {of}{'s' if number != 1 else ''}"


def _level(fleet: Fleet) -> str:
    """The worst of what stands below: a campaign without a result, a change, a verdict."""
    if fleet.failed or any(row.verdict == "unexplained" for row in fleet.rows):
        return "poor"
    open_ones = any(row.effects or row.verdict == "incomplete" for row in fleet.rows)
    return "fair" if fleet.changes or open_ones else "good"


def _sentence(fleet: Fleet) -> str:
    said = [f"{rig}: {what}" for rig, what in fleet.changed_rigs().items()]
    failed = [f"without a result: {len(fleet.failed)} of {len(fleet.rows)}"] if fleet.failed else []
    if said:
        return f"What changed: {'; '.join([*said, *failed])}."
    tested = any(t.change for t in fleet.trends)
    none = "No trend changed" if tested else "No rig has enough dates for a test of its trends"
    return f"{'; '.join([none, *failed])}."


def _changes(fleet: Fleet) -> Table:
    rows = [
        (t.rig, _title(t.name), t.since, _COURSES[t.change.shape], *_sizes(t, t.change), _p(t))
        for t in fleet.changes
        if t.change
    ]
    columns = ("Rig", "Number", "Since", "Course", "Before", "Change by the last date", "p")
    return table("What changed, most certain first", columns, rows, text=(1, 2, 3))


def _sizes(trend: Trend, change: Change) -> tuple[str, str]:
    """The level before with its unit; the change and its 95 % limits, in percent of a level."""
    factor, shown = _SHOWN.get(trend.unit, (1.0, unit(trend.unit)))
    half = 1.96 * change.std
    if trend.has_level:
        factor_of_change, shown_of_change = 100.0 / abs(change.before), "%"
        before = f"{number(factor * change.before)} {shown}"
    else:
        factor_of_change, shown_of_change, before = factor, shown, "0"
    size, low, high = (
        number(factor_of_change * x) for x in (change.size, change.size - half, change.size + half)
    )
    return before, f"{size} {shown_of_change} ({low} to {high})"


def _p(trend: Trend) -> str:
    return number(trend.p_adjusted, 2)


def _title(name: str) -> str:
    for start, title in _TITLES.items():
        if name.startswith(start):
            return title
    parts = name.split(".")
    if parts[0] == "valves" and parts[-1] in _VALVE_TITLES:
        return f"Valve {parts[1].upper()}: {_VALVE_TITLES[parts[-1]]}"
    return name


# --- campaigns -----------------------------------------------------------------------------


def _campaigns() -> Section:
    intro = (
        "Each campaign went through sysid run; its report lies in a folder next to this page. "
        "Friction is that of the bench tests, leakage what a chamber at supply pressure loses past "
        "its valve by the effects that the diagnosis found.",
    )
    return Section("campaigns", "Campaigns", intro)


def _key_names(fleet: Fleet) -> dict[str, str]:
    """The readings that the table shows, one of a kind and unit: rotary and linear rigs differ."""
    units = {r.name: r.unit for row in fleet.rows for r in row.readings}
    found: dict[str, str] = {}
    for start in _KEY:
        for name in (n for n in units if n.startswith(start)):
            shown = _SHOWN.get(units[name], (1.0, unit(units[name])))[1]
            title = f"{_TITLES[start]} ({shown})"
            if title not in found.values():
                found[name] = title
    return found


def _cells(row: FleetRow, names: Sequence[str]) -> CampaignCells:
    values = {r.name: _SHOWN.get(r.unit, (1.0, ""))[0] * r.value for r in row.readings}
    return CampaignCells(
        rig=row.origin.rig if row.origin else Path(row.campaign).parent.name,
        date=row.origin.date.isoformat() if row.origin else "",
        verdict=row.failure or _VERDICTS.get(row.verdict, str(row.verdict)),
        level="poor" if row.failure else _LEVELS.get(row.verdict or "", ""),
        failed=bool(row.failure),
        effects=", ".join(row.effects),
        cells=tuple(number(values[n], 4) if n in values else "" for n in names),
        report="" if row.failure else quote(f"{row.folder}/{_REPORT}"),
    )


# --- rigs ----------------------------------------------------------------------------------


def _rig(fleet: Fleet, rig: str, place: int) -> Section:
    trends = [t for t in fleet.trends if t.rig == rig and len(t.values)]
    if not trends:
        nothing = (Lines(("No number of this rig can be followed.",)),)
        return Section(f"rig-{place}", rig, (), nothing)
    signs = [f"{sign.sentence()}." for sign in fleet.leaks if sign.rig == rig]
    said = (*signs, *(f"{t.sentence(_title(t.name))}." for t in trends if t.is_change))
    figures = tuple(_figure(t, f"fig-{place}-{i}") for i, t in enumerate(trends))
    caption = (
        "Estimates with 95 % intervals over the dates of the campaigns; line: the course of what "
        "changed, the vertical line its first date."
    )
    group: Block = FigureGroup(caption, figures)
    if not said:
        group = Fold(f"No change: {len(trends)} trends", (group,))
    return Section(f"rig-{place}", rig, said, (group,))


def _figure(trend: Trend, id: str) -> Picture:
    factor, shown = _SHOWN.get(trend.unit, (1.0, unit(trend.unit)))
    figure, ax = svg.panel(_title(trend.name), svg.SMALL_PANEL)
    dates = [datetime.date.fromisoformat(date) for date in trend.dates]
    colour = COLOUR["model"] if trend.is_change else COLOUR["second"]
    ax.errorbar(
        np.array(dates),
        factor * trend.values,
        1.96 * factor * trend.std,
        fmt="o",
        markersize=3,
        color=colour,
        elinewidth=0.9,
    )
    if trend.change and trend.is_change:
        course = factor * trend.change.at(trend.days)
        drawn = "steps-post" if trend.change.shape == "step" else "default"
        ax.plot(np.array(dates), course, color=colour, linewidth=0.8, drawstyle=drawn)
        since: Any = np.datetime64(trend.since)
        ax.axvline(since, color=COLOUR["muted"], linewidth=0.6, linestyle=":")
    ax.set_ylabel(shown or "-")
    _date_axis(ax)
    said = (
        trend.sentence(_title(trend.name))
        if trend.is_change
        else f"no change over {len(dates)} dates"
    )
    if trend.change is None:
        said = f"{len(dates)} dates, too few for a test"
    low, high = (number(factor * f(trend.values)) for f in (np.min, np.max))
    return svg.to_figure(figure, id, _title(trend.name), f"{low} to {high} {shown}; {said}.")


def _date_axis(ax: Axes) -> None:
    # Typed `Any`: matplotlib's dates have no annotations.
    dates: Any = importlib.import_module("matplotlib.dates")
    locator = dates.AutoDateLocator(minticks=2, maxticks=6)
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator, show_offset=False))
    low, high = ax.get_xlim()
    margin = 0.04 * max(high - low, 1.0)
    if math.isfinite(margin):
        ax.set_xlim(low - margin, high + margin)


__all__ = ["fleet_page", "write_fleet_page"]
