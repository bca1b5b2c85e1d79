"""The atmosphere added twice to a friction log's pressures: the first that is said, and no fit of
it is good; a chamber that stands under a regulator is none of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pandas as pd
import pytest
from friction_trials import UNWRITTEN

from sysid.commands.app import main
from sysid.friction import fit_friction
from sysid.io.bare_rig import read_bare_logs
from sysid.io.bundled import bundled_campaign
from sysid.io.logs import read_log
from sysid.io.rig import Rig, read_rig

BUNDLED = bundled_campaign().parent
ATMOSPHERE = 101325.0
KINDS = ("static", "sliding", "motion")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return read_rig(BUNDLED / "rig.toml")


def with_more(kind: str, folder: Path, chambers: str, push: float = 0.0) -> Path:
    """A friction log with the atmosphere added to these chambers' pressures, and to the effort."""
    frame = pd.read_parquet(BUNDLED / f"friction_{kind}.parquet")
    for side in chambers:
        frame[f"pressure_{side}_pa"] += ATMOSPHERE
    frame["motor_torque_nm"] += push
    path = folder / "log.parquet"
    frame.to_parquet(path)
    return path


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("chambers", ["ab", "a", "b"])
def test_it_is_the_first_line(kind: str, chambers: str, tmp_path: Path, rig: Rig) -> None:
    log = read_log(with_more(kind, tmp_path, chambers), rig)
    assert log.notices[0] == log.contradictions[0]
    assert "added twice" in log.notices[0] and "without (g)" in log.notices[0]
    for side in chambers:
        assert f"pressure_{side}_pa" in log.notices[0]
    found = fit_friction(log.trials, rig, kind=kind)
    assert not any(q.verdict.startswith("good") for q in found.quality.values())


@pytest.mark.parametrize("kind", KINDS)
def test_a_chamber_under_a_regulator_is_not(kind: str, tmp_path: Path, rig: Rig) -> None:
    """The motor then balances what the chamber pushes."""
    assert rig.cylinder is not None
    push = -ATMOSPHERE * rig.cylinder.area_a_m2 * rig.cylinder.pitch_radius_m
    path = with_more(kind, tmp_path, "a", push)
    strong = dataclasses.replace(rig, motor=None)
    assert read_log(path, strong).contradictions == ()


@pytest.mark.parametrize("chambers", ["", "a"])
def test_a_rig_file_that_declares_no_valves(chambers: str, tmp_path: Path) -> None:
    text = (BUNDLED / "rig.toml").read_text("utf-8")
    sections = text.split("\n[")
    kept = [s for s in sections if not s.startswith(("valves]", "pwm]"))]
    (tmp_path / "rig.toml").write_text("\n[".join(kept), "utf-8")
    without = read_rig(tmp_path / "rig.toml")
    assert without.valves is None
    log = read_log(with_more("sliding", tmp_path, chambers), without)
    assert len(log.contradictions) == len(chambers)


@pytest.mark.parametrize("chambers", ["ab", "a"])
def test_a_log_alone_shows_it(
    chambers: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], rig: Rig
) -> None:
    path = with_more("motion", tmp_path, chambers)
    bare = read_bare_logs([path], {})
    found = fit_friction(bare.logs[0].trials, bare.read_with, kind="motion")
    assert found.quality["friction-motion"].verdict.startswith("usable")
    assert main(["fit", "friction", str(path), *UNWRITTEN]) == 0
    first = next(n for n in capsys.readouterr().err.splitlines() if "notice" in n)
    assert "is that added twice?" in first


def test_logs_in_order_are_silent(rig: Rig) -> None:
    for kind in KINDS:
        path = BUNDLED / f"friction_{kind}.parquet"
        assert read_log(path, rig).contradictions == ()
        assert read_bare_logs([path], {}).logs[0].contradictions == ()
