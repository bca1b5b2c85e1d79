"""The report of a campaign."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.blocks.progress import progress_or_shown
from sysid.errors import Failure, unless_failed
from sysid.io.campaign import Campaign
from sysid.io.files import write_atomic
from sysid.parameters import Bundle, write_bundle
from sysid.pipeline.check import checks_of
from sysid.pipeline.request import Reported, require

if TYPE_CHECKING:
    from sysid.checks.log_check import LogCheck
    from sysid.pipeline.diagnose import CampaignDiagnosis
    from sysid.pipeline.diagnosed import ReadDiagnosis
    from sysid.types import Progress
    from sysid.validation.results import ValidationResult


def report(
    path: str | Path,
    campaign: Campaign,
    found: CampaignDiagnosis | Bundle,
    checked: ValidationResult | None = None,
    *,
    checks: Sequence[LogCheck] | None = None,
    diagnosis: ReadDiagnosis | None = None,
    notices: Sequence[str] = (),
    progress: Progress | None = None,
) -> None:
    """Write one self-contained HTML page about a campaign, whole or not at all.

    `found`: a diagnosis, or a bundle where none was made; `checked` a validation. Sections without
    content are missing, and the page says so. `checks` None: every log is checked anew;
    `diagnosis`: that of a bundle, as `read_diagnosis` read it from the results of a run. `notices`:
    the fit's, each shown next to its number. Raises InputError where a log cannot be read or
    the file not be written, and for the bundle of a linear rig with a rotary one's campaign, or the
    reverse; where another rig file differs in less, the page says so.

    >>> si.report("out.html", campaign, bundle, checked)
    """
    from sysid.pipeline.pages.report import render_report

    require(campaign, "campaign", "Campaign")
    require(found, "found", "CampaignDiagnosis", "Bundle")
    with progress_or_shown(progress, "writing the report") as tell:
        html = render_report(
            campaign=campaign,
            bundle=found if isinstance(found, Bundle) else found.bundle,
            validation=checked,
            checks=checks_of(campaign) if checks is None else checks,
            diagnosis=_diagnosed(found, diagnosis),
            notices=notices,
            progress=tell,
        )
        write_atomic(Path(path), html)


def _diagnosed(
    found: CampaignDiagnosis | Bundle, read: ReadDiagnosis | None
) -> Mapping[str, Any] | None:
    """What a page shows of a diagnosis: that which was made, or was read with its bundle."""
    if isinstance(found, Bundle):
        return None if read is None else read.shown_with(found)
    return found.content()


@dataclass(frozen=True, kw_only=True)
class PageOptions(Reported):
    """What a page shows in addition to what was requested: a validation, or how to make one.

    `diagnosis`: that of a bundle, read from its file; `by_content`: logs that no campaign declares
    may hold tests of several kinds; `notices`: the fit's, each shown next to its number.
    """

    validation: ValidationResult | Callable[[], ValidationResult] | None = None
    diagnosis: ReadDiagnosis | None = None
    by_content: bool = False
    notices: Sequence[str] = ()


def write_page(
    path: Path, campaign: Campaign, found: CampaignDiagnosis | Bundle, options: PageOptions
) -> tuple[str, ...]:
    """`report` with a check of every log; notices of what it lacks, as it could not be had."""
    notices: list[str] = []
    validation: ValidationResult | Failure | None
    if callable(options.validation):
        validation = unless_failed("not validated", options.validation, notices)
    else:
        validation = options.validation
    check = partial(checks_of, campaign, by_content=options.by_content)
    checks = unless_failed("not checked", check, notices)
    report(
        path,
        campaign,
        found,
        None if isinstance(validation, Failure) else validation,
        checks=() if isinstance(checks, Failure) else checks,
        diagnosis=options.diagnosis,
        notices=options.notices,
        progress=options.tell,
    )
    return tuple(notices)


def write_results(
    campaign: Campaign,
    found: CampaignDiagnosis | Bundle,
    options: PageOptions,
    output: Path | None,
    page: Path | None,
) -> tuple[str, ...]:
    """Write the bundle to `output` and its page, where they are asked for; notices of the page."""
    if output is not None:
        write_bundle(found if isinstance(found, Bundle) else found.bundle, output)
    return () if page is None else write_page(page, campaign, found, options)


__all__ = ["PageOptions", "report", "write_page", "write_results"]
