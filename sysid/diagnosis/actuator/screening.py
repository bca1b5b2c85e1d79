"""Which effects explain the residual: a score of every effect, calibrated on twins."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.diagnosis.actuator.signatures import (
    Candidate,
    Signatures,
    base_jacobian,
    base_parameters,
)
from sysid.diagnosis.actuator.whitening import Frame, friction_scatter
from sysid.diagnosis.looked import Book
from sysid.parallel import attempt_in_threads, spend
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.types import FloatArray

# Below this remaining share of its length a signature is one the base parameters can imitate.
_OWN_SHARE = 1e-3
# A form with a state takes as long as so many without.
_OF_A_STATE = 10


@dataclass(frozen=True)
class Projected:
    """A residual after projecting out everything that the model's own parameters explain.

    `residual` (rows,) is unprojected, `rest` (rows,) the remainder, `basis` (rows, m)
    orthonormal; `extra` (rows, k), also orthonormal, are its columns that do not belong to the
    base parameters. `reach` (p,): length of each base parameter's column.
    """

    frame: Frame
    model: Model
    residual: FloatArray
    basis: FloatArray
    rest: FloatArray
    extra: FloatArray
    reach: FloatArray

    def beside_extra(self, values: FloatArray) -> FloatArray:
        """`values` (rows,) or (rows, k) with `extra` projected out."""
        return values - self.extra @ (self.extra.T @ values)

    def project(self, values: FloatArray) -> FloatArray:
        """`values` (rows,) or (rows, k) with the basis projected out."""
        return values - self.basis @ (self.basis.T @ values)


def projected(frame: Frame, model: Model, extra: FloatArray | None = None) -> Projected:
    """The residual of a model, its base parameters (and `extra` columns) projected out."""
    residual = frame.residual(model)
    jacobian = base_jacobian(frame, model, residual, base_parameters(model))
    reach = np.linalg.norm(jacobian, axis=0)
    own = np.zeros((len(residual), 0))
    if extra is not None and extra.size:
        own = _orthonormal(extra)
        jacobian = np.hstack([jacobian, extra])
    basis = _orthonormal(jacobian)
    rest = residual - basis @ (basis.T @ residual)
    return Projected(frame, model, residual, basis, rest, own, reach)


def scatter_beside(frame: Frame, model: Model) -> float:
    """Relative spread of friction from test to test that a model leaves, one standard deviation."""
    plain = replace(frame, scatter=0.0)
    return friction_scatter(plain, projected(plain, model).rest)


def _orthonormal(columns: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns' span, (rows, rank)."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    if not scaled.size:
        return np.asarray(scaled)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])


@dataclass(frozen=True)
class Explained:
    """How much of a residual a candidate explains: a fall of the whitened sum of squares.

    `coefficients` (k,) in probing sizes. `probed`, `probed_gain`: the same with every limit
    and dead gap at the size that was probed; its effect is not proportional to it, so that
    half of its signature is not that of half its size.
    """

    candidate: Candidate
    gain: float
    coefficients: FloatArray
    probed: FloatArray
    probed_gain: float


def screen(base: Projected, forms: Sequence[Candidate], book: Book) -> list[Explained]:
    """Every form against a residual, in parallel on the machine's cores.

    Effects that cannot be screened are noted. Raises OutOfBudgetError.
    """
    # The forms of one effect stay together: those on both sides build on those on either.
    groups = [list(group) for _, group in itertools.groupby(forms, key=lambda f: f.id)]
    # What takes long begins first, so that no core waits for the last of them.
    longest = sorted(range(len(groups)), key=lambda i: -_cost(groups[i]))
    done = attempt_in_threads(partial(screen_group, base, groups[i]) for i in longest)
    tried = [one for _, one in sorted(zip(longest, done, strict=True), key=lambda pair: pair[0])]
    found = book.results([group[0].id for group in groups], tried)
    book.screened += [name for name, _ in found]
    spend(0)
    return [result for _, group in found for result in group]


def _cost(forms: Sequence[Candidate]) -> int:
    """How long an effect takes to screen, in forms without a state."""
    return len(forms) * (_OF_A_STATE if forms[0].effect.states else 1)


def screen_group(base: Projected, forms: Sequence[Candidate]) -> list[Explained]:
    """`screen` in this process."""
    signatures = Signatures(base.frame, base.model, base.residual)
    return [explained(base, form, signatures(form)) for form in forms]


def explained(base: Projected, candidate: Candidate, signature: FloatArray) -> Explained:
    """Least squares of the projected residual on a candidate's signature (rows, k).

    Strengths stay within their bounds: one that would have to leave them counts as absent.
    """
    columns = base.project(signature)
    sizes = np.linalg.norm(signature, axis=0)
    quantities = candidate.effect.strengths()
    steps = np.array([step for _, step in candidate.steps])
    # In probing sizes, which may be negative.
    limits = [(q.lower / step, q.upper / step) for q, step in zip(quantities, steps, strict=True)]
    low, high = np.sort(limits, axis=1).T
    keep = np.linalg.norm(columns, axis=0) > _OWN_SHARE * np.maximum(sizes, 1e-300)
    coefficients = np.zeros(len(steps))
    while keep.any():
        used = columns[:, keep]
        found = -np.linalg.lstsq(used, base.rest, rcond=1e-10)[0]
        limited = np.clip(found, low[keep], high[keep])
        wrong = (limited == 0.0) & (found != 0.0)
        if not wrong.any():
            coefficients[keep] = limited
            break
        keep[np.flatnonzero(keep)[wrong]] = False
    probed = np.where([bool(q.grid) for q in quantities], 1.0, coefficients)

    def gain(strengths: FloatArray) -> float:
        left = base.rest + columns @ strengths
        return float(base.rest @ base.rest - left @ left)

    return Explained(candidate, max(gain(coefficients), 0.0), coefficients, probed, gain(probed))


def best_by_effect(results: Sequence[Explained]) -> dict[str, Explained]:
    """The candidate of each effect that explains most, in descending order."""
    best: dict[str, Explained] = {}
    for result in results:
        known = best.get(result.candidate.id)
        if known is None or result.gain > known.gain:
            best[result.candidate.id] = result
    return dict(sorted(best.items(), key=lambda item: -item[1].gain))


def starting_points(results: Sequence[Explained]) -> dict[str, list[CatalogueEffect]]:
    """Where refits of each effect begin: its form that gains most as probed.

    Where that acts on one side, the best form on both sides too: an effect that is proportional
    on one side need not be so on the other.
    """
    ranked = sorted(results, key=lambda r: -r.probed_gain)
    found: dict[str, list[CatalogueEffect]] = {}
    for result in ranked:
        chosen = dict(result.candidate.shape).get("side")
        known = found.setdefault(result.candidate.id, [])
        if not known or (chosen == "both" and all(_side(e) != "both" for e in known)):
            known.append(result.candidate.with_strengths(list(result.probed)))
    return found


def _side(effect: CatalogueEffect) -> str:
    return str(getattr(effect, "side", "both"))


__all__ = [
    "Explained",
    "Projected",
    "best_by_effect",
    "projected",
    "scatter_beside",
    "screen",
    "starting_points",
]
