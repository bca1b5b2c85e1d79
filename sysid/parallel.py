"""One door to several processes or threads: how many, and for how long, and that no process
outlives its parent.

`SYSID_JOBS` (the command line's `--jobs`) bounds the processes; 1 means none but one's own, and
without it there is one to each core.
"""

from __future__ import annotations

import math
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Generic, ParamSpec, TypeVar

from sysid.errors import input_error, one_line

Given = ParamSpec("Given")
Result = TypeVar("Result")

VARIABLE = "SYSID_JOBS"
_WATCH_S = 1.0
_MOST = 4096
# How long a worker may take to notice that its time is over, s.
_GRACE_S = 3.0


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


class OutOfTimeError(Exception):
    """The time for a computation (`time_limit`) has run out."""


@dataclass(frozen=True)
class Failure:
    """A job that came to no result: why, in a line, and whether only for want of time."""

    reason: str
    out_of_time: bool = False


@dataclass
class _Limit:
    """When the computations of a context have to end, on the clock of `time.monotonic`."""

    deadline: float = math.inf
    is_stopped: bool = False


_LIMIT: ContextVar[_Limit] = ContextVar("limit", default=_Limit())  # noqa: B039 - never changed


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """`check_time` raises once so many seconds have passed; None: never."""
    deadline = math.inf if seconds is None else time.monotonic() + seconds
    token = _LIMIT.set(_Limit(deadline))
    try:
        yield
    finally:
        _LIMIT.reset(token)


def check_time() -> None:
    """To be called within long loops. Raises OutOfTimeError."""
    limit = _LIMIT.get()
    if limit.is_stopped or time.monotonic() > limit.deadline:
        raise OutOfTimeError


def attempt(job: Callable[[], Result]) -> Result | Failure:
    """The result of a job, or why there is none; with `SYSID_DEBUG` errors are raised."""
    try:
        check_time()
        return job()
    except OutOfTimeError:
        return Failure("out of time", out_of_time=True)
    except Exception as error:
        if os.environ.get("SYSID_DEBUG"):
            raise
        return Failure(one_line(f"{type(error).__name__}: {error}"))


def attempt_all(jobs: Iterable[Callable[[], Result]]) -> list[Result | Failure]:
    """`run_all`, with a `Failure` for each job that raises or has not ended in time.

    A worker that does not look at the time itself is killed soon after the limit.
    """
    deadline = _LIMIT.get().deadline
    waiting = [partial(_within, job, deadline) for job in jobs]
    left = None if math.isinf(deadline) else max(deadline - time.monotonic(), 0.0) + _GRACE_S
    done: list[Result | Failure] = []
    try:
        for result in _in_processes(waiting, left):
            done.append(result)
    except TimeoutError:
        rest = Failure("out of time: its process was ended", out_of_time=True)
    except Exception as error:  # a worker that died, for want of memory perhaps
        if os.environ.get("SYSID_DEBUG"):
            raise
        rest = Failure(one_line(f"{type(error).__name__}: {error}"))
    else:
        return done
    return done + [rest] * (len(waiting) - len(done))


def _within(job: Callable[[], Result], deadline: float) -> Result | Failure:
    """`attempt` in another process: its clock is this one's."""
    token = _LIMIT.set(_Limit(deadline))
    try:
        return attempt(job)
    finally:
        _LIMIT.reset(token)


def run_all(jobs: Iterable[Callable[[], Result]]) -> list[Result]:
    """The results of `jobs`, in order; each is picklable and runs in some process.

    Raises what a job raises. Within a worker the jobs run one after the other.
    """
    return list(_in_processes(list(jobs), None))


def _in_processes(
    waiting: Sequence[Callable[[], Result]], timeout: float | None
) -> Iterator[Result]:
    """Each result in turn. Raises TimeoutError, the workers killed, where one takes longer."""
    workers = min(job_count(), len(waiting))
    if workers <= 1:
        yield from (job() for job in waiting)
        return
    import multiprocessing

    from joblib import Parallel, delayed, parallel_config

    config = parallel_config(
        backend="loky", n_jobs=workers, initializer=_serve, initargs=(os.getpid(),)
    )
    try:
        with config:
            how = "list" if timeout is None else "generator"
            work = Parallel(return_as=how, timeout=timeout)
            yield from work(delayed(_call)(job) for job in waiting)
    except (KeyboardInterrupt, multiprocessing.TimeoutError) as error:
        # Python waits at its end for the workers that joblib, interrupted, has not yet stopped.
        for worker in multiprocessing.active_children():
            worker.kill()
        if isinstance(error, KeyboardInterrupt):
            raise
        raise TimeoutError from error


def attempt_in_threads(jobs: Iterable[Callable[[], Result]]) -> list[Result | Failure]:
    """`attempt` of each job, in order, in threads of this process: nothing is copied.

    For jobs that spend their time in numpy on long arrays, which lets other threads run, and
    that call `check_time`: a thread cannot be killed.
    """
    from concurrent.futures import ThreadPoolExecutor

    waiting = list(jobs)
    workers = min(job_count(), len(waiting))
    if workers <= 1:
        return [attempt(job) for job in waiting]
    own = _Limit(_LIMIT.get().deadline)
    token = _LIMIT.set(own)
    contexts = [copy_context() for _ in waiting]
    _LIMIT.reset(token)
    with ThreadPoolExecutor(workers) as pool:
        try:
            pairs = zip(contexts, waiting, strict=True)
            futures = [pool.submit(context.run, attempt, job) for context, job in pairs]
            return [future.result() for future in futures]
        except BaseException:
            own.is_stopped = True
            raise


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
    "Failure",
    "OutOfTimeError",
    "PerThread",
    "attempt",
    "attempt_all",
    "attempt_in_threads",
    "check_jobs",
    "check_time",
    "job_count",
    "kept_per_thread",
    "run_all",
    "time_limit",
]
