"""Fit of the whole pressure curve of valve-discrete tests by simulation error.

Shared by all pieces: the valve's flows, coefficients and delays. Per piece: its initial
pressure and, where it settles, its supply and atmospheric pressure.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.covariance import Covariance, JointCovariance, shrunk
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import LeastSquaresFit, Parameter, central_jacobian, minimise
from sysid.estimation.quality import SIGNIFICANT
from sysid.identification.valve_discrete.held_chamber import (
    DELAYS,
    FLOWS,
    DiscreteValve,
    pressure_curve,
)
from sysid.identification.valve_discrete.trials import Piece
from sysid.parameters.valves import ISO6358, LAW_UNITS, SERIES, THESIS, VALVE_ALONE, WAYS
from sysid.plant.iso6358 import HIGHEST_RATIO
from sysid.types import FloatArray

UNITS = {
    **LAW_UNITS,
    "on_delay_s": "s",
    "off_delay_s": "s",
    **{f"sonic_conductance_{way}": "m3/(s Pa)" for way in WAYS},
    **{f"critical_ratio_{way}": "-" for way in WAYS},
    **{f"subsonic_index_{way}": "-" for way in WAYS},
    **{f"{part}_c_{way}": LAW_UNITS[f"c_{way}"] for part in ("valve", "control") for way in WAYS},
}

CONDUCTANCES = tuple(f"sonic_conductance_{way}" for way in WAYS)
_MAY_SCATTER = 0.2
"""Chance of taking a conductance's error from the tests' scatter where they have none. A test as
strict as one that names a scatter leaves most scatter of the size of the noise out of intervals
(Bancroft, Biometrics 20, 1964, takes 0.25)."""

_PLACES = 16
"""Of a curve between two counts, at which its rounding is taken."""


def thesis_names(way: str) -> tuple[str, str]:
    """The choked flow and the coefficient of a direction, "fill" or "dis", by the thesis."""
    return (FLOWS[0], FLOWS[1]) if way == "fill" else (FLOWS[2], FLOWS[3])


def iso_names(way: str) -> tuple[str, str, str]:
    """Conductance, critical ratio and index of a direction, "fill" or "dis", by ISO 6358."""
    return f"sonic_conductance_{way}", f"critical_ratio_{way}", f"subsonic_index_{way}"


@dataclass(frozen=True)
class CurveFit:
    """The fitted curves, and covariances that hold for autocorrelated errors."""

    problem: CurveProblem
    fit: LeastSquaresFit

    @cached_property
    def groups(self) -> NDArray[np.intp]:
        """(n,): which piece each residual belongs to."""
        groups: NDArray[np.intp] = np.repeat(
            np.arange(len(self.problem.pieces), dtype=np.intp), self.problem.lengths
        )
        return groups

    @cached_property
    def covariance(self) -> Covariance:
        """Sensor noise may be coloured, so the residuals' autocorrelation is used.

        A converter's error is no noise where the pressure rests between two counts: what it does to
        the parameters is added.
        """
        noise = self.fit.correlated_covariance(self.groups)
        return Covariance(noise.matrix + self._rounding, noise.dof)

    @cached_property
    def _rounding(self) -> FloatArray:
        """(p, p): mean square of the steps that the converters' rounding makes in the parameters.

        Where the curve lies between two counts is unknown to less than a count: the mean is over
        all such places, the same in each test.
        """
        pieces = self.problem.pieces
        curves = [p.pressure + self.residuals(i) for i, p in enumerate(pieces)]
        errors = [
            np.concatenate(
                [
                    p.sensor.rounding(curve + share * p.sensor.quantum)
                    for p, curve in zip(pieces, curves, strict=True)
                ]
            )
            for share in np.arange(_PLACES) / _PLACES
        ]
        steps = self.fit.steps_for(np.array(errors))
        return np.asarray(steps.T @ steps / _PLACES)

    def residuals(self, index: int) -> FloatArray:
        """Fitted less measured pressure of one piece, (n_i,) Pa."""
        return np.asarray(self.fit.residuals[self.groups == index])

    def value(self, name: str, index: int) -> float:
        """A piece's own parameter ("initial", "supply_shift", "atmosphere"), Pa."""
        return self.problem.own(self.fit.values, index)[name]

    def error(self, name: str, index: int) -> float:
        """The standard error of a piece's own parameter, Pa; 0 where it is not fitted."""
        own = self.problem.columns[index][len(self.problem.free) :]
        named = (k for k in own if self.fit.names[k].split("[")[0] == name)
        return next((self.covariance.std(k) for k in named), 0.0)

    def estimate(self, name: str) -> tuple[Estimate, bool]:
        """A shared parameter, and whether it differs from test to test beyond its error.

        If so, or if it may (`scattering`), its error is taken from that scatter: the jackknife over
        tests, with Student's interval for their number.
        """
        plain = self.fit.estimate(name, self.covariance)
        if not plain.identified or name not in self.scattering:
            return plain, False
        i, wide = self.fit.names.index(name), self.jackknife
        std = max(wide.std(i), plain.std)
        wider = Estimate.symmetric(plain.value, std, plain.unit, float(wide.dof[i]))
        return wider, self.chances[name] < SIGNIFICANT

    @cached_property
    def scattering(self) -> tuple[str, ...]:
        """The identified shared parameters that differ from test to test beyond their error, or, of
        the sonic conductances, may."""
        levels = {n: _MAY_SCATTER if n in CONDUCTANCES else SIGNIFICANT for n in self.chances}
        return tuple(name for name, chance in self.chances.items() if chance < levels[name])

    @cached_property
    def chances(self) -> dict[str, float]:
        """Of each identified shared parameter, how likely its tests differ so much by noise alone.

        What moves one sonic conductance, as the air's temperature, moves the other, whose own error
        may hide it: of both it is the smaller.
        """
        known = [n for n in self.problem.free if self.fit.estimate(n, self.covariance).identified]
        found = {name: self._chance_of_scatter(name) for name in known}
        least = min((found[n] for n in CONDUCTANCES if n in found), default=1.0)
        return {n: least if n in CONDUCTANCES else chance for n, chance in found.items()}

    @cached_property
    def jackknife(self) -> Covariance:
        """Leave-one-test-out, of all parameters."""
        labels = np.array([p.source for p in self.problem.pieces])
        _, trial = np.unique(labels, return_inverse=True)
        return self.fit.jackknife_covariance(trial[self.groups])

    @cached_property
    def joint(self) -> JointCovariance:
        """Joint covariance of the shared: by the noise, or the tests' scatter if some differ."""
        names = self.problem.free
        own = (slice(len(names)),) * 2
        matrix = self.covariance.matrix[own]
        if self.scattering:
            wide = self.jackknife
            matrix = shrunk(wide.matrix[own], float(wide.dof[0]), towards=matrix)
        return JointCovariance(names, matrix)

    def inflation(self, column: int) -> float:
        """The factor by which correlated noise raises the variance of a parameter."""
        return float(self.covariance.matrix[column, column] / self.fit.covariance[column, column])

    def _chance_of_scatter(self, name: str) -> float:
        """Cochran's test: how likely the pieces' own estimates (one Gauss-Newton step) are so far
        from their mean.

        Each piece's error is that for white noise, scaled as correlation scales the total error.
        """
        from scipy.special import chdtrc

        column = self.fit.names.index(name)
        inflation = self.inflation(column)
        values, variances = [], []
        for index in range(len(self.problem.pieces)):
            columns = self.problem.columns[index]
            rows = self.groups == index
            jacobian = self.fit.jacobian[np.ix_(rows, columns)]
            norm = np.sqrt(np.sum(jacobian**2, axis=0))
            place = int(np.flatnonzero(columns == column)[0])
            used = norm > 0.0
            if not used[place]:
                continue
            scaled = jacobian[:, used] / norm[used]
            inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-10, hermitian=True)
            at = int(np.count_nonzero(used[:place]))
            step = inverse[at] @ (scaled.T @ -self.fit.residuals[rows]) / norm[place]
            variance = inverse[at, at] / norm[place] ** 2 * self.fit.residual_std**2 * inflation
            values.append(float(step))
            variances.append(float(variance))
        if len(values) < 2:
            return 1.0
        weights = 1.0 / np.array(variances)
        mean = float(weights @ values / weights.sum())
        statistic = float(weights @ (np.array(values) - mean) ** 2)
        return float(chdtrc(len(values) - 1, statistic))


