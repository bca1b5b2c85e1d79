"""`sysid compare`: bundles next to each other, and what moved."""

from __future__ import annotations

from pathlib import Path

import click

from sysid.blocks.numbers import ascii_text
from sysid.commands.options import PathArgument, json_option
from sysid.commands.printing import notices, print_blocks, print_json
from sysid.pipeline.compare import compare as compare_bundles
from sysid.pipeline.files import read_bundle


@click.command()
@click.argument("bundles", nargs=-1, required=True, type=PathArgument, metavar="BUNDLE...")
@json_option
def compare(bundles: tuple[Path, ...], as_json: bool) -> None:
    """Parameters of several bundles side by side, and what moved.

    Each BUNDLE is compared with the first. A parameter moved where the standard errors of both do
    not explain the difference, the false discovery rate being 5 % over the whole comparison.
    """
    if len(bundles) < 2:
        raise click.UsageError("Give at least two bundles.")
    found = compare_bundles(*(read_bundle(path) for path in bundles))
    notices(found.notices)
    if as_json:
        print_json(found.to_json())
        return
    print_blocks((*found.tables(), ascii_text(found.headline())))
