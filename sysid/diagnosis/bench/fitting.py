"""A part's law fitted on some of its tests, together with effects of given kinds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.starting_points import (
    first_guesses,
    law_at,
    residuals_of,
    side_of,
)
from sysid.diagnosis.search import shapes_at_limits
from sysid.errors import NotIdentifiedError
from sysid.estimation.autocovariance import error_model
from sysid.estimation.covariance import Covariance
from sysid.estimation.linear import Estimate
from sysid.estimation.nested import nested_p_value
from sysid.estimation.nonlinear import (
    Bounded,
    LeastSquaresFit,
    Parameter,
    central_jacobian_of_all,
    central_points,
    central_slopes,
    minimise,
)
from sysid.estimation.quality import FitQuality, repeated_scatter, repeats_test, scatter_test
from sysid.parallel import spend
from sysid.parameters import Parts
from sysid.plant.effects.entry import CatalogueEffect, Quantity, with_values
from sysid.types import FloatArray


@dataclass(frozen=True)
class FittedLaw:
    """A law fitted on the tests of `component` whose indices are `tests`."""

    component: Component
    tests: tuple[int, ...]
    law: Law
    fit: LeastSquaresFit

    @staticmethod
    def of(
        component: Component,
        kinds: Sequence[type[CatalogueEffect]],
        tests: Sequence[int],
        fit: LeastSquaresFit,
    ) -> FittedLaw:
        """The result of a fit of effects of these kinds, its numbers put back into the law."""
        effects = [kind.neutral(**side_of(kind, component)) for kind in kinds]
        law = law_at(component.parameters(), effects, fit.values)
        return FittedLaw(component, tuple(tests), law, fit)

    def estimates(self, effect: CatalogueEffect) -> dict[str, Estimate]:
        """An effect's numbers by field, save for choices.

        Intervals allow for correlated residuals, and for numbers that differ from test to test.
        """
        fitted = [q for q in self.component.quantities_of(type(effect)) if not q.is_choice]
        return {q.name: self._estimate(_key(type(effect), q)) for q in fitted}

    def base_estimates(self) -> dict[str, Estimate]:
        """The law's own parameters by name, likewise."""
        own = self.component.parameters()
        return {p.name: self._estimate(p.name) for p in own}

    def _estimate(self, name: str) -> Estimate:
        """A number with its interval, which ends where the number cannot be."""
        found = self._bounded.estimate(name, self._covariance)
        own = next(p for p in self.fit.parameters if p.name == name)
        return found.within(own.lower, own.upper)

    def part(self) -> Parts:
        """The law's section of a bundle, with how well it follows its tests."""
        return self.component.part(self.base_estimates(), self.quality())

    def quality(self) -> FitQuality:
        """How well the law, with its effects, follows its tests."""
        component = self.component.judged()
        residuals = np.concatenate(component.residuals(self.law, self.tests))
        found = FitQuality.of(
            component.channel,
            component.unit,
            np.concatenate(component.measured(self.tests)),
            residuals,
            has_constant=component.has_constant,
        )
        cells = component.repeats()
        if cells is not None and len(cells) == len(residuals):
            test = repeats_test(residuals, cells, len(self.fit.values))
            return replace(found, lack_of_fit=test, scatter=repeated_scatter(residuals, cells))
        floor = component.noise_floor(self.law)
        if not floor > 0.0:
            return found
        return replace(found, lack_of_fit=scatter_test(found.rmse, floor), scatter=floor)

    def p_value(self, without: FittedLaw) -> float:
        """p-value of what this fit has beyond `without`: F test of nested models.

        Correlated residuals count by their first two moments (`sysid.estimation.nested`). Wald's
        test fails where a strength's shape makes it much like the law's own parameters.
        """
        fit, less = self.fit, {p.name for p in without.fit.parameters}
        more = np.array([p.name not in less for p in fit.parameters])
        squares = without.fit.sum_of_squares, fit.sum_of_squares
        found = nested_p_value(squares, fit.jacobian, fit.residuals, more, self._groups)
        return max(found, 1e-300)

    @property
    def is_plausible(self) -> bool:
        """Whether the tests do not drive the last effect's strength to the limit of its size."""
        kind = type(self.law.effects[-1])
        stuck = [q for q in kind.strengths() if _key(kind, q) in self.fit.diagnosis.at_bound]
        return not any(getattr(self.law.effects[-1], q.name) for q in stuck)

    @property
    def limits(self) -> tuple[str, ...]:
        """The last effect's shapes that ended at a limit of their range: what the tests show lies
        beyond the forms that it can take."""
        return shapes_at_limits(self.law.effects[-1], self.fit.diagnosis.at_bound)

    @property
    def independent_samples(self) -> float:
        """Number of independent residuals equivalent to the correlated ones, for a mean."""
        # The residuals as they are: what the fit took out counts as its parameters.
        nothing = np.zeros((len(self.fit.residuals), 0))
        errors = error_model(nothing, self.fit.residuals, self._groups)
        return errors.independent_samples(np.unique_counts(self._groups).counts.tolist())

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """The parameters whose value is a bound: what the tests want beyond it is noise."""
        return tuple(self._bounded.steps)

    @cached_property
    def _bounded(self) -> Bounded:
        return self.fit.at_bound_by_noise(self._covariance_of, self.component.attained)

    @cached_property
    def _covariance(self) -> Covariance:
        return self._covariance_of(self._bounded.fit)

    def _covariance_of(self, fit: LeastSquaresFit) -> Covariance:
        """By the correlation within tests, or by what differs between them if that gives more."""
        within = fit.correlated_covariance(self._groups)
        return within.at_least(fit.clustered_covariance(self._groups))

    @cached_property
    def _groups(self) -> NDArray[np.intp]:
        """Which test each residual belongs to, (n,)."""
        parts = self.component.residuals(self.law, self.tests)
        return np.repeat(np.arange(len(parts)), [len(part) for part in parts])


