"""Options and arguments that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from sysid.io.motion import LOADS

PathArgument = click.Path(path_type=Path)
SEED = click.IntRange(min=0)
MOST_DRAWS = 1000
draws_option = click.option(
    "--draws",
    type=click.IntRange(min=20, max=MOST_DRAWS),
    metavar="N",
    default=None,
    help="Draw N models from the uncertainty of the bundle's parameters, and add what they give.",
)


def options(*decorators: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Several options as one decorator, in the order of the help text."""

    def decorate(function: Any) -> Any:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorate


logs_argument = click.argument("logs", nargs=-1, required=True, type=PathArgument, metavar="LOG...")
campaign_argument = click.argument("campaign", type=PathArgument)
bundle_option = click.option("--bundle", required=True, type=PathArgument, help="Bundle to use.")
report_option = click.option("--report", type=PathArgument, help="Write the HTML report here.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
rig_option = click.option(
    "--rig", type=PathArgument, help="Rig file (else rig.toml in or above the log's folder)."
)
law_option = click.option(
    "--law",
    type=click.Choice(["thesis", "iso6358", "thesis-series", "auto"]),
    default="auto",
    show_default=True,
    help="Flow law of on/off valves; auto: the tests choose by evidence.",
)
load_option = click.option(
    "--load",
    type=click.Choice(LOADS),
    help="Friction with a part that grows with this effort: the motor's, or all that is "
    "transmitted, motor and cylinder.",
)
map_option = click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="TARGET=COLUMN:UNIT",
    help='Foreign column and unit, e.g. "pressure_a_pa=P1:kPa(g)"; may be repeated.',
)
exclude_option = click.option(
    "--exclude",
    multiple=True,
    metavar="[LOG/]TEST[@FROM:TO]",
    help="Exclude a test or a span of it (s since its first row); may be repeated.",
)
component_option = click.option(
    "--component",
    metavar="FILE[:CLASS]",
    help="Python file with a component of your own, whose logs these are; it is executed.",
)
effects_option = click.option(
    "--effects", type=PathArgument, help="Python file with further effects; it is executed."
)
accept_assumed_option = click.option(
    "--accept-assumed",
    is_flag=True,
    help="Let controllers use undeclared constants (those of the reference rig).",
)
verbose_option = click.option(
    "-v", "--verbose", is_flag=True, help="Print every step, notice and log's errors."
)
