"""Units as people write them: spellings, mass flows at a standard state, what has two meanings."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from own_components import done

from sysid.errors import InputError
from sysid.io.logs import read_log
from sysid.io.rig import read_rig
from sysid.io.unit_text import parse_unit, ratio_of, without_multiple
from sysid.io.units import parse_map

PSI, LBF, INCH = 6894.757293168361, 4.4482216152605, 0.0254


@pytest.mark.parametrize(
    ("si", "texts", "factor"),
    [
        ("Pa", "bar Bar BAR", 1e5),
        ("Pa", "mbar mBar MBAR hPa HPA", 100.0),
        ("Pa", "kPa KPA KPa [kPa] kilopascal", 1e3),
        ("Pa", "MPa MPA N/mm2 N/mm² N/mm^2", 1e6),
        ("Pa", "psi PSI Psi lbf/in2 lbf/in²", PSI),
        ("Pa", "mmH2O mmWS", 9.80665),
        ("Pa", "inH2O inWC", 249.08891),
        ("Pa", "kgf/cm2 kp/cm2 at", 98066.5),
        ("Pa", "torr Torr", 101325.0 / 760.0),
        ("N*m", "Nm NM N·m N⋅m N*m N.m N-m", 1.0),
        ("N*m", "mNm", 1e-3),
        ("N*m", "ozf*in ozf-in ozin", LBF * INCH / 16.0),
        ("N*m", "in*lbf in-lbf lbf-in", LBF * INCH),
        ("N*m", "lbf*ft ft-lbf", LBF * 12.0 * INCH),
        ("N*m", "kgf*cm", 0.0980665),
        ("N", "kgf kp", 9.80665),
        ("N", "lbf", LBF),
        ("rad/s", "rpm RPM 1/min U/min min-1 min^-1 r/min rev/min", math.pi / 30.0),
        ("rad/s", "deg/s °/s", math.pi / 180.0),
        ("rad/s", "rev/s turn/s", 2.0 * math.pi),
        ("m/s", "mm/s", 1e-3),
        ("m/s", "in/s", INCH),
        ("rad", "deg ° DEG Grad", math.pi / 180.0),
        ("rad", "rev revs turn", 2.0 * math.pi),
        ("s", "µs μs us usec", 1e-6),
        ("s", "s sec Sec SEC", 1.0),
        ("m", "µm um", 1e-6),
        ("m", "mm MM", 1e-3),
        ("K", "K Kelvin degC °C Celsius ℃", 1.0),
        ("count", "count counts Counts pulses ticks inc steps", 1.0),
        ("V", "V Volt VOLT volts", 1.0),
        ("dimensionless", "% percent [%] Percent", 0.01),
        ("dimensionless", "1/255", 1.0 / 255.0),
        ("dimensionless", "100/255", 100.0 / 255.0),
        ("", "0.00392157", 0.00392157),
        ("", "1/255", 1.0 / 255.0),
        ("", "% percent", 0.01),
        ("Nm", "mNm", 1e-3),
        ("bar", "kPa", 0.01),
        ("m/s**2", "mm/s² mm/s2", 1e-3),
        ("m/s**2", "g_0", 9.80665),
    ],
)
def test_spellings(si: str, texts: str, factor: float) -> None:
    for text in texts.split():
        assert parse_unit(text, si, "--map").factor == pytest.approx(factor, rel=1e-5), text


@pytest.mark.parametrize(
    ("text", "gauge"),
    [("mbar(g)", True), ("bar g", True), ("kPa rel", True), ("bar(rel)", True), ("BARG", True),
     ("bar abs", False), ("bar (absolute)", False), ("BARA", False), ("KPA", None)],
)  # fmt: skip
def test_the_reference_of_a_pressure(text: str, gauge: bool | None) -> None:
    assert parse_unit(text, "Pa", "--map").gauge is gauge


@pytest.mark.parametrize(
    ("text", "kg_per_s", "said"),
    [
        ("l/min(ANR)", 1.185 / 60000.0, ""),
        ("L/min (ANR)", 1.185 / 60000.0, ""),
        ("l/min ANR", 1.185 / 60000.0, ""),
        ("l/min(ISO 8778)", 1.185 / 60000.0, ""),
        ("m3/h(ANR)", 1.185 / 3600.0, ""),
        ("m³/h(ANR)", 1.185 / 3600.0, ""),
        ("10 l/min(ANR)", 1.185 / 6000.0, ""),
        ("dm3/s(ANR)", 1.185e-3, ""),
        ("l/min(DIN 1343)", 1.2929 / 60000.0, ""),
        ("Nl/min", 1.2929 / 60000.0, "DIN 1343: 0 degC, 101.325 kPa"),
        ("Nm3/h", 1.2929 / 3600.0, "DIN 1343"),
        ("slpm", 1.2929 / 60000.0, "SEMI E12: 0 degC"),
        ("sccm", 1.2929e-6 / 60.0, "SEMI E12"),
        ("SCFM", 1.2041 * 0.3048**3 / 60.0, "68 degF, 14.696 psi(a)"),
    ],
)
def test_a_volume_at_a_standard_state_is_a_mass(text: str, kg_per_s: float, said: str) -> None:
    found = parse_unit(text, "kg/s", "--map")
    assert found.factor == pytest.approx(kg_per_s, rel=1e-14)
    assert said in found.remark and bool(said) is bool(found.remark)


@pytest.mark.parametrize(
    ("si", "text", "said"),
    [
        ("kg/s", "l/min", r"its mass depends on the state .* write l/min\(ANR\) for ISO 8778"),
        ("kg/s", "m3/h", r"write m3/h\(ANR\)"),
        ("kg/s", "cfm", r"'cfm' is a volume flow.* scfm"),
        ("kg/s", "l(ANR)", "'l' is liter, not a volume flow"),
        ("K", "C", "did you mean degC"),
        ("N", "lbs", "'lbs' is a mass, not a force; did you mean lbf?"),
        ("N", "kg", "did you mean kgf?"),
        ("N", "g", "did you mean gf?"),
        ("N*m", "in-lb", r"did you mean in\*lbf?"),
        ("N*m", "oz-in", r"did you mean ozf\*in?"),
        ("Pa", "kg/cm2", "did you mean kgf/cm2?"),
        ("Pa", "lb/in2", "did you mean psi?"),
        ("m/s**2", "g", "did you mean g_0?"),
        ("rad", "grad", "may be a degree or a gon; write deg or gon"),
        ("rad/s", "1/s", "may be turns or radians per second; write rev/s or rad/s"),
        ("rad/s", "Hz", "write rev/s or rad/s"),
        ("s", "MS", "did you mean ms?"),
        ("dimensionless", "V", "a sensor or a command has a range, 0..24 -> 0..1"),
        ("dimensionless", "0,5", "has a comma; write numbers with a decimal point"),
        ("dimensionless", "1/0", "the ratio 1/0 is unusable"),
        ("", "V", "'V' is a voltage, not a ratio"),
        ("Pa", "1/255", "1/255"),
    ],
)
def test_what_has_two_meanings_or_another_is_refused_with_the_choice(
    si: str, text: str, said: str
) -> None:
    with pytest.raises(InputError, match=said) as caught:
        parse_unit(text, si, "--map x")
    assert str(caught.value).startswith("--map x: ") and "; " in str(caught.value)


def test_one_unit_in_another() -> None:
    assert ratio_of("kPa", "bar") == pytest.approx(0.01)
    assert ratio_of("kPa(g)", "Pa") == pytest.approx(1000.0)
    assert ratio_of("kPa", "V") is None and ratio_of("foo", "V") is None
    assert without_multiple("35.15 N") == "N" and without_multiple("-1 deg") == "deg"
    assert without_multiple("1/min") is None


def test_what_a_flow_was_taken_for_is_said(tmp_path: Path) -> None:
    (tmp_path / "raw.csv").write_text("t,u,q\n0,0.1,60000\n1,0.2,120000\n", "utf-8")
    command = ("convert", tmp_path / "raw.csv", "-o", tmp_path / "log.csv")
    maps = ("--map", "time_s=t", "--map", "duty_a=u", "--map")
    said = done(*command, *maps, "flow_a_kg_s=q:Nl/min").err
    assert "Nl/min is taken at DIN 1343: 0 degC, 101.325 kPa, dry (1.2929 kg/m3)" in said
    assert "taken" not in done(*command, *maps, "flow_a_kg_s=q:l/min(ANR)").err
    assert (tmp_path / "log.csv").read_text("utf-8").endswith("0.0,0.1,1.185\n1.0,0.2,2.37\n")


@pytest.mark.parametrize("unit", ["l/min(ANR)", "0..10 V -> 0..10 l/min(ANR)"])
def test_a_volume_of_another_gas_has_its_mass(unit: str, rig_text: str, tmp_path: Path) -> None:
    """At the same state; of air, and without a rig file, it is air's."""
    rows = "".join(f"{i},0.{i},{6.0 if i % 2 else 3.0}\n" for i in range(1, 9))
    (tmp_path / "raw.csv").write_text(f"t,u,q\n{rows}", "utf-8")
    command = ("convert", tmp_path / "raw.csv", "-o", tmp_path / "log.csv")
    maps = ("--map", "time_s=t:ms", "--map", "duty_a=u", "--map", f"flow_a_kg_s=q:{unit}")

    def flows() -> list[float]:
        written = (tmp_path / "log.csv").read_text("utf-8").splitlines()[-2:]
        return [float(row.split(",")[-1]) for row in written]

    assert "counts air" not in done(*command, *maps).err
    assert flows() == pytest.approx([1.185e-4, 0.5925e-4])
    (tmp_path / "rig.toml").write_text(rig_text, "utf-8")
    assert "counts air" not in done(*command, *maps).err
    constant = re.search(r"gas_constant_j_per_kg_k = [\d.]+", rig_text)
    assert constant is not None
    helium = rig_text.replace(constant[0], "gas_constant_j_per_kg_k = 2077.0")
    (tmp_path / "rig.toml").write_text(helium, "utf-8")
    density = 1e5 / (2077.0 * 293.15)
    said = done(*command, *maps).err
    assert f"gas (2077 J/(kg K)) at 20 degC, 100 kPa: {density:.4g} kg/m3, where air" in said
    assert flows() == pytest.approx([density * 1e-4, density * 0.5e-4])
    # As it is where a log is read by its map.
    mapping = parse_map(maps[1::2])
    log = read_log(tmp_path / "raw.csv", read_rig(tmp_path / "rig.toml"), mapping)
    assert log.trials[0]["flow_a_kg_s"][-2:] == pytest.approx([density * 1e-4, density * 0.5e-4])
    assert any("counts air" in line for line in log.notices)
