"""Readers of foreign files: what each format gives, and files that are damaged."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pandas as pd
import pyarrow.parquet as parquet
import pytest
from foreign_files import (
    ANGLE_DEG,
    ATMOSPHERE,
    PRESSURE_KPA,
    SAMPLES,
    TIME,
    expect_samples,
    log_of,
    maps,
    refused,
    text_of,
    write_mat73,
    write_tdms,
)
from scipy.io import savemat

from sysid.errors import InputError
from sysid.io.conversion import convert
from sysid.io.foreign import names_in
from sysid.io.listing import channels_of

# --- MATLAB ---------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["4", "5"])
@pytest.mark.parametrize("compressed", [False, True])
def test_mat_of_versions_4_to_7(tmp_path: Path, version: str, compressed: bool) -> None:
    foreign, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    content = {"t": TIME[:, None], "P": np.column_stack([ANGLE_DEG, PRESSURE_KPA]), "gain": 3.0}
    savemat(foreign, content, format=version, do_compression=compressed and version == "5")
    report = convert(foreign, out, maps=maps("t", "P#2", "P#1"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    assert report.unmapped == ("gain",)
    assert report.rows == SAMPLES


def test_mat_with_structs_cells_and_rows_of_signals(tmp_path: Path) -> None:
    foreign, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    cell = np.empty(2, dtype=object)
    cell[:] = ["label", TIME]
    element = np.zeros((1, 2), dtype=[("Name", object), ("Data", object)])
    element[0, 0]["Name"], element[0, 0]["Data"] = "angle", ANGLE_DEG
    element[0, 1]["Name"], element[0, 1]["Data"] = "other", ANGLE_DEG * 2
    signals = np.vstack([TIME, PRESSURE_KPA])  # Simulink's To File: a signal a row
    savemat(foreign, {"rec": {"X": cell, "Y": element, "deep": {"P": signals}}})
    convert(
        foreign,
        out,
        maps=maps("rec.X{2}", "rec.deep.P#2", "rec.Y(1).Data"),
        atmosphere_pa=ATMOSPHERE,
    )
    expect_samples(out)


def test_mat_of_version_73(tmp_path: Path) -> None:
    foreign, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    write_mat73(foreign)
    report = convert(
        foreign, out, maps=maps("rec.cells{2}", "rec.P#2", "Y(1).Data"), atmosphere_pa=ATMOSPHERE
    )
    expect_samples(out)
    assert report.sources[0].format == "MATLAB 7.3"
    assert {"name", "void"} <= set(report.unmapped)


def struct_array(path: Path, empty: int | None) -> None:
    """Version 5: `rec(k).t = ...`, a struct for each sample, and a cell for each."""
    rec = np.zeros((1, SAMPLES), dtype=[("t", object), ("s", object)])
    cell = np.empty((SAMPLES, 1), dtype=object)
    for row in range(SAMPLES):
        pressure = np.zeros((0, 0)) if row == empty else PRESSURE_KPA[row]
        rec[0, row]["t"], rec[0, row]["s"] = TIME[row], {"P": pressure}
        cell[row, 0] = ANGLE_DEG[row]
    savemat(path, {"rec": rec, "phi": cell})


def struct_array_73(path: Path, empty: int | None) -> None:
    """The same of version 7.3, where each element is a data set of its own."""
    with h5py.File(path, "w", userblock_size=512) as file:
        rec, kept = file.create_group("rec"), file.create_group("#refs#")
        rec.attrs["MATLAB_class"] = np.bytes_("struct")
        columns = {"t": TIME, "s": PRESSURE_KPA, "phi": ANGLE_DEG}
        for name, values in columns.items():
            references = np.zeros((1, SAMPLES), dtype=h5py.ref_dtype)
            for row in range(SAMPLES):
                place = kept.create_group(f"{name}{row}") if name == "s" else kept
                called = "P" if name == "s" else f"{name}{row}"
                if name == "s" and row == empty:
                    data = place.create_dataset(called, data=np.zeros(2, dtype=np.uint64))
                    data.attrs["MATLAB_empty"] = np.uint8(1)
                else:
                    place.create_dataset(called, data=[[values[row]]])
                references[0, row] = (place if name == "s" else place[called]).ref
            where = file if name == "phi" else rec
            data = where.create_dataset(name, data=references)
            if name == "phi":
                data.attrs["MATLAB_class"] = np.bytes_("cell")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(508) + b"\x00\x02IM")


@pytest.mark.parametrize("write", [struct_array, struct_array_73])
def test_mat_with_a_struct_or_a_cell_for_each_sample(
    write: Callable[[Path, int | None], None], tmp_path: Path
) -> None:
    foreign, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    write(foreign, None)
    report = convert(foreign, out, maps=maps("rec.t", "rec.s.P", "phi"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    assert not report.unmapped
    write(foreign, 3)
    with pytest.raises(InputError, match=r"row 4: column rec.s.P .* is empty"):
        convert(foreign, out, maps=maps("rec.t", "rec.s.P", "phi"), atmosphere_pa=ATMOSPHERE)


def test_mat_with_complex_numbers(tmp_path: Path) -> None:
    foreign, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    savemat(foreign, {"t": TIME, "P": PRESSURE_KPA + 1j, "phi": ANGLE_DEG})
    convert(foreign, out, maps=maps("t", "P.real", "phi"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    with pytest.raises(InputError, match=r"P .* not a column: complex: its parts are P.real and"):
        convert(foreign, out, maps=maps("t", "P", "phi"), atmosphere_pa=ATMOSPHERE)


def test_matrix_named_whole_says_which_signals_it_holds(tmp_path: Path) -> None:
    foreign = tmp_path / "rec.mat"
    savemat(foreign, {"P": np.column_stack([TIME, PRESSURE_KPA]), "note": "text"})
    with pytest.raises(InputError, match=r"P \(mapped to time_s\) holds several.*P#1, P#2"):
        convert(foreign, tmp_path / "log.csv", maps=["time_s=P"])
    with pytest.raises(InputError, match=r"note .* is not a column: text"):
        convert(foreign, tmp_path / "log.csv", maps=["time_s=note"])


# --- text -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("delimiter", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), ("   ", ",")],
)
@pytest.mark.parametrize("header", [None, "Zeit Druck Winkel"])
def test_text_by_its_look(tmp_path: Path, delimiter: str, decimal: str, header: str | None) -> None:
    foreign, out = tmp_path / "rec.txt", tmp_path / "log.csv"
    head = None if header is None else delimiter.join(header.split())
    foreign.write_text(text_of(delimiter, decimal, head), encoding="utf-8", newline="")
    entries = maps("#1:ms", "#2", "#3") if header is None else maps("Zeit:ms", "Druck", "Winkel")
    convert(foreign, out, maps=entries, atmosphere_pa=ATMOSPHERE)
    expect_samples(out)


def test_text_of_a_german_windows_machine(tmp_path: Path) -> None:
    """Windows-1252, CRLF, a comment line, a row of units, a delimiter at each line's end."""
    foreign, out = tmp_path / "rec.csv", tmp_path / "log.csv"
    body = text_of(";", ",", None, ";\r\n")
    head = "# Prüfstand 3\r\nZeit;Druck;Öffnung;\r\nms;kPa;°;\r\n"
    foreign.write_bytes((head + body).encode("cp1252"))
    report = convert(
        foreign, out, maps=maps("Zeit:ms", "Druck", "Öffnung"), atmosphere_pa=ATMOSPHERE
    )
    expect_samples(out)
    assert any("Windows-1252" in notice for notice in report.notices)
    assert any("skipped (ms; kPa; °)" in notice for notice in report.notices)


