"""A measured speed in motion logs: in place of the position, and beside it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from friction_trials import INERTIA as SIMULATED_INERTIA
from friction_trials import UNWRITTEN, simulated
from own_components import done, refused

from sysid.balance.motion import _noise_gains, _noise_gains_of_speed
from sysid.checks.log_check import check_log
from sysid.errors import InputError
from sysid.friction import fit_friction
from sysid.io.logs import Log, read_log
from sysid.io.measured_speed import are_readings, contradiction
from sysid.io.rig import Rig, rig_from_content
from sysid.io.samples import Trial
from sysid.types import FloatArray

PERIOD, INERTIA, COULOMB, VISCOUS = 1e-3, 0.02368, 0.2, 0.03
ROTARY = {
    "rig": {"name": "axis", "orientation": "horizontal"},
    "inertia": {"equivalent_kg_m2": INERTIA},
    "motor": {"max_torque_nm": 1.0},
}
LINEAR = {
    "rig": {"name": "axis", "orientation": "horizontal", "motion": "linear"},
    "inertia": {"mass_kg": 2.0},
    "motor": {"max_force_n": 50.0},
}


def rig(content: dict[str, object]) -> Rig:
    return rig_from_content(content, "rig.toml")


def driven(seed: int, count: int = 8000) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Time, torque, speed and angle of a shaft with friction that a torque drives to and fro."""
    time = PERIOD * np.arange(count)
    torque = 0.7 * np.sin(2 * np.pi * 0.7 * time + seed) + 0.3 * np.sin(2 * np.pi * 1.9 * time)
    speeds, angles = [0.0], [0.0]
    v, way, step = 0.0, 0.0, PERIOD / 10
    for u in torque[:-1].tolist():
        for _ in range(10):
            if v or abs(u) > COULOMB:
                resists = math.copysign(COULOMB, v or u) + VISCOUS * v
                after = v + step * (u - resists) / INERTIA
                v = 0.0 if after * v < 0.0 else after
            way += step * v
        speeds.append(v)
        angles.append(way)
    return time, torque, np.array(speeds), np.array(angles)


def log(folder: Path, content: dict[str, object], **columns: FloatArray) -> Log:
    path = folder / "run.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return read_log(path, rig(content))


@pytest.fixture(scope="module")
def motion() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    return driven(1)


Motion = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def test_the_position_is_the_speed_s_integral(motion: Motion, tmp_path: Path) -> None:
    time, torque, speed, angle = motion
    found = log(tmp_path, ROTARY, time_s=time, velocity_rad_per_s=speed, motor_torque_nm=torque)
    trial = found.trials[0]
    assert not trial.place_known
    np.testing.assert_allclose(trial["theta_rad"], angle, atol=1e-3)
    said = [line for line in found.notices if "integral" in line]
    assert said == [
        f"{found.path}: theta_rad is the integral of velocity_rad_per_s, from 0 at the start of "
        "each test: where in the stroke it moves is not known"
    ]


