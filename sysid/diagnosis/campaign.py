"""From a campaign and a bundle to a diagnosis and the extended bundle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

from sysid.diagnosis.actuator.diagnose import (
    diagnose,
    open_loop_errors,
    rivals_of,
    with_errors_after_judged,
)
from sysid.diagnosis.actuator.known import Earlier
from sysid.diagnosis.bench.diagnose import diagnose_component, held_out_errors
from sysid.diagnosis.bench.evidence import HeldOutEvidence
from sysid.diagnosis.bench.registry import AXIS, part_tested
from sysid.diagnosis.looked import Book, SearchStage, bounded
from sysid.diagnosis.refined import (
    Look,
    simulating_best,
    with_refined_numbers,
    without_contradicted,
)
from sysid.diagnosis.result import Diagnosis, FoundEffect
from sysid.errors import NotIdentifiedError
from sysid.io.campaign import Campaign, CampaignLog
from sysid.io.logs import Log
from sysid.parameters import Bundle, EffectEntry, HeldOutError
from sysid.parameters.assembled_model import assumed_parameters
from sysid.parameters.effects import entry_of
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.plant.effects.entry import Catalogue
from sysid.plant.effects.linear import for_rig
from sysid.refinement.draws import drawn_models
from sysid.types import Progress, no_progress

# Models with fitted numbers drawn by their errors; the squares of these many are averaged.
_DRAWN = 16


def diagnose_logs(
    campaign: Campaign,
    bundle: Bundle,
    *,
    effects: EffectSource = None,
    refine: bool = True,
    seed: int = 0,
    budget: float | None = None,
    quick: bool = False,
    progress: Progress = no_progress,
) -> tuple[Diagnosis, tuple[str, ...]]:
    """The diagnosis of a campaign's logs, and the readers' notices.

    An effect that the bundle already holds is part of the model under diagnosis. With `refine` the
    numbers of what an actuator lacks are those of simulation error on its motion logs, and so are
    those of an axis with a motor alone. Held-out logs tell errors, and decide nothing. Ends after
    `EVALUATIONS`, or after `budget` seconds of processor time in their place, with the best so far.
    `quick`: a first look without refinement.
    """
    with bounded(budget) as limit:
        found, notices = _diagnose_logs(
            campaign, bundle, effects, refine and not quick, seed, quick, progress
        )
    found = replace(found, evaluations=limit.made)
    return (_unrefined(found) if quick and refine else found), notices


def _diagnose_logs(
    campaign: Campaign,
    bundle: Bundle,
    effects: EffectSource,
    refine: bool,
    seed: int,
    quick: bool,
    progress: Progress,
) -> tuple[Diagnosis, tuple[str, ...]]:
    catalogue = catalogue_from(effects)
    taken = {entry.id for entry in bundle.effects}
    open_ones = for_rig(
        {name: effect for name, effect in catalogue.items() if name not in taken},
        campaign.rig.is_linear,
    )
    logs: list[tuple[str, str, Log]] = []
    notices: list[str] = []
    for entry in campaign.logs:
        log = _read(campaign, entry, bundle)
        logs.append((entry.use, entry.kind, log))
        notices += log.notices
    kind = part_tested(campaign.training_kinds(), bundle)
    if kind is None and campaign.rig.air is None:
        raise NotIdentifiedError(
            f"{campaign.path}: an axis without air is diagnosed on tests of kind friction-motion, "
            "of which it holds none; add some (docs: how-to/part-alone)"
        )
    if kind is not None:
        look = _look_at_part(kind, campaign, bundle, logs, catalogue, refine, quick, progress)
    else:
        notices += [*bundle.other_rig(campaign.rig), *assumed_parameters(bundle)]
        look = _look_at_actuator(campaign, bundle, logs, catalogue, refine, seed, quick, progress)
    return without_contradicted(look, open_ones, progress), tuple(notices)


def _look_at_part(
    kind: str,
    campaign: Campaign,
    bundle: Bundle,
    logs: Sequence[tuple[str, str, Log]],
    catalogue: Catalogue,
    refine: bool,
    quick: bool,
    progress: Progress,
) -> Look:
    trials = {
        wanted: [t for use, of, log in logs if (use, of) == (wanted, kind) for t in log.trials]
        for wanted in ("fit", "holdout")
    }
    refine = refine and kind == AXIS and campaign.rig.is_motor_alone

    def look(effects: Catalogue) -> Diagnosis:
        found = diagnose_component(
            kind, trials["fit"], trials["holdout"], campaign.rig, bundle, effects, progress,
            quick=quick,
        )  # fmt: skip
        if not refine:
            return found
        extended = extended_bundle(bundle, found, campaign)
        outside = cast(HeldOutEvidence, found.evidence).outside
        after = None if outside is None else partial(held_out_errors, outside, catalogue=catalogue)
        return with_refined_numbers(found, campaign, extended, catalogue, after, progress)

    return look


def _look_at_actuator(
    campaign: Campaign,
    bundle: Bundle,
    logs: Sequence[tuple[str, str, Log]],
    catalogue: Catalogue,
    refine: bool,
    seed: int,
    quick: bool,
    progress: Progress,
) -> Look:
    model = bundle.model(campaign.rig, catalogue)
    drawn = drawn_models(bundle, campaign.rig, model, _DRAWN, seed)
    earlier: Earlier = {}

    def errors_of(other: Bundle) -> dict[str, float]:
        return open_loop_errors(logs, campaign.rig, other.model(campaign.rig, catalogue))

    def look(effects: Catalogue) -> Diagnosis:
        found = diagnose(
            logs, campaign.rig, model, effects, drawn=drawn, seed=seed, quick=quick,
            earlier=earlier, progress=progress,
        )  # fmt: skip
        if refine:
            rivals = rivals_of(found, logs, campaign.rig, model)
            found = refined(found)
            for rival in rivals:
                found = simulating_best(found, refined(rival), progress)
        return with_errors_after_judged(found)

    def refined(found: Diagnosis) -> Diagnosis:
        extended = extended_bundle(bundle, found, campaign)
        return with_refined_numbers(found, campaign, extended, catalogue, errors_of, progress)

    return look


def _unrefined(found: Diagnosis) -> Diagnosis:
    """A quick diagnosis, which says that its numbers were not refined."""
    if not found.effects:
        return found
    book = Book(SearchStage.REFINEMENT)
    book.left_out(SearchStage.REFINEMENT)
    missed = book.closed()
    notices = (*found.notices, *missed.sentences())
    return replace(found, missed=missed.missed, notices=notices)


def _read(campaign: Campaign, entry: CampaignLog, bundle: Bundle) -> Log:
    log = campaign.read(entry)
    bundle.check_log(log, entry.kind, entry.use)
    return log


def extended_bundle(bundle: Bundle, diagnosis: Diagnosis, campaign: Campaign) -> Bundle:
    """The bundle with the effects found, and the base parameters estimated together with them.

    PWM surfaces stay as they were fitted. Where no effect was found only the campaign's
    held-out logs are added to the provenance.
    """
    found = bundle.with_sources(campaign.sources(None if diagnosis.effects else "holdout"))
    if not diagnosis.effects:
        return found if diagnosis.looked.is_complete else _recorded(found, diagnosis)
    entries = [_entry(effect) for effect in diagnosis.effects]
    if diagnosis.refinement is not None:
        refined = diagnosis.refinement.bundle
        found = refined.replaced(effects=[*refined.effects[: -len(entries)], *entries])
        return _recorded(found, diagnosis)
    return _recorded(diagnosis.evidence.with_base(found.with_effects(entries)), diagnosis)


def _recorded(found: Bundle, diagnosis: Diagnosis) -> Bundle:
    """The bundle with the seed, the verdict and what the search missed in its provenance."""
    made: dict[str, Any] = {"seed": diagnosis.seed, "verdict": diagnosis.verdict}
    if not diagnosis.looked.is_complete:
        made["search"] = diagnosis.looked.to_json()
    options = {**found.provenance.options, "diagnosis": made}
    return found.replaced(provenance=found.provenance.replaced(options=options))


def _entry(found: FoundEffect) -> EffectEntry:
    """The effect as a bundle lists it, with the evidence for it."""
    return entry_of(found.effect, found.estimates).replaced(
        p_value=found.p_value,
        holdout_rmse={name: HeldOutError(**e.to_json()) for name, e in found.holdout.items()},
        ambiguous_with=list(found.ambiguous_with),
    )


__all__ = ["diagnose_logs", "extended_bundle"]
