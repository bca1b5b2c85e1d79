"""The options that bound the time of a search; apart, as they import the diagnosis."""

from __future__ import annotations

import math

import click

from sysid.diagnosis.looked import SECONDS


def _no_nan(_: click.Context, option: click.Parameter, value: float) -> float:
    if math.isnan(value):
        raise click.BadParameter("nan is no time", param=option)
    return value


budget_option = click.option(
    "--budget",
    type=click.FloatRange(min=0.0, min_open=True),
    callback=_no_nan,
    default=SECONDS,
    show_default=True,
    metavar="SECONDS",
    help="Time for search and refinement; ends then with the best so far, says what it missed.",
)

quick_option = click.option(
    "--quick",
    is_flag=True,
    help="A first diagnosis in about a fifth of the time; says what it left out.",
)
