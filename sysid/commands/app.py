"""The command line (`spec/cli.md`): one thin function a command, and no logic.

What a command computes with is imported inside it, so that `sysid --help` stays quick.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from sysid import __version__
from sysid.errors import SysidError

# Small matrices are slower on several BLAS threads; read when numpy is first imported.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

_FAULT = 1
_UNUSABLE = 2
_INTERRUPTED = 130

PathArgument = click.Path(path_type=Path)
_SEED = click.IntRange(min=0)


class _ReaderGoneError(Exception):
    """The reader of a pipe (head, less) went away; click would end with status 1."""


class _App(click.Group):
    """All commands, with what they print written before they end."""

    def make_context(self, *words: Any, **options: Any) -> click.Context:
        try:
            return super().make_context(*words, **options)  # prints --help
        except BrokenPipeError:
            raise _ReaderGoneError from None

    def invoke(self, ctx: click.Context) -> Any:
        try:
            found = super().invoke(ctx)
            sys.stdout.flush()
        except BrokenPipeError:
            raise _ReaderGoneError from None
        return found


class _FitGroup(click.Group):
    """`sysid fit friction LOG...` beside `sysid fit CAMPAIGN.toml`: a path is a campaign."""

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
            first.endswith(".toml") or os.sep in first or Path(first).exists()
        ):
            return "campaign", self.get_command(ctx, "campaign"), args
        return super().resolve_command(ctx, args)


def _options(*decorators: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def decorate(function: Any) -> Any:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorate


_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
_rig_option = click.option(
    "--rig", type=PathArgument, help="Rig file (else rig.toml in or above the log's folder)."
)
_map_option = click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="TARGET=COLUMN:UNIT",
    help='Foreign column and unit, e.g. "pressure_a_pa=P1:kPa(g)"; may be repeated.',
)
_effects_option = click.option(
    "--effects", type=PathArgument, help="Python file of a user's own effects; it is run."
)
_fit_options = _options(
    _rig_option,
    _map_option,
    click.option("-o", "output", type=PathArgument, help="Write a bundle of this part."),
    click.option("--into", type=PathArgument, help="Add this part to an existing bundle."),
    _json_option,
)


@click.group(cls=_App, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sysid")
def app() -> None:
    """Turn logged tests of a pneumatic actuator into a model that controllers can trust."""


@app.group(cls=_FitGroup)
def fit() -> None:
    """Identify parameters: one part from its logs, or a whole CAMPAIGN.toml."""


@fit.command("friction")
@click.argument("logs", nargs=-1, required=True, type=PathArgument, metavar="LOG...")
@click.option(
    "--kind",
    type=click.Choice(["static", "sliding", "motion"]),
    help="Take every test for this kind, whatever its content.",
)
@click.option("--inertia", "estimate_inertia", is_flag=True, help="Estimate the inertia too.")
@click.option(
    "--cutoff",
    "cutoff_hz",
    type=float,
    help="Zero-phase low-pass, Hz; by default 50, or as low as sampling and noise ask for.",
)
@_fit_options
def fit_friction(logs: Sequence[Path], as_json: bool, **options: Any) -> None:
    """Static, Coulomb and viscous friction from ramped, constant or general motion tests."""
    from sysid.commands import fit as pipelines
    from sysid.commands import printing as summary

    fitted = pipelines.fit_friction_logs(logs, **options)
    summary.show(fitted, as_json, summary.friction_tables)


_valve_option = click.option(
    "--valve", type=click.Choice(["a", "b"]), help="This valve only (else: by what moves)."
)


@fit.command("valve-discrete")
@click.argument("logs", nargs=-1, required=True, type=PathArgument, metavar="LOG...")
@_valve_option
@_fit_options
def fit_valve_discrete(logs: Sequence[Path], as_json: bool, **options: Any) -> None:
    """Choked flows, unchoked coefficients and delays of on/off valves, piston held."""
    from sysid.commands import fit as pipelines
    from sysid.commands import printing as summary

    fitted = pipelines.fit_valve_discrete_logs(logs, **options)
    summary.show(fitted, as_json, summary.valve_tables)


@fit.command("valve-pwm")
@click.argument("logs", nargs=-1, required=True, type=PathArgument, metavar="LOG...")
@_valve_option
@click.option(
    "--surface",
    type=click.Choice(["bipolynomial", "ann", "both"]),
    default="both",
    show_default=True,
    help="Which surface to fit; both are compared on held-out tests.",
)
@click.option(
    "--seed", type=_SEED, default=0, show_default=True, help="Of the folds and the restarts."
)
@click.option("--sweep", is_flag=True, help="Also find the smallest network that does (slow).")
@_fit_options
def fit_valve_pwm(logs: Sequence[Path], as_json: bool, **options: Any) -> None:
    """Mean flow over duty and pressure under PWM, and its inverse, piston held."""
    from sysid.commands import fit as pipelines
    from sysid.commands import printing as summary

    fitted = pipelines.fit_valve_pwm_logs(logs, **options)
    summary.show(fitted, as_json, summary.valve_tables)


@fit.command("campaign", hidden=True)
@click.argument("campaign", type=PathArgument)
@click.option("-o", "output", type=PathArgument, help="Write the bundle here.")
@_json_option
def fit_campaign(campaign: Path, output: Path | None, as_json: bool) -> None:
    """All that a campaign's fit logs hold, assembled into one bundle."""
    from sysid.commands import fit as pipelines
    from sysid.commands import printing as summary

    fitted = pipelines.fit_campaign_file(campaign, output, progress=summary.progress("fitting "))
    summary.show(fitted, as_json, summary.campaign_tables)


