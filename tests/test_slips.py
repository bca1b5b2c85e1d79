"""Well-formed logs whose numbers cannot be: said before a number is (`benchmarks/slips.py`)."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from golden_folder import BUNDLED

from sysid.checks.log_check import check_log
from sysid.errors import InputError, NotIdentifiedError
from sysid.friction import fit_friction
from sysid.identification.friction.result import FrictionResult
from sysid.io.conversion import convert
from sysid.io.logs import Log, read_log
from sysid.io.plausibility import check_supply
from sysid.io.rig import Rig, read_rig, rig_from_content
from sysid.io.trust.misread import spikes


@pytest.fixture(scope="module")
def rig() -> Rig:
    return read_rig(BUNDLED / "rig.toml")


def bundled(name: str = "friction_sliding") -> pd.DataFrame:
    return pd.read_parquet(BUNDLED / f"{name}.parquet")


def read(frame: pd.DataFrame, rig: Rig, folder: Path) -> Log:
    file = folder / "log.parquet"
    frame.to_parquet(file)
    return read_log(file, rig)


def fitted(frame: pd.DataFrame, rig: Rig, folder: Path) -> FrictionResult:
    return fit_friction(read(frame, rig, folder).trials, rig)


@pytest.mark.parametrize(
    ("factor", "unit"), [(180.0 / np.pi, "deg"), (0.5 / np.pi, "rev"), (1e3, "mrad")]
)
def test_an_angle_in_another_unit_is_known_by_the_encoder(
    factor: float, unit: str, rig: Rig, tmp_path: Path
) -> None:
    frame = bundled("friction_static").assign(theta_rad=lambda f: factor * f["theta_rad"])
    with pytest.raises(InputError, match=f"theta_rad=theta_rad:{unit}"):
        read(frame, rig, tmp_path)


def test_an_angle_beyond_its_stops_is_said(rig: Rig, tmp_path: Path) -> None:
    shifted = read(bundled().assign(theta_rad=lambda f: f["theta_rad"] + 0.5), rig, tmp_path)
    assert any("beyond the end stops" in n for n in shifted.notices)
    assert not any("end stops" in n for n in read(bundled(), rig, tmp_path).notices)


def test_an_angle_that_wraps_is_followed(rig: Rig, tmp_path: Path) -> None:
    frame = bundled("friction_motion")
    turned = dataclasses.replace(rig, cylinder=None, sensors=type(rig.sensors)())
    wide = frame.assign(theta_rad=4.0 * frame["theta_rad"])
    wrapped = wide.assign(theta_rad=np.mod(wide["theta_rad"], 2.0 * np.pi))
    log = read(wrapped, turned, tmp_path)
    assert any("wraps around at 2 pi" in notice for notice in log.notices)
    wrapped.to_parquet(tmp_path / "wrapped.parquet")
    convert(tmp_path / "wrapped.parquet", tmp_path / "out.parquet", unwrap=True)
    for trials in (log.trials, read_log(tmp_path / "out.parquet", turned).trials):
        for trial in trials:
            own = wide[wide["test"].astype(str) == trial.label]["theta_rad"].to_numpy()
            offset = trial["theta_rad"] - own
            assert np.ptp(offset) == pytest.approx(0.0, abs=1e-9)


def test_a_wrapped_angle_is_not_taken_for_degrees(rig: Rig, tmp_path: Path) -> None:
    """With stops at +-90 degrees, a wrap at zero makes it run from 0 to 2 pi."""
    wrapped = bundled().assign(theta_rad=lambda f: np.mod(f["theta_rad"], 2.0 * np.pi))
    log = read(wrapped, rig, tmp_path)
    assert any("wraps around at 2 pi" in notice for notice in log.notices)
    whole = read(bundled(), rig, tmp_path)
    for trial, own in zip(log.trials, whole.trials, strict=True):
        np.testing.assert_allclose(trial["theta_rad"], own["theta_rad"], atol=1e-9)


def test_rows_every_ten_seconds_are_said_without_a_declared_period(
    rig: Rig, tmp_path: Path
) -> None:
    slow = bundled().assign(time_s=lambda f: 1e3 * f["time_s"])
    open_rig = dataclasses.replace(rig, sampling=None)
    assert any("too slow for an actuator" in n for n in read(slow, open_rig, tmp_path).notices)


def test_chambers_that_rest_at_twice_the_atmosphere_are_said(rig: Rig, tmp_path: Path) -> None:
    names = ("pressure_a_pa", "pressure_b_pa")
    twice = bundled().assign(**{n: bundled()[n] + 100200.0 for n in names})
    assert any("added twice" in n for n in read(twice, rig, tmp_path).notices)


def test_volts_under_the_name_of_a_torque_are_said(rig: Rig, tmp_path: Path) -> None:
    volts = bundled().assign(motor_torque_nm=lambda f: f["motor_torque_nm"] / 0.078)
    assert any("motor_volts" in n for n in read(volts, rig, tmp_path).notices)


def test_a_single_wild_sample_is_left_out_and_named(rig: Rig, tmp_path: Path) -> None:
    frame = bundled()
    frame.loc[1000, "pressure_a_pa"] = 1.2e6
    log = read(frame, rig, tmp_path)
    (notice,) = (n for n in log.notices if "single sample" in n)
    assert "1.2e+06" in notice and "1001" in notice
    clean = fit_friction(read(bundled(), rig, tmp_path).trials, rig)
    again = fit_friction(log.trials, rig)
    assert again.coulomb_nm.value == pytest.approx(clean.coulomb_nm.value, rel=1e-3)


def test_spikes_are_not_seen_in_ordinary_signals() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(4000) / 1000.0
    signals = [
        rng.normal(size=4000),
        np.round(rng.normal(size=4000) * 0.4),
        np.where(time < 2.0, 1e5, 3e5) + 150.0 * rng.normal(size=4000),
        2e5 + 5e3 * ((time * 200.0) % 1.0 < 0.1) + 150.0 * rng.normal(size=4000),
        np.cumsum(rng.normal(size=4000)),
        np.zeros(4000),
    ]
    assert [spikes(s).size for s in signals] == [0] * len(signals)
    with_two = signals[0].copy()
    with_two[[0, 700]] = 40.0, -30.0
    assert spikes(with_two).tolist() == [0, 700]


def test_swapped_chambers_push_the_motion_along(rig: Rig, tmp_path: Path) -> None:
    frame = bundled()
    swapped = frame.assign(
        pressure_a_pa=frame["pressure_b_pa"], pressure_b_pa=frame["pressure_a_pa"]
    )
    assert any("swapped" in n for n in fitted(swapped, rig, tmp_path).notices)
    assert not any("swapped" in n for n in fitted(frame, rig, tmp_path).notices)


@pytest.mark.parametrize("column", ["motor_torque_nm", "theta_rad"])
def test_friction_that_cannot_be_is_no_result(column: str, rig: Rig, tmp_path: Path) -> None:
    frame = bundled("friction_motion")
    found = fitted(frame.assign(**{column: -frame[column]}), rig, tmp_path)
    with pytest.raises(NotIdentifiedError, match=f"the sign of .*{column}.* is reversed"):
        found.require_possible()
    fitted(frame, rig, tmp_path).require_possible()


def test_an_inertia_a_thousand_times_too_large_is_no_result(rig: Rig, tmp_path: Path) -> None:
    text = (BUNDLED / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(text.replace("= 0.019623", "= 19.623"))
    heavy = read_rig(tmp_path / "rig.toml")
    assert heavy.total_inertia() == pytest.approx(1e3 * (rig.total_inertia() or 0.0), rel=0.1)
    found = fitted(bundled(), heavy, tmp_path)
    with pytest.raises(NotIdentifiedError, match="inertia is too large"):
        found.require_possible()


@pytest.mark.parametrize("trim", ["5", "a:b", ":", "4:1"])
def test_a_trim_that_is_none_is_refused(trim: str, tmp_path: Path) -> None:
    pd.DataFrame({"time_s": [0.0, 1.0], "theta_rad": [0.0, 1.0]}).to_csv(
        tmp_path / "a.csv", index=False
    )
    with pytest.raises(InputError, match="FROM:TO"):
        convert(tmp_path / "a.csv", tmp_path / "b.csv", trim=trim)


# --- what was seen with exit 0, slip by slip ------------------------------------------------


def test_milliseconds_for_seconds_are_refused(rig: Rig, tmp_path: Path) -> None:
    with pytest.raises(InputError, match='--map "time_s=time_s:ms"'):
        read(bundled().assign(time_s=lambda f: 1e3 * f["time_s"]), rig, tmp_path)


@pytest.mark.parametrize("factor", [1.5, 2.0, 10.0])
def test_a_scaled_time_is_said(factor: float, rig: Rig, tmp_path: Path) -> None:
    log = read(bundled().assign(time_s=lambda f: factor * f["time_s"]), rig, tmp_path)
    assert any("the rig file declares 0.001 s" in n for n in log.notices)


@pytest.mark.parametrize(
    "column", ["motor_torque_nm", "theta_rad", "pressure_a_pa", "every channel but the time"]
)
@pytest.mark.parametrize("name", ["friction_sliding", "friction_motion"])
def test_a_constant_channel_gives_no_friction(
    name: str, column: str, rig: Rig, tmp_path: Path
) -> None:
    """Effort zero, position constant, or everything but the time; a chamber that never breathes
    alone is no more than said."""
    frame = bundled(name)
    own = [c for c in frame if c not in ("time_s", "test")]
    columns = [column] if column in frame else own
    frame = frame.assign(
        **{c: 0.0 if c == "motor_torque_nm" else frame[c].iloc[0] for c in columns}
    )
    if column == "pressure_a_pa":
        log = read(frame, rig, tmp_path)
        (found,) = (c for c in check_log(log, rig).channels if c.name == column)
        assert found.stuck_s > 1.0
        return
    with pytest.raises((InputError, NotIdentifiedError)):
        fitted(frame, rig, tmp_path).require_possible()


def test_angles_beyond_every_stop_are_refused(rig: Rig, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="more than the stroke"):
        read(bundled().assign(theta_rad=lambda f: 3.0 * f["theta_rad"]), rig, tmp_path)


@pytest.mark.parametrize("factor", [2.0, 0.5, 1.5, 4.0])
def test_a_scaled_angle_is_known_by_the_encoder(factor: float, rig: Rig, tmp_path: Path) -> None:
    """The pitch diameter, a gear, or the decoding: no unit, but not the encoder's step."""
    step = 2.0 * np.pi / 80000
    frame = bundled("motion_motor")
    counts = (0.15 * frame["theta_rad"] / step).round()
    frame = frame.assign(theta_rad=factor * step * counts)
    log = read(frame, rig, tmp_path)
    (line,) = (n for n in log.notices if "resolved in steps" in n)
    assert f"scaled by {factor:g}" in line
    log = read(bundled("motion_motor"), rig, tmp_path)
    assert not any("resolved in steps" in n for n in log.notices)


