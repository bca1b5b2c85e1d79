"""`python -m datasets.measured`: every measured set converted, fitted, diagnosed, reported."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from datasets.measured.findings import (
    COLUMNS,
    agreement,
    mains,
    markdown_table,
    overview,
    with_agreement,
    write_readme_table,
)
from datasets.measured.page import write_page
from datasets.measured.run import chosen, failed, run_sets
from datasets.measured.sets import PROJECT, SETS_FOLDER
from sysid.errors import SysidError, input_error
from sysid.io.files import write_atomic


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; exit status 0 done, 1 a set failed, 2 unusable input."""
    options = _parser().parse_args(arguments)
    try:
        return _run(options)
    except SysidError as error:
        print(f"measured: error: {error}", file=sys.stderr)
        return error.exit_code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m datasets.measured", description=__doc__)
    parser.add_argument("--data", type=Path, default=PROJECT.parent / "shared" / "data")
    parser.add_argument("--sets", type=Path, default=SETS_FOLDER, help="folder of the sets")
    parser.add_argument("-o", "--output", type=Path, default=PROJECT / "reports" / "measured.html")
    parser.add_argument("--work", type=Path, default=PROJECT / "out" / "measured")
    parser.add_argument("--only", action="append", default=[], metavar="SET", help="repeatable")
    parser.add_argument(
        "--readme", type=Path, help="also put the overview between the markers of this file"
    )
    return parser


def _run(options: argparse.Namespace) -> int:
    if options.output.suffix == ".json":
        raise input_error(
            options.output, "is not an HTML page", "name a .html file (JSON is written next to it)"
        )
    folders = chosen(options.sets, options.only, options.data)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    results = run_sets(folders, options.data, options.work, _say)
    write_page(options.output, results)
    numbers = options.output.with_suffix(".json")
    text = json.dumps(with_agreement(results), indent=2, allow_nan=False, ensure_ascii=False)
    write_atomic(numbers, f"{text}\n")
    _show(results)
    for path in (options.output, numbers):
        print(f"written: {path}")
    if failed(results):
        if options.readme is not None:
            _say(f"{options.readme} is unchanged, since a set failed")
        return 1
    if options.readme is not None:
        write_readme_table(options.readme, markdown_table(results))
        print(f"written: {options.readme}")
    return 0


def _say(line: str) -> None:
    print(f"measured: {line}", file=sys.stderr, flush=True)


def _show(results: Mapping[str, Any]) -> None:
    """Print the overview, and whether the verdicts repeat."""
    from rich.text import Text

    from sysid.blocks.terminal import console, new_table

    out = console()
    table = new_table("Measured data, errors on held-out recordings", *COLUMNS)
    for row in overview(results):
        table.add_row(*(Text(cell) for cell in row))
    out.print(table)
    for measured in results["sets"]:
        for campaign in mains(measured):
            answer = agreement(measured, campaign)
            if answer is not None:
                line = f"{measured['name']}, {campaign['file']}: {answer.sentence}"
                out.print(Text(line), soft_wrap=True)


if __name__ == "__main__":
    sys.exit(main())
