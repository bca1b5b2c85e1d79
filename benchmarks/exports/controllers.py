"""Traces of controllers and drives."""

from __future__ import annotations

from pathlib import Path

from benchmarks.exports.record import Record, Sheet, column, style, table


@style(
    "Siemens S7 trace",
    "MyTrace.csv",
    [
        column("time_s", "Time", "ms", 0),
        column("position_m", "Achse_1.ActualPosition", "mm", 4),
        column("pressure_a_pa", "DB_Druck.p_A", "bar(g)", 5),
        column("motor_force_n", "Achse_1.Force", "N", 3),
    ],
)
def siemens(path: Path, record: Record) -> Sheet:
    """Quoted titles, an empty line, names and units, decimal commas."""
    above = ['"Trace";"MyTrace"', '"Date";"06.05.2024 14:22:10"', ""]
    sheet = table(record, decimal=",", separator=";", above=above, ending="\r\n", units_row=1)
    sheet.heads.append(["ms", "mm", "bar", "N"])
    sheet.heads = [[f'"{name}"' for name in row] for row in sheet.heads]
    return sheet


def _scope_head(names: list[str], periods: list[int]) -> list[list[str]]:
    """TwinCAT Scope's rows of `key, value` for each channel."""
    keys = {
        "Name": names,
        "SymbolComment": [""] * len(names),
        "Data-Type": ["REAL64"] * len(names),
        "SampleTime[ms]": [str(period) for period in periods],
        "VariableSize": ["8"] * len(names),
        "SymbolBased": ["TRUE"] * len(names),
        "IndexGroup": ["16448"] * len(names),
        "IndexOffset": [str(608 + 8 * n) for n in range(len(names))],
        "SymbolName": [f"MAIN.{name}" for name in names],
        "NetID": ["172.16.8.205.1.1"] * len(names),
        "Port": ["851"] * len(names),
        "Offset": ["0"] * len(names),
        "ScaleFactor": ["1"] * len(names),
        "BitMask": ["0xFFFFFFFFFFFFFFFF"] * len(names),
    }
    return [[cell for value in values for cell in (key, value)] for key, values in keys.items()]


def _scope_rows(record: Record, decimal: str = ".") -> list[list[str]]:
    """A time and a value for each channel; a slower channel's cells end before the others'."""
    rows: list[list[str]] = [[] for _ in range(record.truth.rows)]
    for channel in record.channels:
        cells = record.cells(channel.target, decimal=decimal)
        for row, line in enumerate(rows):
            line += [str(row * channel.every), cells[row]] if row < len(cells) else ["", ""]
    return rows


def _scope_above(separator: str) -> list[str]:
    return [
        separator.join(("Name", "YT Scope Project")),
        separator.join(("File", "C:\\Data\\cylinder.svdx")),
        separator.join(("Starttime of export", "133591225301234567")),
        separator.join(("Endtime of export", "133591225303644567")),
        "",
    ]


@style(
    "TwinCAT Scope",
    "scope.csv",
    [
        column("pressure_a_pa", "fPressureA", "mbar", 4),
        column("position_m", "fPosition", "mm", 5),
        column("motor_force_n", "fForce", "N", 4),
    ],
    timed=False,
)
def twincat(path: Path, record: Record) -> Sheet:
    """Fourteen rows of channel headers, a column of milliseconds before each value, `EOF`."""
    names = record.names()
    sheet = Sheet(
        _scope_head(names, [1] * len(names)),
        _scope_rows(record),
        "\t",
        _scope_above("\t"),
        ["EOF"],
        "\r\n",
        gap_after_heads=[""],
    )
    sheet.places = {c.target: 2 * n + 1 for n, c in enumerate(record.channels)}
    return sheet


@style(
    "TwinCAT Scope, semicolons, two rates",
    "scope_de.csv",
    [
        column("pressure_a_pa", "fDruckA", "mbar", 4),
        column("position_m", "fPosition", "mm", 5),
        column("duty_a", "fTastgrad", "percent", 5, every=5),
    ],
    timed=False,
)
def twincat_german(path: Path, record: Record) -> Sheet:
    """Decimal commas; the command's channel has a fifth of the rows, its cells are padded."""
    sheet = twincat(path, record)
    assert sheet is not None
    sheet.separator = ";"
    sheet.above = _scope_above(";")
    sheet.heads = _scope_head(record.names(), [c.every for c in record.channels])
    sheet.body = _scope_rows(record, ",")
    return sheet


