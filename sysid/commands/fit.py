"""`sysid fit`: log files in, a bundle out."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click

from sysid.blocks.numbers import ascii_text, si_cells
from sysid.blocks.quality import quality_table
from sysid.blocks.tables import Table, table
from sysid.checks.consistency.campaign import check_consistency
from sysid.commands.default_files import check_same_fit
from sysid.commands.options import (
    SEED,
    PathArgument,
    campaign_argument,
    component_option,
    exclude_option,
    json_option,
    logs_argument,
    map_option,
    options,
    report_option,
    rig_option,
)
from sysid.commands.own_component import read_with
from sysid.commands.printing import (
    notices,
    parameter_table,
    print_blocks,
    print_json,
    progress,
    unless_failed,
    written_lines,
)
from sysid.errors import SysidError, input_error
from sysid.friction import fit_friction
from sysid.identification.friction.volts import friction_in_volts
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign import FRICTION_POINTS, Campaign, CampaignLog
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.files import check_each_once
from sysid.io.logs import Log, Trial, exclusions_for, read_log
from sysid.io.rig import Rig, find_rig_file, read_rig
from sysid.io.source import Source
from sysid.io.tables import require_log
from sysid.io.units import parse_map
from sysid.parameters import (
    Bundle,
    FittedValves,
    Friction,
    assumptions,
    read_bundle,
    shown_by_logs,
    write_bundle,
)
from sysid.parameters.assumptions import FROM_LOG
from sysid.parameters.base import read_number
from sysid.pipeline.fit import PartResult, bench_fit, fit_campaign
from sysid.recording.friction_kind import classify_trial
from sysid.surfaces.kinds import SURFACES
from sysid.valve_discrete import fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm

Tables = Callable[["Fitted"], Iterable[Table]]
_NOWHERE = Path("none")


class _FitGroup(click.Group):
    """`sysid fit friction LOG...` and `sysid fit CAMPAIGN.toml`: a path is a campaign."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        options_first = bool(args) and args[0] not in ctx.help_option_names
        if options_first and args[0].startswith("-") and not set(args) & set(self.commands):
            args = ["campaign", *args]
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        first = args[0]
        if self.get_command(ctx, first) is None and (
            Path(first).suffix or os.sep in first or Path(first).exists()
        ):
            return "campaign", self.get_command(ctx, "campaign"), args
        return super().resolve_command(ctx, args)


@click.group(cls=_FitGroup)
def fit() -> None:
    """Identify parameters: one part from its logs, or a whole CAMPAIGN.toml."""


_part_options = options(
    rig_option,
    map_option,
    click.option(
        "-o",
        "output",
        type=PathArgument,
        help="Bundle of this part (default: STEM.KIND.bundle.json here; none: no bundle).",
    ),
    click.option("--into", type=PathArgument, help="Add this part to an existing bundle."),
    click.option(
        "--report",
        type=PathArgument,
        help="HTML report (default: STEM.KIND.report.html here).",
    ),
    click.option("--no-report", is_flag=True, help="Write no report."),
    exclude_option,
    json_option,
)
_valve_option = click.option(
    "--valve",
    type=click.Choice(["a", "b"]),
    help="This valve only (else: every valve that switches).",
)


