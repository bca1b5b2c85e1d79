"""`sysid pwm-frequency`: which PWM frequency to run a valve at."""

from __future__ import annotations

from pathlib import Path

import click

from sysid.commands.options import (
    exclude_option,
    json_option,
    logs_argument,
    map_option,
    report_option,
    rig_option,
)
from sysid.commands.printing import headline, notices, print_blocks, print_json, written_lines
from sysid.pipeline.pwm_frequency import FrequencyFiles, compare_frequencies


@click.command("pwm-frequency")
@logs_argument
@rig_option
@map_option
@click.option(
    "--hz",
    "hertz",
    type=click.FloatRange(min=0.1, max=1e5),
    multiple=True,
    help="PWM frequency of each LOG, in order (default: what the ripple in its pressure shows).",
)
@click.option("--valve", type=click.Choice(["a", "b"]), help="This valve only.")
@click.option(
    "--least-range",
    type=click.FloatRange(min=0.0, max=1.0),
    help="Choose the highest frequency whose duty is linear over at least this range.",
)
@exclude_option
@report_option
@json_option
def pwm_frequency(
    logs: tuple[Path, ...],
    rig: Path | None,
    maps: tuple[str, ...],
    hertz: tuple[float, ...],
    valve: str | None,
    least_range: float | None,
    exclude: tuple[str, ...],
    report: Path | None,
    as_json: bool,
) -> None:
    """Which PWM frequency to run at, from valve-pwm logs at several: one LOG each.

    For each, the range in which the valve's opening follows the duty, duties whose responses
    overlap, and the largest flow by step of duty. The widest linear range is chosen; of those that
    do not differ from it significantly, the highest frequency.
    """
    found = compare_frequencies(
        FrequencyFiles(
            logs=logs,
            rig=rig,
            maps=maps,
            exclude=exclude,
            hertz=hertz,
            valve=valve,
            least_range=least_range,
            report=report,
        )
    )
    notices(found.notices)
    if as_json:
        print_json(found.to_json())
        return
    written = written_lines([report] if report is not None else [])
    print_blocks((*found.tables(), headline(found), *written))
