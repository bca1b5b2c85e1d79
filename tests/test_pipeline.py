"""`sysid run`: stages, resuming, staleness, and what an interruption leaves behind."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sysid.bundle import read_bundle
from sysid.bundled import bundled_campaign
from sysid.cli import main
from sysid.pipeline import EXPORTS, RunReport, run_campaign

STAGES = ("check", "fit", "validate", "report", "export")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the bundled campaign that a test may change, without its long PWM logs."""
    folder = tmp_path_factory.mktemp("campaign")
    shutil.copytree(bundled_campaign().parent, folder, dirs_exist_ok=True)
    path = folder / "campaign.toml"
    blocks = path.read_text().split("[[log]]")
    path.write_text("[[log]]".join(b for b in blocks if "valve-pwm" not in b))
    return path


@pytest.fixture(scope="module")
def first(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> RunReport:
    return run_campaign(campaign, tmp_path_factory.mktemp("results"))


def done(run: RunReport) -> list[str]:
    return [stage.name for stage in run.stages if stage.why is not None]


def test_a_first_run_does_every_stage(first: RunReport) -> None:
    assert tuple(done(first)) == STAGES
    assert first.report.stat().st_size < 6_000_000
    for name in EXPORTS.values():
        assert (first.folder / name).stat().st_size > 1000
    uses = {log["file"]: log["use"] for log in first.bundle["validation"]["logs"]}
    assert uses["motion_pwm_2.parquet"] == "holdout"
    assert uses["motion_pwm.parquet"] == "fit"


def test_held_out_logs_are_only_validated_on(first: RunReport) -> None:
    fitted = read_bundle(first.folder / "fitted.json")["provenance"]["logs"]
    assert {entry["use"] for entry in fitted} == {"fit"}
    held_out = [e for e in first.bundle["provenance"]["logs"] if e["use"] == "holdout"]
    assert len(held_out) == 3


def test_a_second_run_does_nothing(first: RunReport, campaign: Path) -> None:
    assert done(run_campaign(campaign, first.folder)) == []


def test_what_is_missing_is_made_again(first: RunReport, campaign: Path) -> None:
    (first.folder / EXPORTS["c"]).unlink()
    again = run_campaign(campaign, first.folder)
    assert done(again) == ["export"]
    assert "is missing" in (again.stages[-1].why or "")


def test_a_changed_log_makes_the_run_stale(
    first: RunReport, campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = campaign.parent / "motion_motor_2.csv"
    path.write_text("# a remark that changes nothing but the file\n" + path.read_text())
    assert main(["run", str(campaign), "-o", str(first.folder), "--json"]) == 0
    captured = capsys.readouterr()
    stages = json.loads(captured.out)["stages"]
    assert all("motion_motor_2.csv" in (stage["why"] or "") for stage in stages)
    assert "sysid: check: stale" in captured.err


def test_an_unusable_folder_is_one_line(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["run", str(campaign), "-o", str(tmp_path / "file" / "results")]) == 2
    assert "name another with -o" in capsys.readouterr().err


@pytest.mark.parametrize("seconds", [3.0, 7.0])
def test_a_killed_run_leaves_whole_files_and_is_finished_by_the_next(
    seconds: float, campaign: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "sysid", "run", str(campaign), "-o", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        time.sleep(seconds)
        run.send_signal(signal.SIGKILL)
    for path in tmp_path.rglob("*.json"):
        json.loads(path.read_text())
    finished = run_campaign(campaign, tmp_path)
    assert finished.report.read_text().rstrip().endswith("</html>")
    assert not list(tmp_path.rglob(".sysid-*"))
