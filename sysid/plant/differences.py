"""Slopes of simulated runs by differences of neighbours, simulated in one batch with them.

The same slopes as those of `tangents`, to some 1e-6, in less time, and nothing is compiled for
them (`benchmarks/tangents.py`): what a descent, a scan or the errors of a diagnosis need. Where a
neighbour breaks away at another sample of the command, the difference is a jump and no slope.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs
from sysid.plant.simulator import MAX_STEP, STATE, simulate_states
from sysid.plant.tangents import Direction, Tangents, with_step
from sysid.types import FloatArray

# Step as a share of a number's size, and the states' sizes (rad or m, rad/s or m/s, Pa).
_STEP = 1e-7
_SIZES = np.array([1.0, 1.0, 1e5, 1e5])
# Runs simulated at a time: their samples are all in memory.
_MOST_ROWS = 4_000_000


def simulate_differences(
    inputs: Sequence[Inputs],
    models: Sequence[Model],
    directions: Sequence[Direction],
    sizes: Sequence[float],
    max_step: float = MAX_STEP,
) -> list[Tangents]:
    """Simulate every run as `simulator.simulate` does, with slopes along `directions`.

    `sizes` (directions,): what a number is worth, in its own unit. Slopes as in
    `tangents.simulate_tangents`; raises as it does, but where a run switches without end, which
    is NaN from there on.
    """
    found: list[Tangents] = []
    width = 1 + len(STATE) + len(directions)
    for part in _portions([width * len(one.time) for one in inputs]):
        own = list(zip(inputs[part], models[part], strict=True))
        found += _differences(own, list(directions), sizes, max_step)
    return found


def _portions(rows: Sequence[int]) -> Iterator[slice]:
    first = total = 0
    for i, count in enumerate(rows):
        if total + count > _MOST_ROWS and i > first:
            yield slice(first, i)
            first, total = i, 0
        total += count
    yield slice(first, len(rows))


def _differences(
    pairs: list[tuple[Inputs, Model]],
    directions: list[Direction],
    sizes: Sequence[float],
    max_step: float,
) -> list[Tangents]:
    steps = _STEP * np.concatenate([_SIZES, sizes])
    starts = [_with_start(*pair) for pair in pairs]
    near = _neighbours(starts, directions, steps)
    lanes = [lane for pair, own in zip(starts, near, strict=True) for lane in (pair, *own)]
    width = 1 + len(steps)
    states = _simulated(lanes, max_step)
    found, jumps = [], []
    for i, (one, _) in enumerate(starts):
        here, *moved = states[i * width : (i + 1) * width]
        slopes = np.array(moved)
        slopes -= here
        slopes /= steps[:, None, None]
        if one.velocity == 0.0:
            slopes[1] = 0.0  # as a tangent: a small velocity at rest is braked at once
        found.append(Tangents(np.array(here), slopes))  # not the block that it is a part of
        jumps += [(i, j) for j in np.flatnonzero(_jumps(slopes, steps))]
    if jumps:
        behind = _neighbours([starts[i] for i, _ in jumps], directions, -steps)
        other = [own[j] for own, (_, j) in zip(behind, jumps, strict=True)]
        for (i, j), there in zip(jumps, _simulated(other, max_step), strict=True):
            slope = (there - found[i].states) / -steps[j]
            found[i].slopes[j] = 0.0 if _jumps(slope[None], steps[[j]])[0] else slope
    return found


def _simulated(lanes: Sequence[tuple[Inputs, Model]], max_step: float) -> list[FloatArray]:
    return simulate_states([one for one, _ in lanes], [model for _, model in lanes], max_step)


def _jumps(slopes: FloatArray, steps: FloatArray) -> FloatArray:
    """Which slopes (k, 4, n) change a state by far more than the change of its number."""
    change = np.maximum(slopes.max(axis=2), -slopes.min(axis=2)) / _SIZES
    # So many sizes of the result per size of a number are a jump, no slope.
    return np.asarray(change.max(axis=1) * np.abs(steps) > 3e3 * _STEP)


def _with_start(inputs: Inputs, model: Model) -> tuple[Inputs, Model]:
    """Inputs and model with the starting pressures filled in where the run gives none."""
    own = {name: getattr(inputs, name) for name in STATE[2:]}
    none = {name: float(model.parameters.atmosphere) for name, p in own.items() if p is None}
    return (dataclasses.replace(inputs, **none) if none else inputs), model  # type: ignore[arg-type]


def _neighbours(
    starts: Sequence[tuple[Inputs, Model]], directions: Sequence[Direction], steps: FloatArray
) -> list[list[tuple[Inputs, Model]]]:
    """Each run with each start state, then each number of its model, a step further."""
    sizes = steps[len(STATE) :].tolist()
    moved = {  # runs of one test share their model
        id(model): [with_step(model, d, size) for d, size in zip(directions, sizes, strict=True)]
        for _, model in starts
    }
    found = []
    for one, model in starts:
        ahead = [
            dataclasses.replace(one, **{name: getattr(one, name) + step})
            for name, step in zip(STATE, steps, strict=False)
        ]
        found.append([*((o, model) for o in ahead), *((one, m) for m in moved[id(model)])])
    return found


__all__ = ["simulate_differences"]
