"""`sysid fleet`: many campaigns through `run`, and one page over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from sysid.blocks.shown import Shown
from sysid.commands.options import PathArgument, options
from sysid.commands.printing import (
    grouped_notices,
    headline,
    notices,
    print_blocks,
    print_json,
    progress,
)
from sysid.commands.run import run_options
from sysid.errors import NotIdentifiedError, input_error
from sysid.pipeline.fleet import PAGE_FILE, FleetOptions, run_fleet

fleet_options = options(
    click.argument("campaigns", nargs=-1, required=True, type=PathArgument, metavar="CAMPAIGN..."),
    click.option("-o", "folder", required=True, type=PathArgument, help="Folder for all results."),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler whose workers do the work, tcp://host:8786; local: one is started.",
    ),
)


@click.command()
@fleet_options
@run_options
def fleet(
    campaigns: tuple[Path, ...],
    folder: Path,
    as_json: bool,
    verbose: bool,
    **options: Any,
) -> None:
    """`run` for every CAMPAIGN, and one page on all of them: what changed, and when.

    A campaign whose results are up to date is not run again. Rigs are distinguished by the name in
    the rig file, dates by an ISO date in the name of the campaign file or of its folder.
    """
    asked = FleetOptions(**options, verbose=verbose, reporter=progress, progress=progress())
    done = run_fleet(campaigns, folder, asked)
    notices(done.notices)
    said = [f"{row.folder}: {line}" for row in done.rows for line in row.notices]
    _show_notices(said, verbose)
    if as_json:
        print_json(done.to_json() | {"page": str(folder / PAGE_FILE)})
    else:
        _show(done, folder)
    if len(done.failed) == len(done.rows):
        error = input_error(folder, "no campaign gave a result", "see the notices above")
        unidentified = all(row.exit_code == NotIdentifiedError.exit_code for row in done.rows)
        raise NotIdentifiedError(str(error)) if unidentified else error


def _show_notices(lines: Sequence[str], verbose: bool) -> None:
    """Each campaign's own with its folder's name; grouped unless asked for."""
    if verbose:
        notices(lines)
    else:
        grouped_notices(lines, named=True)


def _show(done: Shown, folder: Path) -> None:
    print_blocks((*done.tables(), headline(done), f"page: {folder / PAGE_FILE}"))
