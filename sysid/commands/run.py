"""`sysid run`: a campaign in; checks, bundle, diagnosis, validation, report and exports out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from sysid.blocks.numbers import ascii_text
from sysid.blocks.tables import table
from sysid.commands.budget import budget_option, quick_option
from sysid.commands.options import (
    SEED,
    PathArgument,
    campaign_argument,
    component_option,
    effects_option,
    exclude_option,
    json_option,
    law_option,
    load_option,
    options,
    verbose_option,
)
from sysid.commands.printing import (
    grouped_notices,
    notices,
    print_blocks,
    print_json,
    stage_progress,
    unasked_notices,
)
from sysid.pipeline.run import (
    BUNDLE_FILE,
    RunOptions,
    RunReport,
    expected_seconds,
    run_campaign,
)
from sysid.pipeline.verdict import verdict_lines

run_options = options(
    click.option(
        "--surface",
        type=click.Choice(RunOptions.surfaces),
        default="both",
        show_default=True,
        help="Which PWM surfaces to fit.",
    ),
    law_option,
    load_option,
    click.option(
        "--seed", type=SEED, default=0, show_default=True, help="Seed of folds, restarts and twins."
    ),
    click.option(
        "--diagnose/--no-diagnose", default=True, help="Whether to diagnose what the model lacks."
    ),
    click.option(
        "--refine/--no-refine",
        default=True,
        help="Whether to estimate all parameters together on the motion logs.",
    ),
    click.option(
        "--advise/--no-advise",
        default=False,
        help="Whether the report says which test to run next, as sysid advise predicts it.",
    ),
    budget_option,
    quick_option,
    effects_option,
    json_option,
    verbose_option,
)


@click.command()
@campaign_argument
@click.option("-o", "folder", required=True, type=PathArgument, help="Folder for all results.")
@component_option
@exclude_option
@run_options
def run(campaign: Path, folder: Path, **options: Any) -> None:
    """The whole pipeline, from checks to exports. Resumes where it stopped."""
    run_and_show(campaign, folder, **options)


def run_and_show(
    campaign: Path, folder: Path, *, as_json: bool, verbose: bool, **options: Any
) -> None:
    """`run_campaign` with its progress on standard error, and its outcome."""
    asked = RunOptions(**options)
    with stage_progress(expected_seconds(folder, asked), verbose) as (tell, entered):
        done = run_campaign(campaign, folder, replace(asked, progress=tell, entered=entered))
    show_run(done, as_json, verbose)


def show_run(done: RunReport, as_json: bool, verbose: bool = False) -> None:
    """The outcome of each stage, where the files are, and the verdict in three lines.

    `verbose`: every notice, and the errors of each log too.
    """
    if verbose or as_json:
        notices(done.notices)
    else:
        grouped_notices(n for n in done.notices if n not in done.unasked)
        unasked_notices(len(done.unasked))
    if as_json:
        print_json(done.to_json())
        return
    stages = tuple((s.name, s.outcome, f"{s.seconds:.1f}") for s in done.stages)
    report = [f"report: {done.report}"] if done.report.is_file() else []
    validation = done.bundle.validation
    said = verdict_lines(done.bundle, done.diagnosis, done.not_diagnosed, done.advice)
    print_blocks(
        (
            *([] if validation is None or not verbose else [validation.table()]),
            table("Stages", ("stage", "", "s"), stages),
            f"bundle: {done.folder / BUNDLE_FILE}",
            *report,
            *map(ascii_text, said),
        )
    )
