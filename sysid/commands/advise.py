"""`sysid advise`: a campaign and a bundle in, which test to run next out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from sysid.commands.options import (
    PathArgument,
    bundle_option,
    campaign_argument,
    effects_option,
    exclude_option,
    json_option,
    options,
)
from sysid.commands.printing import (
    headline,
    notices,
    print_blocks,
    print_json,
    progress,
    remarks,
    written_lines,
)
from sysid.io.campaign import read_campaign
from sysid.pipeline.advise import AdviseOptions, PlayOptions, advise_and_design
from sysid.pipeline.advise import advise as advise_campaign
from sysid.pipeline.files import read_bundle

_POSITIVE = click.FloatRange(min=0.0, min_open=True)
_play_options = options(
    click.option(
        "-o", "output", type=PathArgument, help="Write a test to play: its commands as a log."
    ),
    click.option(
        "--for",
        "asked",
        multiple=True,
        metavar="NAME",
        help="What the test is for: a parameter or an effect; may be repeated (default: all).",
    ),
    click.option(
        "--duration",
        "duration_s",
        type=_POSITIVE,
        metavar="S",
        help="Of the test (default: 10; on a slow rig as many times longer).",
    ),
    click.option(
        "--max-speed",
        type=_POSITIVE,
        metavar="V",
        help="That the test may reach, rad/s or m/s (default: the fastest of the motion logs).",
    ),
    click.option(
        "--max-effort",
        type=_POSITIVE,
        metavar="T",
        help="Of the motor, Nm or N (default: 95 % of the rig file's limit).",
    ),
)


@click.command()
@campaign_argument
@bundle_option
@_play_options
@effects_option
@exclude_option
@json_option
def advise(
    campaign: Path,
    bundle: Path,
    output: Path | None,
    effects: Path | None,
    exclude: Sequence[str],
    as_json: bool,
    **chosen: Any,
) -> None:
    """Which test to run next: expected standard errors, ties, sizes of effects."""
    given = {name: value for name, value in chosen.items() if value not in (None, ())}
    if output is None and given:
        name = {"asked": "for", "duration_s": "duration"}.get(next(iter(given)), next(iter(given)))
        raise click.UsageError(f"--{name.replace('_', '-')} needs -o, the test's file.")
    read = read_campaign(campaign).excluding(exclude)
    asked = PlayOptions(**given, effects=effects, progress=progress())
    test = None
    if output is None:
        found = advise_campaign(read, read_bundle(bundle), asked.those_of(AdviseOptions))
    else:
        found, test = advise_and_design(read, read_bundle(bundle), asked)
    said = () if test is None else test.notices
    notices(dict.fromkeys((*read.notices, *read.rig.notices, *found.notices, *said)))
    written = [] if test is None or output is None else [test.write(output)]
    if as_json:
        own = {} if test is None else {"test": test.to_json(), "written": str(written[0])}
        print_json({**found.to_json(), **own})
        return
    print_blocks((*found.tables(), *remarks(found), headline(found)))
    if test is not None:
        print_blocks((*test.tables(), headline(test), *written_lines(written)))
