"""What programs export, by one `sysid convert` line each, and with one damage (the benchmark's)."""

from __future__ import annotations

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.export_styles import judged, read, try_damage, try_style
from benchmarks.exports import STYLES, Style
from benchmarks.exports.record import Truth, draw_truth

_READ = ("exact", "ok")
# Of the damages that one run draws.
_SEED = 11


@pytest.fixture(scope="module")
def truth() -> Truth:
    return draw_truth(5)


def test_sixty_styles_or_more_each_of_its_own_name() -> None:
    names = [style.name for style in STYLES]
    assert len(names) == len(set(names)) >= 60


@pytest.mark.parametrize("style", STYLES, ids=lambda style: style.name)
def test_a_style_is_read_to_its_last_digit(style: Style, truth: Truth, tmp_path: Path) -> None:
    verdict, reading = try_style(style, truth, tmp_path)
    assert verdict.kind in _READ, (style.words(style.file, "log.csv"), verdict.text)
    draw = random.Random(f"{_SEED} {style.name}")
    damage, found = try_damage(style, truth, tmp_path, draw, reading.said)
    assert found.kind not in ("silent", "fault"), (damage.kind, found.text)


def test_a_digit_that_is_lost_is_seen(truth: Truth, tmp_path: Path) -> None:
    """The comparison itself: one unit of the last digit in one cell is wrong."""
    style = next(s for s in STYLES if s.name == "ulog2csv")
    sheet = style.export(tmp_path / style.file, truth)
    assert sheet is not None
    place = sheet.places["pressure_a_pa"]
    cell = sheet.body[100][place]
    sheet.body[100][place] = cell[:-1] + str((int(cell[-1]) + 1) % 10)
    (tmp_path / style.file).write_bytes(sheet.bytes())
    reading = read(style, tmp_path / style.file, tmp_path / "log.csv")
    verdict = judged(style, truth, reading, range(truth.rows))
    assert verdict.kind == "wrong"
    assert "pressure_a_pa, row 101" in verdict.text
