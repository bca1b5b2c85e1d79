"""Spreadsheets by their languages, and programs that write for them."""

from __future__ import annotations

import datetime
from fractions import Fraction
from pathlib import Path

from benchmarks.exports.record import Channel, Record, Sheet, column, style, table


def _grouped(cell: str, sign: str, decimal: str) -> str:
    """A number's digits before the decimal sign by thousands."""
    whole, point, rest = cell.partition(decimal)
    minus, digits = ("-", whole[1:]) if whole.startswith("-") else ("", whole)
    groups = [digits[max(0, n - 3) : n] for n in range(len(digits), 0, -3)][::-1]
    return minus + sign.join(groups) + point + rest


def _columns(time: str, pressure: str, other: str, position: str) -> tuple[Channel, ...]:
    """Columns with numbers beyond a thousand; none has three decimals."""
    return (
        column("time_s", time, "ms", 1),
        column("pressure_a_pa", pressure, "Pa", 1),
        column("pressure_b_pa", other, "mbar", 2),
        column("position_m", position, "um", 2),
    )


def _localized(record: Record, separator: str, decimal: str, sign: str, encoding: str) -> Sheet:
    sheet = table(record, decimal=decimal, separator=separator, ending="\r\n", encoding=encoding)
    for row in sheet.body:
        row[:] = [_grouped(cell, sign, decimal) for cell in row]
        row[:] = [f'"{cell}"' if separator in cell else cell for cell in row]
    return sheet


@style(
    "Excel CSV, English",
    "book_en.csv",
    _columns("Time (ms)", "Pressure A (Pa)", "Pressure B (mbar)", "Position (um)"),
    "--thousands",
    ",",
)
def english(path: Path, record: Record) -> Sheet:
    """Commas within quoted numbers and between the cells."""
    return _localized(record, ",", ".", ",", "cp1252")


@style(
    "Excel CSV, German",
    "mappe_de.csv",
    _columns("Zeit [ms]", "Druck A [Pa]", "Druck B [mbar]", "Weg [µm]"),
    "--thousands",
    ".",
)
def german(path: Path, record: Record) -> Sheet:
    return _localized(record, ";", ",", ".", "cp1252")


@style(
    "Excel CSV, French",
    "classeur_fr.csv",
    _columns("Temps (ms)", "Pression A (Pa)", "Pression B (mbar)", "Course (µm)"),
    "--thousands",
    " ",
)
def french(path: Path, record: Record) -> Sheet:
    """A narrow no-break blank between groups of digits."""
    return _localized(record, ";", ",", "\u202f", "utf-8-sig")


@style(
    "Excel CSV, Swedish",
    "bok_sv.csv",
    _columns("Tid (ms)", "Tryck A (Pa)", "Tryck B (mbar)", "Läge (µm)"),
    "--thousands",
    " ",
)
def swedish(path: Path, record: Record) -> Sheet:
    """A no-break blank between groups of digits, and a true minus sign."""
    sheet = _localized(record, ";", ",", "\u00a0", "utf-8-sig")
    for row in sheet.body:
        row[:] = [cell.replace("-", "\u2212") for cell in row]
    return sheet


@style(
    "Excel CSV, Swiss",
    "mappe_ch.csv",
    _columns("Zeit [ms]", "Druck A [Pa]", "Druck B [mbar]", "Weg [um]"),
    "--thousands",
    "'",
)
def swiss(path: Path, record: Record) -> Sheet:
    """Decimal points between semicolons; typographic apostrophes."""
    return _localized(record, ";", ".", "\u2019", "utf-8-sig")


@style(
    "Excel workbook with titles and units",
    "protocol.xlsx",
    [
        column("time_s", "t", "ms", 1),
        column("pressure_a_pa", "p A", "bar(g)", 6),
        column("position_m", "y", "mm", 6),
    ],
    "--sheet",
    "Run 3",
)
def workbook(path: Path, record: Record) -> None:
    """A title, an empty row, names, units."""
    import openpyxl

    book = openpyxl.Workbook()
    book.active.title = "Notes"
    book.active.append(["cylinder, 14 May 2024"])
    sheet = book.create_sheet("Run 3")
    sheet.append(["Test protocol 14 May 2024"])
    sheet.append([])
    sheet.append(record.names())
    sheet.append(["ms", "bar", "mm"])
    columns = [record.doubles(c.target) for c in record.channels]
    for row in zip(*columns, strict=True):
        sheet.append([float(value) for value in row])
    book.save(path)


@style(
    "Excel workbook with dates",
    "dates.xlsx",
    [
        column("time_s", "Zeitstempel", "", 3, worth="s"),
        column("pressure_a_pa", "p A [kPa]", "kPa", 6),
        column("valve_a", "Ventil", "", 0),
    ],
)
def workbook_dates(path: Path, record: Record) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(record.names())
    start = datetime.datetime(2024, 5, 14, 13, 29, 30)
    for row in range(record.truth.rows):
        stamp = start + datetime.timedelta(milliseconds=row)
        pressure = float(record.readings("pressure_a_pa")[row])
        book.active.append([stamp, pressure, int(record.readings("valve_a")[row])])
    book.save(path)


@style(
    "LibreOffice CSV, UTF-16 and tabs",
    "table16.csv",
    [
        column("time_s", "Zeit", "s", 4),
        column("pressure_a_pa", "Druck A", "bar", 5),
        column("position_m", "Weg", "mm", 4),
    ],
)
def utf16(path: Path, record: Record) -> Sheet:
    return table(record, decimal=",", separator="\t", encoding="utf-16", ending="\r\n")


