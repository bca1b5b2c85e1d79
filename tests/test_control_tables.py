"""The thesis' tables of controllers: their print, what they declare, and some computed."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import sysid as si
from sysid.commands.app import main
from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.modes import Mode
from sysid.controllers.trajectories import thesis_trajectory
from sysid.errors import InputError
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.pipeline.control_table import control_table
from sysid.pipeline.pages.controllers import write_controllers_page
from sysid.thesis import (
    TABLES,
    Agreement,
    Cell,
    Column,
    Declaration,
    TableLoop,
    TableRig,
    TableRow,
    ThesisTable,
    computed,
    declared,
    printed,
    thesis_table,
)
from sysid.thesis.figures import figure_runs, figure_sets
from sysid.thesis.overview import ControllersPage
from sysid.thesis.shown import compared
from sysid.thesis.studies import flow_study, stabilities

APPENDICES = [
    (name, n)
    for name, count in (("A", 24), ("B", 12), ("C", 16), ("D", 32))
    for n in range(1, count + 1)
]
# Rows and columns as printed; what cannot be read is an empty cell.
SHAPES = (
    {"4.5.1": (3, 4), "4.5.2": (2, 4), "4.5.3": (2, 4)}
    | {"4.5.4": (12, 6), "4.5.5": (8, 6), "4.5.6": (8, 6)}
    | {"5.2.1": (2, 2), "5.2.2": (2, 2), "5.3.1": (10, 2), "5.5.3": (8, 6)}
    | {f"5.4.{n}": (6, 6) for n in range(4, 27) if n != 13}
    | {"4.4.3": (4, 2), "6.3.2": (2, 5)}
    | {f"6.5.{n}": (4, 6) for n in range(1, 23) if n != 18}
    | {f"{a}.{n}": (4 if n % 4 in (1, 2) else 2, 6) for a, n in APPENDICES}
)
# Where a whole table's rows are lost from the text, or a cell of it.
NOT_LEGIBLE = {"4.5.6": 6, "5.4.26": 1, "C.2": 24}


@pytest.fixture(scope="module")
def bundle() -> si.Bundle:
    return si.read_bundle(thesis_folder() / REFERENCE_BUNDLE)


@pytest.fixture(scope="module")
def rig(bundle: si.Bundle) -> TableRig:
    return TableRig.of(bundle)


def cells_of(found: Declaration) -> list[Cell]:
    return [cell for _, row in found.rows for cell in row]


# --- the print -------------------------------------------------------------------------------


def test_all_tables_are_declared() -> None:
    assert set(TABLES) == set(SHAPES)


@pytest.mark.parametrize("name", TABLES)
def test_a_table_has_the_printed_shape(name: str) -> None:
    found = declared(name)
    rows, columns = SHAPES[name]
    assert len(found.rows) == len({label for label, _ in found.rows}) == rows
    assert len(found.columns) == len({c.label for c in found.columns}) == columns
    assert {len(row) for _, row in found.rows} == {columns}
    given = [cell.printed for cell in cells_of(found)]
    assert sum(math.isnan(value) for value in given) == NOT_LEGIBLE.get(name, 0)
    lowest = -math.inf if name[0] in "ABCD" else 0.0  # a steady-state amplitude may be printed as 0
    assert all(value > lowest for value in given if not math.isnan(value))
    for column in range(columns):
        cells = [(row[column].loops, row[column].quantity) for _, row in found.rows]
        assert len(set(cells)) == rows


def test_printed_tables_come_with_the_package() -> None:
    project = Path(__file__).resolve().parent.parent
    shipped = (project / "pyproject.toml").read_text("utf-8")
    names = [path.name for path in (project / "datasets" / "thesis").glob("table_[456a]*.csv")]
    assert len(names) == 16
    assert [name for name in names if f"sysid/_thesis/{name}" not in shipped] == []


def test_printed_means_are_those_of_the_tests() -> None:
    for row in printed("table_4_5_experiment"):
        if row["mean_rmse_rad"]:
            tests = [float(row[f"test_{n}_rmse_rad"]) for n in range(1, 6)]
            assert np.mean(tests) == pytest.approx(float(row["mean_rmse_rad"]), rel=6e-3)


def test_appendices_repeat_chapter_6() -> None:
    """Their RMSE are those of Tables 6.5.1 to 6.5.22, but for two misprints."""
    keys = ("orientation", "controller", "mode", "trajectory", "estimator", "actual_payload_kg")
    tests = [f"test_{n}" for n in range(1, 6)]
    chapter = {tuple(r[k] for k in keys): r for r in printed("table_6_5")}
    other = []
    for row in printed("table_a_to_d"):
        if row["quantity"] != "rmse" or not row["mean_rad"]:
            continue
        twin = chapter.pop(tuple(row[k] for k in keys))
        assert twin["table"] == row["rmse_table"]
        other += [
            (row["table"], test)
            for test in tests
            if float(row[f"{test}_rad"]) != float(twin[f"{test}_rmse_rad"])
        ]
    assert other == [("A.1", "test_1"), ("B.2", "test_5")]
    assert [row["table"] for row in chapter.values()] == ["6.5.19"]  # of C.2, which is lost


def test_the_experiments_of_chapter_6_run_with_their_own_gains(rig: TableRig) -> None:
    """Tables 6.3.1, 6.3.3 and 6.5.18; 0.22 kg assumed."""
    own = rig.design.parameters.inertia
    for table, gains in (
        ("6.5.8", {"k1": 30.0, "k2": 30.0, "k3": 10.0, "k4": 10.0, "motor_p": 197.3}),
        ("6.5.22", {"k1": 40.0, "k2": 20.0, "k3": 45.0, "motor_d": 0.65, "portion": 0.1}),
        ("6.5.17", {"horizon": 50, "hold": 5, "natural_frequency": 20.0, "damping": 0.1}),
    ):
        found = declared(table)
        label, row = found.rows[-1]
        assert label == "hybrid, trajectory 4"
        case = rig.case_of(row[0].loops[0])
        controller: Any = case.controller
        assert {name: getattr(controller, name) for name in gains} == gains
        assert float(controller.design.parameters.inertia - own) == pytest.approx(0.22 * 0.37**2)
        carried = {"6.5.8": 0.22}.get(table, 0.32)
        assert float(case.plant.parameters.inertia - own) == pytest.approx(carried * 0.37**2)
        assert (controller.estimator is not None) == (table == "6.5.17")
    pneumatic = cells_of(declared("6.5.8"))[0]
    assert pneumatic.loops[0].type == 3 and len({loop.seed for loop in pneumatic.loops}) == 1
    assert len({loop.seed for loop in cells_of(declared("6.5.8"))[5].loops}) == 5


def test_the_previous_prototype_has_its_inertias(rig: TableRig) -> None:
    loop = cells_of(declared("4.4.3"))[0].loops[0]
    case = rig.case_of(loop)
    assumed = float(case.controller.design.parameters.inertia)  # type: ignore[attr-defined]
    assert assumed == pytest.approx(0.0275, abs=1e-4)
    assert float(case.plant.parameters.inertia) == pytest.approx(1.9 * assumed, rel=1e-3)


def test_a_stronger_motor_is_known_to_its_controllers(rig: TableRig) -> None:
    strong = rig.limited(1.2)
    for loop in (TableLoop("dvmpc", Mode.MOTOR, 4), TableLoop("backstepping", Mode.MOTOR, 4)):
        case = strong.case_of(loop)
        limits = case.plant.parameters, case.controller.design.parameters  # type: ignore[attr-defined]
        assert [p.max_effort for p in limits] == [1.2, 1.2]
    with pytest.raises(InputError, match="not positive"):
        rig.limited(0.0)


def test_valves_without_delay_are_known_to_the_controllers(rig: TableRig) -> None:
    """Half of the period open passes half of the flow: no share is added by delays."""
    fast = rig.without_delays()
    case = fast.case_of(TableLoop("backstepping", Mode.PNEUMATIC, 4, inverse="averaged"))
    controller: Any = case.controller
    for parameters in (case.plant.parameters, controller.design.parameters):
        assert parameters.on_delay_a == parameters.off_delay_b == 0.0
    law = controller.design.inverse_a
    both = law.open_flow(np.array([1.5e5])), law.closed_flow(np.array([1.5e5]))
    assert law.flow(np.array([0.5]), np.array([1.5e5])) == pytest.approx(0.5 * sum(both))
    other = rig.case_of(TableLoop("backstepping", Mode.PNEUMATIC, 4)).controller
    thesis = fast.case_of(TableLoop("backstepping", Mode.PNEUMATIC, 4)).controller
    duties = [c.design.inverse_a.duty(1e-4, 1.5e5) for c in (other, thesis)]  # type: ignore[attr-defined]
    assert duties[1] > duties[0]


def test_printed_inertias_are_those_of_the_rig(rig: TableRig) -> None:
    """Table 5.4.2 follows from 5.4.1 with the rig's arm and lever."""
    for row in printed("table_5_4_payloads"):
        for name in ("controller", "actual"):
            loaded = rig.assuming(float(row[f"{name}_payload_kg"])).design.parameters.inertia
            assert float(loaded) == pytest.approx(float(row[f"{name}_inertia_kg_m2"]), abs=6e-4)


