"""Tables of text as programs export them: preambles, headings, rows that are none, damage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest
from foreign_files import log_of, refused

from sysid.errors import InputError
from sysid.io.conversion import ConversionReport, convert
from sysid.io.foreign import ForeignTable, ReadOptions, read_foreign
from sysid.io.listing import channels_of

ROWS = 40
TIME = np.arange(ROWS) / 1000.0
POSITION = np.round(50.0 + 8.0 * np.sin(30.0 * TIME), 4)  # mm
FORCE = np.round(5.0 * np.cos(30.0 * TIME), 4)
BY_NAME = ("time_s=t", "position_m=pos:mm", "motor_force_n=u")
BY_NUMBER = ("time_s=#1", "position_m=#2:mm", "motor_force_n=#3")


def rows(sep: str = ",", decimal: str = ".", end: str = "") -> str:
    cells = (
        [f"{a:.3f}", f"{b:.4f}", f"{c:.4f}"] for a, b, c in zip(TIME, POSITION, FORCE, strict=True)
    )
    return "".join(sep.join(row).replace(".", decimal) + end + "\n" for row in cells)


def read(tmp_path: Path, text: str | bytes, *maps: str, **how: object) -> ConversionReport:
    path = tmp_path / "rec.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return convert(path, tmp_path / "log.csv", maps=maps, **how)  # type: ignore[arg-type]


def expect(tmp_path: Path) -> None:
    """The log holds TIME, POSITION and FORCE, to the last digit."""
    frame = log_of(tmp_path / "log.csv")
    assert frame["time_s"].tolist() == TIME.tolist()
    assert frame["position_m"].tolist() == (POSITION / 1000.0).tolist()
    assert frame["motor_force_n"].tolist() == FORCE.tolist()


def table_of(tmp_path: Path, text: str, *names: str) -> ForeignTable:
    path = tmp_path / "rec.csv"
    path.write_text(text)
    with path.open("rb") as file:
        return read_foreign(path, file, ReadOptions(names=names))


# --- preambles and headings -----------------------------------------------------------

SCOPE = "Model,MSO24\nProbe Attenuation,1,1\nVertical Offset,0,0\n,,\nLabel,,\n"
BANNER = "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2024.05.06 14:22:10 =~=~=~=~=~=~=~=~=~=~=~=\n"
LECROY = (
    "LECROYWR64Xi,12345,Waveform\nSegments,1,SegmentSize,40\nSegment,TrigTime,TimeSinceSegment1\n"
    "#1,20-Nov-2012 15:32:30,0\n"
)
HEADINGS = {
    "plain": "t,pos,u\n" + rows(),
    "scope": SCOPE + "t,pos,u\n" + rows(),
    "LeCroy": LECROY + "t,pos,u\n" + rows(),
    "PicoScope": "t,pos,u\n(s),(mm),(V)\n\n" + rows(),
    "Rigol": "t(s),pos(V),u(V),\n" + rows(end=","),
    "Siglent": "Source,pos,u\nt,Volt,Volt\n" + rows(),
    "Siemens": '"Trace";"X"\n"Date";"06.05.2024 14:22:10"\n\n"t";"pos";"u"\n"s";"mm";"N"\n'
    + rows(";", ","),
    "PuTTY": BANNER + "t,pos,u\n" + rows(),
    "long": "".join(f"Key{i},{i}\n" for i in range(300)) + "t,pos,u\n" + rows(),
    "rostopic": "%t,pos,u\n" + rows(),
    "savetxt": "# run of May\n# t pos u\n" + rows(" "),
    "comments": "# rig 3\nt\tpos\tu\tComment\n" + rows("\t"),
    "trailing": "t;pos;u;\n" + rows(";", ",", ";"),
    "trailing heading": "t;pos;u;\n" + rows(";", ","),
    "quoted decimal commas": '"t","pos","u"\n'
    + "".join(f'"{line}"\n' for line in rows('","', ",").splitlines()),
    "serial monitor": "".join(
        f"13:29:30.{i:03d} -> {line}\n" for i, line in enumerate(["t,pos,u", *rows().splitlines()])
    ),
    "period in the heading": "t,pos,u,t0 = -1.0e-3, tInc = 1.0e-3,\n" + rows(end=",,"),
    "labelled names": '"Model","DL850"\n"TraceName","t","pos","u"\n"BlockSize",40,40,40\n'
    + '"VUnit","s","mm","N"\n"Date","2024/05/02","2024/05/02","2024/05/02"\n\n'
    + rows(),
    "labelled names, trailing": '"TraceName","t","pos","u"\n"BlockSize",40,40,40\n' + rows(end=","),
    "signs apart": "t,pos,u\n" + rows().replace("-", "- ").replace(",5", ",+ 5"),
    "Fortran's exponents": "t pos u\n" + rows(" ").replace("\n", "D+00\n"),
    "blanks that do not break": "t\u00a0;pos;u\n" + rows(";").replace(";5", "\u00a0;\u202f5"),
    "in brackets": "t [s],pos [mm],u [N]\n" + rows(),
    "blanks and brackets": "t [s] pos [mm] u [N]\n" + rows(" "),
}


@pytest.mark.parametrize("style", HEADINGS)
def test_the_heading_is_found(tmp_path: Path, style: str) -> None:
    read(tmp_path, HEADINGS[style], *BY_NAME)
    expect(tmp_path)
    if not style.startswith("Siglent"):
        read(tmp_path, HEADINGS[style], *BY_NUMBER)
        expect(tmp_path)


def test_numbers_amid_the_lines_above(tmp_path: Path) -> None:
    """National Instruments' SignalExpress."""
    above = (
        "channel names: \nt\tpos\tu\nstart times: \n05/14/2024 01:29:30 PM\t05/14/2024 01:29:30 PM"
    )
    above += "\t05/14/2024 01:29:30 PM\ndt: \n0.001\t0.001\t0.001\ndata: \n"
    for maps in (BY_NAME, BY_NUMBER):
        read(tmp_path, above + rows("\t"), *maps)
        expect(tmp_path)