@style(
    "CODESYS trace as ASCII",
    "trace.txt",
    [
        column("time_s", "Cycle", "ms", 0),
        column("pressure_a_pa", "PLC_PRG.PA", "Pa", 0),
        column("pressure_b_pa", "PLC_PRG.PB", "Pa", 0),
        column("valve_a", "PLC_PRG.VALVE", "", 0),
    ],
)
def codesys(path: Path, record: Record) -> Sheet:
    """A title, the project's path, names and values separated by blanks."""
    above = ["CoDeSys Trace", "D:\\CODESYS\\PROJECTS\\CYLINDER.PRO"]
    return table(record, separator=" ", above=above, ending="\r\n")


@style(
    "ibaAnalyzer text",
    "iba.txt",
    [
        column("time_s", "time", "s", 3),
        column("pressure_a_pa", "Druck A", "kPa(g)", 4),
        column("pressure_b_pa", "Druck B", "kPa(g)", 4),
        column("position_m", "Kolbenweg", "mm", 5),
    ],
)
def iba(path: Path, record: Record) -> Sheet:
    """Signal numbers in the first row, names in the second, units in the third; tabs."""
    sheet = table(record, separator="\t", ending="\r\n", names_row=1, units_row=2)
    sheet.heads = [
        ["time", "[0:0]", "[0:1]", "[1:0]"],
        sheet.heads[0],
        ["s", "kPa", "kPa", "mm"],
    ]
    return sheet


@style(
    "Panasonic KW Watcher",
    "file1(240514_132930_TRG).csv",
    [
        column("time_s", "Time", "", 3, zero=-(13 * 3600 + 29 * 60 + 30), worth="s"),
        column("pressure_a_pa", "datapoint1", "100 Pa", 0),
        column("position_m", "datapoint2", "10 um", 0),
    ],
)
def kw_watcher(path: Path, record: Record) -> Sheet:
    """Date and time of day in two columns; ports, registers and types under the names."""
    heads = [
        ["Date", "Time", "1", "2"],
        ["", "", "datapoint1", "datapoint2"],
        ["", "", "COM1", "COM1"],
        ["", "", "DT100", "DT102"],
        ["", "", "INT", "DINT"],
        ["", "", "S16", "S32"],
        ["", "", "", ""],
    ]
    body = []
    for time, first, second in record.rows():
        seconds = float(time) - 13 * 3600 - 29 * 60
        body.append(["2024/05/14", f"13:29:{seconds:06.3f}", first, second])
    return Sheet(
        heads, body, places={"time_s": 1, "pressure_a_pa": 2, "position_m": 3}, names_row=1
    )


@style(
    "dydaq measurement",
    "meas_0001.csv",
    [
        column("time_s", "Time Code", "ms", 0, zero=-1715693370),
        column("pressure_a_pa", "AI01", "bar", 5),
        column("motor_force_n", "AI02", "N", 3),
    ],
)
def dydaq(path: Path, record: Record) -> Sheet:
    """Names, descriptions and units in three rows; milliseconds since 1970, and local time."""
    heads = [
        [
            *("Sequence number", "Time Code", "Local Date", "Local Time", "Milliseconds"),
            *("Data quality", "AI01", "AI02"),
        ],
        ["block", "UTC", "date", "time", "of local time", "unused", "Druck A", "Kraft"],
        ["-", "ms", "-", "-", "ms", "-", "bar", "N"],
    ]
    body = []
    for number, (time, pressure, force) in enumerate(record.rows()):
        milliseconds = int(time) % 1000
        clock = ["2024-05-14", "15:29:30", str(milliseconds), "0"]
        body.append([str(number), time, *clock, pressure, force])
    places = {"time_s": 1, "pressure_a_pa": 6, "motor_force_n": 7}
    return Sheet(heads, body, ";", places=places, units_row=2)
