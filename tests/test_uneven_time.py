"""Logs whose period drifts, logs brought onto another period, and files joined by time."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sysid import signals
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.friction import fit_friction
from sysid.io.conversion import convert
from sysid.io.joining import TimedColumns, joined
from sysid.io.logs import Log, read_log
from sysid.io.reshaping import measured_period
from sysid.io.rig import Rig, rig_from_content
from sysid.io.tables import read_table
from sysid.types import FloatArray

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled"
AXIS = Rig("axis", "horizontal", "rotary")
COULOMB, VISCOUS, INERTIA = 0.2, 0.05, 0.02


def drifting(count: int, short: float = 0.010, long: float = 0.018) -> FloatArray:
    """Time stamps (count,) s of a PC's loop whose period drifts between two limits."""
    share = 0.5 + 0.5 * np.sin(2.0 * np.pi * np.arange(count) / 500.0)
    return np.concatenate([[0.0], np.cumsum(short + (long - short) * share)[:-1]])


def motion(time: FloatArray, noise: float = 0.0, seed: int = 1) -> pd.DataFrame:
    """A shaft of known friction, its torque held from row to row."""
    rng = np.random.default_rng(seed)
    speed = 0.6 * np.cos(0.9 * time) + 0.5 * np.cos(0.37 * time)
    angle = 0.6 / 0.9 * np.sin(0.9 * time) + 0.5 / 0.37 * np.sin(0.37 * time)
    rate = -0.54 * np.sin(0.9 * time) - 0.185 * np.sin(0.37 * time)
    torque = INERTIA * rate + VISCOUS * speed + COULOMB * np.sign(speed)
    return pd.DataFrame(
        {
            "time_s": time,
            "theta_rad": angle + noise * rng.standard_normal(len(time)),
            "motor_torque_nm": torque,
        }
    )


def read(frame: pd.DataFrame, folder: Path, rig: Rig = AXIS) -> Log:
    frame.to_csv(folder / "log.csv", index=False)
    return read_log(folder / "log.csv", rig)


def test_a_drifting_period_is_read_with_one_notice(tmp_path: Path) -> None:
    log = read(motion(drifting(4000), 1e-4), tmp_path)
    (notice,) = log.notices
    assert "log.csv: sampled unevenly, every 0.01" in notice and "to 0.01795 s" in notice
    assert log.trials[0].stride == 1


def test_friction_comes_out_of_a_drifting_log(tmp_path: Path) -> None:
    content = {"rig": {"name": "arm", "orientation": "horizontal"}}
    rig = rig_from_content(content | {"inertia": {"equivalent_kg_m2": INERTIA}}, "rig.toml")
    found = fit_friction(read(motion(drifting(8000), 1e-5), tmp_path, rig).trials, rig).parameters
    assert found["coulomb"].value == pytest.approx(COULOMB, rel=0.03)
    assert found["viscous"].value == pytest.approx(VISCOUS, rel=0.08)


def test_a_recorders_second_rate_is_refused(tmp_path: Path) -> None:
    time = np.cumsum(np.where(np.arange(400) < 250, 0.010, 0.025))
    with pytest.raises(InputError, match="convert --resample"):
        read(motion(time), tmp_path)


def test_a_resampled_log_says_so_and_knows_its_noise(tmp_path: Path) -> None:
    motion(drifting(4000), 1e-3).to_csv(tmp_path / "drift.csv", index=False)
    for name in ("even.csv", "even.parquet"):
        convert(tmp_path / "drift.csv", tmp_path / name, resample_s=0.005, trim="0.5:40")
        (line,) = [c for c in read_table(tmp_path / name, {"time_s"}).comments if "resampled" in c]
        assert "to 0.005 s" in line and "rows every 0.01" in line
        (trial,) = read_log(tmp_path / name, AXIS).trials
        assert np.ptp(np.diff(trial.time)) < 1e-9
        assert trial.time[0] == pytest.approx(0.5, abs=0.02)
        assert trial.row_period == pytest.approx(0.014, rel=0.05) and trial.stride == 3
        white = signals.noise_floor(trial["theta_rad"])
        known = signals.noise_floor(trial["theta_rad"], stride=trial.stride)
        assert white.noise < 2e-4  # what the assumption of white noise would make of it
        assert known.noise == pytest.approx(1e-3 * np.sqrt(2.0 / 3.0), rel=0.15)


