"""Trials through the simulator: their commands in, simulated channels out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import input_error
from sysid.io.channels import CHAMBER_PRESSURES, DUTIES, SIDES, SWITCHES, VALVE_COMMANDS
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.io.trial_kind import is_held
from sysid.plant.base import Parameters
from sysid.plant.ports import Model
from sysid.plant.sensors import measured_channels, true_start
from sysid.types import FloatArray

if TYPE_CHECKING:
    import pandas as pd

    from sysid.plant.simulator import Inputs, ValveCommand

# Rows and time (s) from which the velocity within a test is taken, the more of both.
_FIRST_ROWS, _FIRST_S = 8, 0.02

DISCRETE = "discrete"
"""The valve model that is the discrete law; the others are kinds of PWM surface."""


def inputs_from_trial(
    trial: Trial, rig: Rig, starts_on: tuple[bool, bool] = (False, False)
) -> Inputs:
    """A test's commands and first row, as a run of the simulator.

    A command that the test does not hold is off or zero; a position that it does not hold
    starts at 0, or where a designed test says, a pressure at the atmosphere; the run starts at
    rest. `starts_on`: whether valves A and B were on before the first row. A test whose start is
    excluded starts at the velocity that its first samples show, with the on/off commands that it
    has there. A supply that was logged is at the pressure that its line had in this test. Raises
    InputError for fewer than two rows, no command at all, commands out of range, or values that are
    missing.
    """
    from sysid.plant.simulator import Inputs

    if len(trial) < 2:
        raise input_error(trial.source, "has fewer than two rows", "give a longer test")
    commands: list[ValveCommand | None] = [
        _valve_command(trial, name, on)
        for name, on in zip(rig.valve_names, starts_on, strict=False)
    ]
    commands += [None] * (len(SIDES) - len(commands))
    if rig.effort_channel not in trial and commands == [None, None]:
        names = [f"{stem}_{side}" for stem in ("duty", "valve") for side in rig.valve_names]
        raise input_error(
            trial.source,
            "holds no command",
            f"add {', '.join(names)} or {rig.effort_channel}",
        )
    return Inputs(
        time=trial.time,
        motor=_finite(trial, rig.effort_channel) if rig.effort_channel in trial else _zero(trial),
        valve_a=commands[0],
        valve_b=commands[1],
        position=_start_of(trial, rig),
        pressure_a=_first(trial, "pressure_a_pa"),
        pressure_b=_first(trial, "pressure_b_pa") if "b" in rig.sides else None,
        velocity=_first_velocity(trial, rig),
        elapsed=trial.begun_s,
        load=rig.load_of(trial.payload_kg),
        supply=trial.line_pressure_pa,
    )


def _start_of(trial: Trial, rig: Rig) -> float:
    logged = _first(trial, rig.position_channel)
    return trial.starts_at if logged is None else logged


def _first_velocity(trial: Trial, rig: Rig) -> float:
    """0 at a test's start, where it is at rest; else that of its first samples."""
    name = rig.position_channel
    if trial.has_its_start or name not in trial:
        return 0.0
    rows = max(_FIRST_ROWS, math.ceil(_FIRST_S / trial.period))
    since = trial.time[:rows] - trial.time[0]
    line = np.polynomial.Polynomial.fit(since, trial[name][:rows], min(2, len(since) - 1))
    return float(line.deriv()(0.0))


def simulate_trials(
    trials: Sequence[Trial],
    rig: Rig,
    model: Model | Parameters,
    surfaces: tuple[Any, ...] = (),
    starts_on: Sequence[tuple[bool, bool]] | None = None,
) -> list[dict[str, FloatArray]]:
    """Open-loop simulation of every trial, all in one batch; channels (n,) by name.

    Names are those of the log format (`time_s`, `theta_rad` or `position_m`,
    `pressure_a_pa`, `pressure_b_pa` of the chambers that the rig has), and `velocity_rad_per_s` or
    `velocity_m_per_s`.
    Trials may differ in length. `surfaces`: valve A's and B's, for the averaged valve models
    (see `surfaces_for`); without, the discrete law under the real pulses. The first row's
    position and pressures are measured ones, and so are the results: the model's sensors lie
    between them and the true ones. Raises InputError
    as inputs_from_trial does, NotIdentifiedError where the model lacks a parameter.
    """
    from sysid.plant.simulator import simulate

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
        for name in set(CHAMBER_PRESSURES).difference(rig.pressure_channels):
            channels.pop(name, None)
        results.append({"time_s": trial.time, **channels})
    return results


def starts_on_supply(trial: Trial, rig: Rig) -> tuple[bool, bool]:
    """Whether valves A and B were on before the first row (log format).

    Under PWM with the piston held, nearer to the supply; a motion starts with its valves off.
    """
    if not (is_held(trial, rig) and trial.has_its_start):
        return False, False
    air = rig.require("air", "which the valves' flow needs")
    middle = 0.5 * (air.atmospheric_pressure_pa + air.supply_pressure_pa)
    way = rig.supply_way
    on = [
        f"duty_{side}" in trial
        and way * ((_first(trial, f"pressure_{side}_pa") or 0.0) - middle) > 0.0
        for side in SIDES
    ]
    return on[0], on[1]


def check_commands(trial: Trial, rig: Rig, valve_model: str) -> None:
    """InputError where a test's commands need what the rig file lacks, or the model duties."""
    duties = [n for n in DUTIES if n in trial]
    if duties:
        rig.require("pwm", "which holds the PWM period")
    elif valve_model != DISCRETE:
        raise input_error(
            trial.source, f"holds no duty for the {valve_model} surfaces", "use discrete"
        )
    if duties or any(name in trial for name in SWITCHES):
        rig.require("valves", "which holds the valves' delays")


def assumed_starts(trial: Trial, rig: Rig) -> list[str]:
    """Notices of the starting values that a test does not hold and that are assumed."""
    starts = {rig.position_channel: "0"}
    starts |= dict.fromkeys(rig.pressure_channels, "the atmosphere")
    return [
        f"{trial.source}: no {name}: it starts at {start}"
        for name, start in starts.items()
        if name not in trial
    ]


def simulated_table(
    trials: Sequence[Trial], channels: Sequence[Mapping[str, FloatArray]], rig: Rig
) -> pd.DataFrame:
    """Trials' commands and their simulated channels, one row a sample, as a log has them.

    `channels` is what `simulate_trials` returned; the column `test` is present where there
    are several trials, or the only one has a label.
    """
    import pandas as pd

    names = (*VALVE_COMMANDS, rig.effort_channel)
    frames = []
    for trial, simulated in zip(trials, channels, strict=True):
        columns: dict[str, Any] = {"time_s": trial.time}
        if len(trials) > 1 or trial.label:
            columns["test"] = trial.label
        columns |= {name: trial[name] for name in names if name in trial}
        frames.append(pd.DataFrame(columns | dict(simulated)))
    return pd.concat(frames, ignore_index=True)


def _valve_command(trial: Trial, side: str, starts_on: bool) -> ValveCommand | None:
    from sysid.plant.simulator import ValveCommand

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
    if not (trial.has_its_start or is_duty):
        starts_on = bool(values[0])  # it was switched before the first row
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
    "DISCRETE",
    "assumed_starts",
    "check_commands",
    "inputs_from_trial",
    "simulate_trials",
    "simulated_table",
    "starts_on_supply",
]
