"""`sysid refine`: a bundle's parameters estimated together on a campaign's motion logs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sysid.commands.options import (
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
from sysid.errors import input_error
from sysid.pipeline.files import read_bundle, read_with
from sysid.pipeline.refine import RefineOptions
from sysid.pipeline.refine import refine as workflow
from sysid.pipeline.report import PageOptions, write_results
from sysid.pipeline.validate import ValidateOptions, validate
from sysid.types import Progress, no_progress

if TYPE_CHECKING:
    from sysid.pipeline.refine import Refined


@click.command()
@campaign_argument
@bundle_option
@click.option("-o", "output", type=PathArgument, help="Write the refined bundle.")
@report_option
@click.option(
    "--free",
    multiple=True,
    metavar="NAME",
    help="Estimate a declared constant too (rig.inertia, rig.area_a, ...); may be repeated.",
)
@click.option(
    "--fix", multiple=True, metavar="NAME", help="Hold a parameter fixed; may be repeated."
)
@click.option("--no-prior", is_flag=True, help="Use the bench tests for the starting values only.")
@click.option("--robust", is_flag=True, help="Weight each segment by the size of its own errors.")
@click.option(
    "--profile",
    multiple=True,
    metavar="NAME",
    help="Profile-likelihood interval of a parameter; may be repeated.",
)
@effects_option
@component_option
@exclude_option
@json_option
def refine(
    campaign: Path,
    bundle: Path,
    as_json: bool,
    no_prior: bool,
    component: str | None,
    exclude: Sequence[str],
    **options: Any,
) -> None:
    """All parameters of the assembled model together, by simulation error."""
    other_options = {k: v for k, v in options.items() if k not in ("output", "report")}
    given = [name for name, value in {**other_options, "no-prior": no_prior}.items() if value]
    if component is not None and given:
        raise input_error(f"--{given[0]}", "is not for a component of your own", "omit it")
    result, unseen, written = refine_campaign(
        campaign,
        bundle,
        component=component,
        exclude=exclude,
        prior=not no_prior,
        progress=progress(),
        **options,
    )
    notices(unseen)
    _show(result, written, as_json)


def refine_campaign(
    campaign_path: Path,
    bundle_path: Path,
    *,
    output: Path | None = None,
    report: Path | None = None,
    component: str | None = None,
    exclude: Sequence[str] = (),
    progress: Progress = no_progress,
    **options: Any,
) -> tuple[Refined, tuple[str, ...], tuple[Path, ...]]:
    """Refine a bundle on a campaign's motion logs; the result, notices, and the files written.

    `component`: a file of the user's own, which is executed; `exclude` names what is not read;
    `options` are those of `RefineOptions`. Raises InputError for unusable files or unknown names,
    NotIdentifiedError where the bundle lacks what the simulation needs.
    """
    campaign = read_with(campaign_path, component, progress, exclude)
    asked = RefineOptions(**options, progress=progress)
    result = workflow(campaign, read_bundle(bundle_path), asked)
    shown = ValidateOptions(effects=asked.effects, progress=progress)
    validation = partial(validate, campaign, result.bundle, shown)
    page = PageOptions(validation=validation, progress=progress)
    unseen = write_results(campaign, result.bundle, page, output, report)
    return result, unseen, tuple(path for path in (output, report) if path is not None)


def _show(result: Refined, written: tuple[Path, ...], as_json: bool) -> None:
    """Every parameter before and after, the errors of whole tests, and the files written."""
    notices(result.notices)
    if as_json:
        content = result.to_json() | {"notices": list(result.notices)}
        print_json(content | {"written": [str(path) for path in written]})
        return
    print_result(result, written)
