"""`sysid monitor`: a bundle and logs of its machine in, alarms of drift out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from sysid.commands.options import (
    PathArgument,
    effects_option,
    exclude_option,
    json_option,
    map_option,
)
from sysid.commands.printing import notices, print_json, print_result, progress
from sysid.pipeline.monitor import MonitorOptions, monitor_logs, write_monitoring


@click.command()
@click.argument("bundle", type=PathArgument)
@click.argument("logs", nargs=-1, type=PathArgument, metavar="[LOG...]")
@click.option("-o", "output", type=PathArgument, help="JSON file to write.")
@map_option
@exclude_option
@effects_option
@json_option
def monitor(
    bundle: Path,
    logs: Sequence[Path],
    output: Path | None,
    maps: Sequence[str],
    exclude: Sequence[str],
    as_json: bool,
    **options: Any,
) -> None:
    """Alarms where the machine of each LOG no longer obeys BUNDLE, by kind of drift.

    The logs are of one machine's motion to and fro, in their order; after each cycle, a stroke
    there and back, the monitor says whether friction, leakage, a valve's delay or the supply
    drifted beyond the bundle's intervals and its scatter. It is the same as in the exported C.
    Without a LOG: the smallest changes that it would detect.
    """
    found = monitor_logs(
        bundle, logs, maps, exclude, MonitorOptions(**options, progress=progress())
    )
    notices(found.notices)
    if output is not None:
        write_monitoring(found, output)
    if as_json:
        written = {} if output is None else {"written": str(output)}
        print_json(found.to_json() | written)
    else:
        print_result(found, [] if output is None else [output])
