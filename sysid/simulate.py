"""Logs' inputs in, simulated channels out: `sysid simulate` and what it calls."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.bundle import bundle_rig, read_bundle
from sysid.errors import NotIdentifiedError, input_error
from sysid.kinds import is_held
from sysid.logs import PRESSURES, Log, Trial, read_log
from sysid.model.base import Parameters
from sysid.model.effects.serialise import Catalogue
from sysid.model.from_bundle import (
    catalogue_with,
    has_discrete_law,
    model_from_bundle,
    negative_friction,
    surfaces_from_bundle,
)
from sysid.model.ports import SIDES, Model
from sysid.model.sensors import measured_channels, true_start
from sysid.rig import Rig
from sysid.tables import write_table
from sysid.units import parse_map

if TYPE_CHECKING:
    from sysid.model.simulate import Inputs, ValveCommand

FloatArray = NDArray[np.float64]

DISCRETE = "discrete"
VALVE_MODELS = (DISCRETE, "bipolynomial", "ann")


def inputs_from_trial(
    trial: Trial, rig: Rig, starts_on: tuple[bool, bool] = (False, False)
) -> Inputs:
    """A test's commands and first row, as a run of the simulator.

    A command that the test does not hold is off or zero; a position that it does not hold
    starts at 0, a pressure at the atmosphere; the run starts at rest. `starts_on`: whether
    valves A and B were on before the first row. Raises InputError for fewer than two rows,
    no command at all, commands out of range, or values that are missing.
    """
    from sysid.model.simulate import Inputs

    if len(trial) < 2:
        raise input_error(trial.source, "has fewer than two rows", "give a longer test")
    commands = [_valve_command(trial, side, on) for side, on in zip(SIDES, starts_on, strict=True)]
    if rig.effort_channel not in trial and commands == [None, None]:
        raise input_error(
            trial.source,
            "holds no command",
            f"add duty_a, duty_b, valve_a, valve_b or {rig.effort_channel}",
        )
    return Inputs(
        time=trial.time,
        motor=_finite(trial, rig.effort_channel) if rig.effort_channel in trial else _zero(trial),
        valve_a=commands[0],
        valve_b=commands[1],
        position=_first(trial, rig.position_channel) or 0.0,
        pressure_a=_first(trial, "pressure_a_pa"),
        pressure_b=_first(trial, "pressure_b_pa"),
    )


def simulate_trials(
    trials: Sequence[Trial],
    rig: Rig,
    model: Model | Parameters,
    surfaces: tuple[Any, ...] = (),
    starts_on: Sequence[tuple[bool, bool]] | None = None,
) -> list[dict[str, FloatArray]]:
    """Open-loop simulation of every trial, all in one batch; channels (n,) by name.

    Names are those of the log format (`time_s`, `theta_rad` or `position_m`,
    `pressure_a_pa`, `pressure_b_pa`), and `velocity_rad_per_s` or `velocity_m_per_s`.
    Trials may differ in length. `surfaces`: valve A's and B's, for the averaged valve models
    (see `surfaces_for`); without, the discrete law under the real pulses. The first row's
    position and pressures are measured ones, and so are the results: the model's sensors lie
    between them and the true ones. Raises InputError
    as inputs_from_trial does, NotIdentifiedError where the model lacks a parameter.
    """
    from sysid.model.simulate import simulate

    if isinstance(model, Parameters):
        model = Model(model)
    on = starts_on or [(False, False)] * len(trials)
    inputs = [
        true_start(inputs_from_trial(t, rig, o), rig.position_channel, model)
        for t, o in zip(trials, on, strict=True)
    ]
    results = []
    for trial, run in zip(trials, simulate(inputs, [model] * len(inputs), surfaces), strict=True):
        channels = measured_channels(run, rig.position_channel, model)
        results.append({"time_s": trial.time, **channels})
    return results


def surfaces_for(
    bundle: Mapping[str, Any], rig: Rig, valve_model: str, where: str = "bundle"
) -> tuple[Any, ...]:
    """The surfaces of a valve model ("discrete": none) out of a bundle, for simulate_trials.

    Raises InputError for an unknown name, NotIdentifiedError where the bundle lacks one.
    """
    if valve_model not in VALVE_MODELS:
        raise input_error(
            f"valve model {valve_model!r}", "is unknown", f"use {', '.join(VALVE_MODELS)}"
        )
    if valve_model == DISCRETE:
        return ()
    surfaces = surfaces_from_bundle(bundle, rig, valve_model, where)
    if surfaces is None:
        raise NotIdentifiedError(
            f"{where}: holds no {valve_model} surfaces for both valves and directions; "
            "fit valve-pwm tests into it"
        )
    return surfaces


def simulate_bundle(
    trials: Sequence[Trial],
    rig: Rig,
    bundle: Mapping[str, Any],
    valve_model: str = DISCRETE,
    where: str = "bundle",
    catalogue: Catalogue | None = None,
) -> list[dict[str, FloatArray]]:
    """simulate_trials with what a bundle holds; raises as it, surfaces_for and the bundle do."""
    surfaces = surfaces_for(bundle, rig, valve_model, where)
    return simulate_trials(trials, rig, model_from_bundle(bundle, rig, where, catalogue), surfaces)


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


def starts_on_supply(trial: Trial, rig: Rig) -> tuple[bool, bool]:
    """Whether valves A and B were on before the first row (log format).

    Under PWM with the piston held, nearer to the supply; a motion starts with its valves off.
    """
    if not is_held(trial, rig):
        return False, False
    air = rig.require("air", "which the valves' flow needs")
    middle = 0.5 * (air.atmospheric_pressure_pa + air.supply_pressure_pa)
    on = [
        f"duty_{side}" in trial and (_first(trial, f"pressure_{side}_pa") or 0.0) > middle
        for side in SIDES
    ]
    return on[0], on[1]


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


def _valve_command(trial: Trial, side: str, starts_on: bool) -> ValveCommand | None:
    from sysid.model.simulate import ValveCommand

    names = [n for n in (f"duty_{side}", f"valve_{side}") if n in trial]
    used = [n for n in names if np.any(trial[n] != 0.0)] or names[:1]
    if not used:
        return None
    if len(used) == 2:
        raise input_error(
            trial.source, f"commands both {used[0]} and {used[1]}", "keep one of the two"
        )
    values = _finite(trial, used[0])
    is_duty = used[0].startswith("duty")
    wrong = (values < 0.0) | (values > 1.0) if is_duty else ~np.isin(values, (0.0, 1.0))
    if wrong.any():
        at = int(np.argmax(wrong))
        raise input_error(
            trial.source,
            f"{used[0]} = {values[at]:g} at {trial.time[at]:g} s",
            "a duty lies in 0 to 1" if is_duty else "a valve is 0 or 1",
        )
    return ValveCommand(values, is_duty, starts_on)


def _finite(trial: Trial, name: str) -> FloatArray:
    values = np.asarray(trial[name], dtype=float)
    missing = ~np.isfinite(values)
    if missing.any():
        raise input_error(
            trial.source,
            f"{name} is missing at {trial.time[int(np.argmax(missing))]:g} s",
            "a simulation needs every command",
        )
    return values


def _zero(trial: Trial) -> FloatArray:
    return np.zeros(len(trial))


def _first(trial: Trial, name: str) -> float | None:
    """A channel's first value; None if the test does not hold it."""
    if name not in trial:
        return None
    value = float(trial[name][0])
    if math.isnan(value):
        raise input_error(trial.source, f"{name} is missing in its first row", "give the start")
    return value


__all__ = [
    "VALVE_MODELS",
    "Simulated",
    "inputs_from_trial",
    "simulate_bundle",
    "simulate_log",
    "simulate_trials",
    "starts_on_supply",
    "surfaces_for",
]
