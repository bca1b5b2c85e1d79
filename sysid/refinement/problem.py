"""Runs, the unknowns that they share, and their errors: simulated, with slopes, and whitened."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.estimation.autoregression import Autoregression
from sysid.io.channels import simulated_channels
from sysid.parallel import spend
from sysid.plant.differences import simulate_differences
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, overrides
from sysid.plant.preparation import Inputs
from sysid.plant.sensors import measured_channels, state_channels
from sysid.plant.simulator import MAX_STEP, Trajectory, simulate
from sysid.plant.static_reading import static_ratio
from sysid.plant.tangents import Direction, Tangents, number_of, simulate_tangents
from sysid.recording.simulation import after_run_ups
from sysid.refinement.factors import triangular_of_squares
from sysid.refinement.prior import BenchRows, prior_factor
from sysid.refinement.runs import STATES, Run
from sysid.refinement.unknowns import Unknown, model_at
from sysid.types import BoolArray, FloatArray, IntArray

LOCAL = len(STATES) + 2
"""A run's own unknowns: its start and its test's friction."""

SLIDING = ("coulomb_effort", "viscous")
_STATIC: Direction = (0, "static_effort")
# Step of a sensor's derivative, as a share of a state's usual size.
_SENSOR_STEP = 1e-6
# A simulation that did not stay finite counts as a residual of this many times the noise.
_NOT_FINITE_SIZE = 1e8
# Width of a coordinate that is held: far below any standard error.
_HELD = 1e-9
_SIZES = np.array([1.0, 10.0, 1e5, 1e5])
# Step of an effect's coordinate by which static friction follows the motor's effects; and the least
# share of its command that a motor is assumed to deliver.
_RATIO_STEP, _LEAST_RATIO = 1e-4, 0.1
# Least size of a number, as a share of its value, and the size of one without a value.
_LEAST_SIZE = 1e-3


@dataclass(frozen=True)
class Iterate:
    """Where a refinement is: `shared` (p,) unknowns in their coordinates, and what is local.

    `friction` (tests, 2): the logarithms of each test's sliding friction over the model's, and of
    its static friction over the bundle's, in units of the scatter.
    `starts` (runs, 4): start states about those estimated, in units of their errors.
    """

    shared: FloatArray
    friction: FloatArray
    starts: FloatArray


@dataclass(frozen=True)
class RunErrors:
    """A run at a point: `residual` (3, n), simulated less measured; `slopes` (k, 3, n).

    The slopes' order: start, friction of the run's test, shared unknowns; in their coordinates.
    `sliding` (k,): how much of the others the test's sliding friction is; None where it is no sum
    of them.
    """

    residual: FloatArray
    slopes: FloatArray
    sliding: FloatArray | None = None

    def kept(self, run: Run) -> RunErrors:
        """These residuals; large and with zero slopes if the simulation did not stay finite."""
        logged: Any = ~np.isnan(run.measured).any(axis=1)
        logged = slice(None) if logged.all() else logged  # nothing is copied then
        if np.isfinite(self.residual[logged]).all() and np.isfinite(self.slopes[:, logged]).all():
            return self
        far = np.where(np.isnan(run.measured), np.nan, _NOT_FINITE_SIZE * run.noise[:, None])
        return RunErrors(far, np.zeros_like(self.slopes))


@dataclass(frozen=True)
class Linearised:
    """A run's whitened equations: `factor`, triangular, over its start, its test's friction, the
    shared unknowns, and the residual; `cost` is the run's own, with its start's prior. `white` are
    the whitened slopes by logged channel.
    """

    factor: FloatArray
    cost: float
    saturated: float
    errors: RunErrors
    white: dict[int, WhiteSlopes]


class WhiteSlopes(NamedTuple):
    """A channel's whitened slopes (m, k), and their squares (k, k)."""

    columns: FloatArray
    squares: FloatArray


