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
from sysid.commands.own_component import read_with
from sysid.commands.printing import notices, print_json, print_result, progress, unless_failed
from sysid.diagnosis.result import Diagnosis
from sysid.io.campaign import Campaign
from sysid.parameters import read_bundle, write_bundle
from sysid.pipeline.diagnose import CampaignDiagnosis
from sysid.pipeline.diagnose import diagnose as workflow
from sysid.pipeline.subject import subject_of
from sysid.plant.effects.catalogue import catalogue_with
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

    @property
    def diagnosis(self) -> Diagnosis:
        """The verdict with its evidence."""
        return self.found.detail

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid diagnose --json` (spec/cli.md)."""
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
    component: str | None = None,
    exclude: Sequence[str] = (),
    refine: bool = True,
    seed: int = 0,
    budget: float | None = None,
    quick: bool = False,
    progress: Progress = no_progress,
) -> Diagnosed:
    """Diagnose a campaign with its fitted bundle; write the extended bundle and the report.

    `effects` is a Python file with effects in addition to the catalogue, `component` one of the
    user's own, whose logs are the campaign's; `exclude` what is not read of them; `refine` whether
    the numbers of what was found are those of simulation error; after `budget` seconds of processor
    time (None: after so many evaluations) it ends with the best so far, a `quick` one after a first
    look. Raises InputError for unusable files, NotIdentifiedError where the bundle or the campaign
    is insufficient.
    """
    campaign = read_with(campaign_path, component, progress, exclude)
    bundle = read_bundle(bundle_path)
    found = workflow(
        campaign,
        bundle,
        effects=effects,
        refine=refine,
        seed=seed,
        budget=budget,
        quick=quick,
        progress=progress,
    )
    written = []
    if output is not None:
        write_bundle(found.bundle, output)
        written.append(output)
    if report is not None:
        _write_report(report, campaign, found, effects, progress)
        written.append(report)
    notices = (*campaign.notices, *campaign.rig.notices, *found.notices)
    return Diagnosed(found, tuple(dict.fromkeys(notices)), tuple(written))


def _write_report(
    path: Path,
    campaign: Campaign,
    found: CampaignDiagnosis,
    effects: Path | None,
    progress: Progress,
) -> None:
    from sysid.document import write_report

    validation = None
    subject = subject_of(campaign)
    if subject.is_validated(found.bundle):
        validate = partial(subject.validate, found.bundle, catalogue_with(effects), progress)
        validation = unless_failed("not validated", validate, None)
    write_report(
        path,
        campaign=campaign,
        bundle=found.bundle,
        validation=validation,
        checks=unless_failed("not checked", subject.checks, ()),
        diagnosis=found.content(),
        progress=progress,
    )


def show_diagnosis(diagnosed: Diagnosed, as_json: bool) -> None:
    """The verdict, the effects, the errors, what was tried, what to do next."""
    notices(diagnosed.notices)
    if as_json:
        print_json(diagnosed.to_json())
    else:
        print_result(diagnosed.found, diagnosed.written)