def fit_law(
    component: Component,
    kinds: Sequence[type[CatalogueEffect]],
    tests: Sequence[int],
    near: Law | None = None,
) -> FittedLaw:
    """Least squares of the law's own parameters and of effects of these kinds, together.

    Shapes start at the grid's best, strengths where that form's signature puts them; effects
    that `near`, a law fitted before, already holds start from there.
    """
    own = component.parameters()
    starts: list[CatalogueEffect] = []
    if near is not None:
        own = [
            Parameter(p.name, near.values[p.name], p.unit, p.lower, p.upper, p.size) for p in own
        ]
        starts = list(near.effects)
    fit = _minimise(component, own, tuple(starts), tests)
    starts = list(with_values(starts, fit.values[len(own) :]))
    for kind in kinds[len(starts) :]:
        trials = [
            _minimise(component, _moved(own, fit), (*starts, first), tests)
            for first in first_guesses(component, fit, tuple(starts), kind, tests)
            if _is_simulated(component, _moved(own, fit), (*starts, first), tests)
        ]
        if not trials:
            raise NotIdentifiedError(f"{kind.id} cannot be simulated on these tests")
        best = min(range(len(trials)), key=lambda i: trials[i].sum_of_squares)
        fit = trials[best]
        starts = list(
            with_values((*starts, kind.neutral(**side_of(kind, component))), fit.values[len(own) :])
        )
    return FittedLaw.of(component, kinds, tests, fit)


def _is_simulated(
    component: Component,
    own: Sequence[Parameter],
    effects: Sequence[CatalogueEffect],
    tests: Sequence[int],
) -> bool:
    """Whether a fit can start here: all residuals are numbers."""
    law = Law({p.name: p.value for p in own}, tuple(effects))
    return all(np.isfinite(part).all() for part in component.residuals(law, tests))


def _key(kind: type[CatalogueEffect], quantity: Quantity) -> str:
    return f"{kind.id}/{quantity.name}"


def _moved(own: Sequence[Parameter], fit: LeastSquaresFit) -> list[Parameter]:
    """The law's own parameters, starting where another fit left them."""
    return [
        Parameter(p.name, float(v), p.unit, p.lower, p.upper, p.size)
        for p, v in zip(own, fit.values, strict=False)
    ]