@app.command()
@click.argument("logs", nargs=-1, required=True, type=PathArgument, metavar="LOG...")
@_rig_option
@_map_option
@_json_option
def check(logs: Sequence[Path], rig: Path | None, maps: Sequence[str], as_json: bool) -> None:
    """Data quality of each LOG, and what it can and cannot identify."""
    from sysid.checks import log_check as checks
    from sysid.commands import printing as summary

    summary.show_checks(checks.check_logs(logs, rig, maps), as_json)


@app.command()
@click.argument("foreign", nargs=-1, required=True, type=PathArgument, metavar="FOREIGN...")
@click.option(
    "-o", "output", required=True, type=PathArgument, help="log.csv or log.parquet to write."
)
@_map_option
@click.option(
    "--set", "constants", multiple=True, metavar="TARGET=VALUE", help="A column of one value."
)
@click.option("--spec", "spec_file", type=PathArgument, help="A TOML with [map] and [options].")
@click.option("--delimiter", help="Of a text file, where it is not told by its look.")
@click.option("--decimal", help="Decimal sign of a text file: `.` or `,`.")
@click.option("--thousands", help="Thousands separator of a text file.")
@click.option("--skip-rows", type=int, help="Lines to leave out on top of a text file.")
@click.option(
    "--rows",
    metavar="FIRST:LAST",
    help='Rows of the table to keep, counted from 0, LAST not among them; also "::3, 2::3".',
)
@click.option("--no-header", is_flag=True, help="The first row is data; columns are #1, #2, ...")
@click.option("--sheet", help="Sheet of an Excel workbook.")
@click.option("--period", "period_s", type=float, help="Sampling period, s: no time column.")
@click.option("--atmosphere", "atmosphere_pa", type=float, help="Pa, for gauge pressures.")
@_json_option
def convert(foreign: Sequence[Path], output: Path, as_json: bool, **options: Any) -> None:
    """Bring a lab's own file (.mat, text, Excel, TDMS, Parquet) into the log format."""
    from sysid.commands import printing as summary
    from sysid.io import conversion

    summary.show_conversion(conversion.convert(foreign, output, **options), as_json)


@app.command()
@click.argument("campaign", type=PathArgument)
@click.option("--bundle", required=True, type=PathArgument, help="What was fitted.")
@click.option("--report", type=PathArgument, help="Write the HTML report here.")
@click.option("-o", "output", type=PathArgument, help="Write the bundle with its validation.")
@_effects_option
@_json_option
def validate(campaign: Path, bundle: Path, as_json: bool, **options: Any) -> None:
    """Open-loop simulation of a bundle's model against a campaign's motion logs."""
    from sysid.commands import printing as summary
    from sysid.commands.validate import validate_campaign

    validated = validate_campaign(campaign, bundle, progress=summary.progress(), **options)
    summary.show_validation(validated, as_json)


@app.command()
@click.argument("campaign", type=PathArgument)
@click.option("--bundle", required=True, type=PathArgument, help="What was fitted.")
@click.option("-o", "output", type=PathArgument, help="Write the extended bundle.")
@click.option("--report", type=PathArgument, help="Write the HTML report here.")
@_effects_option
@click.option("--seed", type=_SEED, default=0, show_default=True, help="Of the simulated twins.")
@_json_option
def diagnose(campaign: Path, bundle: Path, as_json: bool, **options: Any) -> None:
    """What the model lacks: the residual's cause, and the errors with it and without."""
    from sysid.commands import printing as summary
    from sysid.commands.diagnose import diagnose_campaign

    diagnosed = diagnose_campaign(campaign, bundle, progress=summary.progress(), **options)
    summary.show_diagnosis(diagnosed, as_json)


