"""A part's law fitted on some of its tests, with effects of given kinds beside it."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid._autocovariance import runs_of, tapered_autocovariance
from sysid.components.component import PROBE, Component, Law, shapes
from sysid.estimation import Estimate
from sysid.least_squares import LeastSquaresFit, Parameter, minimise
from sysid.model.effects.entry import CatalogueEffect, Quantity

FloatArray = NDArray[np.float64]

_EVALUATIONS = 30
_SIZED = {"N", "Nm", "kg", "W"}
_TOLERANCE = 1e-7
# Share by which four times a strength may miss four times its effect.
_BENT = 0.5
# Below this share of its length a signature is what the law's own parameters can do as well.
_OWN_SHARE = 1e-3


@dataclass(frozen=True)
class Fitted:
    """A law fitted on the tests of `component` whose indices are `tests`."""

    component: Component
    tests: tuple[int, ...]
    law: Law
    fit: LeastSquaresFit

    def estimates(self, effect: CatalogueEffect) -> dict[str, Estimate]:
        """An effect's numbers by field, intervals for residuals that follow one another."""
        return {
            q.name: self.fit.estimate(_key(type(effect), q), self._covariance)
            for q in type(effect).quantities
        }

    def base_estimates(self) -> dict[str, Estimate]:
        """The law's own parameters by name, likewise."""
        own = self.component.parameters()
        return {p.name: self.fit.estimate(p.name, self._covariance) for p in own}

    def p_value(self, without: Fitted) -> float:
        """Whether what this fit has beyond `without` is nothing: F test of nested models.

        Residuals that follow one another count for as many as are independent. Wald's test
        fails where a strength's shape makes it much like the law's own parameters.
        """
        from scipy.special import fdtrc

        more = len(self.fit.values) - len(without.fit.values)
        left = self.independent_samples - len(self.fit.values)
        if left < 1.0:
            return 1.0
        ratio = without.fit.sum_of_squares / max(self.fit.sum_of_squares, 1e-300)
        return max(float(fdtrc(more, left, max(ratio - 1.0, 0.0) * left / more)), 1e-300)

    @property
    def independent_samples(self) -> float:
        """As many as say as much of a mean as the residuals that follow one another do."""
        gamma = tapered_autocovariance(
            self.fit.residuals, runs_of(len(self.fit.residuals), self._groups), self.fit.dof
        )
        spread = float(gamma[0] + 2.0 * np.sum(gamma[1:]))
        return len(self.fit.residuals) * min(float(gamma[0]) / max(spread, 1e-300), 1.0)

    @cached_property
    def _covariance(self) -> FloatArray:
        return self.fit.correlated_covariance(self._groups)

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
) -> Fitted:
    """Least squares of the law's own parameters and of effects of these kinds, together.

    Shapes start where the grid's best is, strengths where that form's signature puts them;
    effects that `near`, a law that was fitted before, holds already start from there.
    """
    own = component.parameters()
    starts: list[CatalogueEffect] = []
    if near is not None:
        own = [
            Parameter(p.name, near.values[p.name], p.unit, p.lower, p.upper, p.size) for p in own
        ]
        starts = list(near.effects)
    fit = _minimise(component, own, tuple(starts), tests)
    starts = list(_effects_at(starts, fit.values[len(own) :]))
    for kind in kinds[len(starts) :]:
        trials = [
            _minimise(component, _moved(own, fit), (*starts, first), tests)
            for first in _first_guesses(component, fit, tuple(starts), kind, tests)
        ]
        best = min(range(len(trials)), key=lambda i: trials[i].sum_of_squares)
        fit = trials[best]
        starts = list(
            _effects_at((*starts, kind.neutral(**_side(kind, component))), fit.values[len(own) :])
        )
    return Fitted(component, tuple(tests), _law(own, starts, fit.values), fit)


def _law(own: Sequence[Parameter], effects: Sequence[CatalogueEffect], values: FloatArray) -> Law:
    """The law at `values` (p,): its own parameters first, then the effects' in their order."""
    names = [p.name for p in own]
    return Law(
        dict(zip(names, map(float, values), strict=False)),
        _effects_at(effects, values[len(own) :]),
    )


def _key(kind: type[CatalogueEffect], quantity: Quantity) -> str:
    return f"{kind.id}/{quantity.name}"


def _moved(own: Sequence[Parameter], fit: LeastSquaresFit) -> list[Parameter]:
    """The law's own parameters, starting where another fit left them."""
    return [
        Parameter(p.name, float(v), p.unit, p.lower, p.upper, p.size)
        for p, v in zip(own, fit.values, strict=False)
    ]


def _effect_parameters(effects: Sequence[CatalogueEffect]) -> list[Parameter]:
    return [
        Parameter(
            _key(type(e), q),
            float(np.clip(getattr(e, q.name), *_bounds(q))),
            q.unit,
            *_bounds(q),
            abs(getattr(e, q.name)) or abs(q.typical),
        )
        for e in effects
        for q in type(e).quantities
    ]


def _bounds(quantity: Quantity) -> tuple[float, float]:
    """Its own bounds; of a strength in efforts, flows or heats its sign alone.

    Parts come in all sizes, but a sensor's delay or an exponent is what it is on any rig.
    """
    units = set(re.findall(r"[A-Za-z]+", quantity.unit))
    if not quantity.is_strength or not units & _SIZED:
        return quantity.lower, quantity.upper
    return (-math.inf if quantity.lower < 0.0 else 0.0), math.inf


