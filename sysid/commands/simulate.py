"""`sysid simulate`: a log of commands in, simulated channels out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from sysid.blocks.numbers import number
from sysid.blocks.tables import table
from sysid.commands.options import (
    PathArgument,
    bundle_option,
    effects_option,
    json_option,
    map_option,
)
from sysid.commands.printing import notices, print_blocks, print_json, written_lines
from sysid.io.logs import Trial, read_log
from sysid.io.tables import write_table
from sysid.io.units import parse_map
from sysid.parameters import read_bundle
from sysid.parameters.assembled_model import (
    assumed_parameters,
    first_valve_model,
    surfaces_for,
)
from sysid.plant.effects.catalogue import catalogue_with
from sysid.plant.trials import (
    assumed_starts,
    check_commands,
    simulate_trials,
    simulated_table,
    starts_on_supply,
)
from sysid.surfaces.kinds import SURFACES
from sysid.types import FloatArray


@click.command()
@click.argument("inputs", type=PathArgument)
@bundle_option
@click.option("-o", "output", required=True, type=PathArgument, help="CSV or Parquet to write.")
@click.option(
    "--valve-model",
    type=click.Choice(["discrete", "averaged", *SURFACES]),
    help="Default: the on/off law where the bundle has it.",
)
@map_option
@effects_option
@json_option
def simulate(inputs: Path, bundle: Path, output: Path, as_json: bool, **options: Any) -> None:
    """Open-loop simulation of the commands in INPUTS, a log."""
    _show(simulate_log(inputs, bundle, output, **options), as_json)


@dataclass(frozen=True)
class Simulated:
    """The result of `sysid simulate`: each trial with its channels (n,), and notices."""

    trials: tuple[Trial, ...]
    channels: tuple[Mapping[str, FloatArray], ...]
    position: str
    has_chambers: bool
    valve_model: str
    notices: tuple[str, ...]
    written: Path

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid simulate --json`."""
        return {
            "written": str(self.written),
            "valve_model": self.valve_model,
            "tests": [t.label for t in self.trials],
            "rows": sum(len(t) for t in self.trials),
            "notices": list(self.notices),
        }


def _show(simulated: Simulated, as_json: bool) -> None:
    """The range of each channel by test, and where the result is."""
    notices(simulated.notices)
    if as_json:
        print_json(simulated.to_json())
        return
    names = [simulated.position]
    title = "Simulated"
    if simulated.has_chambers:
        names += ["pressure_a_pa", "pressure_b_pa"]
        title += f", {simulated.valve_model} valves"
    rows = []
    for trial, channels in zip(simulated.trials, simulated.channels, strict=True):
        ranges = [channels[name] for name in names]
        cells = [f"{number(float(r.min()), 4)} to {number(float(r.max()), 4)}" for r in ranges]
        rows.append((trial.label or "-", f"{trial.time[-1] - trial.time[0]:.3g}", *cells))
    shown = table(title, ("test", "s", *names), rows)
    print_blocks((shown, *written_lines([simulated.written])))


def simulate_log(
    inputs: Path,
    bundle_path: Path,
    output: Path,
    *,
    valve_model: str | None = None,
    maps: Sequence[str] = (),
    effects: Path | None = None,
) -> Simulated:
    """Simulate every test of a log of commands and write the result in the log format.

    The rig is the bundle's. A test starts at rest, at its first row's position and pressures;
    one under PWM with the piston held that starts nearer to the supply than to the atmosphere
    starts with its valve on (log format). `valve_model` None: the discrete law where the bundle has
    it, else a surface. `effects` is a Python file with further effects, which is executed.
    Raises InputError for unusable files, NotIdentifiedError where the bundle lacks what the
    model needs.
    """
    bundle = read_bundle(bundle_path)
    rig = bundle.rig
    log = read_log(inputs, rig, parse_map(maps))
    catalogue = catalogue_with(effects) if effects else None
    model = bundle.model(rig, catalogue)
    chosen = valve_model or first_valve_model(bundle, rig, model.parameters)
    notices = [*rig.notices, *log.notices, *assumed_parameters(bundle)]
    for trial in log.trials:
        check_commands(trial, rig, chosen)
        notices += assumed_starts(trial, rig)
    channels = simulate_trials(
        log.trials,
        rig,
        model,
        surfaces_for(bundle, rig, chosen),
        [starts_on_supply(trial, rig) for trial in log.trials],
    )
    source = f"simulated from: {log.path.name}, SHA-256 {log.sha256}"
    write_table(
        simulated_table(log.trials, channels, rig),
        output,
        [source, f"bundle: {bundle_path.name}", f"valve model: {chosen}"],
    )
    return Simulated(
        log.trials,
        tuple(channels),
        rig.position_channel,
        rig.cylinder is not None,
        chosen,
        tuple(dict.fromkeys(notices)),
        output,
    )
