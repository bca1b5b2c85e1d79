"""Several processes: bounded in number, and none outlives its parent."""

from __future__ import annotations

import multiprocessing
import os
import platform
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import pytest

from sysid.commands.app import main
from sysid.errors import Failure, InputError
from sysid.parallel import LATE, VARIABLE, attempt_all, job_count, limited, processes, run_all

PARENT = """
import os, signal, sys, time
from functools import partial
# Whoever runs the tests in the background has SIGINT ignored, and children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {folder!r})
from test_parallel import told_and_slept
from sysid.parallel import run_all
run_all(partial(told_and_slept, {told!r}) for _ in range(2))
"""


def told_and_slept(folder: str) -> None:
    """Leave one's process number in a folder, and keep busy."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60.0)


def process_number(_: int) -> int:
    time.sleep(0.2)
    return os.getpid()


def test_one_job_is_this_process_and_two_are_others(monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = [partial(process_number, i) for i in range(4)]
    monkeypatch.setenv(VARIABLE, "1")
    assert run_all(jobs) == [os.getpid()] * 4
    monkeypatch.setenv(VARIABLE, "2")
    others = set(run_all(jobs))
    assert os.getpid() not in others and len(others) == 2


def asleep(_: int) -> None:
    time.sleep(60.0)


def endless(_: int) -> None:
    """A job that computes and does not look at its limit, in a worker that is soon ended."""
    processes._GRACE_S = 0.5
    while True:
        pass


def dead(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refused() -> None:
    raise ImportError("no module of that name here")


class Unreadable:
    """A job that cannot be read where it is to run."""

    def __call__(self) -> int:
        return 0

    def __reduce__(self) -> Any:
        return refused, ()


def doubled(number: int) -> int:
    return 2 * number


DOUBLED = [partial(doubled, i) for i in range(5)]


def test_the_first_job_hangs_and_the_later_ones_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    attempt_all(DOUBLED)  # workers take their time to start
    with limited(seconds=1.0):
        hung, *others = attempt_all([partial(endless, 0), *DOUBLED])
    assert hung == LATE
    assert others == [0, 2, 4, 6, 8]


def test_no_process_is_started_once_the_budget_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    begin = time.monotonic()
    with limited(evaluations=0):
        found = attempt_all([partial(asleep, 0)] * 3)
    assert found == [LATE] * 3
    assert time.monotonic() - begin < 1.0


@pytest.mark.parametrize("culprit", [partial(dead, 0), Unreadable()], ids=["dies", "unreadable"])
@pytest.mark.parametrize("place", [0, 3])
def test_a_worker_that_dies_takes_no_other_job_along(
    place: int, culprit: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    jobs: list[Any] = [*DOUBLED[:place], culprit, *DOUBLED[place:]]
    found = attempt_all(jobs)
    failed = found.pop(place)
    assert isinstance(failed, Failure) and failed.reason and not failed.out_of_budget
    assert found == [0, 2, 4, 6, 8]
    assert attempt_all(DOUBLED) == found


def test_a_pool_of_the_users_own_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        number = pool.apply(process_number, (0,))
        with limited(seconds=0.5):
            found = attempt_all([partial(endless, 0)] * 2)
        assert found == [LATE] * 2
        assert pool.apply_async(process_number, (0,)).get(30.0) == number


def test_without_a_number_of_jobs_every_core_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert job_count() == joblib.cpu_count()


@pytest.mark.parametrize("text", ["0", "-1", "two", "1e3", "9" * 30])
def test_a_bad_number_of_jobs_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, text)
    with pytest.raises(InputError, match="SYSID_JOBS"):
        job_count()


def test_the_command_line_bounds_every_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLE, "7")
    assert main(["effects", "--jobs", "3"]) == 0
    assert job_count() == 3
    assert main(["--jobs=none", "effects"]) == 2
    assert "--jobs: 'none' is not a number of processes" in capsys.readouterr().err
    assert main(["effects", "--jobs"]) == 2


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_their_parent(how: signal.Signals, tmp_path: Path) -> None:
    """And let go of its output: whoever reads it comes to an end."""
    told = tmp_path / "told"
    told.mkdir()
    script = PARENT.format(folder=str(Path(__file__).parent), told=str(told))
    parent = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, VARIABLE: "2"},
    )
    deadline = time.monotonic() + 60.0
    while len(list(told.iterdir())) < 2 and time.monotonic() < deadline:
        time.sleep(0.1)
    workers = [int(file.name) for file in told.iterdir()]
    with parent:
        try:
            assert len(workers) == 2
            parent.send_signal(how)
            parent.communicate(timeout=30.0)
        finally:
            parent.kill()
    deadline = time.monotonic() + 10.0
    while any(map(is_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(is_alive, workers))


def is_alive(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{number}/stat")
    return not (stat.exists() and stat.read_text().rsplit(")", 1)[1].split()[0] == "Z")


# --- memory ----------------------------------------------------------------------------------

HEAPS = """\
import ctypes, sys, threading
from sysid.parallel import share_one_heap

share_one_heap()
# All alive at a time, as each takes a heap that another has left.
wait = threading.Barrier(4)
def work():
    kept = [bytes(50_000) for _ in range(100)]
    wait.wait()
threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads: thread.start()
for thread in threads: thread.join()
library = ctypes.CDLL(None)
library.fopen.restype = ctypes.c_void_p
file = ctypes.c_void_p(library.fopen(sys.argv[1].encode(), b"w"))
library.malloc_info(0, file)
library.fclose(file)
"""
FREED = """\
from sysid.parallel import give_back

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096

many = [bytes(50_000) for _ in range(2000)]
pin = bytes(50_000)
del many
before = resident()
give_back()
print((before - resident()) / 1e6)
"""
glibc = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")


@glibc
@pytest.mark.parametrize(("chosen", "heaps"), [({}, 1), ({"MALLOC_ARENA_MAX": "3"}, 3)])
def test_threads_share_one_heap_unless_the_user_has_chosen(
    chosen: dict[str, str], heaps: int, tmp_path: Path
) -> None:
    path = tmp_path / "heaps.xml"
    environment = {**os.environ, **chosen}
    subprocess.run([sys.executable, "-c", HEAPS, str(path)], env=environment, check=True)
    assert path.read_text().count("<heap nr=") == heaps


@glibc
def test_freed_memory_goes_back_to_the_system() -> None:
    done = subprocess.run([sys.executable, "-c", FREED], capture_output=True, text=True, check=True)
    assert float(done.stdout) > 50.0
