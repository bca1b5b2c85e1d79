"""A covariance of estimates, and its degrees of freedom."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sysid.types import FloatArray


@dataclass(frozen=True)
class Covariance:
    """`matrix` (p, p) and the degrees of freedom `dof` (p,) of its diagonal entries.

    An interval uses both, so that its quantile accounts for the error of the variance.
    """

    matrix: FloatArray
    dof: FloatArray

    def std(self, index: int) -> float:
        """Standard error of one estimate; infinite without degrees of freedom."""
        if not self.dof[index] > 0.0:
            return math.inf
        return math.sqrt(max(float(self.matrix[index, index]), 0.0))
