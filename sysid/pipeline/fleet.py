"""Many campaigns through `run`, and one page over all of them."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from sysid import parallel
from sysid.diagnosis import wording
from sysid.errors import FAULT, Failure, InputError, SysidError
from sysid.fleet.origin import Origin, origin_of, result_folder
from sysid.fleet.rows import FleetRow, effects_of, readings_of
from sysid.fleet.trends import Fleet, fleet_of
from sysid.io.campaign import read_campaign
from sysid.io.files import check_each_once, write_atomic
from sysid.io.locks import clear_left, working_in
from sysid.parameters import read_bundle
from sysid.pipeline.fleet_monitor import with_alarms
from sysid.pipeline.request import takes
from sysid.pipeline.run import FITTED_FILE, RunOptions, RunReport, run_campaign
from sysid.plant.effects.catalogue import catalogue_with
from sysid.types import Progress, no_progress

PAGE_FILE = "fleet.html"
CONTENT_FILE = "fleet.json"
_ENDING_S = 3.0  # how long workers that are killed may take to be gone


def _silent(doing: str) -> Progress:
    return no_progress


@dataclass(frozen=True, kw_only=True)
class FleetOptions(RunOptions):
    """The options of each run, and where it is executed.

    `scheduler`: a Dask scheduler's address, or "local"; `reporter` gives the receiver of the steps
    of a campaign of this name, in any process; with `verbose` it receives all of them,
    else only the start.
    """

    scheduler: str | None = None
    verbose: bool = False
    reporter: Callable[[str], Progress] = _silent


@takes(FleetOptions)
def run_fleet(campaigns: Sequence[Path], folder: Path, options: FleetOptions) -> Fleet:
    """Run every campaign that is not up to date, and write the page.

    A campaign that cannot be run is a row that says why; the others go on. Raises InputError for
    a campaign given twice, a folder that cannot be written or in which another command works, and a
    scheduler that does not answer.
    """
    check_each_once(campaigns, "campaign")
    with working_in(folder):
        return _run_all(campaigns, folder, options)


def _run_all(campaigns: Sequence[Path], folder: Path, options: FleetOptions) -> Fleet:
    # Workers of a scheduler have other folders, and no way to this process' terminal.
    effects = None if options.effects is None else options.effects.resolve()
    verbose = options.verbose and not options.scheduler
    own = replace(options, effects=effects, verbose=verbose, progress=None)
    jobs = [partial(run_one, path.resolve(), folder.resolve(), own) for path in campaigns]
    with _cleaned_up(folder, campaigns), _workers(options.scheduler, options.tell):
        found = parallel.attempt_all(jobs)
    rows = [
        _failed(FleetRow.failed(path, result_folder(path), None, row.reason, FAULT), folder)
        if isinstance(row, Failure)
        else row
        for path, row in zip(campaigns, found, strict=True)
    ]
    done = fleet_of(with_alarms(rows, folder, effects, options.tell))
    write_atomic(folder / CONTENT_FILE, json.dumps(done.to_json(), indent=2) + "\n")
    from sysid.pipeline.pages.fleet import write_fleet_page

    options.tell("writing the page")
    write_fleet_page(folder / PAGE_FILE, done)
    return done


@contextlib.contextmanager
def _cleaned_up(folder: Path, campaigns: Sequence[Path]) -> Iterator[None]:
    """Removes what killed workers leave behind in their campaigns' folders."""
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


@takes(FleetOptions)
def run_one(campaign: Path, folder: Path, options: FleetOptions) -> FleetRow:
    """Run a campaign into its folder of the fleet; its row is written last."""
    name = result_folder(campaign)
    try:
        origin = origin_of(read_campaign(campaign))
    except SysidError as error:
        return _failed(FleetRow.failed(campaign, name, None, str(error), error.exit_code), folder)
    try:
        with working_in(folder / name):
            return _run_alone(campaign, origin, folder / name, options)
    except InputError as error:  # of the folder, in which another command may be at work
        return FleetRow.failed(campaign, name, origin, str(error), error.exit_code)


def _run_alone(campaign: Path, origin: Origin, folder: Path, options: FleetOptions) -> FleetRow:
    """`run_one` in the campaign's own folder."""
    name = folder.name
    try:
        tell = options.reporter(f"{name}: ")
        tell("starts")
        own = replace(options, progress=tell if options.verbose else no_progress)
        done = run_campaign(campaign, folder, own)
        fitted = read_bundle(done.folder / FITTED_FILE)
        readings = readings_of(fitted, done.bundle, catalogue_with(options.effects))
    except SysidError as error:
        failed = FleetRow.failed(campaign, name, origin, str(error), error.exit_code)
        return _failed(failed, folder.parent)
    unasked = () if options.verbose else done.unasked
    row = FleetRow(
        campaign=str(campaign),
        folder=name,
        origin=origin,
        effects=effects_of(done.bundle),
        readings=readings,
        rig=fitted.rig_content,
        fit_logs=tuple(sorted({e.sha256 for e in fitted.provenance.logs if e.use == "fit"})),
        notices=tuple(line for line in done.notices if line not in unasked),
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


def _verdict(done: RunReport) -> dict[str, Any]:
    if done.diagnosis is None:
        return {}
    whole = all(stage.complete for stage in done.stages if stage.name == "diagnose")
    sentence = wording.sentence(done.diagnosis)
    return {"verdict": done.diagnosis["verdict"], "sentence": sentence, "is_whole": whole}


__all__ = ["PAGE_FILE", "FleetOptions", "run_fleet", "run_one"]
