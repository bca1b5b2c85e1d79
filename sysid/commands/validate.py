"""`sysid validate`: a campaign and a bundle in, the validated bundle and its report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
from sysid.commands.own_component import read_with
from sysid.commands.printing import (
    notices,
    print_blocks,
    print_json,
    progress,
    unless_failed,
    validation_table,
    written_lines,
)
from sysid.parameters import Bundle, read_bundle, write_bundle
from sysid.pipeline.subject import subject_of
from sysid.plant.effects.catalogue import catalogue_with
from sysid.types import Progress, no_progress


@click.command()
@campaign_argument
@bundle_option
@report_option
@click.option("-o", "output", type=PathArgument, help="Write the bundle with its validation.")
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
    """The bundle with its validation, notices, and the files that were written."""

    bundle: Bundle
    notices: tuple[str, ...]
    written: tuple[Path, ...]

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid validate --json`."""
        return {
            "validation": self.bundle.to_json()["validation"],
            "notices": list(self.notices),
            "written": [str(path) for path in self.written],
        }


def _show(validated: Validated, as_json: bool) -> None:
    """The errors of every log, and the files written."""
    notices(validated.notices)
    if as_json:
        print_json(validated.to_json())
        return
    table = validation_table(validated.bundle.validation)
    print_blocks((table, *written_lines(validated.written)))


def validate_campaign(
    campaign_path: Path,
    bundle_path: Path,
    *,
    report: Path | None = None,
    output: Path | None = None,
    effects: Path | None = None,
    component: str | None = None,
    exclude: Sequence[str] = (),
    progress: Progress = no_progress,
) -> Validated:
    """Simulate a campaign's motion logs open loop with a bundle's model.

    `effects` is a Python file with further effects, `component` one with a component of the
    user's own; they are executed; `exclude` names what is not read. Raises InputError for unusable
    files, NotIdentifiedError where the bundle lacks what the simulation needs.
    """
    campaign = read_with(campaign_path, component, progress, exclude)
    bundle = read_bundle(bundle_path)
    catalogue = catalogue_with(effects) if effects else None
    result = subject_of(campaign).validate(bundle, catalogue, progress)
    bundle = bundle.replaced(validation=result.record())
    bundle = bundle.with_sources(campaign.sources("holdout"))
    written = []
    if output is not None:
        write_bundle(bundle, output)
        written.append(output)
    if report is not None:
        from sysid.document import write_report

        write_report(
            report,
            campaign=campaign,
            bundle=bundle,
            validation=result,
            checks=unless_failed("not checked", subject_of(campaign).checks, ()),
            progress=progress,
        )
        written.append(report)
    notices = (*campaign.notices, *campaign.rig.notices, *result.notices)
    return Validated(bundle, notices, tuple(written))
