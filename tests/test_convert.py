"""`sysid convert`: maps, recipes, what is written, what is refused, and measured files."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from foreign_files import (
    ANGLE_DEG,
    ATMOSPHERE,
    PRESSURE_KPA,
    SAMPLES,
    TIME,
    log_of,
    plain,
    refused,
    text_of,
)
from scipy.io import savemat

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.conversion import ConversionReport, convert
from sysid.io.tables import read_table

# --- the whole command ----------------------------------------------------------------


def test_output_says_where_it_comes_from(tmp_path: Path) -> None:
    foreign, out = plain(tmp_path, t=TIME, q=ANGLE_DEG, spare=TIME), tmp_path / "log.csv"
    report = convert(foreign, out, maps=["time_s=t:s", "theta_rad=q:deg"], constants=["test=7"])
    digest = hashlib.sha256(foreign.read_bytes()).hexdigest()
    lines = out.read_bytes().decode().split("\r\n")
    assert lines[0] == f"# source: rec.csv (text, separated by commas), SHA-256 {digest}"
    assert lines[1:5] == [
        "# map: time_s=t:s",
        "# map: theta_rad=q:deg",
        "# map: test=7 (constant)",
        "time_s,test,theta_rad",
    ]
    assert report.notices == ("ignored, not mapped: spare",)
    assert report.tests == ("7",)
    assert json.loads(json.dumps(report.to_json()))["sources"][0]["sha256"] == digest


def test_canonical_columns_pass_without_a_map(tmp_path: Path) -> None:
    foreign = plain(tmp_path, time_s=TIME, theta_rad=ANGLE_DEG, test=["a,b"] * SAMPLES, odd=TIME)
    report = convert(foreign, tmp_path / "log.csv")
    frame = log_of(tmp_path / "log.csv")
    assert list(frame.columns) == ["time_s", "test", "theta_rad"]
    assert set(frame["test"]) == {"a,b"}
    assert report.unmapped == ("odd",)


def test_gauge_pressures_take_the_atmosphere_of_the_nearest_rig(
    tmp_path: Path, rig_text: str
) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    (tmp_path / "lab.csv").write_text("t,P1\n0,200\n1,201\n")
    maps = ["time_s=t:ms", "pressure_a_pa=P1:kPa(g)"]
    report, frame = converted(tmp_path / "lab.csv", tmp_path / "log.csv", maps=maps)
    np.testing.assert_allclose(frame["pressure_a_pa"], [3e5, 3.01e5])
    assert any("100000 Pa, is added to gauge" in notice for notice in report.notices)
    _, frame = converted(tmp_path / "lab.csv", tmp_path / "log.csv", maps=maps, atmosphere_pa=9e4)
    np.testing.assert_allclose(frame["pressure_a_pa"], [2.9e5, 2.91e5])


def test_period_in_place_of_a_time_column(tmp_path: Path) -> None:
    foreign, out = plain(tmp_path, q=ANGLE_DEG), tmp_path / "log.csv"
    convert(foreign, out, maps=["theta_rad=q:deg"], period_s=0.001)
    assert log_of(out)["time_s"].tolist() == [float(f"{k / 1000:.3f}") for k in range(SAMPLES)]
    with pytest.raises(InputError, match=r"time_s is not mapped; it has q .*--period"):
        convert(foreign, out, maps=["theta_rad=q:deg"])


@pytest.mark.parametrize("duty", [False, True])
def test_settled_flows_have_no_time(duty: bool, tmp_path: Path) -> None:
    """As a standard's table has them: over two pressures, or over a duty."""
    flow = np.linspace(900.0, 0.0, 12)
    over = {"u": flow / 9.0} if duty else {"p1": np.full(12, 6.3), "p2": np.linspace(1.0, 6.3, 12)}
    foreign, out = plain(tmp_path, Q=flow, **over), tmp_path / "log.csv"
    maps = ["duty_a=u:%"]
    if not duty:
        maps = ["upstream_pressure_pa=p1:bar", "downstream_pressure_pa=p2:bar"]
    report = convert(foreign, out, maps=["flow_a_kg_s=Q:l/min(ANR)", *maps])
    assert sum("holds no time" in line for line in report.notices) == 1
    frame = log_of(out)
    assert frame["time_s"].tolist() == list(range(12))
    assert frame["flow_a_kg_s"].iloc[0] == pytest.approx(900.0 / 60000.0 * 1.185, rel=1e-3)
    # A flow alone is none.
    with pytest.raises(InputError, match="time_s is not mapped"):
        convert(foreign, out, maps=["flow_a_kg_s=Q:l/min(ANR)"])


