"""One test of a rig with undeclared effects: the plant integrated, then its imperfect sensors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from datasets.generator.effects.gas import N_EFFECT_STATES
from datasets.generator.effects.integrator import (
    SENSED_A,
    SENSED_B,
    SENSED_POSITION,
    integrate_with_effects,
)
from datasets.generator.effects.knobs import changed_plant, knobs_of, plant_record, step_s
from datasets.generator.effects.timing import changed_movements
from datasets.generator.plant import N_MODES, SHUT, FloatArray, IntArray, Plant
from datasets.generator.rigs import GeneratedRig
from datasets.generator.timing import Edges, merged, no_edges, of_two_valves


@dataclass
class Way:
    """How far the runs of one test have come, whose commands grow from one run to the next."""

    states: FloatArray = field(default_factory=lambda: np.zeros(N_EFFECT_STATES))
    mode: IntArray = field(default_factory=lambda: np.zeros(N_MODES, dtype=np.int64))
    reached: FloatArray = field(default_factory=lambda: np.zeros(3))
    steps: int = 0
    edges: tuple[FloatArray, IntArray, IntArray] | None = None

    def start_or_go_on(
        self, steps: int, edges: tuple[FloatArray, IntArray, IntArray], period: float
    ) -> None:
        """Back to the start, unless all valves have moved up to here as they do now."""
        row, passed = int(self.reached[0]), int(self.reached[1])
        last = (row - 1) * period + steps * (period / steps)
        if (
            self.edges is None
            or steps != self.steps
            or (edges[0][passed:] < last).any()
            or not all(
                np.array_equal(was[:passed], now[:passed])
                for was, now in zip(self.edges, edges, strict=True)
            )
        ):
            self.reached[:] = 0.0
        self.steps, self.edges = steps, edges


def integrated(
    rig: GeneratedRig,
    plant: Plant,
    motor: FloatArray,
    commands: tuple[Edges, Edges],
    start: FloatArray,
    opened: tuple[int, int],
    held: bool,
    band: tuple[float, float],
    tolerance: float,
    way: Way,
) -> tuple[FloatArray, Plant, Any]:
    """Rows (m, 8), m <= n, the plant with the rig's effects, and their knobs, as `sensed` has them.

    A row has four states, sensed position, pressures, supply, each before its sensor. `motor` (n,)
    Nm or N, `commands` both valves' command edges, `start` (4,), `opened` the valves before the
    first row. The run ends after the first row outside `band`; `tolerance` times the usual step is
    taken. Rows before where the `way` has come to are not filled in; it holds the states at the
    end. Raises ValueError for effects that do not go together, RuntimeError where the integration
    runs away.
    """
    knobs = knobs_of(rig.effects, rig)
    k = knobs[0]
    plant = changed_plant(plant, k, rig)
    delays = rig.content["valves"]
    edges = [
        changed_movements(
            commands[i],
            float(delays["on_delay_s"]),
            float(delays["off_delay_s"]),
            opened[i],
            k,
            "a" if rig.bleeds else "ab"[i],
        )
        for i in (0, 1)
    ]
    if rig.bleeds:
        edges, opened = [of_two_valves(*edges), no_edges()], (SHUT, 0)
    time, valve, state = merged(*edges)
    opened_array: IntArray = np.array(opened, dtype=np.int64)
    step = tolerance * step_s(rig.effects, time.size > 0)
    steps = max(1, round(rig.row_period / step))
    way.start_or_go_on(steps, (time, valve, state), rig.row_period)
    rows, count = integrate_with_effects(
        plant_record(plant), knobs, rig.row_period, steps, motor, time, valve, state,
        start, opened_array, held, np.array(band), way.states, way.mode, way.reached,
    )  # fmt: skip
    if count < len(motor) or len(motor) == 0:
        way.reached[:] = 0.0
    if count == 0:
        raise RuntimeError("the integration with effects diverged: are their sizes plausible?")
    return np.asarray(rows[:count]), plant, k


def sensed(
    rows: FloatArray, motor: FloatArray, plant: Plant, k: Any, row_period: float
) -> FloatArray:
    """Rows (m, 8) with the sensors' gains, offsets, cross-talk, eccentricity and lost counts."""
    scale = float(k["angle_scale"])
    torque = np.clip(motor, -plant.max_effort, plant.max_effort) / scale
    for column, side in ((SENSED_A, "a"), (SENSED_B, "b")):
        zero = plant.atmosphere if k[f"use_gauge_{side}"] > 0.0 else 0.0
        rows[:, column] += k[f"pressure_gain_{side}"] * (rows[:, column] - zero)
        rows[:, column] += k[f"pressure_offset_pa_{side}"]
        rows[:, column] += k[f"crosstalk_pa_per_nm_{side}"] * torque
    if k["encoder_rad"] != 0.0:
        angle = rows[:, SENSED_POSITION] * scale + k["encoder_phase_rad"]
        rows[:, SENSED_POSITION] += k["encoder_rad"] / scale * np.sin(angle)
    if k["lost_share"] != 0.0:
        moved = np.diff(rows[:, SENSED_POSITION], prepend=rows[0, SENSED_POSITION])
        seen = np.clip(moved, *(np.array([-1.0, 1.0]) * k["counted_rad_s"] / scale * row_period))
        # Of what comes too fast, or of all while it does.
        missed = np.where(moved == seen, 0.0, moved) if k["use_lost_of_all"] else moved - seen
        rows[:, SENSED_POSITION] -= k["lost_share"] * np.cumsum(missed)
    return rows