@pytest.mark.parametrize(("group", "option"), [("\u00a0", " "), ("\u202f", " "), ("\u2019", "'")])
def test_signs_that_no_keyboard_has(tmp_path: Path, group: str, option: str) -> None:
    cells = "".join(f"{i},0;1{group}{i:03d},25;\u2212{i},5\n" for i in range(20))
    maps = ("time_s=t", "position_m=x", "motor_force_n=u")
    read(tmp_path, "t;x;u\n" + cells, *maps, thousands=option)
    frame = log_of(tmp_path / "log.csv")
    assert frame["position_m"].tolist() == [1000.25 + i for i in range(20)]
    assert frame["motor_force_n"].tolist() == [-i - 0.5 for i in range(20)]


@pytest.mark.parametrize(
    "stamp",
    [
        "14.05.2024 13:29:{:02d},500",
        "14.05.24 13:29:{:02d}.5",
        "14/05/2024 13:29:{:02d}.500",
        "05/14/2024 01:29:{:02d}.500 PM",
        "05/04/2024 13:29:{:02d}",
        "2024-05-14 13:29:{:02d}.500",
        "13:29:{:02d}.500",
        "01:29:{:02d}.500 PM",
        "13:29:{:02d}:500",
        "29:{:02d}.500",
    ],
)
def test_dates_as_countries_write_them(tmp_path: Path, stamp: str) -> None:
    lines = ["t;u", *(f"{stamp.format(10 + i)};{i}" for i in range(20))]
    maps = ("time_s=t", "motor_force_n=u")
    read(tmp_path, "\n".join(lines) + "\n", *maps)
    assert log_of(tmp_path / "log.csv")["time_s"].tolist() == list(range(20))
    for cell in ("", stamp.format(15).replace("1", "l"), "4"):
        spoilt = [*lines[:12], f"{cell};11", *lines[13:]]
        with pytest.raises(InputError, match="line 13: column t") as caught:
            read(tmp_path, "\n".join(spoilt) + "\n", *maps)
        assert repr(cell)[:20].rstrip("'") in str(caught.value) or not cell


