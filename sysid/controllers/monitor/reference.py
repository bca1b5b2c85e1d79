"""The cycle on which a bundle's smallest detectable changes are computed: on/off, to and fro.

The valves are switched where the shaft passes 30 % of the stroke to either side of the middle, so
that one chamber is open to the supply and the other to the exhaust, without a motor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sysid.controllers.monitor.design import MonitorDesign
from sysid.controllers.monitor.drifts import CHAMBER, SHAFT
from sysid.controllers.monitor.evidence import Cycle, Detectable, detectable
from sysid.controllers.monitor.observer import (
    ChamberState,
    Innovation,
    ShaftState,
    chamber_ahead,
    chamber_seen,
    chamber_start,
    shaft_ahead,
    shaft_seen,
    shaft_start,
)
from sysid.controllers.monitor.terms import (
    ChamberPoint,
    ChamberTerms,
    chamber_rate,
    chamber_terms,
    shaft_effort,
)
from sysid.io.channels import SIDES
from sysid.plant.base import MAX_STEP
from sysid.types import FloatArray

TURN = 0.3
"""Share of the stroke, from its middle, at which the valves are switched."""
_STEP = 2.0 * MAX_STEP
_MOST_STEPS = 4000


@dataclass(frozen=True)
class CycleMotion:
    """A motion, evenly sampled, (n,): position, velocity, pressures, valve A on; B the reverse."""

    position: FloatArray
    velocity: FloatArray
    pressure: dict[str, FloatArray]
    is_on: FloatArray


def reference_changes(design: MonitorDesign) -> tuple[Detectable, float] | None:
    """The smallest detectable changes on the reference cycle, and how long this lasts, s.

    None where the valves do not move the shaft so far.
    """
    motion = reference_motion(design)
    if motion is None:
        return None
    cycle = cycle_of(design, motion)
    found = detectable(cycle, design.scatter, design.errors, design.scales)
    return found, (len(motion.position) - 1) * float(design.noise.period)


def reference_motion(design: MonitorDesign) -> CycleMotion | None:
    """One cycle after one stroke to begin with, on the design's sampling."""
    rows = _integrated(design)
    if rows is None:
        return None
    coarse = np.arange(len(rows)) * _STEP
    time = np.arange(0.0, coarse[-1], float(design.noise.period))
    columns = [np.interp(time, coarse, column) for column in rows.T[:4]]
    held = rows[np.minimum((time / _STEP).astype(int), len(rows) - 1), 4]
    return CycleMotion(columns[0], columns[1], {"a": columns[2], "b": columns[3]}, held)


def _integrated(design: MonitorDesign) -> FloatArray | None:
    """(n, 5) in steps of `_STEP`; None where the shaft does not pass the turns."""
    model, p = design.model, design.model.parameters
    turn, stop = TURN * design.stroke, 0.5 * design.stroke
    x, v, on, turns = 0.0, 0.0, 1.0, 0
    pressure = dict.fromkeys(SIDES, float(p.atmosphere))
    rows: list[tuple[float, ...]] = []
    for _ in range(_MOST_STEPS):
        way = 1.0 if on else -1.0
        if way * x > turn:
            on, turns = 1.0 - on, turns + 1
            rows = [] if turns == 1 else rows
            if turns == 3:
                return np.array(rows)
        rows.append((x, v, pressure["a"], pressure["b"], on))
        effort = float(shaft_effort(model, x, v, pressure["a"], pressure["b"], 0.0))
        if v == 0.0:
            held = abs(effort) <= float(p.static_effort)
            effort = 0.0 if held else effort - math.copysign(float(p.coulomb_effort), effort)
        after = v + _STEP * effort / design.shaft.inertia
        after = 0.0 if after * v < 0.0 else after
        x, v = x + _STEP * (v + 0.5 * (after - v)), after
        if abs(x) > stop:
            x, v = math.copysign(stop, x), 0.0
        pressure = {side: _after(design, side, x, v, pressure, on) for side in SIDES}
    return None


