"""`sysid simulate`: a log of commands in, simulated channels out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.bundle.assembled_model import (
    DISCRETE,
    VALVE_MODELS,
    model_from_bundle,
    negative_friction,
    surfaces_for,
    surfaces_from_bundle,
)
from sysid.bundle.content import bundle_rig, read_bundle
from sysid.errors import NotIdentifiedError, input_error
from sysid.io.channels import PRESSURES
from sysid.io.logs import Log, Trial, read_log
from sysid.io.rig import Rig
from sysid.io.tables import write_table
from sysid.io.units import parse_map
from sysid.model.base import Parameters
from sysid.model.effects.catalogue import catalogue_with
from sysid.model.ports import has_discrete_law
from sysid.model.trials import simulate_trials, starts_on_supply
from sysid.types import FloatArray


@dataclass(frozen=True)
class Simulated:
    """What `sysid simulate` did: each trial with its channels (n,), and what to say."""

    trials: tuple[Trial, ...]
    channels: tuple[Mapping[str, FloatArray], ...]
    position: str
    valve_model: str
    notices: tuple[str, ...]
    written: Path

    def to_json(self) -> dict[str, Any]:
        """What `sysid simulate --json` prints."""
        return {
            "written": str(self.written),
            "valve_model": self.valve_model,
            "tests": [t.label for t in self.trials],
            "rows": sum(len(t) for t in self.trials),
            "notices": list(self.notices),
        }


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
    had its valve on (log format). `valve_model` None: the discrete law where the bundle has
    it, else a surface. `effects` is a file of a user's own effects, which is run. Raises
    InputError for unusable files, NotIdentifiedError where the bundle lacks what the model
    needs.
    """
    bundle = read_bundle(bundle_path)
    rig = bundle_rig(bundle, bundle_path)
    log = read_log(inputs, rig, parse_map(maps))
    catalogue = catalogue_with(effects) if effects else None
    model = model_from_bundle(bundle, rig, str(bundle_path), catalogue)
    chosen = valve_model or _first_valve_model(bundle, rig, model.parameters, str(bundle_path))
    notices = [*rig.notices, *log.notices, *negative_friction(bundle, str(bundle_path))]
    for trial in log.trials:
        _check_commands(trial, rig, chosen)
        notices += _start_notices(trial, rig)
    channels = simulate_trials(
        log.trials,
        rig,
        model,
        surfaces_for(bundle, rig, chosen, str(bundle_path)),
        [starts_on_supply(trial, rig) for trial in log.trials],
    )
    _write(log, rig, channels, output, [f"bundle: {bundle_path.name}", f"valve model: {chosen}"])
    return Simulated(
        log.trials,
        tuple(channels),
        rig.position_channel,
        chosen,
        tuple(dict.fromkeys(notices)),
        output,
    )


def _first_valve_model(
    bundle: Mapping[str, Any], rig: Rig, parameters: Parameters, where: str
) -> str:
    if has_discrete_law(parameters):
        return DISCRETE
    for name in VALVE_MODELS[1:]:
        if surfaces_from_bundle(bundle, rig, name, where) is not None:
            return name
    raise NotIdentifiedError(
        f"{where}: holds no model of both valves; fit valve-discrete tests of both into it"
    )


def _check_commands(trial: Trial, rig: Rig, valve_model: str) -> None:
    duties = [n for n in ("duty_a", "duty_b") if n in trial]
    if duties:
        rig.require("pwm", "which holds the PWM period")
    elif valve_model != DISCRETE:
        raise input_error(
            trial.source, f"holds no duty for the {valve_model} surfaces", "use discrete"
        )
    if duties or "valve_a" in trial or "valve_b" in trial:
        rig.require("valves", "which holds the valves' delays")


def _start_notices(trial: Trial, rig: Rig) -> list[str]:
    starts = {rig.position_channel: "0"} | dict.fromkeys(PRESSURES[:2], "the atmosphere")
    return [
        f"{trial.source}: no {name}: it starts at {start}"
        for name, start in starts.items()
        if name not in trial
    ]


def _write(
    log: Log,
    rig: Rig,
    channels: Sequence[Mapping[str, FloatArray]],
    output: Path,
    comments: Sequence[str],
) -> None:
    import pandas as pd

    names = ("valve_a", "valve_b", "duty_a", "duty_b", rig.effort_channel)
    frames = []
    for trial, simulated in zip(log.trials, channels, strict=True):
        columns: dict[str, Any] = {"time_s": trial.time}
        if len(log.trials) > 1 or trial.label:
            columns["test"] = trial.label
        columns |= {name: trial[name] for name in names if name in trial}
        frames.append(pd.DataFrame(columns | dict(simulated)))
    source = f"simulated from: {log.path.name}, SHA-256 {log.sha256}"
    write_table(pd.concat(frames, ignore_index=True), output, [source, *comments])
