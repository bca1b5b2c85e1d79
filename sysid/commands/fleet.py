"""`sysid fleet`: many campaigns through `run`, and one page over all of them."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from sysid import parallel
from sysid.blocks.numbers import ascii_text
from sysid.commands.options import PathArgument, options
from sysid.commands.printing import grouped_notices, notices, print_blocks, print_json, progress
from sysid.commands.run import run_options
from sysid.diagnosis import wording
from sysid.errors import InputError, NotIdentifiedError, SysidError, input_error
from sysid.fleet.origin import Origin, origin_of, result_folder
from sysid.fleet.rows import FleetRow, effects_of, readings_of
from sysid.fleet.trends import Fleet, fleet_of
from sysid.io.campaign import read_campaign
from sysid.io.files import check_each_once, write_atomic
from sysid.io.locks import clear_left, working_in
from sysid.parameters import read_bundle
from sysid.pipeline.run import FITTED_FILE, RunReport, run_campaign
from sysid.plant.effects.catalogue import catalogue_with
from sysid.types import Progress, no_progress

PAGE_FILE = "fleet.html"
CONTENT_FILE = "fleet.json"
_ENDING_S = 3.0  # how long workers that are killed may take to be gone
_FAULT = 1  # exit code of what is no fault of the input: a worker that died, a fault of the program

fleet_options = options(
    click.argument("campaigns", nargs=-1, required=True, type=PathArgument, metavar="CAMPAIGN..."),
    click.option("-o", "folder", required=True, type=PathArgument, help="Folder for all results."),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler whose workers do the work, tcp://host:8786; local: one is started.",
    ),
)


@click.command()
@fleet_options
@run_options
def fleet(
    campaigns: tuple[Path, ...],
    folder: Path,
    scheduler: str | None,
    as_json: bool,
    verbose: bool,
    **options: Any,
) -> None:
    """Every CAMPAIGN through `run`, and one page over all of them: what changed, and when.

    A campaign whose results are up to date is not run again. Rigs are told apart by the name in
    the rig file, dates by an ISO date in the name of the campaign file or of its folder.
    """
    done = run_fleet(
        campaigns, folder, scheduler=scheduler, tell=progress(), verbose=verbose, **options
    )
    notices(done.notices)
    _show_notices(done, verbose)
    if as_json:
        print_json(done.to_json() | {"page": str(folder / PAGE_FILE)})
    else:
        _show(done, folder)
    if len(done.failed) == len(done.rows):
        error = input_error(folder, "no campaign came to a result", "see the notices above")
        unidentified = all(row.exit_code == NotIdentifiedError.exit_code for row in done.rows)
        raise NotIdentifiedError(str(error)) if unidentified else error


def run_fleet(
    campaigns: tuple[Path, ...],
    folder: Path,
    *,
    scheduler: str | None = None,
    tell: Progress = no_progress,
    verbose: bool = False,
    **options: Any,
) -> Fleet:
    """Run every campaign that is not up to date, and write the page. `options` are those of `run`.

    `verbose`: every step of each campaign goes to standard error, not only that it starts.

    A campaign that cannot be run is a row that says why; the others go on. Raises InputError for
    a campaign given twice, a folder that cannot be written or in which another command works, and a
    scheduler that does not answer.
    """
    check_each_once(campaigns, "campaign")
    with working_in(folder):
        return _run_all(campaigns, folder, scheduler, tell, verbose, options)


def _run_all(
    campaigns: tuple[Path, ...],
    folder: Path,
    scheduler: str | None,
    tell: Progress,
    verbose: bool,
    options: dict[str, Any],
) -> Fleet:
    if options.get("effects") is not None:  # workers of a scheduler have other folders
        options["effects"] = options["effects"].resolve()
    jobs = [
        partial(run_one, path.resolve(), folder.resolve(), options, verbose and not scheduler)
        for path in campaigns
    ]
    with _none_left(folder, campaigns), _workers(scheduler, tell):
        found = parallel.attempt_all(jobs)
    rows = [
        _failed(FleetRow.failed(path, result_folder(path), None, row.reason, _FAULT), folder)
        if isinstance(row, parallel.Failure)
        else row
        for path, row in zip(campaigns, found, strict=True)
    ]
    done = fleet_of(rows)
    write_atomic(folder / CONTENT_FILE, json.dumps(done.to_json(), indent=2) + "\n")
    from sysid.document.fleet import write_fleet_page

    tell("writing the page")
    write_fleet_page(folder / PAGE_FILE, done)
    return done


@contextlib.contextmanager
def _none_left(folder: Path, campaigns: Sequence[Path]) -> Iterator[None]:
    """What workers that are killed leave in their campaigns' folders is removed."""
    try:
        yield
    except BaseException:
        deadline = time.monotonic() + _ENDING_S
        for path in campaigns:
            while not clear_left(folder / result_folder(path)) and time.monotonic() < deadline:
                time.sleep(0.05)
        raise


