"""How much a computation may do, and jobs that come to a result or say why they came to none.

Work is counted in evaluations, which are the same on every machine whatever else it does. Processor
time is checked only where a limit was set.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

from sysid.errors import Failure, OutOfBudgetError
from sysid.parallel.clock import processor_seconds

Result = TypeVar("Result")


LATE = Failure("out of budget", out_of_budget=True)


@dataclass
class Limit:
    """What the computations of a context may do, and what they have done.

    `evaluations`: how many may be made; `until`: on the clock of `processor_seconds`, s; `made`:
    the evaluations that were.
    """

    evaluations: float = math.inf
    until: float = math.inf
    made: int = 0
    is_stopped: bool = False

    @property
    def is_over(self) -> bool:
        if self.is_stopped or self.made >= self.evaluations:
            return True
        return not math.isinf(self.until) and processor_seconds() > self.until

    def for_a_job(self) -> Limit:
        """The limit of one of several jobs that begin now.

        Each may use the whole remaining budget: which of them finish depends neither on their order
        nor on how many run at a time.
        """
        return Limit(self.evaluations - self.made, self.until, is_stopped=self.is_stopped)


# Threads of `in_threads` count on one limit.
_COUNTING = threading.Lock()
_LIMIT: ContextVar[Limit | None] = ContextVar("limit", default=None)


def limit_in_force() -> Limit:
    """The limit of the present context; one without bounds where none was set."""
    return _LIMIT.get() or Limit()


@contextmanager
def within(limit: Limit) -> Iterator[None]:
    """A limit in force in place of the present one."""
    token = _LIMIT.set(limit)
    try:
        yield
    finally:
        _LIMIT.reset(token)


@contextmanager
def limited(*, evaluations: float = math.inf, seconds: float = math.inf) -> Iterator[Limit]:
    """`spend` raises once so many evaluations were made, or so much processor time was used.

    In place of the limit in force, on which the evaluations count as well. The time is that of
    this process and its workers, s.
    """
    outer = limit_in_force()
    own = Limit(evaluations, math.inf if math.isinf(seconds) else processor_seconds() + seconds)
    try:
        with within(own):
            yield own
    finally:
        outer.made += own.made


def spend(evaluations: int = 1) -> None:
    """To be called before so many evaluations of a model on all tests, by its balances or by its
    simulation; 0 only checks whether any budget remains. Raises OutOfBudgetError."""
    limit = limit_in_force()
    if limit.is_over:
        raise OutOfBudgetError
    with _COUNTING:
        limit.made += evaluations


def attempt(job: Callable[[], Result]) -> Result | Failure:
    """The result of a job, or why it failed; with `SYSID_DEBUG` errors are raised."""
    if limit_in_force().is_over:
        return LATE
    try:
        return job()
    except OutOfBudgetError:
        return LATE
    except Exception as error:
        if os.environ.get("SYSID_DEBUG"):
            raise
        return Failure.of(error)


__all__ = [
    "LATE",
    "Limit",
    "attempt",
    "limit_in_force",
    "limited",
    "spend",
    "within",
]
