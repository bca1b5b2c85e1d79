"""Combinations of parameters: what tests identify that do not separate Coulomb friction from an
offset (one direction) or friction from its slope over speed (one speed).

At one speed in both directions the offset is a number of its own: viscous friction enters it only
by how much the two speeds differ, and lies between none and all friction of the tests.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sysid.estimation.linear import Estimate, LinearFit, linear_fit
from sysid.types import FloatArray

OTHER_DIRECTION = (
    "a motion in both directions (friction-motion that reverses, or friction-sliding tests in "
    "the other direction too)"
)
OTHER_SPEED = (
    "motion at further speeds (friction-sliding tests at a second level of the effort, or "
    "friction-motion whose speed changes)"
)


class Units(Protocol):
    """A rig's: the unit of its effort, and a parameter's key in a bundle."""

    @property
    def effort(self) -> str: ...
    def key(self, name: str, /) -> str: ...


@dataclass(frozen=True)
class Combination:
    """A sum of parameters that the tests identify although they do not identify its parts.

    `terms` are the parameters' names, `coefficients` their factors in the sum; `test` is the test
    that would separate them.
    """

    terms: tuple[str, ...]
    coefficients: tuple[float, ...]
    estimate: Estimate
    test: str
    units: Units

    @property
    def of(self) -> tuple[str, ...]:
        """The parameters' keys in a bundle."""
        return tuple(self.units.key(name) for name in self.terms)

    @property
    def expression(self) -> str:
        """ "coulomb_nm + 0.52 viscous_nm_s_per_rad"."""
        terms = [
            (c < 0.0, name if abs(c) == 1.0 else f"{abs(c):.3g} {name}")
            for name, c in zip(self.of, self.coefficients, strict=True)
        ]
        start = ("-" if terms[0][0] else "") + terms[0][1]
        return start + "".join(f" {'-' if less else '+'} {text}" for less, text in terms[1:])

    @property
    def notice(self) -> str:
        """The sum, its value, and the test that would separate its parts."""
        e = self.estimate
        return (
            f"only the sum {self.expression} = {e.value:.4g} {e.unit} is identified; "
            f"{self.test} would separate its parts"
        )

    @property
    def reason(self) -> str:
        """Why none of the parameters is identified by itself."""
        return f"only {self.expression} is identified: give {self.test}"

    def to_json(self) -> dict[str, Any]:
        """The bundle's row."""
        return {
            "of": list(self.of),
            "coefficients": list(self.coefficients),
            "expression": self.expression,
            **self.estimate.to_json(),
            "test": self.test,
        }


@dataclass(frozen=True)
class Sums:
    """What such tests give: the combinations, and the offset where that is not part of one."""

    rows: tuple[Combination, ...] = ()
    offset: Estimate | None = None

    def __bool__(self) -> bool:
        return bool(self.rows)


@dataclass(frozen=True)
class Separation:
    """Whether tests run both ways and at several speeds; `way` is that of one-way tests."""

    both: bool
    speeds: bool
    way: float = 1.0

    @property
    def full(self) -> bool:
        return self.both and self.speeds

    @property
    def test(self) -> str:
        """The test that would separate the parameters."""
        wanted = (() if self.both else (OTHER_DIRECTION,)) + (() if self.speeds else (OTHER_SPEED,))
        return " and ".join(wanted)


def combined(
    estimates: Sequence[Estimate], slope: tuple[float, float], shape: Separation, units: Units
) -> Sums:
    """What a fit of reduced columns gives.

    In both directions `estimates` are of the columns direction and 1, in one of the direction
    alone; `slope` is the fit of the speed on the same columns (its factor of viscous friction
    in each), ignored where there are several speeds.
    """
    if shape.full:
        return Sums()
    terms = {"coulomb": 1.0} if shape.both else {"coulomb": 1.0, "offset": shape.way}
    terms |= {} if shape.speeds else {"viscous": slope[0]}
    row = Combination(tuple(terms), tuple(terms.values()), estimates[0], shape.test, units)
    return Sums((row,), _offset(estimates, slope) if shape.both else None)


def _offset(estimates: Sequence[Estimate], slope: tuple[float, float]) -> Estimate:
    """The offset of tests in both directions at one speed.

    The value goes with a sum that is all Coulomb friction. At the most, viscous friction is all of
    the sum: then the offset is less by that times half the difference of the two speeds. The
    interval reaches from the one to the other.
    """
    friction, offset = estimates
    mean, half = slope
    less = half * max(friction.value, 0.0) / mean if mean > 0.0 else 0.0
    low, high = offset.interval
    limits = (low - max(less, 0.0), high - min(less, 0.0))
    std = math.hypot(offset.std, less / math.sqrt(3.0))
    return Estimate(offset.value, std, offset.unit, limits, offset.reason)


def mean_friction(friction: FloatArray, speed: FloatArray, way: FloatArray, units: Units) -> Sums:
    """What is known of tests or readings at one level, from their mean friction (signed), mean
    speed (signed) and direction, (n,) each.

    Where the effort was set, the friction that scatters shows in the speed alone: viscous friction,
    which makes this an error of the sum, lies between none and all of it, and the larger error
    counts.
    """
    both = len(np.unique(way)) == 2
    shape = Separation(both, False, float(way[0]))
    columns = np.column_stack([way, np.ones(len(way))] if both else [way])
    fit, moved = linear_fit(columns, friction), linear_fit(columns, speed)
    mean, half = (*map(float, moved.coefficients), 0.0)[:2]
    most = max(float(fit.coefficients[0]), 0.0) / mean if mean > 0.0 else 0.0
    at_most = linear_fit(columns, friction - most * speed)
    stds = np.maximum(_stds(fit), _stds(at_most))
    estimates = [
        Estimate.symmetric(float(value), float(std), units.effort, fit.dof)
        for value, std in zip(fit.coefficients, stds, strict=True)
    ]
    return combined(estimates, (mean, half), shape, units)


def _stds(fit: LinearFit) -> FloatArray:
    """Infinite without repeats from which an error could be estimated."""
    return np.asarray(np.sqrt(fit.variance * np.diag(fit.unscaled)))


def unidentified(
    name: str, unit: str, combinations: Sequence[Combination], otherwise: str
) -> Estimate:
    """A parameter that is only part of sums, with the test that would separate it; else why."""
    own = next((c for c in combinations if name in c.terms), None)
    return Estimate.unidentified(unit, otherwise if own is None else own.reason)


__all__ = [
    "OTHER_DIRECTION",
    "OTHER_SPEED",
    "Combination",
    "Separation",
    "Sums",
    "combined",
    "mean_friction",
    "unidentified",
]
