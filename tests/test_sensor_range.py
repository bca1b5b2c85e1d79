"""A sensor's range as its data sheet states it: spellings, what is refused, readings outside."""

from __future__ import annotations

import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest
from own_components import done, refused

from sysid.errors import InputError
from sysid.io.campaign import CampaignFile, read_campaign
from sysid.io.units import ColumnMap, parse_map, parse_map_table, to_si

ATMOSPHERE = 101325.0


def one(text: str) -> ColumnMap:
    return next(iter(parse_map([text]).values()))


@pytest.mark.parametrize(
    ("text", "readings", "expected"),
    [
        ("pressure_a_pa=V:0.5..4.5 -> 0..6.9 bar", [0.5, 2.5, 4.5], [0.0, 3.45e5, 6.9e5]),
        ("pressure_a_pa=V:4..20 mA -> 0..10 bar", [4.0, 4.1, 20.0], [0.0, 6250.0, 1e6]),
        ("pressure_a_pa=V:4 mA..20 mA -> 0 bar..10 bar", [12.0], [5e5]),
        ("pressure_a_pa=V:0-10 V -> 0-10 bar", [0.1, 7.3], [1e4, 7.3e5]),
        ("pressure_a_pa=V:0 - 10 V -> 0 - 10 bar", [0.1], [1e4]),
        ("pressure_a_pa=V:0...10 V → 0...10 bar", [0.3], [3e4]),
        ("pressure_a_pa=V:0 to 10 V -> 0 to 10 bar", [0.3], [3e4]),
        ("pressure_a_pa=V:0–10 V => 0–10 bar", [0.3], [3e4]),
        ("pressure_a_pa=V:0,5–4,5 V -> 0–1 MPa", [0.5, 4.5], [0.0, 1e6]),
        ("pressure_a_pa=V:-5--1 -> 0-10 bar", [-5.0, -1.0], [0.0, 1e6]),
        ("pressure_a_pa=V:-1..1 -> 0..200 kPa", [-1.0, 0.5], [0.0, 1.5e5]),
        ("pressure_a_pa=V:1e-3..5e-3 A -> 0..1e6 Pa", [1e-3, 5e-3], [0.0, 1e6]),
        ("pressure_a_pa=V:10..0 V -> 0..10 bar", [10.0, 2.0], [0.0, 8e5]),
        ("pressure_a_pa=V:0..10 V -> 10..0 bar", [10.0, 2.0], [0.0, 8e5]),
        ("pressure_a_pa=V:0..27648 -> 0..10 bar", [27648.0], [1e6]),
        ("pressure_a_pa=V:0..1023 counts -> 0..5 bar", [1023.0], [5e5]),
        ("duty_a=V:5..10 -> 0..1", [5.0, 7.3, 10.0], [0.0, 0.46, 1.0]),
        ("duty_a=V:5..10 V -> 0..100 percent", [7.3], [0.46]),
        ("duty_a=V:5..10 V -> 0..100 %", [8.1], [0.62]),
        ("valve_a=V:0..24 -> 0..1", [0.0, 24.0], [0.0, 1.0]),
        ("position_m=V:0..10 V -> -50..50 mm", [0.0, 7.5], [-0.05, 0.025]),
        ("theta_rad=V:1..5 -> 0..1 rad", [1.0, 3.0], [0.0, 0.5]),
        ("temperature_k=V:4..20 -> -50..150 degC", [4.0, 20.0], [223.15, 423.15]),
    ],
)
def test_readings_in_si(text: str, readings: list[float], expected: list[float]) -> None:
    assert to_si(readings, one(text)).tolist() == pytest.approx(expected, rel=1e-15, abs=1e-12)


@pytest.mark.parametrize("unit", ["psi(g)", "psig", "psi (g)", "psi gauge", "PSIG"])
def test_a_gauge_sensor_at_its_zero_reads_the_atmosphere(unit: str) -> None:
    entry = one(f"pressure_a_pa=V:0.5..4.5 V -> 0..100 {unit}")
    assert entry.gauge is True
    full = ATMOSPHERE + 100.0 * 6894.757293168361
    assert to_si([0.5, 4.5], entry, ATMOSPHERE).tolist() == pytest.approx([ATMOSPHERE, full])


