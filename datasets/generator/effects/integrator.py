"""Fixed steps of Heun's method for a plant with undeclared effects.

Steps of 25 or 50 us end at every valve edge, and where the rates jump: a flow begins or ceases to
choke, the shaft breaks away, or its velocity changes sign. There it is at rest and sticks or moves
on, by effort and static friction.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from datasets.generator.effects.compiling import compiled
from datasets.generator.effects.gas import (
    FLOW_1,
    FLOW_2,
    GAS,
    N_EFFECT_STATES,
    RESERVOIR,
    SENSOR_1,
    SENSOR_2,
    backs,
    gas_rates,
    supplies,
)
from datasets.generator.effects.mechanics import (
    ARM,
    BRISTLE,
    MOTOR,
    PENDULUM,
    applied_effort,
    breakaway_level,
    bristle,
    drag_effort,
    free_effort,
    second_rates,
    sliding_level,
)
from datasets.generator.plant import (
    CRITICAL_RATIO,
    HELD,
    N_STATES,
    OPEN_A,
    OPEN_B,
    POSITION,
    PRESSURE_A,
    PRESSURE_B,
    SLIDE,
    VELOCITY,
    FloatArray,
    IntArray,
    static_load,
)

# Columns of a run, after the plant's four states.
SENSED_POSITION, SENSED_A, SENSED_B, SENSED_SUPPLY = 4, 5, 6, 7
N_COLUMNS = 8
SHORTEST_S = 1e-9
# Where the rates jump is located to this, and passed at once.
PASSAGE_S = 1e-8
# Where a pressure slides along a choked boundary it jumps again at once: the rest is taken whole.
MOST_PARTS = 8
# The arm's sag under its own weight, by iteration: a hundredth of what is left each time.
_SAG_PASSES = 8


@compiled
def _rates(
    x: FloatArray, mode: IntArray, time: float, command: float, p: Any, k: Any, dx: FloatArray
) -> None:
    for i in range(dx.size):
        dx[i] = 0.0
    held = mode[HELD] == 1
    second_rates(x, dx, command, p, k, held)
    if not held and k.bristle_compliance_rad_per_nm > 0.0:
        dx[BRISTLE], friction = bristle(x, time, command, p, k)
        friction += drag_effort(x[VELOCITY], p, k)
        dx[VELOCITY] = (applied_effort(x, time, command, p, k) - friction) / p.inertia
        dx[POSITION] = x[VELOCITY]
    elif not held and mode[SLIDE] != 0:
        speed = x[VELOCITY] * k.angle_scale
        friction = mode[SLIDE] * sliding_level(x, speed, time, command, p, k)
        friction += drag_effort(x[VELOCITY], p, k) + k.asymmetry_nm * k.angle_scale
        dx[VELOCITY] = (applied_effort(x, time, command, p, k) - friction) / p.inertia
        dx[POSITION] = x[VELOCITY]
    gas_rates(x, mode, time, p, k, dx)


@compiled
def _effort_at_rest(x: FloatArray, time: float, command: float, p: Any, k: Any) -> float:
    """What static friction has to hold."""
    effort = free_effort(x, time, command, p, k)
    if k.use_asymmetric_static > 0.0:
        effort -= k.asymmetry_nm * k.angle_scale
    return float(effort)


@compiled
def _stick_or_slide(
    x: FloatArray, mode: IntArray, time: float, stuck: float, command: float, p: Any, k: Any
) -> None:
    """At zero velocity: stuck unless the effort exceeds static friction."""
    x[VELOCITY] = 0.0
    effort = _effort_at_rest(x, time, command, p, k)
    if abs(effort) <= breakaway_level(x, time, stuck, command, p, k):
        mode[SLIDE] = 0
    else:
        mode[SLIDE] = 1 if effort > 0.0 else -1


@compiled
def _after_step(
    x: FloatArray, mode: IntArray, time: float, stuck: float, command: float, p: Any, k: Any
) -> None:
    """End stops, reversals and breakaway at a step's end."""
    if mode[HELD] == 1:
        return
    at_stop = abs(x[POSITION]) >= p.half_travel and x[POSITION] * x[VELOCITY] > 0.0
    if at_stop:
        x[POSITION] = p.half_travel if x[POSITION] > 0.0 else -p.half_travel
        x[VELOCITY] = 0.0
    if k.bristle_compliance_rad_per_nm > 0.0:
        return
    if at_stop or mode[SLIDE] * x[VELOCITY] < 0.0 or mode[SLIDE] == 0:
        _stick_or_slide(x, mode, time, stuck, command, p, k)


