"""Table 5.5.3: what the valve model costs, at low and at high gains, and pressures tracked.

"Imperfect" is backstepping with the bipolynomial's duties on a plant that follows the on/off law;
"perfect" takes its duties from that law's own mean flow.
"""

from __future__ import annotations

import numpy as np

from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.modes import Mode
from sysid.controllers.record import estimates_of, references_of
from sysid.controllers.trajectories import Sine
from sysid.thesis.declaration import (
    Cell,
    Column,
    Declaration,
    Quantity,
    TableLoop,
    figure,
    printed,
    rows_of,
)

_QUANTITIES: tuple[tuple[Quantity, str, str], ...] = (
    ("position", "position", "position_rmse_rad"),
    ("pressure_a", "pressure A", "pressure_a_rmse_pa"),
    ("pressure_b", "pressure B", "pressure_b_rmse_pa"),
)


def by_valve_model(table: str) -> Declaration:
    """A row per sine and valve model; position and pressures at low and at high gains."""
    paths = {row["trajectory"]: _sine(row) for row in printed("table_5_5_1")}
    gains = {row.pop("gains"): _gains(row) for row in printed("table_5_5_2")}
    columns = tuple(
        Column(title, f"{level} gains", "rad" if quantity == "position" else "Pa")
        for level in gains
        for quantity, title, _ in _QUANTITIES
    )
    lines: dict[str, list[Cell]] = {}
    for row in sorted(rows_of("table_5_5_3", table), key=lambda r: r["gains"] == "high"):
        path = paths[row["trajectory"]]
        loop = TableLoop(
            "backstepping",
            Mode.HYBRID,
            path,
            orientation="horizontal",
            assumed_kg=0.0,
            carried_kg=0.0,
            inverse="averaged" if row["valve_model"] == "perfect" else "bipolynomial",
            options=gains[row["gains"]],
        )
        label = f"{path.frequency_hz:g} Hz, {row['valve_model']}"
        cells = [Cell((loop,), figure(row[key]), name) for name, _, key in _QUANTITIES]
        lines.setdefault(label, []).extend(cells)
    return Declaration(columns, tuple((k, tuple(v)) for k, v in lines.items()))


def _sine(row: dict[str, str]) -> Sine:
    return Sine(float(row["amplitude_rad"]), float(row["frequency_hz"]))


def _gains(row: dict[str, str]) -> tuple[tuple[str, float], ...]:
    return tuple((key.removesuffix("_per_s"), float(value)) for key, value in row.items())


def pressure_rmse(case: Case, run: ClosedLoopRun, quantity: Quantity) -> float:
    """RMSE, Pa, between a chamber's pressure and the one that backstepping wanted there.

    The wanted pressures follow from the record: they are functions of what was measured.
    """
    controller = case.controller
    assert isinstance(controller, BacksteppingController)
    wanted = controller.wanted(estimates_of(case, run), references_of(run)).pressures
    side = 0 if quantity == "pressure_a" else 1
    error = wanted[side] - (run.pressure_a, run.pressure_b)[side]
    return float(np.sqrt(np.mean(error**2)))


__all__ = ["by_valve_model", "pressure_rmse"]
