"""`sysid demo`: `sysid run` on the bundled campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sysid.commands.options import PathArgument
from sysid.commands.printing import progress
from sysid.commands.run import run_campaign, run_options, show_run
from sysid.io.bundled import bundled_campaign


@click.command()
@click.option("-o", "folder", required=True, type=PathArgument, help="Folder for all results.")
@run_options
def demo(folder: Path, as_json: bool, **options: Any) -> None:
    """The whole pipeline on the bundled campaign."""
    done = run_campaign(bundled_campaign(), folder, progress=progress(), **options)
    show_run(done, as_json)
