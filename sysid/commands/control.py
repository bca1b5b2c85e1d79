"""`sysid control`: a bundle and a controller in, the closed loop's run out."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from sysid.commands.options import (
    SEED,
    PathArgument,
    accept_assumed_option,
    draws_option,
    effects_option,
    json_option,
    options,
)
from sysid.commands.printing import (
    Strong,
    notices,
    print_blocks,
    print_json,
    progress,
    written_lines,
)
from sysid.io.files import make_folder
from sysid.io.locks import working_in
from sysid.pipeline.control import MODES, ControlledRun, ControlOptions
from sysid.pipeline.control import control as control_bundle
from sysid.pipeline.control_table import TABLES, ControlTable, control_table
from sysid.pipeline.files import read_bundle
from sysid.types import Progress, no_progress

_run_options = options(
    click.option(
        "--controller",
        metavar="NAME",
        help="pva, backstepping, dvmpc, or FILE.py:CLASS, a controller of your own; it is run.",
    ),
    click.option("--trajectory", type=click.IntRange(1, 4), help="Thesis, Table 4.2.1."),
    click.option("--mode", type=click.Choice(MODES), help="Which actuators act."),
    click.option(
        "--payload",
        "payload_kg",
        type=click.FloatRange(min=0.0),
        metavar="KG",
        help="On the plant, unknown to the controller (which estimates it in the vertical).",
    ),
    click.option(
        "--plant-bundle", type=PathArgument, help="Bundle of the plant (default: BUNDLE)."
    ),
    click.option(
        "--inverse",
        type=click.Choice(ControlOptions.inverses),
        help="Where backstepping's duties come from (default: averaged).",
    ),
    click.option("--horizon", type=int, metavar="N", help="Prediction horizon of dvmpc, ticks."),
    click.option(
        "--varying-input",
        is_flag=True,
        default=None,
        help="dvmpc: the input may change within the horizon.",
    ),
    click.option(
        "--type",
        "backstepping_type",
        type=click.IntRange(1, 4),
        help="backstepping: 1 plain, 2 motor compensation, 3 feedforward, 4 both (default).",
    ),
    click.option(
        "--estimate-payload/--no-estimate-payload",
        default=None,
        help="In the vertical (default: where --payload is given).",
    ),
    click.option(
        "--perfect-sensors",
        is_flag=True,
        default=None,
        help="No quantisation, noise or filter between plant and controller.",
    ),
    click.option("--seed", type=SEED, default=0, help="Seed of the sensor noise and the draws."),
    draws_option,
)


@click.command()
@click.argument("bundle", type=PathArgument, required=False)
@_run_options
@click.option(
    "--table",
    type=click.Choice(TABLES),
    metavar="NUMBER",
    help="Recompute a table of the thesis (4.5.1 to 5.5.3), with BUNDLE as its rig.",
)
@click.option("-o", "output", type=PathArgument, help="Folder for the run's log and its page.")
@effects_option
@accept_assumed_option
@json_option
def control(bundle: Path | None, table: str | None, as_json: bool, **chosen: Any) -> None:
    """Closed-loop simulation with a controller that reads BUNDLE."""
    if table is not None:
        _no_run_options(chosen)
        found = tabulate(
            table,
            bundle,
            chosen["output"],
            accept_assumed=chosen["accept_assumed"],
            progress=progress(),
        )
        _show(found, as_json)
        return
    if bundle is None:
        raise click.UsageError("Missing argument 'BUNDLE'.")
    for name in ("controller", "trajectory", "mode"):
        if chosen[name] is None:
            raise click.UsageError(f"Missing option '--{name}'.")
    output = chosen["output"]
    with working_in(output) if output is not None else nullcontext():
        done = control_run(bundle, **chosen, progress=progress())
    _show(done, as_json)


def _no_run_options(chosen: dict[str, Any]) -> None:
    also = ("output", "seed", "accept_assumed")
    given = [n for n, v in chosen.items() if v is not None and n not in also]
    if given:
        names = {"payload_kg": "payload", "backstepping_type": "type"}
        name = names.get(given[0], given[0]).replace("_", "-")
        raise click.UsageError(f"--{name} does not go with --table.")


@dataclass(frozen=True)
class Controlled:
    """What `sysid control` did, and the files that were written."""

    found: ControlledRun | ControlTable
    written: tuple[Path, ...]

    def to_json(self) -> dict[str, Any]:
        """What `sysid control --json` prints."""
        return {**self.found.to_json(), "written": [str(path) for path in self.written]}


def control_run(
    bundle_path: Path,
    *,
    controller: str,
    plant_bundle: Path | None = None,
    output: Path | None = None,
    **options: Any,
) -> Controlled:
    """Run the closed loop and write it to the folder `output`, if there is one.

    `options` are those of `ControlOptions`, None for its own. Raises as `sysid.control` does.
    """
    if output is not None:
        make_folder(output)
    given = {name: value for name, value in options.items() if value is not None}
    plant = None if plant_bundle is None else read_bundle(plant_bundle)
    asked = ControlOptions(**given, plant=plant)
    found = control_bundle(read_bundle(bundle_path), controller, asked)
    return Controlled(found, () if output is None else found.write(output))


def tabulate(
    name: str,
    bundle_path: Path | None,
    output: Path | None,
    *,
    accept_assumed: bool = False,
    progress: Progress = no_progress,
) -> Controlled:
    """Compute a table of the thesis and write its page to the folder `output`."""
    if output is not None:
        make_folder(output)
    bundle = None if bundle_path is None else read_bundle(bundle_path)
    found = control_table(name, bundle, accept_assumed=accept_assumed, progress=progress)
    return Controlled(found, () if output is None else found.write(output))


def _show(done: Controlled, as_json: bool) -> None:
    found = done.found
    notices(getattr(found, "notices", ()))
    if as_json:
        print_json(done.to_json())
        return
    if isinstance(found, ControlledRun):
        said = [f"fault: {line}" for line in found.faults] or ["no fault"]
        print_blocks((Strong(found.headline()), *found.tables(), *said))
    else:
        print_blocks(found.tables())
    print_blocks(written_lines(done.written))
