"""The given cases of verdicts and causes (`../shared/cases`), where they are."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from conftest import SHARED
from friction_trials import UNWRITTEN

from sysid.commands.app import main

CASES = SHARED / "cases"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is absent")


def fitted(case: str, folder: Path) -> dict[str, object]:
    out = folder / "b.json"
    assert main(["fit", str(CASES / case / "campaign.toml"), "-o", str(out)]) == 0
    return dict(json.loads(out.read_text())["friction"])


def test_a_ripple_is_not_taken_for_presliding(tmp_path: Path) -> None:
    found = fitted("excluded_76_percent", tmp_path)
    low, high = found["coulomb_nm"]["interval"]  # type: ignore[index]
    assert low < 5.4 < high and high - low < 2.0
    assert found["motion_limits"]["left_out"] == 0.0  # type: ignore[index]
    assert found["quality"]["friction-motion"]["verdict"].startswith("usable")  # type: ignore[index]


def test_one_direction_is_not_after_a_reversal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = fitted("one_direction_not_diagnosed", tmp_path)
    assert "after a reversal" not in capsys.readouterr().err
    assert found["motion_limits"]["travel"] == 0.0  # type: ignore[index]
    assert found["combinations"][0]["value"] == pytest.approx(5.0, rel=0.02)  # type: ignore[index]
    assert found["quality"]["friction-motion"]["verdict"] != "good"  # type: ignore[index]


def test_two_levels_in_one_test(capsys: pytest.CaptureFixture[str]) -> None:
    logs = sorted(str(p) for p in (CASES / "two_levels_in_one_test").glob("*.csv"))
    assert main(["fit", "friction", *logs, *UNWRITTEN, "--json"]) == 0
    friction = json.loads(capsys.readouterr().out)["friction"]
    assert friction["coulomb_nm"]["value"] == pytest.approx(0.025, rel=0.05)
    assert friction["viscous_nm_s_per_rad"]["value"] == pytest.approx(1.1e-4, rel=0.05)


def test_a_reversed_sign_comes_first(capsys: pytest.CaptureFixture[str]) -> None:
    log = str(CASES / "reversed_sign_message" / "reversed.csv")
    assert main(["fit", "friction", log, *UNWRITTEN]) == 3
    error = capsys.readouterr().err
    assert "error: friction: the sign of motor_force_n or of position_m is reversed" in error
    found = re.search(r'--map "([^"]+)"', error)
    assert found is not None
    assert main(["fit", "friction", log, *UNWRITTEN, "--map", found[1]]) == 0
