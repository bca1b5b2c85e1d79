"""What a monitor promises, in words: its false alarms, and the smallest changes that it detects."""

from __future__ import annotations

import math
from collections.abc import Iterator

from sysid.blocks.tables import Table, table
from sysid.controllers.monitor.design import MonitorDesign
from sysid.controllers.monitor.drifts import DRIFTS, LEAKAGE, TESTED, Drift
from sysid.controllers.monitor.evidence import FALSE_ALARMS, ODDS, WITHIN, Detectable


def shown_unit(design: MonitorDesign, drift: Drift) -> tuple[str, float]:
    """The unit in which a drift's change is shown, and what it is of SI's: a leak by its flow at
    the supply pressure."""
    p = design.model.parameters
    if drift.kind == LEAKAGE:
        return "mg/s", 1e6 * abs(float(p.supply) ** 2 - float(p.atmosphere) ** 2)
    unit = drift.unit(design.units)
    return {"s": ("ms", 1e3), "Pa": ("kPa", 1e-3)}.get(unit, (unit, 1.0))


def promise() -> tuple[str, ...]:
    """The rate of false alarms and what a kind's name means."""
    count = round(1.0 / FALSE_ALARMS)
    hours = count / 3600.0
    return (
        f"False alarms: one in {count:,} healthy cycles at most ({hours:.0f} h of cycles of 1 s),",
        "as long as friction scatters, and the sensors are as noisy, as the bundle says.",
        f"A kind is named where it is {ODDS:g} times as likely as any other, else it is undecided.",
    )


def change_rows(design: MonitorDesign, found: Detectable) -> list[tuple[str, ...]]:
    """One row per drift that is tested: its name, the change within 1 and 10 cycles, its unit."""
    rows = []
    for k in TESTED:
        unit, factor = shown_unit(design, DRIFTS[k])
        cells = [_shown(factor * float(found.by_cycles[count][k])) for count in WITHIN]
        mark = " (*)" if DRIFTS[k].name in design.assumed else ""
        rows.append((DRIFTS[k].title + mark, *cells, unit))
    return rows


def change_table(design: MonitorDesign, found: Detectable, caption: str) -> Table:
    """The smallest detectable changes as a table."""
    columns = ("drift", *(_within(count) for count in WITHIN), "unit")
    return table(caption, columns, change_rows(design, found), text=(len(columns) - 1,))


def change_lines(design: MonitorDesign, changes: tuple[Detectable, float] | None) -> Iterator[str]:
    """The same as lines of plain text, for the reference cycle."""
    if changes is None:
        yield "Smallest detectable changes: not computed, as the valves do not move the shaft from"
        yield "one end to the other in simulation; sysid monitor BUNDLE LOG gives those of a log."
        return
    found, duration = changes
    yield f"Smallest detectable changes, found in half of the cases, on cycles of {duration:.2g} s"
    yield "in which both valves are switched at 30 % of the stroke from the middle (for another"
    yield "motion: sysid monitor BUNDLE LOG); of twice the size they are practically always found:"
    for title, *cells, unit in change_rows(design, found):
        said = ", ".join(
            f"{cell} {unit} {_within(count)}" for cell, count in zip(cells, WITHIN, strict=True)
        )
        yield f"  {title}: {said}"
    if design.assumed:
        yield "  (*) its standard error in the bundle is not known, and is taken as 3 %"


def _within(count: int) -> str:
    return f"within {count} cycle{'s' * (count > 1)}"


def _shown(value: float) -> str:
    return f"{value:.2g}" if math.isfinite(value) else "none"


__all__ = ["change_lines", "change_rows", "change_table", "promise", "shown_unit"]
