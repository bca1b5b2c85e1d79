"""A table of the thesis' controllers, our figures next to the printed ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.bundle import Bundle, read_bundle
from sysid.control.run_files import make_folder
from sysid.control.thesis_tables import TableRig, ThesisTable, thesis_table
from sysid.display.numbers import number
from sysid.display.plots import bars, one_axes
from sysid.display.progress import progress_or_shown
from sysid.display.tables import Shown, ShownTable
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.report.control_tables import write_table_page
from sysid.types import Progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class ControlTable(Shown):
    """A table of the thesis: `table` holds RMSE in rad, ours and printed; `rig` names the rig."""

    table: ThesisTable
    rig: str

    def headline(self) -> str:
        """The table's title, and the rig."""
        return f"{self.table.title}: RMSE on {self.rig}"

    def records(self) -> list[dict[str, Any]]:
        """One a cell: ours, the printed one (rad), and the factor between them."""
        heading = self.table.heading
        return [
            {
                "table": self.table.name,
                heading: row.label,
                "column": column,
                "rmse_rad": ours,
                "printed_rmse_rad": theirs,
                "factor": ours / theirs,
            }
            for row in self.table.rows
            for column, ours, theirs in zip(self.table.columns, row.ours, row.printed, strict=True)
        ]

    def tables(self) -> Iterable[ShownTable]:
        """Ours / printed in mrad, and the factor."""
        rows = []
        for row in self.table.rows:
            pairs = zip(row.ours, row.printed, strict=True)
            rows.append(
                (
                    row.label,
                    *(
                        f"{number(1e3 * o)} / {number(1e3 * p)} ({number(o / p, 2)})"
                        for o, p in pairs
                    ),
                )
            )
        title = f"{self.table.title}: RMSE in mrad on {self.rig}, ours / printed (factor)"
        yield ShownTable(title, (self.table.heading, *self.table.columns), tuple(rows))

    def plot(self, ax: Axes | None = None) -> Axes:
        """RMSE of every cell, ours next to the printed one; logarithmic."""
        ax = one_axes(ax)
        records = self.records()
        labels = [f"{r[self.table.heading]}\n{r['column']}" for r in records]
        heights = {
            "ours": [1e3 * r["rmse_rad"] for r in records],
            "printed": [1e3 * r["printed_rmse_rad"] for r in records],
        }
        bars(ax, labels, heights)
        ax.set_yscale("log")
        ax.set_ylabel("RMSE, mrad")
        return ax

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the table's page into a folder, `table-4.5.3.html`; its path.

        Raises InputError where it cannot be written.
        """
        place = Path(folder)
        make_folder(place)
        page = place / f"table-{self.table.name}.html"
        write_table_page(page, self.table, self.rig)
        return (page,)

    def to_json(self) -> dict[str, Any]:
        """What `sysid control --table N --json` prints."""
        return {"table": self.table.name, "rig": self.rig, "cells": self.records()}


def control_table(
    name: str, bundle: Bundle | None = None, *, progress: Progress | None = None
) -> ControlTable:
    """Compute a table of the thesis, "4.5.1" to "4.5.3", "5.2.1", "5.2.2" or "5.3.1".

    On a bundle's rig, or (None) on the thesis' own, as far as it is printed. Raises InputError
    or NotIdentifiedError for a bundle that controllers cannot use.
    """
    known = bundle or read_bundle(thesis_folder() / REFERENCE_BUNDLE)
    rig = TableRig.of(known)
    with progress_or_shown(progress, "controlling") as tell:
        return ControlTable(thesis_table(name, rig, tell), known.rig.name)


__all__ = ["ControlTable", "control_table"]