def test_each_test_starts_at_zero(motion: Motion, tmp_path: Path) -> None:
    time, torque, speed, _ = motion
    columns = {"time_s": time, "velocity_rad_per_s": speed, "motor_torque_nm": torque}
    twice = {name: np.concatenate([v, v]) for name, v in columns.items()}
    trials = log(tmp_path, ROTARY, test=np.repeat([1.0, 2.0], len(time)), **twice).trials
    assert len(trials) == 2
    np.testing.assert_array_equal(trials[0]["theta_rad"], trials[1]["theta_rad"])


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_friction_is_as_good_as_from_the_angle(noise: float, tmp_path: Path) -> None:
    """The noise of a speed does not attenuate what is fitted from its integral."""
    errors = []
    for seed in (1, 2, 3):
        time, torque, speed, _ = driven(seed)
        speed = speed + noise * np.random.default_rng(seed).standard_normal(len(time))
        found = log(tmp_path, ROTARY, time_s=time, velocity_rad_per_s=speed, motor_torque_nm=torque)
        fitted = fit_friction(found.trials, rig(ROTARY), estimate_inertia=True).motion
        assert fitted is not None and fitted.inertia is not None
        values = (fitted.coulomb.value, fitted.viscous.value, fitted.inertia.value)
        errors.append(
            [v / t - 1.0 for v, t in zip(values, (COULOMB, VISCOUS, INERTIA), strict=True)]
        )
    assert np.max(np.abs(np.mean(errors, axis=0))) < 0.01 + 0.2 * noise


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_ramps_and_constant_torques_are_as_good_as_from_the_angle(noise: float) -> None:
    random = np.random.default_rng(1)
    ramp, ramped = np.linspace(0.0, 0.35, 4000), []
    for k, sign in enumerate((1.0, -1.0, 1.0, -1.0)):
        ramped.append((f"ramp {k}", sign * ramp))
    for k, torque in enumerate((0.27, -0.27, 0.35, -0.35)):
        ramped.append((f"held {k}", np.append(np.linspace(0.0, torque, 20), np.full(1480, torque))))
    trials = []
    for label, effort in ramped:
        angle = simulated(effort, static=0.25, coulomb=COULOMB, viscous=VISCOUS)
        speed = np.gradient(angle, PERIOD) + noise * random.standard_normal(len(effort))
        time = PERIOD * np.arange(len(effort))
        channels = {"motor_torque_nm": effort, "velocity_rad_per_s": speed}
        trials.append(Trial(label, time, channels, f"run.csv, test {label}"))
    arm = rig({**ROTARY, "inertia": {"equivalent_kg_m2": SIMULATED_INERTIA}})
    fitted = fit_friction(trials, arm)
    assert fitted.static is not None and fitted.sliding is not None
    assert fitted.static.estimate.value == pytest.approx(0.25, rel=0.002 + 0.1 * noise)
    assert fitted.sliding.coulomb.value == pytest.approx(COULOMB, rel=0.002 + 0.1 * noise)


def test_the_noise_of_the_filtered_speed_is_that_of_a_simulation() -> None:
    from sysid import signals

    noise = np.random.default_rng(5).standard_normal(200_000)
    way = signals.integral(PERIOD * np.arange(len(noise)), noise)
    smooth = signals.lowpass(way, PERIOD, 30.0)
    found = [np.std(f(smooth, PERIOD)[500:-500]) for f in
             (signals.first_derivative, signals.second_derivative)]  # fmt: skip
    assert _noise_gains_of_speed(PERIOD, 30.0) == pytest.approx(found, rel=0.03)
    assert _noise_gains(PERIOD, 30.0, 1)[0] != pytest.approx(found[0], rel=0.5)


def test_a_linear_axis(tmp_path: Path) -> None:
    time, torque, speed, angle = driven(2)
    found = log(
        tmp_path, LINEAR, time_s=time, velocity_m_per_s=0.1 * speed, motor_force_n=10 * torque
    )
    np.testing.assert_allclose(found.trials[0]["position_m"], 0.1 * angle, atol=1e-4)


@pytest.mark.parametrize(
    ("content", "name", "mend"),
    [
        (ROTARY, "velocity_m_per_s", 'motion = "linear" there, or map velocity_rad_per_s'),
        (LINEAR, "velocity_rad_per_s", 'motion = "rotary" there, or map velocity_m_per_s'),
    ],
)  # fmt: skip
def test_the_speed_of_another_motion_is_refused(
    content: dict[str, object], name: str, mend: str, tmp_path: Path
) -> None:
    time = np.arange(100) * 0.01
    with pytest.raises(InputError) as caught:
        log(tmp_path, content, time_s=time, **{name: np.sin(time)})
    assert f"holds {name}, but rig.toml describes" in str(caught.value)
    assert mend in str(caught.value)


def test_a_typed_speed_of_a_linear_rig_is_a_column() -> None:
    from sysid.io.units import parse_map, to_si

    (entry,) = parse_map(["velocity_m_per_s=v:mm/s"]).values()
    assert to_si([250.0], entry)[0] == 0.25


def test_where_gravity_follows_from_the_angle_it_is_needed(motion: Motion, tmp_path: Path) -> None:
    time, torque, speed, _ = motion
    arm = {"arm_mass_kg": 0.1, "arm_length_m": 0.3, "equivalent_kg_m2": INERTIA}
    upright = {**ROTARY, "rig": {"name": "arm", "orientation": "vertical"}, "inertia": arm}
    found = log(tmp_path, upright, time_s=time, velocity_rad_per_s=speed, motor_torque_nm=torque)
    assert "theta_rad" not in found.trials[0]
    assert any("no theta_rad, which is needed: gravity's torque" in n for n in found.notices)
    with pytest.raises(InputError, match="holds velocity_rad_per_s but no theta_rad, and gravity"):
        fit_friction(found.trials, rig(upright))


