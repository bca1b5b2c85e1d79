"""Errors along a closed loop's record, and how large a tracking error they allow.

The thesis bounds the tracking error by those of friction, valves and motor (4.3.36 for
backstepping, 4.4.14 for DVMPC with inverse dynamics). Here each of these is taken from a run: the
plant's effort less what the controller took it for. With the motion's equation

    I e'' + D e' + K e = d(t),      e = reference - position,

where K and D are the controller's own stiffness and damping, a loop that starts at rest on its
reference never leaves |e| <= max |d| times `largest_response`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.blocks.numbers import number, unit
from sysid.blocks.tables import Table, table
from sysid.controllers.backstepping import BacksteppingController, WantedState
from sysid.controllers.cases import PERIOD_S, Case, ClosedLoopRun
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.force import ForceController
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.prediction import (
    Motion,
    corrected,
    cylinder_effort,
    loaded,
    opposing_effort,
    point_at,
    sliding_friction,
)
from sysid.controllers.record import estimates_of, references_of, true_states
from sysid.controllers.stability import (
    Condition,
    inverse_dynamics_conditions,
    largest_response,
)
from sysid.errors import input_error
from sysid.plant import base, plant
from sysid.plant.ports import Model, Point
from sysid.types import FloatArray

# The chambers start at the atmosphere: by then that error has decayed to exp(-10) of itself.
_SETTLED_TIMES = 10.0
# Efforts below are rounding, Nm.
_ROUNDING = 1e-9
# A motor within this share of its limit is saturated.
_AT_LIMIT = 1.0 - 1e-9


@dataclass(frozen=True)
class ChamberError:
    """Largest errors of a chamber: of its mean flow, kg/s, and of its pressure, Pa.

    `bound`: the bound on the pressure error that follows from the flow error, psi dm / k3
    (4.3.36). All after the chambers' initial fill.
    """

    side: str
    flow: float
    bound: float
    pressure: float


@dataclass(frozen=True)
class ErrorBudget:
    """What drives the tracking error: the largest of each source, Nm, over a run.

    `together`: the largest of their sum, Nm; `response` rad/Nm; `bound` and `largest` rad, of the
    tracking error; `saturated`: share of the run in which the motor is at its limit; `corners`:
    whether the reference's velocity jumps, which no bounded effort follows.
    """

    sources: tuple[tuple[str, float], ...]
    together: float
    response: float
    bound: float
    largest: float
    saturated: float
    chambers: tuple[ChamberError, ...] = ()
    corners: bool = False


@dataclass(frozen=True)
class Stability:
    """The thesis' conditions on a controller's gains, and the budget of a run's errors."""

    controller: str
    conditions: tuple[Condition, ...]
    budget: ErrorBudget

    def tables(self) -> Iterable[Table]:
        """The conditions; the errors and what they allow."""
        rows = [
            (
                c.name,
                c.equation,
                f"{number(c.value)} {unit(c.unit)}",
                number(c.least),
                _word(c.holds),
            )
            for c in self.conditions
        ]
        head = ("Condition", "Equation", "Value", "Exceeds", "Holds")
        yield table(f"Stability of {self.controller}", head, rows)
        b = self.budget
        found = [(f"Effort: {name}", f"{number(size)} N·m", "", "") for name, size in b.sources]
        found += [
            (
                f"Flow of valve {c.side.upper()}",
                f"{number(1e3 * c.flow)} g/s",
                f"pressure {c.side.upper()}: {number(1e-3 * c.bound)} kPa",
                f"{number(1e-3 * c.pressure)} kPa",
            )
            for c in b.chambers
        ]
        all_of_it = f"position: {number(1e3 * b.bound)} mrad"
        found.append(
            (
                "Effort: together",
                f"{number(b.together)} N·m",
                all_of_it,
                f"{number(1e3 * b.largest)} mrad",
            )
        )
        columns = ("Error", "Largest in this run", "Allows an error of", "Found")
        yield table("What the errors allow (4.3.36, 4.4.14)", columns, found)

    def notes(self) -> tuple[str, ...]:
        """Where the analysis does not reach, one line each."""
        b, said = self.budget, []
        if b.saturated:
            said.append(
                f"the motor is at its limit in {number(100.0 * b.saturated)} % of the run, for "
                "which the thesis' analysis makes no statement"
            )
        if b.corners:
            said.append(
                "the reference's velocity jumps, which no bounded effort follows: the bound holds "
                "between the corners only"
            )
        return tuple(said)

    def to_json(self) -> dict[str, Any]:
        """Conditions, and the budget in SI."""
        b = self.budget
        return {
            "conditions": [
                {
                    "name": c.name,
                    "equation": c.equation,
                    "value": c.value,
                    "exceeds": c.least,
                    "unit": c.unit,
                    "holds": c.holds,
                }
                for c in self.conditions
            ],
            "errors_nm": dict(b.sources) | {"together": b.together},
            "chambers": {
                c.side: {"flow_kg_s": c.flow, "bound_pa": c.bound, "largest_pa": c.pressure}
                for c in b.chambers
            },
            "bound_rad": b.bound if np.isfinite(b.bound) else None,
            "largest_rad": b.largest,
            "saturated": b.saturated,
            "notes": list(self.notes()),
        }


