"""`sysid compare`: bundles next to each other, and what moved."""

from __future__ import annotations

from pathlib import Path

import click

from sysid.commands.options import PathArgument, json_option, report_option
from sysid.commands.printing import headline, notices, print_blocks, print_json, written_lines
from sysid.pipeline.compare import compare as compare_bundles
from sysid.pipeline.compare import write_comparison
from sysid.pipeline.files import read_bundle


@click.command()
@click.argument("bundles", nargs=-1, required=True, type=PathArgument, metavar="BUNDLE...")
@report_option
@json_option
def compare(bundles: tuple[Path, ...], report: Path | None, as_json: bool) -> None:
    """Parameters of several bundles side by side, and what moved.

    Each BUNDLE is compared with the first. A parameter moved where the standard errors of both do
    not explain the difference, the false discovery rate being 5 % over the whole comparison. The
    on/off valves of all bundles are compared by their responses in one chamber too. Of one BUNDLE,
    valve B is compared with valve A.
    """
    found = compare_bundles(*(read_bundle(path) for path in bundles))
    if report is not None:
        write_comparison(report, found)
    notices(found.notices)
    if as_json:
        print_json(found.to_json())
        return
    written = written_lines([report] if report is not None else [])
    print_blocks((*found.tables(), headline(found), *written))