@fit.command("friction")
@logs_argument
@click.option(
    "--kind",
    type=click.Choice(["static", "sliding", "motion", "points"]),
    help="Treat every test as this kind, whatever its content (points: a reading a row).",
)
@click.option("--inertia", "estimate_inertia", is_flag=True, help="Estimate the inertia too.")
@click.option(
    "--cutoff",
    "cutoff_hz",
    type=float,
    help="Zero-phase low-pass, Hz; by default 50, or lower as sampling and noise require.",
)
@_part_options
def _friction(
    kind: str | None,
    estimate_inertia: bool,
    cutoff_hz: float | None,
    as_json: bool,
    **files: Any,
) -> None:
    """Static, Coulomb and viscous friction from ramped, constant or general motion tests.

    A table of speed and effort without a time is one of readings, a row each.
    """

    def fit(trials: list[Trial], rig: Rig) -> PartResult:
        if kind == "points" or (kind is None and _are_readings(trials)):
            return bench_fit(FRICTION_POINTS, trials, rig)
        found = fit_friction(
            trials, rig, kind=kind, estimate_inertia=estimate_inertia, cutoff_hz=cutoff_hz
        )
        found.require_possible()
        return found

    fitted = _fit_part(
        "friction",
        fit,
        _Files(**files, readings=kind in (None, "points")),
        options={"cutoff_hz": cutoff_hz, "kind": kind},
    )
    _show(fitted, as_json, _friction_tables)


def _are_readings(trials: Sequence[Trial]) -> bool:
    """Whether all rows are readings taken by hand, without a time."""
    return bool(trials) and all(trial.is_readings for trial in trials)


@fit.command("valve-discrete")
@logs_argument
@_valve_option
@_part_options
def _valve_discrete(valve: str | None, as_json: bool, **files: Any) -> None:
    """Choked flows, unchoked coefficients and delays of on/off valves, piston held."""
    fitted = _fit_part(
        "valve-discrete",
        lambda trials, rig: fit_valve_discrete(trials, rig, valve=valve),
        _Files(**files),
        options={"valve": valve},
    )
    _show(fitted, as_json, _valve_tables)


@fit.command("valve-pwm")
@logs_argument
@_valve_option
@click.option(
    "--surface",
    type=click.Choice([*SURFACES, "both"]),
    default="both",
    show_default=True,
    help="Which surface to fit; both are compared on held-out tests.",
)
@click.option(
    "--seed", type=SEED, default=0, show_default=True, help="Seed of the folds and restarts."
)
@click.option("--sweep", is_flag=True, help="Also find the smallest sufficient network (slow).")
@_part_options
def _valve_pwm(
    valve: str | None, surface: str, seed: int, sweep: bool, as_json: bool, **files: Any
) -> None:
    """Mean flow over duty and pressure under PWM, and its inverse, piston held."""
    fitted = _fit_part(
        "valve-pwm",
        lambda trials, rig: fit_valve_pwm(
            trials, rig, valve=valve, surface=surface, seed=seed, sweep=sweep
        ),
        _Files(**files),
        seeds={"valve-pwm": seed},
        options={"valve": valve, "surface": surface},
    )
    _show(fitted, as_json, _valve_tables)


@fit.command("campaign", hidden=True)
@campaign_argument
@click.option("-o", "output", type=PathArgument, help="Write the bundle here.")
@component_option
@exclude_option
@report_option
@json_option
def _campaign(
    campaign: Path,
    output: Path | None,
    component: str | None,
    exclude: Sequence[str],
    report: Path | None,
    as_json: bool,
) -> None:
    """Everything that a campaign's training logs identify, in one bundle."""
    read = read_with(campaign, component, progress(), exclude)
    if component is not None:
        from sysid.components.campaign import fit_own

        own = fit_own(read, progress=progress("fitting "))
        if output is not None:
            write_bundle(own.bundle, output)
        _write_report(report, read, own.bundle)
        _show(Fitted(own.bundle, (), own.notices, output, report), as_json, _own_tables)
        return
    found = fit_campaign(read, progress=progress("fitting "))
    if output is not None:
        write_bundle(found.bundle, output)
    notices = (*found.contradictions, *check_consistency(read, "fit"), *found.notices)
    _write_report(report, read, found.bundle)
    fitted = Fitted(found.bundle, found.remarks, notices, output, report)
    _show(fitted, as_json, _campaign_tables)