def test_several_files_are_the_tests_of_one_log(tmp_path: Path) -> None:
    paths = []
    for k, name in enumerate(("a/left.csv", "a/right.csv", "b/left.csv")):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        pd.DataFrame({"t": TIME, "q": ANGLE_DEG + k}).to_csv(path, index=False)
        paths.append(path)
    out = tmp_path / "log.csv"
    report = convert(paths, out, maps=["time_s=t", "theta_rad=q:deg"])
    assert report.tests == ("left-1", "right", "left-2")
    frame = log_of(out)
    assert len(frame) == 3 * SAMPLES
    means = frame.groupby("test")["theta_rad"].mean()
    assert means["left-2"] - means["left-1"] == pytest.approx(np.deg2rad(2.0), rel=1e-9)
    with pytest.raises(InputError, match="several files are several tests"):
        convert(paths, out, maps=["time_s=t", "theta_rad=q:deg"], constants=["test=1"])


RECIPE = """
[map]
time_s = "#1:ms"
pressure_a_pa = "#2:kPa(g)"
theta_rad = "#3:rad"
[constants]
temperature_k = 293.15
[options]
delimiter = ";"
decimal = ","
header = false
skip_rows = 1
atmosphere_pa = 101325.0
"""


def test_recipe_and_what_the_command_line_lays_over_it(tmp_path: Path) -> None:
    foreign, spec, out = tmp_path / "rec.txt", tmp_path / "lab.toml", tmp_path / "log.csv"
    foreign.write_text("preamble\n" + text_of(";", ",", None))
    spec.write_text(RECIPE)
    convert(foreign, out, maps=["theta_rad=#3:deg"], spec_file=spec)
    frame = log_of(out)
    assert set(frame.pop("temperature_k")) == {293.15}
    np.testing.assert_allclose(frame["pressure_a_pa"], PRESSURE_KPA * 1e3 + ATMOSPHERE, rtol=1e-13)
    np.testing.assert_allclose(frame["theta_rad"], np.deg2rad(ANGLE_DEG), rtol=1e-13, atol=1e-15)


def test_rows_by_command_line_win_over_the_recipe(tmp_path: Path) -> None:
    foreign, spec = plain(tmp_path, t=TIME, q=ANGLE_DEG), tmp_path / "lab.toml"
    out = tmp_path / "log.csv"
    spec.write_text('[map]\ntime_s = "t"\ntheta_rad = "q"\n[options]\nrows = "0:3"\n')
    arguments = ["convert", str(foreign), "--spec", str(spec), "-o", str(out)]
    for extra, kept, said in ([], [0, 1, 2], "0:3"), (["--rows", "-2:, 5:9:3"], [5, 8, 48, 49], ""):
        assert main([*arguments, *extra]) == 0
        np.testing.assert_allclose(log_of(out)["theta_rad"], ANGLE_DEG[kept], rtol=1e-13)
        assert f"# map: rows {said or extra[-1]}\n" in out.read_text()


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[map]\ntime_s = 3\n", "time_s = 3 is not text"),
        ("[map]\ntime = 't'\n", "'time' is not a column of the log format; did you mean time_s"),
        ("[optoins]\nheader = false\n", "section optoins is not a key; did you mean.*options"),
        ("[options]\nheadr = false\n", r"\[options\] headr is not a key"),
        ("[options]\nheader = 'no'\n", "header = 'no' is not true or false"),
        ("[options]\nskip_rows = true\n", "skip_rows = True is not a whole number"),
        ("[options]\nsampling_period_s = '1 ms'\n", "is not a number"),
        (
            "[options]\natmosphere_pa = 1.0\n",
            "1 Pa is not an atmospheric pressure; give Pa: about 101325",
        ),
        ("[constants]\ntemperature_k = 'warm'\n", "temperature_k = 'warm' is not a number"),
        ("[constants]\ntemperature_k = [1]\n", "is neither a number nor text"),
        ("[constants]\ntime_s = 1\n", "'time_s' cannot be a constant"),
        ("map = 3\n", r"map is not a section; write \[map\]"),
        ("[map\n", "is not valid TOML"),
    ],
)
def test_recipes_that_are_refused(tmp_path: Path, text: str, what: str) -> None:
    foreign, spec = plain(tmp_path, time_s=TIME, theta_rad=ANGLE_DEG), tmp_path / "lab.toml"
    spec.write_text(text)
    with pytest.raises(InputError, match=what):
        convert(foreign, tmp_path / "log.csv", spec_file=spec)
    assert not (tmp_path / "log.csv").exists()


