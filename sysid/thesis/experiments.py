"""Tables of experiments: chapter 6 with appendices A to D, and the previous prototype (4.4.3).

All were measured on the rig; ours are simulations of the same controllers with the gains of the
experiments (`table_6_gains.csv`), each test with noise of its own. The controllers assume the
nominal payload of 0.22 kg.
"""

from __future__ import annotations

import functools
from typing import Any

from sysid.controllers.modes import Mode
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

NOMINAL_KG = 0.22
TESTS = (1, 2, 3, 4, 5)
_QUANTITIES: dict[str, tuple[Quantity, str]] = {
    "rmse": ("position", "RMSE"),
    "mae": ("mae", "MAE"),
    "sse": ("sse", "SSE"),
    "ssa": ("ssa", "SSA"),
}


def by_robustness_test(table: str) -> Declaration:
    """A row a mode and trajectory, a column a test (6.5.1 to 6.5.22)."""
    rows = []
    for row in rows_of("table_6_5", table):
        loops = _loops(row)
        label = f"{row['mode']}, trajectory {row['trajectory']}"
        rows.append((label, _cells(loops, row, "_rmse_rad", "position")))
    return Declaration(_columns(), tuple(rows))


def by_metric(table: str) -> Declaration:
    """A row a metric of 6.4, a column a test (appendices A to D)."""
    rows = []
    for row in rows_of("table_a_to_d", table):
        quantity, label = _QUANTITIES[row["quantity"]]
        rows.append((label, _cells(_loops(row), row, "_rad", quantity)))
    return Declaration(_columns(), tuple(rows))


def by_motor_test(table: str) -> Declaration:
    """A row a trajectory, a column a test of the inverse dynamics alone (6.3.2)."""
    rows = []
    for row in rows_of("table_6_3_2", table):
        kind = {
            "orientation": "horizontal",
            "controller": "dvmpc",
            "mode": "motor",
            "estimator": "off",
            "actual_payload_kg": str(NOMINAL_KG),
        }
        cells = tuple(
            Cell((loop,), figure(row[f"test_{n}_rmse_rad"]))
            for n, loop in zip(TESTS, _loops(row | kind), strict=True)
        )
        rows.append((f"trajectory {row['trajectory']}", cells))
    return Declaration(_columns()[:-1], tuple(rows))


def by_previous_hardware(table: str, carried_kg: tuple[float, float]) -> Declaration:
    """RMSE and steady-state error by mode, without and with the estimator (4.4.3).

    The prototype before this one, of which the inertias and the horizon are printed: `carried_kg`
    are the payloads that give them on this rig, assumed and carried.
    """
    rows = []
    for row in printed("table_4_4_3"):
        loop = TableLoop(
            "dvmpc",
            Mode(row["mode"]),
            1,
            orientation="vertical",
            assumed_kg=carried_kg[0],
            carried_kg=carried_kg[1],
            has_estimator=row["estimator"] == "on",
            options=(("horizon", int(row["horizon"])),),
        )
        cells = (
            Cell((loop,), figure(row["rmse_rad"])),
            Cell((loop,), figure(row["sse_rad"]), "sse"),
        )
        rows.append((f"{row['mode']}, estimator {row['estimator']}", cells))
    return Declaration((Column("RMSE"), Column("SSE")), tuple(rows))


def _columns() -> tuple[Column, ...]:
    return (*(Column(f"test {n}") for n in TESTS), Column("mean"))


def _cells(
    loops: tuple[TableLoop, ...], row: dict[str, str], unit: str, quantity: Quantity
) -> tuple[Cell, ...]:
    """The tests, and their mean."""
    tests = [
        Cell((loop,), figure(row[f"test_{n}{unit}"]), quantity)
        for n, loop in zip(TESTS, loops, strict=True)
    ]
    return (*tests, Cell(loops, figure(row[f"mean{unit}"]), quantity))


def _loops(row: dict[str, str]) -> tuple[TableLoop, ...]:
    """A row's five tests: a seed each."""
    mode = Mode(row["mode"])
    options = _retuned()[row["controller"], row["orientation"]]
    return tuple(
        TableLoop(
            row["controller"],
            mode,
            int(row["trajectory"]),
            type=4 if mode is Mode.HYBRID else 3,
            orientation=row["orientation"],
            assumed_kg=NOMINAL_KG,
            carried_kg=float(row["actual_payload_kg"]),
            has_estimator=row["estimator"] == "on",
            options=options,
            seed=n,
        )
        for n in TESTS
    )


_Gains = dict[tuple[str, str], tuple[tuple[str, Any], ...]]


@functools.cache
def _retuned() -> _Gains:
    """The gains of section 6.3 and Table 6.5.18, as the controllers' fields."""
    found: _Gains = {}
    for row in printed("table_6_gains"):
        if row["controller"] == "dvmpc":
            gains: tuple[tuple[str, Any], ...] = (
                ("horizon", int(row["horizon"])),
                ("hold", int(row["hold_ms"])),
                ("natural_frequency", float(row["natural_frequency_per_s"])),
                ("damping", float(row["damping"])),
            )
            found |= {("dvmpc", place): gains for place in ("horizontal", "vertical")}
            continue
        names = {f"k{n}": f"k{n}_per_s" for n in (1, 2, 3, 4)}
        names |= {"motor_p": "motor_p_nm_per_rad", "motor_d": "motor_d_nm_s_per_rad"}
        gains = tuple((name, float(row[column])) for name, column in names.items())
        found["backstepping", row["orientation"]] = gains
    return found


__all__ = [
    "NOMINAL_KG",
    "by_metric",
    "by_motor_test",
    "by_previous_hardware",
    "by_robustness_test",
]
