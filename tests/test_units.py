"""Map entries and units: what they mean, and what is refused."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from sysid.errors import InputError
from sysid.io.units import (
    CANONICAL_UNITS,
    ColumnMap,
    find_column,
    parse_map,
    parse_map_table,
    parse_unit,
    to_si,
)


def one(text: str) -> ColumnMap:
    return next(iter(parse_map([text]).values()))


@pytest.mark.parametrize(
    ("text", "reading", "expected"),
    [
        ("time_s=t:ms", 273.0, 0.273),
        ("time_s=t:us", 1.0, 1e-6),
        ("time_s=t:min", 2.0, 120.0),
        ("position_m=x:mm", -12.5, -0.0125),
        ("position_m=x:inch", 1.0, 0.0254),
        ("theta_rad=q:deg", 180.0, np.pi),
        ("theta_rad=q:-1 deg", 90.0, -np.pi / 2),
        ("theta_rad=q:rev", 0.5, np.pi),
        ("pressure_a_pa=p:kPa", 101.325, 101325.0),
        ("pressure_a_pa=p:bar(a)", 3.0, 300000.0),
        ("pressure_b_pa=p:psi", 1.0, 6894.757293168361),
        ("pressure_b_pa=p:mbar", 1013.25, 101325.0),
        ("supply_pressure_pa=p:kgf/cm2", 1.0, 98066.5),
        ("motor_torque_nm=u:Nm", 0.3, 0.3),
        ("motor_torque_nm=u:mNm", 300.0, 0.3),
        ("motor_torque_nm=u:lbf ft", 1.0, 1.3558179483314004),
        ("motor_force_n=vir:35.15 N", 2.0, 70.3),
        ("motor_force_n=f:kN", 0.02, 20.0),
        ("motor_volts=u:mV", 250.0, 0.25),
        ("temperature_k=T:degC", 20.0, 293.15),
        ("temperature_k=T:degF", 68.0, 293.15),
        ("temperature_k=T:0.1 degC", 200.0, 293.15),
        ("duty_a=u:percent", 35.0, 0.35),
        ("duty_b=u:%", 35.0, 0.35),
        ("valve_a=u:0.2", 5.0, 1.0),
        ("encoder_counts=n:counts", 1024.0, 1024.0),
        ("encoder_counts=n:4", 256.0, 1024.0),
    ],
)
def test_reading_in_si(text: str, reading: float, expected: float) -> None:
    assert to_si([reading], one(text))[0] == pytest.approx(expected, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("unit", ["bar(g)", "barg", "bar (gauge)", "100 kPa(g)", "bar_g"])
def test_gauge_adds_the_atmosphere(unit: str) -> None:
    entry = one(f"pressure_a_pa=p:{unit}")
    assert entry.gauge is True
    assert to_si([0.0, 2.0], entry, 98000.0) == pytest.approx([98000.0, 298000.0], rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "gauge"),
    [("psig", True), ("psia", False), ("kPaa", False), ("kPa(a)", False), ("kPa", None)],
)
def test_reference_of_a_pressure(unit: str, gauge: bool | None) -> None:
    assert one(f"pressure_a_pa=p:{unit}").gauge is gauge


def test_a_coils_voltage_is_on_or_off() -> None:
    noisy = [-0.2, 0.4, 23.1, 24.3, np.nan]
    on = to_si(noisy, one("valve_a=coil:0..24 -> 0..1"))
    assert on.tolist()[:4] == [0.0, 0.0, 1.0, 1.0] and np.isnan(on[4])
    assert to_si(noisy, one("valve_a=coil:24..0 -> 0..1")).tolist()[:4] == [1.0, 1.0, 0.0, 0.0]


def test_absolute_pressure_is_left_without_the_atmosphere() -> None:
    assert to_si([2.0], one("pressure_a_pa=p:bar(a)"), 98000.0)[0] == 200000.0


def test_gauge_without_an_atmosphere_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"P1:kPa\(g\).*needs the atmospheric pressure.*--atmosphere"
    ):
        to_si([1.0], one("pressure_a_pa=P1:kPa(g)"))


def test_decimal_readings_stay_the_decimal_that_a_person_expects() -> None:
    milliseconds = np.arange(5000.0)
    expected = np.array([float(f"{int(v) / 1000:.3f}") for v in milliseconds])
    assert np.array_equal(to_si(milliseconds, one("time_s=t:ms")), expected)


def test_readings_that_are_no_decimals_are_multiplied_alone() -> None:
    readings = np.random.default_rng(3).normal(size=500)
    assert np.array_equal(to_si(readings, one("motor_force_n=u:35.15 N")), readings * 35.15)
    decimals = np.arange(500) / 100.0
    expected = [float(f"{i * 3515 / 1e4:.4f}") for i in range(500)]
    assert to_si(decimals, one("motor_force_n=u:35.15 N")).tolist() == expected


def test_conversion_leaves_its_input_and_shape() -> None:
    readings = np.array([[1.0, 2.0], [3.0, 4.0]])
    out = to_si(readings, ColumnMap("time_s", "t"))
    out += 1.0
    assert readings[0, 0] == 1.0
    assert out.shape == (2, 2)


@pytest.mark.parametrize(
    ("text", "column", "unit"),
    [
        ("pressure_a_pa=Druck links [kPa]:kPa", "Druck links [kPa]", "kPa"),
        ("pressure_a_pa=rec:Y:kPa", "rec:Y", "kPa"),
        ("pressure_a_pa=rec:Y:", "rec:Y", None),
        ("time_s = t", "t", None),
        ("time_s=a=b:s", "a=b", "s"),
        ("time_s=#3:ms", "#3", "ms"),
        ("test=run", "run", None),
    ],
)
def test_column_and_unit(text: str, column: str, unit: str | None) -> None:
    entry = one(text)
    assert (entry.column, entry.unit) == (column, unit)
    again = one(str(entry))
    assert (again.column, again.unit, again.factor) == (column, unit, entry.factor)


def test_table_says_the_same_as_the_command_line() -> None:
    table = parse_map_table({"pressure_a_pa": "P1:kPa(g)", "time_s": "t"}, "campaign.toml [map]")
    given = parse_map(["pressure_a_pa=P1:kPa(g)", "time_s=t"], "campaign.toml [map]")
    assert table == given


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("theta_rad=x:kPa", "'kPa' is a pressure, not an angle; give a unit such as rad"),
        ("theta_rad=x:percent", "is a ratio, not an angle"),
        ("encoder_counts=x:rad", "is an angle, not a number of encoder counts"),
        ("duty_a=x:V", "is a voltage, not a ratio"),
        ("temperature_k=x:C", "'C' is coulomb, not a temperature; did you mean degC?"),
        ("pressure_a_pa=x:pa", "did you mean Pa?"),
        ("pressure_a_pa=x:Kpa", "'Kpa' is not a known unit; did you mean kPa?"),
        ("pressure_a_pa=x:barr(g)", "'barr' is not a known unit; did you mean bar?"),
        ("time_s=x:fortnite", "did you mean|give a unit of a time"),
        ("theta_rad=x:deg(g)", r"but an angle is expected; omit the \(g\)"),
        ("time_s=x:5", "'5' has no unit; write 5 s"),
        ("motor_volts=x:12/255", "'12/255' has no unit; write 12/255 V"),
        ("velocity_m_per_s=x:c", "'c' is the speed of light; write m/s"),
        ("position_m=x:px", "'px' is no length.*; write the value of one"),
        (
            "pressure_a_pa=x:25 psi/V (V - 0.5)",
            "a sensor's range is written as 0.5..4.5 V -> 0..100",
        ),
        ("pressure_a_pa=x:25 psi/V", "a sensor's range is written as 0.5..4.5 V -> 0..100"),
        ("time_s=x:0 s", "the multiple 0 is unusable"),
        ("time_s=x:1e999 s", "the multiple 1e999 is unusable"),
        ("time_s=x:1/s", "not a time"),
        ("time_s=x:m s[", "is not a known unit"),
        ("time_s=x:__import__('os')", "is not a known unit"),
        ("time_s=x:" + "s*" * 60, "is not a known unit"),
        ("time_s=:ms", "names no column"),
        ("test=x:m", "test is a label and has no unit"),
        ("presure_a_pa=x:kPa", "did you mean pressure_a_pa?"),
        ("zzz=x", "is not a column of the log format; use one of time_s"),
        ("time_s", "has no '='"),
    ],
)
def test_refused_with_place_and_fix(text: str, what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        parse_map([text], "--map")
    line = str(caught.value)
    assert line.startswith("--map")
    assert "\n" not in line
    assert "; " in line


def test_doubled_target_is_refused_and_a_doubled_column_is_not() -> None:
    with pytest.raises(InputError, match="time_s is mapped twice \\('a' and 'b'\\)"):
        parse_map(["time_s=a", "time_s=b"])
    assert len(parse_map(["pressure_a_pa=p:bar", "pressure_b_pa=p:bar"])) == 2


def test_table_value_that_is_no_text_is_refused() -> None:
    with pytest.raises(InputError, match=r"recipe.toml \[map\]: time_s = 3 is not text"):
        parse_map_table({"time_s": 3}, "recipe.toml [map]")


def test_find_column_by_name_number_and_neither() -> None:
    names = ["t", "pressure left", "#1"]
    assert find_column(names, one("time_s=t"), "log.csv") == 0
    assert find_column(names, one("time_s=#2"), "log.csv") == 1
    assert find_column(names, one("time_s=#1"), "log.csv") == 2  # a name before a number
    with pytest.raises(InputError, match=r"did you mean pressure left?"):
        find_column(names, one("pressure_a_pa=presure left"), "log.csv")
    with pytest.raises(InputError, match=r"log.csv: has no column #7.*#1 to #3"):
        find_column(names, one("time_s=#7"), "log.csv")
    with pytest.raises(InputError, match="its columns are t, pressure left"):
        find_column(names, one("time_s=zzzz"), "log.csv")


def test_every_column_of_the_log_format_takes_its_own_unit() -> None:
    for target, unit in CANONICAL_UNITS.items():
        if unit is not None:
            assert to_si([1.5], one(f"{target}=x:{unit}"))[0] == 1.5


def test_pint_is_imported_only_where_a_unit_needs_it() -> None:
    code = (
        "import sys; from sysid.io.units import parse_map;"
        "parse_map(['time_s=t', 'pressure_a_pa=p:Pa', 'motor_force_n=v:35.15 N']);"
        "print('pint' in sys.modules); parse_map(['time_s=t:ms']); print('pint' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


@pytest.mark.parametrize("text", ["V/341.33", "1/341.33 V", "1 / 341.33 * V"])
def test_a_unit_may_be_a_part_of_one(text: str) -> None:
    """As a converter's counts are given: so many a volt."""
    assert parse_unit(text, "V", "--map")[1] == pytest.approx(1.0 / 341.33, rel=1e-12)


