"""Limits of time, and jobs that come to a result or say why they came to none."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

from sysid.errors import one_line

Result = TypeVar("Result")


class OutOfTimeError(Exception):
    """The time for a computation (`time_limit`) has run out."""


@dataclass(frozen=True)
class Failure:
    """A job that came to no result: why, in a line, and whether only for want of time."""

    reason: str
    out_of_time: bool = False

    @staticmethod
    def of(error: BaseException) -> Failure:
        """Of a job that raised an error."""
        return Failure(one_line(f"{type(error).__name__}: {error}"))


@dataclass
class Limit:
    """When the computations of a context have to end, on the clock of `time.monotonic`."""

    deadline: float = math.inf
    is_stopped: bool = False


_LIMIT: ContextVar[Limit] = ContextVar("limit", default=Limit())  # noqa: B039 - never changed


def limit_in_force() -> Limit:
    """That of the present context."""
    return _LIMIT.get()


@contextmanager
def within(limit: Limit) -> Iterator[None]:
    """A limit in force in place of the present one."""
    token = _LIMIT.set(limit)
    try:
        yield
    finally:
        _LIMIT.reset(token)


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """`check_time` raises once so many seconds have passed; None: never."""
    deadline = math.inf if seconds is None else time.monotonic() + seconds
    with within(Limit(deadline)):
        yield


def check_time() -> None:
    """To be called within long loops. Raises OutOfTimeError."""
    limit = limit_in_force()
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
        return Failure.of(error)


__all__ = [
    "Failure",
    "Limit",
    "OutOfTimeError",
    "attempt",
    "check_time",
    "limit_in_force",
    "time_limit",
    "within",
]