@contextlib.contextmanager
def _workers(scheduler: str | None, tell: Progress) -> Iterator[None]:
    if scheduler is None:
        yield
        return
    with parallel.on_cluster(scheduler, parallel.job_count()) as cluster:
        tell(f"Dask: {cluster.address}, {cluster.workers()} workers, {cluster.dashboard}")
        yield


def run_one(campaign: Path, folder: Path, options: dict[str, Any], shows: bool) -> FleetRow:
    """A campaign through `run`, into its folder of the fleet's; its row, written last."""
    name = result_folder(campaign)
    tell = progress(f"{name}: ") if shows else no_progress
    try:
        origin = origin_of(read_campaign(campaign))
    except SysidError as error:
        return _failed(FleetRow.failed(campaign, name, None, str(error), error.exit_code), folder)
    try:
        with working_in(folder / name):
            return _run_alone(campaign, origin, folder / name, options, tell)
    except InputError as error:  # of the folder, in which another command may be at work
        return FleetRow.failed(campaign, name, origin, str(error), error.exit_code)


def _run_alone(
    campaign: Path, origin: Origin, folder: Path, options: dict[str, Any], tell: Progress
) -> FleetRow:
    """`run_one` in the folder of the campaign's own."""
    name = folder.name
    try:
        progress(f"{name}: ")("starts")
        done = run_campaign(campaign, folder, progress=tell, **options)
        fitted = read_bundle(done.folder / FITTED_FILE)
        readings = readings_of(fitted, done.bundle, catalogue_with(options.get("effects")))
    except SysidError as error:
        failed = FleetRow.failed(campaign, name, origin, str(error), error.exit_code)
        return _failed(failed, folder.parent)
    row = FleetRow(
        campaign=str(campaign),
        folder=name,
        origin=origin,
        effects=effects_of(done.bundle),
        readings=readings,
        rig=fitted.rig_content,
        fit_logs=tuple(sorted({e.sha256 for e in fitted.provenance.logs if e.use == "fit"})),
        notices=done.notices,
        **_verdict(done),
    )
    row.write(done.folder)
    return row


def _failed(row: FleetRow, folder: Path) -> FleetRow:
    """The row; it replaces that of an earlier run, whose verdict no longer holds."""
    with contextlib.suppress(InputError):  # the folder may be what the failure is about
        if (folder / row.folder).is_dir():
            row.write(folder / row.folder)
    return row


def _show_notices(done: Fleet, verbose: bool) -> None:
    """Each campaign's own with its folder's name; grouped unless asked for."""
    lines = [f"{row.folder}: {line}" for row in done.rows for line in row.notices]
    if verbose:
        notices(lines)
    else:
        grouped_notices(lines, named=True)


def _verdict(done: RunReport) -> dict[str, Any]:
    if done.diagnosis is None:
        return {}
    whole = all(stage.complete for stage in done.stages if stage.name == "diagnose")
    sentence = wording.sentence(done.diagnosis)
    return {"verdict": done.diagnosis["verdict"], "sentence": sentence, "is_whole": whole}


def _show(done: Fleet, folder: Path) -> None:
    print_blocks((*done.tables(), ascii_text(done.headline()), f"page: {folder / PAGE_FILE}"))


__all__ = ["fleet", "run_fleet", "run_one"]
