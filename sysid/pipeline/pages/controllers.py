"""The pages of the thesis' tables of controllers: of one, and of all with the figures."""

from __future__ import annotations

from pathlib import Path

from sysid.blocks.html import fill
from sysid.blocks.sections import FigureGroup, Section
from sysid.io.files import write_atomic
from sysid.thesis import Agreement, ThesisTable
from sysid.thesis.overview import ControllersPage, rmse_tables, sections, summary
from sysid.thesis.shown import agreement_sentence, compared, figure


def write_table_page(path: Path, found: ThesisTable, rig: str) -> None:
    """Write a table's page, whole or not at all. Raises InputError where that is not possible."""
    group = FigureGroup("RMSE of the position by cell, logarithmic.", (figure(found),))
    page = fill(
        "control.html",
        name="Thesis",
        subject=found.title,
        facts=[("Rig", rig), ("Computed by", f"sysid control --table {found.name}")],
        level="plain",
        sentence=agreement_sentence(Agreement.of([found])),
        metrics=compared(found),
        notes=[],
        sections=[Section("figure", "Figure", (), (group,))],
    )
    write_atomic(path, page)


def write_controllers_page(path: Path, content: ControllersPage) -> None:
    """Write the page of all, whole or not at all. Raises InputError where that is not possible."""
    page = fill(
        "controllers.html",
        name="Controllers",
        subject="the thesis' tables and figures, computed anew",
        facts=[("Rig", content.rig), ("Made by", "python reports/make_controllers.py")],
        level="plain",
        sentence=agreement_sentence(Agreement.of(rmse_tables(content.tables))),
        summary=summary(content),
        sections=list(sections(content)),
    )
    write_atomic(path, page)


__all__ = ["write_controllers_page", "write_table_page"]
