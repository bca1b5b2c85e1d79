"""LabVIEW's measurement files and TwinCAT Scope's exports, in the layout of these programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from foreign_files import log_of

from sysid.errors import InputError
from sysid.io.conversion import ConversionReport, convert

ROWS = 40
STEPS = np.arange(ROWS)
POSITION = np.round(50.0 + 8.0 * np.sin(0.03 * STEPS), 6)  # mm
FORCE = np.round(5.0 * np.cos(0.03 * STEPS), 6)
MAPS = ("position_m=pos:mm", "motor_force_n=force")


# --- LabVIEW ---------------------------------------------------------------------------


def lvm_head(columns: str, decimal: str = ".", headings: str = "No", sep: str = "\t") -> str:
    word = {"\t": "Tab", ",": "Comma"}[sep]
    lines = [
        "LabVIEW Measurement",
        "Writer_Version\t2",
        "Reader_Version\t2",
        f"Separator\t{word}",
        f"Decimal_Separator\t{decimal}",
        f"Multi_Headings\t{headings}",
        f"X_Columns\t{columns}",
        "Time_Pref\tRelative",
        "Operator\tlab",
        "Date\t2024/05/06",
        f"Time\t10:00:00{decimal}5",
        "***End_of_Header***",
    ]
    return (
        "".join(
            f"{line}\t\n" if i in (0, 11) else f"{line}\n" for i, line in enumerate(lines)
        ).replace("\t", sep)
        + f"{sep}\n"
    )


def lvm_segment(
    columns: str,
    rows: Sequence[Sequence[str]],
    decimal: str = ".",
    samples: Sequence[int] = (ROWS, ROWS),
    period: Sequence[str] = ("0.002000", "0.002000"),
    start: str = "0.0000000000000000E+0",
    sep: str = "\t",
) -> str:
    """A segment's header, heading and rows: Multi leaves each channel two columns."""
    wide = columns == "Multi"

    def spread(key: str, cells: Sequence[object]) -> str:
        text = (sep * 2 if wide else sep).join(str(cell).replace(".", decimal) for cell in cells)
        return f"{key}{sep}{text}{sep}\n"

    time = f"X_Value{sep}"
    names = f"{time}pos{sep}" + (time if wide else "") + f"force{sep}Comment\n"
    head = [
        f"Channels{sep}2" + sep * (4 if wide else 2) + "\n",
        spread("Samples", samples),
        spread("Date", ["2024/05/06"] * 2),
        spread("Time", ["10:00:00.5"] * 2),
        spread("Y_Unit_Label", ["mm", "N"]),
        spread("X_Dimension", ["Time"] * 2),
        spread("X0", [start] * 2),
        spread("Delta_X", period),
        "***End_of_Header***" + sep * (4 if wide else 3) + "\n",
    ]
    body = "".join(sep.join(row).replace(".", decimal) + "\n" for row in rows)
    return "".join(head) + names + body


def lvm_rows(columns: str, period: float = 0.002) -> list[list[str]]:
    cells = []
    for step, position, force in zip(STEPS, POSITION, FORCE, strict=True):
        time = f"{period * step:.6f}"
        own = {"No": ["", f"{position:.6f}", f"{force:.6f}"]}
        own["One"] = [time, *own["No"][1:]]
        own["Multi"] = [time, own["No"][1], time, own["No"][2]]
        cells.append(own[columns])
    return cells


def read(tmp_path: Path, text: str, *maps: str, name: str = "rec.lvm") -> ConversionReport:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return convert(path, tmp_path / "log.csv", maps=maps or MAPS)


def expect(tmp_path: Path, period: float = 0.002, start: float = 0.0) -> None:
    frame = log_of(tmp_path / "log.csv")
    np.testing.assert_allclose(frame["time_s"], start + period * STEPS, rtol=1e-12, atol=1e-15)
    assert frame["position_m"].tolist() == (POSITION / 1000.0).tolist()
    assert frame["motor_force_n"].tolist() == FORCE.tolist()


