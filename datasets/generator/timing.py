"""From valve commands to the moments at which the valves really move (`log-format.md`).

Edges are pairs of arrays: times (m,) s, and the state that each sets (1: supply, 0: exhaust).
"""

from __future__ import annotations

import numpy as np

from datasets.generator.plant import FloatArray, IntArray, compiled

CLOCK_SLACK_S = 1e-9  # a period that starts at a row, but for rounding, starts there

Edges = tuple[FloatArray, IntArray]


def no_edges() -> Edges:
    """A valve that nothing commands."""
    time: FloatArray = np.zeros(0)
    return time, np.zeros(0, dtype=np.int64)


def switched_commands(command: FloatArray, period: float) -> Edges:
    """Command edges of an on/off sequence (n,), a row every `period` s; off before row 0."""
    before = np.concatenate(([0.0], command[:-1]))
    rows = np.flatnonzero(command != before)
    return np.asarray(rows * period, dtype=np.float64), command[rows].astype(np.int64)


@compiled
def pwm_commands(duty: FloatArray, row_period: float, pwm_period: float, initial: int) -> Edges:
    """Command edges of a PWM signal whose duty (n,) is read when a period starts.

    The pulse is on from the period's start for duty * period. `initial` is the command before
    the first row.
    """
    periods = int(np.ceil((duty.size * row_period - CLOCK_SLACK_S) / pwm_period))
    times, states = np.empty(2 * periods), np.empty(2 * periods, dtype=np.int64)
    count, state = 0, initial
    for k in range(periods):
        start = k * pwm_period
        value = duty[min(int((start + CLOCK_SLACK_S) / row_period), duty.size - 1)]
        on = 1 if value > 0.0 else 0
        if on != state:
            times[count], states[count] = start, on
            count += 1
            state = on
        if 0.0 < value < 1.0:
            times[count], states[count] = start + value * pwm_period, 0
            count += 1
            state = 0
    return times[:count], states[:count]


@compiled
def movements(
    times: FloatArray, states: IntArray, on_delay: float, off_delay: float, initial: int
) -> Edges:
    """When the valve moves: each command after its delay, unless a later one overtakes it."""
    moved, to = np.empty(times.size), np.empty(times.size, dtype=np.int64)
    count = 0
    for i in range(times.size):
        when = times[i] + (on_delay if states[i] == 1 else off_delay)
        while count > 0 and moved[count - 1] >= when:
            count -= 1
        state = to[count - 1] if count > 0 else initial
        if states[i] != state:
            moved[count], to[count] = when, states[i]
            count += 1
    return moved[:count], to[:count]


def of_two_valves(fills: Edges, bleeds: Edges) -> Edges:
    """A chamber's state (1: on the supply, 0: exhaust, 2: shut) by its two valves' movements.

    Both are off before; where both are open, the chamber is taken to be on the supply.
    """
    time, valve, state = merged(fills, bleeds)
    opened, to = [0, 0], np.empty(time.size, dtype=np.int64)
    for i in range(time.size):
        opened[valve[i]] = int(state[i])
        to[i] = 1 if opened[0] else (0 if opened[1] else 2)
    return time, to


def merged(a: Edges, b: Edges) -> tuple[FloatArray, IntArray, IntArray]:
    """Both valves' movements in order of time: times (m,) s, valves (0: A, 1: B), states."""
    time = np.concatenate((a[0], b[0]))
    valve = np.repeat(np.array([0, 1], dtype=np.int64), (a[0].size, b[0].size))
    order = np.argsort(time, kind="stable")
    return time[order], valve[order], np.concatenate((a[1], b[1]))[order]