def test_where_valves_move_only_friction_is_taken_from_the_speed(
    motion: Motion, tmp_path: Path, rig_text: str
) -> None:
    time, torque, speed, angle = motion
    (tmp_path / "rig.toml").write_text(rig_text, "utf-8")
    pressure = np.full(len(time), 1e5)
    frame = pd.DataFrame(
        {"time_s": time, "velocity_rad_per_s": speed, "motor_torque_nm": torque,
         "pressure_a_pa": pressure, "pressure_b_pa": pressure,
         "duty_a": 0.5 + 0.4 * np.sin(time), "duty_b": 0.3}
    )  # fmt: skip
    frame.to_csv(tmp_path / "run.csv", index=False)
    fitted = done("fit", "friction", tmp_path / "run.csv", "--kind", "motion", *UNWRITTEN)
    assert "friction is fitted from the speed; flows need theta_rad" in fitted.err
    shown = done("check", tmp_path / "run.csv").out
    assert "1 x motion-pwm" in shown and "velocity_rad_per_s" in shown
    line = refused("fit", "valve-pwm", tmp_path / "run.csv", "--valve", "a", *UNWRITTEN)
    assert "theta_rad is missing" in line
    assert np.ptp(angle) > 0.0


def test_check_shows_the_speed_and_not_its_integral(motion: Motion, tmp_path: Path) -> None:
    time, torque, speed, _ = motion
    found = log(tmp_path, ROTARY, time_s=time, velocity_rad_per_s=speed, motor_torque_nm=torque)
    checked = check_log(found, rig(ROTARY))
    assert checked.kinds == {"friction-motion": 1}
    assert [c.name for c in checked.channels] == ["velocity_rad_per_s", "motor_torque_nm"]
    assert {i.parameter for i in checked.identifies if i.identified} >= {"Coulomb friction"}


def test_readings_of_friction_are_no_motion(tmp_path: Path) -> None:
    speed = np.array([-2.0, -1.0, 1.0, 2.0, 3.0])
    torque = 0.2 * np.sign(speed) + 0.03 * speed
    found = log(
        tmp_path, ROTARY, time_s=np.arange(5.0), velocity_rad_per_s=speed, motor_torque_nm=torque
    )
    columns = {"time_s": np.arange(5.0), "motor_torque_nm": torque, "velocity_rad_per_s": speed}
    sampled = rig({**ROTARY, "sampling": {"period_s": 1.0}})
    assert are_readings(columns, rig(ROTARY)) and not are_readings(columns, sampled)
    assert are_readings({**columns, "velocity_rad_per_s": 0.0 * speed}, rig(ROTARY))
    assert "theta_rad" not in found.trials[0] and not found.notices


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (-1.0, "velocity_rad_per_s has the opposite sign of the motion of theta_rad"),
        (180.0 / np.pi, "0.01745 times as far as velocity_rad_per_s says (theta_rad is used): "
         "is it in deg/s?"),
        (2.0, "times as far as velocity_rad_per_s says (theta_rad is used)"),
        (1.0, None),
        (1.01, None),
    ],
)  # fmt: skip
def test_a_speed_beside_the_position_is_compared(
    factor: float, said: str | None, motion: Motion, tmp_path: Path
) -> None:
    time, torque, speed, angle = motion
    noisy = factor * (speed + 0.1 * np.random.default_rng(1).standard_normal(len(time)))
    counts = 2.0 * np.pi / 4000
    found = log(
        tmp_path, ROTARY, time_s=time, velocity_rad_per_s=noisy, motor_torque_nm=torque,
        theta_rad=np.round(angle / counts) * counts,
    )  # fmt: skip
    assert found.trials[0].place_known
    lines = [n for n in found.notices if "velocity_rad_per_s" in n]
    assert (said is None and not lines) or (
        len(lines) == 1 and said is not None and said in lines[0]
    )


def test_a_speed_of_another_motion_is_said_and_noise_is_not(motion: Motion) -> None:
    time, _, speed, angle = motion
    other = np.interp(time, time, np.roll(speed, 1000)) * np.cos(9.0 * time)
    line = contradiction([(time, angle, other)], rig(ROTARY))
    assert line is not None and "do not belong to one motion" in line
    rest = 0.01 * np.random.default_rng(2).standard_normal(len(time))
    held = np.round(rest / 0.01) * 0.001
    assert contradiction([(time, held, rest)], rig(ROTARY)) is None
