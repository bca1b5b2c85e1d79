"""Files as people write them, from ../shared/cases: rows, headings and times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from foreign_files import log_of

from sysid.commands.app import main
from sysid.io.conversion import ConversionReport, convert

CASES = Path(__file__).resolve().parent.parent.parent / "shared" / "cases"

pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is absent")


def read(
    tmp_path: Path, case: str, *maps: str, period_s: float | None = None, skip_rows: int = 0
) -> tuple[pd.DataFrame, ConversionReport]:
    out = tmp_path / "log.csv"
    report = convert(CASES / case, out, maps=maps, period_s=period_s, skip_rows=skip_rows)
    return log_of(out), report


def test_a_repeated_heading_starts_a_test(tmp_path: Path) -> None:
    frame, report = read(tmp_path, "repeated_header/raw.csv", "time_s=time", "pressure_a_pa=p:bar")
    assert report.tests == ("1", "2")
    assert frame["pressure_a_pa"].tolist() == [1e5, 2e5, 3e5, 1e5, 2e5, 4e5]
    assert any("starts again in line 6: 2 tests" in notice for notice in report.notices)
    frame, report = read(
        tmp_path, "repeated_header/arduino.txt", "time_s=time", "pressure_a_pa=P_D1:kPa"
    )
    assert report.tests == ("1", "2")
    assert frame["time_s"].tolist() == [0.0, 0.7, 1.1, 0.0, 0.7]
    assert any("line 7 passed over" in notice for notice in report.notices)


def test_a_counter_that_wraps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    maps = ["time_s=micros:us", "position_m=x:m", "motor_force_n=F:N"]
    frame, report = read(tmp_path, "counter_wrap/raw.csv", *maps)
    np.testing.assert_allclose(np.diff(frame["time_s"]), 0.002, rtol=1e-8)
    assert any("32-bit counter" in notice for notice in report.notices)
    rig = CASES / "counter_wrap" / "rig.toml"
    given = [word for entry in maps for word in ("--map", entry)]
    raw = str(CASES / "counter_wrap" / "raw.csv")
    assert main(["check", raw, "--rig", str(rig), *given]) == 2
    line = capsys.readouterr().err
    assert "a 32-bit counter of microseconds wrapped; `sysid convert raw.csv" in line
    assert "sort" not in line


@pytest.mark.parametrize("name", ["multirate.csv", "multirate_mid.csv"])
def test_a_slower_column_is_held(tmp_path: Path, name: str) -> None:
    maps = ("time_s=t", "position_m=pos:mm", "motor_force_n=u")
    frame, report = read(tmp_path, f"empty_last_column/{name}", *maps)
    raw = pd.read_csv(CASES / "empty_last_column" / name)
    assert len(frame) == len(raw)
    assert frame["motor_force_n"].tolist() == raw["u"].ffill().tolist()
    assert any("u is empty in 80 % of the rows, held" in notice for notice in report.notices)


def test_labview_with_a_heading_for_comments(tmp_path: Path) -> None:
    case, maps = "lvm_comment_heading/standard.lvm", ("position_m=pos:mm", "motor_force_n=force")
    for how in ({}, {"skip_rows": 22, "period_s": 0.002}):
        frame, _ = read(tmp_path, case, *maps, **how)
        np.testing.assert_allclose(frame["time_s"], 0.002 * np.arange(6), rtol=1e-15)
        assert frame["motor_force_n"].tolist() == [10.5, 10.6, 10.7, 10.8, 10.9, 11.0]


@pytest.mark.parametrize(
    ("name", "skipped", "names"),
    [
        ("tek_new.csv", 18, ("TIME", "CH1", "CH2")),
        ("siglent.csv", 11, ("Second", "CH1", "CH2")),
        ("siemens.csv", 3, ("Time:ms", "Achse_1.ActualPosition", "Achse_1.Torque")),
    ],
)
def test_preambles_with_the_tables_separator(
    tmp_path: Path, name: str, skipped: int, names: tuple[str, str, str]
) -> None:
    case, time = f"preamble_same_separator/{name}", names[0]
    found, _ = read(
        tmp_path, case, f"time_s={time}", f"position_m={names[1]}:mm", f"motor_force_n={names[2]}"
    )
    unit = time.partition(":")[1:]
    by_number = (f"time_s=#1{''.join(unit)}", "position_m=#2:mm", "motor_force_n=#3")
    for how in ({}, {"skip_rows": skipped}):
        frame, _ = read(tmp_path, case, *by_number, **how)
        assert frame.equals(found)
    decimal = "," if name == "siemens.csv" else "."
    lines = (CASES / case).read_text().splitlines()
    last = lines[-1].replace(";", " ").replace(",", decimal if decimal == "," else " ").split()
    assert found["motor_force_n"].iloc[-1] == float(last[-1].replace(",", "."))
    assert len(found) == 50
