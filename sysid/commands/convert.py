"""`sysid convert`: a lab's own files in, a log out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from sysid.blocks.terminal import console, new_table
from sysid.commands.options import PathArgument, component_option, json_option, map_option
from sysid.commands.printing import notices, print_json, progress
from sysid.errors import one_line, shortened
from sysid.io import conversion
from sysid.io.conversion import ConversionReport
from sysid.io.listing import ListedChannel, Listing, channels_of
from sysid.pipeline.files import own_kind


@click.command()
@click.argument("foreign", nargs=-1, required=True, type=PathArgument, metavar="FOREIGN...")
@click.option("-o", "output", type=PathArgument, help="log.csv or log.parquet to write.")
@click.option(
    "--list",
    "is_listed",
    is_flag=True,
    help="Show the channels of each file instead: name, unit, rate, rows, first values.",
)
@map_option
@click.option(
    "--set", "constants", multiple=True, metavar="TARGET=VALUE", help="A column of one value."
)
@click.option("--spec", "spec_file", type=PathArgument, help="TOML file with [map] and [options].")
@click.option("--delimiter", help="Delimiter of a text file, if it is not detected.")
@click.option("--decimal", help="Decimal separator of a text file: `.` or `,`.")
@click.option("--thousands", help="Thousands separator of a text file.")
@click.option("--skip-rows", type=int, help="Lines to skip at the top of a text file.")
@click.option(
    "--rows",
    metavar="FIRST:LAST",
    help='Rows of the table to keep, counted from 0, LAST excluded; also "::3, 2::3". Files of '
    "--join are not cut.",
)
@click.option(
    "--transpose", is_flag=True, help="Each line of a text file is a signal, its name first."
)
@click.option(
    "--fill",
    metavar="hold|linear",
    help="How slower columns are filled between their own rows: hold or "
    "linear (default: measurements linear, commands held).",
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
@click.option("--unwrap", is_flag=True, help="Unwrap an angle over full turns.")
@click.option("--trim", metavar="FROM:TO", help="Seconds of each test to keep, from its start.")
@click.option(
    "--resample", "resample_s", type=float, help="Even sampling period of the log written, s."
)
@click.option(
    "--join",
    multiple=True,
    type=PathArgument,
    metavar="OTHER",
    help="File whose columns are joined to FOREIGN's by time: measurements interpolated "
    "linearly, commands held, within the overlap only; may be repeated.",
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
    help="Seconds to add to the times of the joined files (default: one clock or time stamps).",
)
@component_option
@json_option
def convert(
    foreign: Sequence[Path],
    output: Path | None,
    is_listed: bool,
    component: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Bring a lab's own file (.mat, text, Excel, TDMS, Parquet) into the log format.

    Also HDF5, .npy, .npz, JSON and JSON lines; with the extra sysid[formats] MDF, MCAP, ROS 1 and
    ROS 2 bags and ULog.
    """
    if is_listed:
        _list(foreign, output, as_json, options)
        return
    if output is None:
        context = click.get_current_context()
        missing = next(option for option in context.command.params if option.name == "output")
        raise click.MissingParameter(ctx=context, param=missing)
    own = own_kind(component, progress())
    show_conversion(conversion.convert(foreign, output, own=own, **options), as_json)


def _list(
    foreign: Sequence[Path], output: Path | None, as_json: bool, options: Mapping[str, Any]
) -> None:
    """The channels of each file; options that only a conversion has are named in a notice."""
    reading = {key: options[key] for key in ("delimiter", "decimal", "thousands", "skip_rows")}
    reading |= {"sheet": options["sheet"], "header": False if options["no_header"] else None}
    listings = channels_of(foreign, spec_file=options["spec_file"], **reading)
    if output is not None:
        notices([f"--list writes nothing: -o {output} is ignored"])
    for listing in listings:
        notices(listing.notices)
    if as_json:
        print_json({"files": [listing.to_json() for listing in listings]})
        return
    for listing in listings:
        show_listing(listing)


def show_listing(listing: Listing) -> None:
    """A line for each channel, its name whole: the table may be wider than the terminal."""
    out = console()
    out.width = max(out.width, 10_000)  # wider than any name
    counted = f"{len(listing.channels):,} channel{'s' * (len(listing.channels) != 1)}"
    out.print(Text(f"{listing.path}: {listing.format}, {counted}"))
    table = new_table("", "channel", "unit", "rate", "rows", "first values")
    for column in table.columns:
        column.no_wrap = True
    for number in (2, 3):
        table.columns[number].justify = "right"
    for channel in listing.channels:
        name = channel.name + "".join(f" = {other}" for other in channel.also)
        cells = (name, channel.unit or "-", _rate(channel.period_s), f"{channel.rows}")
        table.add_row(*map(Text, (*cells, _first(channel))))
    out.print(table)
    if listing.skipped:
        out.print(Text("not channels:"))
        for name, reason in listing.skipped.items():
            out.print(Text(f"  {name}: {one_line(reason)}"))


def _rate(period_s: float | None) -> str:
    """A rate in Hz, or a period above a second."""
    if period_s is None:
        return "-"
    return f"{1.0 / period_s:.4g} Hz" if period_s <= 1.0 else f"{period_s:.4g} s"


def _first(channel: ListedChannel) -> str:
    """The first values; of texts and time stamps only one, for they are long."""
    if any(isinstance(value, str) for value in channel.first):
        return shortened(next(value for value in channel.first if isinstance(value, str)))
    return ", ".join("(empty)" if value is None else f"{value:.6g}" for value in channel.first)


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
