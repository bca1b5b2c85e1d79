"""The history of figures: lines that are added, and a slowdown that shows."""

from __future__ import annotations

from pathlib import Path

from benchmarks.history import HISTORY, read, record, shown


def test_a_slowdown_shows(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    for value in (1.0, 1.1, 0.9):
        record("startup", value, "s", path)
    record("memory", 2.0, "GB", path)
    found = read(path)
    assert [entry["value"] for entry in found["startup"]] == [1.0, 1.1, 0.9]
    assert "median of 2 before: 1.05)" in shown("startup", found["startup"])
    assert shown("memory", found["memory"]).endswith("the first)")
    record("startup", 1.3, "s", path)
    assert "more than before" in shown("startup", read(path)["startup"])


def test_the_history_of_this_repository_can_be_read() -> None:
    for figure, entries in read(HISTORY).items():
        assert all(entry["unit"] and entry["date"] for entry in entries)
        assert figure in shown(figure, entries)
