"""Correlation of the errors of a part's numbers, which one fit estimated jointly."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from sysid.estimation.covariance import JointCovariance
from sysid.parameters.base import Absent, Number, Part
from sysid.types import FloatArray

# A matrix in a file is rounded, as its last digits are not significant: its eigenvalues change by
# this much times their number.
_DECIMALS = 6
ROUNDING = 10.0**-_DECIMALS


class Correlation(Part):
    """`matrix` (k, k) of the correlation of the errors of k numbers, and the numbers' keys."""

    names: list[str]
    matrix: list[list[Number]]

    @classmethod
    def of(
        cls, joint: JointCovariance, known: Collection[str], keys: Mapping[str, str] | None = None
    ) -> Correlation | None:
        """The correlation of those in `known`, under their `keys` (None: their names); None with
        fewer than two."""
        names, matrix = joint.correlation(known)
        if len(names) < 2:
            return None
        # Adding 0 makes a rounded -0 one of 0.
        called = [name if keys is None else keys[name] for name in names]
        return cls(names=called, matrix=(np.round(matrix, _DECIMALS) + 0.0).tolist())

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        count = len(self.names)
        if not count:
            raise ValueError("names no parameter")
        if len(set(self.names)) < count:
            raise ValueError("names a parameter twice")
        if [len(row) for row in self.matrix] != [count] * count:
            raise ValueError(f"is not a matrix of {count} rows and columns, as its names say")
        # Compared one by one: a whole number in a file may be too large for an array.
        if not all(abs(c) <= 1.0 + ROUNDING for row in self.matrix for c in row):
            raise ValueError("holds a number outside -1 to 1")
        matrix = self.array()
        if np.any(np.abs(np.diag(matrix) - 1.0) > ROUNDING):
            raise ValueError("has a diagonal that is not 1")
        if np.any(np.abs(matrix - matrix.T) > ROUNDING):
            raise ValueError("is not symmetric")
        if np.linalg.eigvalsh(matrix)[0] < -ROUNDING * count:
            raise ValueError("is not a correlation: it has a negative eigenvalue")
        return self

    def among(self, keys: Sequence[str]) -> FloatArray:
        """(k, k) of these keys; independent where it has no entry."""
        found = np.eye(len(keys))
        at = [self.names.index(key) for key in keys if key in self.names]
        own = [place for place, key in enumerate(keys) if key in self.names]
        found[np.ix_(own, own)] = self.array()[np.ix_(at, at)]
        return found

    def array(self) -> FloatArray:
        """The matrix (k, k)."""
        return np.array(self.matrix, dtype=float)


class CorrelatedPart(Part):
    """A part that keeps the correlation of its numbers, where it is known.

    Numbers without an entry are independent of the others: they are from separate tests.
    """

    correlation: Absent[Correlation] = None

    @model_validator(mode="after")
    def _names_its_numbers(self) -> Self:
        others = set(self._correlated()).difference(self.estimates())
        if others:
            names = ", ".join(sorted(others))
            raise ValueError(f"has a correlation of {names}, which it does not hold")
        return self

    def covariance(self, keys: Sequence[str]) -> FloatArray:
        """(k, k) of the errors of these keys."""
        estimates = self.estimates()
        std = np.array([estimates[key].std for key in keys])
        known = np.eye(len(keys)) if self.correlation is None else self.correlation.among(keys)
        return np.asarray(known * np.outer(std, std))

    def _correlated(self) -> list[str]:
        return [] if self.correlation is None else self.correlation.names

    def replaced(self, **fields: Any) -> Self:
        """A copy with other values in these fields; a number replaced loses the correlation.

        It is kept where the fields hold another one.
        """
        made = super().replaced(**fields)
        stale = "correlation" not in fields and not fields.keys().isdisjoint(self._correlated())
        return made.without("correlation") if stale else made


__all__ = ["CorrelatedPart", "Correlation"]
