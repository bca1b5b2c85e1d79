"""Jobs in threads of this process, and results that each thread keeps for itself."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from contextvars import copy_context
from functools import lru_cache, partial
from typing import Generic, ParamSpec, TypeVar

from sysid.errors import Failure
from sysid.parallel.limits import Limit, attempt, limit_in_force, within
from sysid.parallel.memory import give_back, share_one_heap
from sysid.parallel.processes import attempt_in_turn, job_count, thread_count

Given = ParamSpec("Given")
Result = TypeVar("Result")
Item = TypeVar("Item")


def in_threads(job: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """job(item) of each, in order, in as many threads of this process as there may be.

    For jobs that leave the interpreter's lock for most of their time, as compiled functions and
    numpy on long arrays do. Raises what the first job, in order, raises; none is begun after that.
    """
    workers = min(thread_count(), len(items))
    if workers <= 1:
        return [job(item) for item in items]
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(copy_context().run, job, item) for item in items]
        try:
            return [future.result() for future in futures]
        finally:
            for future in futures:
                future.cancel()


def attempt_in_threads(jobs: Iterable[Callable[[], Result]]) -> list[Result | Failure]:
    """`attempt` of each job, in order, in threads of this process: nothing is copied.

    For jobs that spend their time in numpy on long arrays, which lets other threads run, and
    that call `spend`: a thread cannot be killed. Each may use the whole remaining budget.
    """
    from concurrent.futures import ThreadPoolExecutor

    waiting, limit = list(jobs), limit_in_force()
    workers = min(job_count(), len(waiting))
    if workers <= 1:
        return attempt_in_turn(waiting)
    own = [limit.for_a_job() for _ in waiting]
    try:
        share_one_heap()
        with ThreadPoolExecutor(workers) as pool:
            try:
                futures = [
                    pool.submit(copy_context().run, partial(_attempt_within, *pair))
                    for pair in zip(own, waiting, strict=True)
                ]
                return [future.result() for future in futures]
            except BaseException:
                for one in own:
                    one.is_stopped = True
                raise
            finally:
                give_back()
    finally:
        limit.made += sum(one.made for one in own)


def _attempt_within(limit: Limit, job: Callable[[], Result]) -> Result | Failure:
    with within(limit):
        return attempt(job)


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


__all__ = ["PerThread", "attempt_in_threads", "in_threads", "kept_per_thread"]
