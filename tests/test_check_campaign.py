"""`sysid check CAMPAIGN`: whether its logs identify everything, in one table, the answer first."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from friction_trials import PERIOD, constant, ramp, swing
from test_components_tank import RIG as TANK_RIG
from test_components_tank import discharge
from test_own_component_files import CAMPAIGN, GOOD
from test_own_component_files import RIG as CART_RIG

from sysid.commands.app import main
from sysid.io.logs import Trial
from sysid.io.rig import BARE, rig_from_content

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled"
ARM = '[rig]\nname = "arm"\norientation = "horizontal"\n'
CLOSING = "-v shows each log"

Entry = tuple[str, str, Sequence[Trial]]


def written(folder: Path, entries: Sequence[Entry], rig: str = ARM, use: str = "fit") -> Path:
    """A campaign of logs, each of a kind, a file and trials."""
    (folder / "rig.toml").write_text(rig)
    text = 'rig = "rig.toml"\n'
    for kind, file, trials in entries:
        (folder / file).parent.mkdir(exist_ok=True)
        frames = [
            pd.DataFrame({"time_s": t.time, **t.channels, "test": k}) for k, t in enumerate(trials)
        ]
        pd.concat(frames).to_csv(folder / file, index=False)
        text += f'\n[[log]]\nkind = "{kind}"\nfile = "{file}"\nuse = "{use}"\n'
    path = folder / "campaign.toml"
    path.write_text(text)
    return path


def told(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> list[str]:
    assert main(["check", str(path), *options]) == 0
    return capsys.readouterr().out.rstrip().splitlines()


def row(lines: Sequence[str], parameter: str) -> list[str]:
    """The words of a parameter's row, after its name."""
    (line,) = (one for one in lines if one.startswith(f"{parameter}  "))
    return line.removeprefix(parameter).split()


def statics() -> list[Trial]:
    return [ramp(0.333, 0.208, x, way) for x in (-0.5, 0.5) for way in (1, -1)]


def motions(count: int) -> list[Trial]:
    return [swing(phase=0.3 * k) for k in range(count)]


