"""Regenerate `controllers.html`: the thesis' tables and figures of controllers, computed anew.

    python reports/make_controllers.py               # about two minutes; `make controllers`
    python reports/make_controllers.py -o page.html

Every table is computed twice, with the rig's sensors and with perfect ones, on the bundle of the
thesis' rig; the page shows the former, and how many cells agree with either.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import sys
from collections.abc import Callable
from pathlib import Path

from sysid.controllers.sensing import SensorSuite
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.parameters import read_bundle
from sysid.pipeline.pages.controllers import write_controllers_page
from sysid.thesis import TABLES, TableRig, ThesisTable, batches, thesis_tables
from sysid.thesis.figures import figure_runs
from sysid.thesis.overview import ControllersPage
from sysid.thesis.studies import flow_study, stabilities

PAGE = Path(__file__).resolve().parent / "controllers.html"


def _all_tables(rig: TableRig, say: Callable[[str], None]) -> dict[str, ThesisTable]:
    """All of `TABLES`; the appendices with the tables of chapter 6 whose tests they hold."""
    found: dict[str, ThesisTable] = {}
    for names in batches():
        found |= thesis_tables(names, rig, lambda line, n=names: say(f"{', '.join(n[:3])}: {line}"))
    return {name: found[name] for name in TABLES}


def main() -> None:
    """Compute everything and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", dest="page", type=Path, default=PAGE, help="the page to write")
    page = parser.parse_args().page
    bundle = read_bundle(thesis_folder() / REFERENCE_BUNDLE)
    rig = TableRig.of(bundle)
    ideal = dataclasses.replace(rig, sensors=SensorSuite.perfect())
    say = functools.partial(print, file=sys.stderr)
    tables, perfect = (_all_tables(chosen, say) for chosen in (rig, ideal))
    runs = figure_runs(rig, say)
    content = ControllersPage(
        bundle.rig.name, tables, perfect, runs, stabilities(rig, runs), flow_study(rig, say)
    )
    write_controllers_page(page, content)
    say(f"written: {page}")


if __name__ == "__main__":
    main()
