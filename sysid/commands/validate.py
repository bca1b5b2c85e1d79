"""From a campaign and a bundle to a validated bundle and its report: `sysid validate`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.bundle.content import add_sources, read_bundle, write_bundle
from sysid.checks.log_check import check_log
from sysid.io.campaign import read_campaign
from sysid.model.effects.catalogue import catalogue_with
from sysid.validation import validate


@dataclass(frozen=True)
class Validated:
    """The bundle's `validation`, what to say about it, and the files that were written."""

    validation: dict[str, Any]
    notices: tuple[str, ...]
    written: tuple[Path, ...]

    def to_json(self) -> dict[str, Any]:
        """What `sysid validate --json` prints."""
        return {
            "validation": self.validation,
            "notices": list(self.notices),
            "written": [str(path) for path in self.written],
        }


def validate_campaign(
    campaign_path: Path,
    bundle_path: Path,
    *,
    report: Path | None = None,
    output: Path | None = None,
    effects: Path | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> Validated:
    """Simulate a campaign's motion logs open loop with a bundle's model.

    `effects` is a file of a user's own effects, which is run. Raises InputError for unusable
    files, NotIdentifiedError where the bundle lacks what the simulation needs.
    """
    campaign = read_campaign(campaign_path)
    bundle = read_bundle(bundle_path)
    result = validate(
        campaign,
        bundle,
        bundle_path=bundle_path,
        catalogue=catalogue_with(effects) if effects else None,
        progress=progress,
    )
    bundle["validation"] = result.to_json()
    add_sources(bundle, campaign.sources("holdout"))
    written = []
    if output is not None:
        write_bundle(bundle, output)
        written.append(output)
    if report is not None:
        from sysid.report import write_report

        checks = [check_log(campaign.read(entry), campaign.rig) for entry in campaign.logs]
        write_report(
            report,
            campaign=campaign,
            bundle=bundle,
            validation=result,
            checks=checks,
            progress=progress,
        )
        written.append(report)
    notices = (*campaign.notices, *campaign.rig.notices, *result.notices)
    return Validated(bundle["validation"], notices, tuple(written))