# --- what is refused ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("heading", "maps"),
    [
        ("Torque,Angle (deg),Time (ms)", r"time_s=Time \(ms\):ms.*motor_torque_nm=Torque:Nm"),
        ("Time,Duty,Pressure1 [bar]", 'time_s=Time:s.*duty_a=Duty"'),
        ("tick,Chamber_P1 [bar],y", r"time_s=tick:s.*pressure_a_pa=Chamber_P1 \[bar\]:bar\(g\)"),
        ("no,MotorVoltage,y", "time_s=no:s.*motor_volts=MotorVoltage:V"),
        ("a,b,c", r"time_s=a:s.*pressure_a_pa=b:kPa\(g\)"),
    ],
)
def test_the_example_of_a_map_follows_the_names(tmp_path: Path, heading: str, maps: str) -> None:
    foreign = tmp_path / "rec.csv"
    foreign.write_text(f"{heading}\n" + "".join(f"{k},{k + 1},{k + 2}\n" for k in range(9)))
    with pytest.raises(InputError, match=maps):
        convert(foreign, tmp_path / "log.csv")


BAD_REQUESTS: dict[str, tuple[dict[str, Any], str]] = {
    "no map": ({}, r"rec.csv: no column is mapped.*t \(50 values, first 0\), q .*--map"),
    "only time": ({"maps": ["time_s=t"]}, "no column is mapped"),
    "wrong column": ({"maps": ["time_s=t", "theta_rad=qq"]}, "no column 'qq'.*did you mean q"),
    "wrong number": ({"maps": ["time_s=#9", "theta_rad=q"]}, "no column #9.*#1 to #3"),
    "unknown unit": ({"maps": ["theta_rad=q:degs/"]}, "is not a known unit"),
    "wrong kind": ({"maps": ["theta_rad=q:kPa"]}, "is a pressure, not an angle"),
    "target twice": ({"maps": ["theta_rad=q", "theta_rad=t"]}, "theta_rad is mapped twice"),
    "no atmosphere": ({"maps": ["time_s=t", "pressure_a_pa=q:bar(g)"]}, "--atmosphere"),
    "mapped and constant": (
        {"maps": ["theta_rad=q"], "constants": ["theta_rad=1"]},
        "theta_rad is both mapped and a constant",
    ),
    "constant without value": ({"constants": ["theta_rad"]}, "has no '='"),
    "constant infinite": ({"constants": ["theta_rad=inf"]}, "'inf' is not a number"),
    "period and time": (
        {"maps": ["time_s=t", "theta_rad=q"], "period_s": 0.1},
        "--period: is given in addition to a mapped time_s",
    ),
    "period of nothing": ({"maps": ["theta_rad=q"], "period_s": 0.0}, "not a sampling period"),
    "atmosphere in kPa": (
        {"maps": ["theta_rad=q"], "atmosphere_pa": 101.3},
        "is not an atmospheric pressure",
    ),
    "negative skip": ({"maps": ["theta_rad=q"], "skip_rows": -1}, "skip_rows: is negative"),
    "no slice of rows": ({"maps": ["theta_rad=q"], "rows": "3"}, "--rows: .*'3' is not a slice"),
    "no rows kept": (
        {"maps": ["time_s=t", "theta_rad=q"], "rows": "60:"},
        "'60:' keeps none of its 50 rows; fix --rows",
    ),
    "all skipped": ({"maps": ["theta_rad=q"], "skip_rows": 999}, "holds no rows"),
    "text column": (
        {"maps": ["time_s=t", "theta_rad=word"]},
        r"rec.csv, line 2: column word \(for theta_rad\) holds 'on', not a number",
    ),
}


@pytest.mark.parametrize("case", BAD_REQUESTS)
def test_requests_that_are_refused(tmp_path: Path, case: str) -> None:
    arguments, what = BAD_REQUESTS[case]
    foreign = plain(tmp_path, t=TIME, q=ANGLE_DEG, word=["on"] * SAMPLES)
    refused(foreign, tmp_path / "log.csv", what, **arguments)