def test_commands_are_held_and_signals_interpolated(tmp_path: Path) -> None:
    frame = motion(drifting(2000)).assign(motor_torque_nm=lambda f: np.sign(f["theta_rad"] + 1e-9))
    frame.to_csv(tmp_path / "drift.csv", index=False)
    convert(tmp_path / "drift.csv", tmp_path / "even.csv", resample_s=0.01)
    (trial,) = read_log(tmp_path / "even.csv", AXIS).trials
    assert set(np.unique(trial["motor_torque_nm"])) <= {-1.0, 1.0}
    truth = motion(trial.time)["theta_rad"].to_numpy()
    assert trial["theta_rad"] == pytest.approx(truth, abs=1e-4)


def test_a_pause_stays_a_pause_in_a_resampled_log(tmp_path: Path) -> None:
    """What would fill it is made up, and nothing would say so afterwards."""
    time = np.arange(0.0, 4.0, 0.002)
    time = time[(time < 1.5) | (time > 2.5)]
    path = tmp_path / "paused.csv"
    motion(time).to_csv(path, index=False)
    convert(path, tmp_path / "run.csv", resample_s=1e-3)
    log = read_log(tmp_path / "run.csv", AXIS)
    steps = np.diff(log.trials[0].time)
    assert np.count_nonzero(steps > 0.5) == 1
    assert np.median(steps) == pytest.approx(1e-3)


@pytest.mark.parametrize("shift", [0.1, 12.3, -0.05])
def test_a_command_is_that_of_its_own_row_however_clocks_round(shift: float) -> None:
    time = 1e-3 * np.arange(2000)
    first = TimedColumns("a", pd.DataFrame({"time_s": time, "theta_rad": time}))
    valve = pd.DataFrame({"time_s": time - shift, "valve_a": np.arange(2000) % 2})
    frame, _ = joined(first, [TimedColumns("b", valve, shift_s=shift)])
    assert len(frame) == 2000
    np.testing.assert_array_equal(frame["valve_a"], np.arange(2000) % 2)


def test_comments_of_others_are_no_period() -> None:
    assert measured_period(["map: theta_rad=a", "resampled", "map: trimmed to 0: s"]) is None


# --- joined files ----------------------------------------------------------------------------


def two_files(folder: Path, shift: float = 0.0) -> tuple[Path, Path, FloatArray]:
    """A motion's torque, and its angle (degrees) on other time stamps."""
    first = np.arange(0.0, 10.0, 0.01)
    second = np.arange(0.503, 9.2, 0.013)
    motion(first)[["time_s", "motor_torque_nm"]].to_csv(folder / "drive.csv", index=False)
    angle = np.degrees(motion(second)["theta_rad"])
    pd.DataFrame({"t": 1e3 * (second + shift), "phi": angle}).to_csv(
        folder / "encoder.csv", index=False
    )
    return folder / "drive.csv", folder / "encoder.csv", first


MAPS = ("time_s=t:ms", "theta_rad=phi:deg")


