"""From a campaign and a bundle to a diagnosis and the extended bundle: `sysid diagnose`."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.bundle import (
    add_sources,
    check_log_unchanged,
    check_not_fitted,
    read_bundle,
    write_bundle,
)
from sysid.campaign import Campaign, CampaignLog, read_campaign
from sysid.components.build import part_tested
from sysid.components.verdict import ComponentDiagnosis, diagnose_component
from sysid.diagnosis import Diagnosis, diagnose
from sysid.logs import Log
from sysid.model.effects.linear import for_rig
from sysid.model.effects.serialise import effect_to_dict
from sysid.model.from_bundle import catalogue_with, model_from_bundle, negative_friction
from sysid.rig import Rig

Progress = Callable[[str], None]

_LAWS = {
    "choked_fill": "choked_flow_fill_kg_s",
    "choked_dis": "choked_flow_dis_kg_s",
    "c_fill": "c_fill",
    "c_dis": "c_dis",
}


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis, the bundle extended by it, what to say, and the files that were written."""

    diagnosis: Diagnosis | ComponentDiagnosis
    bundle: Mapping[str, Any]
    notices: tuple[str, ...]
    written: tuple[Path, ...]

    def to_json(self) -> dict[str, Any]:
        """What `sysid diagnose --json` prints (spec/cli.md)."""
        found = self.diagnosis.to_json()
        found["notices"] = list(self.notices)
        return found | {"written": [str(path) for path in self.written]}


def diagnose_campaign(
    campaign_path: Path,
    bundle_path: Path,
    *,
    output: Path | None = None,
    report: Path | None = None,
    effects: Path | None = None,
    seed: int = 0,
    progress: Progress = lambda line: None,
) -> Diagnosed:
    """Diagnose a campaign with its fitted bundle; write the extended bundle and the report.

    `effects` is a user's file of effects beside the catalogue. Raises InputError for
    unusable files, NotIdentifiedError where the bundle or the campaign does not suffice.
    """
    campaign = read_campaign(campaign_path)
    bundle = read_bundle(bundle_path)
    diagnosis, notices = diagnose_logs(
        campaign, bundle, bundle_path, effects=effects, seed=seed, progress=progress
    )
    extended = extended_bundle(bundle, diagnosis, campaign)
    written = []
    if output is not None:
        write_bundle(extended, output)
        written.append(output)
    if report is not None:
        _write_report(report, campaign, extended, bundle_path, diagnosis, effects, progress)
        written.append(report)
    notices = (*campaign.notices, *campaign.rig.notices, *notices, *diagnosis.notices)
    return Diagnosed(diagnosis, extended, tuple(dict.fromkeys(notices)), tuple(written))


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
    friction = {"coulomb_effort": f"coulomb_{unit[0]}", "viscous": f"viscous_{unit[1]}"}
    for name, key in friction.items():
        _renew(found["friction"], key, float(getattr(p, name)), std.get(name))
    for side in ("a", "b"):
        law = found.get("valves", {}).get(side, {}).get("discrete", {})
        for name, key in _LAWS.items():
            _renew(law, key, float(getattr(p, f"{name}_{side}")), std.get(f"{name}_{side}"))


def _renew(part: dict[str, Any], key: str, value: float, std: float | None) -> None:
    """A parameter's new value; its old interval belongs to the old one."""
    if key not in part or std is None:
        return
    part[key] = {
        "value": value,
        "std": std,
        "unit": part[key].get("unit", ""),
        "interval": [value - 1.96 * std, value + 1.96 * std],
    }


def _write_report(
    path: Path,
    campaign: Campaign,
    bundle: Mapping[str, Any],
    bundle_path: Path,
    diagnosis: Diagnosis | ComponentDiagnosis,
    effects: Path | None,
    progress: Progress,
) -> None:
    from sysid.check import check_log
    from sysid.report import write_report
    from sysid.report.findings import content
    from sysid.validation import VALIDATED_KINDS, validate

    validation = None
    is_part = isinstance(diagnosis, ComponentDiagnosis)
    if not is_part and campaign.select(VALIDATED_KINDS, None):
        validation = validate(
            campaign,
            bundle,
            bundle_path=bundle_path,
            catalogue=catalogue_with(effects),
            progress=progress,
        )
    checks = [check_log(campaign.read(entry), campaign.rig) for entry in campaign.logs]
    write_report(
        path,
        campaign=campaign,
        bundle=bundle,
        validation=validation,
        checks=checks,
        diagnosis=content(diagnosis),
        progress=progress,
    )


__all__ = ["Diagnosed", "diagnose_campaign", "diagnose_logs", "extended_bundle"]
