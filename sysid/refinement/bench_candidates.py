"""Bench tests that could be run next, and the information of each on the parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sysid.estimation.autoregression import Autoregression
from sysid.io.rig import Rig
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs, ValveCommand
from sysid.refinement.candidates import row_period
from sysid.refinement.information import ProbedProblem, information_of
from sysid.refinement.problem import SLIDING
from sysid.refinement.runs import LEAST_START_STD, Run
from sysid.types import FloatArray

_TESTS = (6, 12)
# Sliding speeds, travels per second.
_SPEEDS = (0.2, 0.5, 1.0)
_SLIDING_S, _RAMP_S = 2.0, 5.0
_FILLING_S, _ON_S, _OFF_S = 6.0, 1.0, 4.0
_FILLINGS = 3
# Where the piston is held, of half the travel: the valve's chamber is large there.
_HELD = 0.95
# Share of the range from the atmosphere to the supply.
_FULL = 0.97


@dataclass(frozen=True)
class BenchCandidate:
    """A log of bench tests that could be made; `information` (k, k) over the shared unknowns."""

    kind: str
    text: str
    duration: float
    information: FloatArray


def bench_candidates(
    problem: ProbedProblem, rig: Rig, noise: FloatArray, has_motor: bool
) -> list[BenchCandidate]:
    """Friction, of a rig with a motor, by the scatter of its tests; on/off valves by the noise (3,)
    of a filling."""
    return [
        *(_sliding(problem, rig) if has_motor else ()),
        *(_static(problem) if has_motor else ()),
        *(_fillings(problem, rig, noise, side) for side in rig.sides if rig.valves is not None),
    ]


def _columns(problem: ProbedProblem) -> int:
    return len(problem.unknowns) + len(problem.sensors)


def _sliding(problem: ProbedProblem, rig: Rig) -> Iterator[BenchCandidate]:
    """Effort at steady speeds, each test with its own friction: Coulomb and viscous."""
    speeds = np.array(_SPEEDS) * float(rig.travel or 1.0)
    p = problem.model.parameters
    c, b = float(p.coulomb_effort), float(p.viscous)
    rows = np.zeros((len(speeds), _columns(problem)))
    for i, unknown in enumerate(problem.unknowns):
        if unknown.direction in [(0, name) for name in SLIDING]:
            own = 1.0 if unknown.direction[1] == SLIDING[0] else speeds
            rows[:, i] = own * unknown.slope(unknown.start)
    rows /= (problem.scatter[0] * (c + b * speeds))[:, None]
    if not rows.any():
        return
    unit = rig.units.speed
    at = ", ".join(f"{s:.2g}" for s in speeds)
    for count in _TESTS:
        times = count / len(speeds)
        text = f"{count} tests, at {at} {unit}"
        yield BenchCandidate("friction-sliding", text, count * _SLIDING_S, times * (rows.T @ rows))


def _static(problem: ProbedProblem) -> Iterator[BenchCandidate]:
    at = problem.static_number
    if at is None:
        return
    unknown = problem.unknowns[at]
    value = unknown.at(unknown.start)
    row = np.zeros(_columns(problem))
    row[at] = unknown.slope(unknown.start) / (problem.scatter[1] * value)
    for count in _TESTS:
        text = f"{count} breakaways"
        information = count * np.outer(row, row)
        yield BenchCandidate("friction-static", text, count * _RAMP_S, information)


def _fillings(problem: ProbedProblem, rig: Rig, noise: FloatArray, side: str) -> BenchCandidate:
    """A chamber filled and emptied with the piston held, the start pressure unknown."""
    base = problem.model
    model = dataclasses.replace(base, parameters=base.parameters.with_held_shaft())
    inputs = _filling(rig, model, side)
    start_std = np.array([*LEAST_START_STD[:2], noise[1], noise[2]])
    shown = np.zeros((len(noise), len(inputs.time)))
    held = dataclasses.replace(
        problem,
        runs=(Run(0, f"valve-discrete {side}", inputs, shown, start_std, noise),),
        tests=1,
        model=model,
        whitening=(tuple(Autoregression.white(float(n) ** 2) for n in noise),),
    )
    found = information_of(held, held.linearised(held.first_point()))
    text = f"valve {side.upper()}, {_FILLINGS} fillings and exhausts"
    return BenchCandidate("valve-discrete", text, _FILLINGS * _FILLING_S, _FILLINGS * found)


def _filling(rig: Rig, model: Model, side: str) -> Inputs:
    """On until the chamber nears the supply, where the flow's derivative is infinite; then off.

    A chamber that two valves keep shut is then emptied by the second one.
    """
    from sysid.plant.simulator import simulate

    row = row_period(rig)
    time: FloatArray = np.asarray(np.arange(round(_FILLING_S / row)) * row, dtype=float)
    p = model.parameters
    atmosphere, supply = float(p.atmosphere), float(p.supply)
    sign = 1.0 if side == "a" else -1.0
    held = Inputs(
        time,
        np.zeros(len(time)),
        position=sign * _HELD * 0.5 * float(rig.travel or 0.0),
        pressure_a=atmosphere,
        pressure_b=atmosphere,
    )

    def commanded(off: float) -> Inputs:
        on = ((time >= _ON_S) & (time < off)).astype(float)
        valve = ValveCommand(on)
        if rig.bleeds:
            bleed = ValveCommand((time >= _OFF_S).astype(float))
            return dataclasses.replace(held, valve_a=valve, valve_b=bleed)
        if side == "a":
            return dataclasses.replace(held, valve_a=valve)
        return dataclasses.replace(held, valve_b=valve)

    (whole,) = simulate([commanded(_OFF_S)], [model])
    pressure = getattr(whole, f"pressure_{side}")
    full = np.flatnonzero((pressure - atmosphere) / (supply - atmosphere) > _FULL)
    return commanded(float(time[full[0]]) if full.size else _OFF_S)


__all__ = ["BenchCandidate", "bench_candidates"]
