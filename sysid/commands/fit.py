"""`sysid fit`: log files in, a bundle out."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from sysid.blocks.numbers import ascii_text, si_cells
from sysid.blocks.quality import quality_table
from sysid.blocks.tables import Table, table
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
from sysid.commands.printing import (
    notices,
    parameter_table,
    print_blocks,
    print_json,
    progress,
    written_lines,
)
from sysid.parameters import FittedValves, Friction, assumptions, shown_by_logs
from sysid.parameters.base import read_number
from sysid.pipeline.files import read_with
from sysid.pipeline.fit_logs import FitFiles, Fitted, fit_logs
from sysid.pipeline.fit_part import (
    FrictionOptions,
    PartOptions,
    ValveDiscreteOptions,
    ValvePwmOptions,
)
from sysid.pipeline.report import PageOptions, write_results
from sysid.surfaces.kinds import SURFACES

Tables = Callable[[Fitted], Iterable[Table]]


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
    kind: str | None, estimate_inertia: bool, cutoff_hz: float | None, **files: Any
) -> None:
    """Static, Coulomb and viscous friction from ramped, constant or general motion tests.

    A table of speed and effort without a time is one of readings, a row each.
    """
    asked = FrictionOptions(kind=kind, estimate_inertia=estimate_inertia, cutoff_hz=cutoff_hz)
    _fit_logs(asked, _friction_tables, **files)


@fit.command("valve-discrete")
@logs_argument
@_valve_option
@_part_options
def _valve_discrete(valve: str | None, **files: Any) -> None:
    """Choked flows, unchoked coefficients and delays of on/off valves, piston held."""
    _fit_logs(ValveDiscreteOptions(valve=valve), _valve_tables, **files)


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
def _valve_pwm(valve: str | None, surface: str, seed: int, sweep: bool, **files: Any) -> None:
    """Mean flow over duty and pressure under PWM, and its inverse, piston held."""
    asked = ValvePwmOptions(valve=valve, surface=surface, seed=seed, sweep=sweep)
    _fit_logs(asked, _valve_tables, **files)


def _fit_logs(asked: PartOptions, tables: Tables, *, as_json: bool, **files: Any) -> None:
    _show(fit_logs(asked, FitFiles(**files, progress=progress())), as_json, tables)


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
    from sysid.pipeline.fit import contradictions_in, fit_campaign

    read = read_with(campaign, component, progress(), exclude)
    found = fit_campaign(read, progress=progress("fitting "))
    said = (*found.contradictions, *contradictions_in(read), *found.notices)
    unseen = write_results(read, found.bundle, PageOptions(progress=progress()), output, report)
    fitted = Fitted(found.bundle, found.remarks, (*unseen, *said), output, report)
    _show(fitted, as_json, _campaign_tables)


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


def _campaign_tables(fitted: Fitted) -> Iterable[Table]:
    """Every part of a campaign's bundle, or the parameters of a component of the user's own."""
    record = fitted.bundle.component
    if record is not None:
        yield parameter_table(f"{record.name} ({record.kind})", record.parameters)
    yield from _of_friction(fitted.bundle.friction)
    yield from _valve_tables(fitted)