def _word(holds: bool) -> str:
    return "yes" if holds else "no"


def stability_of(case: Case, run: ClosedLoopRun) -> Stability:
    """The conditions on a case's controller, and its errors along the run.

    Raises InputError for a controller other than backstepping or DVMPC, and for DVMPC without the
    motor, for which the thesis has no analysis.
    """
    controller = case.controller
    if isinstance(controller, BacksteppingController) and not isinstance(
        controller, ForceController
    ):
        return _of_backstepping(controller, case, run)
    if isinstance(controller, DvmpcController) and case.mode.uses_motor:
        return _of_inverse_dynamics(controller, case, run)
    raise input_error(
        "stability",
        "is analysed by the thesis for backstepping, and for dvmpc with the motor",
        "use one of these, in mode hybrid or motor for dvmpc",
    )


class _RunSignals:
    """Signals of a run that both controllers' budgets need, (n,)."""

    def __init__(self, case: Case, run: ClosedLoopRun, controller: Any) -> None:
        self.case, self.run = case, run
        design = controller.design
        self.reference: Reference = references_of(run)
        self.shown = corrected(estimates_of(case, run), design.model)
        self.true = true_states(run)
        known = design.payload_mass * design.payload_length**2 + 0.0 * run.time
        if controller.estimator is not None:
            known = run.payload_kg * float(design.payload_length) ** 2
        self.model: Model = loaded(design, known)
        self.motor = run.motor if case.mode.uses_motor else 0.0 * run.motor
        self.limit = float(np.ravel(self.model.parameters.max_effort)[0])
        self.error = self.reference.position - run.position
        self.rate = self.reference.velocity - run.velocity
        self.at_plant = self._point(case.plant, self.true)
        self.inertia = case.plant.parameters.inertia

    def _point(self, model: Model, state: StateEstimate) -> Point:
        motion = Motion(state.position, state.velocity, state.pressure_a, state.pressure_b)
        return point_at(motion, model, self.run.time, self.motor, self.reference.velocity)

    def point(self, state: StateEstimate) -> Point:
        """The controller's own model at a state."""
        return self._point(self.model, state)

    @property
    def cylinder(self) -> FloatArray:
        """The plant's cylinder effort, Nm."""
        return np.asarray(cylinder_effort(self.at_plant, self.case.plant))

    def friction_error(self) -> FloatArray:
        """The plant's friction less what the controller takes it for, Nm."""
        true = self.run.velocity
        sliding = sliding_friction(self.at_plant, self.case.plant, true)
        given = self.cylinder + self.motor - opposing_effort(self.at_plant, self.case.plant)
        static = self.case.plant.parameters.static_effort
        friction = np.where(true == 0.0, np.clip(given, -static, static), sliding)
        known = sliding_friction(self.point(self.true), self.model, self.reference.velocity)
        return np.asarray(friction - known)

    def model_error(self) -> FloatArray:
        """What the controller does not know of inertia, weight and other loads, Nm."""
        own = self.point(self.true)
        loads = opposing_effort(self.at_plant, self.case.plant) - opposing_effort(own, self.model)
        inertia = self.inertia - self.model.parameters.inertia
        return np.asarray(inertia * self.reference.acceleration + loads)

    def saturated(self) -> float:
        """Share of the run in which the motor is at its limit."""
        return float(np.mean(np.abs(self.motor) >= _AT_LIMIT * self.limit))

    def budget(
        self,
        sources: dict[str, FloatArray],
        damping: float,
        stiffness: float,
        chambers: tuple[ChamberError, ...] = (),
    ) -> ErrorBudget:
        """The budget of these sources, Nm, for a loop of this damping and stiffness."""
        sizes = tuple((name, float(np.max(np.abs(d)))) for name, d in sources.items())
        together = float(np.max(np.abs(sum(sources.values()))))
        response = largest_response(float(self.inertia), damping, stiffness)
        jump = np.max(np.abs(np.diff(self.reference.velocity)), initial=0.0)
        smooth = np.max(np.abs(self.reference.acceleration)) * PERIOD_S
        return ErrorBudget(
            sources=tuple((name, size) for name, size in sizes if size > _ROUNDING),
            together=together,
            response=response,
            bound=together * response,
            largest=float(np.max(np.abs(self.error))),
            saturated=self.saturated(),
            chambers=chambers,
            corners=bool(jump > 2.0 * smooth),
        )


