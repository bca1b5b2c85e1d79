"""A table of the thesis' controllers, our figures next to the printed ones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.blocks.drawing import plot_panels
from sysid.blocks.progress import progress_or_shown
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table
from sysid.controllers.design_model import require_declared
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.io.files import make_folder
from sysid.parameters import Bundle, read_bundle
from sysid.pipeline.pages.controllers import write_table_page
from sysid.thesis import TABLES, TableRig, ThesisTable, thesis_table
from sysid.thesis.shown import compared, figure, unit_of
from sysid.types import Progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class ControlTable(Shown):
    """A table of the thesis: `table` holds errors in rad, ours and printed; `rig` names the rig."""

    table: ThesisTable
    rig: str

    def headline(self) -> str:
        """The table's title, and the rig."""
        return f"{self.table.title}: {self.table.measure} on {self.rig}"

    @property
    def _key(self) -> str:
        return self.table.measure.lower()

    def records(self) -> list[dict[str, Any]]:
        """One record per cell: ours and the printed value, rad or Pa, and the factor between them.

        The keys say `rmse`, or `error` where rows hold other metrics too. None in ours: the loop is
        unstable; in print: it is illegible.
        """
        return [
            {
                "table": self.table.name,
                self.table.heading: row.label,
                "column": column.label,
                f"{self._key}_{column.unit.lower()}": _known(ours),
                f"printed_{self._key}_{column.unit.lower()}": _known(theirs),
                "factor": _known(ours / theirs) if theirs else None,
            }
            for row in self.table.rows
            for column, ours, theirs in zip(self.table.columns, row.ours, row.printed, strict=True)
        ]

    def tables(self) -> Iterable[Table]:
        """Ours / printed in mrad or kPa, and the factor."""
        kinds = "ours, simulated / printed" if self.table.is_experiment else "ours / printed"
        caption = f"{self.table.title}: {unit_of(self.table)} on {self.rig}, {kinds} (factor)"
        yield replace(compared(self.table).plain(), caption=caption)

    def plot(self, ax: Axes | None = None) -> Axes:
        """RMSE of the position in every cell, ours next to the printed one; logarithmic."""
        return plot_panels(figure(self.table).panels, ax)[0]

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


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def control_table(
    name: str,
    bundle: Bundle | None = None,
    *,
    max_torque_nm: float | None = None,
    valve_delays: bool = True,
    accept_assumed: bool = False,
    progress: Progress | None = None,
) -> ControlTable:
    """Compute a table of the thesis' controllers: 4.4.3 to 5.5.3, 6.3.2 to 6.5.22, or of A to D.

    On a bundle's rig, or (None) on the thesis' own, as far as it is printed; tables of a
    payload in the horizontal or the vertical turn it. `max_torque_nm`: that of the motor at the
    output, in place of the rig's; `valve_delays` False: valves that switch at once. Raises
    InputError or NotIdentifiedError for another number, and for a bundle that the table's
    controllers cannot use.
    """
    known = bundle or read_bundle(thesis_folder() / REFERENCE_BUNDLE)
    require_declared(known, accept_assumed)
    rig, named = TableRig.of(known), known.rig.name
    if max_torque_nm is not None:
        rig = rig.limited(max_torque_nm)
        named = f"{named} with a motor of {max_torque_nm:g} N m"
    if not valve_delays:
        rig, named = rig.without_delays(), f"{named}, valves without delay"
    with progress_or_shown(progress, "controlling") as tell:
        return ControlTable(thesis_table(name, rig, tell), named)


__all__ = ["TABLES", "ControlTable", "control_table"]
