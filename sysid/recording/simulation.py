"""Tests simulated open loop, whole or in segments, each from its own start state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import SimulationError
from sysid.io.channels import simulated_channels
from sysid.plant.ports import Model
from sysid.plant.sensors import after_seeing, measured_channels, true_start
from sysid.recording.motion_tests import MotionTest, Segment
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.plant.simulator import Inputs, Trajectory


NOT_FINITE = "the simulation switches without end, or does not stay finite"


def simulate_segments(
    segments: Sequence[tuple[MotionTest, Segment]],
    model: Model | Sequence[Model],
    surfaces: tuple[Any, ...] = (),
    position: str = "theta_rad",
    *,
    nan_if_endless: bool = False,
) -> list[FloatArray]:
    """Position and pressures (3, rows) of each segment, simulated from its own start state.

    `model` is every segment's, or one each (of the same effects). The results are as the
    sensors show them, and so is the start state, which was measured: both go through the
    `measure` ports of the model's effects, which know the position by the name `position`.
    Effects count time from the test's start.
    Raises SimulationError where a simulation switches without end or does not stay finite, instead
    of returning a number; with `nan_if_endless` all of that segment is NaN.
    """
    models = [model] * len(segments) if isinstance(model, Model) else list(model)
    inputs = [
        true_start(inputs_of(test, s), position, own)
        for (test, s), own in zip(segments, models, strict=True)
    ]
    run_ups = [
        run_up_of(test, s, position, own) for (test, s), own in zip(segments, models, strict=True)
    ]
    inputs = after_run_ups(inputs, run_ups, models, position, surfaces)
    found = []
    runs = _simulated(inputs, models, surfaces)
    for (test, _), one, run, own in zip(segments, inputs, runs, models, strict=True):
        shown = measured_channels(run, position, own, one.elapsed, one.seen)
        measured = np.array([shown[name] for name in simulated_channels(position)])
        if not np.isfinite(measured).all():
            if not nan_if_endless:
                raise SimulationError(f"{test.source}: {NOT_FINITE}")
            measured = np.full_like(measured, math.nan)
        found.append(measured)
    return found


def _simulated(
    inputs: Sequence[Inputs], models: Sequence[Model], surfaces: tuple[Any, ...]
) -> list[Trajectory]:
    """Runs in one batch; a single one too, which alone would be compiled for once more."""
    from sysid.plant.simulator import simulate

    twice = 2 if len(inputs) == 1 else 1
    runs = simulate([*inputs] * twice, [*models] * twice, surfaces, nan_if_endless=True)
    return runs[: len(inputs)]


def inputs_of(test: MotionTest, segment: Segment) -> Inputs:
    """A segment's commands and estimated start state as a run of the simulator."""
    from sysid.plant.simulator import Inputs, ValveCommand

    rows = slice(segment.start, segment.stop)
    valves = [
        None if command is None else ValveCommand(command[rows], test.pulsed, starts_on)
        for command, starts_on in zip(test.commands, segment.starts_on, strict=True)
    ]
    position, velocity, *pressures = segment.state.values
    known = [None if math.isnan(p) else float(p) for p in pressures]
    return Inputs(
        time=test.trial.time[rows],
        motor=test.commanded[rows],
        valve_a=valves[0],
        valve_b=valves[1],
        position=float(position),
        velocity=float(velocity),
        pressure_a=known[0],
        pressure_b=known[1],
        elapsed=float(test.since_start[segment.start]),
        load=test.load,
        supply=test.trial.line_pressure_pa,
    )


def run_up_of(test: MotionTest, segment: Segment, position: str, model: Model) -> Inputs | None:
    """The run-up to a segment as a run, for a model whose effects or sensors have memory."""
    remembers = bool(model.state_names) or model.has_remembering_sensor
    if segment.run_up is None or not segment.run_up.settled or not remembers:
        return None
    return true_start(inputs_of(test, segment.run_up), position, model)


def after_run_ups(
    inputs: Sequence[Inputs],
    run_ups: Sequence[Inputs | None],
    models: Sequence[Model],
    position: str,
    surfaces: tuple[Any, ...] = (),
) -> list[Inputs]:
    """Runs as measured, with the states of effects and sensors after the run-ups, if any.

    `position`: the log's position channel.
    """
    from sysid.plant.simulator import remembered_after

    found = list(inputs)
    known = [i for i, run_up in enumerate(run_ups) if run_up is not None]
    before = [one for one in run_ups if one is not None]
    own = [models[i] for i in known]
    runs = _simulated(before, own, surfaces)
    for i, run, remembered in zip(known, runs, remembered_after(before, runs, own), strict=True):
        found[i] = replace(found[i], remembered=remembered)
        if models[i].has_remembering_sensor:
            found[i] = after_seeing(found[i], run, position, models[i])
    return found


__all__ = ["NOT_FINITE", "after_run_ups", "inputs_of", "run_up_of", "simulate_segments"]
