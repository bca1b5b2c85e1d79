"""`sysid fit`: log files in, a bundle out."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import click

from sysid.blocks.numbers import ascii_text
from sysid.blocks.quality import quality_table
from sysid.blocks.tables import Table
from sysid.commands.options import (
    SEED,
    PathArgument,
    campaign_argument,
    component_option,
    exclude_option,
    json_option,
    law_option,
    load_option,
    logs_argument,
    map_option,
    options,
    report_option,
    rig_option,
)
from sysid.commands.printing import (
    notices,
    print_blocks,
    print_json,
    progress,
    written_lines,
)
from sysid.pipeline.files import read_with
from sysid.pipeline.fit_logs import FitFiles, Fitted, fit_logs
from sysid.pipeline.fit_part import (
    FrictionOptions,
    PartOptions,
    ValveDiscreteOptions,
    ValvePwmOptions,
)
from sysid.pipeline.fit_tables import campaign_tables, friction_tables, valve_tables

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
    help="This valve only (default: every valve that switches).",
)


@fit.command("friction")
@logs_argument
@click.option(
    "--kind",
    type=click.Choice(["static", "sliding", "motion", "points"]),
    help="Treat every test as this kind, whatever its content (points: one reading per row).",
)
@click.option("--inertia", "estimate_inertia", is_flag=True, help="Estimate the inertia too.")
@click.option(
    "--cutoff",
    "cutoff_hz",
    type=float,
    help="Zero-phase low-pass, Hz; by default 50, or lower as sampling and noise require.",
)
@load_option
@_part_options
def _friction(
    kind: str | None,
    estimate_inertia: bool,
    cutoff_hz: float | None,
    load: str | None,
    **files: Any,
) -> None:
    """Static, Coulomb and viscous friction from ramped, constant or general motion tests.

    A table of speed and effort without a time is one of readings, a row each.
    """
    asked = FrictionOptions(
        kind=kind, estimate_inertia=estimate_inertia, cutoff_hz=cutoff_hz, load=load
    )
    _fit_logs(asked, friction_tables, **files)


@fit.command("valve-discrete")
@logs_argument
@_valve_option
@law_option
@click.option(
    "--without-control",
    "without_control",
    multiple=True,
    type=PathArgument,
    metavar="LOG",
    help="A log of the valve without its flow control; may be repeated.",
)
@_part_options
def _valve_discrete(valve: str | None, law: str, **files: Any) -> None:
    """Flows and delays of on/off valves, piston held.

    By the thesis' law: choked flows and unchoked coefficients; by ISO 6358: sonic conductances and
    critical ratios; with a flow control in series (thesis-series): the coefficients of the valve
    and of its flow control, each alone.
    """
    _fit_logs(ValveDiscreteOptions(valve=valve, law=law), valve_tables, **files)


@fit.command("valve-pwm")
@logs_argument
@_valve_option
@click.option(
    "--surface",
    type=click.Choice(ValvePwmOptions.surfaces),
    default="both",
    show_default=True,
    help="Which surface to fit; both are compared on held-out tests.",
)
@click.option(
    "--seed", type=SEED, default=0, show_default=True, help="Seed of the folds and restarts."
)
@click.option("--sweep", is_flag=True, help="Also find the smallest sufficient network (slow).")
@law_option
@_part_options
def _valve_pwm(
    valve: str | None, surface: str, seed: int, sweep: bool, law: str, **files: Any
) -> None:
    """Mean flow over duty and pressure under PWM, and its inverse, piston held."""
    asked = ValvePwmOptions(valve=valve, surface=surface, seed=seed, sweep=sweep, law=law)
    _fit_logs(asked, valve_tables, **files)


def _fit_logs(asked: PartOptions, tables: Tables, *, as_json: bool, **files: Any) -> None:
    _show(fit_logs(asked, FitFiles(**files, progress=progress())), as_json, tables)


@fit.command("campaign", hidden=True)
@campaign_argument
@click.option("-o", "output", type=PathArgument, help="Write the bundle here.")
@law_option
@load_option
@component_option
@exclude_option
@report_option
@json_option
def _campaign(
    campaign: Path,
    output: Path | None,
    law: str,
    load: str | None,
    component: str | None,
    exclude: Sequence[str],
    report: Path | None,
    as_json: bool,
) -> None:
    """Everything that a campaign's training logs identify, in one bundle."""
    from sysid.pipeline.fit import contradictions_in, fit_campaign
    from sysid.pipeline.report import PageOptions, write_results

    read = read_with(campaign, component, progress(), exclude)
    found = fit_campaign(read, law=law, load=load, progress=progress("fitting "))
    said = (*found.contradictions, *contradictions_in(read), *found.notices)
    page = PageOptions(progress=progress(), notices=found.notices)
    unseen = write_results(read, found.bundle, page, output, report)
    fitted = Fitted(found.bundle, found.remarks, (*unseen, *said), output, report)
    _show(fitted, as_json, campaign_tables)


# --- printing -----------------------------------------------------------------------------


def _show(fitted: Fitted, as_json: bool, tables: Tables) -> None:
    """A fit's summary or its JSON, and where the bundle is."""
    notices(fitted.notices)
    assumed = fitted.assumed()
    if as_json:
        notices(assumed)
        print_json(fitted.to_json())
        return
    written = [path for path in (fitted.written, fitted.report) if path is not None]
    judged = quality_table(fitted.bundle.qualities())
    print_blocks(map(ascii_text, assumed))
    print_blocks((*tables(fitted), judged, *written_lines(written)))