# --- one part -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Fitted:
    """The result of a fit: the bundle, its remarks, and where it was written."""

    bundle: Bundle
    remarks: tuple[str, ...]
    notices: tuple[str, ...]
    written: Path | None = None
    report: Path | None = None

    def to_json(self) -> dict[str, Any]:
        """The output of `--json`: the bundle, what it rests on, the remarks and the files."""
        written = None if self.written is None else str(self.written)
        assumed = [one.to_json() for one in assumptions(self.bundle)]
        return {
            **self.bundle.to_json(),
            "remarks": list(self.remarks),
            "notices": list(self.notices),
            **({"assumed": assumed} if assumed else {}),
            "written": written,
            "bundle": written,
            "report": None if self.report is None else str(self.report),
        }


@dataclass(frozen=True)
class _Given:
    """The rig and its logs; `fitted_with` is the rig that the logs are read and fitted with.

    They differ where efforts are `in_volts`. `is_bare`: no rig file was given; the logs showed the
    constants `shown` (dotted keys).
    """

    rig: Rig
    fitted_with: Rig
    logs: tuple[Log, ...]
    notices: tuple[str, ...]
    in_volts: bool = False
    is_bare: bool = False
    shown: tuple[str, ...] = ()

    def options(self) -> dict[str, Any]:
        """What the provenance holds of a bare log's rig."""
        return {FROM_LOG: list(self.shown)} if self.is_bare else {}

    def said(self, line: str) -> str:
        """A line about the rig, which no file may describe."""
        return self.rig.said(line)

    @contextlib.contextmanager
    def errors(self) -> Iterator[None]:
        """Errors in the block name the rig as it is."""
        try:
            yield
        except SysidError as error:
            # It may be why nothing was found.
            notices(self.said(line) for log in self.logs for line in log.contradictions)
            error.args = tuple(self.said(str(one)) for one in error.args)
            raise


@dataclass(frozen=True)
class _Files:
    """The files that a partial fit reads and writes."""

    logs: Sequence[Path]
    rig: Path | None
    maps: Sequence[str]
    output: Path | None
    into: Path | None
    report: Path | None
    no_report: bool = False
    readings: bool = False
    exclude: Sequence[str] = ()

    def bundle_path(self, kind: str, sources: Sequence[Source]) -> Path | None:
        """Where the bundle of a fit goes; None for nowhere. Raises InputError."""
        if self.output == _NOWHERE:
            return self.into
        return self.output or self.into or self._default(kind, "bundle.json", sources)

    def report_path(self, kind: str, sources: Sequence[Source]) -> Path | None:
        """Where its page goes; None for nowhere. Raises InputError."""
        if self.no_report:
            return None
        return self.report or self._default(kind, "report.html", sources)

    def _default(self, kind: str, suffix: str, sources: Sequence[Source]) -> Path:
        """A file of the first log's name in this folder, which is not another fit's."""
        path = Path(f"{self.logs[0].stem}.{kind}.{suffix}")
        check_same_fit(path, kind, sources)
        return path