@dataclass(frozen=True)
class CurveProblem:
    """Pieces, the valve to start from, and which of its parameters are free."""

    pieces: tuple[Piece, ...]
    start: DiscreteValve
    free: tuple[str, ...]

    def law(self, way: str) -> str:
        """Which law a direction, "fill" or "dis", obeys here."""
        if way in self.start.in_series:
            return SERIES
        return THESIS if getattr(self.start, f"sonic_conductance_{way}") is None else ISO6358

    def flow_names(self, way: str) -> tuple[str, ...]:
        """The numbers of a direction's law."""
        law = self.law(way)
        if law == ISO6358:
            return iso_names(way)
        return (*thesis_names(way), VALVE_ALONE[way]) if law == SERIES else thesis_names(way)

    @cached_property
    def lengths(self) -> list[int]:
        return [len(p.pressure) for p in self.pieces]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        shared = [_shared_parameter(name, getattr(self.start, name)) for name in self.free]
        own = [p for i, piece in enumerate(self.pieces) for p in _own_parameters(i, piece)]
        return tuple(shared + own)

    @cached_property
    def columns(self) -> list[NDArray[np.intp]]:
        """Which parameters each piece depends on."""
        names = [p.name for p in self.parameters]
        shared = list(range(len(self.free)))
        return [
            np.array(shared + [k for k, n in enumerate(names) if n.endswith(f"[{i}]")])
            for i in range(len(self.pieces))
        ]

    def own(self, values: FloatArray, index: int) -> dict[str, float]:
        """A piece's own initial pressure, supply shift and atmosphere, Pa."""
        piece = self.pieces[index]
        found = {
            "initial": piece.initial,
            "supply_shift": piece.supply_shift,
            "atmosphere": piece.atmosphere,
        }
        for k in self.columns[index][len(self.free) :]:
            found[self.parameters[k].name.split("[")[0]] = float(values[k])
        return found

    def curve(self, values: FloatArray, index: int) -> FloatArray:
        """Simulated pressure of one piece, (n_i,) Pa."""
        own, piece = self.own(values, index), self.pieces[index]
        valve = self.start.with_numbers(self.free, values)
        return pressure_curve(
            piece.chamber,
            valve if piece.flow_control else valve.alone(),
            own["initial"],
            own["supply_shift"],
            own["atmosphere"],
        )

    def residuals(self, values: FloatArray) -> FloatArray:
        return np.concatenate(
            [self.curve(values, i) - p.pressure for i, p in enumerate(self.pieces)]
        )

    def jacobian(self, values: FloatArray) -> FloatArray:
        """Central differences, each piece over its own parameters only."""
        sizes = np.array([p.size for p in self.parameters])
        total = np.zeros((sum(self.lengths), len(values)))
        row = 0
        for index, length in enumerate(self.lengths):
            columns = self.columns[index]

            def curve(
                part: FloatArray, index: int = index, columns: NDArray[np.intp] = columns
            ) -> FloatArray:
                full = values.copy()
                full[columns] = part
                return self.curve(full, index)

            block = central_jacobian(curve, values[columns], sizes[columns])
            total[row : row + length, columns] = block
            row += length
        return total