def _bounds(quantity: Quantity, value: float) -> tuple[float, float]:
    """Those of a fit: a strength may have any size, a shape what these tests can show, and no fit
    moves a choice."""
    if quantity.is_choice:
        return value, value
    return quantity.anywhere if quantity.is_strength else (quantity.lower, quantity.upper)


def _effect_parameters(component: Component, effects: Sequence[CatalogueEffect]) -> list[Parameter]:
    return [
        _parameter(_key(type(e), q), q, float(getattr(e, q.name)))
        for e in effects
        for q in component.quantities_of(type(e))
    ]


def _parameter(key: str, quantity: Quantity, value: float) -> Parameter:
    low, high = _bounds(quantity, value)
    size = abs(value) or abs(quantity.typical)
    return Parameter(key, float(np.clip(value, low, high)), quantity.unit, low, high, size)


def _minimise(
    component: Component,
    own: Sequence[Parameter],
    effects: Sequence[CatalogueEffect],
    tests: Sequence[int],
) -> LeastSquaresFit:
    everything = [*own, *_effect_parameters(component, effects)]
    start = np.array([p.value for p in everything])

    def residuals(points: Sequence[FloatArray]) -> list[FloatArray]:
        spend()
        return residuals_of(component, [law_at(own, effects, point) for point in points], tests)

    def moved(i: int) -> FloatArray:
        step = 1e-3 * everything[i].size
        upwards = start[i] + step <= everything[i].upper
        point = start.copy()
        point[i] += step if upwards else -step
        return point

    mine, added = range(len(own)), range(len(own), len(start))
    here, *there = residuals([start, *map(moved, added)])
    # Parameters without influence are held: they would run away and take the trust region along.
    acting = [i for i, values in zip(added, there, strict=True) if np.any(values != here)]
    free = [*mine, *acting]

    def of_free(points: Sequence[FloatArray]) -> list[FloatArray]:
        full = np.tile(start, (len(points), 1))
        full[:, free] = points
        return residuals(list(full))

    sizes, lower, upper = (
        np.array([getattr(everything[i], name) for i in free])
        for name in ("size", "lower", "upper")
    )
    last: tuple[FloatArray, FloatArray] | None = None

    def residuals_at(values: FloatArray) -> FloatArray:
        """And, of a part that simulates many laws for the price of one, the slopes as well."""
        nonlocal last
        if not component.takes_laws_at_once:
            return of_free([values])[0]
        points = central_points(values, sizes, lower, upper)
        here, *around = of_free([values, *points])
        last = values.copy(), central_slopes(points, around)
        return here

    def jacobian(values: FloatArray) -> FloatArray:
        full = start.copy()
        full[free] = values
        exact = component.jacobian(law_at(own, effects, full), tests)
        if exact is not None:
            slopes = exact[:, free]
        elif last is not None and np.array_equal(last[0], values):
            spend()
            slopes = last[1]
        else:
            slopes = central_jacobian_of_all(of_free, values, sizes, lower, upper)
        # Where a neighbour cannot be simulated, the number is held.
        return np.where(np.isfinite(slopes), slopes, 0.0)

    fit = minimise(
        residuals_at,
        [everything[i] for i in free],
        jacobian=jacobian,
        tolerance=1e-7,
        max_evaluations=30,
        polish=False,
    )
    values, slopes = start.copy(), np.zeros((len(here), len(everything)))
    values[free], slopes[:, free] = fit.values, fit.jacobian
    return replace(
        fit,
        parameters=tuple(everything),
        values=values,
        jacobian=slopes,
        taken_out=component.taken_out(tests),
    )


def cross_validated(
    component: Component,
    kinds: Sequence[type[CatalogueEffect]],
    folds: Sequence[Sequence[int]],
    near: Law | None = None,
) -> FloatArray:
    """Mean square of the prediction of each fold's tests by a fit on the others, (folds,).

    `near`: a fit on all of them, from which those on the others start.
    """
    found = []
    everything = range(len(component.tests))
    for fold in folds:
        others = [t for t in everything if t not in fold]
        law = fit_law(component, kinds, others, near).law
        values = np.concatenate(component.residuals(law, list(fold)))
        found.append(float(np.mean(values**2)))
    return np.array(found)


__all__ = ["FittedLaw", "cross_validated", "fit_law"]
