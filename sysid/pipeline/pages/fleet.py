"""The page of a fleet: every campaign with its report, and the trends of each rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import quote

from sysid.blocks.html import fill
from sysid.blocks.sections import Section
from sysid.blocks.standing import section_or_why
from sysid.blocks.titles import capital
from sysid.diagnosis.wording import effect_name
from sysid.fleet.rows import LEAKAGE, FleetRow
from sysid.fleet.shown import (
    changes_table,
    monitor_cell,
    reading_cell,
    rig_section,
    shown_unit,
    title_of,
)
from sysid.fleet.trends import Fleet
from sysid.io.files import write_atomic
from sysid.plant.effects.catalogue import catalogue

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
_KEY = ("friction.static", "friction.coulomb", "friction.viscous", LEAKAGE)


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
    changed = set(fleet.changed_rigs())
    shown = sorted(fleet.rigs, key=lambda rig: rig not in changed)
    trends = (
        section_or_why(f"rig-{i}", rig, partial(rig_section, rig, fleet.trends, fleet.leaks, i))
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
        changes=changes_table(fleet.changes),
        notes=[f"{line}." for line in fleet.notices],
        columns=["Rig", "Date", "Report", "Verdict", "Effects", *names.values(), "Monitor"],
        campaigns=[_cells(row, list(names)) for row in fleet.rows],
        sections=sections,
    )


def _count(number: int, of: str) -> str:
    return f"{number} {of}{'s' if number != 1 else ''}"


def _level(fleet: Fleet) -> str:
    """The worst of what is below: a campaign without a result, a change, a verdict."""
    if fleet.failed or any(row.verdict == "unexplained" for row in fleet.rows):
        return "poor"
    open_ones = any(row.effects or row.verdict == "incomplete" for row in fleet.rows)
    alarms = any(row.alarm for row in fleet.rows)
    return "fair" if fleet.changes or open_ones or alarms else "good"


def _sentence(fleet: Fleet) -> str:
    said = [f"{rig}: {what}" for rig, what in fleet.changed_rigs().items()]
    failed = [f"without a result: {len(fleet.failed)} of {len(fleet.rows)}"] if fleet.failed else []
    if said:
        return f"What changed: {'; '.join([*said, *failed])}."
    tested = any(t.change for t in fleet.trends)
    none = "No trend changed" if tested else "No rig has enough dates for a test of its trends"
    return f"{'; '.join([none, *failed])}."


# --- campaigns -----------------------------------------------------------------------------


def _campaigns() -> Section:
    intro = (
        "Each campaign went through `sysid run`; its report lies in a folder next to this page. "
        "Friction is that of the bench tests; leakage is what a chamber at supply pressure loses "
        "past its valve, by the effects that the diagnosis found. The monitor of a rig's first "
        "bundle watches the motion logs of its later campaigns.",
    )
    return Section("campaigns", "Campaigns", intro)


def _key_names(fleet: Fleet) -> dict[str, str]:
    """The readings that the table shows, one of a kind and unit: rotary and linear rigs differ."""
    units = {r.name: r.unit for row in fleet.rows for r in row.readings}
    found: dict[str, str] = {}
    for start in _KEY:
        for name in (n for n in units if n.startswith(start)):
            title = f"{title_of(start)} ({shown_unit(units[name])[1]})"
            if title not in found.values():
                found[name] = title
    return found


def _cells(row: FleetRow, names: Sequence[str]) -> CampaignCells:
    values = {r.name: reading_cell(r) for r in row.readings}
    titles = {id: one.title for id, one in catalogue().items()}
    return CampaignCells(
        rig=row.origin.rig if row.origin else Path(row.campaign).parent.name,
        date=row.origin.date.isoformat() if row.origin else "",
        verdict=row.failure or _VERDICTS.get(row.verdict, str(row.verdict)),
        level="poor" if row.failure else _LEVELS.get(row.verdict or "", ""),
        failed=bool(row.failure),
        effects=capital(", ".join(effect_name(id, titles) for id in row.effects)),
        cells=(
            *(values.get(n, "") for n in names),
            monitor_cell(row.alarm),
        ),
        report="" if row.failure else quote(f"{row.folder}/{_REPORT}"),
    )


__all__ = ["fleet_page", "write_fleet_page"]
