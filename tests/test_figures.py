"""The rows of figures: whole, of a subject that is shown, and with commands that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.figures import SUBJECTS, FigureRow, of_subject, read, table

PROJECT = Path(__file__).resolve().parent.parent
ROWS = read()


def test_each_subject_has_rows_and_each_row_a_subject() -> None:
    assert {row.subject for row in ROWS} == set(SUBJECTS)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.figure[:40])
def test_a_row_is_whole(row: FigureRow) -> None:
    assert row.figure and row.measured and row.machine and row.command
    assert re.fullmatch(r"[0-9a-f]{7}", row.commit)
    assert len(row.measured) <= 330 and len(row.note) <= 330
    assert row.reached is None or row.asked


@pytest.mark.parametrize("command", sorted({row.command for row in ROWS}))
def test_what_a_command_runs_is_there(command: str) -> None:
    for path in re.findall(r"\b((?:benchmarks|tests)/[\w/]+\.py)\b", command):
        assert (PROJECT / path).is_file()
    for module in re.findall(r"-m ((?:benchmarks|datasets)[\w.]+)", command):
        path = PROJECT / module.replace(".", "/")
        assert path.is_dir() or path.with_suffix(".py").is_file()


def test_what_is_missed_comes_first() -> None:
    own = of_subject(ROWS, "controllers")
    missed = [row.reached is False for row in own]
    assert any(missed) and missed == sorted(missed, reverse=True)
    assert table(own).splitlines()[2].startswith("| **missed** |")