@pytest.mark.parametrize("columns", ["No", "One", "Multi"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_lvm(tmp_path: Path, columns: str, decimal: str) -> None:
    text = lvm_head(columns, decimal) + lvm_segment(columns, lvm_rows(columns), decimal)
    read(tmp_path, text)
    expect(tmp_path)
    numbers = ("#2", "#4") if columns == "Multi" else ("#2", "#3")
    read(tmp_path, text, f"position_m={numbers[0]}:mm", f"motor_force_n={numbers[1]}")
    expect(tmp_path)
    if columns != "Multi":
        read(tmp_path, text, "time_s=X_Value", *MAPS)
        expect(tmp_path)


def test_lvm_without_the_sign_of_its_decimals(tmp_path: Path) -> None:
    """Writer_Version 0.92 does not state it."""
    text = lvm_head("No", ",").replace("Decimal_Separator\t,\n", "")
    read(tmp_path, text + lvm_segment("No", lvm_rows("No"), ","))
    expect(tmp_path)


def test_lvm_separated_by_commas(tmp_path: Path) -> None:
    head = lvm_head("One", sep=",")
    read(tmp_path, head + lvm_segment("One", lvm_rows("One"), sep=","))
    expect(tmp_path)


def test_lvm_with_comments_and_a_first_instant(tmp_path: Path) -> None:
    rows = lvm_rows("No")
    rows[7].append("valve clicked")
    text = lvm_head("No") + lvm_segment("No", rows, start="1.5000000000000000E+0")
    report = read(tmp_path, text)
    expect(tmp_path, start=1.5)
    assert "Comment" in report.unmapped


def test_lvm_whose_comment_is_a_number_and_one_that_is_cut_off(tmp_path: Path) -> None:
    rows = lvm_rows("No")
    rows[0].append("5")
    text = lvm_head("No") + lvm_segment("No", rows)
    read(tmp_path, text)
    expect(tmp_path)
    with pytest.raises(InputError, match="its last number is shorter"):
        read(tmp_path, text.rstrip("\n")[:-3])


def test_lvm_over_another_dimension_than_time(tmp_path: Path) -> None:
    text = lvm_head("One") + lvm_segment("One", lvm_rows("One"))
    with pytest.raises(InputError, match="X_Value is over Frequency, not over time"):
        read(tmp_path, text.replace("X_Dimension\tTime\tTime", "X_Dimension\tFrequency\tFrequency"))
    read(tmp_path, text.replace("X_Dimension\tTime\tTime", "X_Dimension\tZeit\tZeit"))
    expect(tmp_path)


def test_another_period_than_the_file_s_is_said(tmp_path: Path) -> None:
    path = tmp_path / "rec.lvm"
    path.write_text(lvm_head("No") + lvm_segment("No", lvm_rows("No")), encoding="utf-8")
    for period, is_said in ((0.001, True), (0.002, False)):
        report = convert(path, tmp_path / "log.csv", maps=MAPS, period_s=period)
        expect(tmp_path, period)
        said = f"0.002 s apart by the file; --period {period:g} is used"
        assert any(said in notice for notice in report.notices) is is_said


def test_lvm_segments_are_tests(tmp_path: Path) -> None:
    segment = lvm_segment("No", lvm_rows("No"))
    report = read(tmp_path, lvm_head("No", headings="Yes") + f"{segment}\t\n{segment}\n")
    assert report.tests == ("1", "2")
    frame = log_of(tmp_path / "log.csv")
    assert frame["time_s"].tolist() == [*(STEPS / 500.0), *(STEPS / 500.0)]
    assert frame["motor_force_n"].tolist() == [*FORCE, *FORCE]


def test_lvm_of_channels_at_two_rates(tmp_path: Path) -> None:
    rows = lvm_rows("Multi")
    for step, row in enumerate(rows):
        row[2:] = [f"{0.004 * step:.6f}", f"{FORCE[step]:.6f}"] if step < 20 else ["", ""]
    how = {"samples": (ROWS, 20), "period": ("0.002000", "0.004000")}
    text = lvm_head("Multi") + lvm_segment("Multi", rows, **how)  # type: ignore[arg-type]
    report = read(tmp_path, text)
    frame = log_of(tmp_path / "log.csv")
    assert frame["motor_force_n"].tolist() == np.repeat(FORCE[:20], 2).tolist()
    assert any("force held between its own samples (every 0.004 s)" in n for n in report.notices)
    # Some writers end the rows where the longer channel goes on.
    cut = [row if step < 20 else row[:2] for step, row in enumerate(rows)]
    read(tmp_path, lvm_head("Multi") + lvm_segment("Multi", cut, **how))  # type: ignore[arg-type]
    assert log_of(tmp_path / "log.csv").equals(frame)


@pytest.mark.parametrize(
    ("row", "cells", "what"),
    [
        (10, ["", "50.1"], "line 34: the row ends early: 2 of 3 fields"),
        (10, ["", "50.1", ""], "line 34: column force .* is empty"),
        (10, ["", "5x", "1"], "line 34: column pos .* holds '5x'"),
        (10, ["", "1", "2", "3", "4"], "line 34: 5 fields, but 3 are of channels"),
        (10, ["", "7", "50.1", "2.5"], "line 34: 4 fields, but 3 are of channels"),
        (39, ["", "50.1", ""], "line 63: column force .* is empty"),
        (39, ["", "50.1"], "line 63: the row ends early.*delete this last line"),
    ],
)
def test_lvm_damaged(tmp_path: Path, row: int, cells: list[str], what: str) -> None:
    rows = lvm_rows("No")
    rows[row] = cells
    with pytest.raises(InputError, match=what):
        read(tmp_path, lvm_head("No") + lvm_segment("No", rows))


def test_lvm_without_rows(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has a header but no rows"):
        read(tmp_path, lvm_head("No") + lvm_segment("No", []))
    with pytest.raises(InputError, match="has a header but no rows"):
        read(tmp_path, lvm_head("No"))
    with pytest.raises(InputError, match="names are missing below the header"):
        text = lvm_head("No") + lvm_segment("No", []).replace("X_Value\tpos\tforce\tComment\n", "")
        read(tmp_path, text)


# --- TwinCAT ---------------------------------------------------------------------------


def twincat(
    groups: Sequence[Sequence[tuple[str, np.ndarray, str]]],
    periods_ms: Sequence[float],
    sep: str = "\t",
    decimal: str = ".",
    blanks: bool = True,
    end: str = "EOF\n",
) -> str:
    """An export whose channels share a column of times in groups."""

    def line(key: str, cells: Sequence[Sequence[str]]) -> str:
        return sep.join(sep.join([key, *group]) for group in cells) + "\n"

    names = [[name for name, _, _ in group] for group in groups]
    head = [
        sep.join(["Name", "axis"]),
        sep.join(["File", r"C:\Scope\axis.csv"]),
        sep.join(
            ["Starttime of export", "132959733843760000", "Montag, 2. Mai 2022", "15:56:24.376"]
        ),
        sep.join(
            ["Endtime of export", "132959733853750000", "Montag, 2. Mai 2022", "15:56:25.375"]
        ),
        "",
        "",
    ]
    head = [text + "\n" for text in head]
    head += [
        line("Name", names),
        line("SymbolComment", [["" for _ in group] for group in groups]),
        line("Data-Type", [["REAL64" for _ in group] for group in groups]),
        line(
            "SampleTime[ms]",
            [
                [f"{period:g}".replace(".", decimal)] * len(group)
                for period, group in zip(periods_ms, groups, strict=True)
            ],
        ),
        line("SymbolName", [[f"MAIN.{name}" for name in group] for group in names]),
        line("Offset", [["0" for _ in group] for group in groups]),
        line("Unit", [[unit for _, _, unit in group] for group in groups]),
        "\n",
    ]
    rows = []
    for step in range(max(len(group[0][1]) for group in groups)):
        cells: list[str] = []
        for group, period in zip(groups, periods_ms, strict=True):
            if step < len(group[0][1]):
                cells += [
                    f"{round(step * period, 9):g}",
                    *(repr(float(v[step])) for _, v, _ in group),
                ]
            else:
                cells += [" "] * (1 + len(group))
        text = sep.join(cells).replace(".", decimal)
        rows.append((text if blanks else text.rstrip(sep + " ")) + "\n")
    return "".join(head) + "".join(rows) + end


AXIS = ("pos", POSITION, "mm (Length)")
DRIVE = ("force", FORCE[::4], "(None)")


@pytest.mark.parametrize(("sep", "decimal"), [("\t", "."), ("\t", ","), (";", ","), (",", ".")])
def test_twincat_of_one_rate(tmp_path: Path, sep: str, decimal: str) -> None:
    text = twincat([[AXIS, ("force", FORCE, "(None)")]], [2.0], sep, decimal)
    read(tmp_path, text, name="axis.csv")
    expect(tmp_path)


@pytest.mark.parametrize("blanks", [True, False])
@pytest.mark.parametrize("end", ["EOF\n", ""])
def test_twincat_with_a_time_for_each_channel(tmp_path: Path, blanks: bool, end: str) -> None:
    text = twincat([[AXIS], [DRIVE]], [0.5, 2.0], blanks=blanks, end=end)
    report = read(tmp_path, text, name="axis.csv")
    frame = log_of(tmp_path / "log.csv")
    assert frame["time_s"].tolist() == (STEPS / 2000.0).tolist()
    assert frame["position_m"].tolist() == (POSITION / 1000.0).tolist()
    assert frame["motor_force_n"].tolist() == np.repeat(FORCE[::4], 4).tolist()
    assert any("rows are the samples of pos: force held" in notice for notice in report.notices)
    numbers = ("position_m=#2:mm", "motor_force_n=#4")
    read(tmp_path, text, *numbers, name="axis.csv")
    assert log_of(tmp_path / "log.csv").equals(frame)


def test_twincat_channels_of_one_name(tmp_path: Path) -> None:
    text = twincat([[AXIS, ("pos", FORCE, "N")]], [2.0])
    text = text.replace("MAIN.pos\tMAIN.pos", "MAIN.x\tMAIN.f")
    read(tmp_path, text, "position_m=MAIN.x:mm", "motor_force_n=MAIN.f", name="axis.csv")
    expect(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("2\t{}\t", "\t{}\t", "line 19: the time of pos is missing"),
        ("2\t{}\t", "2\t\t", "line 19: column pos .* is empty"),
        ("2\t{}\t", "x\t{}\t", "line 19: the time of .*pos holds 'x', not a number"),
        ("2\t{}\t", "1\t{}\t", "line 19: the times of pos .* go from 0.0015 to 0.001 s"),
        ("2\t{}\t", "2\tx\t", "line 19: column pos .* holds 'x'"),
        ("2\t{}\t", "2\t1\t1\t1\t{}\t", "line 19: 7 fields under 4 names|line 19: 6 fields"),
    ],
)
def test_twincat_damaged(tmp_path: Path, old: str, new: str, what: str) -> None:
    value = repr(float(POSITION[4]))
    text = twincat([[AXIS], [("force", FORCE, "N")]], [0.5, 0.5])
    assert old.format(value) in text
    with pytest.raises(InputError, match=what):
        read(tmp_path, text.replace(old.format(value), new.format(value)), name="axis.csv")


def test_twincat_separated_by_blanks(tmp_path: Path) -> None:
    text = twincat([[AXIS]], [2.0]).replace("\t", " ")
    with pytest.raises(InputError, match=r"separates its columns, and words too; export it"):
        read(tmp_path, text, "position_m=pos:mm", name="axis.csv")