def test_what_is_printed_twice_agrees_where_it_should() -> None:
    """Without the estimator Tables 5.4.4 to 5.4.6 come again in 5.4.7 to 5.4.12, and so on."""
    seen: dict[Any, dict[str, str]] = {}
    factors = []
    for row in printed("table_5_4"):
        keys = ("orientation", "controller", "mode", "type", "trajectory", "estimator")
        key = tuple(row[k] for k in (*keys, "controller_payload_kg"))
        for case in ("below_rmse_rad", "equal_rmse_rad", "above_rmse_rad"):
            if key in seen and row[case] and seen[key][case]:
                factors.append(float(row[case]) / float(seen[key][case]))
        seen.setdefault(key, row)
    assert len(factors) == 251
    assert np.median(np.abs(np.log(factors))) < 0.01


# --- what is run -----------------------------------------------------------------------------


def test_payloads_and_orientation_reach_controller_and_plant(rig: TableRig) -> None:
    """Table 5.4.22, 0.5 kg assumed and 0.9 kg carried, type 4 with the estimator."""
    found = declared("5.4.22")
    label, row = found.rows[-1]
    assert (label, found.columns[-1].label) == ("hybrid, type 4", "estimator on, 0.9 kg")
    case = rig.case_of(row[-1].loops[0])
    plant, controller = case.plant.parameters, case.controller
    own = rig.design.parameters
    arm = 0.5 * 0.30 * 0.46 * 9.81
    assert plant.inertia - own.inertia == pytest.approx(0.9 * 0.37**2)
    assert plant.gravity_moment == pytest.approx(arm + 0.9 * 0.37 * 9.81)
    known = controller.design.parameters  # type: ignore[attr-defined]
    assert known.inertia - own.inertia == pytest.approx(0.5 * 0.37**2)
    assert known.gravity_moment == pytest.approx(arm + 0.5 * 0.37 * 9.81)
    assert controller.estimator is not None  # type: ignore[attr-defined]
    assert case.trajectory.sample(np.array([0.25]))[0, 0] == pytest.approx(0.6)


