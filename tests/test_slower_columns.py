"""Columns at rates of their own in one file, and channels with clocks of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from foreign_files import log_of

from sysid.errors import InputError
from sysid.io.alignment import has_own_rate
from sysid.io.conversion import ConversionReport, convert
from sysid.io.foreign import ForeignTable
from sysid.io.foreign.recipe import Recipe
from sysid.io.foreign_columns import log_columns
from sysid.io.reshaping import measured_period
from sysid.io.tables import comments_in
from sysid.io.units import parse_map

ROWS = 60
TIME = np.round(np.arange(ROWS) / 1000.0, 6)
POSITION = np.round(0.05 + 0.01 * np.sin(30.0 * TIME), 7)
FORCE = np.round(5.0 * np.cos(30.0 * TIME), 6)
ALL = list(zip(TIME, POSITION, FORCE, strict=True))
MAPS = ("time_s=t", "position_m=x", "motor_force_n=u")


def write(tmp_path: Path, **columns: Sequence[object]) -> Path:
    path = tmp_path / "rec.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def every(values: np.ndarray, step: int, first: int = 0) -> np.ndarray:
    """Values in every so manieth row, no others."""
    slow = np.full(len(values), np.nan)
    slow[first::step] = values[first::step]
    return slow


def told(report: ConversionReport) -> str:
    return "\n".join(report.notices)


@pytest.mark.parametrize("order", [("t", "x", "u"), ("t", "u", "x"), ("u", "t", "x")])
def test_a_command_is_held_between_its_own_rows(tmp_path: Path, order: tuple[str, ...]) -> None:
    slow = every(FORCE, 5)
    columns = {"t": TIME, "x": POSITION, "u": slow}
    report = convert(
        write(tmp_path, **{n: columns[n] for n in order}), tmp_path / "o.csv", maps=MAPS
    )
    frame = log_of(tmp_path / "o.csv")
    assert frame["position_m"].tolist() == POSITION.tolist()
    assert frame["motor_force_n"].tolist() == pd.Series(slow).ffill().tolist()
    assert "u is empty in 80 % of the rows, held between its own (every 0.005 s)" in told(report)


@pytest.mark.parametrize("fill", [None, "linear", "hold"])
def test_a_measurement_lies_between_its_own_rows(tmp_path: Path, fill: str | None) -> None:
    slow = every(POSITION, 4)
    path, out = write(tmp_path, t=TIME, x=slow, u=FORCE), tmp_path / "o.csv"
    report = convert(path, out, maps=MAPS, fill=fill)
    frame, own = log_of(out), np.arange(0, ROWS, 4)
    with out.open("rb") as file:
        said = measured_period(comments_in(file))
    if fill == "hold":
        assert frame["position_m"].tolist() == pd.Series(slow).ffill().tolist()
        assert said is None
        return
    # No value lies beyond the last sample, and nothing is made up there.
    assert len(frame) == own[-1] + 1
    assert "3 rows omitted, in which x has no value" in told(report)
    assert frame["position_m"][own].tolist() == POSITION[own].tolist()
    np.testing.assert_allclose(
        frame["position_m"], np.interp(TIME[: own[-1] + 1], TIME[own], POSITION[own]), rtol=1e-12
    )
    assert said == pytest.approx(0.004)


def test_rows_before_the_first_sample_are_left_out(tmp_path: Path) -> None:
    path = write(tmp_path, t=TIME, x=POSITION, u=every(FORCE, 5, first=3))
    report = convert(path, tmp_path / "o.csv", maps=MAPS)
    frame = log_of(tmp_path / "o.csv")
    assert frame["time_s"].iloc[0] == TIME[3]
    assert "3 rows omitted, in which u has no value" in told(report)
    assert "from line 2" in told(report)


def test_a_command_ends_after_its_longest_step(tmp_path: Path) -> None:
    slow = every(FORCE, 5)
    slow[31:] = np.nan
    convert(write(tmp_path, t=TIME, x=POSITION, u=slow), tmp_path / "o.csv", maps=MAPS)
    assert log_of(tmp_path / "o.csv")["time_s"].iloc[-1] == TIME[34]


def test_rows_in_a_pause_of_a_measurement_are_left_out(tmp_path: Path) -> None:
    slow = every(POSITION, 2)
    slow[11:41] = np.nan
    convert(write(tmp_path, t=TIME, x=slow, u=FORCE), tmp_path / "o.csv", maps=MAPS)
    time = log_of(tmp_path / "o.csv")["time_s"].to_numpy()
    assert not np.any((time > TIME[10]) & (time < TIME[42]))
    assert {TIME[10], TIME[42]} <= set(time)


def test_two_clocks_merged_by_time(tmp_path: Path) -> None:
    """Rows of either clock, as an outer join writes them: each column is even on its own rows."""
    other = np.round(TIME[::2] + 0.0003, 6)
    force = pd.DataFrame({"t": other, "u": FORCE[::2]})
    both = pd.merge(pd.DataFrame({"t": TIME, "x": POSITION}), force, on="t", how="outer")
    report = convert(
        write(tmp_path, **both.sort_values("t").to_dict("list")), tmp_path / "o.csv", maps=MAPS
    )
    frame = log_of(tmp_path / "o.csv").set_index("time_s")
    assert frame["position_m"][TIME[7]] == POSITION[7]
    assert frame["motor_force_n"][TIME[7]] == FORCE[6]
    assert "x is empty in 33 % of the rows, linear" in told(report)


def test_fill_in_a_recipe_and_on_the_command_line(tmp_path: Path) -> None:
    path = write(tmp_path, t=TIME, x=every(POSITION, 4), u=FORCE)
    spec, out = tmp_path / "lab.toml", tmp_path / "o.csv"
    spec.write_text('[options]\nfill = "hold"\n')
    convert(path, out, maps=MAPS, spec_file=spec)
    assert len(log_of(out)) == ROWS
    convert(path, out, maps=MAPS, spec_file=spec, fill="linear")
    assert len(log_of(out)) == ROWS - 3
    with pytest.raises(InputError, match="--fill: fill = 'cubic' is not known; write hold or"):
        convert(path, out, maps=MAPS, fill="cubic")
    spec.write_text('[options]\nfill = "cubic"\n')
    with pytest.raises(InputError, match=r"\[options\]: fill = 'cubic'"):
        convert(path, out, maps=MAPS, spec_file=spec)


def test_a_single_empty_cell_is_damage_unless_it_is_to_be_filled(tmp_path: Path) -> None:
    hole = POSITION.copy()
    hole[20] = np.nan
    path = write(tmp_path, t=TIME, x=hole, u=FORCE)
    with pytest.raises(InputError, match=r"line 22: column x \(for position_m\) is empty"):
        convert(path, tmp_path / "o.csv", maps=MAPS)
    report = convert(path, tmp_path / "o.csv", maps=MAPS, fill="linear")
    assert "x is empty in 2 % of the rows, linear" in told(report)


def test_a_slow_sample_that_is_lost_is_told(tmp_path: Path) -> None:
    slow = every(FORCE, 5)
    slow[20] = np.nan
    report = convert(write(tmp_path, t=TIME, x=POSITION, u=slow), tmp_path / "o.csv", maps=MAPS)
    assert "(every 0.005 s, once 0.01 s: none in line 22)" in told(report)


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ([np.nan] * ROWS, "column u .* is empty in every row; map another"),
        ([3.0] + [np.nan] * (ROWS - 1), "holds a single value, 3.0; .*--set motor_force_n=VALUE"),
        (
            [*FORCE[:30], *[np.nan] * 30],
            r"line 32: column u .* has values in rows 0 to 29 only.*--rows 0:30",
        ),
        ([*FORCE[:20], *[np.nan] * 20, *FORCE[40:]], "line 22: column u .* is empty"),
    ],
)
def test_columns_that_cannot_be_filled(tmp_path: Path, values: Sequence[float], what: str) -> None:
    path = write(tmp_path, t=TIME, x=POSITION, u=values)
    with pytest.raises(InputError, match=what):
        convert(path, tmp_path / "o.csv", maps=MAPS)


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("0.007,0,0520794,", "line 9: 4 fields where the other lines have 3"),
        ("0.007,7,0.0520794,", "line 9: 4 fields where the other lines have 3"),
        ("0.007,0.0520794", "line 9: the row ends early: 2 of 3 fields"),
        ("0.007,,", "line 9: column x .* is empty"),
        ("0.001,0.0520794,", None),
    ],
)
def test_damage_amid_cells_that_are_empty(tmp_path: Path, line: str, what: str | None) -> None:
    path = write(tmp_path, t=TIME, x=POSITION, u=every(FORCE, 5))
    lines = path.read_text().splitlines()
    lines[8] = line
    path.write_text("\n".join([*lines, ""]))
    if what is not None:
        with pytest.raises(InputError, match=what):
            convert(path, tmp_path / "o.csv", maps=MAPS)
        return
    report = convert(path, tmp_path / "o.csv", maps=MAPS)
    assert "line 9: time_s goes back from 0.006 to 0.001" in told(report)


def test_rows_that_end_with_their_last_value(tmp_path: Path) -> None:
    rows = [f"{t},{x}" + (f",{u}" if i % 5 == 0 else "") for i, (t, x, u) in enumerate(ALL)]
    (tmp_path / "rec.csv").write_text("\n".join(["t,x,u", *rows, ""]))
    convert(tmp_path / "rec.csv", tmp_path / "o.csv", maps=MAPS)
    held = pd.Series(every(FORCE, 5)).ffill().tolist()
    assert log_of(tmp_path / "o.csv")["motor_force_n"].tolist() == held


@pytest.mark.parametrize("end", ["\n", ""])
def test_rows_that_end_early_at_several_rates(tmp_path: Path, end: str) -> None:
    rows = [
        f"{t},{x}" + (f",{u}" if i % 5 == 0 else "") + (",293.5" if i % 10 == 0 else "")
        for i, (t, x, u) in enumerate(ALL)
    ]
    (tmp_path / "rec.csv").write_text("\n".join(["t,x,u,T", *rows]) + end)
    convert(tmp_path / "rec.csv", tmp_path / "o.csv", maps=[*MAPS, "temperature_k=T"])
    log = log_of(tmp_path / "o.csv")
    held = pd.Series(every(FORCE, 5)).ffill()
    assert log["motor_force_n"].tolist() == held[: len(log)].tolist()
    assert log["temperature_k"].tolist() == [293.5] * len(log)
    assert len(log) > 0.8 * ROWS


@pytest.mark.parametrize("sign", ["-", "---"])
def test_dashes_are_empty_cells(tmp_path: Path, sign: str) -> None:
    rows = [f"{t},{x},{u if i % 5 == 0 else sign}" for i, (t, x, u) in enumerate(ALL)]
    (tmp_path / "rec.csv").write_text("\n".join(["t,x,u", *rows, ""]))
    convert(tmp_path / "rec.csv", tmp_path / "o.csv", maps=MAPS)
    held = pd.Series(every(FORCE, 5)).ffill().tolist()
    assert log_of(tmp_path / "o.csv")["motor_force_n"].tolist() == held


def test_what_shows_a_rate_of_its_own() -> None:
    time = np.arange(100.0)
    assert has_own_rate(np.arange(0, 100, 7), time, held=False)
    assert not has_own_rate(np.delete(np.arange(100), 50), time, held=False)
    assert not has_own_rate(np.r_[0:20, 60:100], time, held=False)
    assert not has_own_rate(np.array([0, 50]), time, held=False)
    assert has_own_rate(np.array([0, 50]), time, held=True)


# --- channels with clocks of their own -------------------------------------------------


def clocked(fast: np.ndarray, slow: np.ndarray) -> ForeignTable:
    table = ForeignTable(Path("rec.mf4"), "MDF")
    table.columns |= {"x": np.sin(fast), "u": np.cos(slow), "p": np.cos(slow) + 2.0}
    table.clocks |= {"x": fast, "u": slow, "p": slow}
    return table


def columns_of(table: ForeignTable, *maps: str, fill: str | None = None) -> pd.DataFrame:
    return log_columns(table, Recipe(maps=parse_map(maps), fill=fill), None)


def test_the_fastest_measurement_gives_the_rows() -> None:
    fast, slow = np.arange(101) / 100.0, np.arange(0.0, 1.0, 0.07)
    table = clocked(fast, slow)
    frame = columns_of(table, "position_m=x", "motor_force_n=u", "pressure_a_pa=p")
    assert frame["time_s"].tolist() == [t for t in fast if t <= slow[-1] + 1e-12]
    rows = np.searchsorted(slow, frame["time_s"] + 1e-9, side="right") - 1
    assert frame["motor_force_n"].tolist() == np.cos(slow)[rows].tolist()
    np.testing.assert_allclose(
        frame["pressure_a_pa"], np.interp(frame["time_s"], slow, np.cos(slow) + 2.0), rtol=1e-12
    )
    assert any("rows are the samples of x: u held" in notice for notice in table.notices)
    assert any("rows every 0.07 s" in line for line in table.shape)


def test_a_mapped_time_gives_the_rows() -> None:
    fast, slow = np.arange(101) / 100.0, np.arange(0.0, 1.0, 0.07)
    table = clocked(fast, slow)
    table.columns["stamp"] = 100.0 + slow
    table.clocks["stamp"] = slow
    frame = columns_of(table, "time_s=stamp", "position_m=x", "motor_force_n=u")
    assert frame["time_s"].tolist() == (100.0 + slow).tolist()
    np.testing.assert_allclose(frame["position_m"], np.interp(slow, fast, np.sin(fast)), rtol=1e-12)


def test_channels_of_one_clock_stay_as_they_are() -> None:
    clock = np.sort(np.random.default_rng(7).uniform(0.0, 1.0, 50))
    table = clocked(clock, clock)
    frame = columns_of(table, "position_m=x", "motor_force_n=u")
    assert frame["time_s"].tolist() == clock.tolist()
    assert frame["motor_force_n"].tolist() == np.cos(clock).tolist()
    assert not table.shape


def test_channels_that_share_no_time_are_refused() -> None:
    table = clocked(np.arange(10.0), np.arange(100.0, 110.0))
    with pytest.raises(InputError, match="no row in which every mapped column has a value"):
        columns_of(table, "position_m=x", "motor_force_n=u")
    table = clocked(np.arange(10.0), np.array([0.0, 2.0, 1.0]))
    with pytest.raises(InputError, match=r"row 3: the times of u .* go from 2 to 1 s"):
        columns_of(table, "position_m=x", "motor_force_n=u")
    del table.clocks["u"]
    with pytest.raises(InputError, match=r"u .* has no times of its own"):
        columns_of(table, "position_m=x", "motor_force_n=u")
