"""`sysid convert`: a lab's own files in, a log out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from sysid.commands.options import PathArgument, json_option, map_option
from sysid.commands.printing import notices, print_json
from sysid.display.terminal import console
from sysid.io import conversion
from sysid.io.conversion import ConversionReport


@click.command()
@click.argument("foreign", nargs=-1, required=True, type=PathArgument, metavar="FOREIGN...")
@click.option(
    "-o", "output", required=True, type=PathArgument, help="log.csv or log.parquet to write."
)
@map_option
@click.option(
    "--set", "constants", multiple=True, metavar="TARGET=VALUE", help="A column of one value."
)
@click.option("--spec", "spec_file", type=PathArgument, help="TOML file with [map] and [options].")
@click.option("--delimiter", help="Delimiter of a text file, where it is not detected.")
@click.option("--decimal", help="Decimal sign of a text file: `.` or `,`.")
@click.option("--thousands", help="Thousands separator of a text file.")
@click.option("--skip-rows", type=int, help="Lines to skip at the top of a text file.")
@click.option(
    "--rows",
    metavar="FIRST:LAST",
    help='Rows of the table to keep, counted from 0, LAST excluded; also "::3, 2::3".',
)
@click.option(
    "--transpose", is_flag=True, help="Each line of a text file is a signal, its name first."
)
@click.option(
    "--fill",
    metavar="hold|linear",
    help="How columns that are sampled more slowly are filled between their own rows: hold or "
    "linear, all of them (else measurements linear, commands held).",
)
@click.option("--no-header", is_flag=True, help="The first row is data; columns are #1, #2, ...")
@click.option("--sheet", help="Sheet of an Excel workbook.")
@click.option(
    "--period", "period_s", type=float, help="Sampling period, s, if no column holds the time."
)
@click.option(
    "--atmosphere",
    "atmosphere_pa",
    type=float,
    help="Atmospheric pressure, Pa, for gauge pressures.",
)
@click.option("--unwrap", is_flag=True, help="Follow an angle that wraps around over its turns.")
@click.option("--trim", metavar="FROM:TO", help="Seconds of each test to keep, from its start.")
@click.option(
    "--resample", "resample_s", type=float, help="Even sampling period of the log written, s."
)
@click.option(
    "--join",
    multiple=True,
    type=PathArgument,
    metavar="OTHER",
    help="File whose columns are put beside FOREIGN's by time: measurements on the line between "
    "rows, commands held, inside the overlap only; may be repeated.",
)
@click.option(
    "--join-map",
    "join_maps",
    multiple=True,
    metavar="TARGET=COLUMN:UNIT",
    help="As --map, for the files of --join (their time_s too).",
)
@click.option(
    "--join-shift",
    "join_shift_s",
    type=float,
    default=0.0,
    help="Seconds to add to the times of the joined files (else one clock, or time stamps).",
)
@json_option
def convert(foreign: Sequence[Path], output: Path, as_json: bool, **options: Any) -> None:
    """Bring a lab's own file (.mat, text, Excel, TDMS, Parquet) into the log format."""
    show_conversion(conversion.convert(foreign, output, **options), as_json)


def show_conversion(report: ConversionReport, as_json: bool) -> None:
    """The columns written, and the notices."""
    notices(report.notices)
    if as_json:
        print_json(report.to_json())
        return
    out = console()
    tests = f", {len(report.tests)} tests" if report.tests else ""
    out.print(Text(f"written: {report.output}: {report.rows} rows{tests}"))
    out.print(Text(f"columns: {', '.join(report.columns)}"))
