"""`sysid simulate`: a log of commands in, simulated channels out."""

from __future__ import annotations

from collections.abc import Sequence
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
from sysid.pipeline.simulate import SimulatedLog, SimulateOptions, simulate_log


@click.command()
@click.argument("inputs", type=PathArgument)
@bundle_option
@click.option("-o", "output", required=True, type=PathArgument, help="CSV or Parquet to write.")
@click.option(
    "--valve-model",
    type=click.Choice(SimulateOptions.valve_models),
    help="Default: the on/off law where the bundle has it.",
)
@map_option
@effects_option
@json_option
def simulate(
    inputs: Path, bundle: Path, output: Path, maps: Sequence[str], as_json: bool, **options: Any
) -> None:
    """Open-loop simulation of the commands in INPUTS, a log."""
    asked = SimulateOptions(**options)
    _show(simulate_log(inputs, bundle, output, maps, asked), as_json)


def _show(simulated: SimulatedLog, as_json: bool) -> None:
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