def test_a_rate_is_no_part_of_a_unit() -> None:
    with pytest.raises(InputError, match="is 1 / second"):
        parse_unit("1/s", "Pa", "--map")


def test_a_factor_of_a_power_of_ten_leaves_the_digits() -> None:
    bars = np.array([float(f"{k / 1000:.3f}") for k in range(20001)])
    assert to_si(bars, one("pressure_a_pa=p:bar")).tolist() == [100.0 * k for k in range(20001)]
    gauge = to_si(bars, one("pressure_a_pa=p:bar(g)"), 101325.0)
    assert gauge.tolist() == [101325.0 + 100.0 * k for k in range(20001)]


def test_a_conversion_never_leaves_the_rounding_of_its_product() -> None:
    readings = (
        np.random.default_rng(3).uniform(-10.0, 10.0, 20000) * 10.0 ** np.arange(-5, 5)[:, None]
    )
    product = readings * 1e5
    found = to_si(readings, one("pressure_a_pa=p:bar"))
    assert np.all(np.abs(found - product) <= 2.0 * np.spacing(np.abs(product)))


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("motor_volts=u:12/255 V", 12.0 / 255.0),
        ("motor_volts=u:1/341.33 V", 1.0 / 341.33),
        ("motor_volts=u:-5/1023V", -5.0 / 1023.0),
        ("pressure_a_pa=u:100/4 psi", 25.0 * 6894.757293168361),
    ],
)
def test_a_range_of_counts_as_a_ratio_before_its_unit(text: str, factor: float) -> None:
    (entry,) = parse_map([text]).values()
    assert entry.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("text", ["motor_volts=u:12/255 V", "motor_volts=u:V/341.33"])
def test_the_other_sign_of_a_ratio_can_be_typed(text: str) -> None:
    (entry,) = parse_map([text]).values()
    (other,) = parse_map([entry.reversed()]).values()
    assert other.factor == pytest.approx(-entry.factor, rel=1e-12)
