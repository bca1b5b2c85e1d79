"""Discrete-valued model predictive control with inverse dynamics of the motor (thesis 4.4).

At every decision the four combinations of the two valves (Table 4.4.1) are predicted at once
over the horizon, and the one with the least sum of squared errors is held. Beyond the thesis:
the valves' delays may be predicted, and the input may change within the horizon (7.3 (5)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.controllers.design_model import DesignModel
from sysid.controllers.effective_law import edge_delay
from sysid.controllers.guard import GuardedController, known
from sysid.controllers.interface import Commands, Reference, StateEstimate
from sysid.controllers.payload import PayloadEstimator, payload_mass
from sysid.controllers.prediction import (
    Motion,
    corrected,
    cylinder_effort,
    euler_step,
    loaded,
    motor_command,
    opposing_effort,
    point_at,
    sliding_friction,
)
from sysid.plant import base
from sysid.plant.arrays import repeat, when
from sysid.plant.base import Array, array_namespace
from sysid.plant.ports import Model

# Valve A and B of each combination, in the order of Table 4.4.1: (4, 1).
_COMBINATIONS = np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]])[:, :, None]


class DvmpcMemory(NamedTuple):
    """Held inputs 0 or 1, payload's inertia kg m2, the motor's last effort Nm; (lanes,).

    `tick`: the inputs are decided where it is 0; `rejected`: ticks that were not good, which
    count in no `tick`.
    """

    valve_a: Array
    valve_b: Array
    payload: Array
    motor: Array
    tick: Array = 0.0
    rejected: Array = 0.0


class _Outlook(NamedTuple):
    """The reference from now on, (1 + horizon, lanes), and the valves' state at the decision."""

    position: Array
    velocity: Array
    before: tuple[Array, Array]


class _Stretch(NamedTuple):
    """Part of the horizon with one input: its steps, ticks in each, first tick, inputs."""

    steps: int
    ticks: int
    first: int
    inputs: tuple[Array, Array]


