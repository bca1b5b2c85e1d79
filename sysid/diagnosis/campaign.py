"""From a campaign and a bundle to a diagnosis and the extended bundle."""

from __future__ import annotations

from typing import Any, TypeVar

from sysid.bundle import Bundle, EffectEntry, HeldOutError
from sysid.bundle.assembled_model import assumed_friction, friction_keys
from sysid.bundle.base import Part
from sysid.bundle.effects import entry_of
from sysid.bundle.valves import LAW_KEYS
from sysid.diagnosis import Diagnosis, diagnose
from sysid.diagnosis.actuator.result import FoundEffect
from sysid.diagnosis.bench.diagnose import ComponentDiagnosis, diagnose_component
from sysid.diagnosis.bench.registry import part_tested
from sysid.diagnosis.looked import SECONDS
from sysid.diagnosis.refined import with_refined_numbers
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign, CampaignLog
from sysid.io.channels import SIDES
from sysid.io.logs import Log
from sysid.model.effects.catalogue import EffectSource, catalogue_from
from sysid.model.effects.linear import for_rig
from sysid.parallel import time_limit
from sysid.types import Progress, no_progress

_Part = TypeVar("_Part", bound=Part)


def diagnose_logs(
    campaign: Campaign,
    bundle: Bundle,
    *,
    effects: EffectSource = None,
    refine: bool = True,
    seed: int = 0,
    budget: float | None = SECONDS,
    progress: Progress = no_progress,
) -> tuple[Diagnosis | ComponentDiagnosis, tuple[str, ...]]:
    """The diagnosis of a campaign's logs, and the readers' notices.

    An effect that the bundle already holds is part of the model under diagnosis. With `refine`
    the numbers of what an actuator lacks are those of simulation error on its motion logs. Ends
    after `budget` seconds with the best so far (None: never).
    """
    with time_limit(budget):
        return _diagnose_logs(campaign, bundle, effects, refine, seed, progress)


def _diagnose_logs(
    campaign: Campaign,
    bundle: Bundle,
    effects: EffectSource,
    refine: bool,
    seed: int,
    progress: Progress,
) -> tuple[Diagnosis | ComponentDiagnosis, tuple[str, ...]]:
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
    kind = part_tested([entry.kind for entry in campaign.logs], bundle)
    if kind is not None:
        trials = {
            wanted: [t for use, of, log in logs if (use, of) == (wanted, kind) for t in log.trials]
            for wanted in ("fit", "holdout")
        }
        found = diagnose_component(
            kind, trials["fit"], trials["holdout"], campaign.rig, bundle, open_ones, progress
        )
        return found, tuple(notices)
    model = bundle.model(campaign.rig, catalogue)
    notices += assumed_friction(bundle)
    diagnosis = diagnose(logs, campaign.rig, model, open_ones, seed=seed, progress=progress)
    if refine:
        extended = extended_bundle(bundle, diagnosis, campaign)
        diagnosis = with_refined_numbers(diagnosis, campaign, extended, catalogue, progress)
    return diagnosis, tuple(notices)


def _read(campaign: Campaign, entry: CampaignLog, bundle: Bundle) -> Log:
    log = campaign.read(entry)
    bundle.check_log_unchanged(log, entry.kind)
    if entry.use == "holdout":
        bundle.check_not_fitted(log)
    return log


def extended_bundle(
    bundle: Bundle, diagnosis: Diagnosis | ComponentDiagnosis, campaign: Campaign
) -> Bundle:
    """The bundle with the effects found, and the base parameters estimated together with them.

    PWM surfaces stay as they were fitted. Where no effect was found only the campaign's
    held-out logs are added to the provenance.
    """
    found = bundle.with_sources(campaign.sources(None if diagnosis.effects else "holdout"))
    if not diagnosis.effects:
        return found if diagnosis.looked.is_complete else _recorded(found, diagnosis)
    if isinstance(diagnosis, Diagnosis) and diagnosis.refinement is not None:
        refined = diagnosis.refinement.bundle
        entries = [_entry(effect) for effect in diagnosis.effects]
        return refined.replaced(effects=[*refined.effects[: -len(entries)], *entries])
    found = found.with_effects(_entry(effect) for effect in diagnosis.effects)
    if isinstance(diagnosis, ComponentDiagnosis):
        found = _with_part(found, diagnosis)
    else:
        found = _with_model(found, diagnosis)
    return _recorded(found, diagnosis)


def _recorded(found: Bundle, diagnosis: Diagnosis | ComponentDiagnosis) -> Bundle:
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


def _with_part(bundle: Bundle, diagnosis: ComponentDiagnosis) -> Bundle:
    """A part with the given numbers in place of those of the same name, level by level."""
    own = {key: part for key, part in vars(diagnosis.part).items() if part is not None}
    return bundle.replaced(
        **{
            key: part if getattr(bundle, key) is None else getattr(bundle, key).overlaid(part)
            for key, part in own.items()
        }
    )


def _with_model(bundle: Bundle, diagnosis: Diagnosis) -> Bundle:
    """The refitted base parameters in place of the original ones."""
    keys = friction_keys(bundle.is_linear)
    friction = {"coulomb_effort": keys["coulomb"], "viscous": keys["viscous"]}
    fields: dict[str, Any] = {}
    if bundle.friction is not None:
        fields["friction"] = _renewed(bundle.friction, friction, diagnosis)
    if bundle.valves is not None:
        sides = {}
        for side in SIDES:
            law = bundle.valve(side).discrete
            if law is not None:
                names = {f"{name}_{side}": key for name, key in LAW_KEYS.items()}
                renewed = _renewed(law, names, diagnosis)
                sides[side] = bundle.valve(side).replaced(discrete=renewed)
        fields["valves"] = bundle.valves.replaced(**sides)
    return bundle.replaced(**fields)


def _renewed(part: _Part, names: dict[str, str], diagnosis: Diagnosis) -> _Part:
    """New values of a part's keys by the model's names; the old intervals no longer apply."""
    fields = {}
    for name, key in names.items():
        old, std = getattr(part, key), diagnosis.base_std.get(name)
        if old is not None and std is not None:
            value = float(getattr(diagnosis.model.parameters, name))
            fields[key] = Estimate.symmetric(value, std, old.unit, diagnosis.base_dof)
    return part.replaced(**fields)


__all__ = ["diagnose_logs", "extended_bundle"]
