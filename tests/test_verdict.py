"""A fit is as good as all that it was given, and names the right cause first."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from friction_trials import (
    BARE,
    INERTIA,
    PERIOD,
    UNWRITTEN,
    constant,
    ramp,
    simulated,
    swing,
    trial,
)
from golden_folder import BUNDLED

from sysid.checks.log_check import check_log
from sysid.commands.app import main
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.quality import CONTRADICTED, ExcludedData, FitQuality
from sysid.friction import fit_friction
from sysid.io.logs import Trial, read_log
from sysid.io.rig import Inertia, Rig, read_rig
from sysid.io.units import parse_map
from sysid.types import FloatArray
from sysid.valve_pwm import fit_valve_pwm

MOVED = Rig("joint", "horizontal", "rotary", inertia=Inertia(equivalent_kg_m2=1.0))


@pytest.fixture(scope="module")
def rig() -> Rig:
    return read_rig(BUNDLED / "rig.toml")


# --- what was left out --------------------------------------------------------------------


def followed(*left_out: ExcludedData, scatter: float | None = None, **more: object) -> FitQuality:
    """A fit that misses 5 % of what it used."""
    found = FitQuality("effort", "N", 100, 0.05, 1.0, scatter=scatter, left_out=left_out)
    return dataclasses.replace(found, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("out", "verdict"),
    [
        (ExcludedData("tests", 1, 14, 0, 0.9, 1.0), "good"),  # few
        (ExcludedData("samples", 40, 100, 0, 0.08, 1.0), "good"),  # the law predicts them
        (ExcludedData("samples", 40, 100, 0, 0.3, 1.0), "usable: 40 % of the samples are excluded"),
        (ExcludedData("tests", 7, 14, 0, 0.9, 1.0), "poor: 7 of 14 tests are excluded"),
        (ExcludedData("tests", 3, 14, 3), "good"),
        (ExcludedData("tests", 5, 14, 5), "usable: 5 of 14 tests are excluded"),
        (ExcludedData("tests", 8, 14, 8), "poor: 8 of 14 tests are excluded"),
    ],
)
def test_what_was_left_out_counts(out: ExcludedData, verdict: str) -> None:
    found = followed(out)
    assert found.verdict.startswith(verdict) and (":" in found.verdict) == (":" in verdict)
    assert found.to_json()["left_out"] == [out.text]
    assert "left_out" not in followed().to_json()


def test_scatter_explains_what_was_left_out() -> None:
    out = ExcludedData("tests", 7, 14, 0, 0.3, 1.0)
    assert followed(out).verdict.startswith("usable")
    assert followed(out, scatter=0.28).verdict == "good"


def test_a_contradiction_and_a_single_value_are_not_good() -> None:
    assert followed(contradicted=True).verdict == f"usable: {CONTRADICTED}"
    assert followed(spare=0).verdict.startswith("usable: no test repeats it")
    assert followed(contradicted=True, impossible=("x",)).verdict == "impossible: x"


def test_tests_that_the_law_does_not_explain_make_a_fit_poor() -> None:
    """Constant-effort tests of which some move against their effort, as with a wrong pressure."""
    tests = [constant(way * level, s, f"{way:+d}{level}{s}")
             for way in (1, -1) for level in (0.3, 0.4) for s in (-0.01, 0.0, 0.01)]  # fmt: skip
    rig = Rig("arm", "horizontal", "rotary", inertia=Inertia(equivalent_kg_m2=INERTIA))
    assert fit_friction(tests, rig).quality["friction-sliding"].verdict == "good"
    moved = [
        dataclasses.replace(t, label=f"against {t.label}",
                            channels={**t.channels, "motor_torque_nm": -t["motor_torque_nm"]})
        for t in tests[:4]
    ]  # fmt: skip
    found = fit_friction([*tests, *moved], rig)
    quality = found.quality["friction-sliding"]
    assert quality.verdict.startswith("poor: 4 of 16 tests are excluded, with which the law misses")
    assert found.coulomb_nm.value == pytest.approx(0.208, rel=0.03)


def test_one_ramp_is_not_good() -> None:
    found = fit_friction([ramp(0.333, 0.208, 0.0, 1)], BARE)
    assert found.quality["friction-static"].verdict.startswith("usable: no test repeats it")
    assert not any("inf" in line for line in found.remarks)


# --- evidence of presliding ---------------------------------------------------------------


def strokes(
    friction: str, size: float, length: float, *, runs: int = 2, even: bool = True
) -> list[Trial]:
    """Slow strokes of 0.011 rad under 5.4 Nm of Coulomb friction and one thing more: a `ripple` of
    the torque, of the friction along the motion (`track`), or a memory of reversals."""
    rng = np.random.default_rng(11)
    found = []
    for n in range(1, runs + 1):
        t = 0.0155 * np.arange(1900) if even else np.cumsum(rng.choice([0.015, 0.016], 1900))
        phase = (t / 9.8 + 0.1 * n) % 1.0
        ramped = np.where(phase < 0.5, 4.0 * phase - 1.0, 3.0 - 4.0 * phase)
        q = 0.005 * (1.0 + 0.1 * n) * np.sin(0.49 * np.pi * ramped)
        way = np.sign(np.gradient(q, t))
        torque = 5.4 * np.tanh(np.gradient(q, t) / 1e-4)
        wave = size * np.sin(2.0 * np.pi * q / length + 0.4)
        if friction == "memory":
            torque = way * 5.4 * (1.0 - 2.0 * np.exp(-since_reversal(q, way) / length))
        elif friction == "ripple":
            torque = torque + wave
        else:
            torque = torque + way * wave
        torque = torque + 0.002 * rng.standard_normal(len(t))
        found.append(Trial(str(n), t, {"theta_rad": q, "motor_torque_nm": torque}, "log"))
    return found


def since_reversal(q: FloatArray, way: FloatArray) -> FloatArray:
    turns = np.concatenate([[0], np.flatnonzero(np.diff(way)) + 1])
    last = turns[np.searchsorted(turns, np.arange(len(q)), side="right") - 1]
    return np.asarray(np.abs(q - q[last]))


@pytest.mark.parametrize("length", [0.002, 0.004, 0.008, 0.02, 0.05])
@pytest.mark.parametrize("size", [1.0, 2.0, 4.0])
def test_a_ripple_over_position_is_no_presliding(size: float, length: float) -> None:
    found = fit_friction(strokes("ripple", size, length), MOVED, kind="motion")
    assert found.motion is not None and found.motion.limits is not None
    assert found.motion.limits.left_out <= 0.25
    assert found.coulomb_nm.holds(5.4)
    assert found.quality["friction-motion"].verdict != "good" or size == 1.0 or length == 0.05


@pytest.mark.parametrize("length", [0.004, 0.02])
def test_friction_along_the_track_is_no_presliding(length: float) -> None:
    found = fit_friction(strokes("track", 1.0, length), MOVED, kind="motion")
    assert found.motion is not None and found.motion.limits is not None
    assert found.motion.limits.left_out == 0.0


def test_a_memory_of_reversals_is_left_out_and_counts() -> None:
    """Presliding is left out as far as it reaches, not farther, and the law is of the rest."""
    found = fit_friction(strokes("memory", 0.0, 1.5e-4, runs=3), MOVED, kind="motion")
    assert found.motion is not None and found.motion.limits is not None
    limits = found.motion.limits
    assert 2.0 * 1.5e-4 < limits.travel < 8.0 * 1.5e-4 and limits.left_out < 0.4
    assert found.coulomb_nm.value == pytest.approx(5.4, rel=0.02)
    assert found.quality["friction-motion"].left_out[0].what == "samples"
    assert any("after a reversal (presliding" in n for n in found.notices)


def forward_only() -> list[Trial]:
    """A spindle: 5 kg, Coulomb 5 N, viscous 35 N s/m, Stribeck friction of 15 N below 0.07 m/s."""
    rng = np.random.default_rng(3)
    found = []
    for n in (1, 2):
        t = 0.004 * np.arange(2500)
        v = 0.01 + 0.45 * (1.0 - np.cos(2.0 * np.pi * (0.1 + 0.05 * n) * t)) * (0.6 + 0.2 * n)
        force = 5.0 * np.gradient(v, t) + 5.0 + 35.0 * v + 15.0 * np.exp(-((v / 0.07) ** 2))
        force += 0.2 * rng.standard_normal(len(t))
        x = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2.0)])
        found.append(Trial(str(n), t, {"position_m": x, "motor_force_n": force}, "spindle"))
    return found


def test_what_never_reverses_has_no_presliding() -> None:
    found = fit_friction(forward_only(), Rig("spindle", "horizontal", "linear"))
    assert found.motion is not None and found.motion.limits is not None
    limits = found.motion.limits
    assert limits.travel == 0.0 and 0.1 < limits.speed < 0.25 and limits.left_out < 0.4
    (total,) = found.combinations
    assert total.estimate.value == pytest.approx(5.0, rel=0.02)
    assert found.viscous_n_s_per_m.value == pytest.approx(35.0, rel=0.01)
    # The law of the faster motion is wrong at low speed, where the user has measured too.
    assert re.match(r"usable: \d+ % of the samples", found.quality["friction-motion"].verdict)


def levels(first: float, second: float, coulomb: float, viscous: float) -> Trial:
    """A motor that runs up at one torque and then at another, 4 s each."""
    effort = np.repeat([first, second], 4000)
    theta = simulated(effort, 1.2 * coulomb, coulomb, viscous)
    return trial(f"{first:g} {second:g}", effort, theta)


def test_several_levels_in_a_test_are_all_used() -> None:
    """Each test alone is one point, and friction differs with the direction."""
    up, down = (0.208, 0.0488), (0.1, 0.1)
    tests = [
        levels(0.4, 0.5, *up), levels(0.4, 0.46, *up),
        levels(-0.3, -0.4, *down), levels(-0.3, -0.36, *down),
    ]  # fmt: skip
    rig = dataclasses.replace(BARE, inertia=Inertia(equivalent_kg_m2=INERTIA))
    alone = fit_friction(tests, rig, kind="sliding")
    assert not (alone.coulomb_nm.identified and alone.viscous_nm_s_per_rad.identified)
    found = fit_friction(tests, rig)
    assert found.coulomb_nm.identified and found.viscous_nm_s_per_rad.identified
    assert 0.1 < found.coulomb_nm.value < 0.208 and 0.0488 < found.viscous_nm_s_per_rad.value < 0.1
    assert any("8 levels of 4 friction-sliding tests" in n for n in found.notices)
    assert not any("give constant-effort" in n for n in found.notices)


# --- contradictions -----------------------------------------------------------------------


def bundled(name: str, folder: Path, **changes: object) -> Path:
    """A bundled log with some columns changed, beside its rig file."""
    (folder / "rig.toml").write_text((BUNDLED / "rig.toml").read_text())
    frame = pd.read_parquet(BUNDLED / f"{name}.parquet")
    path = folder / f"{name}.parquet"
    frame.assign(**changes).to_parquet(path)
    return path


def twice(name: str) -> dict[str, object]:
    frame = pd.read_parquet(BUNDLED / f"{name}.parquet")
    return {c: frame[c] + 1.0e5 for c in ("pressure_a_pa", "pressure_b_pa")}


SLIPS = {
    "sampling": (lambda f: {"time_s": 2.0 * f["time_s"]}, "period_s is wrong by 2"),
    "rest": (lambda f: {c: f[c] + 1e5 for c in ("pressure_a_pa", "pressure_b_pa")}, "twice"),
    "unit": (lambda f: {c: 1.4 * f[c] for c in ("pressure_a_pa", "pressure_b_pa")}, "unit wrong"),
    "stroke": (lambda f: {"theta_rad": f["theta_rad"] + 0.6}, "beyond the end stops"),
    "effort": (lambda f: {"motor_torque_nm": 13.0 * f["motor_torque_nm"]}, "motor_volts"),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_contradiction_is_the_first_line_and_not_good(
    slip: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, said = SLIPS[slip]
    frame = pd.read_parquet(BUNDLED / "friction_sliding.parquet")
    path = bundled("friction_sliding", tmp_path, **change(frame))
    log = read_log(path, read_rig(tmp_path / "rig.toml"))
    assert said in log.contradictions[0] and log.notices[0] == log.contradictions[0]
    for command in (["fit", "friction", str(path), *UNWRITTEN], ["check", str(path)]):
        status = main(command)
        printed = capsys.readouterr()
        assert said in printed.err.splitlines()[0]
        if status == 0 and command[0] == "fit":
            assert not re.search(r"effort.* good", printed.out)


def test_logs_and_rig_that_agree_contradict_nothing(rig: Rig) -> None:
    for path in sorted(BUNDLED.glob("*.parquet")):
        assert read_log(path, rig).contradictions == ()


def test_a_supply_of_another_pressure_contradicts(rig: Rig, tmp_path: Path) -> None:
    assert rig.air is not None
    low = dataclasses.replace(rig, air=rig.air.model_copy(update={"supply_pressure_pa": 2e5}))
    log = read_log(BUNDLED / "valve_discrete_a.parquet", low)
    assert "supply_pressure_pa is 2e+05 Pa" in log.contradictions[0]
    frame = pd.read_parquet(BUNDLED / "valve_discrete_a.parquet")
    frame.assign(supply_pressure_pa=4e5).to_parquet(tmp_path / "logged.parquet")
    assert "4e+05 Pa" in read_log(tmp_path / "logged.parquet", rig).contradictions[0]


def test_what_nobody_declared_is_not_contradicted(rig: Rig, tmp_path: Path) -> None:
    path = bundled("friction_sliding", tmp_path, **twice("friction_sliding"))
    assumed = dataclasses.replace(rig, assumed=("air.atmospheric_pressure_pa",))
    log = read_log(path, assumed)
    assert log.contradictions == () and any("twice" in n for n in log.notices)


def test_a_valve_fit_under_a_contradiction_is_not_good(rig: Rig, tmp_path: Path) -> None:
    frame = pd.read_parquet(BUNDLED / "valve_pwm_a.parquet")
    frame.assign(time_s=frame["time_s"] * 1.1).to_parquet(tmp_path / "slow.parquet")
    found = fit_valve_pwm(read_log(tmp_path / "slow.parquet", rig).trials, rig)
    judged = [q for fit in found.fits.values() for q in fit.quality.values()]
    judged += [q for one in found.averaged.values() for q in one.quality.values()]
    assert judged and not any(q.verdict == "good" for q in judged)


def test_a_check_holds_a_contradiction_apart(rig: Rig, tmp_path: Path) -> None:
    path = bundled("friction_sliding", tmp_path, **twice("friction_sliding"))
    found = check_log(read_log(path, rig), rig)
    assert len(found.contradicts) == 1 and found.said[0] == found.contradicts[0]
    assert found.contradicts[0] not in found.notices


# --- a reversed sign ----------------------------------------------------------------------


def shaken() -> Trial:
    """A motion whose inertia takes most of the effort."""
    rng, time = np.random.default_rng(3), 0.005 * np.arange(2000)
    speed = 3.0 * np.sin(5.0 * time) + 1.5 * np.sin(3.1 * time + 1.0)
    effort = 0.05 * np.gradient(speed, time) + 0.2 * np.sign(speed) + 0.02 * speed
    position = 0.005 * np.cumsum(speed)
    effort += 0.01 * rng.standard_normal(len(time))
    return Trial("0", time, {"theta_rad": position, "motor_torque_nm": effort}, "shaken")


def driven() -> Trial:
    """To and fro at one speed, with ramps of 40 ms: friction is one sum."""
    rng, time = np.random.default_rng(5), 0.002 * np.arange(8000)
    left = (time / 2.0) % 1.0
    way = np.where((time / 4.0) % 1.0 < 0.5, 1.0, -1.0)
    speed = 2.0 * way * np.clip(np.minimum(left, 1.0 - left) / 0.02, 0.0, 1.0)
    effort = 2e-3 * np.gradient(speed, time) + 0.2 * np.sign(speed) + 0.02 * speed
    effort += 0.005 * rng.standard_normal(len(time))
    position = 0.002 * np.cumsum(speed)
    return Trial("0", time, {"theta_rad": position, "motor_torque_nm": effort}, "driven")


@pytest.mark.parametrize(
    ("tests", "rig"),
    [
        ([swing(), swing(phase=1.0)], BARE),
        ([shaken()], BARE),
        ([driven()], BARE),
        ([constant(w * n, s) for w in (1, -1) for n in (0.3, 0.4) for s in (0.0, 0.01)], BARE),
        ([ramp(0.333, 0.208, x, 1) for x in (-0.3, 0.0, 0.3)], BARE),
    ],
)
def test_a_reversed_sign_is_named_first(tests: list[Trial], rig: Rig) -> None:
    turned = [
        dataclasses.replace(t, channels={**t.channels, "theta_rad": -t["theta_rad"]}) for t in tests
    ]
    said = r"^friction: the sign of motor_torque_nm or of theta_rad is reversed.*--map \"motor_t"
    with pytest.raises(NotIdentifiedError, match=said):
        fit_friction(turned, rig).require_possible()
    fit_friction(tests, rig).require_possible()


def test_a_log_whose_sign_alone_is_reversed_is_named() -> None:
    """Of three: together they show no friction, and no test says which is the odd one."""
    tests = [dataclasses.replace(swing(phase=p), source=f"run{p}.csv") for p in (0, 1, 2)]
    tests[1] = dataclasses.replace(
        tests[1], channels={**tests[1].channels, "theta_rad": -tests[1]["theta_rad"]}
    )
    said = r"^friction: the sign of motor_torque_nm or of theta_rad is reversed in run1.csv: with"
    with pytest.raises(NotIdentifiedError, match=said):
        fit_friction(tests, BARE).require_possible()


def test_the_line_that_names_a_sign_turns_it_round(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    test = swing()
    pd.DataFrame(
        {"t": test.time, "x": test["theta_rad"], "F": -1e3 * test["motor_torque_nm"]}
    ).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "rig.toml").write_text('[rig]\nname = "arm"\norientation = "horizontal"\n')
    given = ["fit", "friction", str(tmp_path / "log.csv"), *UNWRITTEN]
    given += ["--map", "time_s=t", "--map", "theta_rad=x"]
    assert main([*given, "--map", "motor_torque_nm=F:mN m"]) == 3
    found = re.search(r'--map "([^"]+)"', capsys.readouterr().err)
    assert found is not None and found[1] == "motor_torque_nm=F:-1 mN m"
    assert main([*given, "--map", found[1]]) == 0


@pytest.mark.parametrize("unit", ["", ":kN", ":-1 N", ":0.5 N", ":2e-3 N"])
def test_a_map_of_the_other_sign_is_minus_the_map(unit: str) -> None:
    (own,) = parse_map([f"motor_force_n=F{unit}"]).values()
    (other,) = parse_map([own.reversed()]).values()
    assert other.factor == pytest.approx(-own.factor) and other.column == own.column


def test_noise_is_no_reversed_sign() -> None:
    rng = np.random.default_rng(4)
    tests = [swing(phase=p) for p in (0.0, 1.0)]
    noise = [
        dataclasses.replace(
            t, channels={**t.channels, "motor_torque_nm": 0.3 * rng.standard_normal(len(t))}
        )
        for t in tests
    ]
    with pytest.raises(NotIdentifiedError) as error:
        fit_friction(noise, BARE).require_possible()
    assert "is reversed:" not in str(error.value)


# --- the cause first ----------------------------------------------------------------------


def test_a_log_without_duties_is_said_to_lack_them(rig: Rig) -> None:
    with pytest.raises(
        InputError, match=r"friction_sliding.parquet: columns duty_a and duty_b are"
    ):
        fit_valve_pwm(read_log(BUNDLED / "friction_sliding.parquet", rig).trials, rig)
    with pytest.raises(InputError, match="valve_a switches: use `sysid fit valve-discrete`"):
        fit_valve_pwm(read_log(BUNDLED / "valve_discrete_a.parquet", rig).trials, rig)


def test_a_motion_given_to_the_fit_of_a_valve_says_so_at_once(rig: Rig) -> None:
    with pytest.raises(NotIdentifiedError) as error:
        fit_valve_pwm(read_log(BUNDLED / "motion_pwm.parquet", rig).trials, rig)
    text = str(error.value)
    assert re.match(r"\S+motion_pwm.parquet, tests 1, 2, 3: excluded: duty_a is not const", text)
    assert "duty_b is not const" in text
    assert len(text.replace(f"{BUNDLED}/", "")) < 350


@pytest.mark.parametrize("name", ["valve_pwm_a", "valve_discrete_a"])
def test_a_valve_s_log_given_to_the_fit_of_friction_says_so(name: str, rig: Rig) -> None:
    still = dataclasses.replace(rig, motor=None)
    said = rf"{name}.parquet: valves are on while the shaft is held.*fit valve-"
    with pytest.raises(NotIdentifiedError, match=said):
        fit_friction(read_log(BUNDLED / f"{name}.parquet", still).trials, still)


def test_a_shaft_at_rest_without_an_effort_is_said_with_its_file() -> None:
    t = PERIOD * np.arange(2000)
    still = Trial("", t, {"theta_rad": 0.0 * t, "motor_torque_nm": 0.0 * t}, "still.csv")
    with pytest.raises(NotIdentifiedError, match=r"still.csv: motor_torque_nm stays zero"):
        fit_friction([still], BARE)


# --- readings -----------------------------------------------------------------------------


def readings(folder: Path) -> Path:
    """Speeds at three torques either way: Coulomb 0.2 Nm, viscous 0.05 Nm s/rad."""
    rng = np.random.default_rng(1)
    torque = np.repeat([way * t for way in (1.0, -1.0) for t in (0.25, 0.3, 0.35)], 4)
    speed = (torque - 0.2 * np.sign(torque)) / 0.05
    speed *= 1.0 + 0.02 * rng.standard_normal(len(torque))
    path = folder / "points.csv"
    pd.DataFrame({"velocity_rad_per_s": speed, "motor_torque_nm": torque}).to_csv(path, index=False)
    (folder / "rig.toml").write_text('[rig]\nname = "arm"\norientation = "horizontal"\n')
    return path


def test_readings_need_no_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    monkeypatch.chdir(tmp_path)
    path = readings(tmp_path)
    (tmp_path / "campaign.toml").write_text(
        'rig = "rig.toml"\n[[log]]\nkind = "friction-points"\nfile = "points.csv"\n'
    )
    assert main(["fit", "friction", path.name]) == 0
    assert main(["fit", "campaign.toml", "-o", "whole.json"]) == 0
    part, whole = (
        json.loads((tmp_path / name).read_text())["friction"]
        for name in ("points.friction.bundle.json", "whole.json")
    )
    assert part == whole
    assert part["coulomb_nm"]["value"] == pytest.approx(0.2, rel=0.02)
    assert part["viscous_nm_s_per_rad"]["value"] == pytest.approx(0.05, rel=0.03)
    capsys.readouterr()
    assert main(["check", path.name]) == 0
    assert "friction-points" in capsys.readouterr().out
    assert main(["fit", "friction", path.name, "--kind", "motion", *UNWRITTEN]) == 2
    assert "time_s is missing" in capsys.readouterr().err
    assert math.isfinite(part["quality"]["friction-points"]["rmse"])