def _fit_part(
    kind: str,
    fit: Callable[[list[Trial], Rig], PartResult],
    files: _Files,
    *,
    seeds: Mapping[str, int] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Fitted:
    """Read the logs, fit, and write the part alone (`-o`) or added to a bundle (`--into`)."""
    existing = None if files.into is None else read_bundle(files.into)
    given = _read_logs(files, existing)
    rig, logs = given.rig, given.logs
    sources = [Source.of(log, "fit", kind) for log in logs]
    target, page = files.bundle_path(kind, sources), files.report_path(kind, sources)
    with given.errors():
        result = fit([t for log in logs for t in log.trials], given.fitted_with)
    part = result.part()
    if given.in_volts and part.friction is not None:
        has_pressures = any(name in log.channels for log in logs for name in CHAMBER_PRESSURES)
        part = friction_in_volts(part, has_pressures=has_pressures)
    bundle = Bundle.new(
        rig,
        part,
        sources,
        seeds=seeds,
        options={kind: {**(options or {}), **given.options()}},
    )
    lost = [] if existing is None else list(_lost(existing, bundle))
    if existing is not None:
        if given.is_bare:  # its rig is the bundle's own, of which this log may show more
            existing = existing.replaced(rig_content=rig.content)
        bundle = existing.merged(bundle)
    if target is not None:
        write_bundle(bundle, target)
    if page is not None:
        campaign = _as_campaign(given.fitted_with, logs, kind, files.maps, options or {})
        is_forced = bool((options or {}).get("kind"))
        _write_report(page, campaign, bundle, by_content=not is_forced)
    wrong = (line for log in logs for line in log.contradictions)
    read = (line for log in logs for line in log.notices)
    notices = tuple(dict.fromkeys((*wrong, *lost, *given.notices, *read, *result.notices)))
    remarks = tuple(map(given.said, result.remarks))
    return Fitted(bundle, remarks, tuple(map(given.said, notices)), target, page)


def _lost(existing: Bundle, added: Bundle) -> Iterator[str]:
    """A notice of numbers of a bundle that a part in their place does not identify."""
    if existing.friction is None or added.friction is None:
        return
    new = added.parameters
    lost = [
        row.key
        for row in existing.parameters.fitted().rows
        if row.origin == "friction" and row.estimate.identified
        if row.path not in new or not new[row.path].estimate.identified
    ]
    if lost:
        yield (
            f"{existing.source}: {', '.join(lost)} was identified there and is not by these logs: "
            "friction is replaced whole; give all friction logs at once to keep it"
        )


def _as_campaign(
    rig: Rig, logs: Sequence[Log], kind: str, maps: Sequence[str], options: Mapping[str, Any]
) -> Campaign:
    """The logs of one part as a report has them: each of the kind that it was fitted as."""
    mapping, valve = parse_map(maps), options.get("valve")
    declared = f"friction-{options['kind']}" if options.get("kind") else None
    entries = tuple(
        CampaignLog(
            declared or _kind_of(log, rig, kind),
            log.path.name,
            log.path,
            "fit",
            valve,
            mapping,
            exclude=tuple(one.exclusion for one in log.excluded),
        )
        for log in logs
    )
    return Campaign(logs[0].path, rig, entries)


def _kind_of(log: Log, rig: Rig, kind: str) -> str:
    """A campaign's kind; of friction tests the one that most of them are."""
    if kind != "friction":
        return kind
    if _are_readings(log.trials):
        return FRICTION_POINTS
    found = Counter(classify_trial(trial, rig) for trial in log.trials)
    return found.most_common(1)[0][0]


def _write_report(
    path: Path | None, campaign: Campaign, bundle: Bundle, *, by_content: bool = False
) -> None:
    """The page of a fit, with a check of every log; nothing without a path.

    `by_content`: logs that no campaign declares may hold tests of several kinds.
    """
    if path is None:
        return
    from sysid.checks.log_check import check_campaign
    from sysid.document import write_report
    from sysid.pipeline.subject import subject_of

    tell = progress()
    check = subject_of(campaign).checks
    if by_content:
        check = partial(check_campaign, campaign, by_content=True)
    checks = unless_failed("not checked", check, ())
    write_report(path, campaign=campaign, bundle=bundle, checks=checks, progress=tell)


def _read_logs(files: _Files, existing: Bundle | None) -> _Given:
    """The logs of one rig: that of `--rig`, of the rig file nearest to all of them, or a bare one.

    Parts of one bundle have one rig: a bare log that is added to a bundle has that bundle's.
    """
    check_each_once(files.logs, "log")
    mapping = parse_map(files.maps)
    excluded = exclusions_for(files.exclude, files.logs, mapping)
    found = {find_rig_file(p) for p in files.logs} if files.rig is None else {files.rig}
    for log in files.logs:
        require_log(log)
    if len(found) > 1:
        named = sorted("no rig file" if path is None else str(path) for path in found)
        raise input_error(
            " and ".join(named),
            "the logs belong to different rigs",
            "fit them one by one, or give one rig file with --rig",
        )
    (path,) = found
    if path is not None:
        rig = read_rig(path)
        logs = tuple(
            read_log(log, rig, mapping, exclude=own, readings=files.readings)
            for log, own in zip(files.logs, excluded, strict=True)
        )
        return _Given(rig, rig, logs, rig.notices)
    beside = None if existing is None else existing.rig_content
    bare = read_bare_logs(files.logs, mapping, beside, excluded, readings=files.readings)
    return _Given(
        bare.rig, bare.read_with, bare.logs, bare.notices, bare.in_volts, True, bare.shown
    )


# --- printing -----------------------------------------------------------------------------


def _show(fitted: Fitted, as_json: bool, tables: Tables) -> None:
    """A fit's summary or its JSON, and where the bundle is."""
    notices(fitted.notices)
    assumed = [one.line for one in assumptions(fitted.bundle)]
    if shown := shown_by_logs(fitted.bundle):
        assumed.append(f"from the log: {shown}")
    if as_json:
        notices(assumed)
        print_json(fitted.to_json())
        return
    written = [path for path in (fitted.written, fitted.report) if path is not None]
    judged = quality_table(fitted.bundle.qualities())
    print_blocks(map(ascii_text, assumed))
    print_blocks((*tables(fitted), judged, *written_lines(written)))


def _friction_tables(fitted: Fitted) -> Iterable[Table]:
    """The friction parameters, and static friction by position."""
    yield from _of_friction(fitted.bundle.friction)
    yield _remarks(fitted)


def _of_friction(friction: Friction | None) -> Iterable[Table]:
    if friction is not None:
        yield parameter_table("Friction", friction.estimates())
        sums = {name: row.estimate for name, row in friction.sums().items()}
        yield parameter_table("Identified only together", sums)
        columns = ("position", "tests", "value", "95 % interval", "unit")
        rows = tuple(
            (f"{row.position:.4g}", str(row.tests), *si_cells(row.static))
            for row in friction.positions()
        )
        yield table("Static friction by position", columns, rows)


def _valve_tables(fitted: Fitted) -> Iterable[Table]:
    """Each valve's flow parameters and delays, and its surfaces' errors."""
    valves = fitted.bundle.valves or FittedValves()
    for name, valve in valves.sides().items():
        if valve.discrete is not None:
            yield parameter_table(f"Valve {name.upper()}, on/off", valve.discrete.estimates())
    columns = (
        "valve", "direction", "surface", "RMSE", "largest relative error, %", "parameters",
    )  # fmt: skip
    title = "PWM surfaces, error in duty on held-out tests"
    yield table(title, columns, tuple(_surface_rows(valves)))
    yield _remarks(fitted)


def _surface_rows(valves: FittedValves) -> Iterator[tuple[str, ...]]:
    for name, valve in valves.sides().items():
        for direction, held in (valve.pwm.directions() if valve.pwm else {}).items():
            for kind, surface in held.surfaces().items():
                numbers = (surface.rmse_duty, surface.max_relative_error_duty_percent)
                cells = [f"{read_number(n):.3g}" for n in numbers]
                count = "41" if kind == "ann" else "9"
                yield name.upper(), direction, kind, *cells, count


def _remarks(fitted: Fitted) -> Table:
    return table("Remarks", ("",), tuple((remark,) for remark in fitted.remarks))


def _own_tables(fitted: Fitted) -> Iterable[Table]:
    """The parameters of a component of the user's own."""
    record = fitted.bundle.component
    if record is not None:
        yield parameter_table(f"{record.name} ({record.kind})", record.parameters)


def _campaign_tables(fitted: Fitted) -> Iterable[Table]:
    """Every part of a campaign's bundle."""
    yield from _of_friction(fitted.bundle.friction)
    yield from _valve_tables(fitted)
