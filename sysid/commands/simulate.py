"""`sysid simulate`: a log of commands in, simulated channels out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from sysid.blocks.numbers import number, span
from sysid.blocks.tables import table
from sysid.commands.options import (
    SEED,
    PathArgument,
    bundle_option,
    draws_option,
    effects_option,
    json_option,
    map_option,
)
from sysid.commands.printing import notices, print_blocks, print_json, progress, written_lines
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
@draws_option
@click.option("--seed", type=SEED, default=0, help="Seed of the draws.")
@map_option
@effects_option
@json_option
def simulate(
    inputs: Path, bundle: Path, output: Path, maps: Sequence[str], as_json: bool, **options: Any
) -> None:
    """Open-loop simulation of the commands in INPUTS, a log."""
    given = {name: value for name, value in options.items() if value is not None}
    asked = SimulateOptions(**given, progress=progress())
    _show(simulate_log(inputs, bundle, output, maps, asked), as_json)


def _show(simulated: SimulatedLog, as_json: bool) -> None:
    """The range of each channel by test, and where the result is."""
    notices(simulated.notices)
    if as_json:
        print_json(simulated.to_json())
        return
    names = [simulated.position, *simulated.pressures]
    title = f"Simulated, {simulated.valve_model} valves" if simulated.pressures else "Simulated"
    rows = []
    for at, (trial, channels) in enumerate(zip(simulated.trials, simulated.channels, strict=True)):
        ranges = [channels[name] for name in names]
        cells = [span(float(r.min()), float(r.max()), 4) for r in ranges]
        widths = [number(w, 2) for w in simulated.widths(at).values()]
        rows.append((trial.label or "-", f"{trial.time[-1] - trial.time[0]:.3g}", *cells, *widths))
    own = [f"{name}, 90 % band" for name in names] if simulated.bands else []
    shown = table(title, ("test", "s", *names, *own), rows)
    print_blocks((shown, *written_lines([simulated.written])))
