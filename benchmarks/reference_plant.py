"""The plant by scipy's solve_ivp, with events: slow, general, and independent of sysid's steps.

Between two valve edges or motor changes the equations of `sysid.plant.base` are integrated
with the regime (choked or not, sliding or sticking) frozen; every boundary of the regime is a
terminal event, after which the regime is determined again.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from sysid.plant import base
from sysid.plant.base import Parameters
from sysid.plant.ports import Model
from sysid.plant.simulator import Inputs, open_intervals
from sysid.types import FloatArray

SIDES = ("a", "b")
# Within this of the supply, Pa, a chamber's law is so steep that only Radau succeeds;
# within the second, its square root is a straight line.
_STIFF_PA = 3000.0
_LINEAR_PA = 1e-3
_SCALE = np.array([1.0, 1.0, 1e5, 1e5])


@dataclass
class Regime:
    """What is frozen: above (1), below (-1) or on (0) each choked boundary; direction."""

    above: dict[str, int]
    direction: int


class ReferencePlant:
    """One run's plant; `rtol` of solve_ivp, `method` away from the supply pressure."""

    def __init__(self, parameters: Parameters, rtol: float, method: str = "DOP853") -> None:
        self.p = parameters
        self.rtol = rtol
        self.method = method
        self.open = {"a": False, "b": False}
        self.motor = 0.0
        self.stop = 0.5 * parameters.stroke / parameters.pitch_radius

    def boundary(self, side: str) -> float:
        """Pressure at which the valve's law changes, Pa."""
        if self.open[side]:
            return float(base.filling_boundary(self.p.supply))
        return float(base.exhaust_boundary(self.p.atmosphere))

    def rate(self, side: str, y: FloatArray, above: int) -> float:
        """dP/dt with the law above (1) or below (-1) the boundary, Pa/s."""
        p, pressure = self.p, y[2 + SIDES.index(side)]
        valve = p.valve(side)
        choked = (above < 0) == self.open[side]
        if self.open[side]:
            gap = p.supply - pressure
            if choked:
                flow = valve.choked_fill * p.supply / p.supply_reference
            elif abs(gap) < _LINEAR_PA:
                flow = valve.c_fill * gap / np.sqrt(_LINEAR_PA)
            else:
                flow = valve.c_fill * np.sign(gap) * np.sqrt(abs(gap))
        else:
            flow = -valve.choked_dis if choked else valve.c_dis * (p.atmosphere - pressure)
        sign, area, offset = (
            (1.0, p.area_a, p.offset_a) if side == "a" else (-1.0, p.area_b, p.offset_b)
        )
        volume = (offset + sign * p.pitch_radius * y[0]) * area
        swept = sign * p.pitch_radius * y[1] * area
        k, r, t = p.heat_capacity_ratio, p.gas_constant, p.temperature
        return float(k * (r * t * flow - pressure * swept) / volume)

    def applied(self, y: FloatArray) -> float:
        """All efforts but friction, Nm or N."""
        p = self.p
        cylinder = (y[2] - p.atmosphere) * p.area_a - (y[3] - p.atmosphere) * p.area_b
        motor = min(max(self.motor, -p.max_effort), p.max_effort)
        gravity = p.gravity_moment * np.sin(y[0]) + p.weight
        return float(cylinder * p.pitch_radius + motor - gravity + p.offset)

    def held(self, y: FloatArray) -> float:
        """How far a shaft at rest is from breaking away; positive where a stop holds it."""
        applied = self.applied(y)
        limit = max(self.p.static_effort, self.p.coulomb_effort)
        if np.sign(applied) * y[0] >= self.stop:
            return float(limit)
        return float(limit - abs(applied))

    def regime(self, y: FloatArray, loose: bool) -> Regime:
        """The regime in which the plant goes on from y."""
        above = {}
        for i, side in enumerate(SIDES):
            excess = y[2 + i] - self.boundary(side)
            if abs(excess) > 1e-9 * self.boundary(side):
                above[side] = 1 if excess > 0 else -1
            else:
                up, down = self.rate(side, y, 1) > 0, self.rate(side, y, -1) < 0
                above[side] = 1 if up else -1 if down else 0
        if y[1] != 0.0:
            return Regime(above, int(np.sign(y[1])))
        breaks = loose or self.held(y) < 0
        return Regime(above, int(np.sign(self.applied(y))) if breaks else 0)

    def derivatives(self, y: FloatArray, regime: Regime) -> FloatArray:
        """dy/dt with the regime frozen."""
        p, way = self.p, regime.direction
        friction = p.coulomb_effort * way + p.viscous * y[1]
        accelerates = (self.applied(y) - friction) / p.inertia if way else 0.0
        rates = [self.rate(s, y, regime.above[s]) if regime.above[s] else 0.0 for s in SIDES]
        return np.array([y[1] if way else 0.0, accelerates, *rates])

    def events(self, regime: Regime) -> list[Any]:
        """Event functions of the regime, each terminal, and falling from positive."""

        def switch(i: int, side: str) -> Any:
            above, at = regime.above[side], self.boundary(side)
            if above == 0:
                return lambda _, y: min(-self.rate(side, y, 1), self.rate(side, y, -1)) / 1e6
            return lambda _, y: above * (y[2 + i] - at) / 1e5

        way = regime.direction
        found = [switch(i, side) for i, side in enumerate(SIDES)]
        if way:
            found += [lambda _, y: way * y[1], lambda _, y: self.stop - way * y[0]]
        else:
            found += [lambda _, y: self.held(y)]
        for function in found:
            function.terminal, function.direction = True, -1
        return found

    def advance(
        self, y: FloatArray, start: float, end: float, rows: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The state at `end`, commands constant in between, and at the times `rows` (4, n)."""
        now, loose = start, False
        out = np.empty((4, len(rows)))
        for _ in range(10000):
            regime = self.regime(y, loose)
            near = any(
                self.open[s] and abs(y[2 + i] - self.p.supply) < _STIFF_PA
                for i, s in enumerate(SIDES)
            )
            solution = solve_ivp(
                lambda _, z, r=regime: self.derivatives(z, r),
                (now, end),
                y,
                method="Radau" if near else self.method,
                rtol=self.rtol,
                atol=self.rtol * _SCALE,
                events=self.events(regime),
                dense_output=True,
            )
            reached = (rows > now) & (rows <= solution.t[-1])
            if reached.any():
                out[:, reached] = solution.sol(rows[reached])
            rests = (y[0], 0.0)
            y, loose = solution.y[:, -1].copy(), False
            if not regime.direction:
                y[:2] = rests  # Radau's linear algebra leaves a velocity of 1e-20
            if not regime.direction:
                out[:2, reached] = np.array(rests)[:, None]
            if solution.status == 0:
                return y, out
            now = float(solution.t[-1])
            hit = next(i for i, t in enumerate(solution.t_events) if len(t))
            if hit < 2:
                y[2 + hit] = self.boundary(SIDES[hit])
            elif regime.direction == 0:
                loose = True
            else:
                y[1] = 0.0
                if hit == 3:
                    y[0] = regime.direction * self.stop
            if now >= end:
                return y, out
        raise RuntimeError("events without end")


def integrate(
    inputs: Inputs, parameters: Parameters, rtol: float = 1e-9, method: str = "DOP853"
) -> FloatArray:
    """(4, rows): position, velocity, pressures at the rows of `inputs`."""
    plant = ReferencePlant(parameters, rtol, method)
    model = Model(parameters)
    intervals = {side: open_intervals(inputs, side, model) for side in SIDES}
    edges = np.concatenate([e for i in intervals.values() for e in (i.opens, i.closes)])
    time, motor = np.asarray(inputs.time), np.asarray(inputs.motor)
    changes = time[1:][np.diff(motor) != 0.0]
    inside = np.concatenate((edges[(edges > time[0]) & (edges < time[-1])], changes))
    times = np.unique(np.concatenate((time[[0, -1]], inside)))
    start = [inputs.pressure_a, inputs.pressure_b]
    pressures = [parameters.atmosphere if p is None else p for p in start]
    y = np.array([inputs.position, inputs.velocity, *pressures])
    out = np.empty((4, len(time)))
    out[:, 0] = y
    for begin, end in pairwise(times):
        middle = np.array([0.5 * (begin + end)])
        plant.open = {side: bool(intervals[side].is_open(middle)[0]) for side in SIDES}
        plant.motor = float(motor[np.searchsorted(time, middle[0]) - 1])
        rows = slice(*np.searchsorted(time, (begin, end), side="right"))
        y, out[:, rows] = plant.advance(y, float(begin), float(end), time[rows])
    return out
