"""`sysid init`: a commented rig file to fill in."""

from __future__ import annotations

from pathlib import Path

import click

from sysid.commands.options import PathArgument
from sysid.io.rig_template import write_rig_template


@click.command()
@click.argument("rig", type=PathArgument)
@click.option("--linear", is_flag=True, help="A linear rig: metres, newtons, kilograms.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def init(rig: Path, linear: bool, force: bool) -> None:
    """Write a commented rig file to fill in."""
    write_rig_template(rig, linear=linear, force=force)
    click.echo(f"{rig}: fill in what is known about the rig, then `sysid check LOG`")
