"""`docs/slips.md` lists every slip that the benchmark makes, where it says it is caught."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(PROJECT))

from benchmarks.slip_catalogue import KINDS, NOTHING, RIG_SLIPS, TWO, Kind  # noqa: E402
from sysid.checks.consistency import campaign as consistency  # noqa: E402
from sysid.io.rig import rig_from_content  # noqa: E402

PAGE = (PROJECT / "docs" / "slips.md").read_text("utf-8")
SECTIONS = dict(re.findall(r"(?ms)^## (.+?)$(.*?)(?=^## |\Z)", PAGE))


def rows(section: str) -> dict[str, list[str]]:
    """Cells of each row of a section's table, by the first."""
    lines = [line for line in SECTIONS[section].splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]
    return {row[0].strip(): row[1:] for row in cells}


def section_of(kind: Kind) -> str:
    if kind.shown == NOTHING:
        return "What no log can show"
    return "Only two logs together" if kind.shown == TWO else "In one log"


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_slip_of_the_benchmark_is_listed(kind: Kind) -> None:
    listed = rows(section_of(kind))
    assert kind.name in listed
    if kind.shown != NOTHING:
        assert listed[kind.name][0] == kind.group


def test_the_tables_hold_no_other_slips() -> None:
    named = {kind.name for kind in KINDS if kind.shown != NOTHING}
    assert set(rows("In one log")) | set(rows("Only two logs together")) == named
    assert set(rows("In the rig file")) == set(RIG_SLIPS)


def test_the_factors_of_the_page_are_those_of_the_code() -> None:
    rig = rig_from_content({"rig": {"name": "any", "orientation": "horizontal"}}, "any")
    wanted = {q.name: q.large for q in consistency.quantities(rig)}
    text = " ".join(PAGE.split())
    assert wanted["the inertia that is moved"] == wanted["Coulomb friction"] == 1.6
    assert "1.6 for the inertia and Coulomb friction" in text
    assert f"{wanted['viscous friction']:g} for viscous friction" in text
    flows = {large for name, large in wanted.items() if "flow" in name}
    pressures = {large for name, large in wanted.items() if "pressure" in name}
    assert flows == {1.4} and "1.4 for flows" in text
    assert pressures == {1.15} and "1.15 for pressures" in text


def test_the_readme_points_to_the_page() -> None:
    assert "docs/slips.md" in (PROJECT / "README.md").read_text("utf-8")
