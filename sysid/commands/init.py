"""`sysid init`: a commented rig or campaign file to fill in."""

from __future__ import annotations

from pathlib import Path

import click

from sysid.commands.options import PathArgument, map_option
from sysid.commands.printing import notices
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign_template import write_campaign_template
from sysid.io.rig import RIG_FILE_NAME
from sysid.io.rig_template import write_rig_of_logs, write_rig_template
from sysid.io.units import parse_map

_CAMPAIGN = "campaign"


@click.command()
@click.argument("file", type=PathArgument, default=RIG_FILE_NAME)
@click.option(
    "--from",
    "logs",
    multiple=True,
    type=PathArgument,
    metavar="LOG",
    help="Write what this log shows of its rig, else the reference rig's constants; repeatable.",
)
@map_option
@click.option(
    "--kind",
    type=click.Choice(["rig", _CAMPAIGN]),
    help="What to write; by default a campaign where FILE's name contains that word, else a rig.",
)
@click.option("--linear", is_flag=True, help="A linear rig: metres, newtons, kilograms.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def init(
    file: Path,
    logs: tuple[Path, ...],
    maps: tuple[str, ...],
    kind: str | None,
    linear: bool,
    force: bool,
) -> None:
    """Write a commented rig or campaign file to fill in."""
    if logs:
        if kind == _CAMPAIGN or linear:
            raise click.UsageError("--from writes the rig file of what its logs show.")
        bare = read_bare_logs(logs, parse_map(maps))
        named = " and ".join(log.name for log in logs)
        write_rig_of_logs(file, bare.rig.content, named, force=force)
        notices(bare.notices)
        click.echo(
            f"{file}: correct what it marks as ASSUMED, and take it out of the list `assumed`"
        )
        return
    if maps:
        raise click.UsageError("--map goes with --from.")
    chosen = kind or (_CAMPAIGN if _CAMPAIGN in file.stem.lower() else "rig")
    if chosen == _CAMPAIGN:
        if linear:
            raise click.UsageError("--linear is for a rig file.")
        write_campaign_template(file, force=force)
        click.echo(f"{file}: name your logs in it, then `sysid check {file}`")
        return
    write_rig_template(file, linear=linear, force=force)
    click.echo(f"{file}: fill in what is known about the rig, then `sysid check LOG`")