@pytest.mark.parametrize("columns", ["80", "120"])
def test_the_bundled_campaign_in_sixty_lines(
    columns: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    lines = told(BUNDLED / "campaign.toml", capsys)
    assert lines[0] == "everything is identified"
    assert len(lines) <= 60
    assert row(lines, "static friction") == ["yes", "friction_static"]
    assert row(lines, "valve B c_dis") == ["yes", "valve_discrete_b"]
    assert not any("motion_discrete_2" in line for line in lines)  # held out
    assert lines[-1].startswith(CLOSING)


def test_what_is_lacking_comes_first_with_its_test(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without ramps nothing gives static friction; with them everything is there."""
    moving: Entry = ("friction-motion", "motion.csv", motions(2))
    lines = told(written(tmp_path, [moving]), capsys)
    assert lines[0].startswith("not identified: static friction (needs a friction-static test")
    assert row(lines, "static friction")[0] == "no"
    assert row(lines, "Coulomb friction") == ["yes", "motion"]
    ramps: Entry = ("friction-static", "ramps.csv", statics())
    lines = told(written(tmp_path, [moving, ramps]), capsys)
    assert lines[0] == "everything is identified"
    assert row(lines, "static friction") == ["yes", "ramps"]


def test_held_out_logs_identify_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, [("friction-static", "ramps.csv", statics())])
    held = path.read_text() + '\n[[log]]\nkind = "friction-motion"\nfile = "m.csv"\n'
    pd.DataFrame({"time_s": (t := motions(1)[0]).time, **t.channels}).to_csv(tmp_path / "m.csv")
    path.write_text(held)
    assert row(told(path, capsys), "Coulomb friction") == ["yes", "m"]
    path.write_text(held + 'use = "holdout"\n')
    lines = told(path, capsys)
    assert lines[0].startswith("not identified: Coulomb friction, viscous friction")
    assert "1 training log, 1 held out" in lines[1]
    path.write_text((held + 'use = "holdout"\n').replace('use = "fit"', 'use = "holdout"'))
    assert told(path, capsys)[0].startswith("nothing is identified: every log is held out")


def test_logs_identify_together_what_none_does_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One level of the torque, one way, a file: no line through it; through all there is."""
    levels = [w * x for w in (1, -1) for x in (0.25, 0.31, 0.36)]
    entries: list[Entry] = [
        ("friction-sliding", f"s{k}.csv", [constant(level, 0.0, offset=0.01 * k)])
        for k, level in enumerate(levels)
    ]
    path = written(tmp_path, [*entries, ("friction-static", "ramps.csv", statics())])
    assert main(["check", str(path), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    alone = [i for log in content["logs"][:6] for i in log["identifies"] if i["identified"]]
    assert alone == []
    (found,) = (i for i in content["identifies"] if i["parameter"] == "Coulomb friction")
    assert found["identified"] and found["together"] and found["logs"] == []
    lines = told(path, capsys)
    assert row(lines, "viscous friction")[:3] == ["yes", "all", "together"]
    assert main(["fit", str(path), "--json"]) == 0
    fitted = json.loads(capsys.readouterr().out)["friction"]
    assert fitted["coulomb_nm"]["value"] is not None


def test_many_logs_are_counted_by_kind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("sysid.blocks.terminal._PIPED_WIDTH", 80)
    short = [swing(seconds=2.5, phase=0.3 * k) for k in range(29)]
    still = Trial("still", short[0].time, {n: 0.0 * v for n, v in short[0].channels.items()}, "s")
    entries: list[Entry] = [
        ("friction-motion", f"runs/run_{k}.csv", [one]) for k, one in enumerate([*short, still])
    ]
    lines = told(written(tmp_path, entries), capsys)
    assert len(lines) <= 30 and max(map(len, lines[2:])) <= 80
    words = " ".join(row(lines, "inertia"))
    assert words == "yes 29 of 30 friction-motion logs, not run_29"


def test_contradictions_follow_the_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = pd.read_parquet(BUNDLED / "motion_pwm.parquet").iloc[::2]
    frame.assign(time_s=frame.time_s / 2.0).to_parquet(tmp_path / "fast.parquet")
    for name in ("rig.toml", "motion_motor.parquet"):
        shutil.copy(BUNDLED / name, tmp_path)
    path = tmp_path / "campaign.toml"
    path.write_text(
        'rig = "rig.toml"\n'
        '[[log]]\nkind = "motion-motor"\nfile = "motion_motor.parquet"\n'
        '[[log]]\nkind = "motion-pwm"\nfile = "fast.parquet"\n'
    )
    lines = told(path, capsys)
    assert lines[0].endswith("but logs or rig file contradict")
    assert lines[1].startswith("- ") and "the inertia that is moved" in " ".join(lines[1:4])


def test_a_log_with_gaps_or_noise_has_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rig_text: str
) -> None:
    one = swing()
    rng = np.random.default_rng(3)
    lost = np.delete(np.arange(len(one)), slice(1000, 1050))
    pressure = 1e5 + 2000.0 * rng.standard_normal(len(one))
    channels = {**one.channels, "pressure_a_pa": pressure, "pressure_b_pa": pressure[::-1]}
    gap = Trial("", one.time[lost], {n: v[lost] for n, v in channels.items()}, "gap")
    rig = rig_text.split("[sensors]")[0] + "[sensors]\npressure_noise_pa = 250.0\n"
    path = written(tmp_path, [("friction-motion", "gap.csv", [gap])], rig)
    lines = told(path, capsys)
    (line,) = (one for one in lines if one.startswith("gap.csv: "))
    assert f"1 gap, {51 * PERIOD:.3g} s" in line
    assert "pressure_a_pa: noise 2" in line and "times the rig file's" in line


# --- parts alone --------------------------------------------------------------------------


def tank_rig() -> str:
    return "\n".join(
        f"[{name}]\n" + "\n".join(f"{k} = {json.dumps(v)}" for k, v in keys.items())
        for name, keys in TANK_RIG.items()
    )


def test_a_tank_is_identified_by_its_discharge(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, [("tank", "d.csv", [discharge(4e4, 1)])], tank_rig())
    lines = told(path, capsys)
    assert lines[0] == "everything is identified"
    assert row(lines, "c_dis") == ["yes", "d"]
    assert not any("friction" in line for line in lines)


@pytest.mark.parametrize("name", ["pump_volts", "valve_a"])
def test_a_tanks_log_is_known_as_such(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By its command; and without one, where that is what is missing."""
    (tmp_path / "rig.toml").write_text(tank_rig())
    one = discharge(4e4, 1)
    on = (one["pump_volts"] > 0.0).astype(int)
    frame = pd.DataFrame({"time_s": one.time, "pressure_a_pa": one["pressure_a_pa"], name: on})
    frame.to_csv(tmp_path / "d.csv", index=False)
    lines = told(tmp_path / "d.csv", capsys)
    assert lines[0] == "d.csv identifies c_dis"
    frame.drop(columns=name).to_csv(tmp_path / "d.csv", index=False)
    first = told(tmp_path / "d.csv", capsys)[0]
    assert "this is a tank's discharge" in first and "friction" not in first
    assert "pump_volts is missing" in first and "valve_a" in first


READINGS = pd.DataFrame(
    {
        "velocity_rad_per_s": [1.0, 1.1, 2.0, 2.1, 3.0],
        "motor_torque_nm": [0.25, 0.25, 0.3, 0.3, 0.35],
    }
)


@pytest.mark.parametrize("rig", [ARM, ""])
def test_readings_of_friction_need_no_time(
    rig: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    READINGS.to_csv(tmp_path / "points.csv", index=False)
    if rig:
        (tmp_path / "rig.toml").write_text(rig)
    assert main(["check", str(tmp_path / "points.csv")]) == 0
    said = capsys.readouterr()
    assert said.out.startswith("points.csv identifies Coulomb friction, viscous friction\n")
    assert "each row is a reading of friction" in said.err


def test_a_campaign_of_readings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And a motion log without its time is none."""
    (tmp_path / "rig.toml").write_text(ARM)
    READINGS.to_csv(tmp_path / "points.csv", index=False)
    path = tmp_path / "campaign.toml"
    text = 'rig = "rig.toml"\n[[log]]\nkind = "{}"\nfile = "points.csv"\n'
    path.write_text(text.format("friction-points"))
    lines = told(path, capsys)
    assert lines[0] == "everything is identified"
    assert row(lines, "Coulomb friction") == ["yes", "points"]
    assert main(["fit", str(path), "--json"]) == 0
    capsys.readouterr()
    path.write_text(text.format("friction-motion"))
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert "column time_s is missing" in said and "friction-points" in said


DUTIES = np.linspace(0.0, 1.0, 21)
FLOWS = {
    "valve-flow": pd.DataFrame(
        {"duty_a": DUTIES, "flow_a_kg_s": 6e-4 * np.maximum(DUTIES - 0.1, 0.0) / 0.9}
    ),
    "valve-time": pd.DataFrame(
        {
            "duty_a": DUTIES[1:],
            "time_to_pressure_s": 0.2 / DUTIES[1:],
            "pwm_period_s": 0.02,
            "valve_a": 1,
        }
    ),
}


@pytest.mark.parametrize("kind", list(FLOWS))
def test_a_campaign_of_settled_flows_needs_no_time(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Alone as in a campaign, whatever sampling period the rig file declares."""
    (tmp_path / "rig.toml").write_text(f"{ARM}\n[sampling]\nperiod_s = 0.001\n")
    FLOWS[kind].to_csv(tmp_path / "sweep.csv", index=False)
    path = tmp_path / "campaign.toml"
    path.write_text(f'rig = "rig.toml"\n[[log]]\nkind = "{kind}"\nfile = "sweep.csv"\n')
    assert told(path, capsys)[0] == "everything is identified"
    assert main(["check", str(tmp_path / "sweep.csv")]) == 0
    assert f"each row is a reading by itself ({kind})" in capsys.readouterr().err
    assert main(["fit", str(path), "--json"]) == 0


# --- a component of one's own -------------------------------------------------------------


@pytest.fixture
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SYSID_JOBS", "1")
    (tmp_path / "rig.toml").write_text(CART_RIG)
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN)
    damped = GOOD.replace(
        '(Parameter("mass_kg", 2.0, "kg", 0.1, 10.0),)',
        '(Parameter("mass_kg", 2.0, "kg", 0.1, 10.0), '
        'Parameter("drag_n_s_per_m", 0.5, "N*s/m", 0.0, 10.0))',
    ).replace(
        'inputs["push_n"] / values["mass_kg"]',
        '(inputs["push_n"] - values["drag_n_s_per_m"] * state["speed"]) / values["mass_kg"]',
    )
    (tmp_path / "cart.py").write_text(damped)
    return path


def pushed(path: Path, push: float, noise: float, seed: int) -> None:
    """4 s of a cart of 2 kg under a square wave of force."""
    rng, time = np.random.default_rng(seed), 0.01 * np.arange(400)
    force = push * np.sign(np.sin(3.0 * time))
    speed = np.zeros(400)
    for k in range(399):
        speed[k + 1] = speed[k] + 0.01 * (force[k] - 0.5 * speed[k]) / 2.0
    speed += noise * rng.standard_normal(400)
    frame = pd.DataFrame({"time_s": time, "push_n": force, "speed_m_per_s": speed})
    frame.to_csv(path, index=False)


def test_each_log_of_a_component_says_what_it_identifies(
    cart: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A held-out log too; one that excites nothing, or less than the noise, identifies nothing."""
    pushed(cart.parent / "run.csv", 3.0, 0.01, 1)
    pushed(cart.parent / "other.csv", 0.0, 0.01, 2)
    given = ("--component", str(cart.parent / "cart.py"))
    assert main(["check", str(cart), *given, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    first, second = content["logs"]
    assert [i["identified"] for i in first["identifies"]] == [True, True]
    assert "expected standard error" in first["identifies"][0]["reason"]
    assert [i["identified"] for i in second["identifies"]] == [False, False]
    assert [i["logs"] for i in content["identifies"]] == [["run.csv"], ["run.csv"]]
    lines = told(cart, capsys, *given)
    assert lines[0] == "everything is identified"
    assert row(lines, "mass_kg") == ["yes", "run"]
    assert any("other.csv (held out): push_n does not change" in line for line in lines)
    pushed(cart.parent / "run.csv", 0.001, 0.5, 1)
    lines = told(cart, capsys, *given)
    assert lines[0].startswith("not identified: ") and "mass_kg" in lines[0]


# --- the file that is at fault ------------------------------------------------------------


@pytest.mark.parametrize("words", [("check",), ("fit", "friction"), ("fit", "valve-pwm"), ("fit",)])
def test_a_log_that_is_not_there_is_named_first(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before the rig file that would be read with it."""
    (tmp_path / "rig.toml").write_text("broken = [")
    gone = tmp_path / "gone.csv"
    assert main([*words, str(gone)]) == 2
    assert f"{gone}: no such file" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["run.npz", "run.csv", "run.json", "run.jsonl", "run.npy"])
def test_other_programs_files_are_named_for_what_they_are(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, time = tmp_path / name, 0.01 * np.arange(50)
    wanted = "JSON"
    if name.endswith(("npz", "csv")):
        with path.open("wb") as file:
            np.savez(file, time_s=time, pressure_a_pa=1e5 + time)
        wanted = "a NumPy archive (.npz)"
    elif name.endswith("npy"):
        np.save(path, time)
        wanted = "a NumPy array (.npy)"
    elif name.endswith("json"):
        path.write_text(json.dumps({"time_s": time.tolist()}, indent=1))
    else:
        path.write_text("\n".join(json.dumps({"t": t}) for t in time.tolist()))
    (tmp_path / "rig.toml").write_text(ARM)
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert f"is {wanted}, not a log; convert it first: `sysid convert {name} -o " in said


def test_an_assumed_rig_is_not_called_a_file() -> None:
    line = "swing the shaft less, or correct stroke_m in the rig file"
    content = {"rig": {"name": "arm", "orientation": "horizontal"}}
    assert rig_from_content(content, BARE).said(line).endswith("in the assumed rig")
    assert rig_from_content(content, "rig.toml").said(line) == line


# --- what a healthy log may be, and what a broken one is called -----------------------------


def pressure_log(path: Path, rig_text: str, **columns: np.ndarray) -> Path:
    (path / "rig.toml").write_text(rig_text)
    time = 0.001 * np.arange(400)
    position = 0.5 * np.sin(20.0 * time)
    frame = pd.DataFrame({"time_s": time, "theta_rad": position, "motor_torque_nm": 0.1})
    frame.assign(**columns).to_csv(path / "run.csv", index=False)
    return path / "run.csv"


def test_a_closed_chamber_may_be_pulled_far_below_the_atmosphere(
    tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """From rest at the atmosphere; a gauge pressure in Pa, near 0 where it rests, is refused."""
    pulled = 1e5 / (1.0 + 2.5 * np.linspace(0.0, 1.0, 400))
    assert main(["check", str(pressure_log(tmp_path, rig_text, pressure_a_pa=pulled))]) == 0
    capsys.readouterr()
    gauge = np.linspace(40.0, 2e5, 400)
    assert main(["check", str(pressure_log(tmp_path, rig_text, pressure_a_pa=gauge))]) == 2
    assert "it looks like a gauge pressure in Pa" in capsys.readouterr().err


@pytest.mark.parametrize(("reading", "mend"), [(21.0, "degC"), (0.0, "degC"), (65535.0, "omit")])
def test_an_impossible_temperature(
    reading: float,
    mend: str,
    tmp_path: Path,
    rig_text: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Degrees Celsius are named where they would be possible."""
    path = pressure_log(tmp_path, rig_text, temperature_k=np.full(400, reading))
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert mend in said.split("; ")[1] and ("degC" in said) == (mend == "degC")


def test_a_position_with_another_zero(
    tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its span is the stroke's: not the stroke is wrong, but the zero, or the unit."""
    path = pressure_log(tmp_path, rig_text)
    frame = pd.read_csv(path)
    frame.assign(theta_rad=frame.theta_rad + 20.0).to_csv(path, index=False)
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert "its zero is not the middle of the stroke" in said and "stroke_m" not in said


@pytest.mark.parametrize("seed", [2, 7, 11])
def test_a_coarse_sensor_that_repeats_by_chance_is_not_stuck(
    seed: int, tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Noise of 0.55 steps repeats a reading 25 to 30 times in a row in 200 000 samples."""
    rng, rows = np.random.default_rng(seed), 200_000
    (tmp_path / "rig.toml").write_text(rig_text)
    time = 0.001 * np.arange(rows)
    pressure = 1e5 + 100.0 * np.round(0.55 * rng.standard_normal(rows))
    frame = pd.DataFrame({"time_s": time, "pressure_a_pa": pressure, "theta_rad": 0.0})
    frame.to_csv(tmp_path / "run.csv", index=False)
    assert main(["check", str(tmp_path / "run.csv"), "--json"]) == 0
    (log,) = json.loads(capsys.readouterr().out)["logs"]
    (found,) = (c for c in log["channels"] if c["name"] == "pressure_a_pa")
    assert found["stuck_s"] == 0.0
    pressure[5000:5200] = pressure[5000]
    frame.assign(pressure_a_pa=pressure).to_csv(tmp_path / "run.csv", index=False)
    assert main(["check", str(tmp_path / "run.csv"), "--json"]) == 0
    (log,) = json.loads(capsys.readouterr().out)["logs"]
    assert max(c["stuck_s"] for c in log["channels"]) == pytest.approx(0.2, abs=0.05)


def test_a_few_readings_out_of_range_are_to_be_excluded(
    tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A cable that came out: the unit is right, and the line says when."""
    pressure = np.full(400, 2e5)
    pressure[100:121] = -3e4
    path = pressure_log(tmp_path, rig_text, pressure_a_pa=pressure)
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert "21 of 400 readings" in said and "from 0.1 to 0.12 s: exclude" in said
    assert "--exclude" in said and "kPa" not in said
    assert main(["check", str(path), "--exclude", "@0.09:0.13"]) == 0


def test_a_bag_s_folder_is_named_for_what_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").touch()
    assert main(["check", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert "is a ROS 2 bag, not a log" in said and "or map its columns here" in said


def test_a_log_declared_of_the_valve_that_stays_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tests asked for are there, of the other valve: that is said, not only what is needed."""
    shutil.copy(BUNDLED / "rig.toml", tmp_path / "rig.toml")
    shutil.copy(BUNDLED / "valve_discrete_b.parquet", tmp_path / "b.parquet")
    path = tmp_path / "campaign.toml"
    path.write_text(
        'rig = "rig.toml"\n[[log]]\nkind = "valve-discrete"\nfile = "b.parquet"\nvalve = "a"\n'
    )
    said = " ".join(told(path, capsys))
    assert "valve_a is not logged, or never switched on" in said