def test_text_in_utf_16_with_a_preamble(tmp_path: Path) -> None:
    foreign, out = tmp_path / "rec.txt", tmp_path / "log.csv"
    preamble = "Recorder v2\nOperator: A\n"
    foreign.write_text(preamble + text_of("\t", ".", "t\tp\tq"), encoding="utf-16")
    entries = maps("t:ms", "p", "q")
    report = convert(foreign, out, maps=entries, atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    assert any("begins in line 3;" in notice for notice in report.notices)
    convert(foreign, out, maps=entries, skip_rows=2, atmosphere_pa=ATMOSPHERE)
    expect_samples(out)


def test_look_overruled(tmp_path: Path) -> None:
    foreign, out = tmp_path / "rec.txt", tmp_path / "log.csv"
    foreign.write_text("1,5 2,5\n2,5 3,5\n")
    convert(foreign, out, maps=["time_s=#1", "theta_rad=#2"], delimiter="blank", decimal=",")
    assert log_of(out)["theta_rad"].tolist() == [2.5, 3.5]
    convert(foreign, out, maps=["time_s=#1", "theta_rad=#3"], delimiter=",", no_header=True)
    assert log_of(out)["theta_rad"].tolist() == [5.0, 5.0]
    for delimiter, decimal, what in (
        ("ab", None, "cannot separate"),
        (None, ":", "not a decimal sign"),
    ):
        with pytest.raises(InputError, match=what):
            convert(foreign, out, maps=["time_s=#1"], delimiter=delimiter, decimal=decimal)


@pytest.mark.parametrize(
    ("text", "thousands", "decimal"),
    [
        ("900.000;1\n1.003.000;1.003\n1.100.500;-2\n", ".", None),
        ("900,000;1\n1.003,000;1,003\n1.100,500;-2\n", ".", ","),
        ("900.000;1\n1,003.000;1.003\n1,100.500;-2\n", ",", "."),
    ],
)
def test_digits_grouped_by_thousands(
    tmp_path: Path, text: str, thousands: str, decimal: str | None
) -> None:
    foreign, out = tmp_path / "rec.csv", tmp_path / "log.csv"
    foreign.write_text(text)
    entries = ["time_s=#1:ms", "theta_rad=#2"]
    with pytest.raises(InputError, match=r"line 2: column #1.*1.003.*--thousands"):
        convert(foreign, out, maps=entries, delimiter=";", decimal=decimal)
    convert(foreign, out, maps=entries, thousands=thousands, decimal=decimal)
    frame = log_of(out)
    assert frame["time_s"].tolist() == [0.9, 1.003, 1.1005]
    assert frame["theta_rad"].tolist() == [1.0, 1.003, -2.0]


def test_every_digit_survives(tmp_path: Path) -> None:
    rng = np.random.default_rng(20240607)
    values = rng.standard_normal(500) * 10.0 ** rng.integers(-300, 300, 500)
    foreign, again = tmp_path / "log.csv", tmp_path / "again.csv"
    pd.DataFrame({"time_s": np.arange(500.0), "theta_rad": values}).to_csv(foreign, index=False)
    convert(foreign, again)
    lines = again.read_bytes().decode().split("\r\n")[:-1]
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    assert rows[0] == ["time_s", "theta_rad"]
    assert [float(row[1]) for row in rows[1:]] == values.tolist()


# --- Excel, TDMS, Parquet -------------------------------------------------------------


def test_excel_with_a_chosen_sheet(tmp_path: Path) -> None:
    foreign, out = tmp_path / "rec.xlsx", tmp_path / "log.csv"
    book = openpyxl.Workbook()
    book.active.title = "Notes"
    book.active.append(["recorded on a Monday"])
    sheet = book.create_sheet("Run 3")
    sheet.append([])
    sheet.append(["t", "Druck links", "q"])
    sheet.append(["s", "kPa", "deg"])
    for row in zip(TIME, PRESSURE_KPA, ANGLE_DEG, strict=True):
        sheet.append([float(v) for v in row])
    book.save(foreign)
    entries = maps("t", "Druck links", "q")
    convert(foreign, out, maps=entries, sheet="Run 3", atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    with pytest.raises(InputError, match="has no sheet 'Run 4'; its sheets are 'Notes', 'Run 3'"):
        convert(foreign, out, maps=entries, sheet="Run 4")


@pytest.mark.parametrize("top", [["100 g", None, "200 g"], ["Run of a Monday"]])
def test_excel_names_are_below_a_title_or_one_of_several_columns(
    tmp_path: Path, top: list[str | None]
) -> None:
    """Also where the maps give numbers: the units are those that the names state."""
    foreign, out = tmp_path / "rec.xlsx", tmp_path / "log.csv"
    book = openpyxl.Workbook()
    book.active.append(top)
    book.active.append(["Time (ms)", "P (kPa)", "Angle (deg)"])
    for i in range(30):
        book.active.append([10.0 * i, 200.0 + i, 90.0])
    book.save(foreign)
    report = convert(foreign, out, maps=["time_s=#1", "pressure_a_pa=#2", "theta_rad=#3"])
    log = log_of(out)
    assert log["time_s"].tolist() == pytest.approx(np.arange(30) / 100.0)
    assert log["pressure_a_pa"].tolist() == pytest.approx(1e3 * (200.0 + np.arange(30)))
    assert log["theta_rad"].tolist() == pytest.approx([np.pi / 2.0] * 30)
    assert any("above the names passed over" in line for line in report.notices)


def test_excel_cell_without_a_number_is_named(tmp_path: Path) -> None:
    foreign = tmp_path / "rec.xlsx"
    book = openpyxl.Workbook()
    for row in (["t", "q"], [0.0, 1.0], [0.1, "n.a. here"], [0.2, None]):
        book.active.append(row)
    book.save(foreign)
    with pytest.raises(InputError, match=r"'Sheet', row 3: column q .* holds 'n.a. here'"):
        convert(foreign, tmp_path / "log.csv", maps=["time_s=t", "theta_rad=q"])


@pytest.mark.parametrize("name", ["rec.tdms", "rec.parquet"])
@pytest.mark.parametrize("with_time", [False, True])
def test_tdms(tmp_path: Path, with_time: bool, name: str) -> None:
    """Whatever the file is called: its signature says what it is."""
    foreign, out = tmp_path / name, tmp_path / "log.csv"
    write_tdms(foreign, (0.0, 0.0) if with_time else (0.001, 0.001), with_time)
    entries = maps("run/t", "run/P", "run/angle")
    convert(foreign, out, maps=entries[not with_time :], atmosphere_pa=ATMOSPHERE)
    expect_samples(out)


def test_tdms_channels_of_two_time_bases_are_refused(tmp_path: Path) -> None:
    foreign = tmp_path / "rec.tdms"
    write_tdms(foreign, (0.001, 0.002))
    with pytest.raises(InputError, match="have different time bases"):
        convert(
            foreign,
            tmp_path / "log.csv",
            maps=maps("x", "run/P", "run/angle")[1:],
            atmosphere_pa=ATMOSPHERE,
        )


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_parquet_in_and_out(tmp_path: Path, suffix: str) -> None:
    foreign, out = tmp_path / "rec.parquet", tmp_path / f"log{suffix}"
    frame = pd.DataFrame({"t": TIME, "P": PRESSURE_KPA, "q": ANGLE_DEG})
    frame.to_parquet(foreign)
    convert(foreign, out, maps=maps("t", "P", "q"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    if suffix == ".parquet":
        note = json.loads(parquet.read_schema(out).metadata[b"sysid.comments"])
        assert hashlib.sha256(foreign.read_bytes()).hexdigest() in note[0]


def test_time_stamps_become_seconds_from_the_first(tmp_path: Path) -> None:
    stamps = pd.Timestamp("2024-03-01T12:00:00") + pd.to_timedelta(TIME, unit="s")
    frame = pd.DataFrame({"when": stamps, "theta_rad": ANGLE_DEG})
    frame.to_parquet(tmp_path / "rec.parquet")
    frame.to_csv(tmp_path / "rec.csv", index=False)
    frame.to_excel(tmp_path / "rec.xlsx", index=False)
    frame.assign(when=stamps.tz_localize("Europe/Berlin")).to_parquet(tmp_path / "zone.parquet")
    frame.assign(when=stamps - stamps[0]).to_parquet(tmp_path / "since.parquet")
    for name in ("rec.parquet", "rec.csv", "rec.xlsx", "zone.parquet", "since.parquet"):
        convert(tmp_path / name, tmp_path / "log.csv", maps=["time_s=when"])
        np.testing.assert_allclose(log_of(tmp_path / "log.csv")["time_s"], TIME, atol=1e-9)
    with pytest.raises(InputError, match="holds time stamps, which need no unit"):
        convert(tmp_path / "rec.parquet", tmp_path / "x.csv", maps=["time_s=when:ms"])
    with pytest.raises(InputError, match="holds time stamps, not pressure_a_pa"):
        convert(tmp_path / "rec.parquet", tmp_path / "x.csv", maps=["pressure_a_pa=when:kPa"])


# --- damage ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda s: s[: s.rindex(",")], "line 51: the row ends early: 2 of 3 fields.*cut off"),
        (lambda s: s[:-5], "line 51: the last line has no line end.*looks cut off"),
        (lambda s: s.replace("\n", "\n1,2,3,4\n", 3), "4 fields where the other lines have 3"),
        (lambda s: s.replace("Q", "Q,R"), "line 1: 4 column names over 3 fields"),
        (lambda s: s.splitlines()[0] + "\n", "has a header but no rows"),
        (
            lambda s: "t,P,Q,Q\n" + s.partition("\n")[2].replace("\n", ",1\n"),
            r"Q .* is not a column: it names #3 and #4; map another",
        ),
    ],
)
def test_text_that_is_damaged(tmp_path: Path, change: Callable[[str], str], what: str) -> None:
    foreign = tmp_path / "rec.csv"
    numbers = np.column_stack([TIME, PRESSURE_KPA, ANGLE_DEG])
    rows = "".join(",".join(f"{v:.8f}" for v in row) + "\n" for row in numbers)
    foreign.write_text(change("t,P,Q\n" + rows))
    refused(foreign, tmp_path / "log.csv", what, maps=["time_s=t", "theta_rad=Q:deg"])


def damaged_files(folder: Path) -> dict[str, tuple[bytes, str]]:
    """File name -> (content, what the error says), for each format."""
    savemat(folder / "good.mat", {"t": TIME, "q": ANGLE_DEG}, do_compression=True)
    mat = (folder / "good.mat").read_bytes()
    write_mat73(folder / "good73.mat")
    mat73 = (folder / "good73.mat").read_bytes()
    write_tdms(folder / "good.tdms", (0.001, 0.001))
    tdms = (folder / "good.tdms").read_bytes()
    pd.DataFrame({"t": TIME}).to_parquet(folder / "good.parquet")
    table = (folder / "good.parquet").read_bytes()
    book = openpyxl.Workbook()
    book.active.append(["t", "q"])
    book.save(folder / "good.xlsx")
    excel = (folder / "good.xlsx").read_bytes()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("rec.csv", "t,q\n")
    ole = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)
    return {
        "cut.mat": (mat[: len(mat) // 2], "cut.mat: is damaged or not a MATLAB file"),
        "noise.mat": (bytes(range(256)) * 8, "is damaged or not a MATLAB file"),
        "cut73.mat": (mat73[: len(mat73) // 2], r"is damaged or not an HDF5 \(MATLAB 7.3\) file"),
        "cut.tdms": (tdms[: len(tdms) - 100], "ends in the middle|is damaged or not a TDMS file"),
        "length.tdms": (
            tdms[:12] + bytes([tdms[12] ^ 8]) + tdms[13:],
            "not a TDMS file .no segment begins at byte|ends in the middle",
        ),
        "head.tdms": (tdms[:20], "ends in the middle|is damaged or not a TDMS|holds no columns"),
        "text.tdms": (b"t,q\n1,2\n", "is damaged or not a TDMS file"),
        "cut.parquet": (table[: len(table) // 2], "is damaged or not Parquet"),
        "text.parquet": (b"t,q\n1,2\n", "is damaged or not Parquet"),
        "cut.xlsx": (excel[: len(excel) // 2], "is damaged or not an Excel workbook"),
        "empty.xlsx": (excel, "sheet 'Sheet' has a header but no rows"),
        "old.xls": (ole, "is an old Excel workbook.*save it from Excel as .xlsx"),
        "locked.xlsx": (ole + "EncryptedPackage".encode("utf-16-le"), "protected by a password"),
        "rec.zip": (buffer.getvalue(), "is an archive .zip.; unpack it"),
        "rec.csv.gz": (b"\x1f\x8b" + bytes(20), "is a compressed file .gzip.; unpack it"),
        "binary.dat": (bytes(range(256)), "is a binary file of an unknown format"),
        "empty.csv": (b"", "the file is empty"),
        "comments.csv": (b"# nothing\n# else\n", "holds no rows"),
    }


def test_files_that_are_damaged(tmp_path: Path) -> None:
    cases = damaged_files(tmp_path)
    for name, (content, what) in cases.items():
        (tmp_path / name).write_bytes(content)
        refused(tmp_path / name, tmp_path / "log.csv", what)


def test_names_are_read_without_the_rows(tmp_path: Path) -> None:
    rows = "\n".join(f"{i * 1e-3:.3f};{i % 7}.5;{i % 3}" for i in range(20_000))
    text, table = tmp_path / "long.csv", tmp_path / "long.parquet"
    text.write_text(f"logger 7\nclock;angle;drive\n{rows}\n1;2;3;4;5;6;7\n", "utf-8")
    with pytest.raises(InputError):  # the whole of it: its last row is damaged
        channels_of([text])
    assert names_in(text, "a log") == ("clock", "angle", "drive")
    short = tmp_path / "short.csv"
    short.write_text(f"clock;angle;drive\n{rows[:600]}\n", "utf-8")
    assert names_in(short, "a log") == ("clock", "angle", "drive")
    pd.DataFrame({"a": [1.0], "b": ["x"], "c": [[1.0, 2.0]]}).to_parquet(table)
    assert names_in(table, "a log") == tuple(c.name for c in channels_of([table])[0].channels)