def test_the_horizontal_has_no_weight(rig: TableRig) -> None:
    upright = rig.turned(vertical=True)
    assert upright.design.gravity == 1.0 and upright.plant.parameters.gravity_moment > 0.0
    assert upright.turned(vertical=False) == rig


def test_the_experiments_run_with_their_own_gains(rig: TableRig) -> None:
    cell = cells_of(declared("4.5.6"))[-1]
    assert [loop.seed for loop in cell.loops] == [1, 2, 3, 4, 5]
    controller: Any = rig.case_of(cell.loops[0]).controller
    inertia = rig.design.parameters.inertia
    assert controller.horizon == 60
    assert inertia * controller.natural_frequency**2 == pytest.approx(9.5)
    damping = 2.0 * controller.damping * controller.natural_frequency * inertia
    assert damping == pytest.approx(0.67)


def test_a_vertical_table_needs_the_arm(rig: TableRig) -> None:
    bare = dataclasses.replace(rig, arm_moment=None)
    with pytest.raises(InputError, match="arm_mass_kg"):
        thesis_table("5.4.16", bare, duration=0.1)


# --- computed --------------------------------------------------------------------------------


def test_a_table_holds_the_errors_of_its_loops(rig: TableRig) -> None:
    found = thesis_table("5.2.2", rig, duration=0.5)
    cells = cells_of(declared("5.2.2"))
    runs = rig.run([rig.case_of(cell.loops[0]) for cell in cells], 0.5)
    ours = [value for row in found.rows for value in row.ours]
    assert ours == [run.metrics.rmse for run in runs]
    assert [value for row in found.rows for value in row.printed] == [c.printed for c in cells]