@pytest.mark.parametrize("shift", [0.0, 100.0])
def test_columns_of_two_files_are_joined_by_time(shift: float, tmp_path: Path) -> None:
    drive, encoder, first = two_files(tmp_path, shift)
    report = convert(
        drive,
        tmp_path / "run.csv",
        join=[encoder],
        join_maps=MAPS,
        join_shift_s=-shift,
    )
    assert any("joined with" in notice and "encoder.csv" in notice for notice in report.notices)
    assert [Path(s.path).name for s in report.sources] == ["drive.csv", "encoder.csv"]
    (trial,) = read_log(tmp_path / "run.csv", AXIS).trials
    assert trial.time[0] >= 0.503 and trial.time[-1] <= 9.2  # inside the overlap only
    assert np.isin(np.round(trial.time, 9), np.round(first, 9)).all()
    truth = motion(trial.time)
    assert trial["theta_rad"] == pytest.approx(truth["theta_rad"].to_numpy(), abs=5e-5)
    assert trial["motor_torque_nm"] == pytest.approx(truth["motor_torque_nm"].to_numpy())
    assert trial.row_period == pytest.approx(0.013)
    comments = read_table(tmp_path / "run.csv", {"time_s"}).comments
    assert any(c.startswith("map: joined by time") for c in comments)
    assert sum(c.startswith("source: ") for c in comments) == 2


def test_an_angle_that_wraps_is_unwrapped_before_it_is_joined(tmp_path: Path) -> None:
    drive, encoder, _ = two_files(tmp_path)
    frame = pd.read_csv(encoder)
    frame["phi"] = (3.0 * frame["phi"] + 180.0) % 360.0 - 180.0
    frame.to_csv(encoder, index=False)
    convert(drive, tmp_path / "run.csv", join=[encoder], join_maps=MAPS, unwrap=True)
    (trial,) = read_log(tmp_path / "run.csv", AXIS).trials
    truth = 3.0 * motion(trial.time)["theta_rad"].to_numpy()
    assert trial["theta_rad"] - trial["theta_rad"][0] == pytest.approx(truth - truth[0], abs=3e-4)


