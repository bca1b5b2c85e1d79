"""`sysid app`: the workbench in the browser."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sysid.commands.options import PathArgument, component_option, effects_option
from sysid.errors import input_error
from sysid.io.files import inputs_changed

if TYPE_CHECKING:
    from sysid.app.workbench import Workbench

_NEEDED = ("panel", "tomlkit")


@click.command("app")
@click.argument("campaign", type=PathArgument, required=False)
@click.option(
    "-o", "results", type=PathArgument, help="Folder of results (default: results, next to it)."
)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Port on 127.0.0.1 (default: any)."
)
@click.option("--no-browser", is_flag=True, help="Print the address, and open no browser.")
@effects_option
@component_option
def workbench(
    campaign: Path | None,
    results: Path | None,
    port: int,
    no_browser: bool,
    effects: Path | None,
    component: str | None,
) -> None:
    """The workbench in the browser: look at logs, fit, try effects, compare and export.

    Only this machine reaches it, and only by the address that is printed. Without CAMPAIGN, that of
    the folder is opened, or one is made. Own code (--effects, --component) runs once the page was
    told that it may. Ctrl-C ends it.
    """
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        fix = 'pip install "sysid[app]"'
        raise input_error("sysid app", f"{' and '.join(missing)} is not installed", fix)
    path = campaign or Path("campaign.toml")
    if path.is_dir():
        raise input_error(path, "is a folder", "give the campaign file in it")
    if campaign is not None and component is None:
        # To import what reads it may take seconds: it is said first.
        click.echo(f"sysid app: reading {path}", err=True)
        from sysid.pipeline.files import read_campaign

        read_campaign(path)
    from sysid.app.server import serve

    folder = path.resolve().parent
    kept = folder / "results" if results is None else results.resolve()

    def made() -> Workbench:
        from sysid.app.workbench import Workbench

        return Workbench(folder, folder / path.name, kept, component, effects)

    with inputs_changed():
        serve(made, port, _tell, opens_browser=not no_browser)


def _tell(address: str) -> None:
    click.echo(f"sysid app: {address}")
    click.echo("Only this machine reaches it. Ctrl-C ends it.")
    sys.stdout.flush()  # a pipe's reader waits for the address too


__all__ = ["workbench"]