def test_pressures_are_tracked_and_a_lost_loop_is_unstable(
    rig: TableRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Table 5.5.3, its first half second, with the last loop driven off its stroke."""
    run = TableRig.run

    def lose_one(self: TableRig, cases: list[Case], duration: float) -> list[ClosedLoopRun]:
        runs = run(self, cases, duration)
        return [*runs[:-1], dataclasses.replace(runs[-1], position=runs[-1].position + 2.0)]

    monkeypatch.setattr(TableRig, "run", lose_one)
    found = thesis_table("5.5.3", rig, duration=0.5)
    ours = np.array([row.ours for row in found.rows])
    assert np.isnan(ours[-1, 3:]).all() and np.isfinite(ours[:-1]).all()
    assert [c.unit for c in found.columns] == ["rad", "Pa", "Pa"] * 2
    # 1 Hz at low gains: the chambers are some kPa off, of 200 kPa that they have.
    assert 500.0 < ours[0, 1] < 30e3 and 500.0 < ours[0, 2] < 30e3


def test_agreement_counts_cells() -> None:
    columns = tuple(Column(name) for name in "abcdef")
    ours = (1.0e-3, 1.0e-3, 1.0e-3, math.nan, math.nan, 0.2)
    print_ = (1.9e-3, 2.1e-3, 0.4e-3, 1.0e-3, 0.3, 0.3)
    table = ThesisTable("0", "", "", columns, (TableRow("", ours, print_),))
    assert Agreement.of([table]) == Agreement(4, 1, 1, 2, 2, 2)


def test_an_error_of_nothing_is_far_below_the_print() -> None:
    """A simulated test may end exactly where it should."""
    rows = (TableRow("", (0.0, 1.0e-3), (1.0e-3, 1.0e-3)),)
    table = ThesisTable("0", "", "", (Column("a"), Column("b")), rows)
    ((_, (nothing, same)),) = compared(table).rows
    assert "< 0.01" in str(nothing) and "1" in str(same)


# --- the command -----------------------------------------------------------------------------


def standing(case: Case) -> Any:
    """Stands in for a run, with nothing simulated."""
    metrics = SimpleNamespace(rmse=1e-3 * (1.0 + case.seed))
    return SimpleNamespace(position=np.zeros(4), metrics=metrics)


def test_a_table_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stand(self: TableRig, cases: list[Case], duration: float) -> list[Any]:
        return [standing(case) for case in cases]

    monkeypatch.setattr(TableRig, "run", stand)
    assert main(["control", "--table", "5.4.26", "-o", str(tmp_path), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert len(content["cells"]) == 36
    row = content["cells"][8]
    assert row["payload assumed for carried, estimator"].endswith("estimator off")
    assert row["column"] == "trajectory 1, heavier" and row["printed_rmse_rad"] is None
    page = (tmp_path / "table-5.4.26.html").read_text("utf-8")
    assert "not legible" in page and "fig-table" in page and 'colspan="3"' in page


def test_a_table_of_metrics_with_a_stronger_motor(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Table A.18: RMSE, MAE, SSE, and an SSA that is printed as 0."""
    limits = []

    def stand(self: TableRig, cases: list[Case], duration: float) -> list[Any]:
        limits.extend(case.plant.parameters.max_effort for case in cases)
        metrics = SimpleNamespace(rmse=1e-3, mae=2e-3, sse=3e-3, ssa=4e-3)
        return [SimpleNamespace(position=np.zeros(4), metrics=metrics)] * len(cases)

    monkeypatch.setattr(TableRig, "run", stand)
    assert main(["control", "--table", "A.18", "--max-torque", "1.2", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["rig"].endswith("motor of 1.2 N m") and limits == [1.2] * 5
    found = {(c["metric"], c["column"]): c for c in content["cells"]}
    assert found["MAE", "mean"]["error_rad"] == pytest.approx(2e-3)
    zero = found["SSA", "test 1"]
    assert (zero["error_rad"], zero["printed_error_rad"], zero["factor"]) == (4e-3, 0.0, None)
    assert main(["control", "--table", "A.18"]) == 0
    assert "4.00 / 0" in capsys.readouterr().out


def test_an_unknown_table_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["control", "--table", "5.4.13"]) == 2
    assert "5.4.14" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"table 5\.4\.13"):
        control_table("5.4.13")


# --- the page of all of them -----------------------------------------------------------------


def test_the_figures_are_those_of_the_thesis() -> None:
    figures = [figure for part in figure_sets() for figure in part.figures]
    numbers = {number for figure in figures for number in figure.number.split(", ") if number}
    assert numbers == {f"4.{n}" for n in range(2, 32)} | {"5.1", "5.2", "5.3"}
    assert {figure.view for figure in figures} == {"tracking", "errors", "pressures", "payload"}


def test_the_feedforward_alone_has_no_feedback(rig: TableRig) -> None:
    """Its duties do not depend on where the arm is; backstepping's do."""
    loop = TableLoop("feedforward", Mode.PNEUMATIC, 1)
    feedforward, backstepping = (
        rig.case_of(dataclasses.replace(loop, controller=name)).controller
        for name in ("feedforward", "backstepping")
    )
    path = np.arange(1.5, 1.506, 1e-3)
    rows = thesis_trajectory(1).sample(path).T[:, :, None]
    reference = Reference(*rows[:, 0], Reference(*rows[:, 1:]))
    zero = np.zeros(1)
    duties = []
    for off in (0.0, 5e-4):
        at = StateEstimate(0, rows[0, 0] + off, rows[1, 0], zero, zero, zero + 2e5, zero + 2e5)  # type: ignore[arg-type]
        for controller in (feedforward, backstepping):
            commands = controller.commands(controller.start(1), at, reference)[1]
            duties.append(float(commands.valve_a[0]))
    assert duties[0] == duties[2] and 0.0 < duties[0] < 1.0
    assert duties[1] != duties[3]


def test_the_page_holds_every_table_and_figure(
    rig: TableRig, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Laid out with one short run that stands for all."""
    one = rig.run([rig.case_of(TableLoop("pva", Mode.PNEUMATIC, 1))], 0.05)[0]
    one = dataclasses.replace(one, payload_kg=np.zeros(len(one.time)))
    monkeypatch.setattr(TableRig, "run", lambda self, cases, duration=0.0: [one] * len(cases))
    monkeypatch.setattr(computed, "pressure_rmse", lambda *_: 5e3)
    tables = {name: thesis_table(name, rig) for name in TABLES}
    runs = figure_runs(rig)
    studies = stabilities(rig, runs), flow_study(rig)
    content = ControllersPage("thesis rig", tables, tables, runs, *studies)
    write_controllers_page(tmp_path / "page.html", content)
    page = (tmp_path / "page.html").read_text("utf-8")
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    # An appendix is one table, of the means of its own.
    own = {name[0] if name[0] in "ABCD" else name.replace(".", "-") for name in TABLES}
    assert {f"table-{name}" for name in own} | {"stability", "flow"} <= set(ids)
    shown = sum(len(part.figures) for part in figure_sets()) + len(("all cells", "5.4")) + 8
    assert page.count("<svg ") == shown
    assert not re.search(r'(?:src|href)="(?!#|data:)', page) and "<script" not in page
