"""Effects' numbers: nonlinear least squares of the whitened equation error.

The base parameters are fitted along, each in the balance that it belongs to.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.actuator.equation_error import CHANNELS, channels_of
from sysid.diagnosis.actuator.projection import Projected
from sysid.diagnosis.actuator.signatures import base_jacobian, base_parameters, channel_of
from sysid.diagnosis.actuator.whitening import Frame
from sysid.estimation.nonlinear import LeastSquaresFit, Parameter, minimise
from sysid.plant.effects.entry import CatalogueEffect, Quantity, with_values
from sysid.plant.ports import Model
from sysid.plant.static_reading import as_read
from sysid.types import BoolArray, FloatArray

_EVALUATIONS = 20
# Slopes predict to within this share of what changes.
_PREDICTED = 0.3
_TOLERANCE = 1e-4
# One-sided differences: half the evaluations, and accurate enough for a fit to 1e-4.
_STEP = 1e-5
# A threshold acts in steps, pulse by pulse: its slope is that of a chord.
THRESHOLD_STEP = 0.05
_MOST_FACTOR = 5.0
_BASE_STEPS = 6
_MOST_STEP = 0.5
_SMALL_STEP = 1e-4
# Share of its column's length without effects that a base parameter must keep to be refitted.
_LEAST_REACH = 0.02


@dataclass(frozen=True)
class Refit:
    """Effects with their numbers fitted, and their share of a residual.

    `rest` (rows,) is the remainder; `fit`
    holds the effects' parameters by "id/name", in the effects' order, then the base
    parameters' factors. `chords` (rows, k + p): its slopes, of a threshold the chord from where its
    effect is absent.
    """

    effects: tuple[CatalogueEffect, ...]
    rest: FloatArray
    fit: LeastSquaresFit
    chords: FloatArray

    @property
    def free(self) -> BoolArray:
        """Which of the effects' numbers were fitted, (k,)."""
        count = sum(len(type(e).quantities) for e in self.effects)
        return np.array([p.lower < p.upper for p in self.fit.parameters[:count]])

    def own_slopes(self) -> FloatArray:
        """The slopes (rows, k) of the effects' numbers, the base parameters at their best."""
        return self._own(self.fit.jacobian)

    def own_chords(self, slopes: FloatArray) -> FloatArray:
        """The same of the `chords`; `slopes` (rows, k) are the `own_slopes`."""
        return slopes if self.chords is self.fit.jacobian else self._own(self.chords)

    def _own(self, columns: FloatArray) -> FloatArray:
        count = sum(len(type(e).quantities) for e in self.effects)
        own, base = columns[:, :count], columns[:, count:]
        size = np.linalg.norm(base, axis=0)
        base = base[:, size > 0.0] / size[size > 0.0]
        if base.shape[1]:
            own = own - base @ np.linalg.lstsq(base, own, rcond=1e-9)[0]
        return np.asarray(own)


def refit(base: Projected, starts: Sequence[CatalogueEffect], held: Collection[str] = ()) -> Refit:
    """Fit the effects' strengths and shapes from a start, in addition to the model's effects.

    The base parameters of the balances that the effects reach are fitted along: an effect that
    replaces a law changes their role. Numbers `held` ("id/name") stay.
    """
    equations = _Equations(base, starts, held)
    parameters, left = equations.from_best_base(), _EVALUATIONS
    while True:
        fit = minimise(
            equations.residuals,
            parameters,
            jacobian=equations.slopes,
            tolerance=_TOLERANCE,
            max_evaluations=left,
            polish=False,
        )
        fit = replace(fit, jacobian=equations.exact_slopes(fit.values))
        left -= fit.evaluations
        if left <= 0 or fit.next_fall() < _TOLERANCE:
            break
        parameters = [
            replace(p, value=float(v)) for p, v in zip(parameters, fit.values, strict=True)
        ]
    chords = equations.chords(fit.values, fit.jacobian)
    return Refit(equations.effects(fit.values), equations.rest(fit.values), fit, chords)


