"""A table computed: every closed loop of it in one batch."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.metrics import LOST_RAD
from sysid.controllers.trajectories import DURATION_S
from sysid.thesis.declaration import Cell, Column, Declaration, Quantity, TableLoop
from sysid.thesis.index import ENTRIES, declared
from sysid.thesis.rig import TableRig
from sysid.thesis.valve import pressure_rmse
from sysid.types import Progress, no_progress


@dataclass(frozen=True)
class TableRow:
    """A row: errors by column, ours and the printed one, in the columns' units.

    NaN in `ours`: the loop is unstable; in `printed`: the print cannot be read.
    """

    label: str
    ours: tuple[float, ...]
    printed: tuple[float, ...]


@dataclass(frozen=True)
class ThesisTable:
    """A table of the thesis, and what its rows and columns are.

    `is_experiment`: printed figures were measured on the rig, ours are simulated. `measure`: what
    the cells hold, RMSE, or errors that the rows name.
    """

    name: str
    title: str
    heading: str
    columns: tuple[Column, ...]
    rows: tuple[TableRow, ...]
    is_experiment: bool = False
    measure: Literal["RMSE", "error"] = "RMSE"


@dataclass(frozen=True)
class Agreement:
    """How many cells agree, of those that can be read.

    `tracked`: cells that the print does not lose, and of these how many of ours are within a
    factor of 2 of it, `lower` or `higher` (unstable ones among them). `lost`: cells above 0.1 rad
    in print, which the thesis calls unstable (5.4.1.3); `both`: lost in ours as well.
    """

    tracked: int
    within: int
    lower: int
    higher: int
    lost: int
    both: int

    @classmethod
    def of(cls, tables: Iterable[ThesisTable]) -> Agreement:
        """The count over all cells of these tables."""
        tracked: list[tuple[float, float]] = []
        lost: list[tuple[float, float]] = []
        for table in tables:
            for row in table.rows:
                for column, ours, theirs in zip(table.columns, row.ours, row.printed, strict=True):
                    if not theirs > 0.0:  # not legible, or too small for the print
                        continue
                    is_lost = column.unit == "rad" and theirs >= LOST_RAD
                    (lost if is_lost else tracked).append((ours, theirs))
        factors = np.array([math.inf if math.isnan(o) else o / p for o, p in tracked])
        lower, higher = int(np.sum(factors < 0.5)), int(np.sum(factors > 2.0))
        both = sum(not o < LOST_RAD for o, _ in lost)
        within = len(tracked) - lower - higher
        return cls(len(tracked), within, lower, higher, len(lost), both)


_Errors = dict[tuple[TableLoop, Quantity], float]


def thesis_table(
    name: str, rig: TableRig, progress: Progress = no_progress, duration: float = DURATION_S
) -> ThesisTable:
    """One of TABLES, computed on this rig over `duration` s.

    Raises InputError for another name, or for a rig that lacks what the table needs.
    """
    return thesis_tables([name], rig, progress, duration)[name]


def thesis_tables(
    names: Sequence[str],
    rig: TableRig,
    progress: Progress = no_progress,
    duration: float = DURATION_S,
) -> dict[str, ThesisTable]:
    """Several of TABLES, each loop that they share run once, all in one batch."""
    found = {name: declared(name) for name in names}
    cells = [cell for one in found.values() for _, row in one.rows for cell in row]
    loops = tuple(dict.fromkeys(loop for cell in cells for loop in cell.loops))
    cases = [rig.case_of(loop) for loop in loops]
    progress(f"simulating {len(loops)} closed loops of {duration:g} s")
    runs = dict(zip(loops, zip(cases, rig.run(cases, duration), strict=True), strict=True))
    errors = _errors(cells, runs, rig.reach)
    return {name: _table(name, one, errors) for name, one in found.items()}


def _table(name: str, found: Declaration, errors: _Errors) -> ThesisTable:
    entry = ENTRIES[name]
    rows = tuple(
        TableRow(
            label,
            tuple(_mean(errors, cell) for cell in row),
            tuple(cell.printed for cell in row),
        )
        for label, row in found.rows
    )
    title = f"Table {name}, {entry.title}"
    quantities = {cell.quantity for _, row in found.rows for cell in row}
    return ThesisTable(
        name,
        title,
        entry.heading,
        found.columns,
        rows,
        entry.is_experiment,
        "error" if quantities & {"mae", "sse", "ssa"} else "RMSE",
    )


def _errors(
    cells: list[Cell], runs: dict[TableLoop, tuple[Case, ClosedLoopRun]], reach: float
) -> _Errors:
    wanted = {(loop, cell.quantity) for cell in cells for loop in cell.loops}
    return {(loop, quantity): _error(*runs[loop], quantity, reach) for loop, quantity in wanted}


def _error(case: Case, run: ClosedLoopRun, quantity: Quantity, reach: float) -> float:
    """A quantity's error; NaN for a loop that is unstable."""
    if math.isnan(position_error(run, reach)):
        return math.nan
    if quantity in ("pressure_a", "pressure_b"):
        return pressure_rmse(case, run, quantity)
    return float(getattr(run.metrics, "rmse" if quantity == "position" else quantity))


def position_error(run: ClosedLoopRun, reach: float) -> float:
    """RMSE, rad; NaN for a loop that is unstable: it leaves the cylinder's stroke."""
    if not np.isfinite(run.position).all() or np.max(np.abs(run.position)) > reach:
        return math.nan
    return run.metrics.rmse


def _mean(errors: _Errors, cell: Cell) -> float:
    return float(np.mean([errors[loop, cell.quantity] for loop in cell.loops]))


__all__ = [
    "LOST_RAD",
    "Agreement",
    "TableRow",
    "ThesisTable",
    "position_error",
    "thesis_table",
    "thesis_tables",
]
