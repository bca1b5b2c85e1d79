"""`sysid diagnose`: a campaign and a bundle in, the diagnosis, extended bundle and report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click

from sysid.commands.budget import budget_option, quick_option
from sysid.commands.options import (
    SEED,
    PathArgument,
    bundle_option,
    campaign_argument,
    component_option,
    effects_option,
    exclude_option,
    json_option,
    report_option,
)
from sysid.commands.printing import notices, print_json, print_result, progress
from sysid.pipeline.diagnose import CampaignDiagnosis, DiagnoseOptions
from sysid.pipeline.diagnose import diagnose as workflow
from sysid.pipeline.files import read_bundle, read_with
from sysid.pipeline.report import PageOptions, write_results
from sysid.pipeline.validate import ValidateOptions, is_validated, validate
from sysid.types import Progress, no_progress


@click.command()
@campaign_argument
@bundle_option
@click.option("-o", "output", type=PathArgument, help="Write the extended bundle.")
@report_option
@effects_option
@component_option
@exclude_option
@click.option(
    "--refine/--no-refine",
    default=True,
    help="Whether to estimate all parameters together at the end, if an actuator lacked an effect.",
)
@click.option(
    "--seed", type=SEED, default=0, show_default=True, help="Seed of the simulated twins."
)
@budget_option
@quick_option
@json_option
def diagnose(campaign: Path, bundle: Path, as_json: bool, **options: Any) -> None:
    """What the model lacks: the residual's cause, and the errors with and without it."""
    diagnosed = diagnose_campaign(campaign, bundle, progress=progress(), **options)
    show_diagnosis(diagnosed, as_json)


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis with its extended bundle, all notices, and the files that were written."""

    found: CampaignDiagnosis
    notices: tuple[str, ...]
    written: tuple[Path, ...]

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid diagnose --json` (`docs/reference/command-line.md`)."""
        found = self.found.detail.to_json()
        found["notices"] = list(self.notices)
        return found | {"written": [str(path) for path in self.written]}


def diagnose_campaign(
    campaign_path: Path,
    bundle_path: Path,
    *,
    output: Path | None = None,
    report: Path | None = None,
    component: str | None = None,
    exclude: Sequence[str] = (),
    progress: Progress = no_progress,
    **options: Any,
) -> Diagnosed:
    """Diagnose a campaign with its fitted bundle; write the extended bundle and the report.

    `component`: a file of the user's own, whose logs are the campaign's; `exclude` what is not read
    of them; `options` those of `DiagnoseOptions`. Raises InputError for unusable files,
    NotIdentifiedError where the bundle or the campaign is insufficient.
    """
    campaign = read_with(campaign_path, component, progress, exclude)
    asked = DiagnoseOptions(**options, progress=progress)
    found = workflow(campaign, read_bundle(bundle_path), asked)
    validation = None
    if is_validated(campaign, found.bundle):
        shown = ValidateOptions(effects=asked.effects, progress=progress)
        validation = partial(validate, campaign, found.bundle, shown)
    page = PageOptions(validation=validation, progress=progress)
    unseen = write_results(campaign, found, page, output, report)
    notices = (*unseen, *campaign.notices, *campaign.rig.notices, *found.notices)
    written = tuple(path for path in (output, report) if path is not None)
    return Diagnosed(found, tuple(dict.fromkeys(notices)), written)


def show_diagnosis(diagnosed: Diagnosed, as_json: bool) -> None:
    """The verdict, the effects, the errors, what was tried, what to do next."""
    notices(diagnosed.notices)
    if as_json:
        print_json(diagnosed.to_json())
    else:
        print_result(diagnosed.found, diagnosed.written)
