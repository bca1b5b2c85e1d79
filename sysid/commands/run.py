"""`sysid run`: a campaign in; checks, bundle, diagnosis, validation, report and exports out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

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
    options,
    verbose_option,
)
from sysid.commands.own_component import read_with
from sysid.commands.printing import (
    grouped_notices,
    notices,
    print_blocks,
    print_json,
    stage_progress,
    unasked_notices,
    validation_table,
)
from sysid.commands.stages import (
    BUNDLE_FILE,
    EXPORTS,
    REPORT_FILE,
    PipelineRun,
    StageReport,
    digests,
    expected_seconds,
    has_whole_diagnosis,
    perform,
    stages_of,
)
from sysid.commands.verdict import verdict_lines
from sysid.io.files import make_folder, remove_leftovers
from sysid.io.locks import working_in
from sysid.parameters import Bundle, read_bundle
from sysid.plant.effects.catalogue import catalogue_with
from sysid.surfaces.kinds import SURFACES
from sysid.types import Progress, no_progress

run_options = options(
    click.option(
        "--surface",
        type=click.Choice([*SURFACES, "both"]),
        default="both",
        show_default=True,
        help="Which PWM surfaces to fit.",
    ),
    click.option(
        "--seed", type=SEED, default=0, show_default=True, help="Seed of folds, restarts and twins."
    ),
    click.option(
        "--diagnose/--no-diagnose", default=True, help="Whether to look for what the model lacks."
    ),
    click.option(
        "--refine/--no-refine",
        default=True,
        help="Whether to estimate all parameters together on the motion logs.",
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


@dataclass(frozen=True)
class RunReport:
    """The result of `sysid run`: the stages, the bundle, and the files that it wrote.

    `diagnosis` is the content of its file, None without a diagnosis; `unasked` are those of the
    notices, on what an export lacks, that a terminal shows only when asked to; `not_diagnosed` says
    why a diagnosis was skipped.
    """

    folder: Path
    stages: tuple[StageReport, ...]
    bundle: Bundle
    notices: tuple[str, ...]
    diagnosis: dict[str, Any] | None = None
    unasked: tuple[str, ...] = ()
    not_diagnosed: str = ""

    @property
    def report(self) -> Path:
        """The HTML report."""
        return self.folder / REPORT_FILE

    @property
    def exports(self) -> dict[str, Path]:
        """The files for a controller by format, without those that could not be made.

        None of a component of the user's own.
        """
        if not any(stage.name == "export" for stage in self.stages):
            return {}
        paths = {kind: self.folder / name for kind, name in EXPORTS.items()}
        return {kind: path for kind, path in paths.items() if path.is_file()}

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid run --json`; `diagnosis` as in `sysid diagnose --json`, or null."""
        diagnosis = self.diagnosis and {k: v for k, v in self.diagnosis.items() if k != "figures"}
        return {
            "folder": str(self.folder),
            "report": str(self.report) if self.report.is_file() else None,
            "bundle": str(self.folder / BUNDLE_FILE),
            "exports": {kind: str(path) for kind, path in self.exports.items()},
            "stages": [asdict(s) for s in self.stages],
            "diagnosis": diagnosis,
            "validation": self.bundle.to_json().get("validation", {}),
            "notices": list(self.notices),
        }


def run_campaign(
    campaign_path: Path,
    folder: Path,
    *,
    surface: str = "both",
    seed: int = 0,
    diagnose: bool = True,
    refine: bool = True,
    effects: Path | None = None,
    budget: float | None = None,
    quick: bool = False,
    component: str | None = None,
    exclude: Sequence[str] = (),
    progress: Progress = no_progress,
    entered: Progress = no_progress,
) -> RunReport:
    """Run every stage that is not up to date. Raises what the stages raise.

    `surface` and `seed` are those of `sysid fit valve-pwm` and the diagnosis; `diagnose` says
    whether to look for what the model lacks, `refine` whether to estimate all parameters together
    afterwards, `effects` is a Python file with further effects, `component` one with a component of
    the user's own, `exclude` what is not read of the logs (`--exclude`); `progress` is called with
    a line for each step, `entered` with each stage's name. The diagnosis ends after `budget`
    seconds of processor time (None: after so many evaluations); where it missed something then, a
    call with more does it again. `quick`: a first diagnosis that leaves much out, and no
    refinement; a call without it does both. No other call works in the folder meanwhile.
    """
    campaign = read_with(campaign_path, component, progress, exclude)
    if effects is not None:
        catalogue_with(effects)  # an unusable file is reported before the work, not after it
    with working_in(folder):
        if (folder / "export").exists():  # what cannot be a folder is reported before the work
            make_folder(folder / "export")
        remove_leftovers(folder)
        remove_leftovers(folder / "export")
        run = PipelineRun(
            campaign,
            folder,
            surface,
            seed,
            progress,
            digests(campaign),
            diagnose=diagnose,
            refine=refine,
            quick=quick,
            effects=effects,
            budget=budget,
            exclude=tuple(exclude),
        )
        if quick and has_whole_diagnosis(run):
            run.quick = False  # what is there already is more than a first look
        run.notices += [*campaign.notices, *campaign.rig.notices]
        done = []
        for stage in stages_of(run):
            entered(stage.name)
            done.append(perform(run, stage))
        stages = tuple(done)
        bundle = read_bundle(folder / BUNDLE_FILE)
        found = run.diagnosis()
        diagnosis = found if found and "verdict" in found else None
        skipped = "" if found is None else found.get("skipped", "")
        notices = tuple(dict.fromkeys(run.notices))
        unasked = tuple(dict.fromkeys(run.unasked))
        return RunReport(folder, stages, bundle, notices, diagnosis, unasked, skipped)


def run_and_show(
    campaign: Path, folder: Path, *, as_json: bool, verbose: bool, **options: Any
) -> None:
    """`run_campaign` with its progress on standard error, and its outcome."""
    asked = {name: options[name] for name in ("diagnose", "refine", "quick")}
    expected = expected_seconds(folder, options["budget"], **asked)
    with stage_progress(expected, verbose) as (tell, entered):
        done = run_campaign(campaign, folder, progress=tell, entered=entered, **options)
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
    print_blocks(
        (
            *([validation_table(done.bundle.validation)] if verbose else []),
            table("Stages", ("stage", "", "s"), stages),
            f"bundle: {done.folder / BUNDLE_FILE}",
            *report,
            *verdict_lines(done.bundle, done.diagnosis, done.not_diagnosed),
        )
    )
