"""A time that goes back: counters that wrap, recordings that start again, rows out of order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from foreign_files import log_of, plain, refused

from sysid.commands.app import main
from sysid.io.conversion import convert
from sysid.io.time_breaks import time_breaks, wraps_of, wraps_of_seconds

MAPS = ("time_s=t:us", "theta_rad=q")
STEPS = np.arange(80)


def recorded(folder: Path, *parts: np.ndarray, **more: np.ndarray) -> Path:
    time = np.concatenate(parts)
    return plain(folder, t=time, q=np.arange(len(time)) / 7.0, **more)


@pytest.mark.parametrize("bits", [15, 16, 20, 24, 31, 32, 48])
@pytest.mark.parametrize("signed", [False, True])
def test_a_counter_is_unwrapped(tmp_path: Path, bits: int, signed: bool) -> None:
    size = 1 << bits
    true = size - 20 * 997 + 997 * STEPS
    counts = true % size - (size // 2 if signed else 0)
    report = convert(recorded(tmp_path, counts), tmp_path / "o.csv", maps=MAPS)
    time = log_of(tmp_path / "o.csv")["time_s"].to_numpy()
    np.testing.assert_allclose(np.diff(time), 997e-6, rtol=1e-6, atol=1e-21 * size)
    assert any(f"a {bits}-bit counter, {size}) in line 22" in n for n in report.notices)
    assert report.tests == ()


@pytest.mark.parametrize(("size", "step"), [(2.0**12, 20.0), (2.0**20, 1000.0)])
def test_a_counter_that_began_near_nothing(size: float, step: float) -> None:
    true = 3.0 + step * np.arange(5 * size // step)
    wraps = wraps_of(true % size)
    assert wraps is not None
    np.testing.assert_array_equal(np.diff(wraps.unwrapped(true % size)), step)
    # Recordings that end where the counter would, and start again where the first one did.
    assert wraps_of(np.tile(3.0 + step * np.arange(size // step), 3)) is None


def test_a_counter_wraps_more_than_once(tmp_path: Path) -> None:
    counts = (60_000 + 9_000 * STEPS) % 65536
    convert(recorded(tmp_path, counts), tmp_path / "o.csv", maps=("time_s=t:ms", "theta_rad=q"))
    np.testing.assert_allclose(np.diff(log_of(tmp_path / "o.csv")["time_s"]), 9.0, rtol=1e-12)


def test_the_time_of_day_over_midnight_in_seconds(tmp_path: Path) -> None:
    time = np.round((86_398.0 + 0.05 * STEPS) % 86_400.0, 3)
    path = recorded(tmp_path, time)
    report = convert(path, tmp_path / "o.csv", maps=("time_s=t", "theta_rad=q"))
    np.testing.assert_allclose(np.diff(log_of(tmp_path / "o.csv")["time_s"]), 0.05, rtol=1e-6)
    assert any("the time of day" in notice for notice in report.notices)


@pytest.mark.parametrize("whole", [1.0, 60.0, 3600.0, 43_200.0, 604_800.0])
def test_a_part_of_a_clock_wraps_and_recordings_of_its_length_do_not(whole: float) -> None:
    step = whole / 50.0
    wraps = wraps_of_seconds((whole - 9.5 * step + step * STEPS) % whole)
    assert wraps is not None
    assert wraps.rows.tolist() == [10, 60]
    again = np.tile(step * np.arange(50), 2)
    assert wraps_of_seconds(again) is None


def test_seconds_that_were_a_counter(tmp_path: Path) -> None:
    true = (1 << 32) - 20_000 + 1000 * STEPS
    convert(
        recorded(tmp_path, (true % (1 << 32)) / 1e6),
        tmp_path / "o.csv",
        maps=("time_s=t", "theta_rad=q"),
    )
    np.testing.assert_allclose(np.diff(log_of(tmp_path / "o.csv")["time_s"]), 1e-3, rtol=1e-6)


def test_what_is_no_wrap() -> None:
    again = np.r_[0:50, 0:50].astype(float)
    assert wraps_of(again) is None
    assert wraps_of_seconds(again / 1000.0) is None
    assert wraps_of(np.tile(np.arange(1024.0), 2)) is None  # two blocks of samples
    # One wrong value near nothing amid values near the counter's size.
    wrong = 2.0**32 - 1000.0 * np.arange(50, 0, -1)
    wrong[25] = 3.0
    assert wraps_of(wrong) is None
    assert wraps_of(np.arange(50.0)) is None


def test_a_time_that_starts_again_is_a_new_test(tmp_path: Path) -> None:
    first, second = 1000 * STEPS, 5000 + 1000 * STEPS[:30]
    report = convert(recorded(tmp_path, first, second), tmp_path / "o.csv", maps=MAPS)
    assert report.tests == ("1", "2")
    assert any("time starts again in line 82: 2 tests" in notice for notice in report.notices)
    assert log_of(tmp_path / "o.csv").groupby("test").size().tolist() == [80, 30]


def test_labels_that_the_file_has_are_kept(tmp_path: Path) -> None:
    names = np.repeat(["up", "down"], 80)
    path = recorded(tmp_path, 1000 * STEPS, 1000 * STEPS, test=names)
    report = convert(path, tmp_path / "o.csv", maps=MAPS)
    assert report.tests == ("up", "down")
    assert not any("again" in notice for notice in report.notices)


def test_tests_of_what_the_user_calls_them(tmp_path: Path) -> None:
    path = recorded(tmp_path, 1000 * STEPS, 1000 * STEPS)
    report = convert(path, tmp_path / "o.csv", maps=MAPS, constants=["test=up"])
    assert report.tests == ("up/1", "up/2")
    (tmp_path / "b.csv").write_bytes(path.read_bytes())
    report = convert([path, tmp_path / "b.csv"], tmp_path / "o.csv", maps=MAPS)
    assert report.tests == ("rec/1", "rec/2", "b/1", "b/2")


def test_a_cell_that_is_missing_where_a_test_begins(tmp_path: Path) -> None:
    text = "t,q\n" + "".join(f"{i},{i}.5\n" for i in range(20))
    (tmp_path / "rec.csv").write_text(text + text.replace("0,0.5", "0,"))
    refused(
        tmp_path / "rec.csv",
        tmp_path / "o.csv",
        "line 23: column q .* is empty",
        maps=["time_s=t", "theta_rad=q"],
    )


@pytest.mark.parametrize("sep", [",", ";", " ", "\t"])
@pytest.mark.parametrize("date", ["02 13 20 12:13:20", "2024-05-06 14:22:10", "06.05.2024"])
def test_dates_beside_headings(tmp_path: Path, sep: str, date: str) -> None:
    rows = "".join(f"{i}.0{sep}{i}.5{sep}0.1\n" for i in range(20))
    heading = sep.join("tqu") + "\n"
    for block in (heading + f"{date}\n" + rows, f"{date}\n" + heading + rows):
        (tmp_path / "rec.txt").write_text(2 * block)
        report = convert(tmp_path / "rec.txt", tmp_path / "o.csv", maps=["time_s=t", "theta_rad=q"])
        assert report.tests == ("1", "2")
        assert log_of(tmp_path / "o.csv").groupby("test").size().tolist() == [20, 20]


def test_a_heading_with_a_single_row_is_no_test(tmp_path: Path) -> None:
    (tmp_path / "rec.csv").write_text("t,q\n0,1\n1,2\nt,q\nt,q\n0,5\nt,q\n0,3\n1,4\n")
    report = convert(tmp_path / "rec.csv", tmp_path / "o.csv", maps=["time_s=t", "theta_rad=q"])
    assert log_of(tmp_path / "o.csv")["theta_rad"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert any("1 test of a single row omitted (in line 6)" in n for n in report.notices)


@pytest.mark.parametrize(
    ("time", "starts", "disordered"),
    [
        ([0, 1, 2, 0, 1, 2], [3], None),
        ([0, 1, 3, 2, 4, 5], [], 3),
        ([0, 1, 4, 5, 2, 3, 6], [], 4),
        ([0, 1, 2, 3, 0, 5, 6], [], 4),
        ([5, 6, 7, 8, 0, 1, 2, 3], [4], None),
        ([0, 1, 2, 3, 4, 5, 1.5, 2.5, 3.5, 4.5, 5.5], [6], None),
        ([0, 1, 1, 2, 3], [], None),
    ],
)
def test_recordings_and_rows_out_of_order(
    time: list[float], starts: list[int], disordered: int | None
) -> None:
    found = time_breaks(np.array(time, dtype=float))
    assert (found.starts.tolist(), found.disordered) == (starts, disordered)


def test_rows_out_of_order_are_no_test(tmp_path: Path) -> None:
    time = 1000 * STEPS
    time[[20, 21]] = time[[21, 20]]
    report = convert(recorded(tmp_path, time), tmp_path / "o.csv", maps=MAPS)
    assert report.tests == ()
    assert any("line 23: time_s goes back" in n and "out of order" in n for n in report.notices)


# --- the strict reader names the cause -------------------------------------------------

CAUSES = {
    "wrap": ("a 32-bit counter of microseconds wrapped", "unwraps it"),
    "restart": ("the recording starts again there", "numbers the tests in a column `test`"),
    "disorder": ("out of order", "sort the rows by time"),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_the_cause_that_the_data_show(
    tmp_path: Path, rig_text: str, cause: str, capsys: pytest.CaptureFixture[str]
) -> None:
    time = STEPS / 1000.0
    if cause == "wrap":
        time = ((1 << 32) - 20_000 + 1000 * STEPS) % (1 << 32) / 1e6
    elif cause == "restart":
        time = np.r_[time[:40], time[:40]]
    else:
        time[[20, 21]] = time[[21, 20]]
    (tmp_path / "rig.toml").write_text(rig_text)
    log = tmp_path / "run.csv"
    table = pd.DataFrame({"time_s": time, "theta_rad": np.sin(STEPS / 9.0), "motor_torque_nm": 0.1})
    table.to_csv(log, index=False)
    assert main(["check", str(log)]) == 2
    line = capsys.readouterr().err
    assert all(words in line for words in CAUSES[cause])
    assert ("sort" in line) == (cause == "disorder")
    if cause == "disorder":
        return
    assert "sysid convert run.csv -o run_2.csv" in line
    assert main(["convert", str(log), "-o", str(tmp_path / "run_2.csv")]) == 0
    assert main(["check", str(tmp_path / "run_2.csv")]) == 0


def test_an_empty_column_is_absent(
    tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    time = np.tile(STEPS / 1000.0, 2)
    table = pd.DataFrame({"time_s": time, "test": np.repeat(["a", "b"], len(STEPS))})
    table["theta_rad"] = 0.1 * np.sin(np.arange(len(time)) / 9.0)
    table["motor_torque_nm"] = 0.1
    table["pressure_a_pa"] = np.where(table["test"] == "a", 1e5, np.nan)
    table["temperature_k"] = np.nan
    table.to_csv(tmp_path / "run.csv", index=False)
    assert main(["check", str(tmp_path / "run.csv")]) == 0
    said = " ".join("".join(capsys.readouterr()).split())
    assert "temperature_k is empty: taken as absent" in said
    assert "pressure_a_pa is empty in test b: taken as absent" in said
    table.loc[3, "pressure_a_pa"] = np.nan
    table.to_csv(tmp_path / "run.csv", index=False)
    assert main(["check", str(tmp_path / "run.csv")]) == 2
    assert "line 5: pressure_a_pa is empty" in capsys.readouterr().err
