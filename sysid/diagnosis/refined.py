"""The last step of a diagnosis: the numbers of the model found, estimated by simulation error.

The balances that find an effect give its numbers with the bias of their approximations. Where the
model that was found is simulated, the motion tests say them without (design, step 4).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from sysid.bundle import Bundle, EffectEntry
from sysid.bundle.assembled_model import effects_from_bundle
from sysid.diagnosis.looked import LATE, Book, SearchStage
from sysid.diagnosis.result import Diagnosis, FoundEffect
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign
from sysid.model.effects.entry import Catalogue, CatalogueEffect
from sysid.parallel import Failure, attempt
from sysid.types import Progress, no_progress

if TYPE_CHECKING:
    from sysid.refinement.result import RefineResult


def with_refined_numbers(
    diagnosis: Diagnosis,
    campaign: Campaign,
    extended: Bundle,
    catalogue: Catalogue,
    held_out_errors: Callable[[Bundle], Mapping[str, float]],
    progress: Progress = no_progress,
) -> Diagnosis:
    """The diagnosis with its numbers, and the errors after, as a refinement has them.

    `extended` is the bundle with the effects found; `held_out_errors` are a bundle's by channel,
    in its unit. Where nothing was found, or the refinement does not hold or time runs out, the
    diagnosis is as it was, with a notice that says why.
    """
    if not diagnosis.effects:
        return diagnosis
    found = attempt(lambda: _numbers(campaign, extended, catalogue, held_out_errors, progress))
    if isinstance(found, Failure):
        return _out_of_time(diagnosis) if found.out_of_time else _as_it_was(diagnosis, found.reason)
    result, after = found
    count = len(diagnosis.effects)
    own = effects_from_bundle(result.bundle, catalogue)[-count:]
    refined = zip(diagnosis.effects, result.bundle.effects[-count:], own, strict=True)
    return dataclasses.replace(
        diagnosis,
        effects=tuple(_refined(effect, entry, new) for effect, entry, new in refined),  # type: ignore[arg-type]
        residual={
            name: dataclasses.replace(error, after=after[name])
            for name, error in diagnosis.residual.items()
            if math.isfinite(after.get(name, math.nan))
        },
        refinement=result,
        notices=(*diagnosis.notices, *result.notices),
    )


def _numbers(
    campaign: Campaign,
    extended: Bundle,
    catalogue: Catalogue,
    held_out_errors: Callable[[Bundle], Mapping[str, float]],
    progress: Progress,
) -> tuple[RefineResult, Mapping[str, float]] | Failure:
    """The refinement and a bundle's errors with it; why it is not to be used where it is not."""
    from sysid.refinement.refine import refine  # loads jax

    try:
        result = refine(campaign, extended, catalogue=catalogue, progress=progress)
        if result.worse:
            return Failure(f"the training tests would be simulated {result.worse}")
        return result, held_out_errors(result.bundle)
    except (InputError, NotIdentifiedError, RuntimeError) as error:
        return Failure(str(error))


def _as_it_was(diagnosis: Diagnosis, why: str) -> Diagnosis:
    notice = f"the numbers are those of the balances, not refined by simulation: {why}"
    notices = (*diagnosis.notices, notice)
    return dataclasses.replace(diagnosis, not_refined=why, notices=notices)


def _out_of_time(diagnosis: Diagnosis) -> Diagnosis:
    book = Book(SearchStage.REFINEMENT)
    book.miss(LATE, decides=False)
    missed = book.closed()
    notices = (*diagnosis.notices, *missed.sentences())
    return dataclasses.replace(diagnosis, missed=missed.missed, notices=notices)


def _refined(found: FoundEffect, entry: EffectEntry, effect: CatalogueEffect) -> FoundEffect:
    estimates = {
        q.name: estimate
        for q in type(found.effect).quantities
        if isinstance(estimate := entry.parameters.get(q.label), Estimate)
    }
    return dataclasses.replace(found, effect=effect, estimates={**found.estimates, **estimates})


__all__ = ["with_refined_numbers"]
