"""Stretches of motion tests as runs of the simulator, each with its own start state."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from sysid.io.channels import LOG_COLUMNS, simulated_channels
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs
from sysid.plant.sensors import true_start
from sysid.recording.encoder import counts_at_rest
from sysid.recording.motion_tests import MotionTest, Segment
from sysid.recording.simulation import inputs_of, run_up_of
from sysid.types import FloatArray, IntArray

STATES = ("position", "velocity", "pressure_a", "pressure_b")
LEAST_ROWS = 50
LEAST_START_STD = (1e-9, 1e-9, 1e-3, 1e-3)
# A start that is known (a test at rest has no velocity) keeps its value.
_KNOWN = 1e-8
_NOT_LOGGED = 1e3


@dataclass(frozen=True)
class Run:
    """A stretch of a test that is simulated.

    `measured` (3, rows) position and pressures, NaN where not logged; `inputs` begin at the
    estimated start state, about which it may move by `start_std` (4,); `noise` (channels,) of a
    sample. `test` numbers the test among all, `name` says where the run is. `run_up`: what goes
    before it, for a model whose effects or sensors remember, and `as_measured` the inputs without
    that (`Problem.after_run_ups`).
    """

    test: int
    name: str
    inputs: Inputs
    measured: FloatArray
    start_std: FloatArray
    noise: FloatArray
    run_up: Inputs | None = None
    as_measured: Inputs | None = None

    @property
    def start(self) -> FloatArray:
        """The estimated start state, (4,): rad or m, rad/s or m/s, Pa, Pa."""
        return np.array([getattr(self.inputs, name) for name in STATES], dtype=float)

    def independent(self, channel: int, columns: FloatArray) -> FloatArray:
        """Columns (n, k) of a channel's rows as (m, k), whose errors are independent.

        At rest an encoder repeats one count with the same rounding error: the rows of a rest carry
        the information of one, and count as one, their mean.
        """
        if channel or np.isnan(self.measured[0]).any():
            return columns
        if len(self._rows) == len(columns):
            return columns
        found: FloatArray = np.add.reduceat(columns, self._rows, axis=0)
        return found / np.diff(self._rows, append=len(columns))[:, None]

    @functools.cached_property
    def _rows(self) -> IntArray:
        """The first row of each rest, and every other row."""
        count = len(self.inputs.time)
        changes = np.flatnonzero(np.diff(self.measured[0])) + 1
        first = np.concatenate([[0], changes])
        rests = counts_at_rest(changes, count)
        own = np.repeat(~rests, np.diff(first, append=count))
        own[first] = True
        return np.flatnonzero(own)

    def from_start(self, state: FloatArray) -> Inputs:
        """The run's inputs from another start state (4,)."""
        position, velocity, pressure_a, pressure_b = map(float, state)
        return dataclasses.replace(
            self.inputs,
            position=position,
            velocity=velocity,
            pressure_a=pressure_a,
            pressure_b=pressure_b,
        )


def runs_of(number: int, test: MotionTest, model: Model, position: str) -> list[Run]:
    """A test's segments as runs; the whole test where it has none."""
    return [
        run_of(number, test, segment, model, position)
        for segment in test.segments or (test.whole,)
        if segment.settled and test.counted(segment) >= LEAST_ROWS
    ]


def run_of(number: int, test: MotionTest, segment: Segment, model: Model, position: str) -> Run:
    """The rows of a segment that count, as a run."""
    rows = test.counted(segment)
    inputs = true_start(
        inputs_of(test, dataclasses.replace(segment, stop=segment.start + rows)), position, model
    )
    atmosphere = float(model.parameters.atmosphere)
    unknown: dict[str, Any] = {n: atmosphere for n in STATES[2:] if getattr(inputs, n) is None}
    moves = np.array([True, segment.state.values[1] != 0.0, True, True])
    inputs = dataclasses.replace(inputs, **unknown)
    std = np.maximum(np.nan_to_num(segment.state.std, nan=_NOT_LOGGED), LEAST_START_STD)
    # A channel that shows no noise at all is not known exactly.
    least = [LOG_COLUMNS[name].least_noise or 0.0 for name in simulated_channels(position)]
    # The samples that gave a start state are also the segment's: a tenth of the weight.
    return Run(
        test=number,
        name=f"{PurePath(test.source).name} at {inputs.elapsed:.1f} s",
        inputs=inputs,
        measured=test.measured[:, segment.start : segment.start + rows],
        start_std=np.where(moves & (std > _KNOWN), 10.0 * std, std),
        noise=np.fmax(test.noise.total, least),  # not NaN where it is not logged
        run_up=run_up_of(test, segment, position, model),
        as_measured=inputs,
    )


__all__ = ["LEAST_ROWS", "STATES", "Run", "run_of", "runs_of"]
