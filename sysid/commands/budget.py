"""The options that bound a search."""

from __future__ import annotations

import math

import click


def _no_nan(_: click.Context, option: click.Parameter, value: float | None) -> float | None:
    if value is not None and math.isnan(value):
        raise click.BadParameter("nan is not a time", param=option)
    return value


budget_option = click.option(
    "--budget",
    type=click.FloatRange(min=0.0, min_open=True),
    callback=_no_nan,
    default=None,
    metavar="SECONDS",
    help="Processor time for search and refinement, workers included, instead of the limit "
    "on evaluations; ends with the best result so far and names what was not done.",
)

quick_option = click.option(
    "--quick",
    is_flag=True,
    help="A first diagnosis in about a fifth of the time; says what it skipped.",
)
