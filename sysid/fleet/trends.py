"""A fleet: its campaigns in order, the course of each number on each rig, and what changed.

The p-values of all courses of all rigs are adjusted together for the false discovery rate by
Benjamini and Yekutieli (2001), whatever their dependence; a change counts below 5 %.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import Line, Panel, Role, Scale
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.errors import one_line
from sysid.estimation.multiple_tests import adjusted
from sysid.fleet.changes import LEAST_DATES, change_in
from sysid.fleet.rows import FAMILIES, Family, FleetReading, FleetRow
from sysid.fleet.shown import changes_table, monitor_cell
from sysid.fleet.signs import LeakSign, leak_signs
from sysid.fleet.trend import Trend
from sysid.io.rig import differing_sections

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_ROLES: tuple[Role, ...] = ("model", "second", "third", "fourth")


@dataclass(frozen=True, repr=False)
class Fleet(Shown):
    """The result of `sysid fleet`: a row a campaign, by rig and date, and the trends."""

    rows: tuple[FleetRow, ...]
    trends: tuple[Trend, ...]
    notices: tuple[str, ...]

    @property
    def changes(self) -> tuple[Trend, ...]:
        """The trends that changed, the most certain first."""
        return tuple(sorted((t for t in self.trends if t.is_change), key=lambda t: t.p_adjusted))

    @property
    def leaks(self) -> tuple[LeakSign, ...]:
        """The chambers whose valve tests changed as a leak would change them."""
        return leak_signs(self.trends)

    @property
    def rigs(self) -> tuple[str, ...]:
        """The rigs in the order of the rows."""
        return tuple(dict.fromkeys(row.origin.rig for row in self.rows if row.origin))

    @property
    def failed(self) -> tuple[FleetRow, ...]:
        """The campaigns without a result."""
        return tuple(row for row in self.rows if row.failure)

    def headline(self) -> str:
        """How many campaigns of how many rigs, and which rigs changed in what since when."""
        count = f"{len(self.rows)} campaign{'s' if len(self.rows) != 1 else ''}"
        rigs = f"{len(self.rigs)} rig{'s' if len(self.rigs) != 1 else ''}"
        failed = f", {len(self.failed)} without a result" if self.failed else ""
        said = "; ".join(f"{rig}: {what}" for rig, what in self.changed_rigs().items())
        if not said:
            testable = any(t.change for t in self.trends)
            none = "no change" if testable else f"no rig with {LEAST_DATES} dates: no trend tested"
            said = none
        return f"{count} of {rigs}{failed}; {said}"

    def changed_rigs(self) -> dict[str, str]:
        """What changed on each rig: `leakage, delay from 2024-03-17 on; friction from ...`.

        Numbers that change on the same date are one event, the most certain one first.
        """
        found = {}
        for rig in self.rigs:
            events: dict[str, list[str]] = defaultdict(list)
            for trend in (t for t in self.changes if t.rig == rig):
                events[trend.since].append(trend.family)
            if events:
                leaks = [sign.side.upper() for sign in self.leaks if sign.rig == rig]
                sign = f" (as with a leak of chamber {' and '.join(leaks)})" if leaks else ""
                found[rig] = (
                    "; ".join(
                        f"{', '.join(dict.fromkeys(families))} from {date} on"
                        for date, families in sorted(events.items())
                    )
                    + sign
                )
        return found

    def records(self) -> list[dict[str, Any]]:
        """One record per campaign and number: rig, date, value, std, unit."""
        return [
            {
                "rig": t.rig,
                "date": date,
                "family": t.family,
                "name": t.name,
                "value": float(value),
                "std": float(std),
                "unit": t.unit,
            }
            for t in self.trends
            for date, value, std in zip(t.dates, t.values, t.std, strict=True)
        ]

    def tables(self) -> Iterable[Table]:
        """The campaigns, and what changed."""
        yield table(
            "Campaigns",
            ("rig", "date", "verdict", "effects", "monitor"),
            tuple(
                (
                    row.origin.rig if row.origin else row.campaign,
                    row.origin.date.isoformat() if row.origin else "",
                    row.failure or row.verdict or "not diagnosed",
                    ", ".join(row.effects),
                    monitor_cell(row.alarm),
                )
                for row in self.rows
            ),
        )
        yield changes_table(self.changes)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Every trend over time, over its own first value (leakage: over its largest)."""
        marks = [_over_first(t, place) for place, t in enumerate(self.trends)]
        x = Scale("days since the fleet's first campaign")
        return plot_panels((Panel(x, Scale("over the first value"), tuple(marks)),), ax)[0]

    def to_json(self) -> dict[str, Any]:
        """The object that `sysid fleet --json` prints."""
        return {
            "campaigns": [row.to_json() for row in self.rows],
            "trends": [trend.to_json() for trend in self.trends],
            "changes": [
                {"rig": t.rig, "family": t.family, "name": t.name, "since": t.since}
                for t in self.changes
            ],
            "leak_signs": [vars(sign) for sign in self.leaks],
            "notices": list(self.notices),
        }


