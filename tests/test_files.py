"""Files are written whole or not at all."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.files import open_atomic, remove_leftovers, write_atomic

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled"


def leftovers(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.name.startswith(".sysid-"))


def test_text_and_bytes(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a.txt", "tau_cf = 0.2081 ±\n")
    write_atomic(tmp_path / "b.bin", b"\x00\r\n")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "tau_cf = 0.2081 ±\n"
    assert (tmp_path / "b.bin").read_bytes() == b"\x00\r\n"
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_what_stood_there_survives_a_failure(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "bundle.json"
    path.write_text("old")
    with pytest.raises(error), open_atomic(path) as file:
        file.write(b"half")
        raise error
    assert path.read_text() == "old"
    assert leftovers(tmp_path) == []


def test_termination_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("old")
    code = (
        "import sys, time; from pathlib import Path; from sysid.io.files import open_atomic\n"
        "with open_atomic(Path(sys.argv[1])) as file:\n"
        "    file.write(b'half'); file.flush(); print('ready', flush=True); time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        assert path.read_text() == "old"
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 128 + signal.SIGTERM
    assert path.read_text() == "old"
    assert leftovers(tmp_path) == []


def test_mode_and_links_are_kept(tmp_path: Path) -> None:
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    write_atomic(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    write_atomic(tmp_path / "fresh", "x")
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE((tmp_path / "fresh").stat().st_mode) == 0o666 & ~mask


def test_a_pipe_is_written_directly(tmp_path: Path) -> None:
    read, write = os.pipe()
    write_atomic(Path(f"/dev/fd/{write}"), "through")
    os.close(write)
    assert os.read(read, 100) == b"through"
    os.close(read)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("missing/log.csv", "its folder .* does not exist"),
        ("folder", "is a directory"),
        ("file/log.csv", "is not a folder"),
        ("x" * 400, "cannot be written: File name too long"),
        ("nul\0", "cannot be written"),
    ],
)
def test_places_that_cannot_be_written(tmp_path: Path, name: str, what: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=what) as caught:
        write_atomic(tmp_path / name, "x")
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.parametrize("which", ["file", "folder"])
def test_no_permission(tmp_path: Path, which: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    path = folder / "log.csv"
    path.write_text("old")
    (path if which == "file" else folder).chmod(0o555 if which == "folder" else 0o444)
    try:
        with pytest.raises(InputError, match="may not be written"):
            write_atomic(path, "new")
    finally:
        folder.chmod(0o755)
    assert path.read_text() == "old"


def test_a_killed_process_leaves_no_half_written_file(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    code = (
        "import os, signal, sys; from pathlib import Path; from sysid.io.files import open_atomic\n"
        "with open_atomic(Path(sys.argv[1])) as file:\n"
        "    file.write(b'half'); file.flush(); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    remove_leftovers(tmp_path)
    assert list(tmp_path.iterdir()) == []
    write_atomic(path, "whole")
    assert path.read_text() == "whole"


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    """A folder with a rig file, a log, a campaign and a bundle of it."""
    for name in ("friction_sliding.parquet", "rig.toml"):
        shutil.copy(BUNDLED / name, tmp_path / name)
    log = '[[log]]\nkind = "friction-sliding"\nfile = "friction_sliding.parquet"\n'
    (tmp_path / "campaign.toml").write_text(f'rig = "rig.toml"\n{log}')
    assert main(["fit", str(tmp_path / "campaign.toml"), "-o", str(tmp_path / "b.json")]) == 0
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        "fit friction friction_sliding.parquet -o friction_sliding.parquet",
        "fit friction friction_sliding.parquet -o rig.toml",
        "fit campaign.toml -o campaign.toml",
        "export b.json --format c -o b.json",
    ],
)
def test_a_result_does_not_replace_what_the_command_reads(
    inputs: Path,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(inputs)
    before = {path.name: path.read_bytes() for path in inputs.iterdir()}
    capsys.readouterr()
    assert main(words.split()) == 2
    assert "give another path" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in inputs.iterdir()} == before


def test_a_bundle_may_be_fitted_into(inputs: Path) -> None:
    into = [str(inputs / "campaign.toml"), "-o", str(inputs / "b.json")]
    assert main(["fit", *into]) == 0
    assert main(["fit", *into]) == 0
