"""The cases beside the project whose right answer `sysid check`, or a tank's fit, gives."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import shared_folder

from sysid.commands.app import main


@pytest.fixture
def cases() -> Path:
    return shared_folder("cases")


def test_a_pressure_alone_beside_a_tank(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(cases / "check_tank_log" / "d.csv")]) == 0
    out = capsys.readouterr().out
    first = out.splitlines()[0]
    assert "a tank's discharge" in first and "pump_volts" in first and "valve_a" in first
    assert "friction" not in out


@pytest.mark.parametrize(
    ("name", "c_dis"), [("tank_slow_sampling", 1e-8), ("tank_short_discharge", 2e-9)]
)
def test_a_tank_of_any_size_is_fitted(
    name: str, c_dis: float, cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = str(cases / name / "campaign.toml")
    assert main(["fit", campaign, "-o", str(tmp_path / "b.json"), "--json"]) == 0
    valve = json.loads(capsys.readouterr().out)["valves"]["a"]["discrete"]
    assert valve["c_dis"]["value"] == pytest.approx(c_dis, rel=2e-3)
    assert main(["check", campaign]) == 0
    assert capsys.readouterr().out.startswith("everything is identified\n")