def test_decimal_readings_give_the_decimal_that_a_person_expects() -> None:
    volts = np.arange(0, 10001) / 1000.0
    pascals = to_si(volts, one("pressure_a_pa=V:0..10 V -> 0..10 bar"))
    assert pascals.tolist() == [float(100 * k) for k in range(10001)]
    command = 5.0 + np.arange(0, 5001) / 1000.0
    command = np.array([float(f"{v:.3f}") for v in command])
    duty = to_si(command, one("duty_a=V:5..10 -> 0..1"))
    assert duty.tolist() == [float(f"{k / 5000:.4f}") for k in range(5001)]


@pytest.mark.parametrize(
    "text",
    [
        "pressure_a_pa=V:0.5..4.5 V -> 0..100 psi(g)",
        "pressure_a_pa=ai:0:0,5–4,5 V → 0–100 psi(g)",
        "duty_a=Y:5..10 -> 0..1",
    ],
)
def test_an_entry_shown_can_be_typed(text: str) -> None:
    entry = one(text)
    assert one(str(entry)) == entry


def test_a_table_says_the_same_as_the_text() -> None:
    text = '{column = "V", from = [0.5, 4.5], to = [0, 100], unit = "psi(g)"}'
    table = tomllib.loads(f"pressure_a_pa = {text}\nduty_a = {{column = 'u', unit = 'percent'}}")
    found = parse_map_table(table, "recipe.toml [map]")
    said = parse_map(
        ["pressure_a_pa=V:0.5..4.5 -> 0..100 psi(g)", "duty_a=u:percent"], "recipe.toml [map]"
    )
    assert found == said
    assert str(found["pressure_a_pa"]) == "pressure_a_pa=V:0.5..4.5 -> 0..100 psi(g)"
    plain = parse_map_table({"time_s": {"column": "a:b"}, "duty_b": {"column": "u", "from": [5, 10],
                            "to": [0, 1]}}, "x")  # fmt: skip
    assert plain["time_s"] == ColumnMap("time_s", "a:b", source="x")
    assert to_si([7.3], plain["duty_b"])[0] == 0.46


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("4..4 -> 0..1 bar", "readings begin and end at 4: it has no width; give both ends"),
        ("0..10 -> 5..5 bar", "values begin and end at 5: it has no width"),
        ("0.5.. -> 0..100 psi", "has no two numbers in '0.5..'; write it as 0.5..4.5 V -> "),
        ("..4.5 -> 0..100 psi", "has no two numbers in '..4.5'"),
        ("4.5 -> 0..100 psi", "has no two numbers in '4.5'"),
        ("0.5..4.5 -> 100 psi", "has no two numbers in '100 psi'"),
        ("0.5..4.5 ->", "lacks one of its two sides"),
        ("-> 0..100 psi", "lacks one of its two sides"),
        ("0.5..4.5 V", "lacks one of its two sides"),
        ("0..1 -> 0..1 -> 0..1 bar", "has two arrows"),
        ("0..10..20 -> 0..1 bar", "has no two numbers in '0..10..20'"),
        ("0 -100 -> 0..1 bar", "has no two numbers in '0 -100'"),
        ("0 V..10 A -> 0..1 bar", "has two units, V and A, on one side"),
        ("0..100 psi -> 0.5..4.5 V", "reversed: .* write 0.5..4.5 V -> 0..100 psi"),
        ("0..10 V -> 0..10", "values 0 to 10 have no unit; write it behind them"),
        ("0..10 V -> 0..10 V", "'V' is a voltage, not a pressure"),
        ("0..10 V -> 0..10 barr", "'barr' is not a known unit; did you mean bar?"),
        ("0..10 foo -> 0..10 bar", "'foo', of the readings, is not a known unit"),
        ("0..10 V -> 0..1,000 bar", "1,000 .* may be grouped or a decimal; write 1000 or 1.000"),
        ("0..1e999 -> 0..10 bar", "1e999 is not the end of a range"),
        ("0..10 -> 0..1e99999999 bar", "1e99999999 is not the end of a range"),
        ("0..10 V -> 0..10 deg(g)", "is declared gauge, but a pressure|not a pressure"),
    ],
)
def test_refused_in_one_line_with_the_fix(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        parse_map([f"pressure_a_pa=V:{text}"])
    line = str(caught.value)
    assert line.startswith("--map pressure_a_pa=V:") and "\n" not in line and "; " in line


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"column": "V", "from": [0.5, 4.5]}, "from is given without to; give both ends"),
        ({"column": "V", "to": [0, 1], "unit": "bar"}, "to is given without from"),
        ({"column": "V", "from": [0.5], "to": [0, 1]}, r"from = \[0.5\] is not two numbers"),
        ({"column": "V", "from": [0, True], "to": [0, 1]}, "is not two numbers"),
        ({"column": "V", "from": "0..1", "to": [0, 1]}, "is not two numbers"),
        ({"column": "V", "from": [0, 1], "to": [0, 1]}, "have no unit"),
        ({"column": "V", "from": [1, 1], "to": [0, 1], "unit": "bar"}, "has no width"),
        ({"column": "V", "from": [0, float("inf")], "to": [0, 1], "unit": "bar"}, "the end of a"),
        ({"column": "V", "from": [0, 10**400], "to": [0, 1], "unit": "bar"}, "the end of a range"),
        ({"column": "V", "from": [0, 1], "to": [0, 1], "unit": "0..1 -> 0..1 bar"}, "of its own"),
        ({"column": "V", "units": "bar"}, "units is not a key .*; did you mean unit?"),
        ({"unit": "bar"}, "names no column"),
        ({"column": 3, "unit": "bar"}, "column = 3 is not text"),
    ],
)
def test_a_table_refused(table: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        parse_map_table({"pressure_a_pa": table}, "recipe.toml [map]")
    assert str(caught.value).startswith("recipe.toml [map] pressure_a_pa")


def converted(folder: Path, volts: list[float] | np.ndarray, sensor: str) -> str:
    """What `convert` says on standard error of readings of a sensor."""
    frame = pd.DataFrame({"t": np.arange(len(volts)) * 0.001, "V": volts})
    frame.to_csv(folder / "raw.csv", index=False)
    return done(
        "convert", folder / "raw.csv", "-o", folder / "log.csv", "--map", "time_s=t",
        "--map", f"pressure_a_pa=V:{sensor}", "--atmosphere", ATMOSPHERE,
    ).err  # fmt: skip


def test_a_wire_that_is_off_is_said_with_its_first_row_and_share(tmp_path: Path) -> None:
    volts = 0.5 + 0.001 * np.random.default_rng(1).standard_normal(400)
    volts[100:140] = 0.0
    said = converted(tmp_path, volts, "0.5..4.5 V -> 0..100 psi(g)")
    assert "line 102: V: 0 is the first of 40 readings of 400 (10 %) outside" in said
    assert "range of 0.5 to 4.5 V: a broken wire" in said


def test_readings_of_another_range_are_said(tmp_path: Path) -> None:
    said = converted(tmp_path, np.linspace(4.0, 12.0, 200), "0..10 V -> 0..10 bar")
    assert "outside the sensor's range of 0 to 10 V: is the range right?" in said


@pytest.mark.parametrize(
    ("low", "high", "noise", "sensor"),
    [
        (0.5, 3.0, 0.02, "0.5..4.5 V -> 0..100 psi(g)"),  # rests at its zero, with noise
        (0.5, 3.0, 0.1, "0.5..4.5 V -> 0..100 psi(g)"),
        (3.85, 20.4, 0.005, "4..20 mA -> 0..10 bar"),  # a transmitter's reserve
        (-0.02, 9.0, 0.002, "0..10 V -> 0..10 bar"),
    ],
)
def test_a_healthy_sensor_is_not_suspected(
    low: float, high: float, noise: float, sensor: str, tmp_path: Path
) -> None:
    ramp = np.clip(np.linspace(low - 2.0, high, 2000), low, None)
    readings = ramp + noise * np.random.default_rng(2).standard_normal(2000)
    assert "outside" not in converted(tmp_path, readings, sensor)


CAMPAIGN = """\
rig = "rig.toml"
[map]
time_s = "t"
pressure_a_pa = {column = "V", from = [0.5, 4.5], to = [0, 100], unit = "psi(g)"}
[[log]]
kind = "friction-motion"
file = "run.csv"
map = {duty_a = "Y:5..10 -> 0..1"}
"""


def test_a_campaign_takes_both_spellings_and_its_schema_too(tmp_path: Path, rig_text: str) -> None:
    (tmp_path / "rig.toml").write_text(rig_text, "utf-8")
    rows = "\n".join(f"{k / 100},{0.5 + k / 100},{5 + k / 20}" for k in range(100))
    (tmp_path / "run.csv").write_text(f"t,V,Y\n{rows}\n", "utf-8")
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN, "utf-8")
    campaign = read_campaign(path)
    trial = campaign.read(campaign.logs[0]).trials[0]
    assert trial["pressure_a_pa"][0] == pytest.approx(100000.0)
    assert trial["duty_a"][[0, -1]].tolist() == [0.0, 0.99]
    schema = CampaignFile.model_json_schema()
    jsonschema.validate(tomllib.loads(CAMPAIGN), schema)
    for wrong in ("from = [0.5], ", "form = [0.5, 4.5], ", ""):
        text = CAMPAIGN.replace("from = [0.5, 4.5], ", wrong)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(tomllib.loads(text), schema)


