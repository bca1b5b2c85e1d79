"""Orthogonal factorisations of equations: as few rows as there are columns, the same squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.types import FloatArray


def triangular(rows: Sequence[FloatArray]) -> FloatArray:
    """The triangular factor (k, k) of stacked rows, (n, k) each."""
    return np.asarray(np.linalg.qr(np.vstack(list(rows)), mode="r"), dtype=float)


__all__ = ["triangular"]
