"""`sysid check`: quality of a log, and what it can and cannot identify."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sysid.checks.log_check import LogCheck, check_log
from sysid.commands.app import main
from sysid.io.logs import read_log
from sysid.io.rig import read_rig

PERIOD = 1e-3
QUANTUM_PA = 26.0


def pressure(rng: np.random.Generator, mean: np.ndarray, noise: float = 200.0) -> np.ndarray:
    return np.round((mean + noise * rng.standard_normal(len(mean))) / QUANTUM_PA) * QUANTUM_PA


@pytest.fixture
def folder(tmp_path: Path, rig_text: str) -> Path:
    (tmp_path / "rig.toml").write_text(rig_text)
    return tmp_path


def motion_frame(noise: float = 200.0) -> pd.DataFrame:
    rng = np.random.default_rng(5)
    time = np.arange(4000) * PERIOD
    angle = 0.5 * np.sin(2 * np.pi * 0.7 * time)
    step = 2 * np.pi / 80000
    speed = np.gradient(angle, PERIOD)
    torque = 0.0237 * np.gradient(speed, PERIOD) + 0.2 * np.sign(speed) + 0.05 * speed
    return pd.DataFrame(
        {
            "time_s": time,
            "theta_rad": np.round(angle / step) * step,
            "motor_torque_nm": torque,
            "pressure_a_pa": pressure(rng, np.full(4000, 1e5), noise),
            "pressure_b_pa": pressure(rng, np.full(4000, 1e5), noise),
        }
    )


def checked(frame: pd.DataFrame, folder: Path) -> LogCheck:
    path = folder / "run.csv"
    frame.to_csv(path, index=False)
    rig = read_rig(folder / "rig.toml")
    return check_log(read_log(path, rig), rig)


@pytest.mark.parametrize("noise", [30.0, 150.0, 600.0])
def test_noise_and_resolution_are_found(noise: float, folder: Path) -> None:
    found = next(
        c for c in checked(motion_frame(noise), folder).channels if c.name == "pressure_a_pa"
    )
    assert found.noise_std == pytest.approx(noise, rel=0.06)
    assert found.quantum == pytest.approx(QUANTUM_PA, rel=1e-3)
    assert found.stuck_s == 0.0


def test_jitter_and_gaps(folder: Path) -> None:
    rng = np.random.default_rng(8)
    frame = motion_frame()
    frame["time_s"] += 2e-5 * rng.standard_normal(len(frame))
    check = checked(frame.drop(index=range(1000, 1120)), folder)
    assert check.gaps == 1
    assert check.longest_gap_s == pytest.approx(0.121, abs=1e-3)
    assert check.jitter_s == pytest.approx(2e-5 * np.sqrt(2), rel=0.1)


def test_a_stuck_sensor(folder: Path) -> None:
    frame = motion_frame()
    frame.loc[500:799, "pressure_a_pa"] = frame.pressure_a_pa[500]
    check = checked(frame, folder)
    found = next(c for c in check.channels if c.name == "pressure_a_pa")
    assert found.stuck_s == pytest.approx(0.299, abs=1e-3)
    assert found.saturated_share == 0.0
    assert next(c for c in check.channels if c.name == "pressure_b_pa").stuck_s == 0.0


def test_a_saturated_sensor(folder: Path) -> None:
    frame = motion_frame()
    rise = 1e5 + 1.5e5 * np.sin(np.pi * np.arange(4000) / 4000)
    rng = np.random.default_rng(2)
    frame["pressure_a_pa"] = np.minimum(pressure(rng, rise), 208000.0)
    found = next(c for c in checked(frame, folder).channels if c.name == "pressure_a_pa")
    share = float(np.mean(frame.pressure_a_pa == 208000.0))
    assert found.saturated_share == pytest.approx(share, rel=0.1)


def test_what_a_motion_identifies(folder: Path) -> None:
    check = checked(motion_frame(), folder)
    said = {i.parameter: i for i in check.identifies}
    for name in ("Coulomb friction", "viscous friction", "torque offset", "inertia"):
        assert said[name].identified, said[name]
    assert not said["static friction"].identified
    assert "friction-static" in said["static friction"].reason
    assert not said["valve A c_fill"].identified


def test_one_direction_cannot_tell_coulomb_from_offset(folder: Path) -> None:
    frame = motion_frame()
    time = frame.time_s.to_numpy()
    frame["theta_rad"] = 0.2 * time + 0.02 * np.sin(3 * time)
    frame["motor_torque_nm"] = 0.3
    said = {i.parameter: i for i in checked(frame, folder).identifies}
    assert not said["Coulomb friction"].identified
    assert "both directions" in said["torque offset"].reason


@pytest.mark.parametrize(("seconds_on", "identified"), [(3.0, True), (0.02, False)])
def test_filling_must_reach_the_unchoked_stretch(
    seconds_on: float, identified: bool, folder: Path
) -> None:
    rng = np.random.default_rng(4)
    time = np.arange(6000) * PERIOD
    on = (time >= 1.0) & (time < 1.0 + seconds_on)
    mean = 1e5 + 2e5 * (1 - np.exp(-np.clip(time - 1.0, 0, seconds_on) / 0.3))
    after = time >= 1.0 + seconds_on
    mean[after] = 1e5 + (mean[after] - 1e5) * np.exp(-(time[after] - 1.0 - seconds_on) / 0.3)
    frame = pd.DataFrame(
        {
            "time_s": time,
            "theta_rad": 1.69,
            "valve_a": on.astype(int),
            "valve_b": 0,
            "pressure_a_pa": pressure(rng, mean),
            "pressure_b_pa": pressure(rng, np.full(6000, 1e5)),
        }
    )
    check = checked(frame, folder)
    said = {i.parameter: i.identified for i in check.identifies}
    assert check.kinds == {"valve-discrete": 1}
    assert said["valve A c_fill"] is identified
    assert said["valve A choked filling flow"]
    assert not said["valve B c_fill"]


def test_the_command_prints_one_json_object(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "run.csv"
    motion_frame().to_csv(path, index=False)
    assert main(["check", str(path), "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["logs"][0]["rows"] == 4000
    assert not {"declared", "use"} & set(out["logs"][0])
    assert main(["check", str(path)]) == 0
    assert "Coulomb friction" in capsys.readouterr().out


def test_a_campaign_is_checked_log_by_log(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With its rig and its maps, and next to what it declares each log to be."""
    (folder / "rig.toml").rename(folder / "its_rig.toml")
    motion_frame().to_csv(folder / "run.csv", index=False)
    motion_frame().rename(columns={"theta_rad": "alpha"}).to_csv(folder / "two.csv", index=False)
    path = folder / "campaign.toml"
    path.write_text(
        'rig = "its_rig.toml"\n'
        '[[log]]\nkind = "motion-motor"\nfile = "run.csv"\nuse = "holdout"\n'
        '[[log]]\nkind = "friction-motion"\nfile = "two.csv"\nmap = { theta_rad = "alpha" }\n'
    )
    assert main(["check", str(path), "--json"]) == 0
    first, second = json.loads(capsys.readouterr().out)["logs"]
    assert (first["declared"], first["use"]) == ("motion-motor", "holdout")
    assert (second["declared"], second["use"]) == ("friction-motion", "fit")
    assert Path(second["file"]).name == "two.csv" and second["rows"] == 4000
    assert first["channels"] == second["channels"] and first["kinds"] == {"friction-motion": 1}
    assert main(["check", str(path), "-v"]) == 0
    printed = capsys.readouterr().out
    assert "in the campaign: motion-motor, held-out" in printed
    assert "excitation: " in printed and "e+0" not in printed
    assert main(["check", str(folder / "run.csv"), "--rig", str(folder / "its_rig.toml")]) == 0
    assert "in the campaign" not in capsys.readouterr().out


@pytest.mark.parametrize("option", [["--rig", "rig.toml"], ["--map", "theta_rad=alpha"]])
def test_a_campaign_has_its_own_rig_and_maps(
    option: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "campaign.toml"
    path.write_text('rig = "rig.toml"\n')
    assert main(["check", str(path), *option]) == 2
    assert f"{option[0]} is for logs" in capsys.readouterr().err


def test_the_ripple_of_a_valve_under_pwm_is_no_noise(folder: Path) -> None:
    frame = motion_frame(noise=0.0)
    rng = np.random.default_rng(6)
    ripple = 1200.0 * np.sin(2 * np.pi * frame.time_s / 0.005)
    frame["pressure_a_pa"] = pressure(rng, 1.8e5 + ripple.to_numpy())
    frame["duty_a"], frame["duty_b"] = 0.4, 0.0
    found = next(c for c in checked(frame, folder).channels if c.name == "pressure_a_pa")
    assert found.noise_std == pytest.approx(200.0, rel=0.1)
