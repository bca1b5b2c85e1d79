"""`sysid validate`: a campaign and a bundle in, the validated bundle and its report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from sysid.blocks.tables import Table
from sysid.commands.options import (
    SEED,
    PathArgument,
    bundle_option,
    campaign_argument,
    component_option,
    draws_option,
    effects_option,
    exclude_option,
    json_option,
    report_option,
)
from sysid.commands.printing import (
    notices,
    print_blocks,
    print_json,
    progress,
    written_lines,
)
from sysid.errors import input_error
from sysid.pipeline.diagnosed import read_diagnosis
from sysid.pipeline.files import read_bundle, read_with
from sysid.pipeline.report import PageOptions, write_results
from sysid.pipeline.validate import BandCoverage, ValidateOptions, coverage
from sysid.pipeline.validate import validate as workflow
from sysid.types import Progress, no_progress


@click.command()
@campaign_argument
@bundle_option
@report_option
@click.option(
    "--diagnosis",
    type=PathArgument,
    help="diagnosis.json of the run that extended the bundle, for the report.",
)
@click.option("-o", "output", type=PathArgument, help="Write the bundle with its validation.")
@draws_option
@click.option("--seed", type=SEED, default=0, help="Seed of the draws.")
@effects_option
@component_option
@exclude_option
@json_option
def validate(campaign: Path, bundle: Path, as_json: bool, **options: Any) -> None:
    """Open-loop simulation of a bundle's model against a campaign's motion logs."""
    found = validate_campaign(campaign, bundle, progress=progress(), **options)
    _show(found, as_json)


@dataclass(frozen=True)
class Validated:
    """A bundle's `validation` as its file holds it and as a table, notices, the written files."""

    content: Any
    table: Table
    notices: tuple[str, ...]
    written: tuple[Path, ...]
    bands: BandCoverage | None = None

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid validate --json`."""
        own = {} if self.bands is None else {"bands": self.bands.to_json()}
        return {
            **own,
            "validation": self.content,
            "notices": list(self.notices),
            "written": [str(path) for path in self.written],
        }


def _show(validated: Validated, as_json: bool) -> None:
    """The errors of every log, and the files written."""
    notices(validated.notices)
    if as_json:
        print_json(validated.to_json())
        return
    bands = () if validated.bands is None else (validated.bands.table(),)
    print_blocks((validated.table, *bands, *written_lines(validated.written)))


def validate_campaign(
    campaign_path: Path,
    bundle_path: Path,
    *,
    report: Path | None = None,
    diagnosis: Path | None = None,
    output: Path | None = None,
    component: str | None = None,
    exclude: Sequence[str] = (),
    draws: int | None = None,
    seed: int = 0,
    progress: Progress = no_progress,
    **options: Any,
) -> Validated:
    """Simulate a campaign's motion logs open loop with a bundle's model.

    `diagnosis`: the file of the bundle's, which the report shows; `draws`: models for bands about
    the simulation, by `seed`; `component`: a file of the user's own, which is executed; `exclude`
    names what is not read; `options` are those of `ValidateOptions`. Raises InputError for unusable
    files, NotIdentifiedError where the bundle lacks what the simulation needs.
    """
    if diagnosis is not None and report is None:
        raise input_error("--diagnosis", "is shown by the report alone", "add --report, or omit it")
    campaign = read_with(campaign_path, component, progress, exclude)
    bundle = read_bundle(bundle_path)
    diagnosed = None if diagnosis is None else read_diagnosis(diagnosis)
    if diagnosed is not None:  # before the work, not after it
        diagnosed.shown_with(bundle)
    asked = ValidateOptions(**options, progress=progress)
    result = workflow(campaign, bundle, asked)
    bands = coverage(campaign, bundle, draws, seed, asked) if draws else None
    record = result.record()
    bundle = bundle.replaced(validation=record)
    bundle = bundle.with_sources(campaign.sources("holdout"))
    page = PageOptions(validation=result, diagnosis=diagnosed, progress=progress)
    unseen = write_results(campaign, bundle, page, output, report)
    said = () if bands is None else bands.notices
    notices = (*unseen, *campaign.notices, *campaign.rig.notices, *result.notices, *said)
    written = tuple(path for path in (output, report) if path is not None)
    return Validated(bundle.to_json()["validation"], record.table(), notices, written, bands)
