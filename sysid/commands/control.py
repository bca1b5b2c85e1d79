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
    headline,
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
from sysid.pipeline.tune import TunedGains, TuneOptions
from sysid.pipeline.tune import tune as tune_gains
from sysid.types import Progress, no_progress

_run_options = options(
    click.option(
        "--controller",
        metavar="NAME",
        help="pva, backstepping, dvmpc, force, or FILE.py:CLASS of your own; it is run.",
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
        "--stiffness",
        type=click.FloatRange(min=0.0, min_open=True),
        metavar="NM_PER_RAD",
        help="force: of the spring between arm and reference.",
    ),
    click.option(
        "--perfect-sensors",
        is_flag=True,
        default=None,
        help="No quantisation, noise or filter between plant and controller.",
    ),
    click.option("--gains", type=PathArgument, help="Gains from a file of --tune."),
    click.option(
        "--stability",
        is_flag=True,
        default=None,
        help="Conditions on the gains (4.3.50, 4.4.13), and what the run's errors allow (4.3.36).",
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
    help="Recompute a table of the thesis (4.4.3 to 6.5.22, A.1 to D.32), with BUNDLE as its rig.",
)
@click.option(
    "--max-torque",
    "max_torque_nm",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="NM",
    help="--table: the motor's largest torque, in place of the rig's.",
)
@click.option(
    "--no-valve-delays", is_flag=True, default=None, help="--table: valves that switch at once."
)
@click.option(
    "--tune",
    is_flag=True,
    help="Search the controller's gains for BUNDLE, with --draws robustly; -o DIR/gains.json.",
)
@click.option("-o", "output", type=PathArgument, help="Folder for the run's log and its page.")
@effects_option
@accept_assumed_option
@json_option
def control(
    bundle: Path | None, table: str | None, tune: bool, as_json: bool, **chosen: Any
) -> None:
    """Closed-loop simulation with a controller that reads BUNDLE."""
    if table is not None and tune:
        raise click.UsageError("--tune does not go with --table.")
    if table is not None:
        _no_run_options(chosen)
        found = tabulate(
            table,
            bundle,
            chosen["output"],
            max_torque_nm=chosen["max_torque_nm"],
            valve_delays=not chosen["no_valve_delays"],
            accept_assumed=chosen["accept_assumed"],
            progress=progress(),
        )
        _show(found, as_json)
        return
    if bundle is None:
        raise click.UsageError("Missing argument 'BUNDLE'.")
    needed = ("controller", "mode") if tune else ("controller", "trajectory", "mode")
    for name in needed:
        if chosen[name] is None:
            raise click.UsageError(f"Missing option '--{name}'.")
    for name in ("max_torque_nm", "no_valve_delays"):
        if chosen.pop(name) is not None:
            raise click.UsageError(f"--{_option(name)} goes with --table.")
    output = chosen["output"]
    if tune:
        _show(tuned(bundle, **_of_tuning(chosen), progress=progress()), as_json)
        return
    with working_in(output) if output is not None else nullcontext():
        done = control_run(bundle, **chosen, progress=progress())
    _show(done, as_json)


_TUNES = ("controller", "mode", "trajectory", "plant_bundle", "inverse", "draws", "seed", "output")


def _of_tuning(chosen: dict[str, Any]) -> dict[str, Any]:
    """The options of a search. UsageError for another that was given."""
    for name, value in chosen.items():
        if value is not None and name not in (*_TUNES, "accept_assumed"):
            raise click.UsageError(f"--{_option(name)} does not go with --tune.")
    return {name: chosen[name] for name in (*_TUNES, "accept_assumed")}


def _option(name: str) -> str:
    """An option as it is written."""
    names = {"payload_kg": "payload", "backstepping_type": "type", "max_torque_nm": "max-torque"}
    return names.get(name, name).replace("_", "-")


def _no_run_options(chosen: dict[str, Any]) -> None:
    also = ("output", "seed", "accept_assumed", "max_torque_nm", "no_valve_delays")
    given = [n for n, v in chosen.items() if v is not None and n not in also]
    if given:
        raise click.UsageError(f"--{_option(given[0])} does not go with --table.")


@dataclass(frozen=True)
class Controlled:
    """What `sysid control` did, and the files that were written."""

    found: ControlledRun | ControlTable | TunedGains
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
    max_torque_nm: float | None = None,
    valve_delays: bool = True,
    accept_assumed: bool = False,
    progress: Progress = no_progress,
) -> Controlled:
    """Compute a table of the thesis and write its page to the folder `output`."""
    if output is not None:
        make_folder(output)
    bundle = None if bundle_path is None else read_bundle(bundle_path)
    found = control_table(
        name,
        bundle,
        max_torque_nm=max_torque_nm,
        valve_delays=valve_delays,
        accept_assumed=accept_assumed,
        progress=progress,
    )
    return Controlled(found, () if output is None else found.write(output))


def tuned(
    bundle_path: Path,
    *,
    controller: str,
    trajectory: int | None,
    plant_bundle: Path | None,
    output: Path | None,
    progress: Progress,
    **options: Any,
) -> Controlled:
    """Search gains and write them to the folder `output`, if there is one.

    `options` are those of `TuneOptions`, None for its own. Raises as `tune` does.
    """
    if output is not None:
        make_folder(output)
    given = {name: value for name, value in options.items() if value is not None}
    plant = None if plant_bundle is None else read_bundle(plant_bundle)
    only = () if trajectory is None else (trajectory,)
    asked = TuneOptions(**given, plant=plant, trajectories=only, progress=progress)
    found = tune_gains(read_bundle(bundle_path), controller, asked)
    return Controlled(found, () if output is None else found.write(output))


def _show(done: Controlled, as_json: bool) -> None:
    found = done.found
    notices(getattr(found, "notices", ()))
    if as_json:
        print_json(done.to_json())
        return
    if isinstance(found, ControlledRun):
        said = [f"fault: {line}" for line in found.faults] or ["no fault"]
        print_blocks((headline(found), *found.tables(), *said))
    elif isinstance(found, TunedGains):
        print_blocks((headline(found), *found.tables()))
    else:
        print_blocks(found.tables())
    print_blocks(written_lines(done.written))
