"""What a table of the thesis consists of: closed loops in words, and the printed figures."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from typing import Any, Literal

from sysid.controllers.modes import Mode
from sysid.controllers.trajectories import Sine
from sysid.io.bundled import thesis_folder

Quantity = Literal["position", "mae", "sse", "ssa", "pressure_a", "pressure_b"]
"""What a cell holds: the position's RMSE, its largest error, its steady-state error and amplitude
(6.4), rad, or the RMSE of a chamber's pressure, Pa."""


@dataclass(frozen=True)
class TableLoop:
    """One closed loop in words: what is run, whatever the rig.

    `controller` is "pva", "backstepping" (with its `type` of Table 5.4.3 and its `inverse`),
    "feedforward" (backstepping's alone) or "dvmpc"; `trajectory` a number of Table 4.2.1 or a
    motion of its own. `orientation` "": the rig's own. `assumed_kg` is the payload that the
    controller takes into account, `carried_kg` the one on the plant; None: the rig's own. `options`
    are the controller's fields by name; `as_tested`: DVMPC as in the experiments (Table 4.4.5).
    `seed`: the noise's.
    """

    controller: str
    mode: Mode
    trajectory: int | Sine
    type: int = 4
    orientation: str = ""
    assumed_kg: float | None = None
    carried_kg: float | None = None
    has_estimator: bool = False
    inverse: Literal["bipolynomial", "averaged"] = "bipolynomial"
    options: tuple[tuple[str, Any], ...] = ()
    as_tested: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Cell:
    """A cell: the mean over `loops` of a quantity's error, and the printed figure.

    `printed` is NaN where the print cannot be read.
    """

    loops: tuple[TableLoop, ...]
    printed: float
    quantity: Quantity = "position"


@dataclass(frozen=True)
class Column:
    """A column: its name, its group (or ""), and its unit, rad or Pa."""

    title: str
    group: str = ""
    unit: Literal["rad", "Pa"] = "rad"

    @property
    def label(self) -> str:
        """Group and title."""
        return f"{self.group}, {self.title}" if self.group else self.title


@dataclass(frozen=True)
class Declaration:
    """A table: what its rows and columns are, and its cells, row after row."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]


def printed(name: str) -> list[dict[str, str]]:
    """Rows of a CSV file of printed figures, such as "table_4_5" or "table_5_4"."""
    with (thesis_folder() / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def rows_of(name: str, table: str) -> list[dict[str, str]]:
    """The rows of a file that belong to one table."""
    return [row for row in printed(name) if row["table"] == table]


def figure(text: str) -> float:
    """A printed figure; NaN for one that cannot be read."""
    return float(text) if text else math.nan


__all__ = ["Cell", "Column", "Declaration", "Quantity", "TableLoop", "figure", "printed", "rows_of"]
