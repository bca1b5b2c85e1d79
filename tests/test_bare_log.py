"""Logs without a rig file: what they show is taken from them, the rest said as assumed."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from friction_trials import UNWRITTEN
from golden_folder import BUNDLED, golden_bundle

import sysid as si
from sysid.blocks.html import typeset
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.bare_rig import read_bare_logs
from sysid.io.conversion import convert
from sysid.io.log_constants import pwm_period
from sysid.io.rig import rig_from_content
from sysid.io.samples import Trial
from sysid.io.units import parse_map
from sysid.parameters import assumptions, read_bundle

LOGS = {
    "friction": "friction_static",
    "valve-discrete": "valve_discrete_a",
    "valve-pwm": "valve_pwm_a",
}
# Of the true rig: datasets/bundled/rig.toml.
SUPPLY, ATMOSPHERE, END = 312e3, 100.2e3, 1.558
RIG = {"rig": {"name": "axis", "orientation": "horizontal"}}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, without a rig file in or above it."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(folder: Path, kind: str, name: str = "run.csv", **columns: Any) -> Path:
    """The bundled log of a kind as a CSV, with columns changed (None: left out)."""
    frame = pd.read_parquet(BUNDLED / f"{LOGS[kind]}.parquet")
    for column, change in columns.items():
        if change is None:
            frame = frame.drop(columns=column)
        else:
            frame[column] = change(frame[column]) if callable(change) else change
    frame.to_csv(folder / name, index=False)
    return folder / name


@pytest.mark.parametrize("kind", LOGS)
def test_the_literal_command(kind: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if kind == "valve-pwm":
        part_of(folder, slice(None, None, 3))
    else:
        put(folder, kind)
    assert main(["fit", kind, "run.csv"]) == 0
    said = capsys.readouterr()
    bundle = read_bundle(folder / f"run.{kind}.bundle.json")
    page = (folder / f"run.{kind}.report.html").read_text()
    lines = said.out.splitlines()
    assert lines[-2:] == [
        f"written: run.{kind}.bundle.json",
        f"written: run.{kind}.report.html",
    ]
    assumed = [line for line in lines if line.startswith("assumed: ")]
    assert any("chamber A 0.034 l (reference rig): " in line for line in assumed)
    keys = [key for one in assumptions(bundle) for key in one.keys]
    assert sorted(keys) == sorted(bundle.rig.assumed) and len(keys) == len(set(keys))
    for one in assumptions(bundle):
        assert one.line in assumed
        first_screen = page.partition('<span class="count">1</span>')[0].replace("&#39;", "'")
        assert typeset(one.text) in first_screen
    air = bundle.rig.require("air", "")
    assert air.atmospheric_pressure_pa == pytest.approx(ATMOSPHERE, rel=1e-3)
    if kind != "friction":
        assert air.supply_pressure_pa == pytest.approx(SUPPLY, rel=1e-3)
        assert bundle.rig.travel == pytest.approx(2.0 * END, rel=1e-3)
    assert ("pwm.period_s" in keys) == (kind != "valve-pwm")
    # Again: its own files are replaced.
    assert main(["fit", kind, "run.csv", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["bundle"] == f"run.{kind}.bundle.json"
    assert told["report"] == f"run.{kind}.report.html"
    assert {key for one in told["assumed"] for key in one["keys"]} == set(told["rig"]["assumed"])


def test_the_report_says_where_assumed_constants_are_corrected(folder: Path) -> None:
    put(folder, "friction")
    pages = []
    for words in (
        ["fit", "friction", "run.csv"],
        ["fit", "friction", "run.csv", "--rig", "rig.toml"],
    ):
        assert main(words) == 0
        pages.append((folder / "run.friction.report.html").read_text())
        for written in folder.glob("run.friction.*"):
            written.unlink()
        main(["init", "--from", "run.csv", "rig.toml"])
    bare, own = pages
    assert "no rig file declares" in bare
    assert "Assumed in the rig file" in own and "no rig file declares" not in own


def test_files_of_another_fit_are_not_replaced(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(folder, "friction")
    words = ["fit", "friction", "run.csv"]
    assert main([*words, "--no-report"]) == 0
    before = (folder / "run.friction.bundle.json").read_bytes()
    put(folder, "friction", motor_torque_nm=lambda torque: 1.1 * torque)
    capsys.readouterr()
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "run.friction.bundle.json" in said and "in the way" in said and "-o" in said
    assert (folder / "run.friction.bundle.json").read_bytes() == before
    assert main([*words, "-o", "other.json"]) == 0  # the report's name is free
    put(folder, "friction", motor_torque_nm=lambda torque: 1.2 * torque)
    assert main([*words, "-o", "none"]) == 2
    assert "run.friction.report.html" in capsys.readouterr().err


def test_nothing_is_written_where_that_is_asked_for(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(folder, "valve-discrete")
    assert main(["fit", "valve-discrete", "run.csv", *UNWRITTEN, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["bundle"] is None and told["report"] is None
    assert [path.name for path in folder.iterdir()] == ["run.csv"]


def test_init_from_a_log_gives_the_same_fit(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(folder, "valve-discrete")
    words = ["fit", "valve-discrete", "run.csv", *UNWRITTEN, "--json"]
    assert main(words) == 0
    bare = json.loads(capsys.readouterr().out)
    assert main(["init", "--from", "run.csv"]) == 0
    assert main(["init", "--from", "run.csv"]) == 2  # it is there now
    written = tomllib.loads((folder / "rig.toml").read_text())
    assert written == bare["rig"]
    capsys.readouterr()
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["valves"] == bare["valves"] and told["rig"] == bare["rig"]
    # A corrected constant that is taken out of the list is a declared one.
    text = (folder / "rig.toml").read_text()
    text = text.replace('    "cylinder.area_a_m2",\n', "").replace("0.0004524", "0.0004325")
    (folder / "rig.toml").write_text(text)
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert "cylinder.area_a_m2" not in told["rig"]["assumed"]
    flows = [one["valves"]["a"]["discrete"]["c_fill"]["value"] for one in (told, bare)]
    assert flows[0] / flows[1] == pytest.approx(0.0004325 / 0.0004524, rel=1e-6)


def test_a_part_is_added_to_a_bundle_with_its_rig(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(folder, "friction", "friction.csv")
    put(folder, "valve-discrete", "valve.csv")
    assert main(["fit", "friction", "friction.csv", "-o", "all.json", "--no-report"]) == 0
    assert "air.supply_pressure_pa" in read_bundle(folder / "all.json").rig.assumed
    assert main(["fit", "valve-discrete", "valve.csv", "--into", "all.json", "--no-report"]) == 0
    both = read_bundle(folder / "all.json")
    assert both.friction is not None and both.valve("a").discrete is not None
    assert "air.supply_pressure_pa" not in both.rig.assumed
    assert both.rig.require("air", "").supply_pressure_pa == pytest.approx(SUPPLY, rel=1e-3)
    for _ in range(2):  # a page of its own, replaced by the same fit
        assert main(["fit", "valve-discrete", "valve.csv", "--into", "all.json"]) == 0
    # A rig file that contradicts the bundle's is refused, as it was.
    shutil.copy(BUNDLED / "rig.toml", folder)
    capsys.readouterr()
    words = ["fit", "valve-discrete", "valve.csv", "--into", "all.json", "--no-report"]
    assert main(words) == 2
    assert "another rig file" in capsys.readouterr().err


def test_volts_without_a_torque_constant_are_no_torque(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """0.0795 Nm a volt: the breakaway of 0.287 Nm is 3.61 V, and no Nm is invented."""
    frame = pd.read_parquet(BUNDLED / "friction_static.parquet")
    frame["motor_volts"] = frame.pop("motor_torque_nm") / 0.0795
    frame.to_csv(folder / "run.csv", index=False)
    assert main(["fit", "friction", "run.csv", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    static = told["friction"]["static_nm"]
    assert static["value"] is None and not static["identified"]
    assert "torque_per_volt_nm is not declared" in static["reason"]
    assert float(static["reason"].split()[0]) == pytest.approx(3.6, rel=0.03)
    assert "motor" not in told["rig"] and (folder / "run.friction.report.html").is_file()


def test_a_motor_without_pressures_is_a_motor_alone(folder: Path) -> None:
    path = put(folder, "friction", pressure_a_pa=None, pressure_b_pa=None)
    rig = read_bare_logs([path], {}).rig
    assert rig.is_motor_alone and not any(key.startswith("air.") for key in rig.assumed)


def test_a_linear_log_is_of_a_linear_rig(folder: Path) -> None:
    path = put(folder, "valve-discrete", position_m=0.06, theta_rad=None)
    rig = read_bare_logs([path], {}).rig
    assert rig.is_linear and rig.require("cylinder", "").stroke_m == pytest.approx(0.12)
    assert "cylinder.stroke_m" not in rig.assumed


def test_an_angle_whose_unit_was_stated_is_not_asked_for_it(tmp_path: Path) -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    table = {"time_s": time, "theta_rad": 1.9 * np.sin(3.0 * time), "motor_volts": np.sin(time)}
    pd.DataFrame(table).to_csv(tmp_path / "turns.csv", index=False)

    def asks(entries: list[str], name: str) -> bool:
        convert([tmp_path / "turns.csv"], tmp_path / name, maps=["time_s=time_s", *entries])
        return any("in degrees" in line for line in read_bare_logs([tmp_path / name], {}).notices)

    volts = "motor_volts=motor_volts"
    assert not asks(["theta_rad=theta_rad:turn", volts], "stated.csv")
    pd.DataFrame({**table, "theta_rad": 10.0 * time}).to_csv(tmp_path / "turns.csv", index=False)
    assert asks(["theta_rad=theta_rad", volts], "bare.csv")


def test_a_speed_s_integral_is_not_asked_for_degrees(folder: Path) -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    table = {"time_s": time, "velocity_rad_per_s": 20.0 + np.sin(time)}
    pd.DataFrame({**table, "motor_torque_nm": np.sin(time)}).to_csv("wheel.csv", index=False)
    found = read_bare_logs([Path("wheel.csv")], {})
    (trial,) = found.logs[0].trials
    assert np.ptp(trial["theta_rad"]) > 70.0
    assert not any("in degrees" in line for line in found.notices)


def test_a_period_that_varies_does_not_contradict_the_one_taken_from_it(folder: Path) -> None:
    steps = np.random.default_rng(1).choice([0.016, 0.026, 0.049], 800, p=[0.4, 0.4, 0.2])
    time = np.cumsum(steps)
    assert np.mean(steps) > 1.02 * np.median(steps)
    table = {"theta_rad": np.sin(time), "motor_torque_nm": np.cos(time)}
    pd.DataFrame({"time_s": time, **table}).to_csv("uneven.csv", index=False)
    found = read_bare_logs([Path("uneven.csv")], {})
    (log,) = found.logs
    assert not any("period_s is wrong" in line for line in (*log.notices, *log.contradictions))
    declared = rig_from_content({**RIG, "sampling": {"period_s": 0.02}}, "rig.toml")
    (wrong,) = [
        line for line in si.read_log("uneven.csv", declared).contradictions if "is wrong" in line
    ]
    assert "sampled every 0.026 s, the rig file declares 0.02 s" in wrong


def test_logged_supply_and_temperature_are_shown(folder: Path) -> None:
    path = put(folder, "valve-discrete", supply_pressure_pa=313e3, temperature_k=301.0)
    air = read_bare_logs([path], {}).rig.require("air", "")
    assert (air.supply_pressure_pa, air.temperature_k) == (313e3, 301.0)


SLIPS: dict[str, tuple[dict[str, Any], str, int]] = {
    "kilopascals": ({"pressure_a_pa": lambda p: p / 1e3}, "kPa", 2),
    "gauge, all": ({f"pressure_{s}_pa": lambda p: p - 1e5 for s in "ab"}, "gauge pressure", 2),
    "gauge": ({"pressure_a_pa": lambda p: p - 100e3}, "not plausible as absolute Pa", 2),
    "atmosphere twice": ({"pressure_a_pa": lambda p: p + 1e5}, "added twice", 0),
    "degrees": ({"theta_rad": np.degrees}, "in degrees", 0),
    "milliseconds": ({"time_s": lambda t: 1e3 * t}, "too slow for an actuator's motion", 0),
    "inverted": ({"valve_a": lambda v: 1 - v}, "pressure", 3),
}


@pytest.mark.parametrize("name", SLIPS)
def test_assumptions_hide_no_slip(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns, words, _ = SLIPS[name]
    put(folder, "valve-discrete", **columns)
    main(["fit", "valve-discrete", "run.csv", *UNWRITTEN])
    assert words in capsys.readouterr().err


# --- what a log shows ---------------------------------------------------------------------


def pulsed(period: float, duty: float, rows: int, noise: float, sampling: float = 1e-3) -> Trial:
    """A chamber that fills by pulses of 2 ms or so, as a sensor with noise (Pa) sees it."""
    fine = np.arange(0.0, rows * sampling, 1e-5)
    flow = 2e6 * ((fine % period) < duty * period) * np.exp(-fine / 0.4)
    pressure = 1e5 + np.cumsum(flow) * 1e-5
    time = sampling * np.arange(rows)
    seen = np.interp(time, fine, pressure) + np.random.default_rng(rows).normal(0.0, noise, rows)
    channels = {"duty_a": np.full(rows, duty), "pressure_a_pa": seen}
    return Trial("1", time, channels, "made")


@pytest.mark.parametrize("period", [0.0034, 0.004, 0.005, 1.0 / 150.0, 0.01, 0.025])
def test_the_period_of_pulses_is_read_from_their_ripple(period: float) -> None:
    trials = [pulsed(period, duty, 800, 150.0) for duty in (0.2, 0.5, 0.8)]
    assert pwm_period(trials) == pytest.approx(period, rel=1e-3)


def test_noise_alone_shows_no_period() -> None:
    found = [pwm_period([pulsed(0.005, 1e-9, 800, 150.0)]) for _ in range(3)]
    assert found == [None, None, None]


# --- what rests on them -------------------------------------------------------------------


def assumed_bundle(folder: Path) -> Path:
    """A whole bundle whose piston area nobody declared."""
    content = json.loads(golden_bundle("diagnosed").read_text())
    content["rig"] = {"assumed": ["cylinder.area_a_m2", "sampling.period_s"], **content["rig"]}
    path = folder / "bundle.json"
    path.write_text(json.dumps(content))
    return path


def test_controllers_rest_on_assumptions_only_where_they_are_accepted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bundle = assumed_bundle(folder)
    words = ["export", str(bundle), "--format", "c", "-o", "model.h"]
    assert main(words) == 0
    assert "--accept-assumed" in capsys.readouterr().err
    without = (folder / "model.h").read_text()
    assert "#define SYSID_HAS_CONTROLLERS 0" in without
    assert "assumed: piston area A" in without and "; ASSUMED */" in without
    assert main([*words, "--accept-assumed"]) == 0
    assert "#define SYSID_HAS_CONTROLLERS 1" in (folder / "model.h").read_text()
    run = [
        "control",
        str(bundle),
        "--controller",
        "pva",
        "--trajectory",
        "1",
        "--mode",
        "pneumatic",
    ]
    assert main(run) == 2
    said = capsys.readouterr().err
    assert "cylinder.area_a_m2" in said and "sampling.period_s" not in said
    read = si.read_bundle(bundle)
    options: dict[str, Any] = {"trajectory": 1, "mode": "pneumatic", "duration_s": 0.1}
    with pytest.raises(InputError, match="undeclared constants"):
        si.control(read, "pva", **options)
    assert si.control(read, "pva", accept_assumed=True, **options).faults == ()


def test_assumed_names_constants_that_are_there(rig_text: str) -> None:
    content = tomllib.loads(rig_text)
    wrong: list[tuple[Any, str]] = [
        ("cylinder.area_a_m2", "not a list"),
        (["cylinder.arae"], "cylinder.arae"),
        (["nothing.at_all"], "nothing.at_all"),
    ]
    for assumed, words in wrong:
        with pytest.raises(InputError, match=words):
            rig_from_content({"assumed": assumed, **content}, "rig.toml")
    read: Callable[[list[str]], Any] = lambda keys: rig_from_content(  # noqa: E731
        {"assumed": keys, **content}, "rig.toml"
    )
    assert read(["cylinder.area_a_m2"]).assumed == ("cylinder.area_a_m2",)


def part_of(folder: Path, tests: slice, rows: slice = slice(None)) -> Path:
    """Some tests of the bundled log under PWM, and of them some rows."""
    frame = pd.read_parquet(BUNDLED / "valve_pwm_a.parquet")
    kept = [own.iloc[rows] for _, own in list(frame.groupby("test"))[tests]]
    pd.concat(kept).to_csv(folder / "run.csv", index=False)
    return folder / "run.csv"


@pytest.mark.parametrize("tests", [slice(0, 25), slice(25, 50)], ids=["filling", "emptying"])
def test_tests_of_one_direction_show_the_supply(
    tests: slice, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part_of(folder, tests)
    words = ["fit", "valve-pwm", "run.csv", "--surface", "bipolynomial", *UNWRITTEN, "--json"]
    assert main(words) == 0
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert told["rig"]["air"]["supply_pressure_pa"] == pytest.approx(SUPPLY, rel=1e-3)
    assert "the rig file" not in said.err and "from the log: " in said.err


def test_low_duties_leave_the_supply_assumed_but_leave_no_test_out(folder: Path) -> None:
    rig = read_bare_logs([part_of(folder, slice(0, 18))], {}).rig
    supply = rig.require("air", "").supply_pressure_pa
    assert "air.supply_pressure_pa" in rig.assumed and supply >= 300e3


def test_a_period_that_rows_are_too_far_apart_for_is_assumed(folder: Path) -> None:
    """Every fourth row: pulses of 5 ms look like those of 20 ms, but a third as large."""
    rig = read_bare_logs([part_of(folder, slice(None), slice(None, None, 4))], {}).rig
    assert "pwm.period_s" in rig.assumed and rig.require("pwm", "").period_s == 0.005


def test_a_gauge_shows_no_atmosphere(folder: Path) -> None:
    path = put(folder, "valve-discrete", pressure_a_pa=lambda p: p - 105e3, pressure_b_pa=None)
    bare = read_bare_logs([path], parse_map(["pressure_a_pa=pressure_a_pa:Pa(g)"]))
    assert "air.atmospheric_pressure_pa" in bare.rig.assumed
    assert bare.rig.require("air", "").atmospheric_pressure_pa == 100e3
    lowest = min(t["pressure_a_pa"].min() for t in bare.logs[0].trials)
    assert lowest == pytest.approx(ATMOSPHERE - 5e3, rel=0.01)


def test_numbers_that_a_part_takes_out_of_a_bundle_are_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(folder, "friction")
    frame = pd.read_parquet(BUNDLED / "friction_sliding.parquet")
    frame.to_csv(folder / "sliding.csv", index=False)
    assert main(["fit", "friction", "sliding.csv", "-o", "all.json", "--no-report"]) == 0
    capsys.readouterr()
    assert main(["fit", "friction", "run.csv", "--into", "all.json", "--no-report"]) == 0
    assert "coulomb_nm, viscous_nm_s_per_rad" in capsys.readouterr().err


def test_an_assumed_inertia_gives_way_to_that_of_motion(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = pd.read_parquet(BUNDLED / "friction_motion.parquet")
    frame.to_csv(folder / ("x" * 150 + ".csv"), index=False)
    assert main(["fit", "friction", "x" * 150 + ".csv", *UNWRITTEN, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["friction"]["inertia_kg_m2"]["value"] == pytest.approx(0.0198, rel=0.02)
    resting = [one for one in told["assumed"] if "inertia.equivalent_kg_m2" in one["keys"]]
    assert [one["numbers"] for one in resting] == [[]]


def test_maps_serve_bare_logs(folder: Path) -> None:
    path = put(folder, "valve-discrete", pressure_a_pa=None, P1=0.0)
    frame = pd.read_csv(path)
    true = pd.read_parquet(BUNDLED / "valve_discrete_a.parquet")
    frame["P1"] = (true["pressure_a_pa"] - 100e3) / 1e3
    frame.to_csv(path, index=False)
    maps = parse_map(["pressure_a_pa=P1:kPa(g)"])
    air = read_bare_logs([path], maps).rig.require("air", "")
    assert air.supply_pressure_pa == pytest.approx(SUPPLY, rel=1e-3)


def test_a_time_in_milliseconds_is_mapped_as_such(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = put(folder, "valve-discrete")
    frame = pd.read_csv(path).rename(columns={"time_s": "time_ms"})
    frame.to_csv(path, index=False)
    assert main(["fit", "valve-discrete", "run.csv"]) == 2
    assert '--map "time_s=time_ms:ms"' in capsys.readouterr().err