@compiled
def _margins(
    x: FloatArray, mode: IntArray, time: float, stuck: float, command: float, p: Any, k: Any
) -> tuple[float, float, float]:
    """Numbers that change sign where the rates jump: where a flow chokes, and friction reverses.

    Each chamber's pressure above its flow's choked boundary, Pa; the velocity along the motion, or
    what is left of static friction at rest.
    """
    supply_a, supply_b, _ = supplies(x, mode, time, p, k)
    back_a, back_b = backs(x, mode, p, k)
    a = CRITICAL_RATIO * supply_a if mode[OPEN_A] == 1 else back_a / CRITICAL_RATIO
    b = CRITICAL_RATIO * supply_b if mode[OPEN_B] == 1 else back_b / CRITICAL_RATIO
    shaft = 1.0
    if mode[HELD] == 0 and k.bristle_compliance_rad_per_nm <= 0.0:
        if mode[SLIDE] != 0:
            shaft = mode[SLIDE] * x[VELOCITY]
        else:
            effort = _effort_at_rest(x, time, command, p, k)
            shaft = breakaway_level(x, time, stuck, command, p, k) - abs(effort)
    return x[PRESSURE_A] - a, x[PRESSURE_B] - b, shaft


@compiled
def _passed(before: tuple[float, float, float], after: tuple[float, float, float]) -> bool:
    """Whether the rates have jumped between two `_margins`."""
    return bool(
        before[0] * after[0] < 0.0 or before[1] * after[1] < 0.0 or before[2] * after[2] < 0.0
    )


@compiled
def _advance(
    x: FloatArray, mode: IntArray, time: float, h: float, stuck: float, command: float,
    p: Any, k: Any, first: FloatArray, second: FloatArray, end: FloatArray,
) -> float:  # fmt: skip
    """One step of `h` s; returns for how long the shaft has been stuck, s. The last three: work.

    Where the rates jump it is taken in parts: up to there (both of Heun's rates from one side,
    found by bisection), across, and on.
    """
    done, parts = 0.0, 0
    while h - done > 0.0:
        now, whole = time + done, h - done
        _rates(x, mode, now, command, p, k, first)
        before = _margins(x, mode, now, stuck, command, p, k)
        early, late, step = 0.0, whole, whole
        while True:
            for i in range(x.size):
                end[i] = x[i] + step * first[i]
            _rates(end, mode, now + step, command, p, k, second)
            rest = stuck + step
            passed = _passed(before, _margins(end, mode, now + step, rest, command, p, k))
            for i in range(x.size):
                end[i] = x[i] + 0.5 * step * (first[i] + second[i])
            passed = passed or _passed(before, _margins(end, mode, now + step, rest, command, p, k))
            if parts >= MOST_PARTS or step <= PASSAGE_S:
                break
            if passed:
                late = step
            else:
                early = step
                if late - early <= PASSAGE_S:
                    break
            step = 0.5 * (early + late)
            if late - early <= PASSAGE_S:
                step = early if early > 0.0 else late
        x[:] = end
        done, parts = (h if step == whole else done + step), parts + 1
        _after_step(x, mode, time + done, stuck, command, p, k)
        stuck = stuck + step if mode[SLIDE] == 0 else 0.0
    return stuck


@compiled
def _start(start: FloatArray, p: Any, k: Any) -> FloatArray:
    """All states in rest at the plant's start (4,)."""
    x = np.zeros(N_EFFECT_STATES)
    x[:N_STATES] = start
    if k.use_gap == 1.0:
        x[MOTOR] = x[POSITION]
    x[ARM] = x[POSITION]
    if k.arm_inertia > 0.0:
        for _ in range(_SAG_PASSES):
            x[ARM] = x[POSITION] - static_load(x[ARM], p) / k.arm_stiffness
    x[PENDULUM] = x[POSITION]
    for i in range(2):
        c = p.a if i == 0 else p.b
        volume = (c.offset + c.direction * x[POSITION] * p.radius) * c.area
        mass = x[PRESSURE_A + i] * volume / (p.gas_constant * p.temperature)
        x[GAS + i] = p.temperature if k.use_heat == 2.0 else mass
        x[SENSOR_1 + i] = x[SENSOR_2 + i] = x[PRESSURE_A + i]
    x[FLOW_1 : FLOW_2 + 2] = 0.0
    x[RESERVOIR] = p.supply
    return x


