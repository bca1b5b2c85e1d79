"""What once was a fault (exit 1) in well-meant use: one clear line and exit 2."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.conversion import convert
from sysid.io.rig import read_toml

REFERENCE = Path(__file__).resolve().parent.parent / "datasets" / "thesis" / "reference_bundle.json"


def test_toml_that_is_nested_too_deeply(tmp_path: Path) -> None:
    file = tmp_path / "deep.toml"
    file.write_text("a = " + "[" * 2000 + "]" * 2000 + "\n")
    with pytest.raises(InputError, match="nested too deeply"):
        read_toml(file, "a rig file")


def test_a_line_beyond_the_readers_limit(tmp_path: Path) -> None:
    names = ",".join(f"c{i}" for i in range(300_000))
    (tmp_path / "wide.csv").write_text(f"{names}\n{'1,' * 299_999}1\n{'2,' * 299_999}2\n")
    with pytest.raises(InputError, match=r"wide\.csv: cannot be read as text"):
        convert(tmp_path / "wide.csv", tmp_path / "out.csv", maps=["time_s=c0:s"])


@pytest.mark.parametrize("name", ["log.xlsx", "log.mat", "log.tdms"])
def test_a_log_is_not_written_under_a_foreign_name(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,theta_rad\n0,0\n1,1\n")
    with pytest.raises(InputError, match=r"CSV or Parquet.*log\.csv"):
        convert(tmp_path / "a.csv", tmp_path / name)
    assert not (tmp_path / name).exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_standard_output() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "sysid", "effects"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.startswith("sysid: error: standard output: ")
    assert len(done.stderr.splitlines()) == 1


def test_a_closed_standard_output() -> None:
    done = subprocess.run(
        ["sh", "-c", '"$0" -m sysid effects >&-', sys.executable],
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("key", ["c_fill", "c_dis", "choked_flow_fill_kg_s"])
def test_a_flow_below_zero(key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = json.loads(REFERENCE.read_text())
    content["valves"]["a"]["discrete"][key]["value"] *= -1.0
    file = tmp_path / "b.json"
    file.write_text(json.dumps(content))
    assert main(["export", str(file), "--format", "c", "-o", str(tmp_path / "b.h")]) == 2
    assert f"valves.a.discrete: {key} is -" in capsys.readouterr().err
