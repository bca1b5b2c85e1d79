"""`sysid export`: a bundle in, files for a controller or a simulator out."""

from __future__ import annotations

from collections.abc import Sequence
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
    NO_CONTROLLERS,
    ExportOptions,
    check_folder,
    controllers_file,
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
    """Files for a controller (a C header, MATLAB, flat JSON) or a simulator (FMU, MJCF).

    Next to the header a folder is written that replays Python's numbers through it. An FMU is the
    plant for co-simulation, with a library for this machine where a C compiler is there; the
    controllers are a second one. MJCF is the joint for MuJoCo, without chambers and valves.
    """
    asked = ExportOptions(**options)
    said = export_file(bundle, output, asked)
    notices(said)
    more = _next_to(output, asked.format, said)
    if as_json:
        shown = {"written": str(output), "notices": list(said)}
        print_json(shown | {key: str(path) for key, path in more.items()})
    else:
        print_blocks(written_lines([output, *more.values()]))


def _next_to(output: Path, chosen: str | None, said: Sequence[str]) -> dict[str, Path]:
    """What is written next to a file, by its key in JSON."""
    if chosen == "c" and check_folder(output).is_dir():
        return {"check": check_folder(output)}
    if chosen == "fmu" and not any(text.startswith(NO_CONTROLLERS) for text in said):
        return {"controllers": controllers_file(output)}
    return {}
