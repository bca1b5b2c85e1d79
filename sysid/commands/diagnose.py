"""`sysid diagnose`: files in, diagnosis, extended bundle and report out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.bundle.content import read_bundle, write_bundle
from sysid.diagnosis.actuator.result import Diagnosis
from sysid.diagnosis.bench.verdict import ComponentDiagnosis
from sysid.diagnosis.campaign import diagnose_logs, extended_bundle
from sysid.io.campaign import Campaign, read_campaign
from sysid.model.effects.catalogue import catalogue_with
from sysid.types import Progress


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


def _write_report(
    path: Path,
    campaign: Campaign,
    bundle: Mapping[str, Any],
    bundle_path: Path,
    diagnosis: Diagnosis | ComponentDiagnosis,
    effects: Path | None,
    progress: Progress,
) -> None:
    from sysid.checks.log_check import check_log
    from sysid.diagnosis.content import content
    from sysid.report import write_report
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
