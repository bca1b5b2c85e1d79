"""A proportional valve on a bench: settled flow over the duty, up and down again.

Without effects the flow is proportional to the duty. What it lacks (a dead band, a curved
opening, saturation, a path that matters) acts through the port of the filling flow, so that
an effect acts here as it does in an actuator. The law and its inverse are a slice of the
valve's surface at one supply pressure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sysid.diagnosis.bench.component import (
    LEAST_IN_STRETCH,
    STRETCHES,
    Component,
    Law,
    bends,
    law_held,
    probes,
    rmse,
    usable,
    valve_alone,
)
from sysid.diagnosis.thresholds import ACTS
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, FittedValves, Parts, Valve
from sysid.parameters.quality import quality_field
from sysid.parameters.valves import SteadyLaw
from sysid.plant.base import Parameters
from sysid.plant.effects.bench import DUTY_DIRECTION
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, Point
from sysid.types import FloatArray

KIND = "valve-flow"
PARAMETER = "full_flow_kg_s"
_COLUMNS = ("duty_a", "flow_a_kg_s")
_SIDE = "a"
# A sweep is cut into up to `STRETCHES` of the duty, and those half a sweep apart, the same ones of
# every sweep, are left out together (`folds_of`). The remaining ones then contain nothing of a
# stretch on the way up or down, nor its near neighbours, as leaving out every third row would; and
# every fold holds a stretch of the upper half, where there is flow. At least one has to remain.
_FEWEST_ROWS = 2 * LEAST_IN_STRETCH
# A proportional valve has no pulses that could be too short.
_PULSED = ("partial-opening",)
_GRID = 4001


@dataclass(frozen=True)
class DutyStretch:
    """Readings of one sweep within a range of duties, in the order taken.

    `duty` (n,) 0 to 1, `flow` (n,) kg/s, `direction` (n,) 1 where the duty rose to its
    value, -1 where it fell; `sweep` names the test that it was cut from.
    """

    sweep: str
    duty: FloatArray
    flow: FloatArray
    direction: FloatArray


@dataclass(frozen=True)
class ValveFlow(Component):
    """Stretches of sweeps of the duty. Residuals are flows, kg/s."""

    base_parameters: Parameters
    stretches: tuple[DutyStretch, ...]
    left_out: tuple[str, ...] = ()

    channel = "flow_a_kg_s"
    unit = "kg/s"
    has_constant = False

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(s.sweep for s in self.stretches)

    def parameters(self) -> list[Parameter]:
        duty, flow = self._pooled("duty"), self._pooled("flow")
        start = float(duty @ flow) / float(duty @ duty)
        return [Parameter(PARAMETER, start, self.unit, 0.0, math.inf, float(np.abs(flow).max()))]

    def _pooled(self, name: str) -> FloatArray:
        return np.concatenate([getattr(s, name) for s in self.stretches])

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """Those that change the flow differently from the gain, each at its usual size."""
        law = Law({p.name: p.value for p in self.parameters()})
        duty, direction = self._pooled("duty"), self._pooled("direction")
        without = self.flow(law, duty, direction)
        return tuple(
            kind
            for kind in catalogue.values()
            if kind.id not in _PULSED
            and any(
                self._acts(self.flow(Law(law.values, (probe,)), duty, direction), without)
                for probe in probes(kind, _SIDE)
            )
        )

    @staticmethod
    def _acts(flow: FloatArray, without: FloatArray) -> bool:
        if not np.isfinite(flow).all():
            return False
        own = flow - without * float(flow @ without) / float(without @ without)
        return float(np.abs(own).max()) > ACTS * float(np.abs(without).max())

    def flow(self, law: Law, duty: ArrayLike, direction: ArrayLike = 0.0) -> FloatArray:
        """Settled flow, kg/s, at duties (n,); `direction` as in `DutyStretch`, 0: mean of both."""
        u = np.asarray(duty, dtype=np.float64)
        way = np.broadcast_to(np.asarray(direction, dtype=np.float64), u.shape)
        full = law.values[PARAMETER]
        model = Model(self.base_parameters.replace(choked_fill_a=full), law.effects)
        point = Point.at_rest(
            model.parameters, np.zeros_like(u), open_a=u, extra={DUTY_DIRECTION + _SIDE: way}
        )
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(model.through("filling_flow", full * u, _SIDE, point))

    def duty(self, law: Law, flow: ArrayLike, direction: float = 0.0) -> FloatArray:
        """The inverse: the smallest duty (n,) that gives each flow (n,), kg/s.

        Exact to 1e-12 of the duty. NaN outside what duties from 0 to 1 give; at no flow the
        end of the dead band, from which on the flow rises.
        """
        wanted = np.atleast_1d(np.asarray(flow, dtype=np.float64))
        grid = np.linspace(0.0, 1.0, _GRID)
        curve = np.maximum.accumulate(self.flow(law, grid, direction))
        # From the last point at or below the wanted flow, bisected to rounding.
        place = np.clip(np.searchsorted(curve, wanted, side="right") - 1, 0, _GRID - 2)
        low, high = grid[place], grid[place + 1]
        for _ in range(40):
            middle = 0.5 * (low + high)
            below = self.flow(law, middle, direction) <= wanted
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        inside = (wanted >= curve[0]) & (wanted <= curve[-1])
        return np.where(inside, 0.5 * (low + high), np.nan)

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        chosen = [self.stretches[t] for t in tests]
        duty = np.concatenate([s.duty for s in chosen])
        direction = np.concatenate([s.direction for s in chosen])
        ends = np.cumsum([len(s.duty) for s in chosen])[:-1]
        modelled = np.split(self.flow(law, duty, direction), ends)
        return [s.flow - m for s, m in zip(chosen, modelled, strict=True)]

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        return [self.stretches[t].flow for t in tests]

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        chosen = [self.stretches[t] for t in tests]
        return {
            "duty_a": np.concatenate([s.duty for s in chosen]),
            "direction of the duty": np.concatenate([s.direction for s in chosen]),
            "flow_a_kg_s": np.concatenate([s.flow for s in chosen]),
        }

    def noise_floor(self, law: Law) -> float:
        """From second differences of the readings along the duty, each way: a slope is no noise."""
        found = []
        for sweep in dict.fromkeys(s.sweep for s in self.stretches):
            own = [s for s in self.stretches if s.sweep == sweep]
            duty, flow, way = (
                np.concatenate([getattr(s, name) for s in own])
                for name in ("duty", "flow", "direction")
            )
            for sign in np.unique(way):
                order = np.argsort(duty[way == sign], kind="stable")
                found.append(bends(flow[way == sign][order]))
        return rmse(found)

    def further_errors(self, law: Law) -> dict[str, tuple[float, float]]:
        """On the way up and on the way down separately, kg/s."""
        floor = self.noise_floor(law)
        residual = np.concatenate(self.residuals(law, range(len(self.stretches))))
        way = self._pooled("direction")
        return {
            name: (rmse([residual[way == sign]]), floor)
            for name, sign in (("flow_up_kg_s", 1.0), ("flow_down_kg_s", -1.0))
            if (way == sign).any()
        }

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        law = SteadyLaw.model_validate({PARAMETER: estimates[PARAMETER], **quality_field(quality)})
        return Parts(valves=FittedValves(a=Valve(steady=law)))

    def law_of(self, bundle: Bundle) -> Law:
        steady = bundle.valve("a").steady
        return law_held("valves.a.steady", steady, [PARAMETER], f"{KIND} tests")


def valve_flow(trials: Sequence[Trial], rig: Rig) -> ValveFlow:
    """The sweeps that `trials` show: `duty_a` and `flow_a_kg_s`, a settled reading a row.

    Readings are in the order in which they were taken. `[air]` and `[pwm]` of the rig file
    are used where present. Raises InputError for a missing column and
    NotIdentifiedError where the duty is not swept.
    """
    if not trials:
        raise NotIdentifiedError(f"no {KIND} test to fit; give a sweep of the duty")
    found, left_out = usable(trials, _stretches)
    return ValveFlow(valve_alone(rig), tuple(s for own in found for s in own), tuple(left_out))


def _stretches(trial: Trial) -> list[DutyStretch]:
    trial.require(_COLUMNS, f"which a {KIND} test needs")
    duty, flow = trial["duty_a"], trial["flow_a_kg_s"]
    if len(duty) < _FEWEST_ROWS or not float(np.ptp(duty)) > 0.0:
        raise NotIdentifiedError(
            f"{trial.source}: {PARAMETER} is not identified: {len(duty)} readings over "
            f"{float(np.ptp(duty)):g} of duty; a sweep of {_FEWEST_ROWS} readings would identify it"
        )
    steps = np.diff(duty)
    moves = np.flatnonzero(steps)
    # The first reading has the direction of the first change, a repeated one the previous one's.
    last = moves[np.maximum(np.searchsorted(moves, np.arange(len(duty)) - 1, "right") - 1, 0)]
    direction = np.sign(steps[last])
    order = np.argsort(duty, kind="stable")
    found = []
    for rows in np.array_split(order, min(STRETCHES, len(duty) // LEAST_IN_STRETCH)):
        taken = np.sort(rows)
        found.append(DutyStretch(trial.title, duty[taken], flow[taken], direction[taken]))
    return found


__all__ = ["KIND", "PARAMETER", "DutyStretch", "ValveFlow", "valve_flow"]
