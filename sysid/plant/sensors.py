"""What the sensors show of simulated channels, and the true start behind a measured one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sysid.io.channels import VELOCITY_CHANNELS
from sysid.plant.base import MAX_STEP
from sysid.plant.ports import Model
from sysid.plant.preparation import History
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.plant.simulator import Inputs, Trajectory


_Value = TypeVar("_Value", bound=Any)
_STATE = ("position", "velocity", "pressure_a", "pressure_b")
# Longer than a run-up: after that a link at 25 Hz still rings at a fifth of its amplitude.
_HISTORY_S = 0.5


def through_sensors(
    channels: Mapping[str, FloatArray], time: FloatArray, model: Model
) -> dict[str, FloatArray]:
    """Channels as the model's sensors show them: the `measure` port of every effect, in order.

    `channels` (n,) by log-format names (rad or m, Pa); `time` (n,) s since the test's start.
    """
    shown = dict(channels)
    for effect in model.effects:
        shown = effect.measure(shown, time)
    return shown


def without_errors(
    measured: Mapping[str, _Value], error: Callable[[dict[str, _Value]], Mapping[str, _Value]]
) -> dict[str, _Value]:
    """The fixed point of true = measured - `error`(true), by channel or command.

    Numbers or arrays, of any array library. Each of two iterations multiplies what is wrong by
    the slope of the error, 1e-2 or less for a sensor.
    """
    true = dict(measured)
    for _ in range(2):
        found = error(true)
        true = {name: value - found[name] for name, value in measured.items()}
    return true


def before_sensors(
    channels: Mapping[str, float], model: Model, elapsed: float = 0.0
) -> dict[str, float]:
    """The true values that the model's sensors show as `channels`, at rest.

    `channels` by log-format names (rad or m, Pa), `elapsed` s since the test's start. On two rows
    of a constant: offsets and gains are inverted; a lag and a delay do not change a constant.
    """
    if not model.effects:
        return dict(channels)
    time = elapsed + np.array([0.0, MAX_STEP])
    measured = {name: np.full(2, value, dtype=float) for name, value in channels.items()}

    def error(true: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        shown = through_sensors(true, time, model)
        return {name: shown[name] - row for name, row in true.items()}

    true = without_errors(measured, error)
    return {name: float(row[0]) for name, row in true.items()}


def measured_channels(
    run: Trajectory,
    position: str,
    model: Model,
    elapsed: float = 0.0,
    before: History | None = None,
) -> dict[str, FloatArray]:
    """A simulated run's position, velocity and pressures (n,) as the sensors show them.

    By name; `position` is the log's position channel. `elapsed`, and `before` what was seen, as in
    the run's `Inputs`.
    """
    seen = run.between or run
    time, states = seen.time - run.time[0], seen.states
    rows = None if run.between is None else run.between.rows
    if before is not None:
        # A run may begin elsewhere than what was before it ends: nothing jumps there.
        leading = before.states + (states[:, 0] - before.end)[:, None]
        rows = len(before.time) + (np.arange(len(run.time)) if rows is None else rows)
        time, states = np.append(before.time, time), np.hstack([leading, states])
    channels = dict(zip(state_channels(position), states, strict=True))
    shown = through_sensors(channels, time + elapsed, model)
    return shown if rows is None else {name: values[rows] for name, values in shown.items()}


def after_seeing(inputs: Inputs, before: Trajectory, position: str, model: Model) -> Inputs:
    """A run's inputs, its start measured, with what its sensors saw of the run that ends there.

    What they are behind at that end is added to the start. A run before it that does not stay
    finite changes nothing.
    """
    names, seen = state_channels(position), before.between or before
    end, time = before.states[:, -1], before.time
    begun = inputs.elapsed - float(time[-1] - time[0])
    shown = measured_channels(before, position, model, begun)
    measured = {name: float(shown[name][-1]) for name in names}
    taken = before_sensors(measured, model, inputs.elapsed)
    if not np.isfinite([*end, *taken.values()]).all():
        return inputs
    changes: dict[str, Any] = {
        field: value + (float(true) - taken[name])
        for name, field, true in zip(names, _STATE, end, strict=True)
        if (value := getattr(inputs, field)) is not None
    }
    late = slice(int(np.searchsorted(seen.time, time[-1] - _HISTORY_S)), -1)
    history = History(seen.time[late] - time[-1], seen.states[:, late], end)
    return dataclasses.replace(inputs, seen=history, **changes)


def true_start(inputs: Inputs, position: str, model: Model) -> Inputs:
    """Inputs whose start state was measured, with the sensors' errors removed.

    A pressure that is None, which starts at the atmosphere, was not measured. `position` as
    in `measured_channels`.
    """
    fields = dict(zip(state_channels(position), _STATE, strict=True))
    given = {name: getattr(inputs, field) for name, field in fields.items()}
    # An effect may read any channel: one that was not measured is set to the atmosphere.
    atmosphere = float(model.parameters.atmosphere)
    start = {name: atmosphere if value is None else value for name, value in given.items()}
    true = before_sensors(start, model, inputs.elapsed)
    changes: dict[str, Any] = {
        fields[name]: true[name] for name, value in given.items() if value is not None
    }
    return dataclasses.replace(inputs, **changes)


def state_channels(position: str) -> tuple[str, str, str, str]:
    """The channels that show position, velocity and pressures, in the order of the states."""
    return position, VELOCITY_CHANNELS[position], "pressure_a_pa", "pressure_b_pa"


__all__ = [
    "after_seeing",
    "before_sensors",
    "measured_channels",
    "state_channels",
    "through_sensors",
    "true_start",
    "without_errors",
]