def _shared_parameter(name: str, value: float) -> Parameter:
    unit = UNITS[name]
    if name in DELAYS:
        # A command's time stamp may be late; no valve takes as long as the upper bound. Seconds.
        low, high = -0.02, 0.3
        return Parameter(name, min(max(value, 0.9 * low), 0.9 * high), unit, low, high, 0.002)
    if name.startswith("critical_ratio"):
        return Parameter(name, value, unit, 0.0, HIGHEST_RATIO, 0.3)
    if name.startswith("subsonic_index"):
        return Parameter(name, value, unit, 0.2, 0.95)
    return Parameter(name, value, unit, value / 1e3, value * 1e3)


def _own_parameters(index: int, piece: Piece) -> list[Parameter]:
    found = []
    if piece.fits_initial:
        found.append(Parameter(f"initial[{index}]", piece.initial, "Pa"))
    if piece.fits_supply:
        found.append(
            Parameter(f"supply_shift[{index}]", piece.supply_shift, "Pa", scale=piece.supply)
        )
    if piece.fits_atmosphere:
        found.append(Parameter(f"atmosphere[{index}]", piece.atmosphere, "Pa"))
    return found


def fit_curves(
    pieces: Sequence[Piece],
    start: DiscreteValve,
    free: Sequence[str],
    tolerance: float = 1e-8,
) -> CurveFit:
    """Fit the free shared parameters and the pieces' own.

    `tolerance`: relative decrease of the sum of squares that ends the fit; over 10^4 rows, the
    default is far below the noise.
    """
    problem = CurveProblem(tuple(pieces), start, tuple(free))
    fit = minimise(
        problem.residuals,
        problem.parameters,
        jacobian=problem.jacobian,
        tolerance=tolerance,
        max_evaluations=100,
        polish=False,
    )
    return CurveFit(problem, fit)


def fitted_valve(found: CurveFit) -> DiscreteValve:
    """The valve at the minimum."""
    names = found.problem.free
    values: dict[str, Any] = {n: found.fit[n] for n in names}
    return dataclasses.replace(found.problem.start, **values)
