"""`sysid init`: a commented rig or campaign file to fill in."""

from __future__ import annotations

from pathlib import Path

import click

from sysid.commands.options import PathArgument
from sysid.io.campaign_template import write_campaign_template
from sysid.io.rig_template import write_rig_template

_CAMPAIGN = "campaign"


@click.command()
@click.argument("file", type=PathArgument)
@click.option(
    "--kind",
    type=click.Choice(["rig", _CAMPAIGN]),
    help="What to write; by default a campaign where FILE's name contains that word, else a rig.",
)
@click.option("--linear", is_flag=True, help="A linear rig: metres, newtons, kilograms.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def init(file: Path, kind: str | None, linear: bool, force: bool) -> None:
    """Write a commented rig or campaign file to fill in."""
    chosen = kind or (_CAMPAIGN if _CAMPAIGN in file.stem.lower() else "rig")
    if chosen == _CAMPAIGN:
        if linear:
            raise click.UsageError("--linear is for a rig file.")
        write_campaign_template(file, force=force)
        click.echo(f"{file}: name your logs in it, then `sysid check {file}`")
        return
    write_rig_template(file, linear=linear, force=force)
    click.echo(f"{file}: fill in what is known about the rig, then `sysid check LOG`")