@app.command()
@click.argument("inputs", type=PathArgument)
@click.option("--bundle", required=True, type=PathArgument, help="What was fitted.")
@click.option("-o", "output", required=True, type=PathArgument, help="CSV or Parquet to write.")
@click.option(
    "--valve-model",
    type=click.Choice(["discrete", "bipolynomial", "ann"]),
    help="Else the on/off law where the bundle has it.",
)
@_map_option
@_effects_option
@_json_option
def simulate(inputs: Path, bundle: Path, output: Path, as_json: bool, **options: Any) -> None:
    """Open-loop simulation of the commands in INPUTS, a log."""
    from sysid.commands import printing as summary
    from sysid.commands.simulate import simulate_log

    summary.show_simulated(simulate_log(inputs, bundle, output, **options), as_json)


_run_options = _options(
    click.option(
        "--surface",
        type=click.Choice(["bipolynomial", "ann", "both"]),
        default="both",
        show_default=True,
        help="Which PWM surfaces to fit.",
    ),
    click.option(
        "--seed", type=_SEED, default=0, show_default=True, help="Of folds, restarts and twins."
    ),
    click.option(
        "--diagnose/--no-diagnose", default=True, help="Whether to look for what the model lacks."
    ),
    _effects_option,
    _json_option,
)


@app.command()
@click.argument("campaign", type=PathArgument)
@click.option("-o", "folder", required=True, type=PathArgument, help="Folder for all results.")
@_run_options
def run(campaign: Path, folder: Path, as_json: bool, **options: Any) -> None:
    """The whole pipeline, from checks to exports. Resumes where it stopped."""
    from sysid.commands import printing as summary
    from sysid.commands import run as pipeline

    done = pipeline.run_campaign(campaign, folder, progress=summary.progress(), **options)
    summary.show_run(done, as_json)


@app.command()
@click.option("-o", "folder", required=True, type=PathArgument, help="Folder for all results.")
@_run_options
def demo(folder: Path, as_json: bool, **options: Any) -> None:
    """The whole pipeline on the bundled campaign."""
    from sysid.commands import printing as summary
    from sysid.commands import run as pipeline
    from sysid.io.bundled import bundled_campaign

    done = pipeline.run_campaign(bundled_campaign(), folder, progress=summary.progress(), **options)
    summary.show_run(done, as_json)


@app.command()
@click.argument("bundle", type=PathArgument)
@click.option(
    "--format", "kind", required=True, type=click.Choice(["c", "mat", "json"]), help="What for."
)
@click.option("-o", "output", required=True, type=PathArgument, help="File to write.")
@_effects_option
@_json_option
def export(bundle: Path, kind: str, output: Path, effects: Path | None, as_json: bool) -> None:
    """What a controller consumes: a C header, a MATLAB file or flat JSON."""
    from sysid.commands import printing as summary
    from sysid.export import export_file

    notices = export_file(bundle, output, kind, effects=effects)
    summary.show_written(output, notices, as_json)


@app.command()
@click.argument("name", metavar="[ID]", required=False)
@_effects_option
@click.option("-o", "output", type=PathArgument, help="Picture of what ID changes, SVG or PNG.")
@_json_option
def effects(name: str | None, effects: Path | None, output: Path | None, as_json: bool) -> None:
    """The catalogue of effects; with ID all of one, and what it does to a rig."""
    from sysid.commands.effects import show_effects

    show_effects(name, effects, as_json, output)


@app.command()
@click.argument("rig", type=PathArgument)
@click.option("--linear", is_flag=True, help="A linear rig: metres, newtons, kilograms.")
@click.option("--force", is_flag=True, help="Write over a file that exists.")
def init(rig: Path, linear: bool, force: bool) -> None:
    """Write a commented rig file to fill in."""
    from sysid.io.rig_template import write_rig_template

    write_rig_template(rig, linear=linear, force=force)
    click.echo(f"{rig}: fill in what is known about the rig, then `sysid check LOG`")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status of `spec/cli.md`, errors as one line on standard error."""
    try:
        app(args=arguments, prog_name="sysid", standalone_mode=False)
    except SysidError as error:
        return _report("error", str(error), error.exit_code)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return _UNUSABLE
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "sysid"
        return _report(
            "error", f"{error.format_message().rstrip('.')}; see `{command} --help`", _UNUSABLE
        )
    except (click.Abort, KeyboardInterrupt):
        return _report("error", "interrupted; nothing was written by halves", _INTERRUPTED)
    except _ReaderGoneError:
        # What is left to print has no use.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if os.environ.get("SYSID_DEBUG"):
            raise
        what = f"{type(error).__name__}: {error}"
        return _report(
            "fault", f"{what} (a fault of sysid itself; SYSID_DEBUG=1 shows where)", _FAULT
        )
    return 0


def _report(kind: str, line: str, code: int) -> int:
    click.echo(f"sysid: {kind}: {' '.join(line.split())}", err=True)
    return code


if __name__ == "__main__":
    sys.exit(main())
