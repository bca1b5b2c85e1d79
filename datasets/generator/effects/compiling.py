"""How the effects' laws are compiled: as the plant's, and in division as C does it.

A division by zero gives inf or nan instead of an exception, and every law is compiled into its
caller: together this is twice as fast. The copy of the integrator cached on disk contains the laws'
code and does not notice that a law changed: after an edit delete this folder's `__pycache__/*.nb*`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

_F = TypeVar("_F", bound=Callable[..., Any])


def compiled(function: _F) -> _F:
    """Compile to machine code at the first call, kept on disk; the type stays as written."""
    return cast(_F, njit(cache=True, error_model="numpy", forceinline=True)(function))
