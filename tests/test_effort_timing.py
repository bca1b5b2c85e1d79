"""A row's force: a command that holds to the next row, or a reading at the row."""

from __future__ import annotations

import logging
import tomllib
from pathlib import Path

import numpy as np
import pytest

import sysid as si
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.effort_timing import effort_is_read, with_commands
from sysid.io.rig import rig_from_content
from sysid.io.samples import Trial
from sysid.types import FloatArray

MASS, COULOMB, VISCOUS = 3.0, 20.0, 60.0
FINE = 20  # points that a sampling period is simulated in
RIG = '[rig]\nname = "axis"\nmotion = "linear"\norientation = "horizontal"\n'


SLOW_JOINT = {"name": "joint", "orientation": "horizontal"}


def ramps(level: float, period: float, ramp: float, bristle_m: float) -> tuple[FloatArray, ...]:
    """Speed that turns twice a second, within `ramp` s: time, position and force, on a fine grid.

    Friction follows the way since a reversal over `bristle_m` (0: at once).
    """
    time = np.arange(0.0, 4.0, period / FINE)
    knots, speeds = [0.0], [0.0]
    for k in range(8):
        speeds += 2 * [level * (-1) ** k * (0.5 + 0.25 * (k // 2))]
        knots += [0.5 * k + ramp, 0.5 * (k + 1)]
    speed = np.interp(time, knots, speeds)
    step = time[1]
    position = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * step)])
    friction = np.sign(speed)
    if bristle_m:
        for i in range(1, len(time)):  # Dahl (1968)
            slope = 1.0 - friction[i - 1] * np.sign(speed[i])
            friction[i] = friction[i - 1] + slope * speed[i] * step / bristle_m
    force = MASS * np.gradient(speed, step) + COULOMB * friction + VISCOUS * speed
    return time, position, force


def campaign(
    folder: Path, *, reading: bool, ramp: float, period: float = 0.002, bristle_m: float = 0.0,
    rig: str = RIG,
) -> Path:  # fmt: skip
    """Three tests of an axis, with the force of a load cell or the command of a controller."""
    rng = np.random.default_rng(4)
    (folder / "rig.toml").write_text(rig)
    entries = ['rig = "rig.toml"']
    for i, level in enumerate((0.1, 0.2, 0.3)):
        time, position, force = ramps(level, period, ramp, bristle_m)
        count = len(time) // FINE
        held = force[: count * FINE].reshape(count, FINE).mean(axis=1)
        rows = np.column_stack([time[::FINE], position[::FINE], force[::FINE]])[:count]
        if not reading:
            rows[:, 2] = held
        rows[:, 1] = 1e-5 * np.round(rows[:, 1] / 1e-5)
        rows[:, 2] += 0.5 * rng.standard_normal(count)
        file = folder / f"run_{i}.csv"
        np.savetxt(
            file, rows, delimiter=",", fmt="%.7f", comments="",
            header="time_s,position_m,motor_force_n",
        )  # fmt: skip
        entries.append(f'[[log]]\nkind = "friction-motion"\nfile = "{file.name}"')
    path = folder / "campaign.toml"
    path.write_text("\n\n".join(entries) + "\n")
    return path


@pytest.mark.parametrize(("ramp", "period"), [(0.03, 0.002), (0.2, 0.002), (0.03, 0.0005)])
@pytest.mark.parametrize("reading", [True, False])
def test_readings_and_commands_are_told_apart(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, reading: bool, ramp: float, period: float
) -> None:
    path = campaign(tmp_path, reading=reading, ramp=ramp, period=period)
    with caplog.at_level(logging.WARNING, logger="sysid"):
        found = si.fit(si.read_campaign(path)).friction
    assert found is not None and found.mass_kg is not None and found.viscous_n_s_per_m is not None
    assert ("as a reading at each row" in caplog.text) == reading
    assert found.mass_kg.value == pytest.approx(MASS, rel=0.015)
    assert found.viscous_n_s_per_m.value == pytest.approx(VISCOUS, rel=0.01)
    low, high = found.mass_kg.interval
    assert low < MASS < high


