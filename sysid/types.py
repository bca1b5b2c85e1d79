"""Types that many modules share: typed arrays, and a progress callback."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

Progress = Callable[[str], None]
"""Called with one line as each step begins."""


def no_progress(line: str) -> None:
    """Report nothing."""