def _effects_at(
    effects: Sequence[CatalogueEffect], values: FloatArray
) -> tuple[CatalogueEffect, ...]:
    found, place = [], 0
    for effect in effects:
        fields: dict[str, Any] = {}
        for q in type(effect).quantities:
            fields[q.name] = float(values[place])
            place += 1
        if type(effect).has_side():
            fields["side"] = getattr(effect, "side")  # noqa: B009
        found.append(type(effect)(**fields))
    return tuple(found)


def _minimise(
    component: Component,
    own: Sequence[Parameter],
    effects: Sequence[CatalogueEffect],
    tests: Sequence[int],
) -> LeastSquaresFit:

    def residuals(values: FloatArray) -> FloatArray:
        return np.concatenate(component.residuals(_law(own, effects, values), tests))

    everything = [*own, *_effect_parameters(effects)]
    start = np.array([p.value for p in everything])
    here = residuals(start)

    def acts(i: int) -> bool:
        moved = start.copy()
        step = 1e-3 * everything[i].size
        moved[i] += step if start[i] + step <= everything[i].upper else -step
        return bool(np.any(residuals(moved) != here))

    # What has no influence stays put: it would run away and take the trust region along.
    free = [i for i in range(len(everything)) if i < len(own) or acts(i)]

    def of_free(values: FloatArray) -> FloatArray:
        full = start.copy()
        full[free] = values
        return residuals(full)

    fit = minimise(
        of_free,
        [everything[i] for i in free],
        tolerance=_TOLERANCE,
        max_evaluations=_EVALUATIONS,
        polish=False,
    )
    values, jacobian = start.copy(), np.zeros((len(here), len(everything)))
    values[free], jacobian[:, free] = fit.values, fit.jacobian
    return replace(fit, parameters=tuple(everything), values=values, jacobian=jacobian)


def _first_guesses(
    component: Component,
    fit: LeastSquaresFit,
    before: tuple[CatalogueEffect, ...],
    kind: type[CatalogueEffect],
    tests: Sequence[int],
) -> list[CatalogueEffect]:
    """Where a fit with one effect more begins; several where it may have several minima.

    An effect that is not proportional to its strength (a heat flow that ends in isothermal
    air) is tried from its usual size too.
    """
    first = _start(component, fit, before, kind, tests)
    law = _law(component.parameters(), before, fit.values)

    def at(scale: float) -> CatalogueEffect:
        return replace(first, **{q.name: scale * q.typical for q in kind.strengths()})  # type: ignore[type-var]

    def change(scale: float) -> FloatArray:
        changed = component.residuals(Law(law.values, (*law.effects, at(scale))), tests)
        return np.concatenate(changed) - fit.residuals

    if any(q.grid for q in kind.strengths()):
        return [first]
    small, large = change(PROBE), change(4.0 * PROBE)
    bends = np.linalg.norm(large - 4.0 * small) > _BENT * np.linalg.norm(large)
    return [first, at(1.0), at(4.0)] if bends else [first]


def _start(
    component: Component,
    fit: LeastSquaresFit,
    before: tuple[CatalogueEffect, ...],
    kind: type[CatalogueEffect],
    tests: Sequence[int],
) -> CatalogueEffect:
    """The form of `kind` whose signature takes most of what a fit left, at its size."""
    law = _law(component.parameters(), before, fit.values)
    rest = fit.residuals
    basis = np.linalg.qr(fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300))[0]
    best, most = kind.neutral(**_side(kind, component)), -1.0
    for shape in shapes(kind):
        for probes in itertools.product(*(_probes(q) for q in kind.strengths())):
            columns = []
            for q, size in zip(kind.strengths(), probes, strict=True):
                effect = kind.neutral(**{**shape, **_side(kind, component), q.name: size})
                changed = component.residuals(Law(law.values, (*law.effects, effect)), tests)
                columns.append(np.concatenate(changed) - rest)
            gain, coefficients = _take(np.column_stack(columns), rest, basis, kind, probes)
            if gain > most:
                fields = {
                    q.name: c * size
                    for q, c, size in zip(kind.strengths(), coefficients, probes, strict=True)
                }
                best = kind.neutral(**{**shape, **_side(kind, component), **fields})
                most = gain
    return best


def _probes(quantity: Quantity) -> tuple[float, ...]:
    return quantity.grid or (PROBE * quantity.typical,)


def _side(kind: type[CatalogueEffect], component: Component) -> dict[str, str]:
    return {"side": component.side()} if kind.has_side() else {}


def _take(
    columns: FloatArray,
    rest: FloatArray,
    basis: FloatArray,
    kind: type[CatalogueEffect],
    probes: Sequence[float],
) -> tuple[float, FloatArray]:
    """What columns (n, k) take of `rest` (n,) beside a basis, and their coefficients (k,)."""
    own = columns - basis @ (basis.T @ columns)
    sizes = np.linalg.norm(columns, axis=0)
    keep = np.linalg.norm(own, axis=0) > _OWN_SHARE * np.maximum(sizes, 1e-300)
    coefficients = np.zeros(columns.shape[1])
    if keep.any():
        coefficients[keep] = -np.linalg.lstsq(own[:, keep], rest, rcond=1e-10)[0]
    thresholds = np.array([bool(q.grid) for q in kind.strengths()])
    coefficients = np.where(thresholds & keep, 1.0, coefficients)
    for i, (q, size) in enumerate(zip(kind.strengths(), probes, strict=True)):
        low, high = _bounds(q)
        coefficients[i] = np.clip(coefficients[i] * size, low, high) / size
    left = rest + own @ coefficients
    return float(rest @ rest - left @ left), coefficients


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


__all__ = ["Fitted", "cross_validated", "fit_law"]
