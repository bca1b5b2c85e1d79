"""Dormand-Prince 5(4) between events that are located exactly.

Embedded Runge-Kutta pair of Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19-26. A step
whose end or middle lies past an event is taken again, shorter and shorter (bisection in time),
until the event is bracketed to `EVENT_TIME_S`; the state is put on the event and the mode changed.
"""

from __future__ import annotations

import numpy as np

from datasets.generator.plant import (
    HELD,
    N_EVENTS,
    N_MODES,
    N_STATES,
    OPEN_A,
    POSITION,
    PRESSURE_A,
    REGIME_A,
    SLIDE,
    FloatArray,
    IntArray,
    Plant,
    apply_events,
    compiled,
    derivative,
    margins,
    regime_at,
    stick_or_slide,
)

EVENT_TIME_S = 1e-12
SHORTEST_STEP_S = 1e-10
MOST_STEPS_A_ROW = 200_000

# Local error allowed a step: rad (m), rad/s (m/s), Pa, Pa; `tolerance` scales all four.
ERROR_SCALE = np.array([1e-9, 1e-8, 1e-3, 1e-3])

_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


@compiled
def _step(
    x: FloatArray,
    h: float,
    mode: IntArray,
    command: float,
    p: Plant,
    k: FloatArray,
    tolerance: float,
    end: FloatArray,
) -> float:
    """One step of `h` from `x`, whose derivative is `k[0]`: `end`, and the error over its limit."""
    for stage in range(1, 7):
        for i in range(N_STATES):
            total = 0.0
            for j in range(stage):
                total += _A[stage, j] * k[j, i]
            end[i] = x[i] + h * total
        derivative(end, mode, command, p, k[stage])
    worst = 0.0
    for i in range(N_STATES):
        total = 0.0
        for j in range(7):
            total += _ERROR[j] * k[j, i]
        worst = max(worst, abs(h * total) / (tolerance * ERROR_SCALE[i]))
    return worst


@compiled
def _locate(
    x: FloatArray,
    early: float,
    late: float,
    mode: IntArray,
    command: float,
    p: Plant,
    k: FloatArray,
    margin: FloatArray,
    end: FloatArray,
) -> float:
    """Bisect for the first event between the step lengths; `end` and `margin` just past it."""
    while late - early > EVENT_TIME_S:
        middle = 0.5 * (early + late)
        _step(x, middle, mode, command, p, k, 1.0, end)
        if margins(end, mode, command, p, margin) < 0.0:
            late = middle
        else:
            early = middle
    _step(x, late, mode, command, p, k, 1.0, end)
    margins(end, mode, command, p, margin)
    return late


@compiled
def _middle_is_past(
    x: FloatArray,
    end: FloatArray,
    h: float,
    mode: IntArray,
    command: float,
    p: Plant,
    k: FloatArray,
    margin: FloatArray,
) -> bool:
    """Whether the step's middle (cubic Hermite) lies past an event that its end does not show."""
    middle = np.empty(N_STATES)
    for i in range(N_STATES):
        middle[i] = 0.5 * (x[i] + end[i]) + 0.125 * h * (k[0, i] - k[6, i])
    return margins(middle, mode, command, p, margin) < 0.0


@compiled
def _advance(
    x: FloatArray,
    span: float,
    mode: IntArray,
    command: float,
    p: Plant,
    tolerance: float,
    h: float,
    work: FloatArray,
) -> float:
    """Integrate `x` over `span` s with inputs held; returns the step to go on with, or -1.

    `work` (7, 4) holds the stages. -1: the number of steps ran away, which no rig should do.
    """
    k, end, margin = work, np.empty(N_STATES), np.empty(N_EVENTS)
    if mode[HELD] == 0 and mode[SLIDE] == 0:
        stick_or_slide(x, mode, command, p)
    derivative(x, mode, command, p, k[0])
    elapsed = 0.0
    for _ in range(MOST_STEPS_A_ROW):
        left = span - elapsed
        if left <= EVENT_TIME_S:
            return h
        taken = min(h, left)
        error = _step(x, taken, mode, command, p, k, tolerance, end)
        factor = 5.0 if error < 3e-4 else 0.9 * error**-0.2
        if error > 1.0 and taken > SHORTEST_STEP_S:
            h = taken * max(factor, 0.1)
            continue
        past = margins(end, mode, command, p, margin) < 0.0
        if past or _middle_is_past(x, end, taken, mode, command, p, k, margin):
            if not past:  # a graze: look no further than the middle, if the step confirms it
                _step(x, 0.5 * taken, mode, command, p, k, tolerance, end)
                if margins(end, mode, command, p, margin) < 0.0:
                    past, taken = True, 0.5 * taken
                else:
                    _step(x, taken, mode, command, p, k, tolerance, end)
            if past:
                taken = _locate(x, 0.0, taken, mode, command, p, k, margin, end)
                apply_events(end, mode, command, p, margin)
                x[:] = end
                derivative(x, mode, command, p, k[0])
                elapsed += taken
                continue
        x[:] = end
        k[0] = k[6]
        elapsed += taken
        if taken == h or factor < 1.0:
            h = taken * max(factor, 0.1)
    return -1.0


@compiled
def _switch(x: FloatArray, mode: IntArray, valve: int, state: int, p: Plant) -> None:
    """A valve has moved: its new position and the regime that its chamber is in."""
    mode[OPEN_A + valve] = state
    mode[REGIME_A + valve] = regime_at(x[PRESSURE_A + valve], state, p)


@compiled
def integrate(
    p: Plant,
    period: float,
    motor: FloatArray,
    edge_time: FloatArray,
    edge_valve: IntArray,
    edge_state: IntArray,
    start: FloatArray,
    opened: IntArray,
    held: bool,
    band: FloatArray,
    tolerance: float,
) -> tuple[FloatArray, int]:
    """States at each row, (n, 4), and how many rows were reached.

    `motor` (n,) is the effort commanded from each row to the next, `period` s apart. Edges are the
    moments at which valve 0 (A) or 1 (B) really moves, in order of time. `opened` (2,) is the
    valves' position before the first row, `start` (4,) the state, at rest. The run ends after the
    first row whose position lies outside `band` (2,). A count of 0 rows means that the number of
    steps ran away.
    """
    n = motor.size
    states = np.empty((n, N_STATES))
    work = np.empty((7, N_STATES))
    x = start.copy()
    mode = np.zeros(N_MODES, dtype=np.int64)
    mode[HELD] = 1 if held else 0
    for valve in range(2):
        _switch(x, mode, valve, opened[valve], p)
    edge, now, h = 0, 0.0, period
    for row in range(n):
        row_start, row_end = row * period, (row + 1) * period
        now = row_start
        states[row] = x
        if x[POSITION] < band[0] or x[POSITION] > band[1]:
            return states, row + 1
        while True:
            until = row_end
            switches = edge < edge_time.size and edge_time[edge] < row_end
            if switches:
                until = max(edge_time[edge], now)
            h = _advance(x, until - now, mode, motor[row], p, tolerance, h, work)
            if h < 0.0:
                return states, 0
            now = until
            if not switches:
                break
            _switch(x, mode, edge_valve[edge], edge_state[edge], p)
            edge += 1
    return states, n