class _Equations:
    """The whitened errors of effects' numbers, with those of the base parameters along.

    `parameters` (k + p): the effects' numbers, then factors of the base parameters.
    """

    def __init__(
        self, base: Projected, starts: Sequence[CatalogueEffect], held: Collection[str]
    ) -> None:
        others = (*base.model.effects, *starts)
        self._base, self._starts = base, starts
        self._held = frozenset(held) | {
            f"{e.id}/{q.name}" for e in starts for q in type(e).quantities if q.is_choice
        }
        self._channels = tuple(
            c for c in CHANNELS if any(c in channels_of(e, others) for e in starts)
        )
        self._touched = base.frame.belongs(self._channels)
        self._names = [n for n in base_parameters(base.model) if channel_of(n) in self._channels]
        own = _own_parameters(starts, base.frame.traces.travel)
        self._count = len(own)
        self._shares = [share for e in starts for share in _steps(type(e).quantities)]
        self._shares += [_STEP] * len(self._names)
        self.parameters = [*own, *(_relative(n) for n in self._names)]
        # The last point with its errors, whitened and next to the extra columns; one with slopes,
        # and whether those of the base parameters are its own.
        self._last: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self._known: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self._is_exact = False
        self._held |= self._inert()
        self.parameters[: self._count] = [_held(p) if p.name in self._held else p for p in own]

    def _inert(self) -> frozenset[str]:
        """The numbers that show nothing, as gravity on a level rig or a share at rest: a solver
        would take them anywhere. A strength that acts alone was proposed because it shows."""
        asked = {
            f"{e.id}/{q.name}"
            for e in self._starts
            for q in type(e).quantities
            if (len(type(e).strengths()) > 1 if q.is_strength else len(q.grid) == 1)
            and not q.is_threshold
        }
        places = [i for i, p in enumerate(self.parameters[: self._count]) if p.name in asked]
        if not places:
            return frozenset()
        columns = self._columns(np.array([p.value for p in self.parameters]), places)
        shown = zip(places, columns.T, strict=True)
        return frozenset(self.parameters[i].name for i, column in shown if not column.any())

    def from_best_base(self) -> list[Parameter]:
        """The parameters with the base's where they suit the effects' start best, if they do better
        there than as they are: to leave them would make a large effect look wrong at first."""
        values = np.array([p.value for p in self.parameters])
        if not self._names:
            return self.parameters
        columns = self._columns(values, range(self._count, len(values)))
        step = np.linalg.lstsq(columns, -self.residuals(values), rcond=None)[0]
        moved = values.copy()
        moved[self._count :] += step
        limits = np.array([(p.lower, p.upper) for p in self.parameters])
        moved = np.clip(moved, *limits.T)
        before, after = (float(np.sum(self.residuals(v) ** 2)) for v in (values, moved))
        if not after < before:
            return self.parameters
        return [replace(p, value=float(v)) for p, v in zip(self.parameters, moved, strict=True)]

    def effects(self, values: FloatArray) -> tuple[CatalogueEffect, ...]:
        """The effects with their numbers."""
        return with_values(self._starts, values[: self._count])

    def residuals(self, values: FloatArray) -> FloatArray:
        """(rows,): 0 in the balances that no effect reaches.

        They would only add to the sum of squares, of which the fit's tolerance is a share: the
        noise of one balance would end the fit of another that is far off, and weighs little.
        """
        rest = self.rest(values)
        return rest if self._base.extra.shape[1] else np.where(self._touched, rest, 0.0)

    def rest(self, values: FloatArray) -> FloatArray:
        """(rows,): what is left in all balances."""
        return self._at(values)[1]

    def slopes(self, values: FloatArray) -> FloatArray:
        """(rows, k + p): those of the base parameters are a former point's while they predict.

        A rate is nearly proportional to them, and they are many.
        """
        if self._known is None:
            return self.exact_slopes(values)
        before, errors, columns = self._known
        here = self._at(values)[1]
        change = here - errors
        missed = change - columns @ (values - before)
        if not np.linalg.norm(missed) < _PREDICTED * np.linalg.norm(change):
            return self.exact_slopes(values)
        own = self._columns(values, range(self._count))
        self._known = (values.copy(), here, np.hstack([own, columns[:, self._count :]]))
        self._is_exact = False
        return self._known[2]

    def exact_slopes(self, values: FloatArray) -> FloatArray:
        """(rows, k + p)."""
        if self._is_exact and self._known and np.array_equal(self._known[0], values):
            return self._known[2]
        columns = self._columns(values, range(len(self.parameters)))
        self._known, self._is_exact = (values.copy(), self._at(values)[1], columns), True
        return columns

    def chords(self, values: FloatArray, slopes: FloatArray) -> FloatArray:
        """Slopes (rows, k + p) with those of thresholds replaced: pulse by pulse one is a step, or
        none, and says nothing of how much the effect explains in a test."""
        kinds = [q for e in self._starts for q in type(e).quantities]
        places = [i for i, q in enumerate(kinds) if q.is_threshold and values[i] != 0.0]
        if not places:
            return slopes
        here, found = self._at(values)[0], np.array(slopes)
        for i in places:
            absent = np.array(values)
            absent[i] = 0.0
            change = (here - self._whitened(absent, self._channels)) / values[i]
            found[:, i : i + 1] = self._base.without_extra(change[:, None])
        return found

    def _at(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The errors of a point, whitened and next to the extra columns, kept for its slopes."""
        if self._last is None or not np.array_equal(self._last[0], values):
            here = self._whitened(values, self._channels)
            errors = self._base.without_extra(np.where(self._touched, here, self._base.rest))
            self._last = (values.copy(), here, errors)
        return self._last[1:]

    def _columns(self, values: FloatArray, some: Sequence[int]) -> FloatArray:
        here, columns = self._at(values)[0], []
        for i in some:
            parameter = self.parameters[i]
            if parameter.name in self._held:
                columns.append(np.zeros(len(here)))
                continue
            step = self._shares[i] * max(abs(values[i]), 1e-2 * parameter.size)
            moved = np.array(values)
            moved[i] += step if values[i] + step <= parameter.upper else -step
            name = None if i < self._count else self._names[i - self._count]
            channels = self._channels if name is None else (channel_of(name),)
            change = self._whitened(moved, channels) - here
            change = np.where(self._base.frame.belongs(channels), change, 0.0)
            columns.append(change / (moved[i] - values[i]))
        return self._base.without_extra(np.column_stack(columns))

    def _whitened(self, values: FloatArray, channels: tuple[str, ...]) -> FloatArray:
        given = self._base.model
        factors = zip(self._names, values[self._count :], strict=True)
        changes = {n: getattr(given.parameters, n) * f for n, f in factors}
        effects = (*given.effects, *self.effects(values))
        model = Model(given.parameters.replace(**changes), effects)
        return self._base.frame.residual(model, channels)


def _steps(quantities: Sequence[Quantity]) -> list[float]:
    """Relative steps of an effect's numbers; next to a threshold a shape has no slope either."""
    in_steps = any(q.is_threshold for q in quantities)
    return [THRESHOLD_STEP if in_steps or q.jumps else _STEP for q in quantities]


def has_threshold(effect: CatalogueEffect) -> bool:
    """Whether one of an effect's strengths is a threshold."""
    return any(q.is_threshold for q in type(effect).quantities)


def _own_parameters(effects: Sequence[CatalogueEffect], travel: float) -> list[Parameter]:
    return [
        Parameter(
            f"{e.id}/{q.name}",
            float(np.clip(getattr(e, q.name), q.lower, q.upper)),
            q.unit,
            q.lower,
            q.upper,
            abs(q.typical) or q.upper,
        )
        for e in effects
        for q in type(e).within(travel) or type(e).quantities
    ]


def _held(parameter: Parameter) -> Parameter:
    """A parameter that stays at its start, and is still one of the fit's."""
    return replace(parameter, lower=parameter.value, upper=parameter.value)


def _relative(name: str) -> Parameter:
    """A base parameter relative to the bundle's value."""
    return Parameter(name, 1.0, "-", 1.0 / _MOST_FACTOR, _MOST_FACTOR, 1.0)


def with_base_refitted(base: Projected, model: Model) -> Model:
    """A model whose base parameters are refitted to the remaining residual: Gauss-Newton steps.

    `base` is the Jacobian without effects. Steps go on as long as they lower the residual, and
    stay within a factor of 5 of the original values. A parameter that keeps hardly any
    influence given an effect is not moved: its step would be arbitrary, and where the effect
    does not act (a flow that runs backwards) it still counts. Static friction, which no balance
    shows, is what the bench read, as the effects have it.
    """
    model = as_read(base.model, model)
    names = base_parameters(model)
    given = np.array([float(getattr(model.parameters, n)) for n in names])
    factors, best, least = np.ones(len(names)), model, math.inf
    for _ in range(_BASE_STEPS):
        residual = base.frame.residual(model)
        power = float(residual @ residual)
        if not power < least:
            break
        best, least = model, power
        step = linear_step(reaching_columns(base, base.frame, model, residual), residual)
        moved = factors * (1.0 + np.clip(step, -_MOST_STEP, _MOST_STEP))
        moved = np.clip(moved, 1.0 / _MOST_FACTOR, _MOST_FACTOR)
        if float(np.max(np.abs(moved / factors - 1.0))) < _SMALL_STEP:
            break
        factors = moved
        changes = dict(zip(names, (given * factors).tolist(), strict=True))
        model = Model(model.parameters.replace(**changes), model.effects)
    return best


def reaching_columns(
    base: Projected, frame: Frame, model: Model, residual: FloatArray
) -> FloatArray:
    """`base_jacobian` (rows, p) of a model with effects, 0 where hardly any influence remains.

    `base` is the model's without them, on any frame.
    """
    columns = base_jacobian(frame, model, residual, base_parameters(model))
    columns[:, np.linalg.norm(columns, axis=0) <= _LEAST_REACH * base.reach] = 0.0
    return columns


def linear_step(columns: FloatArray, residual: FloatArray) -> FloatArray:
    """The step (k,) along columns (rows, k) that reduces a residual (rows,) most.

    0 along a column of zeros.
    """
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = np.inf
    return np.asarray(-np.linalg.lstsq(columns / size, residual, rcond=1e-6)[0] / size)


def standard_errors(base: Projected, extra: FloatArray) -> dict[str, float]:
    """Standard errors of the base parameters, with `extra` columns (rows, k), in their units.

    From the remaining whitened squares, so that unexplained structure widens them. None of a
    parameter that no residual depends on.
    """
    names = base_parameters(base.model)
    jacobian = np.hstack([base_jacobian(base.frame, base.model, base.residual, names), extra])
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    spread = max(float(base.rest @ base.rest) / len(base.rest), 1.0)
    covariance = np.linalg.pinv((jacobian / size).T @ (jacobian / size), hermitian=True) * spread
    relative = np.sqrt(np.diag(covariance)) / size
    return {
        name: float(abs(getattr(base.model.parameters, name)) * relative[i])
        for i, name in enumerate(names)
        if jacobian[:, i].any()
    }


def own_columns(frame: Frame, model: Model) -> FloatArray:
    """Change of the residual with every parameter of the model's effects, (rows, k), in order.

    0 for a choice, which has no slope.
    """
    residual = frame.residual(model)
    columns = []
    for place, effect in enumerate(model.effects):
        assert isinstance(effect, CatalogueEffect)
        for q in type(effect).quantities:
            if q.is_choice:
                columns.append(np.zeros_like(residual))
                continue
            value = float(getattr(effect, q.name))
            share = THRESHOLD_STEP if q.is_threshold else 0.01
            move = share * (abs(value) or abs(q.typical) or 1.0)
            move = -move if value + move > q.upper else move
            changed = list(model.effects)
            changed[place] = replace(effect, **{q.name: value + move})  # type: ignore[type-var]
            other = frame.residual(Model(model.parameters, tuple(changed)))
            columns.append((other - residual) / move)
    return np.column_stack(columns)


def friction_given_effects(
    frame: Frame, model: Model, names: Sequence[str], rows: BoolArray
) -> tuple[tuple[tuple[int, str], ...], FloatArray, FloatArray, FloatArray]:
    """What some rows (rows,) of a frame say of friction's parameters, by these names, next to the
    effects of a model: as many equations at most as there are parameters, linear about it.

    The numbers (0 and a parameter's name, or an effect's place from 1 and a field), their values
    (k,), and the equations' slopes (n, k) and errors (n,), which are white and no more certain than
    what is left in the rows.
    """
    left = frame.residual(model)
    numbers = {(0, name): float(getattr(model.parameters, name)) for name in names}
    slopes = base_jacobian(frame, model, left, names) / list(numbers.values())
    for place, effect in enumerate(model.effects, start=1):
        assert isinstance(effect, CatalogueEffect)
        for q in type(effect).quantities:
            numbers[place, q.name] = math.nan if q.is_choice else float(getattr(effect, q.name))
    columns = np.column_stack([slopes, own_columns(frame, model), left])[rows]
    # The first rows of the factor hold all that depends on friction: one each, but for parameters
    # that the rows tell apart by rounding alone.
    factor = np.asarray(np.linalg.qr(columns, mode="r"))[: len(names)]
    own = factor[:, : len(factor)]
    rounding = math.sqrt(np.finfo(float).eps) * np.linalg.norm(own, axis=0)
    factor = factor[abs(np.diag(own)) > rounding]
    factor /= math.sqrt(max(float(np.mean(left[rows] ** 2)), 1.0))
    values = np.array(list(numbers.values()))
    return tuple(numbers), values, factor[:, :-1], factor[:, -1]
