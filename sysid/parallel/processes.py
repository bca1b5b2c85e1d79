"""Jobs in several processes: how many, how much they may do, and that none outlives its parent."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, TypeVar

from sysid.errors import Failure, input_error
from sysid.parallel.clock import processor_seconds, tell, tell_remote
from sysid.parallel.cluster import VARIABLE, cluster_in_force, collect_on
from sysid.parallel.limits import LATE, Limit, attempt, limit_in_force, within
from sysid.parallel.memory import share_one_heap

Result = TypeVar("Result")

_MOST_WORKERS = 4096
# Processor time that a worker may take to notice that its share is over, s.
_GRACE_S = 3.0


def job_count() -> int:
    """How many processes may work at a time, at least 1. Raises InputError for a bad variable."""
    cluster = cluster_in_force()
    if cluster is not None:
        return max(cluster.workers(), 1)  # none while one that died is replaced
    text = check_jobs(VARIABLE)
    if text:
        return int(text)
    import joblib

    return int(joblib.cpu_count())


def thread_count() -> int:
    """How many threads of this process may compute at a time, at least 1: `SYSID_JOBS`, or the
    cores that this process may use. Raises InputError for a bad variable."""
    text = check_jobs(VARIABLE)
    if text:
        return int(text)
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def check_jobs(where: str) -> str:
    """The text of `SYSID_JOBS`, empty without one; InputError, naming `where`, for a bad one."""
    text = os.environ.get(VARIABLE, "").strip()
    if text and not (text.isdecimal() and 1 <= int(text) <= _MOST_WORKERS):
        raise input_error(where, f"{text[:20]!r} is not a number of processes", "give at least 1")
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
    """`run_all`, with a `Failure` for each job that raises or has not ended within its limit.

    Each may make all the remaining evaluations; each worker has its share of the remaining
    processor time, and one that does not check it itself is ended soon after that. If a worker
    dies, the unfinished jobs are tried again, each in a separate process.
    """
    limit = limit_in_force()
    on_cluster = cluster_in_force() is not None
    waiting = dict(enumerate(jobs))
    workers = min(job_count(), len(waiting))
    none_other = workers <= 1 and not on_cluster
    if none_other or limit.is_over:  # none is begun then, and no process started
        return attempt_in_turn(waiting.values())
    found: dict[int, _Told[Result]] = {}
    why = _collected(found, waiting, workers, limit)
    failed: dict[int, Failure] = {}
    for number in [n for n in waiting if n not in found]:
        if not limit.is_over:
            why = _collected(found, {number: waiting[number]}, 1, limit)
        failed[number] = LATE if limit.is_over else why
    limit.made += sum(told.made for told in found.values())
    return [found[number].result if number in found else failed[number] for number in waiting]


def attempt_in_turn(jobs: Iterable[Callable[[], Result]]) -> list[Result | Failure]:
    """`attempt` of each job in this thread, one after the other, as if all began now."""
    limit = limit_in_force()
    results, made, begun = list[Result | Failure](), 0, limit.for_a_job()
    for job in jobs:
        own = replace(begun)
        with within(own):
            results.append(attempt(job))
        made += own.made
    limit.made += made
    return results


@dataclass(frozen=True)
class _Told(Generic[Result]):
    """A job's result with the evaluations that it made, and the processor time that it used, s."""

    result: Result | Failure
    made: int
    used: float


@dataclass(frozen=True)
class _Share:
    """What a job in another process may do: `evaluations`, and `seconds` of processor time that
    each process has for all jobs of this `block`."""

    evaluations: float
    seconds: float
    block: str

    @staticmethod
    def of(limit: Limit, workers: int) -> _Share:
        seconds = limit.until
        if not math.isinf(seconds):
            seconds = max(seconds - processor_seconds(), 0.0) / workers
        return _Share(limit.evaluations - limit.made, seconds, uuid.uuid4().hex)


@dataclass
class _Worker:
    """State of this process as a worker: which block of jobs it is at, since when and until
    when, in its processor time, s."""

    block: str = ""
    since: float = 0.0
    until: float = math.inf


_SELF = _Worker()


def _attempt_by(job: Callable[[], Result], share: _Share) -> _Told[Result]:
    """`attempt` in another process."""
    begun = time.process_time()
    if _SELF.block != share.block:
        _SELF.block, _SELF.since = share.block, begun
    _SELF.until = _SELF.since + share.seconds
    own = Limit(share.evaluations, _SELF.until)
    try:
        with within(own):
            result = attempt(job)
    finally:
        _SELF.until = math.inf
    return _Told(result, own.made, time.process_time() - begun)


def _collected(
    found: dict[int, _Told[Result]],
    waiting: Mapping[int, Callable[[], Result]],
    workers: int,
    limit: Limit,
) -> Failure:
    """`_collect`; why jobs came to no result, if some did."""
    share = _Share.of(limit, workers)
    new: dict[int, _Told[Result]] = {}
    try:
        jobs = {number: partial(_attempt_by, job, share) for number, job in waiting.items()}
        _collect(new, jobs, workers)
    except Exception as error:  # a worker that died, perhaps out of memory
        if os.environ.get("SYSID_DEBUG"):
            raise
        return Failure.of(error)
    finally:
        found |= new
        if cluster_in_force() is not None:
            tell_remote(sum(told.used for told in new.values()))
    return Failure("no result")


def _collect(
    found: dict[int, Result], waiting: Mapping[int, Callable[[], Result]], workers: int
) -> None:
    """Put each job's result into `found`, by its number, as it comes.

    Raises what a job raises. joblib kills its own workers; those of other pools are not touched. On
    a cluster the scheduler does this.
    """
    cluster = cluster_in_force()
    if cluster is not None:
        collect_on(cluster, found, waiting)
        return
    from joblib import Parallel, delayed, parallel_config

    config = parallel_config(
        backend="loky", n_jobs=max(workers, 2), initializer=_serve, initargs=(os.getpid(),)
    )
    try:
        with config:
            # In batches a job that hangs would block others.
            work = Parallel(return_as="generator_unordered", batch_size=1)
            for number, result, used in work(delayed(_numbered)(*one) for one in waiting.items()):
                found[number] = result
                tell(*used)
    except (KeyboardInterrupt, SystemExit):  # Ctrl-C and SIGTERM
        _kill_workers()
        raise


def _kill_workers() -> None:
    """Python waits at its end for the workers that joblib, interrupted, has not yet stopped."""
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor(reuse=True).shutdown(wait=False, kill_workers=True)


def _numbered(number: int, job: Callable[[], Result]) -> tuple[int, Result, tuple[int, float]]:
    """A job's number and result; the process and the processor time that it has used so far, s."""
    return number, job(), (os.getpid(), time.process_time())


def _serve(parent: int) -> None:
    """A worker leaves Ctrl-C to its parent, and ends when that has ended, however it did."""
    os.environ[VARIABLE] = "1"
    # jax is used on the processor only: an accelerator that it found would cost each worker
    # seconds, and some of the accelerator's memory, which the user's own process may need.
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    share_one_heap()
    if not os.environ.get("SYSID_DEBUG"):
        warnings.simplefilter("ignore")  # they would appear next to the parent's one line
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent and time.process_time() < _SELF.until + _GRACE_S:
        time.sleep(1.0)
    os._exit(1)


__all__ = [
    "VARIABLE",
    "attempt_all",
    "attempt_in_turn",
    "check_jobs",
    "job_count",
    "run_all",
    "thread_count",
]
