"""`sysid demo`: `sysid run` on the bundled campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sysid.commands.options import PathArgument
from sysid.commands.run import run_and_show, run_options
from sysid.io.bundled import bundled_campaign


@click.command()
@click.option("-o", "folder", required=True, type=PathArgument, help="Folder for all results.")
@run_options
def demo(folder: Path, **options: Any) -> None:
    """The whole pipeline on the bundled campaign."""
    run_and_show(bundled_campaign(), folder, **options)
