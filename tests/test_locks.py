"""One command at a time in a folder of results, with real processes."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io import locks
from sysid.io.files import inputs_kept, note_input, write_atomic
from sysid.io.locks import LOCK_FILE, FolderInUseError, Holder, clear_left, working_in
from sysid.pipeline.fleet import run_one
from sysid.pipeline.run import run_campaign

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled"
HOLDS = """
import sys, time
from pathlib import Path
from sysid.io.locks import working_in
with working_in(Path(sys.argv[1])):
    print("ready", flush=True)
    time.sleep(60.0)
"""
READINGS = "time_s,velocity_rad_per_s,motor_torque_nm\n" + "".join(
    f"{i},{v},{0.2 * (1 if v > 0 else -1) + 0.05 * v + 0.001 * (i % 3)}\n"
    for i, v in enumerate([0.5, -0.5, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0])
)
IN_USE = r"another run has been working in this folder since .* \(process {} on .*\); wait until"


@contextlib.contextmanager
def listening() -> Iterator[None]:
    """Whoever runs the tests in the background has SIGINT ignored, and children inherit that."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def another(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that works in the folder."""
    words = [sys.executable, "-c", HOLDS, str(folder)]
    with listening():
        process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    with process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def campaign(folder: Path) -> Path:
    """A campaign of readings of friction, done in a few seconds."""
    folder.mkdir(parents=True)
    (folder / "rig.toml").write_text('[rig]\nname = "arm"\norientation = "horizontal"\n')
    (folder / "readings.csv").write_text(READINGS)
    log = '[[log]]\nkind = "friction-points"\nfile = "readings.csv"\n'
    (folder / "campaign.toml").write_text(f'rig = "rig.toml"\n{log}')
    return folder / "campaign.toml"


def left_by(folder: Path, holder: Holder, silent_s: float = 0.0) -> None:
    """The file of a process that works in the folder, last touched so long ago."""
    folder.mkdir(exist_ok=True)
    path = folder / LOCK_FILE
    path.write_text(json.dumps(asdict(holder)))
    then = time.time() - silent_s
    os.utime(path, (then, then))


def is_taken(folder: Path) -> bool:
    """Whether another command would be let into the folder."""
    try:
        with working_in(folder):
            assert Holder.of((folder / LOCK_FILE).read_text()) is not None
    except FolderInUseError:
        return True
    assert list(folder.iterdir()) == []
    return False


def test_the_other_one_is_named(tmp_path: Path) -> None:
    with another(tmp_path / "out") as process:
        with (
            pytest.raises(FolderInUseError, match=IN_USE.format(process.pid)) as caught,
            working_in(tmp_path / "out"),
        ):
            raise AssertionError
        assert re.search(r"since \d\d:\d\d \(", str(caught.value))
        assert "\n" not in str(caught.value) and caught.value.exit_code == 2
        with working_in(tmp_path / "else"):
            pass
    assert list((tmp_path / "else").iterdir()) == []


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_releases_the_folder(tmp_path: Path, how: signal.Signals) -> None:
    with another(tmp_path) as process:
        process.send_signal(how)
        assert process.wait(20) != 0
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_has_left_is_taken_over(tmp_path: Path) -> None:
    with another(tmp_path) as process:
        process.send_signal(signal.SIGKILL)
        deadline = time.monotonic() + 10.0
        while is_taken(tmp_path) and time.monotonic() < deadline:  # a zombie works no more
            time.sleep(0.05)
        assert not is_taken(tmp_path)


def test_within_a_block_the_same_thread_is_let_in(tmp_path: Path) -> None:
    with working_in(tmp_path):
        with working_in(tmp_path / "." / "x" / ".."):
            assert (tmp_path / LOCK_FILE).exists()
        assert (tmp_path / LOCK_FILE).exists()
        found: list[bool] = []
        thread = threading.Thread(target=lambda: found.append(is_taken(tmp_path)))
        thread.start()
        thread.join()
        assert found == [True]


