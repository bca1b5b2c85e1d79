"""The log reader: every dialect of the contract ends in the same samples."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sysid.errors import InputError
from sysid.io.logs import Log, read_log
from sysid.io.rig import Rig, read_rig, rig_from_content
from sysid.io.units import parse_map

COUNTS = 80000


@pytest.fixture
def rig(tmp_path: Path, rig_text: str) -> Rig:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text)
    return read_rig(path)


@pytest.fixture
def frame() -> pd.DataFrame:
    rng = np.random.default_rng(3)
    rows = 400
    return pd.DataFrame(
        {
            "time_s": np.arange(rows) * 1e-3,
            "pressure_a_pa": 1e5 + 26.0 * rng.integers(-9, 10, rows),
            "pressure_b_pa": 1.2e5 + 26.0 * rng.integers(-9, 10, rows),
            "theta_rad": np.round(0.3 * np.sin(np.arange(rows) / 60) * COUNTS / (2 * math.pi))
            * (2 * math.pi / COUNTS),
            "motor_torque_nm": 0.4 * np.sin(np.arange(rows) / 50),
        }
    )


def read(frame: pd.DataFrame, rig: Rig, folder: Path, *maps: str, name: str = "run.csv") -> Log:
    path = folder / name
    if path.suffix == ".parquet":
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False)
    return read_log(path, rig, parse_map(maps))


def assert_same(log: Log, frame: pd.DataFrame, *names: str) -> None:
    (trial,) = log.trials
    for name in names or ("pressure_a_pa", "pressure_b_pa", "theta_rad", "motor_torque_nm"):
        np.testing.assert_allclose(trial[name], frame[name], rtol=1e-9, atol=1e-9)


def test_csv_and_parquet_agree(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    assert_same(read(frame, rig, tmp_path), frame)
    assert_same(read(frame, rig, tmp_path, name="run.parquet"), frame)


def test_parquet_of_an_index_and_of_durations(
    frame: pd.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    """A data frame with time as its index, and times as pandas keeps them."""
    assert_same(read(frame.set_index("time_s"), rig, tmp_path, name="i.parquet"), frame)
    spans = pd.to_timedelta(frame["time_s"], unit="s")
    stamps = pd.Timestamp("2026-11-21") + spans
    for times in (spans, stamps):
        (trial,) = read(frame.assign(time_s=times), rig, tmp_path, name="t.parquet").trials
        np.testing.assert_allclose(trial.time, frame["time_s"], atol=1e-9)


def test_columns_of_other_kinds_of_test_may_be_anything(
    frame: pd.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    """A velocity by `diff()` begins with a hole; what needs it is told."""
    log = read(frame.assign(velocity_rad_per_s=frame["theta_rad"].diff()), rig, tmp_path)
    assert_same(log, frame)
    assert any("velocity_rad_per_s is ignored" in notice for notice in log.notices)
    with pytest.raises(InputError, match="line 2: velocity_rad_per_s is empty"):
        log.trials[0].require(("velocity_rad_per_s",), "for this")


def test_counts_and_volts(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    other = frame.assign(
        encoder_counts=np.round(frame.theta_rad * COUNTS / (2 * math.pi)).astype(int),
        motor_volts=frame.motor_torque_nm / 0.0795,
    ).drop(columns=["theta_rad", "motor_torque_nm"])
    assert_same(read(other, rig, tmp_path), frame)


def test_encoder_zero(frame: pd.DataFrame, rig_text: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text + "encoder_zero_counts = 1234\n")
    counts = np.round(frame.theta_rad * COUNTS / (2 * math.pi)).astype(int) + 1234
    other = frame.assign(encoder_counts=counts).drop(columns="theta_rad")
    assert_same(read(other, read_rig(path), tmp_path), frame)


@pytest.mark.parametrize(
    ("entry", "change"),
    [
        ("pressure_a_pa=P1:kPa", lambda p: p / 1e3),
        ("pressure_a_pa=P1:bar(g)", lambda p: (p - 1e5) / 1e5),
        ("pressure_a_pa=P1:psi(a)", lambda p: p / 6894.757293168361),
        ("pressure_a_pa=P1", lambda p: p),
        ("pressure_a_pa=#5:kPa", lambda p: p / 1e3),
    ],
)
def test_mapped_pressure(
    entry: str, change: object, frame: pd.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    other = frame.assign(P1=change(frame.pressure_a_pa)).drop(columns="pressure_a_pa")  # type: ignore[operator]
    assert_same(read(other, rig, tmp_path, entry), frame)


def test_mapped_angle_and_time(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    other = frame.assign(t=frame.time_s * 1e3, alpha=np.degrees(frame.theta_rad))
    other = other.drop(columns=["time_s", "theta_rad"])
    log = read(other, rig, tmp_path, "time_s=t:ms", "theta_rad=alpha:deg")
    assert_same(log, frame)
    np.testing.assert_allclose(log.trials[0].time, frame.time_s)


def test_times_of_a_calendar_are_counted_from_the_start(
    frame: pd.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    log = read(frame.assign(time_s=frame["time_s"] + 1.7e9), rig, tmp_path)
    np.testing.assert_allclose(log.trials[0].time, frame["time_s"], atol=3e-7)
    assert any("time_s begins at 1700000000 s" in notice for notice in log.notices)


def test_tests_keep_their_order_and_rows(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    labels = np.where(np.arange(len(frame)) < 150, "zweiter", "erster")
    log = read(frame.assign(test=labels), rig, tmp_path)
    assert [t.label for t in log.trials] == ["zweiter", "erster"]
    assert [len(t) for t in log.trials] == [150, 250]


def test_interleaved_tests(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    log = read(frame.assign(test=np.arange(len(frame)) % 2), rig, tmp_path)
    np.testing.assert_allclose(log.trials[1]["theta_rad"], frame.theta_rad[1::2])


def test_time_may_restart_in_each_test(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    other = frame.assign(test=np.arange(len(frame)) // 200)
    other.loc[200:, "time_s"] -= 0.2
    log = read(other, rig, tmp_path)
    np.testing.assert_allclose([t.time[0] for t in log.trials], 0.0, atol=1e-12)


def test_torque_beyond_the_limit_is_cut_and_said(
    frame: pd.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    log = read(frame.assign(motor_torque_nm=2.5 * frame.motor_torque_nm), rig, tmp_path)
    assert float(np.max(log.trials[0]["motor_torque_nm"])) == pytest.approx(0.795)
    assert any("motor's limit of 0.795" in n for n in log.notices)


def test_unknown_columns_are_named(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    log = read(frame.assign(humidity=40), rig, tmp_path)
    assert any("humidity" in n for n in log.notices)


def test_a_slower_column_and_a_row_of_units_are_said(
    frame: pd.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    slower = frame.assign(motor_torque_nm=frame["motor_torque_nm"].where(frame.index % 5 == 0))
    for name, place in (("run.csv", "line 3"), ("run.parquet", "row 2")):
        said = rf"{name}, {place}: motor_torque_nm .* in 320 of 400 rows.*`sysid convert` fills in"
        with pytest.raises(InputError, match=said):
            read(slower, rig, tmp_path, name=name)
    units = dict(zip(frame, ["s", "Pa", "Pa", "rad", "Nm"], strict=True))
    with pytest.raises(InputError, match=r"line 2: .* = 's' is not a number; delete this row of"):
        read(pd.concat([pd.DataFrame([units]), frame]), rig, tmp_path)


def test_lines_above_the_columns_are_said(frame: pd.DataFrame, rig: Rig, tmp_path: Path) -> None:
    """As many cells as the table has, or fewer: a scope's."""
    path = tmp_path / "run.csv"
    table = frame.to_csv(index=False)
    path.write_text(f"Operator,Meier,,,\nDate,2024-05-06,,,\n{table}")
    with pytest.raises(InputError, match="line 3: the columns' names are below other lines"):
        read_log(path, rig)
    path.write_text("Model,MSO24\nVersion,2.0.3\nUnits,V,V\nTIME,CH1,CH2\n0,1,2\n")
    with pytest.raises(InputError, match=r"line 3: 3 fields under 2 .*with `sysid convert`"):
        read_log(path, rig)


