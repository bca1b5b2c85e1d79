"""The options that bound a search."""

from __future__ import annotations

import math

import click


def _no_nan(_: click.Context, option: click.Parameter, value: float | None) -> float | None:
    if value is not None and math.isnan(value):
        raise click.BadParameter("nan is no time", param=option)
    return value


budget_option = click.option(
    "--budget",
    type=click.FloatRange(min=0.0, min_open=True),
    callback=_no_nan,
    default=None,
    metavar="SECONDS",
    help="Processor time of the command and its workers for search and refinement, in place of the "
    "bound by counted evaluations; ends then with the best so far, says what it missed.",
)

quick_option = click.option(
    "--quick",
    is_flag=True,
    help="A first diagnosis in about a fifth of the time; says what it left out.",
)
