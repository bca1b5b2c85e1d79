"""National Instruments: LabVIEW, SignalExpress, TDMS."""

from __future__ import annotations

from pathlib import Path

import nptdms

from benchmarks.exports.record import Channel, Record, Sheet, column, style, table

_HEAD = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t{decimal}
Multi_Headings\t{multi}
X_Columns\t{columns}
Time_Pref\tRelative
Operator\tlab
Date\t2024/05/14
Time\t13:29:30.1234567
***End_of_Header***\t
\t"""


def _signals() -> tuple[Channel, ...]:
    return (
        column("pressure_a_pa", "P1", "bar(g)", 6),
        column("position_m", "pos", "mm", 6),
        column("motor_force_n", "force", "N", 6),
    )


def _lvm(record: Record, columns: str, decimal: str = ".") -> Sheet:
    """Header, a block of the channels' settings, `X_Value` and names, `Comment` without a field."""
    rows, many = record.truth.rows, len(record.channels) - (columns == "One")
    signals = [c for c in record.channels if c.target != "time_s"]
    step, zero = f"0{decimal}001000", f"0{decimal}0000000000000000E+0"
    gap = "\t\t" if columns == "Multi" else "\t"
    head = _HEAD.format(decimal=decimal, multi="No", columns=columns).splitlines()

    def line(name: str, values: list[str]) -> str:
        return f"{name}\t{gap.join(values)}\t"

    units = [c.unit.removesuffix("(g)") for c in signals]
    head += [
        line("Channels", [str(many)] + [""] * (many - 1)),
        line("Samples", [str(rows)] * many),
        line("Date", ["2024/05/14"] * many),
        line("Time", [f"13:29:30{decimal}1234567"] * many),
        line("Y_Unit_Label", units),
        line("X_Dimension", ["Time"] * many),
        line("X0", [zero] * many),
        line("Delta_X", [step] * many),
        "***End_of_Header***" + "\t" * (many + 1),
    ]
    sheet = Sheet([], [], "\t", head, ending="\r\n")
    times = [f"{row / 1000:.6f}".replace(".", decimal) for row in range(rows)]
    cells = [record.cells(c.target, decimal=decimal) for c in signals]
    if columns == "Multi":
        sheet.heads = [[w for c in signals for w in ("X_Value", c.name)] + ["Comment"]]
        sheet.body = [[w for own in cells for w in (times[row], own[row])] for row in range(rows)]
        sheet.places = {c.target: 2 * n + 1 for n, c in enumerate(signals)}
        return sheet
    sheet.heads = [["X_Value", *(c.name for c in signals), "Comment"]]
    first = times if columns == "One" else [""] * rows
    sheet.body = [[first[row], *(own[row] for own in cells)] for row in range(rows)]
    sheet.places = {c.target: n + 1 for n, c in enumerate(signals)}
    if columns == "One":
        sheet.places["time_s"] = 0
    return sheet


@style("LabVIEW .lvm, no X column", "test.lvm", _signals(), timed=False)
def lvm_none(path: Path, record: Record) -> Sheet:
    return _lvm(record, "No")


@style("LabVIEW .lvm, one X column", "test.lvm", [column("time_s", "X_Value", "s", 6), *_signals()])
def lvm_one(path: Path, record: Record) -> Sheet:
    return _lvm(record, "One")


@style("LabVIEW .lvm, an X column each", "test.lvm", _signals(), timed=False)
def lvm_multi(path: Path, record: Record) -> Sheet:
    return _lvm(record, "Multi")


@style(
    "LabVIEW .lvm, decimal comma",
    "messung.lvm",
    [column("time_s", "X_Value", "s", 6), *_signals()],
)
def lvm_comma(path: Path, record: Record) -> Sheet:
    return _lvm(record, "One", ",")


@style(
    "LabVIEW spreadsheet file",
    "data.txt",
    [
        column("time_s", "#1", "s", 3),
        column("pressure_a_pa", "#2", "kPa(g)", 3),
        column("pressure_b_pa", "#3", "kPa(g)", 3),
        column("position_m", "#4", "mm", 3),
    ],
    "--no-header",
)
def spreadsheet_file(path: Path, record: Record) -> Sheet:
    """`Write To Spreadsheet File`: %.3f and tabs, nothing else."""
    sheet = table(record, separator="\t", ending="\r\n", names_row=None)
    sheet.heads = []
    return sheet


@style(
    "SignalExpress text",
    "log.txt",
    [
        column("pressure_a_pa", "Dev1_ai0", "20 kPa", 6),
        column("position_m", "Dev1_ai1", "10 mm", 6),
    ],
    "--period",
    "0.001",
    timed=False,
)
def signal_express(path: Path, record: Record) -> Sheet:
    """Blocks `channel names:`, `start times:`, `dt:`, `data:`, each word on its own line."""
    start = "05/14/2024 01:29:30.123456 PM"
    above = [
        "channel names: ",
        "\t".join(record.names()),
        "start times: ",
        f"{start}\t{start}",
        "dt: ",
        "0.001000\t0.001000",
        "data: ",
    ]
    sheet = table(record, ".8E", separator="\t", above=above, ending="\r\n", names_row=None)
    sheet.heads = []
    return sheet


def _write_tdms(path: Path, record: Record, timed: bool) -> None:
    root = nptdms.RootObject(properties={"title": "cylinder"})
    found = [root, nptdms.GroupObject("Run")]
    for channel in record.channels:
        more = {} if timed else {"wf_increment": 0.001, "wf_start_offset": 0.0, "wf_samples": 1}
        unit = {"unit_string": channel.unit.removesuffix("(g)")} if channel.unit else {}
        name = channel.name.removeprefix("Run/")
        values = record.doubles(channel.target)
        found.append(nptdms.ChannelObject("Run", name, values, properties={**more, **unit}))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(found)


@style(
    "TDMS waveforms",
    "run.tdms",
    [
        column("pressure_a_pa", "Run/P1", "bar(g)", None),
        column("pressure_b_pa", "Run/P2", "bar(g)", None),
        column("position_m", "Run/pos", "mm", None),
    ],
    timed=False,
)
def tdms(path: Path, record: Record) -> None:
    _write_tdms(path, record, timed=False)
