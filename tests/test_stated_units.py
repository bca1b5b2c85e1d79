"""The unit that a file states for a column, beside what a map says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign_files import log_of

from sysid.io.conversion import convert
from sysid.io.foreign import ForeignTable
from sysid.io.foreign.recipe import Recipe
from sysid.io.foreign_columns import log_columns
from sysid.io.units import parse_map


def read(
    maps: list[str], units: dict[str, str], names: dict[str, str] | None = None
) -> tuple[Any, list[str]]:
    """A small file's log columns, and the notices; `names` of its columns other than these."""
    named = {name: name for name in ("t", "P", "u")} | (names or {})
    columns = {"t": [0.0, 1000.0], "P": [1.0, 4.0], "u": [0.0, 50.0]}
    table = ForeignTable(Path("rec.mf4"), "a format that states units")
    for name, values in columns.items():
        table.columns[named[name]] = np.array(values)
    table.units.update(units)
    frame = log_columns(table, Recipe(parse_map(maps), atmosphere_pa=1e5), None)
    return frame, table.notices


def test_a_map_without_a_unit_takes_that_of_the_file() -> None:
    units = {"t": "ms", "P": "bar", "u": "%"}
    frame, notices = read(["time_s=t", "pressure_a_pa=P", "duty_a=u"], units)
    assert frame["time_s"].tolist() == [0.0, 1.0]
    assert frame["pressure_a_pa"].tolist() == [1e5, 4e5]
    assert frame["duty_a"].tolist() == [0.0, 0.5]
    assert "rec.mf4: P (for pressure_a_pa) is in bar, absolute, as the file states" in notices
    assert len(notices) == 3


def test_a_column_named_as_in_the_log_format_too() -> None:
    names = {"t": "time_s", "P": "pressure_a_pa", "u": "theta_rad"}
    frame, notices = read([], {"pressure_a_pa": "bar(g)", "theta_rad": "deg", "time_s": "s"}, names)
    assert frame["pressure_a_pa"].tolist() == [2e5, 5e5]
    assert frame["theta_rad"].tolist() == [0.0, pytest.approx(np.deg2rad(50.0))]
    assert frame["time_s"].tolist() == [0.0, 1000.0] and len(notices) == 2


@pytest.mark.parametrize("unit", ["", "-", "[-]", "Pa", "[Pa]", "none"])
def test_si_or_no_unit_needs_no_word(unit: str) -> None:
    frame, notices = read(["time_s=t:ms", "pressure_a_pa=P"], {"P": unit})
    assert frame["pressure_a_pa"].tolist() == [1.0, 4.0] and not notices


@pytest.mark.parametrize(
    ("entry", "unit"),
    [("P:kPa", "bar"), ("P:bar", "V"), ("P:bar", "bar(g)"), ("P:2 bar", "kPa")],
)
def test_a_map_that_contradicts_the_file_is_said(entry: str, unit: str) -> None:
    _, notices = read(["time_s=t:ms", f"pressure_a_pa={entry}"], {"P": unit})
    (line,) = notices
    assert f"P is in {unit!r} by the file, mapped as {entry[2:]!r}: the map is used" in line


@pytest.mark.parametrize(
    ("entry", "unit"),
    [
        ("P:bar", "bar"),
        ("P:100 kPa", "bar"),
        ("P:bar(g)", "bar"),  # says more than the file
        ("P:-1 bar", "bar"),
        ("P:25 psi(g)", "count"),  # a raw reading's worth
        ("P:0.5..4.5 -> 0..100 psi(g)", "V"),
        ("P:0.5..4.5 V -> 0..100 psi(g)", "V"),
        ("P:bar", "engineering"),
    ],
)
def test_a_map_that_agrees_or_says_more_is_not(entry: str, unit: str) -> None:
    assert not read(["time_s=t:ms", f"pressure_a_pa={entry}"], {"P": unit})[1]


def test_readings_in_another_unit_than_the_range_s_are_converted() -> None:
    maps = ["time_s=t:ms", "pressure_a_pa=P:0.5..4.5 mV -> 0..4 bar"]
    frame, notices = read(maps, {"P": "V"})
    assert frame["pressure_a_pa"].tolist() == pytest.approx([999.5e5, 3999.5e5])
    assert "P is in V by the file, its range in mV: converted" in notices[0]
    assert "outside the sensor's range of 0.0005 to 0.0045 V" in notices[1]
    _, notices = read(["time_s=t:ms", "pressure_a_pa=P:0.5..4.5 V -> 0..4 bar"], {"P": "degC"})
    assert "P is in 'degC' by the file, mapped from 'V': the map is used" in notices[0]


