"""The report of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sysid.blocks.progress import progress_or_shown
from sysid.checks.log_check import LogCheck
from sysid.document import write_report
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.pipeline.diagnose import CampaignDiagnosis
from sysid.pipeline.subject import subject_of
from sysid.types import Progress
from sysid.validation.results import ValidationResult


def report(
    path: str | Path,
    campaign: Campaign,
    found: CampaignDiagnosis | Bundle,
    checked: ValidationResult | None = None,
    *,
    checks: Sequence[LogCheck] | None = None,
    progress: Progress | None = None,
) -> None:
    """Write one self-contained HTML page about a campaign, whole or not at all.

    `found`: a diagnosis, or a bundle where none was made; `checked` a validation. Sections
    without content are missing, and the page says so. `checks` None: every log is checked
    anew. Raises InputError where a log cannot be read or the file not be written, and for the
    bundle of a linear rig with a rotary one's campaign, or the reverse; where another rig file
    differs in less, the page says so.

    >>> si.report("out.html", campaign, bundle, checked)
    """
    diagnosis = None if isinstance(found, Bundle) else found.content()
    with progress_or_shown(progress, "writing the report") as tell:
        if checks is None:
            checks = subject_of(campaign).checks()
        write_report(
            Path(path),
            campaign=campaign,
            bundle=found if isinstance(found, Bundle) else found.bundle,
            validation=checked,
            checks=checks,
            diagnosis=diagnosis,
            progress=tell,
        )


__all__ = ["report"]