def test_lengths_that_differ(tmp_path: Path) -> None:
    foreign = tmp_path / "rec.mat"
    savemat(foreign, {"t": TIME, "q": ANGLE_DEG[:-1]})
    what = "differ in length: t has 50, q has 49"
    refused(foreign, tmp_path / "log.csv", what, maps=["time_s=t", "theta_rad=q:deg"])


@pytest.mark.parametrize(("value", "word"), [(np.nan, "empty"), (np.inf, "infinite")])
def test_a_hole_is_named_by_its_row(tmp_path: Path, value: float, word: str) -> None:
    angle = ANGLE_DEG.copy()
    angle[7] = value
    savemat(tmp_path / "rec.mat", {"t": TIME, "q": angle})
    entries = ["time_s=t", "theta_rad=q:deg"]
    refused(
        tmp_path / "rec.mat", tmp_path / "log.csv", f"row 8: column q .* is {word}", maps=entries
    )
    foreign = plain(tmp_path, t=TIME, q=angle)
    refused(foreign, tmp_path / "log.csv", f"rec.csv, line 9: column q .* is {word}", maps=entries)
    savemat(tmp_path / "rec.mat", {"t": TIME, "q": ANGLE_DEG, "spare": angle})
    assert convert(tmp_path / "rec.mat", tmp_path / "log.csv", maps=entries).rows == SAMPLES


def test_matlab_objects_are_told_apart_from_damage(tmp_path: Path) -> None:
    foreign = tmp_path / "rec.mat"
    savemat(foreign, {"t": TIME, "q": ANGLE_DEG, "z": ANGLE_DEG + 1j, "s": "text"})
    report = convert(foreign, tmp_path / "log.csv", maps=["time_s=t", "theta_rad=q"])
    assert report.unmapped == ("z.real", "z.imag", "z", "s")
    said = "z .* is not a column: complex: its parts are z.real and z.imag"
    refused(foreign, tmp_path / "x.csv", said, maps=["time_s=z"])


def test_places(tmp_path: Path) -> None:
    foreign = plain(tmp_path, time_s=TIME, theta_rad=ANGLE_DEG)
    out = tmp_path / "log.csv"
    refused(tmp_path / "none.mat", out, "none.mat: no such file")
    refused(tmp_path, out, "is a directory")
    refused(foreign, tmp_path / "missing" / "log.csv", "its folder .* does not exist; create it")
    with pytest.raises(InputError, match="is the file to be converted"):
        convert(foreign, foreign)
    with pytest.raises(InputError, match="is a directory"):
        convert(foreign, tmp_path)
    assert read_table(foreign, ()).header == ("time_s", "theta_rad")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_file_that_may_not_be_read(tmp_path: Path) -> None:
    foreign = plain(tmp_path, time_s=TIME, theta_rad=ANGLE_DEG)
    foreign.chmod(0o000)
    refused(foreign, tmp_path / "log.csv", "may not be read")


# --- measured files -------------------------------------------------------------------

ZILLEN = [
    "time_s=#1:ms",
    "position_m=#5:mm",
    "pressure_a_pa=#6:bar(g)",
    "motor_force_n=#7:N",
]


def test_emps(tmp_path: Path, shared_data: Path) -> None:
    from scipy.io import loadmat

    foreign, out = shared_data / "emps" / "DATA_EMPS.mat", tmp_path / "emps.csv"
    entries = ["time_s=t", "position_m=qm:m", "motor_force_n=vir:35.15 N"]
    report = convert(foreign, out, maps=entries)
    frame, raw = log_of(out), loadmat(foreign)
    assert len(frame) == report.rows == 24841
    assert np.array_equal(frame["position_m"], raw["qm"].ravel())
    assert np.array_equal(frame["motor_force_n"], raw["vir"].ravel() * 35.15)
    assert report.unmapped == ("gtau", "kp", "kv", "qg")


def converted(foreign: Path, out: Path, **arguments: Any) -> tuple[ConversionReport, Any]:
    report = convert(foreign, out, **arguments)
    return report, log_of(out)