def test_a_recipe_takes_a_range(tmp_path: Path) -> None:
    (tmp_path / "raw.csv").write_text("t,V\n0,0.5\n1,4.5\n", "utf-8")
    recipe = tmp_path / "lab.toml"
    recipe.write_text(
        '[map]\ntime_s = "t"\npressure_a_pa = {column = "V", from = [0.5, 4.5], to = [0, 7], '
        'unit = "bar"}\n',
        "utf-8",
    )
    done("convert", tmp_path / "raw.csv", "--spec", recipe, "-o", tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text("utf-8")
    assert "# map: pressure_a_pa=V:0.5..4.5 -> 0..7 bar\n" in text
    assert text.endswith("0.0,0.0\n1.0,700000.0\n")


def test_a_duty_in_counts_is_refused_with_the_ratio(tmp_path: Path, rig_text: str) -> None:
    (tmp_path / "rig.toml").write_text(rig_text, "utf-8")
    rows = "\n".join(f"{k / 100},{(k * 5) % 256}" for k in range(100))
    (tmp_path / "run.csv").write_text(f"t,PWM\n{rows}\n", "utf-8")
    command = ("check", tmp_path / "run.csv", "--map", "time_s=t", "--map")
    assert 'give --map "duty_a=PWM:1/255"' in refused(*command, "duty_a=PWM")
    for ratio in ("1/255", "0..255 -> 0..1"):
        assert "leaves 0 to 1" not in done(*command, f"duty_a=PWM:{ratio}").err
    said = done(*command, "duty_a=PWM:0.00392157").err
    assert "duty_a leaves 0 to 1 by at most 3.5e-07 in 1 rows; 0 or 1 is used there" in said


@pytest.mark.parametrize(
    ("entry", "readings", "said"),
    [
        ("V:25 psi(g)", [0.5, 0.51, 2.5], "0.5..4.5 V"),
        ("V:2.5 bar", [0.98, 1.4, 5.1], "1..5 V"),
        ("V:2.5 bar(g)", [4.02, 12.0, 20.1], "4..20 mA"),
        ("V:1.25 bar(g)", [2.0, 9.9], "2..10 V"),
    ],
)
def test_a_multiple_of_volts_that_begin_above_zero_is_questioned(
    entry: str, readings: list[float], said: str
) -> None:
    (notice,) = one(f"pressure_a_pa={entry}").notices(np.array(readings), "run.csv", str)
    assert said in notice and "counts from zero" in notice
    assert (
        one(f"motor_force_n=V:{entry[2:].split()[0]} N").notices(np.array(readings), "", str) == []
    )


@pytest.mark.parametrize(
    ("entry", "readings"),
    [
        ("V:1 bar", [1.01, 4.0]),  # the atmosphere
        ("V:1 bar(g)", [0.01, 4.0]),
        ("V:bar(g)", [0.5, 4.0]),  # no raw reading
        ("V:0.5..4.5 V -> 0..100 psi(g)", [0.5, 4.5]),
        ("V:25 psi(g)", [0.5, 700.0]),  # a converter's counts
        ("V:25 psi(g)", [2.7, 4.0]),
    ],
)
def test_a_multiple_that_may_begin_at_zero_is_not(entry: str, readings: list[float]) -> None:
    assert one(f"pressure_a_pa={entry}").notices(np.array(readings), "run.csv", str) == []