def test_a_lost_sample_is_a_gap_not_mixed_sampling(
    frame: pd.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    assert len(read(frame.drop(index=[50, 51, 200]), rig, tmp_path).trials[0]) == len(frame) - 3


def test_a_linear_rig_has_metres_and_newtons(tmp_path: Path) -> None:
    rig = rig_from_content(
        {"rig": {"motion": "linear", "orientation": "horizontal"}, "inertia": {"mass_kg": 95.0}},
        "rig.toml",
    )
    time = np.arange(200) * 1e-3
    path = tmp_path / "run.csv"
    pd.DataFrame({"time_s": time, "position_m": 0.1 * time, "motor_force_n": 20.0}).to_csv(
        path, index=False
    )
    (trial,) = read_log(path, rig).trials
    np.testing.assert_allclose(trial["position_m"], 0.1 * time)
    with pytest.raises(InputError, match="linear rig"):
        path.write_text(path.read_text().replace("position_m", "theta_rad"))
        read_log(path, rig)


def test_samples_of_other_rigs_are_read(shared_samples: Path) -> None:
    for folder in sorted(p for p in shared_samples.iterdir() if p.is_dir()):
        rig = read_rig(folder / "rig.toml")
        for path in sorted(folder.glob("*.csv")):
            log = read_log(path, rig)
            assert log.trials
            assert log.notices == ()
