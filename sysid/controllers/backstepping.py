"""Backstepping with pneumatic feedforward and motor compensation (thesis 4.3).

Types 1 to 4 (Table 5.4.3) switch the two compensations. Friction and its derivative are those
of the desired velocity, as in 4.4.2, step 9: the measured one would make the wanted flow
chatter around rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from sysid.controllers.cases import PERIOD_S
from sysid.controllers.design_model import DesignModel
from sysid.controllers.effective_law import leakage
from sysid.controllers.guard import GuardedController, known
from sysid.controllers.interface import Commands, Reference, StateEstimate
from sysid.controllers.payload import PayloadEstimator, payload_mass
from sysid.controllers.prediction import (
    Motion,
    corrected,
    loaded,
    motor_command,
    opposing_effort,
    point_at,
    sliding_friction,
)
from sysid.controllers.stability import StabilityCheck, check_stability
from sysid.errors import input_error
from sysid.plant import base, plant
from sysid.plant.base import Array, array_namespace
from sysid.plant.ports import Model, Point


class BacksteppingMemory(NamedTuple):
    """Payload's inertia kg m2; the motor's last effort Nm; ticks that were not good."""

    payload: Array
    motor: Array
    rejected: Array = 0.0


class WantedEffort(NamedTuple):
    """Wanted effort Nm, its rate Nm/s, and the error z2 rad/s that couples to the pressures."""

    effort: Array
    rate: Array
    z2: Array


class WantedState(NamedTuple):
    """What the feedback wants: the whole effort Nm, pressures Pa and flows kg/s of A and B."""

    effort: Array
    pressures: tuple[Array, Array]
    flows: tuple[Array, Array]


class _Wanted(NamedTuple):
    """Wanted effort beyond gravity's counterweight and its rate; pressures and their rates."""

    pressures: tuple[Array, Array]
    rates: tuple[Array, Array]