@compiled
def _sensed(x: FloatArray, i: int, k: Any) -> float:
    """What the pressure sensor of chamber `i` (0: A) shows, Pa, before gain and offset."""
    lag = k.pressure_lag_s_a if i == 0 else k.pressure_lag_s_b
    second = k.use_sensor_second_a if i == 0 else k.use_sensor_second_b
    if lag <= 0.0:
        return float(x[PRESSURE_A + i])
    return float(x[SENSOR_2 + i] if second > 0.0 else x[SENSOR_1 + i])


@compiled
def _late(history: FloatArray, at: int, i: int, steps: float) -> float:
    """The sensed pressure `steps` fine steps before step `at`; the first value before the test."""
    place = max(at - steps, 0.0)
    low = int(place)
    share = place - low
    value = history[low, i]
    return float(value + share * (history[min(low + 1, at), i] - value) if share > 0.0 else value)


@compiled
def integrate_with_effects(
    plant: Any,
    knobs: Any,
    period: float,
    substeps: int,
    motor: FloatArray,
    edge_time: FloatArray,
    edge_valve: IntArray,
    edge_state: IntArray,
    start: FloatArray,
    opened: IntArray,
    held: bool,
    band: FloatArray,
    x: FloatArray,
    mode: IntArray,
    reached: FloatArray,
) -> tuple[FloatArray, int]:
    """Rows (n, 8), and how many were reached: four states, sensed position, pressures, supply.

    `plant` and `knobs` are `PLANT` and `KNOBS` arrays of one record, `substeps` the steps a row;
    the arguments from `motor` to `band` are those of `generator.integrator.integrate`. The last
    three are how far a run has come: all states, the mode, and the row (0: it starts), the edges
    passed and the time at rest. They are left as they are after the last row; only the rows since
    are filled in, their pressures without `k.skew_s_a` and `k.skew_s_b` unless the run started.
    """
    p, k = plant[0], knobs[0]
    n = motor.size
    rows = np.empty((n, N_COLUMNS))
    first, edge, stuck = int(reached[0]), int(reached[1]), reached[2]
    if first == 0:
        x[:] = _start(start, p, k)
        mode[:] = 0
        mode[HELD] = 1 if held else 0
        mode[OPEN_A], mode[OPEN_A + 1] = opened[0], opened[1]
    one, two, three = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    on_arm = k.use_encoder_on_arm > 0.0 and k.arm_inertia > 0.0
    late = max(k.skew_s_a, k.skew_s_b) > 0.0 and first == 0
    history = np.empty((n * substeps + 1 if late else 1, 2))
    step = period / substeps
    for row in range(first, n):
        now = row * period
        rows[row, :N_STATES] = x[:N_STATES]
        rows[row, SENSED_POSITION] = x[ARM] if on_arm else x[POSITION]
        rows[row, SENSED_A], rows[row, SENSED_B] = _sensed(x, 0, k), _sensed(x, 1, k)
        rows[row, SENSED_SUPPLY] = supplies(x, mode, now, p, k)[2]
        at = row * substeps
        if late:
            history[at, 0], history[at, 1] = rows[row, SENSED_A], rows[row, SENSED_B]
            rows[row, SENSED_A] = _late(history, at, 0, k.skew_s_a / step)
            rows[row, SENSED_B] = _late(history, at, 1, k.skew_s_b / step)
        if x[POSITION] < band[0] or x[POSITION] > band[1]:
            return rows, row + 1
        _after_step(x, mode, now, stuck, motor[row], p, k)
        for part in range(substeps):
            begin, end = row * period + part * step, row * period + (part + 1) * step
            while True:
                switches = edge < edge_time.size and edge_time[edge] < end
                until = max(edge_time[edge], begin) if switches else end
                h = until - begin
                if h > SHORTEST_S or not switches:
                    stuck = _advance(x, mode, begin, h, stuck, motor[row], p, k, one, two, three)
                    begin = until
                if not switches:
                    break
                mode[OPEN_A + edge_valve[edge]] = edge_state[edge]
                edge += 1
            if late:
                history[at + part + 1, 0] = _sensed(x, 0, k)
                history[at + part + 1, 1] = _sensed(x, 1, k)
        if not (np.isfinite(x[POSITION]) and x[PRESSURE_A] > 0.0 and x[PRESSURE_B] > 0.0):
            return rows, 0
    reached[0], reached[1], reached[2] = n, edge, stuck
    return rows, n