def test_of_the_same_machine_the_process_decides(tmp_path: Path) -> None:
    """However long ago it touched its file: it may have been suspended."""
    here = Holder.this()
    left_by(tmp_path, here, silent_s=1e6)
    assert is_taken(tmp_path)
    for gone in (replace(here, began="1"), replace(here, pid=2**22 + 1)):
        left_by(tmp_path, gone)  # the number is another process' now; there is none of it
        assert not is_taken(tmp_path)
    left_by(tmp_path, replace(here, boot="an earlier start", machine=here.machine))
    assert is_taken(tmp_path) == (not here.machine)


def test_of_another_machine_the_age_decides(tmp_path: Path) -> None:
    here = Holder.this()
    for other in (
        replace(here, host="elsewhere"),
        replace(here, machine="another"),  # of the same name
        replace(here, processes="pid:[1]"),  # a container
    ):
        left_by(tmp_path, replace(other, pid=2**22 + 1), silent_s=60.0)
        assert is_taken(tmp_path)
        left_by(tmp_path, replace(other, pid=2**22 + 1), silent_s=3600.0)
        assert not is_taken(tmp_path)


def test_a_file_that_is_not_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process is about to write it, unless it was killed then."""
    monkeypatch.setattr(locks, "_WAIT_S", 0.001)
    for content in ("", "{", "[]", '{"pid": 1}', "\0\xff"):
        (tmp_path / LOCK_FILE).write_text(content)
        with (
            pytest.raises(FolderInUseError, match="another run has been working in this folder;"),
            working_in(tmp_path),
        ):
            raise AssertionError
        os.utime(tmp_path / LOCK_FILE, (0.0, 0.0))
        assert not is_taken(tmp_path)


def test_one_of_many_takes_over(tmp_path: Path) -> None:
    left_by(tmp_path, replace(Holder.this(), pid=2**22 + 1))
    begin, got, refused = threading.Barrier(16), [], []

    def take() -> None:
        begin.wait()
        try:
            with working_in(tmp_path):
                got.append(threading.get_ident())
                last.wait()
        except FolderInUseError:
            refused.append(threading.get_ident())

    last = threading.Event()
    threads = [threading.Thread(target=take) for _ in range(16)]
    for thread in threads:
        thread.start()
    deadline = time.monotonic() + 20.0
    while len(got) + len(refused) < 16 and time.monotonic() < deadline:
        time.sleep(0.01)
    last.set()
    for thread in threads:
        thread.join()
    assert (len(got), len(refused)) == (1, 15)
    assert list(tmp_path.iterdir()) == []


def test_a_takeover_that_was_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "_WAIT_S", 0.001)
    left_by(tmp_path, replace(Holder.this(), pid=2**22 + 1))
    guard = tmp_path / ".sysid-lock-takeover"
    guard.touch()
    assert is_taken(tmp_path)
    os.utime(guard, (0.0, 0.0))
    assert not is_taken(tmp_path)


def test_the_file_is_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "_BEAT_S", 0.01)
    with working_in(tmp_path):
        path = tmp_path / LOCK_FILE
        os.utime(path, (0.0, 0.0))
        deadline = time.monotonic() + 10.0
        while path.stat().st_mtime == 0.0 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert path.stat().st_mtime > 0.0


def test_only_what_an_ended_process_left_is_cleared(tmp_path: Path) -> None:
    assert clear_left(tmp_path / "none") and clear_left(tmp_path)
    with another(tmp_path):
        assert not clear_left(tmp_path)
    left_by(tmp_path, replace(Holder.this(), pid=2**22 + 1))
    assert clear_left(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_only_be_read(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    try:
        with working_in(tmp_path):
            assert list(tmp_path.iterdir()) == []
    finally:
        tmp_path.chmod(0o755)


# --- commands ------------------------------------------------------------------------------


def sysid(*words: str | Path, jobs: int = 1) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "sysid", "--jobs", str(jobs), *map(str, words)]
    with listening():
        return subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )


def test_of_runs_at_the_same_time_one_works(tmp_path: Path) -> None:
    path, out = campaign(tmp_path / "arm"), tmp_path / "out"
    runs = [sysid("run", path, "-o", out, "--no-diagnose", "--no-refine") for _ in range(3)]
    said = {run.pid: run.communicate(timeout=240)[1] for run in runs}
    codes = [run.returncode for run in runs]
    assert set(codes) <= {0, 2} and 0 in codes
    for run in runs:
        if run.returncode == 2:
            (line,) = said[run.pid].splitlines()
            others = "|".join(str(other.pid) for other in runs if other is not run)
            assert re.search(IN_USE.format(f"({others})"), line)
    assert not list(out.glob(".sysid-*"))
    report = run_campaign(path, out, diagnose=False, refine=False)
    assert all(stage.outcome == "up to date" for stage in report.stages)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_fleet_releases_all_folders(tmp_path: Path, how: signal.Signals) -> None:
    """Its workers are killed in the midst of their campaigns."""
    paths = [campaign(tmp_path / day) for day in ("2025-01-10", "2025-02-11")]
    out = tmp_path / "out"
    with sysid("fleet", *paths, "-o", out, jobs=2) as fleet:
        deadline = time.monotonic() + 120.0
        # On a busy machine one may have ended before the other begins.
        while not list(out.glob("*/" + LOCK_FILE)) and time.monotonic() < deadline:
            time.sleep(0.01)
        fleet.send_signal(how)
        assert fleet.wait(60) == 128 + how
    assert list(out.iterdir())
    assert not list(out.rglob(".sysid-*"))


def test_commands_that_write_into_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = campaign(tmp_path / "arm")
    shutil.copytree(BUNDLED, tmp_path / "bundled")
    out = tmp_path / "out"
    loop = ["--controller", "pva", "--trajectory", "1", "--mode", "motor"]
    with another(out) as process:
        for words in (
            ["run", str(path)],
            ["fleet", str(path)],
            ["demo"],
            ["control", str(tmp_path / "b.json"), *loop],
        ):
            assert main([*words, "-o", str(out)]) == 2
            assert re.search(IN_USE.format(process.pid), capsys.readouterr().err), words
    assert [file.name for file in out.iterdir()] == [LOCK_FILE]  # it was killed


def test_a_campaign_of_a_fleet_that_is_at_work(tmp_path: Path) -> None:
    first, second = (campaign(tmp_path / day) for day in ("2025-01-10", "2025-02-11"))
    quick = {"diagnose": False, "refine": False}
    fine = run_one(first, tmp_path / "fleet", **quick)
    folder = tmp_path / "fleet" / fine.folder
    row = (folder / "row.json").read_text()
    with another(folder) as process:
        busy = run_one(first, tmp_path / "fleet", **quick)
        assert busy.exit_code == 2 and re.search(IN_USE.format(process.pid), busy.failure)
        assert run_one(second, tmp_path / "fleet", **quick).exit_code == 0
    assert (folder / "row.json").read_text() == row


# --- what is read and what is written ------------------------------------------------------


def test_a_result_may_take_the_number_of_a_file_that_is_gone(tmp_path: Path) -> None:
    """Another process replaces what was read; the result is a file with the old one's number."""
    read, result = tmp_path / "log.csv", tmp_path / "run.json"
    read.write_text("1")
    with inputs_kept():
        note_input(read)
        read.rename(result)  # what reuse of its number comes to
        read.write_text("2")
        write_atomic(result, "result")
        with pytest.raises(InputError, match="is what this command reads"):
            write_atomic(read, "result")
        link, hard = tmp_path / "link.csv", tmp_path / "hard.csv"
        link.symlink_to(read)
        hard.hardlink_to(read)
        for same in (link, hard, tmp_path / "x" / ".." / "log.csv"):
            (tmp_path / "x").mkdir(exist_ok=True)
            with pytest.raises(InputError, match="is what this command reads"):
                write_atomic(same, "result")
    assert (result.read_text(), read.read_text()) == ("result", "2")
