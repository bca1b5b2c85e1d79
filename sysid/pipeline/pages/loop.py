"""The page of a closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sysid.blocks.html import fill
from sysid.blocks.standing import section_or_why
from sysid.blocks.tables import Table
from sysid.controllers.shown import ShownLoop
from sysid.io.files import write_atomic


def write_control_page(
    path: Path,
    loop: ShownLoop,
    title: str,
    metrics: Table,
    facts: Mapping[str, str],
    notices: Sequence[str],
) -> None:
    """Write one self-contained HTML page, whole or not at all; `facts` stand in its head.

    Raises InputError where that is not possible.
    """
    parts = (
        section_or_why("tracking", "Tracking", loop.tracking),
        section_or_why("pressures", "Chambers", loop.chambers),
        section_or_why("commands", "Commands", loop.commands),
    )
    faults = loop.run.faults
    said = f"The loop reports {len(faults)} fault{'s' if len(faults) > 1 else ''}."
    page = fill(
        "control.html",
        name=loop.rig.name,
        subject="closed loop, simulated",
        facts=list(facts.items()),
        level="fair" if faults else "good",
        sentence=f"{title}. {said if faults else 'The loop reports no fault.'}",
        metrics=metrics,
        notes=[*(f"Fault: {line}." for line in faults), *(f"Notice: {line}." for line in notices)],
        sections=list(filter(None, parts)),
    )
    write_atomic(path, page)


__all__ = ["write_control_page"]
