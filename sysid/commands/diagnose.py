"""`sysid diagnose`: a campaign and a bundle in, the diagnosis, extended bundle and report out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click

from sysid.blocks.tables import Table, table
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
from sysid.commands.printing import (
    Strong,
    estimate_cells,
    notices,
    print_blocks,
    print_json,
    progress,
    spaced,
    unless_failed,
    written_lines,
)
from sysid.diagnosis import wording
from sysid.diagnosis.evidence import is_of_actuator
from sysid.diagnosis.result import Diagnosis
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle, read_bundle, write_bundle
from sysid.pipeline.diagnose import CampaignDiagnosis
from sysid.pipeline.diagnose import diagnose as workflow
from sysid.pipeline.subject import subject_of
from sysid.plant.effects.catalogue import catalogue_with
from sysid.types import Progress, no_progress

# Suspects of one round that a summary names.
_MOST_SUSPECTS = 6
_CORRECT = wording.CORRECT_MODEL.lower()


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
    """A diagnosis, the bundle extended by it, notices, and the files that were written."""

    diagnosis: Diagnosis
    bundle: Bundle
    notices: tuple[str, ...]
    written: tuple[Path, ...]

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
    return Diagnosed(found.detail, found.bundle, tuple(dict.fromkeys(notices)), tuple(written))


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


# --- printing ---------------------------------------------------------------------------


def show_diagnosis(diagnosed: Diagnosed, as_json: bool) -> None:
    """The verdict, the effects, the errors, what was tried, what to do next."""
    notices(diagnosed.notices)
    content = diagnosed.to_json()
    if as_json:
        print_json(content)
        return
    tables = (
        _effects(content),
        _before_after(content),
        _unexplained(content),
        _tried(diagnosed.diagnosis.evidence.rounds_shown()),
    )
    print_blocks(
        (
            Strong(wording.sentence(content)),
            *spaced(tables),
            "",
            *wording.left(content),
            *wording.advice(content),
            *written_lines(diagnosed.written),
        )
    )


def _effects(content: dict[str, Any]) -> Table:
    """One row per parameter; cells about the effect as a whole are in its first row."""
    rows = []
    for effect in content["effects"]:
        head = effect["id"]
        share = f"{100.0 * effect['share']:.3g}"
        whole = (
            wording.p_text(effect["p_value"]),
            share,
            wording.joined(effect["ambiguous_with"], "or") or "-",
        )
        for name, estimate in wording.parameter_rows(effect):
            cells = (estimate, "", "") if isinstance(estimate, str) else estimate_cells(estimate)
            rows.append((head, name, *cells, *whole))
            head, whole = "", ("", "", "")
    columns = ("parameter", "value", "95 % interval", "unit", "p", "share, %", "ambiguous with")
    return table("Effects", ("effect", *columns), rows)


def _before_after(content: dict[str, Any]) -> Table:
    how = ", simulated open loop" if is_of_actuator(content) else ""
    rows = []
    for name, errors in wording.errors_by_step(content).items():
        floor = content["residual"][name]["noise_floor"]
        cells = ("-" if math.isnan(e) else f"{e:.4g}" for e in errors)
        rows.append((name, *cells, f"{floor:.4g}"))
    columns = ("channel", "original bundle", *wording.steps(content), _CORRECT)
    return table(f"RMSE on held-out logs{how}", columns, rows)


def _unexplained(content: dict[str, Any]) -> Table:
    rows = tuple(
        (one["channel"], wording.regressor_name(one["regressor"]), f"{100.0 * one['share']:.3g}")
        for one in content["unexplained"]
    )
    return table("Unexplained", ("channel", "depends most on", "share of variance, %"), rows)


def _tried(looks: Sequence[dict[str, Any]]) -> Table:
    """What each round tried in addition to the effect that it added."""
    compared = any("twins" in s for look in looks for s in look["suspects"])
    gain = ("gain", "most on a twin") if compared else ("share of the prediction error, %",)
    columns = ("round", "suspect", *gain, "p", "outcome")
    rows = []
    for place, look in enumerate(looks, start=1):
        others = [s for s in look["suspects"] if s["fate"] != "added"]
        for suspect in others[:_MOST_SUSPECTS]:
            p_value = wording.p_text(suspect["p_value"])
            rows.append((str(place), suspect["id"], *_gains(suspect), p_value, suspect["fate"]))
        if len(others) > _MOST_SUSPECTS:
            more = f"{len(others) - _MOST_SUSPECTS} more with less gain"
            rows.append((str(place), more, *[""] * (len(columns) - 2)))
    return table("Tried, and not added", columns, rows)


def _gains(suspect: dict[str, Any]) -> tuple[str, ...]:
    """A suspect's gain and the largest on a twin, or its share of the prediction error."""
    if "twins" in suspect:
        return f"{suspect['gain']:.3g}", f"{max(suspect['twins']):.3g}"
    return (f"{100.0 * suspect['gain']:.3g}",)