def test_a_date_of_two_readings(tmp_path: Path) -> None:
    cells = "".join(
        f"0{4 + i // 10}/05/2024 {'23:59:50' if i < 10 else '00:00:00'};1\n" for i in range(20)
    )
    with pytest.raises(InputError, match="either number may be the day"):
        read(tmp_path, "t;u\n" + cells, "time_s=t", "motor_force_n=u")


def test_names_that_are_numbers(tmp_path: Path) -> None:
    text = "x-axis,1,2\nsecond,Volt,Volt\n" + rows()
    read(tmp_path, text, "time_s=x-axis", "position_m=1:mm", "motor_force_n=2")
    expect(tmp_path)


def test_a_comment_sign_may_be_part_of_the_name(tmp_path: Path) -> None:
    read(tmp_path, HEADINGS["rostopic"], "time_s=%t", *BY_NAME[1:])
    expect(tmp_path)


def test_nanoseconds_since_1970_keep_their_digits(tmp_path: Path) -> None:
    start = 1_715_004_130_123_456_789
    cells = "".join(f"{start + 1_000_003 * i},{v:.4f}\n" for i, v in enumerate(FORCE))
    maps = ("time_s=%time:ns", "motor_force_n=field.u")
    report = read(tmp_path, "%time,field.u\n" + cells, *maps)
    frame = log_of(tmp_path / "log.csv")
    assert frame["time_s"].tolist() == [1_000_003 * i / 1e9 for i in range(ROWS)]
    assert any(f"time counts from {start}" in notice for notice in report.notices)
    later = start + 500_000_000
    other = tmp_path / "other.csv"
    other.write_text(f"%time,p\n{start - 10**9},0\n{later},15\n")
    how = {"join": [other], "join_maps": ["time_s=%time:ns", "pressure_a_pa=p"]}
    read(tmp_path, "%time,field.u\n" + cells, *maps, **how)
    joined = log_of(tmp_path / "log.csv")["pressure_a_pa"]
    assert joined.iloc[0] == pytest.approx(10.0, rel=1e-6)


@pytest.mark.parametrize("maps", [BY_NAME[1:], ("time_s=X", *BY_NAME[1:])])
def test_period_of_a_scope_that_states_it(tmp_path: Path, maps: tuple[str, ...]) -> None:
    cells = "".join(
        f"{i},{b:.4f},{c:.4f},,\n" for i, (b, c) in enumerate(zip(POSITION, FORCE, strict=True))
    )
    text = "X,pos,u,Start,Increment\nSequence,Volt,Volt,0.0,1.0E-3\n" + cells
    report = read(tmp_path, text, *maps)
    expect(tmp_path)
    assert any("the file's own period, 0.001 s" in notice for notice in report.notices)


def test_settings_over_no_column_of_the_rows(tmp_path: Path) -> None:
    """Rigol: the period stands in the row of units, beyond the rows' cells."""
    cells = "".join(
        f"{i},{b:.4f},{c:.4f},\n" for i, (b, c) in enumerate(zip(POSITION, FORCE, strict=True))
    )
    text = "X,pos,u,Start,Increment,\nSequence,Volt,Volt,0.0,1.0E-3,\n" + cells
    for how in ({}, {"period_s": 0.001}):
        read(tmp_path, text, *BY_NAME[1:], **how)
        expect(tmp_path)
    (listing,) = channels_of([tmp_path / "rec.csv"])
    told = [(channel.name, channel.unit, channel.period_s) for channel in listing.channels]
    assert told == [("X", None, 0.001), ("pos", "Volt", 0.001), ("u", "Volt", 0.001)]


YOKOGAWA = (
    '"HEADER SIZE",8\n"Model Name","DLM2024"\n"TraceName","t","pos","u"\n"BlockSize",40,40,40\n'
    '"VUnit","s","mm","N"\n"SampleRate",1E+03,1E+03,1E+03\n"HUnit","s","s","s"\n\n'
)


