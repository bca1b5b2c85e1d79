"""Tests simulated open loop, whole or in segments, each from its own start state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.errors import SimulationError
from sysid.model.ports import Model
from sysid.model.sensors import measured_channels, true_start
from sysid.types import FloatArray
from sysid.validation.motion_tests import CHAMBER_PRESSURES, MotionTest, Segment

if TYPE_CHECKING:
    from sysid.model.simulator import Inputs


# Runs in one call of the simulator: one compiled shape serves every call.
_LANES = 32


def simulate_segments(
    segments: Sequence[tuple[MotionTest, Segment]],
    model: Model | Sequence[Model],
    surfaces: tuple[Any, ...] = (),
    position: str = "theta_rad",
) -> list[FloatArray]:
    """Position and pressures (3, rows) of each segment, simulated from its own start state.

    `model` is every segment's, or one each (of the same effects). The results are as the
    sensors show them, and so is the start state, which was measured: both go through the
    `measure` ports of the model's effects, which know the position by the name `position`.
    Effects count time from the test's start.
    Raises SimulationError where a simulation does not stay finite, instead of returning a number.
    """
    from sysid.model.simulator import simulate

    models = [model] * len(segments) if isinstance(model, Model) else list(model)
    inputs = [
        true_start(inputs_of(test, s), position, own)
        for (test, s), own in zip(segments, models, strict=True)
    ]
    # Runs of similar length share a call: a short one would wait for the longest.
    order = sorted(range(len(inputs)), key=lambda i: len(inputs[i].time))
    found: dict[int, FloatArray] = {}
    for first in range(0, len(order), _LANES):
        group = order[first : first + _LANES]
        padded = [*group, *[group[0]] * (_LANES - len(group))]
        runs = simulate([inputs[i] for i in padded], [models[i] for i in padded], surfaces)
        for i, run in zip(group, runs, strict=False):
            shown = measured_channels(run, position, models[i], inputs[i].elapsed)
            found[i] = np.array([shown[name] for name in (position, *CHAMBER_PRESSURES)])
            if not np.isfinite(found[i]).all():
                why = "the simulation does not stay finite"
                raise SimulationError(f"{segments[i][0].source}: {why}")
    return [found[i] for i in range(len(inputs))]


def inputs_of(test: MotionTest, segment: Segment) -> Inputs:
    """A segment's commands and estimated start state as a run of the simulator."""
    from sysid.model.simulator import Inputs, ValveCommand

    rows = slice(segment.start, segment.stop)
    valves = [
        None if command is None else ValveCommand(command[rows], test.pulsed, starts_on)
        for command, starts_on in zip(test.commands, segment.starts_on, strict=True)
    ]
    position, velocity, *pressures = segment.state.values
    known = [None if math.isnan(p) else float(p) for p in pressures]
    return Inputs(
        time=test.time[rows],
        motor=test.motor[rows],
        valve_a=valves[0],
        valve_b=valves[1],
        position=float(position),
        velocity=float(velocity),
        pressure_a=known[0],
        pressure_b=known[1],
        elapsed=float(test.time[segment.start] - test.time[0]),
    )


__all__ = ["inputs_of", "simulate_segments"]
