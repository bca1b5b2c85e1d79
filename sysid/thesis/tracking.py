"""Tables without payload: controllers by mode (4.5), compensations (5.2), horizons (5.3)."""

from __future__ import annotations

from sysid.controllers.modes import Mode
from sysid.controllers.trajectories import TRAJECTORIES
from sysid.thesis.declaration import (
    Cell,
    Column,
    Declaration,
    TableLoop,
    figure,
    printed,
    rows_of,
)
from sysid.thesis.experiments import TESTS


def by_controller(table: str) -> Declaration:
    """A row a controller, a column a trajectory (4.5.1 to 4.5.3)."""
    rows = []
    for row in rows_of("table_4_5", table):
        cells = tuple(
            Cell(
                (TableLoop(row["controller"], Mode(row["mode"]), n),),
                figure(row[f"trajectory_{n}_rmse_rad"]),
            )
            for n in TRAJECTORIES
        )
        rows.append((row["controller"], cells))
    return Declaration(tuple(Column(f"trajectory {n}") for n in TRAJECTORIES), tuple(rows))


def by_test(table: str) -> Declaration:
    """A row a controller and trajectory, a column a test (4.5.4 to 4.5.6, experiments).

    Ours are simulations of the same controller, each test with different noise.
    """
    rows = []
    for row in rows_of("table_4_5_experiment", table):
        tests = [
            TableLoop(
                row["controller"],
                Mode(row["mode"]),
                int(row["trajectory"]),
                as_tested=True,
                seed=n,
            )
            for n in TESTS
        ]
        cells = [
            Cell((loop,), figure(row[f"test_{n}_rmse_rad"]))
            for n, loop in zip(TESTS, tests, strict=True)
        ]
        cells.append(Cell(tuple(tests), figure(row["mean_rmse_rad"])))
        rows.append((f"{row['controller']}, trajectory {row['trajectory']}", tuple(cells)))
    columns = [*(Column(f"test {n}") for n in TESTS), Column("mean")]
    return Declaration(tuple(columns), tuple(rows))


def by_compensation(table: str, mode: Mode, types: tuple[int, int]) -> Declaration:
    """A row a trajectory, backstepping of two types as columns (5.2.1, 5.2.2)."""
    keys = ("without_rmse_rad", "with_rmse_rad")
    rows = []
    for row in rows_of("table_5_2", table):
        n = int(row["trajectory"])
        cells = tuple(
            Cell((TableLoop("backstepping", mode, n, type=kind),), figure(row[key]))
            for kind, key in zip(types, keys, strict=True)
        )
        rows.append((f"trajectory {n}", cells))
    return Declaration((Column("without"), Column("with")), tuple(rows))


def by_horizon(table: str) -> Declaration:
    """A row a horizon of DVMPC, pneumatic; trajectories 1 and 4 (5.3.1)."""
    rows = []
    for row in printed("table_5_3_1"):
        options = (("horizon", int(row["horizon"])),)
        cells = tuple(
            Cell(
                (TableLoop("dvmpc", Mode.PNEUMATIC, n, options=options),),
                figure(row[f"trajectory_{n}_rmse_rad"]),
            )
            for n in (1, 4)
        )
        rows.append((row["horizon"], cells))
    return Declaration((Column("trajectory 1"), Column("trajectory 4")), tuple(rows))


__all__ = ["by_compensation", "by_controller", "by_horizon", "by_test"]
