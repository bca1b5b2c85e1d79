"""The information of a test on the parameters, with its nuisance parameters eliminated.

A test's start states and its friction (a random effect) are its nuisance parameters. Eliminating
them leaves rows of linearised equations in the shared unknowns; information adds up over tests.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.plant.tangents import Direction, Tangents
from sysid.refinement.factors import triangular
from sysid.refinement.problem import Iterate, Linearised, Problem, RunErrors
from sysid.refinement.reduction import INFORMED
from sysid.refinement.runs import STATES, Run
from sysid.types import FloatArray

_S = len(STATES)
# A direction with less information than this, in coordinates of order one, is unidentified.
_LEAST_INFORMATION = 1e-9
_SENSOR_STEP = 1e-3


@dataclass(frozen=True)
class SensorProbe:
    """An effect of the sensors alone, at zero: its slope needs no further simulation.

    `quantity` names the strength, `typical` is the size that is one unit of its column.
    """

    effect: CatalogueEffect
    quantity: str
    typical: float


@dataclass(frozen=True)
class ProbedProblem(Problem):
    """A problem whose runs have a further column for each of the sensors' effects.

    `enlargement`: by how much the standard error of each of the first unknowns is larger than its
    information says, the median of them for the others; 1 where none is given.
    """

    sensors: tuple[SensorProbe, ...] = ()
    enlargement: tuple[float, ...] = ()

    def _errors(
        self,
        run: Run,
        found: Tangents,
        model: Model,
        point: Iterate,
        directions: Sequence[Direction],
    ) -> RunErrors:
        own = super()._errors(run, found, model, point, directions)
        if not self.sensors:
            return own
        here = self._shown(run, found.states, model)
        slopes = []
        for probe in self.sensors:
            step = {probe.quantity: _SENSOR_STEP * probe.typical}
            changed: CatalogueEffect = dataclasses.replace(probe.effect, **step)  # type: ignore[type-var]
            moved = Model(model.parameters, (*model.effects, changed))
            slopes.append((self._shown(run, found.states, moved) - here) / _SENSOR_STEP)
        of = None if own.sliding is None else np.pad(own.sliding, (0, len(slopes)))
        return RunErrors(own.residual, np.concatenate([own.slopes, slopes]), of).kept(run)


def prior_information(problem: Problem, columns: int) -> FloatArray:
    """Information (columns, columns) of the bench tests, by the bundle's standard errors."""
    rows = problem.prior(problem.first_point().shared)[:, :-1]
    found = np.zeros((columns, columns))
    known = rows.shape[1]
    found[:known, :known] = rows.T @ rows
    return found


def information_of(problem: ProbedProblem, runs: Sequence[Linearised]) -> FloatArray:
    """Information (k, k) of some runs of a test, in the order of the shared unknowns.

    A run without a derivative (a chamber that is filled up to the supply) contributes nothing.
    """
    k = len(problem.unknowns) + len(problem.sensors)
    rows = [r.factor[_S:, _S:-1] for r in runs if np.isfinite(r.factor).all()]
    if not rows:
        return np.zeros((k, k))
    factor = triangular(rows)
    scatter = np.zeros((2, factor.shape[1]))
    scatter[:, :2] = np.eye(2)
    if np.linalg.norm(factor[:, 1]) < INFORMED:
        factor[:, 1] = 0.0
    elif problem.static_number is not None:
        scatter[1, 2 + problem.static_number] = -1.0 / problem.scatter[1]
    rest = triangular([scatter, factor])[2:, 2:]
    rest /= _enlargement(problem, k)
    return np.asarray(rest.T @ rest)


def _enlargement(problem: ProbedProblem, columns: int) -> FloatArray:
    """The enlargement of each column's standard error, (columns,)."""
    known = np.array(problem.enlargement or (1.0,))
    return np.concatenate([known, np.full(columns, np.median(known))])[:columns]


def covariance(information: FloatArray) -> FloatArray:
    """The inverse of information (k, k); a direction without any is very uncertain, not certain."""
    _, outer = _scales(information)
    values, vectors = np.linalg.eigh(information / outer)
    inverse = (vectors / np.maximum(values, _LEAST_INFORMATION)) @ vectors.T
    return np.asarray(inverse / outer)


def log_volume(information: FloatArray, columns: Sequence[int]) -> FloatArray:
    """Log determinant (...) of the covariance of some columns, of information (..., k, k).

    As `covariance` has it, but for directions that are hardly known: a little information is added
    to each, which costs a tenth of the time.
    """
    scale, outer = _scales(information)
    sides = np.zeros((information.shape[-1], len(columns)))
    sides[list(columns), np.arange(len(columns))] = 1.0
    some = information / outer + _LEAST_INFORMATION * np.eye(len(sides))
    own = np.linalg.solve(some, sides)[..., list(columns), :]
    size = 2.0 * np.sum(np.log(scale[..., list(columns)]), axis=-1)
    return np.asarray(np.linalg.slogdet(own)[1] - size)


def _scales(information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Roots of the diagonal (..., k), and their products (..., k, k)."""
    scale = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), _LEAST_INFORMATION))
    return scale, scale[..., :, None] * scale[..., None, :]


__all__ = [
    "ProbedProblem",
    "SensorProbe",
    "covariance",
    "information_of",
    "log_volume",
    "prior_information",
]
