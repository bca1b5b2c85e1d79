"""Starting points of a fit with one more effect, and laws made of a fit's numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.bench.component import Component, Law, shapes
from sysid.diagnosis.thresholds import IMITATED, PROBE
from sysid.estimation.nonlinear import LeastSquaresFit, Parameter
from sysid.plant.effects.entry import CatalogueEffect, Quantity, with_values
from sysid.signals import strongest_waves
from sysid.types import FloatArray

# Tolerated deviation of the effect of four times a strength from four times its effect.
_BENT = 0.5
# Wave numbers that are tried of the residual's spectrum over the position.
_PEAKS = 3


def law_at(own: Sequence[Parameter], effects: Sequence[CatalogueEffect], values: FloatArray) -> Law:
    """The law at `values` (p,): its own parameters first, then the effects' in their order."""
    names = [p.name for p in own]
    return Law(
        dict(zip(names, map(float, values), strict=False)),
        with_values(effects, values[len(own) :]),
    )


def side_of(kind: type[CatalogueEffect], component: Component) -> dict[str, str]:
    """The side that an effect of this kind acts on here; nothing for one without a side."""
    return {"side": component.side()} if kind.has_side() else {}


def residuals_of(
    component: Component, laws: Sequence[Law], tests: Sequence[int]
) -> list[FloatArray]:
    """The residuals of each of several laws of one form, the tests end to end, (n,)."""
    return [np.concatenate(parts) for parts in component.residuals_of(laws, tests)]


def first_guesses(
    component: Component,
    fit: LeastSquaresFit,
    before: tuple[CatalogueEffect, ...],
    kind: type[CatalogueEffect],
    tests: Sequence[int],
) -> list[CatalogueEffect]:
    """Starting points of a fit with one more effect; several where it may have several minima.

    An effect that is not proportional to its strength (a heat flow that ends in isothermal
    air) is tried from its usual size too.
    """
    first = _start(component, fit, before, kind, tests)
    law = law_at(component.parameters(), before, fit.values)

    def at(scale: float) -> CatalogueEffect:
        return replace(first, **{q.name: scale * q.typical for q in kind.strengths()})  # type: ignore[type-var]

    if any(q.grid for q in kind.strengths()):
        return [first]
    probing = [Law(law.values, (*law.effects, at(scale * PROBE))) for scale in (1.0, 4.0)]
    small, large = (there - fit.residuals for there in residuals_of(component, probing, tests))
    bends = np.linalg.norm(large - 4.0 * small) > _BENT * np.linalg.norm(large)
    return [first, at(1.0), at(4.0)] if bends else [first]


def _start(
    component: Component,
    fit: LeastSquaresFit,
    before: tuple[CatalogueEffect, ...],
    kind: type[CatalogueEffect],
    tests: Sequence[int],
) -> CatalogueEffect:
    """The form of `kind` whose signature explains most of a fit's residual, at its size."""
    law = law_at(component.parameters(), before, fit.values)
    rest = fit.residuals
    basis = np.linalg.qr(fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300))[0]
    best, most = kind.neutral(**side_of(kind, component)), -1.0
    sizes = list(itertools.product(*(_probes(q) for q in kind.strengths())))
    every = shapes(_with_waves_of(rest, component, kind, tests))
    forms = [(shape, probes) for shape in every for probes in sizes]
    probing = [
        kind.neutral(**{**shape, **side_of(kind, component), q.name: size})
        for shape, probes in forms
        for q, size in zip(kind.strengths(), probes, strict=True)
    ]
    laws = [Law(law.values, (*law.effects, effect)) for effect in probing]
    changed = iter(residuals_of(component, laws, tests))
    for shape, probes in forms:
        columns = [next(changed) - rest for _ in probes]
        reduction, coefficients = _take(np.column_stack(columns), rest, basis, kind, probes)
        if reduction > most:
            fields = {
                q.name: c * size
                for q, c, size in zip(kind.strengths(), coefficients, probes, strict=True)
            }
            best = kind.neutral(**{**shape, **side_of(kind, component), **fields})
            most = reduction
    return best


def _with_waves_of(
    rest: FloatArray, component: Component, kind: type[CatalogueEffect], tests: Sequence[int]
) -> list[Quantity]:
    """An effect's quantities, a wave number's grid with those at which a residual (n,) peaks."""
    found = list(component.quantities_of(kind))
    columns = component.regressors(tests)
    place = columns.get("position", columns.get("angle"))
    if place is None or not any(q.is_wave for q in found):
        return found
    # A ripple of the motor changes its sign with the effort.
    changing = [rest * np.sign(columns["motor"])] if "motor" in columns else []

    def peaks(q: Quantity) -> list[float]:
        shown = [strongest_waves(place, r, q.lower, q.upper, _PEAKS) for r in (rest, *changing)]
        return list(itertools.chain.from_iterable(shown))

    return [replace(q, grid=(*q.grid, *peaks(q))) if q.is_wave else q for q in found]


def _probes(quantity: Quantity) -> tuple[float, ...]:
    return quantity.grid or (PROBE * quantity.typical,)


def _take(
    columns: FloatArray,
    rest: FloatArray,
    basis: FloatArray,
    kind: type[CatalogueEffect],
    probes: Sequence[float],
) -> tuple[float, FloatArray]:
    """How much columns (n, k) explain of `rest` (n,) beyond a basis; coefficients (k,)."""
    if not np.isfinite(columns).all():
        return -math.inf, np.zeros(columns.shape[1])
    own = columns - basis @ (basis.T @ columns)
    sizes = np.linalg.norm(columns, axis=0)
    keep = np.linalg.norm(own, axis=0) > IMITATED * np.maximum(sizes, 1e-300)
    coefficients = np.zeros(columns.shape[1])
    if keep.any():
        coefficients[keep] = -np.linalg.lstsq(own[:, keep], rest, rcond=1e-10)[0]
    thresholds = np.array([bool(q.grid) for q in kind.strengths()])
    coefficients = np.where(thresholds & keep, 1.0, coefficients)
    for i, (q, size) in enumerate(zip(kind.strengths(), probes, strict=True)):
        low, high = q.anywhere
        coefficients[i] = np.clip(coefficients[i] * size, low, high) / size
    left = rest + own @ coefficients
    return float(rest @ rest - left @ left), coefficients


__all__ = ["first_guesses", "law_at", "residuals_of", "side_of"]
