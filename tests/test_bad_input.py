"""Bad input: exit code 2, one line that names the place and the fix, never a traceback.

Every case goes through the command line as a user would meet it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sysid.commands.app import main

HEADER = "time_s,motor_torque_nm,theta_rad,pressure_a_pa,pressure_b_pa"
ROWS = 60
QUANTUM = 2 * math.pi / 80000


def good_rows(count: int = ROWS) -> list[list[str]]:
    """A torque ramp at rest: every row is sound."""
    rng = np.random.default_rng(11)
    return [
        [
            f"{0.001 * i:.3f}",
            f"{0.002 * i:.5f}",
            f"{QUANTUM * (i // 20):.7f}",
            f"{100000 + 26 * rng.integers(-8, 9)}",
            f"{100000 + 26 * rng.integers(-8, 9)}",
        ]
        for i in range(count)
    ]


def as_text(rows: Sequence[Sequence[str]], header: str = HEADER, end: str = "\n") -> str:
    return end.join([header, *(",".join(row) for row in rows)]) + end


class Workplace:
    """A folder with a sound rig file and log, for a case to spoil."""

    def __init__(self, folder: Path, rig_text: str) -> None:
        self.folder = folder
        self.rig = folder / "rig.toml"
        self.log = folder / "run.csv"
        self.rig.write_text(rig_text)
        self.log.write_text(as_text(good_rows()))
        self.arguments = ["fit", "friction", str(self.log)]

    def rows(self, change: Callable[[list[list[str]]], object]) -> None:
        rows = good_rows()
        change(rows)
        self.log.write_text(as_text(rows))

    def column(self, index: int, change: Callable[[float], object]) -> None:
        self.rows(lambda rows: [r.__setitem__(index, f"{change(float(r[index]))}") for r in rows])

    def rig_line(self, old: str, new: str) -> None:
        text = self.rig.read_text()
        assert old in text
        self.rig.write_text(text.replace(old, new))

    def header(self, old: str, new: str) -> None:
        self.log.write_text(as_text(good_rows(), HEADER.replace(old, new)))


@dataclass(frozen=True)
class Case:
    """What is spoilt, and what the one line must hold: the place and the fix."""

    name: str
    spoil: Callable[[Workplace], object]
    place: str
    fix: str


def _cell(row: int, column: int, value: str) -> Callable[[Workplace], object]:
    return lambda w: w.rows(lambda rows: rows[row].__setitem__(column, value))


def _raw(data: bytes) -> Callable[[Workplace], object]:
    return lambda w: w.log.write_bytes(data)


def _rig(old: str, new: str) -> Callable[[Workplace], object]:
    return lambda w: w.rig_line(old, new)


def _map(entry: str) -> Callable[[Workplace], object]:
    return lambda w: w.arguments.extend(["--map", entry])


def _log_named(name: str) -> Callable[[Workplace], object]:
    def spoil(w: Workplace) -> None:
        w.arguments[-1] = str(w.folder / name)

    return spoil


def _mixed_sampling(w: Workplace) -> None:
    def change(rows: list[list[str]]) -> None:
        for i in range(40, ROWS):
            rows[i][0] = f"{0.039 + 0.002 * (i - 39):.3f}"

    w.rows(change)


def _time_back_in_test(w: Workplace) -> None:
    rows = [[*row, "t1" if i < 30 else "t2"] for i, row in enumerate(good_rows())]
    rows[45][0] = "0.001"
    w.log.write_text(as_text(rows, HEADER + ",test"))


def _one_row_of_a_test(w: Workplace) -> None:
    rows = [[*row, "t1"] for row in good_rows()]
    rows[-1][-1] = "t2"
    w.log.write_text(as_text(rows, HEADER + ",test"))


def _empty_label(w: Workplace) -> None:
    rows = [[*row, "t1"] for row in good_rows()]
    rows[7][-1] = ""
    w.log.write_text(as_text(rows, HEADER + ",test"))


def _truncated_fields(w: Workplace) -> None:
    w.log.write_text(as_text(good_rows())[:-1].rsplit(",", 2)[0])


def _truncated_number(w: Workplace) -> None:
    w.log.write_text(as_text(good_rows())[:-5])


def _no_permission(w: Workplace) -> None:
    w.log.chmod(0)
    if os.access(w.log, os.R_OK):
        pytest.skip("this user may read every file")


def _damaged_parquet(w: Workplace) -> None:
    path = w.folder / "run.parquet"
    frame = pd.DataFrame({"time_s": np.arange(50) * 1e-3, "theta_rad": np.zeros(50)})
    frame.to_parquet(path)
    path.write_bytes(path.read_bytes()[:-30])
    w.arguments[-1] = str(path)


def _parquet_with_a_hole(w: Workplace) -> None:
    path = w.folder / "run.parquet"
    torque = np.arange(50.0) * 1e-3
    torque[20] = np.nan
    frame = pd.DataFrame(
        {"time_s": np.arange(50) * 1e-3, "theta_rad": np.zeros(50), "motor_torque_nm": torque}
    )
    frame.to_parquet(path)
    w.arguments[-1] = str(path)


def _campaign(text: str) -> Callable[[Workplace], object]:
    def spoil(w: Workplace) -> None:
        path = w.folder / "campaign.toml"
        path.write_text(text)
        w.arguments[:] = ["fit", str(path), "-o", str(w.folder / "bundle.json")]

    return spoil


def _bundle(text: str) -> Callable[[Workplace], object]:
    def spoil(w: Workplace) -> None:
        w.log.write_text(as_text(_breakaway_rows()))
        path = w.folder / "bundle.json"
        path.write_text(text)
        w.arguments.extend(["--into", str(path)])

    return spoil


def _breakaway_rows() -> list[list[str]]:
    """A ramp that does move, so that the fit gets as far as writing."""
    rows = []
    for i in range(3000):
        t = 0.001 * i
        moved = 2.6 * max(0.0, t - 2.0) ** 2
        angle = round(min(moved, 1.0) / QUANTUM) * QUANTUM
        rows.append([f"{t:.3f}", f"{0.16 * t:.6f}", f"{angle:.7f}", "100000", "100000"])
    return rows


LOG_ENTRY = '[[log]]\nkind = "friction-static"\nfile = "run.csv"\n'

CASES = [
    Case(
        "semicolons",
        lambda w: w.log.write_text(as_text(good_rows()).replace(",", ";")),
        "run.csv, line 1",
        "sysid convert",
    ),
    Case(
        "tabs",
        lambda w: w.log.write_text(as_text(good_rows()).replace(",", "\t")),
        "run.csv, line 1",
        "sysid convert",
    ),
    Case(
        "no header",
        lambda w: w.log.write_text(as_text(good_rows()).split("\n", 1)[1]),
        "run.csv, line 1",
        "--no-header",
    ),
    Case(
        "time column missing", lambda w: w.header("time_s", "seconds"), "run.csv", '--map "time_s='
    ),
    Case(
        "time column misspelt", lambda w: w.header("time_s", "times_s"), "run.csv", "time_s=times_s"
    ),
    Case("position missing", lambda w: w.header("theta_rad", "angle"), "theta_rad", "--map"),
    Case(
        "motor missing",
        lambda w: w.header("motor_torque_nm", "current"),
        "motor_torque_nm",
        "--map",
    ),
    Case(
        "doubled column",
        lambda w: w.header("pressure_b_pa", "pressure_a_pa"),
        "run.csv, line 1",
        "rename or delete",
    ),
    Case("text in a number", _cell(9, 2, "0.1x"), "run.csv, line 11", "fix the cell"),
    Case("unit in a number", _cell(9, 3, "100 kPa"), "run.csv, line 11", "no units"),
    Case("decimal comma", _cell(9, 2, '"0,001"'), "run.csv, line 11", "decimal point"),
    Case("NaN", _cell(4, 1, "NaN"), "run.csv, line 6", "delete the row or fill"),
    Case("empty cell", _cell(4, 3, ""), "run.csv, line 6", "delete the row or fill"),
    Case("infinite", _cell(4, 1, "inf"), "run.csv, line 6", "delete the row or fix"),
    Case("time back", _cell(30, 0, "0.010"), "run.csv, line 32", "sort the rows by time"),
    Case(
        "time back within a test", _time_back_in_test, "run.csv, line 47", "sort the rows by time"
    ),
    Case("duplicate time", _cell(30, 0, "0.029"), "run.csv, line 32", "delete the duplicate row"),
    Case("mixed sampling", _mixed_sampling, "run.csv, line 42", "column `test`"),
    Case(
        "too many fields in a row",
        lambda w: w.rows(lambda r: r[20].append("7")),
        "run.csv, line 22",
        "surplus",
    ),
    Case(
        "too few fields in a row",
        lambda w: w.rows(lambda r: r[20].pop()),
        "run.csv, line 22",
        "complete the row",
    ),
    Case(
        "trailing commas",
        lambda w: w.rows(lambda r: [x.append("") for x in r]),
        "run.csv, line 2",
        "header and rows agree",
    ),
    Case("truncated last line", _truncated_fields, f"run.csv, line {ROWS + 1}", "cut off"),
    Case("truncated last number", _truncated_number, f"run.csv, line {ROWS + 1}", "cut off"),
    Case(
        "gauge for absolute",
        lambda w: w.column(3, lambda v: v - 100000),
        "pressure_a_pa",
        "pressure_a_pa:Pa(g)",
    ),
    Case(
        "kPa for Pa",
        lambda w: w.column(3, lambda v: v / 1000),
        "pressure_a_pa",
        "pressure_a_pa:kPa",
    ),
    Case(
        "bar for Pa", lambda w: w.column(4, lambda v: v / 1e5), "pressure_b_pa", "pressure_b_pa:bar"
    ),
    Case(
        "psi for Pa",
        lambda w: w.column(4, lambda v: v / 6894.757),
        "pressure_b_pa",
        "pressure_b_pa:psi",
    ),
    Case(
        "kPa gauge for Pa",
        lambda w: w.column(3, lambda v: (v - 1e5) / 1000),
        "pressure_a_pa",
        "kPa(g)",
    ),
    Case(
        "degrees for radians",
        lambda w: w.column(2, lambda v: v * 180 / math.pi),
        "theta_rad",
        "theta_rad:deg",
    ),
    Case(
        "degrees beyond the stroke",
        lambda w: w.column(2, lambda v: 45 + v),
        "theta_rad",
        "theta_rad:deg",
    ),
    Case(
        "milliseconds for seconds", lambda w: w.column(0, lambda v: 1000 * v), "time_s", "time_s:ms"
    ),
    Case("millinewtonmetres", lambda w: w.column(1, lambda v: 1000 * v), "motor_torque_nm", "mN m"),
    Case("empty file", _raw(b""), "run.csv", "another file"),
    Case("blank lines only", _raw(b"\n\n\n"), "run.csv", "another file"),
    Case("header only", _raw(HEADER.encode() + b"\n"), "run.csv", "record the log again"),
    Case("comments only", _raw(b"# a\n# b\n"), "run.csv", "add a header row"),
    Case("one row", lambda w: w.log.write_text(as_text(good_rows(1))), "run.csv", "two samples"),
    Case("one row of a test", _one_row_of_a_test, f"run.csv, line {ROWS + 1}", "correct its label"),
    Case("empty test label", _empty_label, "run.csv, line 9", "delete the row or fill"),
    Case(
        "Latin-1",
        lambda w: w.log.write_bytes(
            "# Prüfstand\n".encode("latin-1") + as_text(good_rows()).encode()
        ),
        "run.csv, line 1",
        "UTF-8",
    ),
    Case(
        "UTF-16",
        lambda w: w.log.write_bytes(as_text(good_rows()).encode("utf-16")),
        "run.csv",
        "UTF-8",
    ),
    Case("binary", lambda w: w.log.write_bytes(b"\x01\x02\0\0" * 50), "run.csv", "sysid convert"),
    Case(
        "a directory",
        lambda w: w.arguments.__setitem__(-1, str(w.folder)),
        "is a directory",
        "path of a log",
    ),
    Case("missing file", _log_named("nothing.csv"), "nothing.csv", "path of a log"),
    Case("no permission", _no_permission, "run.csv", "permissions"),
    Case("huge file name", _log_named("x" * 5000 + ".csv"), "xxx", "path of a log"),
    Case("a .mat as a log", _log_named("run.mat"), "run.mat", "sysid convert"),
    Case("damaged parquet", _damaged_parquet, "run.parquet", "write it again"),
    Case("NaN in parquet", _parquet_with_a_hole, "run.parquet, row 21", "fill"),
    Case("unknown unit", _map("pressure_a_pa=pressure_a_pa:kPaq"), "kPaq", "kPa"),
    Case("unit of another kind", _map("theta_rad=theta_rad:kPa"), "theta_rad", "rad"),
    Case("map without a column", _map("pressure_a_pa"), "pressure_a_pa", "="),
    Case("map of an absent column", _map("pressure_a_pa=P1:kPa"), "P1", "pressure_a_pa"),
    Case(
        "map to an unknown target",
        _map("presure_a_pa=pressure_a_pa:Pa"),
        "presure_a_pa",
        "pressure_a_pa",
    ),
    Case("rig not TOML", _rig("[air]", "[air"), "rig.toml", "fix that line"),
    Case("rig key missing", _rig("area_a_m2 = 4.524e-4\n", ""), "area_a_m2", "add `area_a_m2"),
    Case("rig key misspelt", _rig("area_a_m2", "area_a_m"), "area_a_m", "did you mean"),
    Case("rig section misspelt", _rig("[cylinder]", "[cilinder]"), "cilinder", "cylinder"),
    Case(
        "negative area",
        _rig("area_a_m2 = 4.524e-4", "area_a_m2 = -4.524e-4"),
        "[cylinder] area_a_m2",
        "m2",
    ),
    Case(
        "area in mm2",
        _rig("area_a_m2 = 4.524e-4", "area_a_m2 = 452.4"),
        "[cylinder] area_a_m2",
        "mm2",
    ),
    Case(
        "temperature in Celsius",
        _rig("temperature_k = 293.15", "temperature_k = 20.0"),
        "[air] temperature_k",
        "273.15",
    ),
    Case(
        "gauge supply",
        _rig("supply_pressure_pa = 300000.0", "supply_pressure_pa = 2.0"),
        "[air] supply_pressure_pa",
        "absolute",
    ),
    Case("rig number in quotes", _rig("0.0375", '"0.0375"'), "pitch_radius_m", "quotes"),
    Case("orientation unknown", _rig('"horizontal"', '"sideways"'), "orientation", "vertical"),
    Case(
        "offset within the stroke",
        _rig("offset_a_m = 0.075", "offset_a_m = 0.05"),
        "offset_a_m",
        "half the stroke",
    ),
    Case(
        "counts without resolution",
        lambda w: (
            w.header("theta_rad", "encoder_counts"),
            w.rig_line("encoder_counts_per_rev = 80000\n", ""),
        ),
        "encoder_counts_per_rev",
        "[sensors]",
    ),
    Case(
        "campaign missing",
        lambda w: w.arguments.__setitem__(slice(None), ["fit", "absent.toml", "-o", "b.json"]),
        "absent.toml",
        "campaign file",
    ),
    Case("campaign without rig", _campaign(LOG_ENTRY), "campaign.toml", "rig ="),
    Case(
        "campaign path missing",
        _campaign('rig = "rig.toml"\n' + LOG_ENTRY.replace("run.csv", "gone.csv")),
        "entry 1 (gone.csv)",
        "relative to the campaign",
    ),
    Case(
        "campaign kind unknown",
        _campaign('rig = "rig.toml"\n' + LOG_ENTRY.replace("friction-static", "friction")),
        "entry 1",
        "friction-static",
    ),
    Case(
        "campaign key misspelt",
        _campaign('rig = "rig.toml"\n' + LOG_ENTRY + 'usee = "fit"\n'),
        "usee",
        "use",
    ),
    Case(
        "fit and holdout at once",
        _campaign('rig = "rig.toml"\n' + LOG_ENTRY + LOG_ENTRY + 'use = "holdout"\n'),
        "run.csv",
        "give it one use",
    ),
    Case(
        "bundle of another schema",
        _bundle('{"schema": "sysid-bundle/9"}'),
        "bundle.json",
        "fit again",
    ),
    Case("bundle not JSON", _bundle('{"schema": '), "bundle.json, line 1", "again"),
    Case(
        "bundle with a missing key",
        _bundle('{"schema": "sysid-bundle/1"}'),
        "bundle.json",
        "fix that key",
    ),
    Case(
        "bundle with NaN",
        _bundle('{"schema": "sysid-bundle/1", "created": NaN}'),
        "bundle.json",
        "finite",
    ),
    Case(
        "bundle beyond the range of numbers",
        _bundle('{"schema": "sysid-bundle/1", "created": 1e999}'),
        "bundle.json: holds 1e999",
        "finite",
    ),
    Case(
        "bundle with an endless whole number",
        _bundle('{"schema": "sysid-bundle/1", "created": %s}' % ("9" * 5000)),
        "bundle.json: holds 99999",
        "finite",
    ),
    Case("bundle nested without end", _bundle("[" * 200_000), "bundle.json", "again"),
    Case(
        "seed below zero",
        lambda w: w.arguments.__setitem__(
            slice(None), ["fit", "valve-pwm", str(w.log), "--seed", "-1"]
        ),
        "--seed",
        "--help",
    ),
    Case("cut-off zero", lambda w: w.arguments.extend(["--cutoff", "0"]), "--cutoff", "omit it"),
    Case(
        "cut-off no number",
        lambda w: w.arguments.extend(["--cutoff", "nan"]),
        "--cutoff",
        "omit it",
    ),
    Case(
        "payload without its length",
        _rig("equivalent_kg_m2 = 0.02368", "equivalent_kg_m2 = 0.02368\npayload_mass_kg = 0.5"),
        "rig.toml: [inertia] payload_length_m",
        "from the shaft",
    ),
    Case(
        "carriage returns alone",
        lambda w: w.log.write_text(as_text(good_rows(), end="\r"), newline=""),
        "run.csv",
        "save it again",
    ),
    Case(
        "no column that is known",
        _raw(b"t,P1,P2\n0,1,2\n1,1,2\n2,1,2\n"),
        "run.csv: column time_s is missing (it has t, P1, P2)",
        '--map "time_s=',
    ),
    Case("unknown option", lambda w: w.arguments.append("--colour"), "--colour", "--help"),
    Case(
        "unknown command",
        lambda w: w.arguments.__setitem__(slice(None), ["frobnicate"]),
        "frobnicate",
        "--help",
    ),
    Case(
        "output folder missing",
        lambda w: (
            w.log.write_text(as_text(_breakaway_rows())),
            w.arguments.extend(["-o", str(w.folder / "no" / "b.json")]),
        ),
        "b.json",
        "folder",
    ),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_bad_input_is_one_line_with_place_and_fix(
    case: Case, tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    work = Workplace(tmp_path, rig_text)
    case.spoil(work)
    before = sorted(p.name for p in tmp_path.iterdir())
    code = main(work.arguments)
    captured = capsys.readouterr()
    lines = [x for x in captured.err.splitlines() if not x.startswith("sysid: notice: ")]
    assert code == 2, captured.err
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("sysid: error: ")
    assert case.place in lines[0]
    assert case.fix in lines[0].split("; ", 1)[-1] or case.fix in lines[0]
    assert "Traceback" not in captured.err
    assert captured.out == ""
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_there_are_at_least_forty_distinct_kinds() -> None:
    assert len({case.name for case in CASES}) == len(CASES) >= 40


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + as_text(good_rows()),
        as_text(good_rows(), end="\r\n"),
        "# rig: arm\n# operator\n" + as_text(good_rows()),
        as_text(good_rows()) + "\n\n",
        as_text(good_rows())[:-1],
        as_text([[*r, "7"] for r in good_rows()], HEADER + ",cabinet_temperature"),
        as_text([[*r, "7", "8"] for r in good_rows()], HEADER + ",spare,spare"),
        as_text([[*r, "off"] for r in good_rows()], HEADER + ",flow_a_kg_s"),
        "# a long story\n" * 20_000 + as_text(good_rows()),
    ],
    ids=[
        *("BOM", "CRLF", "comments", "blank lines at the end", "no last line end"),
        *("unknown column", "two of a name", "a column of another kind of test", "long comments"),
    ],
)
def test_harmless_dialects_are_read(
    text: str, tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    work = Workplace(tmp_path, rig_text)
    work.log.write_bytes(text.encode())
    assert main(["check", str(work.log)]) == 0, capsys.readouterr().err


def test_a_fault_of_the_program_is_told_from_bad_input(
    tmp_path: Path,
    rig_text: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    work = Workplace(tmp_path, rig_text)
    import sysid.io.logs

    def broken(*_: object) -> None:
        raise ZeroDivisionError("inside")

    monkeypatch.setattr(sysid.io.logs, "read_table", broken)
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    assert main(work.arguments) == 1
    assert "fault" in capsys.readouterr().err
