"""The thesis' tables of simulated controllers (4.5.1 to 4.5.3, 5.2.1 to 5.3.1) computed anew.

On the thesis' rig, or on that of any bundle. Backstepping takes its duties from bipolynomials,
as there; DVMPC predicts 40 ticks but in Table 5.3.1.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sysid.bundle.content import BundleContent
from sysid.control.backstepping import backstepping_type
from sysid.control.cases import Case
from sysid.control.design_model import DesignModel, design_from_bundle, with_bipolynomials
from sysid.control.dvmpc import DvmpcController
from sysid.control.interface import Controller
from sysid.control.modes import Mode
from sysid.control.pva import PvaController
from sysid.control.sensing import SensorSuite
from sysid.control.task import HORIZON, MOTOR_SHARE, check_rotary, check_travel
from sysid.control.trajectories import thesis_trajectory
from sysid.errors import input_error
from sysid.io.bundled import thesis_folder
from sysid.model.ports import Model
from sysid.types import Progress, no_progress

TABLES = ("4.5.1", "4.5.2", "4.5.3", "5.2.1", "5.2.2", "5.3.1")
TRAJECTORIES = (1, 2, 3, 4)
_TITLES = {
    "4.5.1": "pneumatic mode",
    "4.5.2": "motor mode",
    "4.5.3": "hybrid mode",
    "5.2.1": "backstepping, hybrid, without and with the motor's compensation",
    "5.2.2": "backstepping, pneumatic, without and with feedforward",
    "5.3.1": "DVMPC, pneumatic, by its horizon in ticks",
}
# Tables 5.2.1 and 5.2.2: mode, and the types (Table 5.4.3) without and with.
_TYPES = {"5.2.1": (Mode.HYBRID, (1, 2)), "5.2.2": (Mode.PNEUMATIC, (1, 3))}

Cell = tuple[Controller, int, Mode]
"""One closed loop of a table: controller, trajectory, mode."""


@dataclass(frozen=True)
class TableRig:
    """What the loops of a table run on: the plant, what controllers know of it, its sensors.

    `bipolynomial` is `design` with the thesis' inverse; `is_vertical` chooses the trajectories.
    """

    plant: Model
    design: DesignModel
    bipolynomial: DesignModel
    sensors: SensorSuite
    is_vertical: bool = False

    @classmethod
    def of(cls, bundle: BundleContent) -> TableRig:
        """A bundle's rig. Raises InputError or NotIdentifiedError as `task.prepared` does."""
        rig = bundle.rig
        check_rotary(rig)
        for number in TRAJECTORIES:
            check_travel(rig, number)
        for section in ("motor", "pwm"):
            rig.require(section, "which the tables' controllers need")
        design = design_from_bundle(bundle)
        sensors = SensorSuite.of(rig)
        return cls(design.model, design, with_bipolynomials(design), sensors, rig.is_vertical)

    def case(self, controller: Controller, number: int, mode: Mode, seed: int = 0) -> Case:
        """The closed loop of a cell."""
        path = thesis_trajectory(number, self.is_vertical)
        return Case(controller, self.plant, path, mode, self.sensors, seed=seed)

    def rmse(self, cells: Sequence[Cell]) -> list[float]:
        """RMSE, rad, of every cell, in one batch."""
        from sysid.control.loop import closed_loop

        return [r.metrics.rmse for r in closed_loop([self.case(*cell) for cell in cells])]

    def backstepping(self, kind: int, mode: Mode) -> Controller:
        """Type 1 to 4; without the motor's share where the motor is off."""
        portion = MOTOR_SHARE if mode.uses_motor else 0.0
        return backstepping_type(kind, self.bipolynomial, portion=portion)

    def dvmpc(self, horizon: int = HORIZON, **options: Any) -> DvmpcController:
        """DVMPC with this horizon, ticks."""
        return DvmpcController(self.design, horizon=horizon, **options)

    def named(self, name: str, mode: Mode) -> Controller:
        """The controller of a row of Tables 4.5.1 to 4.5.3."""
        if name == "pva":
            return PvaController()
        return self.dvmpc() if name == "dvmpc" else self.backstepping(4, mode)