@dataclass(frozen=True)
class DvmpcController(GuardedController):
    """Table 4.4.4: `horizon` and `hold` in ticks of `period` s; the motor's natural frequency
    rad/s and damping (4.4.17), which with the printed gains are 50 rad/s and 1.

    `predicts_delays`: a changed input acts after the valve's delay, as on the rig, not at
    once as in 4.4.2. `trapezoidal`: positions by the mean velocity of a step (`euler_step`), not
    by 4.4.2's old one. `filtered_velocity`: predictions start from the filtered velocity, not
    from the last difference of the encoder. `varying`: each of the four inputs, held for
    `hold` ticks, is followed by each of the four for the rest, which is predicted in whole
    steps of `coarse` ticks, so that the sixteen sequences take about as many steps as the four
    whole ones (best: `hold` 7 and `horizon` 39, `benchmarks/controllers.py`). `estimator`:
    estimates the payload, or None.
    """

    design: DesignModel
    horizon: int = 30
    hold: int = 5
    period: float = 1e-3
    natural_frequency: float = 50.0
    damping: float = 1.0
    predicts_delays: bool = False
    trapezoidal: bool = False
    filtered_velocity: bool = False
    varying: bool = False
    coarse: int = 4
    estimator: PayloadEstimator | None = None
    is_duty: bool = False

    @property
    def preview(self) -> int:  # type: ignore[override]
        """Ticks of the reference within the horizon."""
        return self.horizon

    @property
    def predicted_steps(self) -> int:
        """Euler steps of one decision, all sequences together."""
        if not self.varying:
            return 4 * self.horizon
        return 4 * self.hold + 16 * ((self.horizon - self.hold) // self.coarse)

    def start(self, lanes: int) -> DvmpcMemory:
        """See `Controller`."""
        none = np.zeros(lanes)
        own = self.design.payload_mass * self.design.payload_length**2
        return DvmpcMemory(none, none, none + own, none, none, none)

    def law(
        self, memory: DvmpcMemory, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        """The held combination, decided anew every `hold` ticks, and the motor's effort."""
        payload = memory.payload
        estimate = corrected(estimate, self.design.model)
        if self.estimator is not None:
            payload = self.estimator.update(payload, memory.motor, estimate, reference, self.design)
        model = loaded(self.design, payload)
        before = memory.valve_a, memory.valve_b
        xp = array_namespace(estimate.position)
        decides = memory.tick + 0.0 * payload == 0.0
        found = when(
            decides.any(),
            lambda: self.decide(before, estimate, reference, model),
            before,
            estimate.position,
        )
        a, b = (xp.where(decides, x, y) for x, y in zip(found, before, strict=True))
        motor = self.inverse_dynamics(estimate, reference, model)
        tick = xp.where(memory.tick + 1.0 < self.hold, memory.tick + 1.0, 0.0)
        return DvmpcMemory(a, b, payload, motor, tick, memory.rejected), Commands(
            motor=motor,
            valve_a=a,
            valve_b=b,
            payload_kg=payload_mass(payload, self.design),
        )

    def decide(
        self,
        before: tuple[Array, Array],
        estimate: StateEstimate,
        reference: Reference,
        model: Model,
    ) -> tuple[Array, Array]:
        """Valve A's and B's best input, 0 or 1 (lanes,), after the held inputs `before`.

        Sequences whose cost is not finite are discarded; NaN if none remains.
        """
        costs = self.costs(before, estimate, reference, model)
        xp = array_namespace(costs)
        is_known = xp.isfinite(costs)
        best = xp.argmin(xp.where(is_known, costs, xp.inf), axis=0)
        if self.varying:
            best = best // 4
        off = xp.where(is_known.any(axis=0), 0.0, xp.nan)
        return xp.where(best % 2 == 1, 1.0 + off, off), xp.where(best >= 2, 1.0 + off, off)

    def costs(
        self,
        before: tuple[Array, Array],
        estimate: StateEstimate,
        reference: Reference,
        model: Model,
    ) -> Array:
        """Sum of squared errors of every sequence (4.4.1), rad2 times ticks.

        (4, lanes) in the order of Table 4.4.1; with `varying` (16, lanes), four times the
        first input plus the second.
        """
        xp = array_namespace(estimate.position)
        assert reference.ahead is not None
        outlook = _Outlook(
            xp.concatenate([reference.position[None], reference.ahead.position]),
            xp.concatenate([reference.velocity[None], reference.ahead.velocity]),
            before,
        )
        wide = xp.zeros((4, 1)) + 0.0 * estimate.position
        velocity = estimate.velocity if self.filtered_velocity else estimate.raw_velocity
        motion = Motion(
            wide + estimate.position,
            wide + velocity,
            wide + estimate.pressure_a,
            wide + estimate.pressure_b,
        )
        inputs = tuple(xp.asarray(row) + wide for row in _COMBINATIONS)
        whole = self.hold if self.varying else self.horizon
        stretch = _Stretch(whole, 1, 0, (inputs[0], inputs[1]))
        motion, cost = self._roll(motion, wide, stretch, outlook, model)
        if not self.varying:
            return cost
        motion = Motion(*(xp.repeat(x, 4, axis=0) for x in motion))
        then = tuple(xp.tile(row, (4, 1)) for row in inputs)
        now = tuple(xp.repeat(row, 4, axis=0) for row in inputs)
        steps = (self.horizon - self.hold) // self.coarse
        stretch = _Stretch(steps, self.coarse, self.hold, (then[0], then[1]))
        outlook = outlook._replace(before=(now[0], now[1]))
        return self._roll(motion, xp.repeat(cost, 4, axis=0), stretch, outlook, model)[1]

    def _roll(
        self, motion: Motion, cost: Array, stretch: _Stretch, outlook: _Outlook, model: Model
    ) -> tuple[Motion, Array]:
        """Motion and cost after a stretch of the horizon with one input."""
        none = 0.0 * motion.position

        def body(i: Any, carry: tuple[Motion, Array]) -> tuple[Motion, Array]:
            motion, cost = carry
            tick = stretch.first + i * stretch.ticks
            wanted = none + outlook.velocity[tick]
            point = point_at(motion._replace(velocity=wanted), model, none, none, wanted)
            shares = self._shares(i * stretch.ticks, stretch, outlook, model)
            step = self.period * stretch.ticks
            after = euler_step(motion, shares, point, model, step, self.trapezoidal)
            error = outlook.position[tick + stretch.ticks] - after.position
            return after, cost + stretch.ticks * error * error

        return repeat(stretch.steps, body, (motion, cost), motion.position)

    def _shares(
        self, since: Array, stretch: _Stretch, outlook: _Outlook, model: Model
    ) -> tuple[Array, Array]:
        """Share of the step `since` ticks after the change in which each valve is open."""
        if not self.predicts_delays:
            return stretch.inputs
        since_s, span_s = since * self.period, stretch.ticks * self.period
        a, b = (
            delayed_share(side, new, old, since_s, span_s, model)
            for side, new, old in zip("ab", stretch.inputs, outlook.before, strict=True)
        )
        return a, b

    def inverse_dynamics(
        self, estimate: StateEstimate, reference: Reference, model: Model
    ) -> Array:
        """Motor effort, Nm (4.4.10 corrected): what the cylinder does not give, and feedback."""
        motion = Motion(
            estimate.position, estimate.velocity, estimate.pressure_a, estimate.pressure_b
        )
        none = 0.0 * estimate.position
        point = point_at(motion, model, none, none, reference.velocity)
        inertia = point.parameters.inertia
        missing = (
            inertia * reference.acceleration
            - cylinder_effort(point, model)
            + opposing_effort(point, model)
            + sliding_friction(point, model, reference.velocity)
        )
        w = self.natural_frequency
        stiff = inertia * w * w * (reference.position - estimate.position)
        damped = 2.0 * self.damping * w * inertia * (reference.velocity - estimate.velocity)
        command = motor_command(missing + stiff + damped, point, model)
        return base.limit_effort(known(command), model.parameters.max_effort)


def delayed_share(
    side: str, new: Array, old: Array, since: Array, span: Array, model: Model
) -> Array:
    """Share of a step of `span` s in which a valve is open, `since` s after its command changed.

    `new` and `old` are the commands, 0 or 1; the old one acts until the valve's delay is over.
    """
    xp = array_namespace(new)
    opens = edge_delay(side, True, model, new) - since
    closes = edge_delay(side, False, model, new) - since
    late = xp.where(new > old, opens, closes)
    share = xp.clip(late / span, 0.0, 1.0)
    return share * old + (1.0 - share) * new


__all__ = ["DvmpcController", "DvmpcMemory", "delayed_share"]