def _over_first(trend: Trend, place: int) -> Line:
    """One that changed is drawn in colour and named."""
    scale = float(trend.values[0] or np.max(np.abs(trend.values)) or 1.0)
    values = trend.values / scale
    if not trend.is_change:
        return Line(trend.days, values, "measured", width=0.6, marker="o")
    role = _ROLES[place % len(_ROLES)]
    return Line(trend.days, values, role, f"{trend.rig} {trend.name}", width=2.0, marker="o")


def fleet_of(rows: Sequence[FleetRow]) -> Fleet:
    """A fleet of these rows, ordered by rig and date, each trend tested for a change."""
    known = [row for row in rows if row.origin is not None]
    known.sort(key=lambda row: (row.origin.rig, row.origin.date, row.campaign))  # type: ignore[union-attr]
    ordered = (*known, *(row for row in rows if row.origin is None))
    trends = _adjusted(list(_trends(known)))
    notices = (*_notices(ordered), *_other_rig_files(known, trends), *_shared_logs(known))
    return Fleet(ordered, trends, notices)


def _trends(rows: Sequence[FleetRow]) -> Iterable[Trend]:
    by_rig: dict[str, list[FleetRow]] = defaultdict(list)
    for row in rows:
        if row.origin and not row.failure:
            by_rig[row.origin.rig].append(row)
    start = min((r.origin.date for own in by_rig.values() for r in own if r.origin), default=None)
    for rig, own in by_rig.items():
        numbers = {(r.family, r.name, r.unit) for row in own for r in row.readings}
        for key in sorted(numbers, key=lambda k: (FAMILIES.index(k[0]), k[1])):
            points = [(row, reading) for row in own for reading in _reading(row, key, own)]
            dates = tuple(row.origin.date for row, _ in points if row.origin)
            days = np.array([(date - start).days for date in dates if start], dtype=float)
            values = np.array([reading.value for _, reading in points])
            std = np.array([reading.std for _, reading in points])
            shown = tuple(date.isoformat() for date in dates)
            change = change_in(days, values, std)
            yield Trend(rig, key[0], key[1], key[2], shown, days, values, std, change)


def _reading(
    row: FleetRow, key: tuple[Family, str, str], own: Sequence[FleetRow]
) -> Iterable[FleetReading]:
    """The reading of a row; a leak that a whole diagnosis did not find is one of 0.

    Without a point where one was found without a flow, or the search was cut short. The standard
    error of 0 is the median of those where it was found: what it could have been found to.
    """
    family, name, unit_of = key
    found = [r for r in row.readings if (r.family, r.name, r.unit) == key]
    if found:
        return found[:1]
    if family != "leakage" or not row.lacks_leakage:
        return ()
    known = [r.std for other in own for r in other.readings if (r.family, r.name) == (family, name)]
    return (FleetReading(family, name, 0.0, float(np.median(known)), unit_of),)


def _adjusted(trends: list[Trend]) -> tuple[Trend, ...]:
    found = iter(adjusted([t.change.p_value for t in trends if t.change]))
    return tuple(replace(t, p_adjusted=float(next(found))) if t.change else t for t in trends)


def _notices(rows: Sequence[FleetRow]) -> Iterable[str]:
    for row in rows:
        if row.failure:
            why = one_line(row.failure)
            place = "" if why.startswith(row.campaign) else f"{row.campaign}: "
            yield f"{place}no result: {why}"
    guessed = [r for r in rows if r.origin and r.origin.date_from.startswith("day of")]
    if guessed:
        yield (
            f"no date in the name of file, folder or campaign in {len(guessed)} of {len(rows)}: "
            "the day on which the newest log was changed is used; name the folder by its "
            "date, 2024-03-17"
        )


def _other_rig_files(rows: Sequence[FleetRow], trends: Sequence[Trend]) -> Iterable[str]:
    """A line for each date on which numbers changed and the rig file did too."""
    begins = {(t.rig, t.since): None for t in trends if t.is_change}
    for rig, since in sorted(begins):
        own = [(r.origin.date.isoformat(), r) for r in rows if r.origin and r.origin.rig == rig]
        held = [(date, row) for date, row in own if row.rig and not row.failure]
        before = [(date, row) for date, row in held if date < since]
        after = [row for date, row in held if date == since]
        if not before or not after:
            continue
        date, last = before[-1]
        differ = sorted({k for row in after for k in differing_sections(last.rig, row.rig)})
        if differ:
            sections = ", ".join(f"[{k}]" for k in differ)
            yield (
                f"{rig}: the rig file differs from that of {date}: {sections}; what changed from "
                f"{since} on may be the file, not the rig"
            )


def _shared_logs(rows: Sequence[FleetRow]) -> Iterable[str]:
    """A line for each campaign with training logs that an earlier one of the fleet has too."""
    first: dict[str, str] = {}
    for row in rows:
        name = f"{row.origin.rig} of {row.origin.date}" if row.origin else row.campaign
        logs = () if row.failure else row.fit_logs
        found = [first[log] for log in logs if log in first]
        if found:
            yield (
                f"{name}: {len(found)} of its {len(logs)} training logs are those of "
                f"{', '.join(dict.fromkeys(found))}, byte for byte: a test repeated on another "
                "date has a log of its own"
            )
        for log in logs:
            first.setdefault(log, name)


__all__ = ["Fleet", "Trend", "fleet_of"]