@dataclass(frozen=True)
class TableRow:
    """A row: RMSE in rad by column, ours and the printed one."""

    label: str
    ours: tuple[float, ...]
    printed: tuple[float, ...]


@dataclass(frozen=True)
class ThesisTable:
    """A table of the thesis, and what its rows and columns are."""

    name: str
    title: str
    heading: str
    columns: tuple[str, ...]
    rows: tuple[TableRow, ...]


def printed(name: str) -> list[dict[str, str]]:
    """Rows of a file of printed figures: "table_4_5", "table_5_2" or "table_5_3_1"."""
    with (thesis_folder() / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def thesis_table(name: str, rig: TableRig, progress: Progress = no_progress) -> ThesisTable:
    """One of TABLES, computed on this rig. Raises InputError for another name."""
    if name not in TABLES:
        raise input_error(f"table {name}", "is not one that is computed", f"give {TABLES}")
    make = _by_controller if name.startswith("4.5") else _by_type
    return (make if name != "5.3.1" else _by_horizon)(name, rig, progress)


def _by_controller(name: str, rig: TableRig, progress: Progress) -> ThesisTable:
    given = [row for row in printed("table_4_5") if row["table"] == name]
    cells = [
        (rig.named(row["controller"], Mode(row["mode"])), n, Mode(row["mode"]))
        for row in given
        for n in TRAJECTORIES
    ]
    columns = tuple(f"trajectory {n}" for n in TRAJECTORIES)
    keys = [f"trajectory_{n}_rmse_rad" for n in TRAJECTORIES]
    ours = _computed(cells, rig, progress)
    return _table(
        name, "controller", columns, [row["controller"] for row in given], ours, given, keys
    )


def _by_type(name: str, rig: TableRig, progress: Progress) -> ThesisTable:
    given = [row for row in printed("table_5_2") if row["table"] == name]
    mode, kinds = _TYPES[name]
    cells: list[Cell] = [
        (rig.backstepping(kind, mode), int(row["trajectory"]), mode)
        for row in given
        for kind in kinds
    ]
    ours = _computed(cells, rig, progress)
    labels = [f"trajectory {row['trajectory']}" for row in given]
    keys = ["without_rmse_rad", "with_rmse_rad"]
    return _table(name, "trajectory", ("without", "with"), labels, ours, given, keys)


def _by_horizon(name: str, rig: TableRig, progress: Progress) -> ThesisTable:
    given = printed("table_5_3_1")
    ours: list[float] = []
    for row in given:
        controller = rig.dvmpc(int(row["horizon"]))
        cells: list[Cell] = [(controller, n, Mode.PNEUMATIC) for n in (1, 4)]
        progress(f"horizon {row['horizon']}")
        ours += rig.rmse(cells)
    labels = [row["horizon"] for row in given]
    keys = ["trajectory_1_rmse_rad", "trajectory_4_rmse_rad"]
    return _table(name, "horizon", ("trajectory 1", "trajectory 4"), labels, ours, given, keys)


def _computed(cells: list[Cell], rig: TableRig, progress: Progress) -> list[float]:
    progress(f"simulating {len(cells)} closed loops of 10 s")
    return rig.rmse(cells)


def _table(
    name: str,
    heading: str,
    columns: tuple[str, ...],
    labels: list[str],
    ours: list[float],
    given: list[dict[str, str]],
    keys: list[str],
) -> ThesisTable:
    """`ours` row after row; `keys` are the printed columns."""
    width = len(columns)
    rows = tuple(
        TableRow(
            label,
            tuple(ours[i * width : (i + 1) * width]),
            tuple(float(row[key]) for key in keys),
        )
        for i, (label, row) in enumerate(zip(labels, given, strict=True))
    )
    return ThesisTable(name, f"Table {name}, {_TITLES[name]}", heading, columns, rows)


__all__ = ["TABLES", "TableRig", "TableRow", "ThesisTable", "printed", "thesis_table"]