def _after(
    design: MonitorDesign, side: str, x: float, v: float, pressure: dict[str, float], on: float
) -> float:
    """A chamber's pressure a step later, by the exponential Euler step."""
    share = on if side == "a" else 1.0 - on
    other = "b" if side == "a" else "a"
    spread = float(design.noise.pressure)
    levels = pressure[side] + spread * np.array([-1.0, 0.0, 1.0])
    none = np.zeros(3)
    at = ChamberPoint(
        none + x, none + v, levels, none + pressure[other], none, none + 1.0 - share, none, none
    )
    low, middle, high = (float(r) for r in chamber_rate(design.model, side, at, none + share))
    z = _STEP * (high - low) / (2.0 * spread)
    gain = _STEP * (math.expm1(z) / z if abs(z) > 1e-6 else 1.0)
    return pressure[side] + gain * middle


def cycle_of(design: MonitorDesign, motion: CycleMotion) -> Cycle:
    """The normal equations' matrix of a motion whose innovations are as the model says."""
    cycle, noise = Cycle(), design.noise
    x, middle = motion.position, 0.5 * (motion.position[1:] + motion.position[:-1])
    speed = np.diff(x) / float(noise.period)
    on = motion.is_on[:-1]
    # The edges of the last cycle's end begin this one.
    change = np.diff(np.concatenate((on[-1:], on)))
    for side in SIDES:
        other = "b" if side == "a" else "a"
        own, way = (on, change) if side == "a" else (1.0 - on, -change)
        at = ChamberPoint(
            middle,
            speed,
            motion.pressure[side][:-1],
            motion.pressure[other][:-1],
            own,
            1.0 - own,
            (way > 0.5).astype(float),
            (way < -0.5).astype(float),
        )
        terms = chamber_terms(
            design.model, side, at, noise, design.chamber_scales(side), design.choked[side]
        )
        _add(cycle, CHAMBER[side], _chamber_rows(design, side, terms, motion.pressure[side]))
    _add(cycle, SHAFT, _shaft_rows(design, motion))
    return cycle


def _add(cycle: Cycle, own: tuple[int, ...], rows: FloatArray) -> None:
    cycle.matrix[np.ix_(own, own)] += rows.T @ rows


def _chamber_rows(
    design: MonitorDesign, side: str, terms: ChamberTerms, pressure: FloatArray
) -> FloatArray:
    variance, period = design.pressure_variance, float(design.noise.period)
    state = _vector(chamber_start(float(pressure[0]), variance))
    slopes = np.array([np.broadcast_to(s, terms.rate.shape) for s in terms.slopes]).T
    jumps = np.zeros_like(slopes)
    jumps[:, 2:4] = np.array(terms.jumps).T
    found = []
    for k, reading in enumerate(pressure[1:]):
        state = state._replace(slopes=(state.slopes[0] + jumps[k],))
        own = ChamberTerms(
            float(terms.rate[k]),
            float(terms.over_pressure[k]),
            (slopes[k],),
            (0.0, 0.0),
            float(terms.per_flow[k]),
            float(terms.boundary[k]),
        )
        ahead = chamber_ahead(state, own, period, design.swept[side])
        # The model's own motion: what is expected is what is read.
        ahead = ahead._replace(pressure=float(reading))
        state, shown = chamber_seen(ahead, float(reading), variance)
        found.append(shown.slopes[0])
    return np.array(found)


def _vector(state: ChamberState) -> ChamberState:
    """The same with its slopes as one array."""
    return state._replace(slopes=(np.zeros(len(state.slopes)),))


def _shaft_rows(design: MonitorDesign, motion: CycleMotion) -> FloatArray:
    variance, period = design.position_variance, float(design.noise.period)
    efforts = shaft_effort(
        design.model,
        motion.position,
        motion.velocity,
        motion.pressure["a"],
        motion.pressure["b"],
        np.zeros(len(motion.position)),
    )
    state = shaft_start(float(motion.position[0]), variance, design.speed**2)
    state = state._replace(velocity=float(motion.velocity[0]))
    found = []
    for k in range(len(motion.position) - 1):
        ahead = shaft_ahead(state, float(efforts[k]), period, design.shaft, design.shaft_scales)
        position, velocity = float(motion.position[k + 1]), float(motion.velocity[k + 1])
        ahead: ShaftState = ahead._replace(position=position, velocity=velocity)  # type: ignore[no-redef]
        shown: Innovation
        state, shown = shaft_seen(ahead, position, variance)
        found.append(shown.slopes)
    return np.array(found)


__all__ = ["TURN", "CycleMotion", "cycle_of", "reference_changes", "reference_motion"]
