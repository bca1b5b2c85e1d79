"""`sysid export`: a bundle in, files for a controller or a simulator out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sysid.commands.options import (
    PathArgument,
    accept_assumed_option,
    effects_option,
    json_option,
)
from sysid.commands.printing import notices, print_blocks, print_json, written_lines
from sysid.pipeline.export import (
    FMI_VERSIONS,
    FORMATS,
    ExportOptions,
    check_folder,
    export_file,
)


@click.command()
@click.argument("bundle", type=PathArgument)
@click.option(
    "--format",
    required=True,
    type=click.Choice(FORMATS),
    help="Format of the file.",
)
@click.option(
    "--fmi",
    type=click.Choice(FMI_VERSIONS),
    default=FMI_VERSIONS[0],
    show_default=True,
    help="Version of FMI, for an FMU.",
)
@click.option("-o", "output", required=True, type=PathArgument, help="File to write.")
@effects_option
@accept_assumed_option
@json_option
def export(bundle: Path, output: Path, as_json: bool, **options: Any) -> None:
    """Files for a controller (a C header, MATLAB, flat JSON) or a simulator (an FMU).

    Next to the header a folder is written that replays Python's numbers through it. An FMU is the
    plant for co-simulation, with a library for this machine where a C compiler is there.
    """
    asked = ExportOptions(**options)
    said = export_file(bundle, output, asked)
    notices(said)
    check = check_folder(output)
    has_check = asked.format == "c" and check.is_dir()
    if as_json:
        shown = {"written": str(output), "notices": list(said)}
        print_json(shown | ({"check": str(check)} if has_check else {}))
    else:
        print_blocks(written_lines([output, *([check] if has_check else [])]))
