"""`sysid advise`: a campaign and a bundle in, which test to run next out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from sysid.commands.options import (
    bundle_option,
    campaign_argument,
    effects_option,
    exclude_option,
    json_option,
)
from sysid.commands.printing import notices, print_blocks, print_json, progress, remarks
from sysid.io.campaign import read_campaign
from sysid.pipeline.advise import advise as advise_campaign
from sysid.pipeline.files import read_bundle


@click.command()
@campaign_argument
@bundle_option
@effects_option
@exclude_option
@json_option
def advise(
    campaign: Path, bundle: Path, effects: Path | None, exclude: Sequence[str], as_json: bool
) -> None:
    """Which test to run next: expected standard errors, ties, sizes of effects."""
    read = read_campaign(campaign).excluding(exclude)
    found = advise_campaign(read, read_bundle(bundle), effects=effects, progress=progress())
    notices((*read.notices, *read.rig.notices, *found.notices))
    if as_json:
        print_json(found.to_json())
        return
    print_blocks((*found.tables(), *remarks(found), found.headline()))
