"""Oscilloscopes: two transducers of 0.5 to 4.5 V (an LVDT of -10 to 10 V) on their channels."""

from __future__ import annotations

from pathlib import Path

from benchmarks.exports.record import (
    SECOND_START,
    Channel,
    Record,
    Sheet,
    column,
    sensor,
    style,
    table,
)

_RANGE = ("0.5", "4.5"), ("0", "10"), "bar(g)"


def _pressures(a: str, b: str, decimals: int = 5) -> tuple[Channel, Channel]:
    return (
        sensor("pressure_a_pa", a, *_RANGE, decimals=decimals),
        sensor("pressure_b_pa", b, *_RANGE, decimals=decimals),
    )


def _lvdt(name: str, decimals: int) -> Channel:
    return sensor("position_m", name, ("-10", "10"), ("-100", "100"), "mm", decimals)


@style(
    "Tektronix MSO/MDO",
    "tek0001ALL.csv",
    [column("time_s", "TIME", "s", 9, zero="-0.05"), *_pressures("CH1", "CH2")],
)
def tektronix_new(path: Path, record: Record) -> Sheet:
    """A preamble with the table's separator, a row `Label,,`, then the headings."""
    rows = record.truth.rows
    above = f"""Model,MSO24
Firmware Version,2.0.3

Waveform Type,ANALOG
Point Format,Y
Horizontal Units,s
Horizontal Scale,0.04
Horizontal Delay,0
Sample Interval,0.001
Record Length,{rows}
Gating,0.0% to 100.0%
Probe Attenuation,1,1
Vertical Units,V,V
Vertical Offset,0,0
Vertical Scale,1,1
Vertical Position,0,0
,,
Label,,"""
    return table(record, ".9e", above=above.splitlines(), ending="\r\n")


@style(
    "Tektronix TDS",
    "F0000CH1.CSV",
    [column("time_s", "#4", "s", 12, zero="-0.05"), _lvdt("#5", 5)],
    "--no-header",
)
def tektronix_old(path: Path, record: Record) -> Sheet:
    """The settings stand in the first columns beside the data, without headings."""
    settings = [
        ("Record Length", f"{record.truth.rows:.6e}"),
        ("Sample Interval", "1.000000e-03"),
        ("Trigger Point", "5.000000000000e+01"),
        ("", ""),
        ("", ""),
        ("", ""),
        ("Source", "CH1"),
        ("Vertical Units", "V"),
        ("Vertical Scale", "5.000000e+00"),
        ("Vertical Offset", "0.000000e+00"),
        ("Horizontal Units", "s"),
        ("Horizontal Scale", "2.500000e-02"),
        ("Pt Fmt", "Y"),
        ("Yzero", "0.000000e+00"),
        ("Probe Atten", "1.000000e+00"),
        ("Model Number", "TDS2024C"),
        ("Serial Number", "C010001"),
        ("Firmware Version", "FV:v24.26"),
    ]
    body = []
    for row, (time, volts) in enumerate(
        zip(record.cells("time_s"), record.cells("position_m"), strict=True)
    ):
        body.append([*(settings[row] if row < len(settings) else ("", "")), "", time, volts, ""])
    return Sheet([], body, places=record.places(3), names_row=None, ending="\r\n")


@style(
    "Siglent SDS",
    "SDS00001.csv",
    [
        column("time_s", "Second", "s", 9, zero="-0.05"),
        *(_pressures("#2", "#3", 6)),
    ],
)
def siglent(path: Path, record: Record) -> Sheet:
    """Settings as `name,CH1:value,CH2:value`; two columns are both called Value."""
    above = f"""Record Length,Analog:{record.truth.rows},
Sample Interval,Analog:1.000000E-03,
Vertical Units,CH1:V,CH2:V,
Vertical Scale,CH1:1.000000,CH2:1.000000,
Vertical Offset,CH1:0.000000,CH2:0.000000,
Horizontal Units,s,
Horizontal Scale,2.000000E-02,
Model Number,SDS1104X-E,
Serial Number,SDSMMFCX000001,
Software Version,8.2.6.1.37R9,
Source,CH1,CH2,"""
    sheet = table(record, "+.9E", above=above.splitlines())
    sheet.heads = [["Second", "Value", "Value"]]
    return sheet


@style(
    "Rigol DS/MSO",
    "NewFile1.csv",
    [*_pressures("CH1", "CH2", 6)],
    "--period",
    "0.001",
    timed=False,
)
def rigol(path: Path, record: Record) -> Sheet:
    """Numbered rows; start and increment stand in the row of units, beyond the data's columns."""
    sheet = table(record, ".6E")
    sheet.heads = [
        ["X", "CH1", "CH2", "Start", "Increment", ""],
        ["Sequence", "VOLT", "VOLT", "-5.000000e-02", "1.000000e-03", ""],
    ]
    sheet.body = [[str(number), *cells, ""] for number, cells in enumerate(sheet.body)]
    sheet.places = record.places(1)
    return sheet