@style(
    "LibreOffice CSV, all cells quoted",
    "quoted.csv",
    [
        column("time_s", "Time, s", "s", 4),
        column("pressure_a_pa", "Pressure A, kPa", "kPa", 4),
        column("position_m", "Position", "mm", 4),
    ],
)
def quoted(path: Path, record: Record) -> Sheet:
    """Headings that hold the separator."""
    sheet = table(record)
    sheet.heads = [[f'"{name}"' for name in row] for row in sheet.heads]
    sheet.body = [[f'"{cell}"' for cell in row] for row in sheet.body]
    return sheet


@style(
    "CSV in Windows-1252",
    "winkel.csv",
    [
        column("time_s", "Zeit", "s", 3),
        column("theta_rad", "Winkel [°]", "deg", 4),
        column("motor_torque_nm", "Moment", "Nm", 4),
    ],
)
def windows(path: Path, record: Record) -> Sheet:
    return table(record, decimal=",", separator=";", encoding="cp1252", ending="\r\n")


@style(
    "German date and time of day",
    "datum.csv",
    [
        column("time_s", "Zeitpunkt", "", 3, worth="s"),
        column("pressure_a_pa", "Druck", "bar", 4),
        column("position_m", "Weg", "mm", 4),
    ],
)
def german_dates(path: Path, record: Record) -> Sheet:
    sheet = table(record, decimal=",", separator=";", ending="\r\n")
    for number, row in enumerate(sheet.body):
        row[0] = f"14.05.2024 13:29:30,{number:03d}"
    return sheet


# 14 May 2024, 13:29:30, in days since Excel's zero.
_SERIAL = 45426 + Fraction(13 * 3600 + 29 * 60 + 30, 86400)


@style(
    "Excel serial days",
    "serial.csv",
    [
        column("time_s", "Timestamp", "day", 10, zero=-_SERIAL * 86400),
        column("pressure_a_pa", "P", "kPa", 4),
        column("motor_force_n", "F", "N", 3),
    ],
)
def serial_days(path: Path, record: Record) -> Sheet:
    """Days with ten decimals: 8.6 microseconds."""
    return table(record)


@style(
    "ISO 8601 stamps with a zone",
    "iso.csv",
    [
        column("time_s", "timestamp", "", 6, worth="s"),
        column("pressure_a_pa", "p_a", "bar", 5),
        column("valve_a", "valve", "", 0),
    ],
)
def iso(path: Path, record: Record) -> Sheet:
    sheet = table(record)
    for number, row in enumerate(sheet.body):
        row[0] = f"2024-05-14T13:29:30.{1000 * number:06d}+02:00"
    return sheet


@style(
    "Grafana CSV, series as columns",
    "panel.csv",
    [
        column("time_s", "Time", "", 3, worth="s"),
        column("pressure_a_pa", 'pressure {chamber="a"}', "bar", 5),
        column("position_m", "position", "mm", 4),
    ],
)
def grafana(path: Path, record: Record) -> Sheet:
    """Date and time with milliseconds; names with labels in quotes."""
    sheet = table(record)
    sheet.heads = [['"' + n.replace('"', '""') + '"' for n in sheet.heads[0]]]
    for number, row in enumerate(sheet.body):
        row[0] = f"2024-05-14 13:29:30.{number:03d}"
    return sheet


@style(
    "InfluxDB annotated CSV, pivoted",
    "influx.csv",
    [
        column("time_s", "_time", "", 3, worth="s"),
        column("pressure_a_pa", "pressure_a", "bar", 5),
        column("position_m", "position", "mm", 4),
    ],
)
def influx(path: Path, record: Record) -> Sheet:
    """Three annotation rows, an empty first column, stamps of RFC 3339."""
    above = [
        "#group,false,false,false,false,false",
        "#datatype,string,long,dateTime:RFC3339,double,double",
        "#default,_result,,,,",
    ]
    sheet = table(record, above=above, ending="\r\n")
    sheet.heads = [["", "result", "table", *sheet.heads[0]]]
    body = []
    for number, (_, *cells) in enumerate(sheet.body):
        body.append(["", "", "0", f"2024-05-14T13:29:30.{number:03d}Z", *cells])
    sheet.body = body
    sheet.places = record.places(3)
    return sheet


@style(
    "signals in rows",
    "transposed.csv",
    [
        column("time_s", "t", "s", 3),
        column("pressure_a_pa", "p_a", "kPa", 4),
        column("position_m", "y", "mm", 4),
    ],
    "--transpose",
)
def transposed(path: Path, record: Record) -> Sheet:
    columns = [[c.name, *record.cells(c.target)] for c in record.channels]
    return Sheet([], columns, names_row=None)


@style(
    "table with bars, as in Markdown",
    "table.md",
    [
        column("time_s", "t", "s", 3),
        column("pressure_a_pa", "p_a", "bar", 4),
        column("position_m", "y", "mm", 3),
    ],
)
def markdown(path: Path, record: Record) -> Sheet:
    sheet = table(record, separator=" | ")
    sheet.heads.append(["---:"] * 3)
    sheet.heads = [["| " + row[0], *row[1:-1], row[-1] + " |"] for row in sheet.heads]
    sheet.body = [["| " + row[0], *row[1:-1], row[-1] + " |"] for row in sheet.body]
    return sheet


@style(
    "columns of fixed width",
    "fixed.dat",
    [
        column("time_s", "t", "s", 4),
        column("pressure_a_pa", "pA", "Pa", 1),
        column("position_m", "y", "m", 7),
    ],
)
def fixed_width(path: Path, record: Record) -> Sheet:
    sheet = table(record, separator=" ")
    sheet.heads = [[name.rjust(14) for name in row] for row in sheet.heads]
    sheet.body = [[cell.rjust(14) for cell in row] for row in sheet.body]
    return sheet
