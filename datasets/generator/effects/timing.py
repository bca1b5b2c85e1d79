"""Valve movements with undeclared delays, coil heating, lost pulses, and a spool that sticks."""

from __future__ import annotations

from typing import Any

import numpy as np

from datasets.generator.effects.compiling import compiled
from datasets.generator.plant import FloatArray
from datasets.generator.timing import Edges


@compiled
def without_short_pulses(times: FloatArray, states: Any, dead: float, on_only: bool) -> Edges:
    """Command edges without the pulses (and, unless `on_only`, the gaps) shorter than `dead` s."""
    kept, to = np.empty(times.size), np.empty(times.size, dtype=np.int64)
    count = 0
    for i in range(times.size):
        short = count > 0 and times[i] - kept[count - 1] < dead
        if short and (to[count - 1] == 1 or not on_only):
            count -= 1  # the pulse that this edge ends never moved the valve
        else:
            kept[count], to[count] = times[i], states[i]
            count += 1
    return kept[:count], to[:count]


@compiled
def shortened_pulses(times: FloatArray, states: Any, dead: float) -> Edges:
    """Command edges whose pulses lose `dead` s at their start; shorter ones vanish."""
    kept, to = np.empty(times.size), np.empty(times.size, dtype=np.int64)
    count = 0
    for i in range(times.size):
        when = times[i] + (dead if states[i] == 1 else 0.0)
        if count > 0 and to[count - 1] == 1 and kept[count - 1] >= when:
            count -= 1
        else:
            kept[count], to[count] = when, states[i]
            count += 1
    return kept[:count], to[:count]


def partly_opening_pulses(times: FloatArray, states: Any, dead: float, ratio: float) -> Edges:
    """Command edges without what is shorter than `dead` s, and hardly longer ones cut short.

    What lasts for `ratio` (above 1) times as long is obeyed whole; in between the valve opens (or
    closes) part of the way, which counts as a share of the time that rises from none to all.
    """
    times, states = without_short_pulses(times, states, dead, False)
    moved = np.array(times)
    for i in range(times.size - 1):
        lasts = times[i + 1] - times[i]
        if dead <= lasts < dead * ratio:
            share = (lasts - dead) / (dead * ratio - dead)
            moved[i] = times[i + 1] - share * dead * ratio
    return moved, states


@compiled
def stuck_commands(times: FloatArray, states: Any, most: float, rest: float, law: float) -> Edges:
    """Command edges whose openings come later by up to `most` s, the longer the valve rested.

    By `rest` s / (`rest` + time since it was let go), or if `law` is 1 its exponential; before the
    first edge it rested for ever. An opening may come after the closing that follows.
    """
    when = times.copy()
    let_go = -np.inf
    for i in range(times.size):
        if states[i] == 0:
            let_go = times[i]
            continue
        rested = times[i] - let_go
        held = np.exp(-rested / rest) if law == 1.0 else 1.0 / (1.0 + rested / rest)
        when[i] += most * (1.0 - held)
    return when, states


@compiled
def drifting_movements(
    times: FloatArray,
    states: Any,
    on_delay: float,
    off_delay: float,
    on_drift: float,
    off_drift: float,
    drift_time: float,
    initial: int,
) -> Edges:
    """When the valve moves, its delays growing by drift (1 - exp(-t / drift_time)), all in s."""
    moved, to = np.empty(times.size), np.empty(times.size, dtype=np.int64)
    count = 0
    for i in range(times.size):
        warmed = 1.0 - np.exp(-times[i] / drift_time)
        delay = on_delay + on_drift * warmed if states[i] == 1 else off_delay + off_drift * warmed
        when = times[i] + max(delay, 0.0)
        while count > 0 and moved[count - 1] >= when:
            count -= 1
        state = to[count - 1] if count > 0 else initial
        if states[i] != state:
            moved[count], to[count] = when, states[i]
            count += 1
    return moved[:count], to[:count]


def changed_movements(
    commands: Edges, on_delay: float, off_delay: float, initial: int, k: Any, side: str
) -> Edges:
    """Movements of valve `side` (`a` or `b`) from its command edges, with the effects of `k`."""
    times, states = commands
    dead = float(k[f"dead_s_{side}"])
    if dead > 0.0:
        law = k[f"use_dead_{side}"]
        if law == 2.0:
            times, states = shortened_pulses(times, states, dead)
        elif law == 3.0:
            ratio = float(k[f"dead_whole_ratio_{side}"])
            times, states = partly_opening_pulses(times, states, dead, ratio)
        else:
            times, states = without_short_pulses(times, states, dead, bool(law == 1.0))
    most = float(k[f"stick_s_{side}"])
    if most > 0.0:
        rest, law = float(k[f"stick_time_s_{side}"]), float(k[f"use_stick_{side}"])
        times, states = stuck_commands(times, states, most, rest, law)
    drift = float(k["heating_s"])
    return drifting_movements(
        times,
        states,
        on_delay + float(k[f"on_delay_s_{side}"]),
        off_delay + float(k[f"off_delay_s_{side}"]),
        drift,
        0.0 if k["use_on_only"] > 0.0 else drift,
        float(k["heating_time_s"]) or 1.0,
        initial,
    )