@style(
    "Keysight InfiniiVision",
    "scope_0.csv",
    [column("time_s", "x-axis", "s", 9, zero="-0.05"), *_pressures("1", "2", 4)],
)
def keysight(path: Path, record: Record) -> Sheet:
    """Channels are called 1 and 2; a row of units in words."""
    sheet = table(record, "+.8E", units_row=1)
    sheet.heads.append(["second", "Volt", "Volt"])
    return sheet


@style(
    "LeCroy, two segments",
    "C1Trace00000.csv",
    [column("time_s", "Time", "s", 9), _lvdt("Ampl", 6)],
    starts=(0, SECOND_START),
)
def lecroy(path: Path, record: Record) -> Sheet:
    """Segments follow one another, each with its time from its trigger."""
    rows, start = record.truth.rows, SECOND_START
    above = f"""LECROYWaveRunner,20113,Waveform
Segments,2,SegmentSize,{rows - start}
Segment,TrigTime,TimeSinceSegment1
#1,14-May-2024 13:29:30,0
#2,14-May-2024 13:29:31,1.25"""
    sheet = table(record, ".8e", above=above.splitlines(), ending="\r\n")
    times = record.readings("time_s")
    for row in range(start, rows):
        sheet.body[row][0] = f"{times[row] - times[start]:.8e}"
    return sheet


@style(
    "Yokogawa DL",
    "00000000.CSV",
    [*_pressures("CH1", "CH2", 5)],
    "--period",
    "0.001",
    timed=False,
)
def yokogawa(path: Path, record: Record) -> Sheet:
    """A header of settings by rows, among them the traces' names; each data row begins empty."""
    size = record.truth.rows
    above = f""""HEADER SIZE",16
"Model Name","DLM2024"
"Comment",""
"BlockNumber",1
"TraceName","CH1","CH2"
"BlockSize",{size},{size}
"VUnit","V","V"
"SampleRate",1.000000E+03,1.000000E+03
"HResolution",1.000000E-03,1.000000E-03
"HOffset",-5.000000E-02,-5.000000E-02
"HUnit","s","s"
"DisplayBlockSize",{size},{size}
"DisplayPointNo.",1,1
"PhaseShift",0.0000E+00,0.0000E+00
"Date","2024/05/14","2024/05/14"
"Time","13:29:30.12","13:29:30.12"
"""
    sheet = table(record, ".8E", above=above.split("\n"), names_row=None, ending="\r\n")
    sheet.heads = []
    sheet.body = [["", *cells, ""] for cells in sheet.body]
    sheet.places = record.places(1)
    return sheet


@style(
    "PicoScope",
    "20240514-0001.csv",
    [column("time_s", "Time", "ms", 8, zero="-0.05"), *_pressures("Channel A", "Channel B", 8)],
)
def picoscope(path: Path, record: Record) -> Sheet:
    """A row of units in brackets, then an empty line."""
    sheet = table(record, units_row=1, gap_after_heads=[""], ending="\r\n", encoding="utf-8-sig")
    sheet.heads.append(["(ms)", "(V)", "(V)"])
    return sheet


@style(
    "Rohde & Schwarz RTB",
    "RTB2K_CHAN1.CSV",
    [column("time_s", "in s", "s", 10, zero="-0.05"), *_pressures("C1 in V", "C2 in V", 6)],
)
def rohde_schwarz(path: Path, record: Record) -> Sheet:
    """One row of headings, units among the words."""
    return table(record, ".9E")


@style(
    "GW Instek GDS",
    "DS0001.CSV",
    [column("time_s", "#1", "s", 9, zero="-0.05"), _lvdt("#2", 5)],
    "--no-header",
)
def gw_instek(path: Path, record: Record) -> Sheet:
    """Settings as pairs with a comma at the end, then pairs of numbers of the same form."""
    above = f"""Format,2.0B,
Memory Length,{record.truth.rows},
IntpDistance,0,
Trigger Address,50,
Trigger Level,1.160E+01,
Source,CH1,
Vertical Units,V,
Vertical Units Div,0,
Vertical Units Extend Div,15,
Label,,
Probe Type,0,
Probe Ratio,1.000e+00,
Vertical Scale,5.000e+00,
Vertical Position,0.000e+00,
Horizontal Units,S,
Horizontal Scale,2.500E-02,
Horizontal Position,0.000E+00,
Horizontal Mode,Main,
SincET Mode,Real Time,
Sampling Period,1.000e-03,
Horizontal Old Scale,2.500E-02,
Horizontal Old Position,0.000E+00,
Firmware,V1.20,
Mode,Detail,
Waveform Data,,"""
    sheet = table(record, ".9E", above=above.splitlines(), names_row=None)
    sheet.heads = []
    sheet.body = [[*cells, ""] for cells in sheet.body]
    return sheet