def test_time_stamps_are_a_common_clock(tmp_path: Path) -> None:
    drive, encoder, _ = two_files(tmp_path)
    start = pd.Timestamp("2024-05-01T12:00:00")
    for file, unit in ((drive, "s"), (encoder, "ms")):
        frame = pd.read_csv(file)
        name = frame.columns[0]
        frame[name] = start + pd.to_timedelta(frame[name], unit=unit)
        frame.to_csv(file, index=False)
    maps = ("time_s=t", "theta_rad=phi:deg")
    convert(drive, tmp_path / "run.csv", join=[encoder], join_maps=maps)
    (trial,) = read_log(tmp_path / "run.csv", AXIS).trials
    truth = motion(trial.time)["theta_rad"].to_numpy()
    assert trial["theta_rad"] == pytest.approx(truth, abs=5e-5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "does not overlap"),
        (["--join-shift", "-100", "--join-map", "motor_torque_nm=phi:Nm"], "so has"),
        (["--join-shift", "-100", "--join-map", "pressure_a_pa=p:Pa"], "has no column 'p'"),
    ],
)
def test_joins_that_are_refused(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, encoder, _ = two_files(tmp_path, 100.0)
    given = ["convert", str(drive), "-o", str(tmp_path / "run.csv"), "--join", str(encoder)]
    for text in MAPS:
        given += ["--join-map", text]
    assert main([*given, *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "run.csv").exists()


def test_a_joined_file_keeps_the_label_of_its_test(tmp_path: Path) -> None:
    drive, encoder, _ = two_files(tmp_path)
    given = {"join": [encoder], "join_maps": MAPS}
    report = convert(drive, tmp_path / "run.csv", constants=["test=up"], **given)
    (trial,) = read_log(tmp_path / "run.csv", AXIS).trials
    assert trial.label == "up" and report.rows == len(trial)
    once = drive.read_text()
    drive.write_text(once * 2)
    with pytest.raises(InputError, match=r"drive.* holds several tests; keep one with --rows"):
        convert(drive, tmp_path / "twice.csv", **given)
    drive.write_text(once)
    encoder.write_text(encoder.read_text() * 2)
    with pytest.raises(InputError, match=r"encoder.* holds several tests; --rows cuts the first"):
        convert(drive, tmp_path / "twice.csv", **given)


def test_times_of_another_unit_are_no_shift_of_clocks(tmp_path: Path) -> None:
    """The second file lies within the first one's times, which are read as seconds, not ms."""
    drive, encoder, _ = two_files(tmp_path)
    frame = pd.read_csv(drive)
    frame.assign(time_s=1e3 * frame["time_s"]).to_csv(drive, index=False)
    with pytest.raises(InputError, match=r"lies between rows of .* s apart; check the unit"):
        convert(drive, tmp_path / "run.csv", join=[encoder], join_maps=MAPS, join_shift_s=0.2)


def test_a_clock_that_stops_is_named_and_left_out_by_the_fix(tmp_path: Path) -> None:
    drive, encoder, _ = two_files(tmp_path)
    frame = pd.read_csv(drive)
    frame.loc[300:, "time_s"] = frame["time_s"][299]
    frame.to_csv(drive, index=False)
    report = convert(drive, tmp_path / "run.csv")
    (line,) = [one for one in report.notices if "repeats" in one]
    assert f"line 302: time_s repeats {frame['time_s'][299]:.9g}" in line
    assert f"the first of {len(frame) - 300} rows" in line
    assert line.endswith("; --rows 0:300 keeps those before")
    with pytest.raises(InputError, match=f"the first of {len(frame) - 300} rows"):
        read_log(tmp_path / "run.csv", AXIS)
    with pytest.raises(InputError, match="with --rows 0:300 keeps those before"):
        convert(drive, tmp_path / "run.csv", join=[encoder], join_maps=MAPS)
    kept = convert(drive, tmp_path / "kept.csv", rows="0:300")
    assert kept.rows == 300 and not any("repeats" in one for one in kept.notices)


def test_what_a_joined_file_leaves_out_and_adds_is_said(tmp_path: Path) -> None:
    drive, encoder, _ = two_files(tmp_path)
    frame = pd.read_csv(encoder).assign(junk=1.0, p=100.0)
    frame.to_csv(encoder, index=False)
    rig = (BUNDLED / "rig.toml").read_text()
    at = "atmospheric_pressure_pa = "
    (tmp_path / "rig.toml").write_text(re.sub(f"{at}[0-9.e]+", f"{at}98000.0", rig))
    maps = (*MAPS, "pressure_a_pa=p:kPa(g)")
    report = convert(drive, tmp_path / "run.csv", join=[encoder], join_maps=maps)
    assert "junk" in report.unmapped
    assert set(maps) <= set(report.maps)
    assert any("98000 Pa, is added to gauge pressures" in notice for notice in report.notices)
    comments = read_table(tmp_path / "run.csv", {"time_s"}).comments
    assert "map: atmosphere 98000 Pa (joined)" in comments


@pytest.mark.parametrize(
    ("maps", "said"), [(("theta_rad=phi:deg",), "time_s"), (("time_s=t:ms",), "none")]
)
def test_a_joined_file_is_mapped_by_its_own_option(
    maps: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    drive, encoder, _ = two_files(tmp_path)
    with pytest.raises(InputError, match=rf"{said}.*--join-map") as raised:
        convert(drive, tmp_path / "run.csv", join=[encoder], join_maps=maps)
    assert "--period" not in str(raised.value)


@pytest.mark.parametrize("again", ["again.csv", "again.parquet"])
def test_a_log_converted_once_more_keeps_what_is_known_of_its_rows(
    again: str, tmp_path: Path
) -> None:
    drive, encoder, _ = two_files(tmp_path)
    convert(drive, tmp_path / "run.csv", join=[encoder], join_maps=MAPS)
    convert(tmp_path / "run.csv", tmp_path / again, trim="1:5")
    convert(tmp_path / again, tmp_path / f"third-{again}")
    (trial,) = read_log(tmp_path / f"third-{again}", AXIS).trials
    assert trial.row_period == pytest.approx(0.013)


def test_a_period_that_no_log_has_is_refused(tmp_path: Path) -> None:
    drive, _, _ = two_files(tmp_path)
    with pytest.raises(InputError, match="--resample"):
        convert(drive, tmp_path / "run.csv", resample_s=1e-308)
