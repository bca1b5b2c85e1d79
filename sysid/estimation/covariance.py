"""A covariance of estimates, and the degrees of freedom that it was estimated with."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sysid.types import FloatArray


@dataclass(frozen=True)
class Covariance:
    """`matrix` (p, p) and, of each diagonal entry, the degrees of freedom `dof` (p,).

    An interval takes both from here, so that the quantile is that of the variance's own error.
    """

    matrix: FloatArray
    dof: FloatArray

    def std(self, index: int) -> float:
        """Standard error of one estimate; infinite without degrees of freedom."""
        if not self.dof[index] > 0.0:
            return math.inf
        return math.sqrt(max(float(self.matrix[index, index]), 0.0))
