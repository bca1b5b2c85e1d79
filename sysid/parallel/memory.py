"""What the threads of a process free serves the others, and goes back to the system when asked.

glibc gives each thread its own heap. Threads that work with long arrays then each keep what they
have freed: on a long log, more than all the memory in use.
"""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from typing import Any

_ARENA_MAX = -8  # malloc.h: M_ARENA_MAX


@cache
def share_one_heap() -> None:
    """Threads started from now on allocate from one heap; elsewhere than on glibc, nothing.

    A heap (`MALLOC_ARENA_MAX`) that the user has chosen is kept.
    """
    library = _glibc()
    if library is not None and "MALLOC_ARENA_MAX" not in os.environ:
        library.mallopt(_ARENA_MAX, 1)


def give_back() -> None:
    """Hand memory that was freed back to the system; elsewhere than on glibc, nothing."""
    library = _glibc()
    if library is not None:
        library.malloc_trim(0)


@cache
def _glibc() -> Any:
    """The C library, None where it is not glibc."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        library = ctypes.CDLL(None)
        return library if library.mallopt and library.malloc_trim else None
    except (AttributeError, OSError):
        return None


__all__ = ["give_back", "share_one_heap"]
