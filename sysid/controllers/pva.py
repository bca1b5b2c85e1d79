"""Position, velocity and acceleration feedback with feedforward and dead-zone compensation.

Thesis 4.2; gains of Table 4.2.2. The feedforward (4.2.3) is added before the division by
`full_scale`: only there are its printed gains as large as the feedback's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.controllers.guard import GuardedController, known
from sysid.controllers.interface import Commands, Reference, StateEstimate
from sysid.plant.base import Array, array_namespace


class PvaMemory(NamedTuple):
    """`rejected` (lanes,): the ticks that were not good (`GuardedController`)."""

    rejected: Array = 0.0


@dataclass(frozen=True)
class PvaController(GuardedController):
    """Gains per rad, s/rad, s2/rad; duties between which each valve answers. No motor."""

    position_gain: float = 140.0
    velocity_gain: float = 45.0
    acceleration_gain: float = 1.0
    feedforward_velocity: float = 1.0
    feedforward_acceleration: float = 0.1
    full_scale: float = 10.0
    duty_a_min: float = 0.08
    duty_a_max: float = 0.80
    duty_b_min: float = 0.08
    duty_b_max: float = 0.72

    def start(self, lanes: int) -> PvaMemory:
        """See `Controller`."""
        return PvaMemory(np.zeros(lanes))

    def virtual_input(self, estimate: StateEstimate, reference: Reference) -> Array:
        """The one input for both valves, -1 to 1 (4.2.1 and 4.2.3)."""
        xp = array_namespace(estimate.position)
        feedback = (
            self.position_gain * (reference.position - estimate.position)
            + self.velocity_gain * (reference.velocity - estimate.velocity)
            + self.acceleration_gain * (reference.acceleration - estimate.acceleration)
        )
        feedforward = (
            self.feedforward_velocity * reference.velocity
            + self.feedforward_acceleration * reference.acceleration
        )
        return xp.clip(known((feedback + feedforward) / self.full_scale), -1.0, 1.0)

    def law(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        """One valve by the virtual input's sign, past its dead zone (4.2.2)."""
        xp = array_namespace(estimate.position)
        u = self.virtual_input(estimate, reference)
        duty_a = self.duty_a_min + xp.abs(u) * (self.duty_a_max - self.duty_a_min)
        duty_b = self.duty_b_min + xp.abs(u) * (self.duty_b_max - self.duty_b_min)
        return memory, Commands(
            motor=0.0 * u,
            valve_a=xp.where(u <= 0.0, 0.0, duty_a),
            valve_b=xp.where(u >= 0.0, 0.0, duty_b),
        )


__all__ = ["PvaController", "PvaMemory"]
