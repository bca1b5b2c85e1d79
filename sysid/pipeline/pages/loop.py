"""The page of a closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sysid.blocks.html import fill
from sysid.blocks.sections import Lines, Section
from sysid.blocks.standing import section_or_why
from sysid.blocks.tables import Table
from sysid.blocks.titles import capital
from sysid.controllers.error_budget import Stability
from sysid.controllers.shown import ShownLoop
from sysid.io.files import write_atomic


def write_control_page(
    path: Path,
    loop: ShownLoop,
    title: str,
    metrics: Table,
    facts: Mapping[str, str],
    notices: Sequence[str],
    stability: Stability | None = None,
) -> None:
    """Write one self-contained HTML page, whole or not at all; `facts` are in its head.

    Raises InputError where that is not possible.
    """
    parts = (
        section_or_why("tracking", "Tracking", loop.tracking),
        section_or_why("pressures", "Chambers", loop.chambers),
        section_or_why("commands", "Commands", loop.commands),
        None if stability is None else _stability(stability),
    )
    faults = loop.run.faults
    # What limits the proof is with the proof.
    notices = [line for line in notices if stability is None or line not in stability.notes()]
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


def _stability(found: Stability) -> Section:
    """Conditions on the gains, and what the run's errors allow."""
    intro = (
        "A proof fails where a condition does not hold; the loop need not. The errors are those of "
        "this run: the plant's effort less what the controller took it for. Their sum never "
        "exceeded its largest value, and the tracking error stays within what that allows.",
    )
    notes = (Lines(tuple(f"{capital(line)}." for line in found.notes())),)
    blocks = (*found.tables(), *(notes if found.notes() else ()))
    return Section("stability", "Stability", intro, blocks)


__all__ = ["write_control_page"]