def test_names_amid_a_header_of_settings(tmp_path: Path) -> None:
    """Yokogawa: lines of the header have a cell for each column, some of them numbers."""
    body = "".join(f",{line},\n" for line in rows().splitlines())
    report = read(tmp_path, YOKOGAWA + body, *BY_NAME)
    expect(tmp_path)
    assert any("line 4 and 2 more passed over" in notice for notice in report.notices)
    read(tmp_path, YOKOGAWA + body, "time_s=#2", "position_m=#3:mm", "motor_force_n=#4")
    expect(tmp_path)
    spoilt = body.replace(",0.005,", ",,0.005,")
    with pytest.raises(InputError, match="line 14"):
        read(tmp_path, YOKOGAWA + spoilt, *BY_NAME)


def test_settings_of_numbers_right_above_the_rows(tmp_path: Path) -> None:
    """Yokogawa: they have a cell for each column, as rows have, but no row has a word there."""
    above = YOKOGAWA.rstrip() + '\n"HResolution",1E-03,1E-03,1E-03\n"BlockSize",40,40,40\n\n'
    body = "".join(f",{line}\n" for line in rows().splitlines())
    for maps in (BY_NAME, ("time_s=#2", "position_m=#3:mm", "motor_force_n=#4")):
        read(tmp_path, above + body, *maps)
        expect(tmp_path)


def test_short_tests_each_under_names_and_units(tmp_path: Path) -> None:
    """As many lines of words as rows: the rows, not the majority, show what is a number."""
    lines = rows().splitlines()
    parts = ["\n".join(lines[at : at + 2]) for at in (0, 2, 4)]
    report = read(tmp_path, "".join(f"t,pos,u\ns,mm,N\n{part}\n\n" for part in parts), *BY_NAME)
    assert report.tests == ("1", "2", "3") and report.rows == 6


def test_settings_beside_the_rows(tmp_path: Path) -> None:
    """Tektronix: the first rows have a setting and its value in columns of their own."""
    lines = rows().splitlines()
    beside = ["Record Length,40,", "Source,CH1,", "Vertical Units,V,"]
    text = [f"{beside[i] if i < 3 else ',,'},{line}" for i, line in enumerate(lines)]
    maps = ("time_s=#4", "position_m=#5:mm", "motor_force_n=#6")
    read(tmp_path, "\n".join(text) + "\n", *maps, no_header=True)
    expect(tmp_path)
    text[1] = text[1].replace(",0.001,", ",0.0O1,")
    with pytest.raises(InputError, match="line 2"):
        read(tmp_path, "\n".join(text) + "\n", *maps, no_header=True)


@pytest.mark.parametrize("style", ["trailing", "serial monitor", "trailing heading"])
@pytest.mark.parametrize("row", [3, 36])
def test_a_row_shifted_by_a_cell_is_named(tmp_path: Path, style: str, row: int) -> None:
    lines = HEADINGS[style].splitlines(keepends=True)
    sign = ";" if ";" in lines[0] else ","
    lines[row] = sign + lines[row].replace(sign + "\n", "\n")
    with pytest.raises(InputError, match=f"line {row + 1}"):
        read(tmp_path, "".join(lines), *BY_NAME)


def test_remarks_in_the_first_rows_are_no_settings(tmp_path: Path) -> None:
    lines = rows().splitlines()
    text = "note,t,pos,u\nwarm,{}\nagain,{}\n".format(*lines[:2])
    read(tmp_path, text + "".join(f",{line}\n" for line in lines[2:]), *BY_NAME)
    expect(tmp_path)


@pytest.mark.parametrize(
    "heading",
    [
        "t,pos,u\nUnit: s,Unit: cm,Unit: 1\nInterp: linear,Interp: zoh,Interp: zoh\n",
        "t,pos,u\n,Lage,Kraft\ns,cm,\n",
        "s,cm,\nt,pos,u\n",
        "t,pos,u\n,,\n[s],[cm],\n",
    ],
)
def test_a_row_of_units_wherever_it_stands(tmp_path: Path, heading: str) -> None:
    report = read(tmp_path, heading + rows(), *BY_NAME)
    expect(tmp_path)
    assert any("pos is in 'cm' by the file, mapped as 'mm'" in line for line in report.notices)


