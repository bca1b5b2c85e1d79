"""Jobs in several processes: how many, for how long, and that none outlives its parent."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TypeVar

from sysid.errors import input_error
from sysid.parallel.cluster import cluster_in_force, collect_on
from sysid.parallel.limits import Failure, Limit, attempt, limit_in_force, within
from sysid.parallel.memory import share_one_heap

Result = TypeVar("Result")

VARIABLE = "SYSID_JOBS"
_WATCH_S = 1.0
_MOST = 4096
# How long a worker may take to notice that its time is over, s.
_GRACE_S = 3.0
_LATE = Failure("out of time: its process was ended", out_of_time=True)


def job_count() -> int:
    """How many processes may work at a time, 1 or more. Raises InputError for a bad variable."""
    cluster = cluster_in_force()
    if cluster is not None:
        return max(cluster.workers(), 1)  # none while one that died is replaced
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
    waiting = dict(enumerate(jobs))
    workers = min(job_count(), len(waiting))
    if workers <= 1 and cluster_in_force() is None:
        return [job() for job in waiting.values()]
    found: dict[int, Result] = {}
    _collect(found, waiting, workers)
    return [found[number] for number in waiting]


def attempt_all(jobs: Iterable[Callable[[], Result]]) -> list[Result | Failure]:
    """`run_all`, with a `Failure` for each job that raises or has not ended in time.

    A worker that does not look at the time itself is killed soon after the limit. Where one
    dies, what was not done is tried again, each job with a process to itself.
    """
    deadline = limit_in_force().deadline
    on_cluster = cluster_in_force() is not None  # sets the limit itself: clocks differ there
    waiting = {
        i: partial(attempt, job) if on_cluster else partial(_attempt_by, job, deadline)
        for i, job in enumerate(jobs)
    }
    workers = min(job_count(), len(waiting))
    none_other = workers <= 1 and not on_cluster
    if none_other or time.monotonic() > deadline:  # none is begun then, and no process started
        return [job() for job in waiting.values()]
    found: dict[int, Result | Failure] = {}
    why = _collected(found, waiting, workers, deadline)
    for number in [n for n in waiting if n not in found]:
        if not why.out_of_time:
            why = _collected(found, {number: waiting[number]}, 2, deadline)
        found.setdefault(number, why)
    return [found[number] for number in waiting]


def _attempt_by(job: Callable[[], Result], deadline: float) -> Result | Failure:
    """`attempt` in another process: its clock is this one's."""
    with within(Limit(deadline)):
        return attempt(job)


def _collected(
    found: dict[int, Result | Failure],
    waiting: Mapping[int, Callable[[], Result | Failure]],
    workers: int,
    deadline: float,
) -> Failure:
    """`_collect`; why jobs came to no result, if some did."""
    try:
        _collect(found, waiting, workers, deadline + _GRACE_S)
    except TimeoutError:
        return _LATE
    except Exception as error:  # a worker that died, for want of memory perhaps
        if os.environ.get("SYSID_DEBUG"):
            raise
        return Failure.of(error)
    return Failure("no result")


def _collect(
    found: dict[int, Result],
    waiting: Mapping[int, Callable[[], Result]],
    workers: int,
    deadline: float = math.inf,
) -> None:
    """Put each job's result into `found`, by its number, as it comes.

    Raises TimeoutError, the workers killed, where jobs have not ended by the deadline, and
    what a job raises. joblib kills its workers itself, those of other pools are left alone.
    On a cluster the scheduler does all that.
    """
    cluster = cluster_in_force()
    if cluster is not None:
        collect_on(cluster, found, waiting, deadline)
        return
    import multiprocessing

    from joblib import Parallel, delayed, parallel_config

    def left() -> float | None:
        return None if math.isinf(deadline) else max(deadline - time.monotonic(), 0.0)

    config = parallel_config(
        backend="loky", n_jobs=workers, initializer=_serve, initargs=(os.getpid(),)
    )
    try:
        with config:
            # In batches a job that hangs would take others along.
            work = Parallel(return_as="generator_unordered", batch_size=1, timeout=left())
            for number, result in work(delayed(_numbered)(*one) for one in waiting.items()):
                found[number] = result
                work.timeout = left()  # joblib's own is from one result to the next
    except (KeyboardInterrupt, SystemExit):  # Ctrl-C and SIGTERM
        _kill_workers()
        raise
    except multiprocessing.TimeoutError as error:
        raise TimeoutError from error


def _kill_workers() -> None:
    """Python waits at its end for the workers that joblib, interrupted, has not yet stopped."""
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor(reuse=True).shutdown(wait=False, kill_workers=True)


def _numbered(number: int, job: Callable[[], Result]) -> tuple[int, Result]:
    return number, job()


def _serve(parent: int) -> None:
    """A worker leaves Ctrl-C to its parent, and ends when that has ended, however it did."""
    os.environ[VARIABLE] = "1"
    # All that jax is for here runs on the processor: an accelerator that it found would cost each
    # worker seconds, and of its memory, which the user's own process may need.
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    share_one_heap()
    if not os.environ.get("SYSID_DEBUG"):
        warnings.simplefilter("ignore")  # they would stand beside the parent's one line
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)


__all__ = ["VARIABLE", "attempt_all", "check_jobs", "job_count", "run_all"]