def test_zillen_friction(tmp_path: Path, shared_data: Path) -> None:
    files = sorted((shared_data / "zillen_cylinder" / "friction").glob("*.csv"))
    report, frame = converted(files[0], tmp_path / "log.csv", maps=ZILLEN, atmosphere_pa=ATMOSPHERE)
    first = files[0].read_text().split("\n")[1].split()
    row = [float(first[i]) for i in (0, 4, 5, 6)]
    given = frame[["time_s", "position_m", "pressure_a_pa", "motor_force_n"]].iloc[1]
    expected = [row[0] / 1e3, row[1] / 1e3, row[2] * 1e5 + ATMOSPHERE, row[3]]
    assert given.tolist() == pytest.approx(expected, rel=1e-14)
    assert report.unmapped == ("#2", "#3", "#4")
    together = convert(files[:6], tmp_path / "all.parquet", maps=ZILLEN, atmosphere_pa=ATMOSPHERE)
    assert together.tests == tuple(path.stem for path in files[:6])


def test_zillen_leakage_groups_its_digits(tmp_path: Path, shared_data: Path) -> None:
    entries = ["time_s=#1:ms", "pressure_a_pa=#3:bar(g)"]
    files = sorted((shared_data / "zillen_cylinder" / "leakage").glob("*.csv"))
    for foreign in files:
        _, frame = converted(
            foreign,
            tmp_path / "log.csv",
            maps=entries,
            thousands=".",
            atmosphere_pa=ATMOSPHERE,
        )
        steps = np.diff(frame["time_s"])
        assert steps.min() > 0.0
        assert np.median(steps) == pytest.approx(0.1, abs=0.01)


def test_pump_tank_gauge_and_absolute_agree(tmp_path: Path, shared_data: Path) -> None:
    foreign = shared_data / "pump_tank" / "Step7V.txt"
    absolute = ["time_s=#1", "pressure_a_pa=#4:mbar", "pressure_b_pa=#3:mbar(g)"]
    _, frame = converted(foreign, tmp_path / "log.csv", maps=absolute, atmosphere_pa=102964.0)
    assert np.median(np.diff(frame["time_s"])) == pytest.approx(0.01)
    np.testing.assert_allclose(frame["pressure_a_pa"], frame["pressure_b_pa"], atol=500.0)


def test_valve_files(tmp_path: Path, shared_data: Path) -> None:
    folder = shared_data / "valve_pwm_medtronic"
    _, frame = converted(
        folder / "10_ms_cycle_time_deflate.csv",
        tmp_path / "log.csv",
        maps=["duty_a=#2:percent", "time_s=#4:ms"],
    )
    assert frame["duty_a"].iloc[:3].tolist() == [1.0, 0.95, 0.9]
    assert frame["time_s"].iloc[0] == 3.316
    _, frame = converted(
        shared_data / "valve_surface_princeton" / "valve_response_dlite_setup.csv",
        tmp_path / "log.csv",
        maps=["duty_a=#1"],
        period_s=1.0,
    )
    np.testing.assert_allclose(frame["duty_a"], np.arange(101) / 100.0, atol=1e-12)


def test_times_of_day_count_from_the_first(tmp_path: Path) -> None:
    """Over midnight too; a cell that is no time is named."""
    cells = ["23:59:59.998", "23:59:59.999", "00:00:00.000", "00:00:00.001"]
    path = tmp_path / "clock.csv"
    path.write_text("zeit;x\n" + "".join(f"{cell};{i}.5\n" for i, cell in enumerate(cells)))
    words = ["convert", str(path), "-o", str(tmp_path / "out.csv")]
    words += ["--map", "time_s=zeit", "--map", "position_m=x:mm"]
    assert main(words) == 0
    read = pd.read_csv(tmp_path / "out.csv", comment="#")
    assert read["time_s"].tolist() == pytest.approx([0.0, 0.001, 0.002, 0.003], abs=1e-9)
    path.write_text("zeit;x\n23:59:59;1.5\nnoon;2.5\n")
    assert main(words) == 2


def test_a_misspelt_name_of_the_log_format_is_asked_about(tmp_path: Path) -> None:
    head = "time_s,theta_rad,motor_torqe_nm,spare,pressure_c_pa\n"
    (tmp_path / "a.csv").write_text(head + "".join(f"{i},{i},{i},{i},{i}\n" for i in range(20)))
    known = ["pressure_a_pa=1e5", "pressure_b_pa=1e5"]
    report = convert(tmp_path / "a.csv", tmp_path / "b.csv", constants=known)
    (line,) = [line for line in report.notices if "not mapped" in line]
    assert "motor_torqe_nm (did you mean motor_torque_nm?), spare, pressure_c_pa" in line
