"""Models drawn from the distribution of the fitted numbers' errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import NotIdentifiedError
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.parameters.scatter import friction_scatter
from sysid.plant.ports import Model
from sysid.refinement.prior import prior_factor
from sysid.refinement.unknowns import Unknown, model_at, unknowns_of
from sysid.types import FloatArray


@dataclass(frozen=True)
class PosteriorDraws:
    """Models about a bundle's, `models` (n,), with the `values` (n, k) of its numbers `names`.

    `held`: names of fitted numbers that keep the bundle's value, as their error is not known.
    """

    models: tuple[Model, ...]
    names: tuple[str, ...]
    values: FloatArray
    held: tuple[str, ...]

    def notices(self) -> tuple[str, ...]:
        """What is not varied, in one line."""
        if not self.held:
            return ()
        return (
            f"draws: {', '.join(self.held)} keep the bundle's value: their standard errors are "
            "not known",
        )


def posterior_draws(
    bundle: Bundle, rig: Rig, model: Model, count: int, seed: int
) -> PosteriorDraws:
    """`count` models about the bundle's `model`, each with errors of its fitted numbers.

    The errors are normal in the coordinates of a refinement (logarithms of what is positive), with
    the bundle's standard errors and correlations, a refinement's across all numbers. Draw i is the
    same whatever `count` is. Constants of the rig file are not varied. Raises NotIdentifiedError
    where no fitted number has a standard error.
    """
    fitted = _fitted(bundle, rig, model)
    known = [u for u in fitted if math.isfinite(u.prior_std)]
    held = tuple(u.name for u in fitted if not math.isfinite(u.prior_std))
    known = [u for u in known if u.prior_std > 0.0]
    if not known:
        raise NotIdentifiedError(
            f"{bundle.source}: no fitted number has a standard error: nothing can be drawn; "
            "`sysid refine` gives them"
        )
    errors_from_white = np.linalg.inv(prior_factor(known))
    rng = np.random.default_rng(seed)
    off = [errors_from_white @ rng.standard_normal(len(known)) for _ in range(count)]
    values = np.array(
        [[u.at(u.start + o) for u, o in zip(known, row, strict=True)] for row in off]
    ).reshape(count, len(known))
    models = tuple(model_at(model, known, row) for row in values)
    return PosteriorDraws(models, tuple(u.name for u in known), values, held)


def with_test_scatter(bundle: Bundle, models: Sequence[Model], seed: int) -> list[Model]:
    """The models, each with the friction of one further test.

    Sliding and static friction scatter from test to test as the refinement found it, else as the
    bench tests showed it.
    """
    share = np.array(friction_scatter(bundle))
    rng = np.random.default_rng([seed, 1])
    found = []
    for model in models:
        sliding, static = np.exp(share * rng.standard_normal(2))
        found.append(Model(model.parameters.with_friction(sliding, static), model.effects))
    return found


def _fitted(bundle: Bundle, rig: Rig, model: Model) -> list[Unknown]:
    return [
        dataclasses.replace(u, has_prior=True)
        for u in unknowns_of(bundle, rig, model)
        if u.origin != "rig"
    ]


def drawn_models(bundle: Bundle, rig: Rig, model: Model, count: int, seed: int) -> list[Model]:
    """`posterior_draws`, empty where any fitted number has no standard error.

    The uncertainty of such a model is unknown.
    """
    fitted = _fitted(bundle, rig, model)
    if not fitted or any(not math.isfinite(u.prior_std) for u in fitted):
        return []
    if all(u.prior_std == 0.0 for u in fitted):
        return [model] * count
    return list(posterior_draws(bundle, rig, model, count, seed).models)


__all__ = ["PosteriorDraws", "drawn_models", "posterior_draws", "with_test_scatter"]