@dataclass(frozen=True)
class Problem:
    """Runs of several tests, the unknowns they share, and what their errors are like.

    `whitening` by run and channel; `scatter` the standard deviation of each test's sliding and
    static friction about the model's, relative. `robust`: each channel of a run has errors of a
    size of its own, at least the whitening's. `max_step` of the simulation, s; with `fine_step` it
    has the slopes alone, and the states are those of smaller steps. `by_differences`: slopes are
    differences of neighbouring simulations; else derivatives, by forward mode. `bench`: what the
    bench tests say of unknowns without a prior of their own.
    """

    runs: tuple[Run, ...]
    unknowns: tuple[Unknown, ...]
    model: Model
    position: str
    whitening: tuple[tuple[Autoregression, ...], ...]
    scatter: tuple[float, float]
    tests: int
    robust: bool = True
    max_step: float = MAX_STEP
    fine_step: float | None = None
    by_differences: bool = False
    bench: BenchRows | None = None

    def first_point(self) -> Iterate:
        """The initial point: the bundle's values, the model's friction, the estimated starts."""
        shared = np.array([u.start for u in self.unknowns])
        return Iterate(shared, np.zeros((self.tests, 2)), np.zeros((len(self.runs), 4)))

    def after_run_ups(self, point: Iterate) -> Problem:
        """The problem of the same runs, with the states of effects and sensors after the run-ups,
        simulated with the unknowns at a point.
        """
        run_ups = [run.run_up for run in self.runs]
        if not any(run_ups):
            return self
        measured = [run.as_measured or run.inputs for run in self.runs]
        inputs = after_run_ups(measured, run_ups, self.models(point), self.position)
        runs = [dataclasses.replace(r, inputs=i) for r, i in zip(self.runs, inputs, strict=True)]
        return dataclasses.replace(self, runs=tuple(runs))

    def members(self, test: int) -> list[int]:
        """The runs of a test, by number."""
        return [i for i, run in enumerate(self.runs) if run.test == test]

    def of_tests(self, tests: BoolArray) -> tuple[Problem, IntArray]:
        """The problem of some tests (tests,) alone, and the numbers of their runs."""
        numbers = np.array([i for i, run in enumerate(self.runs) if tests[run.test]], dtype=int)
        place = np.cumsum(tests) - 1
        runs = tuple(
            dataclasses.replace(self.runs[i], test=int(place[self.runs[i].test])) for i in numbers
        )
        white = tuple(self.whitening[i] for i in numbers)
        found = dataclasses.replace(self, runs=runs, whitening=white, tests=int(tests.sum()))
        return found, numbers

    def model_for(self, point: Iterate, test: int) -> Model:
        """The model at a point, with a test's own friction."""
        pairs = zip(self.unknowns, point.shared, strict=True)
        model = model_at(self.model, self.unknowns, np.array([u.at(c) for u, c in pairs]))
        sliding, static = np.exp(point.friction[test] * self.scatter)
        base = model.parameters
        return Model(
            base.replace(
                coulomb_effort=base.coulomb_effort * sliding,
                viscous=base.viscous * sliding,
                static_effort=self.model.parameters.static_effort * static,
            ),
            model.effects,
        )

    def models(self, point: Iterate) -> list[Model]:
        """Every run's model at a point."""
        by_test = [self.model_for(point, test) for test in range(self.tests)]
        return [by_test[run.test] for run in self.runs]

    def linearised(
        self, point: Iterate, slopes_of: Sequence[Linearised] | None = None
    ) -> list[Linearised]:
        """Every run's equations at a point. Raises OutOfBudgetError.

        With `slopes_of`, the equations at a point near it, the slopes are those: they cost many
        times what the simulation does.
        """
        models = self.models(point)
        inputs = self.inputs(point)
        if slopes_of is not None:
            spend()
            residuals = self._residuals(inputs, models)
            errors = [
                dataclasses.replace(known.errors, residual=residual).kept(run)
                for run, residual, known in zip(self.runs, residuals, slopes_of, strict=True)
            ]
            return self.equations(errors, point, slopes_of)
        directions = self._directions()
        spend(1 + len(directions))
        if self.by_differences:
            sizes = self.sizes(point, directions)
            found = simulate_differences(inputs, models, directions, sizes, self.max_step)
        else:
            found = simulate_tangents(inputs, models, directions, max_step=self.max_step)
        errors = [
            self._errors(run, own, model, point, directions)
            for run, own, model in zip(self.runs, found, models, strict=True)
        ]
        if self.fine_step is not None or self.model.has_remembering_sensor:
            # Slopes cost many times a simulation and need not be as exact.
            exact = self._measured(inputs, models)
            errors = [
                dataclasses.replace(own, residual=shown - run.measured).kept(run)
                for run, own, shown in zip(self.runs, errors, exact, strict=True)
            ]
        return self.equations(errors, point)

    def equations(
        self,
        errors: Sequence[RunErrors],
        point: Iterate,
        slopes_of: Sequence[Linearised] | None = None,
    ) -> list[Linearised]:
        """Every run's equations with the whitening of this problem, from its errors at a point.

        `slopes_of`: this problem's equations elsewhere, whose slopes are whitened already where
        the errors have the same.
        """
        known: Sequence[Linearised | None] = slopes_of or [None] * len(errors)
        pairs = enumerate(zip(errors, known, strict=True))
        return [self._equations(i, own, point, one) for i, (own, one) in pairs]

    def residuals(self, point: Iterate) -> list[FloatArray]:
        """Every run's (3, n), simulated less measured: rad or m, Pa. Raises OutOfBudgetError."""
        spend()
        return self._residuals(self.inputs(point), self.models(point))

    def _residuals(self, inputs: Sequence[Inputs], models: Sequence[Model]) -> list[FloatArray]:
        exact = self._measured(inputs, models)
        return [
            _without_slopes(run, shown).residual
            for run, shown in zip(self.runs, exact, strict=True)
        ]

    def _measured(self, inputs: Sequence[Inputs], models: Sequence[Model]) -> list[FloatArray]:
        """Every run as the sensors show it, (3, n)."""
        step = self.fine_step or self.max_step
        found = simulate(inputs, models, max_step=step, nan_if_endless=True)
        return [
            self._seen(run, own, model)
            for run, own, model in zip(self.runs, found, models, strict=True)
        ]

    def _seen(self, run: Run, found: Trajectory, model: Model) -> FloatArray:
        """A run's position and pressures (3, n) as the sensors show them."""
        inputs = run.inputs
        channels = measured_channels(found, self.position, model, inputs.elapsed, inputs.seen)
        return np.array([channels[n] for n in simulated_channels(self.position)])

    def errors_alone(self, run: Run, found: Trajectory, model: Model) -> RunErrors:
        """A run's errors, simulated less measured, without slopes."""
        return _without_slopes(run, self._seen(run, found, model))

    def inputs(self, point: Iterate) -> list[Inputs]:
        """Every run's inputs from its start at a point."""
        return [
            run.from_start(run.start + run.start_std * own)
            for run, own in zip(self.runs, point.starts, strict=True)
        ]

    @functools.cached_property
    def limits(self) -> FloatArray:
        """(p, 2): the least and the largest coordinate of each unknown."""
        return np.array([u.limits for u in self.unknowns]).reshape(-1, 2)

    def _directions(self) -> list[Direction]:
        """The directions simulated with derivatives: the unknowns, and each test's own friction."""
        directions = [u.direction for u in self.unknowns]
        return directions + [
            d for d in (*((0, n) for n in SLIDING), _STATIC) if d not in directions
        ]

    def sizes(self, point: Iterate, directions: Sequence[Direction]) -> list[float]:
        """The change of the number along each direction, in its unit, of about one coordinate."""
        own = {d: abs(number_of(self.model, d)) for d in directions}
        for unknown, c in zip(self.unknowns, point.shared, strict=True):
            d = unknown.direction
            if d in own:
                own[d] = max(abs(unknown.model_slope(float(c))), _LEAST_SIZE * own[d])
        return [own[d] or _LEAST_SIZE for d in directions]

    def _errors(
        self,
        run: Run,
        found: Tangents,
        model: Model,
        point: Iterate,
        directions: Sequence[Direction],
    ) -> RunErrors:
        states, slopes = self.shown(run, found, model, directions)
        first = len(STATES)
        by = {d: slopes[first + i] for i, d in enumerate(directions)}
        p = model.parameters
        sliding = by[0, "coulomb_effort"] * p.coulomb_effort + by[0, "viscous"] * p.viscous
        static = by[0, "static_effort"] * p.static_effort
        local = [*(slopes[:first] * run.start_std[:, None, None])]
        local += [sliding * self.scatter[0], static * self.scatter[1]]
        shared, parts = [], dict.fromkeys(SLIDING, np.zeros(0))
        for number, (unknown, c) in enumerate(zip(self.unknowns, point.shared, strict=True)):
            part, name = unknown.direction
            own = unknown.model_slope(float(c))
            if part == 0 and name in SLIDING:
                # A test's own friction multiplies the model's.
                own *= math.exp(float(point.friction[run.test, 0]) * self.scatter[0])
                parts[name] = np.zeros(LOCAL + len(self.unknowns))
                parts[name][LOCAL + number] = getattr(p, name) * self.scatter[0] / own
            elif (part, name) == _STATIC:
                own = 0.0  # each test has its own; the model's is their centre
            shared.append(by[unknown.direction] * own)
        of = np.sum(list(parts.values()), axis=0) if all(map(len, parts.values())) else None
        return RunErrors(states - run.measured, np.array([*local, *shared]), of).kept(run)

    def shown(
        self, run: Run, found: Tangents, model: Model, directions: Sequence[Direction]
    ) -> tuple[FloatArray, FloatArray]:
        """Position and pressures (3, n) as the sensors show them, and their slopes (k, 3, n).

        Through a model of the sensors the slopes are one-sided differences along the states'.
        """
        here = self._shown(run, found.states, model)
        names = state_channels(self.position)
        rows = [names.index(n) for n in simulated_channels(self.position) if n in names]
        if len(rows) == len(here) and not _has_sensors(model):
            return here, found.slopes[:, rows]
        slopes = []
        for j, slope in enumerate(found.slopes):
            direction = directions[j - len(STATES)] if j >= len(STATES) else (0, "")
            size = float(np.max(np.abs(slope / _SIZES[:, None])))
            step, moved = _SENSOR_STEP / size if size > 0.0 else math.inf, model
            if direction[0] and overrides(model.effects[direction[0] - 1], "measure"):
                step, moved = _sensor_moved(model, direction, step)
            if math.isinf(step):
                slopes.append(np.zeros_like(here))
                continue
            slopes.append((self._shown(run, found.states + step * slope, moved) - here) / step)
        return here, np.array(slopes)

    def _shown(self, run: Run, states: FloatArray, model: Model) -> FloatArray:
        """Position and pressures (3, n) as the sensors show states (4, n) at the run's rows."""
        return self._seen(run, Trajectory(run.inputs.time, *states), model)

    def _equations(
        self, number: int, errors: RunErrors, point: Iterate, known: Linearised | None
    ) -> Linearised:
        """A run's equations: its start's prior, and each logged channel's whitened errors.

        The cost of a channel with errors of a size of its own is n log(1 + chi2 / n), and its
        slope that of weighted squares.
        """
        count = errors.slopes.shape[0]
        prior = np.zeros((len(STATES), count + 1))
        prior[:, : len(STATES)], prior[:, -1] = np.eye(len(STATES)), point.starts[number]
        same = known is not None and known.errors.slopes is errors.slopes
        slopes = known.white if known is not None and same else self._slopes(number, errors)
        squares, saturated, weighted = prior.T @ prior, 0.0, []
        for channel, own in slopes.items():
            left = self._white(number, channel, errors.residual[None, channel])
            total, weight = float(left[:, 0] @ left[:, 0]), 1.0
            if self.robust:
                ratio = total / len(left)
                weight = 1.0 / (1.0 + ratio)
                saturated += len(left) * (math.log1p(ratio) - weight * ratio)
            squares[:count, :count] += weight * own.squares
            squares[:count, count:] += weight * (own.columns.T @ left)
            squares[count, count] += weight * total
            weighted.append((own.columns, left, math.sqrt(weight)))
        squares[count:, :count] = squares[:count, count:].T
        of = errors.sliding
        factor = triangular_of_squares(
            squares,
            lambda: [prior, *(np.hstack([s, r]) * weight for s, r, weight in weighted)],
            None if of is None else (len(STATES), np.append(of, 0.0)),
        )
        cost = float(factor[:, -1] @ factor[:, -1]) + saturated
        return Linearised(factor, cost, saturated, errors, slopes)

    def _slopes(self, number: int, errors: RunErrors) -> dict[int, WhiteSlopes]:
        found = {}
        for channel in np.flatnonzero(~np.isnan(errors.residual).any(axis=1)).tolist():
            columns = self._white(number, channel, errors.slopes[:, channel])
            found[channel] = WhiteSlopes(columns, columns.T @ columns)
        return found

    def _white(self, number: int, channel: int, rows: FloatArray) -> FloatArray:
        """Rows (k, n) of a channel of a run as whitened columns (m, k)."""
        independent = self.runs[number].independent(channel, rows.T)
        return self.whitening[number][channel].innovations(independent)

    def whitened(self, number: int, errors: RunErrors) -> Iterator[FloatArray]:
        """For each logged channel of a run its whitened derivatives and residual, (m, k + 1)."""
        for channel in np.flatnonzero(~np.isnan(errors.residual).any(axis=1)).tolist():
            rows = np.vstack([errors.slopes[:, channel], errors.residual[None, channel]])
            yield self._white(number, channel, rows)

    def friction_residual(self, point: Iterate) -> FloatArray:
        """(tests, 2): how far each test's friction is from the model's, in units of the scatter."""
        deviation = np.array(point.friction)
        if self.static_number is not None:
            deviation[:, 1] -= point.shared[self.static_number] / self.scatter[1]
        return deviation

    @functools.cached_property
    def static_number(self) -> int | None:
        """Which of the unknowns is static friction."""
        return next((i for i, u in enumerate(self.unknowns) if u.direction == _STATIC), None)

    def unseen_friction(self, point: Iterate) -> FloatArray | None:
        """The direction (p + 2 tests,) of the shared unknowns, then of each test's friction, along
        which no simulation changes; None if every direction changes one.

        The model's sliding friction grows as each test's own shrinks about it.
        """
        number = {u.direction: i for i, u in enumerate(self.unknowns)}
        found = np.zeros(len(self.unknowns) + 2 * self.tests)
        for name in SLIDING:
            i = number.get((0, name))
            if i is None:
                return None
            unknown, at = self.unknowns[i], float(point.shared[i])
            found[i] = unknown.at(at) / unknown.slope(at) * self.scatter[0]
        if not found[number[0, SLIDING[0]]]:
            return None
        found[len(self.unknowns) :: 2] = -1.0
        return found

    @property
    def knows_static(self) -> bool:
        """Whether static friction is fixed or has a prior from the bench tests."""
        number = self.static_number
        return number is None or self.unknowns[number].prior_std > 0.0

    @property
    def has_unknown_breakaway(self) -> bool:
        """Whether static friction is estimated without a prior."""
        number = self.static_number
        return number is not None and math.isnan(self.unknowns[number].std)

    def prior_cost(self, point: Iterate) -> float:
        """Prior cost of the unknowns and of the tests' friction about the model's."""
        deviation = self.prior(point.shared)[:, -1]
        return float(deviation @ deviation + np.sum(self.friction_residual(point) ** 2))

    def prior(self, shared: FloatArray) -> FloatArray:
        """Rows (p + n, p + 1) of the unknowns' joint prior and their residuals, zero without one;
        then those of the `bench` (n)."""
        centre, slopes = self._prior_centre(shared)
        factor = self._prior_factor
        rows = np.column_stack(
            [factor @ (np.eye(len(shared)) - slopes), factor @ (shared - centre)]
        )
        for i, unknown in enumerate(self.unknowns):
            if unknown.held_at is not None:
                rows[i] = 0.0
                rows[i, i] = 1.0 / _HELD
                rows[i, -1] = (shared[i] - unknown.held_at) / _HELD
        if self.bench is None:
            return rows
        return np.vstack([rows, self.bench.over(self.unknowns, shared)])

    def prior_residual(self, shared: FloatArray, number: int) -> float:
        """One unknown's distance from its marginal prior, in the prior's standard errors."""
        centre, _ = self._prior_centre(shared)
        return float(shared[number] - centre[number]) / self.unknowns[number].prior_std

    def _prior_centre(self, shared: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The quantities that the bench tests measured (p,), and their slopes (p, p).

        Static friction was measured as a commanded effort, so that it changes with the motor's
        effects.
        """
        centre = np.array([u.start for u in self.unknowns])
        slopes = np.zeros((len(centre), len(centre)))
        own, motor = self.static_number, self._motor_numbers
        if own is None or not motor:
            return centre, slopes
        ratio = self._static_ratio(shared)
        centre[own] += math.log(ratio / self._static_ratio(centre))
        for i in motor:
            sign = -1.0 if shared[i] + _RATIO_STEP > self.limits[i, 1] else 1.0
            moved = np.array(shared)
            moved[i] += sign * _RATIO_STEP
            slopes[own, i] = sign * math.log(self._static_ratio(moved) / ratio) / _RATIO_STEP
        return centre, slopes

    @functools.cached_property
    def _motor_numbers(self) -> list[int]:
        """The unknowns of effects of the motor."""
        effects = self.model.effects
        return [
            i
            for i, (part, _) in enumerate(u.direction for u in self.unknowns)
            if part and overrides(effects[part - 1], "motor_effort")
        ]

    def _static_ratio(self, shared: FloatArray) -> float:
        values = np.array([u.at(c) for u, c in zip(self.unknowns, shared, strict=True)])
        model = model_at(self.model, self.unknowns, values)
        told = float(self.model.parameters.static_effort)
        return max(static_ratio(model, told), _LEAST_RATIO)

    @functools.cached_property
    def _prior_factor(self) -> FloatArray:
        return prior_factor(self.unknowns)


def _has_sensors(model: Model) -> bool:
    return any(overrides(e, "measure") for e in model.effects)


def _without_slopes(run: Run, shown: FloatArray) -> RunErrors:
    left = shown - run.measured
    return RunErrors(left, np.zeros((0, *left.shape))).kept(run)


def _sensor_moved(model: Model, direction: Direction, step: float) -> tuple[float, Model]:
    """The step for an effect's number, and the model with it moved."""
    part, name = direction
    effects = list(model.effects)
    moved = effects[part - 1]
    value = float(getattr(moved, name))
    step = min(step, _SENSOR_STEP * max(abs(value), _SENSOR_STEP))
    if isinstance(moved, CatalogueEffect):
        own = next(q for q in type(moved).quantities if q.name == name)
        # No law need hold beyond a bound.
        step = -step if value + step > own.around(value)[1] else step
    effects[part - 1] = dataclasses.replace(moved, **{name: value + step})  # type: ignore[type-var]
    return step, Model(model.parameters, tuple(effects))


__all__ = ["LOCAL", "Iterate", "Linearised", "Problem", "RunErrors"]
