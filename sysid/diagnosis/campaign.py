"""From a campaign and a bundle to a diagnosis and the extended bundle: `sysid diagnose`."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sysid.bundle.assembled_model import model_from_bundle, negative_friction
from sysid.bundle.content import (
    add_sources,
    check_log_unchanged,
    check_not_fitted,
)
from sysid.diagnosis import Diagnosis, diagnose
from sysid.diagnosis.bench.registry import part_tested
from sysid.diagnosis.bench.verdict import ComponentDiagnosis, diagnose_component
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign, CampaignLog
from sysid.io.logs import Log
from sysid.io.rig import Rig
from sysid.model.effects.catalogue import catalogue_with
from sysid.model.effects.linear import for_rig
from sysid.model.effects.serialise import effect_to_dict
from sysid.types import Progress

_LAWS = {
    "choked_fill": "choked_flow_fill_kg_s",
    "choked_dis": "choked_flow_dis_kg_s",
    "c_fill": "c_fill",
    "c_dis": "c_dis",
}


def diagnose_logs(
    campaign: Campaign,
    bundle: Mapping[str, Any],
    bundle_path: Path,
    *,
    effects: Path | None = None,
    seed: int = 0,
    progress: Progress = lambda line: None,
) -> tuple[Diagnosis | ComponentDiagnosis, tuple[str, ...]]:
    """The diagnosis of a campaign's logs, and what their readers want said.

    An effect that the bundle holds already is part of the model that is looked at.
    """
    catalogue = catalogue_with(effects)
    taken = {entry["id"] for entry in bundle["effects"]}
    open_ones = for_rig(
        {name: effect for name, effect in catalogue.items() if name not in taken},
        campaign.rig.is_linear,
    )
    logs: list[tuple[str, str, Log]] = []
    notices: list[str] = []
    for entry in campaign.logs:
        log = _read(campaign, entry, bundle, bundle_path)
        logs.append((entry.use, entry.kind, log))
        notices += log.notices
    kind = part_tested([entry.kind for entry in campaign.logs], bundle)
    if kind is not None:
        trials = {
            wanted: [t for use, of, log in logs if (use, of) == (wanted, kind) for t in log.trials]
            for wanted in ("fit", "holdout")
        }
        found = diagnose_component(
            kind,
            trials["fit"],
            trials["holdout"],
            campaign.rig,
            bundle,
            open_ones,
            progress,
        )
        return found, tuple(notices)
    model = model_from_bundle(bundle, campaign.rig, str(bundle_path), catalogue)
    notices += negative_friction(bundle, str(bundle_path))
    diagnosis = diagnose(
        logs,
        campaign.rig,
        model,
        open_ones,
        seed=seed,
        progress=progress,
    )
    return diagnosis, tuple(notices)


def _read(
    campaign: Campaign, entry: CampaignLog, bundle: Mapping[str, Any], bundle_path: Path
) -> Log:
    log = campaign.read(entry)
    check_log_unchanged(bundle, log, entry.kind, bundle_path)
    if entry.use == "holdout":
        check_not_fitted(bundle, log, bundle_path)
    return log


def extended_bundle(
    bundle: Mapping[str, Any], diagnosis: Diagnosis | ComponentDiagnosis, campaign: Campaign
) -> dict[str, Any]:
    """The bundle with the effects that were found and the base parameters refitted beside them.

    PWM surfaces stay as they were fitted. Where no effect was found only the campaign's
    held-out logs are added to the provenance.
    """
    found = copy.deepcopy(dict(bundle))
    add_sources(found, campaign.sources(None if diagnosis.effects else "holdout"))
    if not diagnosis.effects:
        return found
    found.pop("validation", None)
    for effect in diagnosis.effects:
        stds = {name: e.std for name, e in effect.estimates.items() if e.identified}
        intervals = {name: e.interval for name, e in effect.estimates.items() if e.identified}
        entry = effect_to_dict(effect.effect, stds, intervals)
        entry |= {
            "p_value": effect.p_value,
            "holdout_rmse": {name: e.to_json() for name, e in effect.holdout.items()},
            "ambiguous_with": list(effect.ambiguous_with),
        }
        found["effects"].append(entry)
    if isinstance(diagnosis, ComponentDiagnosis):
        _renew_part(found, diagnosis.part)
    else:
        _renew_model(found, diagnosis, campaign.rig)
    found["provenance"]["options"] = {
        **found["provenance"].get("options", {}),
        "diagnosis": {"seed": diagnosis.seed, "verdict": diagnosis.verdict},
    }
    return found


def _renew_part(content: dict[str, Any], part: Mapping[str, Any]) -> None:
    """A part's own numbers in place of those of the same name, level by level."""
    for key, value in part.items():
        if isinstance(value, dict) and "value" not in value and isinstance(content.get(key), dict):
            _renew_part(content[key], value)
        else:
            content[key] = value


def _renew_model(found: dict[str, Any], diagnosis: Diagnosis, rig: Rig) -> None:
    unit = ("n", "n_s_per_m") if rig.is_linear else ("nm", "nm_s_per_rad")
    p, std = diagnosis.model.parameters, diagnosis.base_std
    dof = diagnosis.base_dof
    friction = {"coulomb_effort": f"coulomb_{unit[0]}", "viscous": f"viscous_{unit[1]}"}
    for name, key in friction.items():
        _renew(found["friction"], key, float(getattr(p, name)), std.get(name), dof)
    for side in ("a", "b"):
        law = found.get("valves", {}).get(side, {}).get("discrete", {})
        for name, key in _LAWS.items():
            value = float(getattr(p, f"{name}_{side}"))
            _renew(law, key, value, std.get(f"{name}_{side}"), dof)


def _renew(part: dict[str, Any], key: str, value: float, std: float | None, dof: float) -> None:
    """A parameter's new value with its 95 % interval; the old one belongs to the old value."""
    if key not in part or std is None:
        return
    part[key] = Estimate.symmetric(value, std, part[key].get("unit", ""), dof).to_json()


__all__ = ["diagnose_logs", "extended_bundle"]