def test_a_pitch_diameter_for_its_radius_is_said(rig: Rig, tmp_path: Path) -> None:
    wide = dataclasses.replace(
        rig, cylinder=rig.cylinder and rig.cylinder.model_copy(update={"pitch_radius_m": 0.07534})
    )
    with pytest.raises(InputError, match="pitch_radius_m"):
        read(bundled(), wide, tmp_path)
    for name in ("valve_pwm_a", "valve_discrete_b"):
        said = read(bundled(name), wide, tmp_path).notices
        assert any("pitch_radius_m is wrong" in n for n in said), name


def test_one_wild_sample_under_pwm_changes_nothing(rig: Rig, tmp_path: Path) -> None:
    frame = bundled("valve_pwm_a")
    frame.loc[len(frame) // 2, "pressure_a_pa"] = 1.2e6
    log = read(frame, rig, tmp_path)
    assert any("single sample" in n and "1.2e+06" in n for n in log.notices)
    assert max(float(t["pressure_a_pa"].max()) for t in log.trials) < 4e5


def test_one_pressure_under_both_names_is_said(rig: Rig, tmp_path: Path) -> None:
    log = read(bundled().assign(pressure_b_pa=lambda f: f["pressure_a_pa"]), rig, tmp_path)
    assert any("hold the same values in every row" in n for n in log.notices)


@pytest.mark.parametrize("name", ["motion_pwm", "valve_discrete_a"])
def test_swapped_and_inverted_valves_are_said(name: str, rig: Rig, tmp_path: Path) -> None:
    frame = bundled(name)
    a, b = ("duty_a", "duty_b") if "duty_a" in frame else ("valve_a", "valve_b")
    exchanged = read(frame.assign(**{a: frame[b], b: frame[a]}), rig, tmp_path)
    assert any("swapped" in n for n in exchanged.notices)
    moving = [c for c in (a, b) if np.ptp(frame[c]) > 0.0]
    inverted = read(frame.assign(**{c: 1.0 - frame[c] for c in moving}), rig, tmp_path)
    assert any("inverted" in n for n in inverted.notices)
    assert not any("swapped" in n for n in read(frame, rig, tmp_path).notices)


def test_an_angle_without_its_sign_is_said(rig: Rig, tmp_path: Path) -> None:
    frame = bundled("motion_motor")
    folded = read(frame.assign(theta_rad=frame["theta_rad"].abs()), rig, tmp_path)
    assert any("its sign is missing" in n for n in folded.notices)
    assert not any("its sign is missing" in n for n in read(frame, rig, tmp_path).notices)
    lifted = frame.assign(theta_rad=frame["theta_rad"] - frame["theta_rad"].min())
    assert not any("its sign is missing" in n for n in read(lifted, rig, tmp_path).notices)


def test_chambers_under_a_regulator_are_no_slip(rig: Rig, tmp_path: Path) -> None:
    """A rig without valves may stand at any pressure: at twice the atmosphere too, where the motor
    balances what that pushes."""
    assert rig.cylinder is not None and rig.cylinder.pitch_radius_m is not None
    names = ("pressure_a_pa", "pressure_b_pa")
    push = 100200.0 * (rig.cylinder.area_a_m2 - rig.cylinder.area_b_m2)
    frame = bundled()
    twice = frame.assign(
        **{n: frame[n] + 100200.0 for n in names},
        motor_torque_nm=frame["motor_torque_nm"] - push * rig.cylinder.pitch_radius_m,
    )
    regulated = dataclasses.replace(rig, valves=None, motor=None)
    assert not any("added twice" in n for n in read(twice, regulated, tmp_path).notices)


def test_tests_from_several_supplies_contradict_none(rig_text: str) -> None:
    rig = rig_from_content(tomllib.loads(rig_text), "rig.toml")
    declared = rig.require("air", "").supply_pressure_pa
    steps = declared * np.repeat([0.5, 0.65, 0.8, 1.0], 250)
    assert check_supply("log.csv", {"supply_pressure_pa": steps}, rig) is None
    gauge = check_supply("log.csv", {"supply_pressure_pa": 0.75 * steps}, rig)
    assert "one of the two is wrong" in (gauge or "")


def test_a_piston_that_compresses_a_chamber_above_the_supply_is_no_slip(rig_text: str) -> None:
    rig = rig_from_content(tomllib.loads(rig_text), "rig.toml")
    air, cylinder = rig.require("air", ""), rig.require("cylinder", "")
    angle = np.linspace(0.0, -0.5, 1000)
    room = cylinder.offset_a_m + cylinder.pitch_radius_m * angle
    pressure = air.supply_pressure_pa * (room[0] / room) ** 1.4
    columns = {"valve_a": np.ones(1000), "pressure_a_pa": pressure, rig.position_channel: angle}
    assert pressure.max() > 1.3 * air.supply_pressure_pa
    assert check_supply("log.csv", columns, rig) is None
    still = columns | {rig.position_channel: np.zeros(1000)}
    assert "one of the two is wrong" in (check_supply("log.csv", still, rig) or "")
