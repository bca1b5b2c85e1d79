"""Limits of time, and jobs that come to a result or say why they came to none."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TypeVar

from sysid.errors import InputError, NotIdentifiedError, SysidError, one_line

Result = TypeVar("Result")


class OutOfTimeError(Exception):
    """The time for a computation (`time_limit`) has run out."""


@dataclass(frozen=True)
class Failure:
    """A job that came to no result: why, in a line, and whether only for want of time.

    `error`: what would have ended the command, where that is not a fault of the program.
    """

    reason: str
    out_of_time: bool = False
    error: SysidError | None = field(default=None, compare=False, repr=False)

    @property
    def status(self) -> int:
        """The exit status with which it would have ended the command."""
        return 1 if self.error is None else self.error.exit_code

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


def on_its_own(part: Callable[[], Result]) -> Result | Failure:
    """The result of a part that the rest of the work goes on without, or why there is none.

    What the data do not give (a SysidError) is a reason in its own words, and so is what cannot be
    computed from them: a singular matrix, an overflow. Anything else is a fault of the program:
    its reason says so, and with `SYSID_DEBUG` it is raised. Running out of time, and what the
    machine refuses (OSError), are not the part's: they pass.
    """
    from numpy.linalg import LinAlgError

    try:
        return part()
    except (OutOfTimeError, OSError):
        raise
    except SysidError as error:
        return Failure(str(error), error=error)
    except (ArithmeticError, LinAlgError) as error:
        what = one_line(f"its equations cannot be solved: {error}")
        return Failure(what, error=NotIdentifiedError(what))
    except Exception as error:
        if os.environ.get("SYSID_DEBUG"):
            raise
        what = f"{Failure.of(error).reason} (a fault in sysid itself; SYSID_DEBUG=1 shows where)"
        return Failure(what)


def error_of(failures: Sequence[Failure], what: str) -> Exception:
    """The error, saying `what`, of a whole of which no part came to a result, as these failed.

    InputError where the input is unusable for every part, NotIdentifiedError where the data do not
    suffice for some or there is none, RuntimeError where a fault of the program ended one. Where a
    part's own error says it, that error.
    """
    for failure in failures:
        if failure.error is not None and failure.reason == what:
            return failure.error
    statuses = {failure.status for failure in failures}
    if 1 in statuses:
        return RuntimeError(what)
    return InputError(what) if statuses == {InputError.exit_code} else NotIdentifiedError(what)


__all__ = [
    "Failure",
    "Limit",
    "OutOfTimeError",
    "attempt",
    "check_time",
    "error_of",
    "limit_in_force",
    "on_its_own",
    "time_limit",
    "within",
]
