"""A covariance of estimates, its degrees of freedom, and the correlation that it says."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

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

    def at_least(self, other: Covariance) -> Covariance:
        """With each estimate's larger standard error of the two, and its degrees of freedom.

        Where `other` has no variance, it carries no information.
        """
        own, theirs = np.diag(self.matrix), np.diag(other.matrix)
        larger = (other.dof > 0.0) & (theirs > own) & (own > 0.0)
        scale = np.ones(len(own))
        scale[larger] = np.sqrt(theirs[larger] / own[larger])
        dof = np.where(larger, np.minimum(self.dof, other.dof), self.dof)
        return Covariance(self.matrix * np.outer(scale, scale), dof)


@dataclass(frozen=True)
class JointCovariance:
    """The covariance `matrix` (k, k) of the errors of k estimates, by name."""

    names: tuple[str, ...]
    matrix: FloatArray

    def joined(self, variances: Mapping[str, float]) -> JointCovariance:
        """With further estimates, by name, whose errors are independent of these."""
        k, own = len(self.names), list(variances.values())
        matrix = np.zeros((k + len(own),) * 2)
        matrix[:k, :k], matrix[k:, k:] = self.matrix, np.diag(own)
        return JointCovariance((*self.names, *variances), matrix)

    def correlation(self, known: Collection[str]) -> tuple[tuple[str, ...], FloatArray]:
        """The names in `known` that have an error, and their correlation (m, m)."""
        variances = np.diag(self.matrix)
        places = [
            i
            for i, (name, variance) in enumerate(zip(self.names, variances, strict=True))
            if name in known and 0.0 < variance < math.inf
        ]
        matrix = correlation_of(self.matrix[np.ix_(places, places)])
        return tuple(self.names[i] for i in places), matrix


def correlation_of(covariance: FloatArray) -> FloatArray:
    """The correlation (k, k) of a covariance (k, k); 0 with what has no finite error."""
    variances = np.diag(covariance)
    known = (variances > 0.0) & np.isfinite(variances)
    std = np.sqrt(np.where(known, variances, 1.0))
    matrix = np.where(np.outer(known, known), covariance, 0.0) / np.outer(std, std)
    matrix = np.clip(0.5 * (matrix + matrix.T), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


def shrunk(covariance: FloatArray, dof: float, towards: FloatArray | None = None) -> FloatArray:
    """A covariance (k, k) that the scatter of few tests shows, its correlations shrunk.

    Of `dof` + 1 tests, as if k + 1 further ones had shown the correlations of the covariance
    `towards` (None: none), as an inverse Wishart prior does (Barnard, McCulloch, Meng 2000). Two
    tests alone would say that two numbers are tied exactly.
    """
    k = len(covariance)
    prior = np.eye(k) if towards is None else correlation_of(towards)
    matrix = (dof * correlation_of(covariance) + (k + 1.0) * prior) / (dof + k + 1.0)
    std = np.sqrt(np.diag(covariance))
    return np.asarray(matrix * np.outer(std, std))