def test_one_log_is_judged_like_a_campaign(tmp_path: Path) -> None:
    campaign(tmp_path, reading=True, ramp=0.03)
    found = si.fit_friction(si.read_log(tmp_path / "run_2.csv"))
    assert any("as a reading at each row" in line for line in found.notices)
    assert found.mass_kg.value == pytest.approx(MASS, rel=0.015)


def test_a_gap_in_a_recording_is_not_bridged() -> None:
    """A pause of the logger: a curve through it would give forces of kilonewtons beside it."""
    time = 0.01 * np.arange(400.0)
    time[200:] += 2.66
    force = 155.0 + np.random.default_rng(4).normal(0.0, 0.5, 400)
    trial = Trial("1", time, {"motor_force_n": force}, "run.csv")
    (found,) = with_commands([trial], rig_from_content(tomllib.loads(RIG), "rig.toml"))
    assert np.abs(found["motor_force_n"] - 155.0).max() < 5.0
    whole = Trial("1", time[:200], {"motor_force_n": force[:200]}, "run.csv")
    (alone,) = with_commands([whole], rig_from_content(tomllib.loads(RIG), "rig.toml"))
    np.testing.assert_array_equal(found["motor_force_n"][:200], alone["motor_force_n"])


def test_friction_that_turns_late_makes_no_reading_of_a_command(tmp_path: Path) -> None:
    path = campaign(tmp_path, reading=False, ramp=0.03, bristle_m=2e-4)
    read = si.read_campaign(path)
    assert not any("as a reading" in n for n in read.read(read.logs[0]).notices)


@pytest.mark.parametrize("reading", [True, False])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_ripple_over_the_position_hides_no_half_sample(seed: int, reading: bool) -> None:
    """A slow joint whose ripple takes 20 rows a period, a sixth of its friction in size."""
    period, rig = 0.01, rig_from_content({"rig": SLOW_JOINT}, "rig.toml")
    rng = np.random.default_rng(seed)
    time = period * np.arange(3000)
    trials = []
    for size, rate in ((0.02, 0.6), (0.024, 0.5)):
        # A command acts to the next row: its mean is that of the middle.
        at = time if reading else time + 0.5 * period
        angle = size * np.sin(rate * at)
        torque = 6.0 * np.sign(np.cos(rate * at)) + np.sin(2500.0 * angle + seed)
        torque += 0.01 * rng.standard_normal(len(time))
        channels = {"theta_rad": size * np.sin(rate * time), "motor_torque_nm": torque}
        trials.append(Trial(str(size), time, channels, "run.csv"))
    assert effort_is_read(trials, rig) == reading


def test_a_declared_motor_is_a_command(tmp_path: Path) -> None:
    path = campaign(tmp_path, reading=True, ramp=0.03, rig=RIG + "\n[motor]\nmax_force_n = 500.0\n")
    read = si.read_campaign(path)
    log = read.read(read.logs[0])
    as_written = np.loadtxt(read.logs[0].path, delimiter=",", skiprows=1)[:, 2]
    np.testing.assert_array_equal(log.trials[0]["motor_force_n"], as_written)


def test_a_log_that_cannot_be_read_is_named_where_it_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = campaign(tmp_path, reading=True, ramp=0.03)
    (tmp_path / "run_1.csv").write_text("time_s,position_m\n0,zero\n")
    read = si.read_campaign(path)
    assert "as a reading" in read.read(read.logs[0]).notices[-1]
    with pytest.raises(InputError, match=r"run_1\.csv"):
        read.read(read.logs[1])
    assert main(["fit", str(path), "-o", str(tmp_path / "b.json")]) == 2
    assert "run_1.csv" in capsys.readouterr().err
