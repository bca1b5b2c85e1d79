"""Models drawn from the distribution of the fitted numbers' errors."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.plant.ports import Model
from sysid.refinement.prior import prior_factor
from sysid.refinement.unknowns import model_at, unknowns_of


def drawn_models(bundle: Bundle, rig: Rig, model: Model, count: int, seed: int) -> list[Model]:
    """`count` models about the bundle's `model`, each with errors of its fitted numbers.

    The errors have the bundle's standard errors and correlations. Empty where it gives a fitted
    number without a standard error: the uncertainty of such a model is unknown.
    """
    fitted = [
        dataclasses.replace(u, has_prior=True)
        for u in unknowns_of(bundle, rig, model)
        if u.origin != "rig"
    ]
    if not fitted or any(not math.isfinite(u.prior_std) for u in fitted):
        return []
    fitted = [u for u in fitted if u.prior_std > 0.0]  # the others are known exactly
    errors_from_white = np.linalg.inv(prior_factor(fitted))
    rng = np.random.default_rng(seed)
    models = []
    for _ in range(count):
        off = errors_from_white @ rng.standard_normal(len(fitted))
        values = np.array([u.at(u.start + o) for u, o in zip(fitted, off, strict=True)])
        models.append(model_at(model, fitted, values))
    return models


__all__ = ["drawn_models"]