def test_what_stands_above_is_said(tmp_path: Path) -> None:
    report = read(tmp_path, SCOPE + "t,pos,u\n" + rows(), *BY_NAME)
    assert any("begins in line 6;" in n and "(--skip-rows 5)" in n for n in report.notices)


def test_units_as_the_heading_states_them(tmp_path: Path) -> None:
    table = table_of(tmp_path, "t;pos [mm];x_mm;act;F (raw)\ns;;;%;\n1;2;3;4;5\n2;3;4;5;6\n")
    assert table.units == {"t": "s", "pos [mm]": "mm", "x_mm": "mm", "act": "%"}


def test_names_without_their_unit_must_tell_columns_apart(tmp_path: Path) -> None:
    text = "t,p [bar],p [kPa],u\n1,2,3,4\n2,3,4,5\n"
    with pytest.raises(
        InputError, match=r"has no column 'p'.*its columns are t, p \[bar\], p \[kPa\]"
    ):
        read(tmp_path, text, "time_s=t", "pressure_a_pa=p")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("t,pos,u,w\n" + rows(), "line 1: 4 column names over 3 fields.*--skip-rows 1"),
        ("t,pos\n" + rows(), "line 1: 2 column names over 3 fields"),
        ("T,Pos,U\n" + rows(), "has no column 't'"),
        (rows(), "has no column 't'.*#1"),
    ],
)
def test_headings_that_do_not_fit(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        read(tmp_path, text, *BY_NAME)


def test_sheet_with_rows_above_its_names(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    for row in (["Rig", 3], ["Date", "today", "x"], ["t", "q [deg]"], ["s", "deg"]):
        book.active.append(row)
    for time in range(5):
        book.active.append([time, 2.0 * time])
    book.save(tmp_path / "rec.xlsx")
    convert(tmp_path / "rec.xlsx", tmp_path / "log.csv", maps=["time_s=t", "theta_rad=q"])
    angle = np.degrees(log_of(tmp_path / "log.csv")["theta_rad"])
    np.testing.assert_allclose(angle, [0.0, 2.0, 4.0, 6.0, 8.0])


def test_sheet_with_descriptions_over_its_units(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    for row in (["AI01", "AI02", "t"], ["Druck A", "Winkel", "Zeit"], ["mbar", "deg", "s"]):
        book.active.append(row)
    for time in range(5):
        book.active.append([1000 + time, time, time])
    book.save(tmp_path / "rec.xlsx")
    maps = ["time_s=t", "pressure_a_pa=AI01", "theta_rad=AI02:rad"]
    report = convert(tmp_path / "rec.xlsx", tmp_path / "log.csv", maps=maps)
    assert log_of(tmp_path / "log.csv")["pressure_a_pa"].tolist()[:2] == [100000.0, 100100.0]
    assert any("2 rows of words under the names skipped" in line for line in report.notices)
    assert any("AI02 is in 'deg' by the file" in line for line in report.notices)


# --- lines that are no rows ------------------------------------------------------------

HALF = rows().splitlines(keepends=True)
PASSED = {
    "EOF": (rows() + "EOF\n", "line 42 passed over.*EOF"),
    "padding": (rows() + ",,\n,,\n\nEND\n", "line 42 and 1 more passed over, without values"),
    "footer": (rows() + "\nrecorded by logger\n", "line 43 passed over.*recorded"),
    "long footer": (
        rows() + "".join(f"Statistic {i}: none\n" for i in range(15)),
        "line 42 and 14 more passed over",
    ),
    "comment": ("".join([*HALF[:9], "# paused\n", *HALF[9:]]), "line 11 passed over, a comment"),
    "zeros": (rows() + "\0" * 9000, "9000 zero bytes"),
}


@pytest.mark.parametrize("style", PASSED)
def test_lines_passed_over(tmp_path: Path, style: str) -> None:
    text, what = PASSED[style]
    report = read(tmp_path, "t,pos,u\n" + text, *BY_NAME)
    expect(tmp_path)
    assert pd.Series(report.notices).str.contains(what).any(), report.notices


def test_signals_in_rows(tmp_path: Path) -> None:
    columns = [line.split(",") for line in rows().splitlines()]
    lines = [[name, *cells] for name, cells in zip("tpu", zip(*columns, strict=True), strict=True)]
    maps = ("time_s=t", "position_m=p:mm", "motor_force_n=u")
    text = "".join(",".join(line) + "\n" for line in lines)
    read(tmp_path, text, *maps, transpose=True)
    expect(tmp_path)
    united = "".join(
        ";".join([line[0], unit, *line[1:]]).replace(".", ",") + "\n"
        for line, unit in zip(lines, ("s", "mm", "N"), strict=True)
    )
    read(tmp_path, united, *maps, transpose=True)
    expect(tmp_path)
    spec = tmp_path / "lab.toml"
    spec.write_text("[options]\ntranspose = true\nheader = false\n")
    bare = "".join(" ".join(line[1:]) + "\n" for line in lines)
    read(tmp_path, bare, *BY_NUMBER, spec_file=spec)
    expect(tmp_path)
    with pytest.raises(InputError, match=r"value 4 of the line: column p .* is empty"):
        read(tmp_path, text.replace(lines[1][4], "", 1), *maps, transpose=True)


def test_sheet_of_signals_in_rows(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.append(["t", 0.0, 0.1, 0.2])
    book.active.append(["q", 1.0, 2.0, 4.0])
    book.save(tmp_path / "rec.xlsx")
    maps = ["time_s=t", "theta_rad=q"]
    convert(tmp_path / "rec.xlsx", tmp_path / "log.csv", maps=maps, transpose=True)
    assert log_of(tmp_path / "log.csv")["theta_rad"].tolist() == [1.0, 2.0, 4.0]
    pd.DataFrame({"t": TIME, "q": FORCE}).to_parquet(tmp_path / "rec.parquet")
    refused(
        tmp_path / "rec.parquet", tmp_path / "x.csv", "omit --transpose", maps=maps, transpose=True
    )


# --- damage: named, or said ------------------------------------------------------------


def _cell(row: int, column: int, text: str | None) -> Callable[[list[list[str]]], None]:
    def change(cells: list[list[str]]) -> None:
        if text is None:
            cells[row].pop(column)
        else:
            cells[row][column] = text

    return change


def _run_together(cells: list[list[str]]) -> None:
    following = cells.pop(11)
    cells[10][-1] += following[0]
    cells[10] += following[1:]


DAMAGE: dict[str, tuple[Callable[[list[list[str]]], None], str]] = {
    "an empty cell": (_cell(10, 1, ""), "line 12: column pos .* is empty"),
    "an empty last cell": (_cell(10, 2, ""), "line 12: column u .* is empty"),
    "a cell that is missing": (_cell(10, 1, None), "line 12: the row ends early: 2 of 3 fields"),
    "a first row cut short": (_cell(0, 1, None), "line 2: the row ends early"),
    "a word": (_cell(10, 1, "err"), "line 12: column pos .* holds 'err'"),
    "a word in the first row": (_cell(0, 0, "x0"), "line 2: column t .* holds 'x0'|holds 'x0'"),
    "a decimal comma": (_cell(10, 1, "50,1"), "line 12: 4 fields where the other lines have 3"),
    "rows run together": (_run_together, "line 12: 5 fields where the other lines have 3"),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("above", ["", SCOPE])
def test_a_damaged_row_is_named(tmp_path: Path, damage: str, above: str) -> None:
    change, what = DAMAGE[damage]
    cells = [line.split(",") for line in rows().splitlines()]
    change(cells)
    text = above + "t,pos,u\n" + "".join(",".join(row) + "\n" for row in cells)
    if above:
        what = what.replace("line 12", "line 17").replace("line 2:", "line 7:")
    with pytest.raises(InputError, match=what):
        read(tmp_path, text, *BY_NAME)


def test_a_line_cut_within_its_last_number(tmp_path: Path) -> None:
    for cut in (2, 3, 6, 9, 15):
        with pytest.raises(InputError, match=r"line 41: .*(cut off|ends early)"):
            read(tmp_path, ("t,pos,u\n" + rows())[:-cut], *BY_NAME)


def test_another_heading_amid_the_rows(tmp_path: Path) -> None:
    text = "".join(["t,pos,u\n", *HALF[:9], "u,pos,t\n", *HALF[9:]])
    with pytest.raises(InputError, match=r"line 11: words amid the rows \('u,pos,t'\)"):
        read(tmp_path, text, *BY_NAME)


@pytest.mark.parametrize("wider_first", [True, False])
def test_a_second_heading_of_other_columns_loses_no_rows(tmp_path: Path, wider_first: bool) -> None:
    """A logger that appends, whose program got a column more between two recordings."""
    plain = "t,pos,u\n" + rows()
    wider = "t,pos,u,extra\n" + rows().replace("\n", ",1\n")
    text = wider + plain if wider_first else plain + wider
    with pytest.raises(InputError, match=r"line 42: a second heading.* line 1 .*--skip-rows 41"):
        read(tmp_path, text, *BY_NAME)
    read(tmp_path, text, *BY_NAME, skip_rows=41)
    expect(tmp_path)


def test_signals_in_rows_are_named(tmp_path: Path) -> None:
    columns = [line.split(",") for line in ("t,pos,u\n" + rows()).splitlines()]
    text = "".join(",".join(signal) + "\n" for signal in zip(*columns, strict=True))
    with pytest.raises(InputError, match=r"line 1: 't' names the line.*--transpose"):
        read(tmp_path, text, *BY_NAME)


@pytest.mark.parametrize("again", ["T,Pos,U", "t, pos, u", '"t","pos","u"', "\ufefft,pos,u,"])
def test_a_heading_again_in_other_signs(tmp_path: Path, again: str) -> None:
    report = read(tmp_path, f"t,pos,u\n{rows()}{again}\n{rows()}", *BY_NAME)
    assert report.tests == ("1", "2")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_text_of_wide_signs(tmp_path: Path, encoding: str) -> None:
    read(tmp_path, ("t;pos;u;µ\n" + rows(";", end=";0")).encode(encoding), *BY_NAME)
    expect(tmp_path)


def test_what_instruments_send_in_place_of_a_number(tmp_path: Path) -> None:
    lines = rows().splitlines()
    for cell, what in (("9.91E+37", "empty or not a number"), ("-9.9E+37", "infinite")):
        lines[4] = f"0.004,{cell},1.0"
        with pytest.raises(InputError, match=f"line 6: column pos .* is {what}"):
            read(tmp_path, "\n".join(["t,pos,u", *lines, ""]), *BY_NAME)


def test_decimal_commas_between_commas_are_named(tmp_path: Path) -> None:
    text = "t,pos,u\n" + "".join(f"0,{i:03d},5,{i},7,2\n" for i in range(40))
    with pytest.raises(InputError, match=r"line 1: 3 column names over 6 fields: .*decimal commas"):
        read(tmp_path, text, *BY_NAME)


@pytest.mark.parametrize(
    "above",
    [
        "Messung;12;\n",
        "Device;MX100;\nSerial;4711;2\nDate;01.02.2026;\n",
        "Device;MX100\n2026-02-01 10:00;;\n",
    ],
)
def test_a_preamble_of_as_many_cells_again_with_its_heading(above: str, tmp_path: Path) -> None:
    """A logger that appends writes all of its head again at each start."""
    one = f"{above}t;pos;u\ns;mm;N\n{rows(';', ',')}"
    report = read(tmp_path, one + one, *BY_NAME)
    assert report.tests == ("1", "2")
    assert log_of(tmp_path / "log.csv")["motor_force_n"].tolist() == [*FORCE, *FORCE]
    first = one.count("\n") + 1
    assert any(f"line {first} and" in notice for notice in report.notices)


def test_a_row_above_a_second_heading_is_no_preamble(tmp_path: Path) -> None:
    damaged = rows(";").replace("0.039", "o.039")
    with pytest.raises(InputError, match=r"line 42: column t .* holds 'o.039'"):
        read(tmp_path, f"Serial;4711;2\nt;pos;u\n{damaged}t;pos;u\n{rows(';')}", *BY_NAME)


def test_a_footer_of_statistics(tmp_path: Path) -> None:
    text = f"t,pos,u\n{rows()}\nMin,42.0,-5.0\nMax,58.0,5.0\nMean,50.0,0.1\n"
    report = read(tmp_path, text, *BY_NAME)
    expect(tmp_path)
    assert any("line 43 and 2 more passed over" in notice for notice in report.notices)
    amid = f"t,pos,u\n{rows()}Min,42.0,-5.0\n{rows()}"
    with pytest.raises(InputError, match=r"line 42: column t .* holds 'Min'"):
        read(tmp_path, amid, *BY_NAME)


def test_settings_between_the_names_and_the_rows(tmp_path: Path) -> None:
    text = f"Channel,1,2\nt,pos,u\nUnit,mm,N\nGain,1.0,2.0\nOffset,0.0,0.0\n{rows()}"
    report = read(tmp_path, text, *BY_NAME)
    expect(tmp_path)
    assert any("line 4 and 1 more passed over" in notice for notice in report.notices)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_names_of_several_lines(tmp_path: Path, end: str) -> None:
    head = '"t\n(s)";"pos\n(mm)";"u\n(N)"\n'.replace("\n", end)
    read(tmp_path, head + rows(";", ","), *BY_NAME)
    expect(tmp_path)
    text = f'Bore;5" pipe;\nt;pos;u\n{rows(";", ",").replace("0,038", "o,038")}'
    with pytest.raises(InputError, match=r"line 41: column t .* holds 'o,038'"):
        read(tmp_path, text, *BY_NAME)


def sheet_of(path: Path, *lines: Sequence[object]) -> None:
    book = openpyxl.Workbook()
    for line in lines:
        book.active.append(list(line))
    book.save(path)


DATA = [list(row) for row in zip(TIME.tolist(), POSITION.tolist(), FORCE.tolist(), strict=True)]


@pytest.mark.parametrize("above", [[], [["Serial", 4711, 2], ["Device", "MX", None]]])
def test_a_sheet_whose_heading_repeats(tmp_path: Path, above: list[list[object]]) -> None:
    path, out = tmp_path / "rec.xlsx", tmp_path / "log.csv"
    one = [*above, ["t", "pos", "u"], ["s", "mm", "N"], *DATA]
    sheet_of(path, *one, *one, ["Mean", 50.0, 0.1])
    report = convert(path, out, maps=BY_NAME)
    assert report.tests == ("1", "2")
    frame = log_of(out)
    assert frame["time_s"].tolist() == [*TIME, *TIME]
    assert frame["motor_force_n"].tolist() == [*FORCE, *FORCE]
    first = len(one) + 1
    assert any(f"row {first} and" in notice for notice in report.notices)
    assert any(f"row {first + len(above) + 2}: 2 tests" in notice for notice in report.notices)


def test_a_sheet_of_numbers_as_text(tmp_path: Path) -> None:
    path = tmp_path / "rec.xlsx"
    sheet_of(path, ["t", "pos", "u"], *([str(v).replace(".", ",") for v in row] for row in DATA))
    with pytest.raises(InputError, match=r"'50,0', not a number; .*--decimal"):
        convert(path, tmp_path / "log.csv", maps=["time_s=t", "position_m=pos:mm"])
    convert(path, tmp_path / "log.csv", maps=BY_NAME, decimal=",")
    expect(tmp_path)