@pytest.mark.parametrize(
    ("entry", "unit", "taken", "given"),
    [
        ("pressure_a_pa=P", "V", "taken as Pa", "0.5..4.5 -> 0..100 Pa"),
        ("pressure_a_pa=P", "foo", "taken as Pa", "0.5..4.5 -> 0..100 Pa"),
        ("duty_a=u", "V", "taken as it stands", "0..24 -> 0..1"),
        ("flow_a_kg_s=u", "l/min", "taken as kg/s", "l/min(ANR)"),
        ("motor_force_n=u", "g", "taken as N", "gf"),
        ("temperature_k=u", "C", "taken as K", "degC"),
        ("velocity_m_per_s=u", "c", "taken as m/s", "0.5..4.5 -> 0..100 m/s"),
    ],
)
def test_a_map_without_a_unit_is_si_where_the_file_s_is_another_s(
    entry: str, unit: str, taken: str, given: str
) -> None:
    """As the log format says; with a notice, for the map may have forgotten it."""
    target, _, column = entry.partition("=")
    frame, notices = read(["time_s=t:ms", entry], {column: unit})
    assert frame[target].tolist() == {"P": [1.0, 4.0], "u": [0.0, 50.0]}[column]
    (line,) = notices
    assert line.startswith(f"rec.mf4: {column} (for {target}) is in {unit!r} by the file; {taken}")
    assert f'--map "{target}={column}:{given}"' in line


@pytest.mark.parametrize(("unit", "worth"), [("KPA", 1e3), ("MBAR", 100.0), ("PSI", 6894.757293)])
def test_capitals_of_a_heading(unit: str, worth: float) -> None:
    frame, _ = read(["time_s=t:ms", "pressure_a_pa=P"], {"P": unit})
    assert frame["pressure_a_pa"].tolist() == pytest.approx([worth, 4 * worth])


@pytest.mark.parametrize(
    ("name", "target", "worth"),
    [
        ("arm_nm", "motor_torque_nm", 1.0),
        ("arm_mnm", "motor_torque_nm", 1e-3),
        ("arm_kpa", "pressure_a_pa", 1e3),
        ("cylinder_mm", "pressure_a_pa", 1.0),
        ("cylinder_ms", "position_m", 1.0),
    ],
)
def test_the_end_of_a_name_is_a_unit_only_of_its_target_s_quantity(
    tmp_path: Path, name: str, target: str, worth: float
) -> None:
    (tmp_path / "a.csv").write_text(f"t,{name}\n" + "".join(f"{i},{2 * i}\n" for i in range(30)))
    report = convert(tmp_path / "a.csv", tmp_path / "b.csv", maps=["time_s=t", f"{target}={name}"])
    values = log_of(tmp_path / "b.csv")[target]
    assert values.tolist() == pytest.approx((2 * worth * np.arange(30)).tolist())
    assert any("as the file states" in line for line in report.notices) == (worth != 1.0)


@pytest.mark.parametrize(
    ("name", "target", "worth"),
    [
        ("Friction [uN]", "motor_force_n", 1e-6),
        ("pull (daN)", "motor_force_n", 10.0),
        ("P1 [kgf/cm2]", "pressure_a_pa", 98066.5),
        ("speed [in/s]", "velocity_m_per_s", 0.0254),
        ("Friction [uN]", "position_m", 1.0),
        ("pull (raw)", "motor_force_n", 1.0),
    ],
)
def test_a_unit_in_brackets_is_any_that_can_be_read_as_one(
    tmp_path: Path, name: str, target: str, worth: float
) -> None:
    (tmp_path / "a.csv").write_text(f"t,{name}\n" + "".join(f"{i},{2 * i}\n" for i in range(30)))
    report = convert(tmp_path / "a.csv", tmp_path / "b.csv", maps=["time_s=t", f"{target}=#2"])
    values = log_of(tmp_path / "b.csv")[target]
    assert values.tolist() == pytest.approx((2 * worth * np.arange(30)).tolist())
    assert any("as the file states" in line for line in report.notices) == (worth != 1.0)


def test_names_of_the_log_format_are_si(tmp_path: Path) -> None:
    head, row = "time_s,motor_torque_nm,pressure_a_pa [kPa],encoder_counts\n", "{0},{0},{0},{0}\n"
    (tmp_path / "a.csv").write_text(head + "".join(row.format(i) for i in range(30)))
    report = convert(tmp_path / "a.csv", tmp_path / "b.csv", maps=["pressure_a_pa=#3"])
    log = log_of(tmp_path / "b.csv")
    assert log["motor_torque_nm"].tolist() == log["time_s"].tolist() == list(range(30))
    assert log["pressure_a_pa"].tolist() == [1e3 * i for i in range(30)]
    assert not any("torque" in line for line in report.notices)
    report = convert(
        tmp_path / "a.csv", tmp_path / "b.csv", maps=["motor_torque_nm=motor_torque_nm:mNm"]
    )
    assert any("motor_torque_nm is in 'Nm' by the file" in line for line in report.notices)


def test_a_label_needs_no_unit() -> None:
    frame, notices = read(["time_s=t:ms", "pressure_a_pa=P:bar", "test=u"], {"u": "1/min"})
    assert frame["test"].tolist() == ["0", "50"] and not notices
