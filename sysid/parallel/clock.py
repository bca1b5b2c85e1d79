"""Processor time of this process and of the workers that it has started.

For a living worker it is the time reported with its last result; of processes that have ended,
what the system says, where it does (not on Windows).
"""

from __future__ import annotations

import os
import sys
import time

# Processor time of each living worker as last reported, s by its number.
_WORKERS: dict[int, float] = {}
# Processor time of jobs on other machines.
_REMOTE = [0.0]


def processor_seconds() -> float:
    """Processor time of this process' threads, its workers and its children, s."""
    if sys.platform == "win32":
        return time.process_time() + sum(_WORKERS.values()) + _REMOTE[0]
    import resource

    for number in list(_WORKERS):
        try:
            os.kill(number, 0)
        except OSError:
            _WORKERS.pop(number, None)  # it has ended, and counts among the children that have
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    children = ended.ru_utime + ended.ru_stime
    return time.process_time() + children + sum(_WORKERS.values()) + _REMOTE[0]


def tell(number: int, used: float) -> None:
    """Record the processor time, s, of a worker of this machine, by its process number."""
    _WORKERS[number] = max(used, _WORKERS.get(number, 0.0))


def tell_remote(used: float) -> None:
    """Record the processor time, s, used by a job elsewhere."""
    _REMOTE[0] += used


__all__ = ["processor_seconds", "tell", "tell_remote"]
