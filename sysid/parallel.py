"""One door to several processes or threads: how many, and that no process outlives its parent.

`SYSID_JOBS` (the command line's `--jobs`) bounds the processes; 1 means none but one's own, and
without it there is one to each core.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Generic, ParamSpec, TypeVar

from sysid.errors import input_error

Given = ParamSpec("Given")
Result = TypeVar("Result")

VARIABLE = "SYSID_JOBS"
_WATCH_S = 1.0
_MOST = 4096


def job_count() -> int:
    """How many processes may work at a time, 1 or more. Raises InputError for a bad variable."""
    text = check_jobs(VARIABLE)
    if text:
        return int(text)
    import joblib

    return int(joblib.cpu_count())


def check_jobs(where: str) -> str:
    """The text of `SYSID_JOBS`, empty without one; InputError, naming `where`, for a bad one."""
    text = os.environ.get(VARIABLE, "").strip()
    if text and not (text.isdecimal() and 1 <= int(text) <= _MOST):
        raise input_error(where, f"{text[:20]!r} is no number of processes", "give 1 or more")
    return text


def run_all(jobs: Iterable[Callable[[], Result]]) -> list[Result]:
    """The results of `jobs`, in order; each is picklable and runs in some process.

    Raises what a job raises. Within a worker the jobs run one after the other.
    """
    waiting = list(jobs)
    workers = min(job_count(), len(waiting))
    if workers <= 1:
        return [job() for job in waiting]
    from joblib import Parallel, delayed, parallel_config

    config = parallel_config(
        backend="loky", n_jobs=workers, initializer=_serve, initargs=(os.getpid(),)
    )
    try:
        with config:
            return list(Parallel()(delayed(_call)(job) for job in waiting))
    except KeyboardInterrupt:
        import multiprocessing

        # Python waits at its end for the workers that joblib, interrupted, has not yet stopped.
        for worker in multiprocessing.active_children():
            worker.kill()
        raise


def run_in_threads(jobs: Iterable[Callable[[], Result]]) -> list[Result]:
    """The results of `jobs`, in order, from threads of this process: nothing is copied.

    For jobs that spend their time in numpy on long arrays, which lets other threads run.
    Raises what a job raises.
    """
    from concurrent.futures import ThreadPoolExecutor

    waiting = list(jobs)
    workers = min(job_count(), len(waiting))
    if workers <= 1:
        return [job() for job in waiting]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(_call, waiting))


class PerThread(Generic[Given, Result]):
    """A function whose last `size` results are kept, in each thread its own.

    So no thread drops what another works with, and with a thread go its results.
    """

    def __init__(self, function: Callable[Given, Result], size: int) -> None:
        self._function, self._size, self._own = function, size, threading.local()
        self.__doc__ = function.__doc__

    def __call__(self, *values: Given.args, **named: Given.kwargs) -> Result:
        kept = getattr(self._own, "kept", None)
        if kept is None:
            kept = self._own.kept = lru_cache(maxsize=self._size)(self._function)
        result: Result = kept(*values, **named)  # type: ignore[arg-type]
        return result

    def forget(self) -> None:
        """Drop this thread's results."""
        self._own.__dict__.clear()


def kept_per_thread(
    size: int,
) -> Callable[[Callable[Given, Result]], PerThread[Given, Result]]:
    """A decorator that makes a function a `PerThread`."""
    return lambda function: PerThread(function, size)


def _call(job: Callable[[], Result]) -> Result:
    return job()


def _serve(parent: int) -> None:
    """A worker leaves Ctrl-C to its parent, and ends when that has ended, however it did."""
    os.environ[VARIABLE] = "1"
    if not os.environ.get("SYSID_DEBUG"):
        warnings.simplefilter("ignore")  # they would stand beside the parent's one line
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)


__all__ = [
    "VARIABLE",
    "PerThread",
    "check_jobs",
    "job_count",
    "kept_per_thread",
    "run_all",
    "run_in_threads",
]