def _of_backstepping(
    controller: BacksteppingController, case: Case, run: ClosedLoopRun
) -> Stability:
    record = _RunSignals(case, run, controller)
    wanted = controller.wanted(record.shown, record.reference, record.model)
    ideal = controller.wanted(record.true, record.reference, record.model)
    share = controller.portion / (1.0 + controller.portion)
    sources = {
        "friction": record.friction_error(),
        "model of the load": record.model_error(),
        "sensors": ideal.effort - wanted.effort,
        "chamber pressures": (1.0 - share) * wanted.effort - record.cylinder,
        "motor": share * wanted.effort - record.motor,
    }
    inertia = float(np.mean(record.model.parameters.inertia))
    damping = inertia * (controller.k1 + controller.k2)
    stiffness = inertia * (1.0 + controller.k1 * controller.k2)
    chambers = _chambers(controller, record, wanted) if case.mode.uses_valves else ()
    budget = record.budget(sources, damping, stiffness, chambers)
    if controller.compensation and case.mode.uses_motor:
        # The motor's feedback counts as part of the loop; without it, it is an error (4.3.51).
        p, d = controller.motor_p, controller.motor_d
        fed = dict(sources, motor=sources["motor"] + p * record.error + d * record.rate)
        budget = min(
            budget,
            record.budget(fed, damping + d, stiffness + p, chambers),
            key=lambda b: b.bound,
        )
    conditions = controller.stability(case.mode.uses_motor).conditions
    return Stability("backstepping", conditions, budget)


def _of_inverse_dynamics(controller: DvmpcController, case: Case, run: ClosedLoopRun) -> Stability:
    record = _RunSignals(case, run, controller)
    inertia = float(np.mean(record.model.parameters.inertia))
    frequency = controller.natural_frequency
    stiffness = inertia * frequency**2
    damping = 2.0 * controller.damping * frequency * inertia
    shown = record.point(record.shown)
    known = record.model.parameters.inertia * record.reference.acceleration
    friction = sliding_friction(shown, record.model, record.reference.velocity)
    weight, cylinder = opposing_effort(shown, record.model), cylinder_effort(shown, record.model)
    remaining = known + weight + friction - cylinder
    off = record.reference.position - record.shown.position
    rate = record.reference.velocity - record.shown.velocity
    asked = remaining + stiffness * off + damping * rate
    sources = {
        "friction": record.friction_error(),
        "model of the load": record.model_error(),
        "cylinder": cylinder - record.cylinder,
        "sensors": stiffness * (record.error - off)
        + damping * (record.rate - rate)
        + opposing_effort(record.point(record.true), record.model)
        - weight,
        "motor": asked - record.motor,
    }
    conditions = (
        *inverse_dynamics_conditions(stiffness, damping),
        Condition(
            "limit of the motor against its largest torque asked for",
            record.limit,
            float(np.max(np.abs(asked))),
            "N m",
            "4.4.11",
        ),
    )
    return Stability(
        "dvmpc with inverse dynamics", conditions, record.budget(sources, damping, stiffness)
    )


def _chambers(
    controller: BacksteppingController, record: _RunSignals, wanted: WantedState
) -> tuple[ChamberError, ...]:
    """Errors of flows and pressures, both as means over a PWM period."""
    run = record.run
    model = record.case.plant
    ticks = max(1, round(float(np.ravel(model.parameters.pwm_period)[0]) / PERIOD_S))
    found = []
    for i, (side, gain) in enumerate((("a", controller.k3), ("b", controller.k4))):
        pressure = np.asarray(getattr(run, f"pressure_{side}"))
        point = record.at_plant
        first = round(_SETTLED_TIMES / float(gain) / PERIOD_S)
        p = point.parameters
        volume = plant.chamber_volume(side, plant.displacement(point, model), p)
        rate = (pressure[ticks:] - pressure[:-ticks]) / (ticks * PERIOD_S)
        flow = base.flow_from_pressure_rate(
            rate,
            _means(pressure, ticks),
            _means(volume, ticks),
            _means(np.asarray(plant.volume_rate(side, point, model)), ticks),
            p.heat_capacity_ratio,
            p.gas_constant,
            p.temperature,
        )
        missing = _largest(_means(np.asarray(wanted.flows[i]), ticks) - flow, first)
        slope = p.heat_capacity_ratio * p.gas_constant * p.temperature / np.min(volume)
        off = _largest(_means(np.asarray(wanted.pressures[i]) - pressure, ticks), first)
        found.append(ChamberError(side, missing, float(slope * missing / gain), off))
    return tuple(found)


def _largest(values: FloatArray, first: int) -> float:
    """The largest size from a sample on; 0 of a run that is shorter."""
    return float(np.max(np.abs(values[first:]), initial=0.0))


def _means(values: FloatArray, ticks: int) -> FloatArray:
    """Means of `ticks` samples from each on, (n - ticks,)."""
    sums = np.cumsum(np.concatenate([[0.0], values]))
    return np.asarray((sums[ticks:] - sums[:-ticks])[:-1] / ticks)


__all__ = ["ChamberError", "ErrorBudget", "Stability", "stability_of"]