@dataclass(frozen=True)
class BacksteppingController(GuardedController):
    """Gains of Table 4.3.2: 1/s, and Nm/rad, Nm s/rad of the motor's compensation.

    `portion`: the motor's share of the cylinder's wanted effort (4.3.20; 0 in the pneumatic
    mode). `feedforward`: the pneumatic feedforward (4.3.3.3), `compensation`: the motor's
    feedback (4.3.3.1). `preview` ticks ahead the feedforward is taken; 0: one PWM period, as
    its rates are over that.
    `estimator`: estimates the payload, or None.
    """

    design: DesignModel
    k1: float = 60.0
    k2: float = 20.0
    k3: float = 65.0
    k4: float = 65.0
    portion: float = 0.1
    motor_p: float = 85.0
    motor_d: float = 14.0
    feedforward: bool = True
    compensation: bool = True
    estimator: PayloadEstimator | None = None
    preview: int = 0

    def __post_init__(self) -> None:
        if not self.preview:
            object.__setattr__(self, "preview", _ticks_a_period(self.design))

    def start(self, lanes: int) -> BacksteppingMemory:
        """See `Controller`."""
        import numpy as np

        own = self.design.payload_mass * self.design.payload_length**2
        return BacksteppingMemory(np.zeros(lanes) + own, np.zeros(lanes), np.zeros(lanes))

    def stability(self, uses_motor: bool = True) -> StabilityCheck:
        """The gains against 4.3.50, of a controller for one rig (not stacked)."""
        acts = self.compensation and uses_motor
        p, d = (self.motor_p, self.motor_d) if acts else (0.0, 0.0)
        return check_stability(self.k1, self.k2, p, d, float(self.design.parameters.inertia))

    def law(
        self, memory: BacksteppingMemory, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        """Duties for the wanted flows (4.3.59) and the motor's effort (4.3.41)."""
        design, payload = self.design, memory.payload
        estimate = corrected(estimate, design.model)
        if self.estimator is not None:
            payload = self.estimator.update(payload, memory.motor, estimate, reference, design)
        model = loaded(design, payload)
        motion = Motion(
            estimate.position, estimate.velocity, estimate.pressure_a, estimate.pressure_b
        )
        point = point_at(motion, model, 0.0 * estimate.position, memory.motor, reference.velocity)
        (flow_a, flow_b), effort = self._feedback(point, estimate, reference, model)
        if self.feedforward:
            ahead_a, ahead_b = self._feedforward(reference, model)
            flow_a, flow_b = flow_a + ahead_a, flow_b + ahead_b
        motor = self._motor(effort, point, estimate, reference, model)
        limit = model.parameters.max_effort
        command = base.limit_effort(known(motor_command(motor, point, model)), limit)
        if not design.is_measured:
            flow_a = flow_a - leakage("a", point, model)
            flow_b = flow_b - leakage("b", point, model)
        after = BacksteppingMemory(payload, base.limit_effort(known(motor), limit), memory.rejected)
        return after, Commands(
            motor=command,
            valve_a=design.inverse_a.duty(known(flow_a), estimate.pressure_a),
            valve_b=design.inverse_b.duty(known(flow_b), estimate.pressure_b),
            payload_kg=payload_mass(payload, design),
        )

    def _motor(
        self,
        effort: Array,
        point: Point,
        estimate: StateEstimate,
        reference: Reference,
        model: Model,
    ) -> Array:
        """The motor's effort, Nm, of a whole wanted one (4.3.23, 4.3.41)."""
        motor = self.portion / (1.0 + self.portion) * effort
        if self.compensation:
            motor = motor + self.motor_p * (reference.position - estimate.position)
            motor = motor + self.motor_d * (reference.velocity - estimate.velocity)
        return motor

    def _feedback(
        self, point: Point, estimate: StateEstimate, reference: Reference, model: Model
    ) -> tuple[tuple[Array, Array], Array]:
        """Virtual flows kg/s (4.3.29, 4.3.30) and the whole wanted effort Nm (4.3.13)."""
        p = point.parameters
        wanted, effort, z2 = self._wanted(point, estimate, reference, model)
        lever = plant.pitch_radius(point, model)
        # gamma_3 of 4.3.24 is 1 m2/(kg s): in SI the coupling between the errors of torque and
        # pressure is negligible against the pressures' own feedback.
        coupling = z2 / p.inertia * lever
        flows = []
        for i, (side, gain, area) in enumerate(
            (("a", self.k3, p.area_a), ("b", self.k4, -p.area_b))
        ):
            error = wanted.pressures[i] - point.pressure(side)
            wish = gain * error + coupling * area + wanted.rates[i]
            flows.append(_flow_for(side, wish, point.pressure(side), point, model))
        return (flows[0], flows[1]), effort

    def _wanted(
        self, point: Point, estimate: StateEstimate, reference: Reference, model: Model
    ) -> tuple[_Wanted, Array, Array]:
        """Wanted pressures, the whole wanted effort Nm (4.3.13), and the error z2 rad/s."""
        effort, rate, z2 = self._effort(point, estimate, reference, model)
        return self._pressures(effort, rate, self.portion, point, model), effort, z2

    def _effort(
        self, point: Point, estimate: StateEstimate, reference: Reference, model: Model
    ) -> WantedEffort:
        """The whole wanted effort and its rate (4.3.13, 4.3.26)."""
        p = point.parameters
        z1 = reference.position - estimate.position
        dz1 = reference.velocity - estimate.velocity
        z2 = self.k1 * z1 + dz1
        ddz1 = reference.acceleration - estimate.acceleration
        beta = reference.acceleration + self.k1 * dz1 + z1 + self.k2 * z2
        dbeta = reference.jerk + self.k1 * ddz1 + dz1 + self.k2 * (self.k1 * dz1 + ddz1)
        friction = sliding_friction(point, model, reference.velocity)
        effort = p.inertia * beta + opposing_effort(point, model) + friction
        rate = p.inertia * dbeta + p.viscous * reference.acceleration
        return WantedEffort(effort, rate, z2)

    def wanted(
        self, estimate: StateEstimate, reference: Reference, model: Model | None = None
    ) -> WantedState:
        """What the feedback wants at every row of a record, (n,): effort, pressures, flows.

        By `model` (None: the design's own, with its own payload: what an estimator knew is not in
        a record).
        """
        known_model, none = model or self.design.model, 0.0 * estimate.position
        motion = Motion(
            estimate.position, estimate.velocity, estimate.pressure_a, estimate.pressure_b
        )
        point = point_at(motion, known_model, none, none, reference.velocity)
        wanted, _, _ = self._wanted(point, estimate, reference, known_model)
        flows, effort = self._feedback(point, estimate, reference, known_model)
        return WantedState(effort, wanted.pressures, flows)

    def _pressures(
        self, effort: Array, rate: Array, portion: Array, point: Point, model: Model
    ) -> _Wanted:
        """Pressures (4.3.21, 4.3.22) for a wanted effort and its rate, Nm and Nm/s.

        The pair that gives the cylinder's share of the effort and is as far above the
        atmosphere in one chamber as it is below the supply in the other (4.3.19).
        """
        p = point.parameters
        lever = plant.pitch_radius(point, model)
        both = (1.0 + portion) * (p.area_a + p.area_b) * lever
        middle = 0.5 * (p.supply + p.atmosphere)
        away = effort / both - (middle - p.atmosphere) * (p.area_a - p.area_b) / (
            p.area_a + p.area_b
        )
        xp = array_namespace(away)
        reach = p.supply - middle
        away = xp.clip(known(away), -reach, reach)
        return _Wanted((middle + away, middle - away), (rate / both, -rate / both))

    def _feedforward(self, reference: Reference, model: Model) -> tuple[Array, Array]:
        """Flows of the desired motion, one PWM period ahead (4.3.55 to 4.3.58), kg/s."""
        if reference.ahead is None:
            raise input_error("reference", "has no preview", f"give {self.preview} ticks")
        soon = Reference(*(row[self.preview - 1] for row in reference.ahead[:4]))
        now, then = (self._desired(r, model) for r in (reference, soon))
        period = model.parameters.pwm_period
        flows = []
        for side, before, after in zip("ab", now[0].pressures, then[0].pressures, strict=True):
            flows.append(_flow_for(side, (after - before) / period, after, then[1], model))
        return flows[0], flows[1]

    def _desired(self, reference: Reference, model: Model) -> tuple[_Wanted, Point]:
        middle = 0.0 * reference.position + model.parameters.atmosphere
        motion = Motion(reference.position, reference.velocity, middle, middle)
        point = point_at(motion, model, 0.0 * middle, 0.0 * middle, reference.velocity)
        effort = (
            point.parameters.inertia * reference.acceleration
            + opposing_effort(point, model)
            + sliding_friction(point, model, reference.velocity)
        )
        return self._pressures(effort, 0.0 * effort, 0.0, point, model), point


def _ticks_a_period(design: DesignModel) -> int:
    """Control periods in a PWM period; 1 for a rig without one."""
    import numpy as np

    period = float(np.ravel(design.parameters.pwm_period)[0])
    return max(1, round(period / PERIOD_S)) if np.isfinite(period) else 1


def _flow_for(side: str, rate: Array, pressure: Array, point: Point, model: Model) -> Array:
    """Flow, kg/s, that changes a pressure (Pa) at `rate` (Pa/s) while the piston moves."""
    p = point.parameters
    return base.flow_from_pressure_rate(
        rate,
        pressure,
        plant.chamber_volume(side, plant.displacement(point, model), p),
        plant.volume_rate(side, point, model),
        p.heat_capacity_ratio,
        p.gas_constant,
        p.temperature,
    )


def backstepping_type(number: int, design: DesignModel, **gains: Any) -> BacksteppingController:
    """Type 1 to 4 (Table 5.4.3): without compensation, with the motor's, pneumatic, both."""
    if number not in (1, 2, 3, 4):
        raise input_error(f"backstepping type {number}", "is not one of 1 to 4", "give one")
    return BacksteppingController(
        design, feedforward=number in (3, 4), compensation=number in (2, 4), **gains
    )


__all__ = [
    "BacksteppingController",
    "BacksteppingMemory",
    "WantedEffort",
    "WantedState",
    "backstepping_type",
]
