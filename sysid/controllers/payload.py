"""The payload's inertia estimated while the loop runs (thesis 4.4.6, corrected)."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.controllers.design_model import DesignModel
from sysid.controllers.guard import known
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.prediction import (
    Motion,
    cylinder_effort,
    loaded,
    opposing_effort,
    point_at,
    sliding_friction,
)
from sysid.io.rig import GRAVITY_M_PER_S2
from sysid.plant.base import Array, array_namespace


@dataclass(frozen=True)
class PayloadEstimator:
    """4.4.18 to 4.4.24 with the friction that 4.4.19 lacks; numbers of Table 4.4.2.

    Acts where the rig is in the vertical (`DesignModel.gravity`): the payload is known by its
    weight. `threshold` Nm: no update while the effort's error is smaller; `least_angle` rad:
    nor near the hanging position, where the weight has no lever; `least_speed` rad/s of the
    reference: nor at rest, where friction holds any effort up to the static one (beyond the
    thesis); `forgetting` within 0.9 to 1 per tick; `heaviest` kg bounds the estimate.
    """

    threshold: float = 0.15
    least_angle: float = 0.318
    least_speed: float = 0.05
    forgetting: float = 0.999
    heaviest: float = 2.0

    def update(
        self,
        inertia: Array,
        motor: Array,
        estimate: StateEstimate,
        reference: Reference,
        design: DesignModel,
    ) -> Array:
        """The next estimate of the payload's inertia, kg m2, from the present one.

        `motor` is the effort that the motor has now, Nm. NaN where what it follows from is not
        finite.
        """
        xp = array_namespace(estimate.position)
        model = loaded(design, inertia)
        motion = Motion(
            estimate.position, estimate.velocity, estimate.pressure_a, estimate.pressure_b
        )
        point = point_at(motion, model, 0.0 * estimate.position, motor, reference.velocity)
        friction = sliding_friction(point, model, reference.velocity)
        # The actuators' effort beyond friction and acceleration carries the weight (4.4.20).
        given = cylinder_effort(point, model) + motor - friction
        held = given - point.parameters.inertia * reference.acceleration
        error = opposing_effort(point, model) - held
        sine = xp.sin(estimate.position)
        lever = design.payload_length
        present = inertia / xp.maximum(lever, 1e-9) * GRAVITY_M_PER_S2 * sine
        payload = present - error
        seen = payload * lever / (GRAVITY_M_PER_S2 * xp.where(xp.abs(sine) > 1e-3, sine, 1e-3))
        bounded = xp.clip(known(seen), 0.0, self.heaviest * lever**2)
        acts = (
            (xp.abs(error) > self.threshold)
            & (xp.abs(estimate.position) > self.least_angle)
            & (xp.abs(reference.velocity) > self.least_speed)
            & (design.gravity > 0.0)
        )
        smoothed = self.forgetting * inertia + (1.0 - self.forgetting) * bounded
        is_known = xp.isfinite(error) & xp.isfinite(smoothed)
        return xp.where(is_known, xp.where(acts, smoothed, inertia), xp.nan)

    def detects(self, inertia: Array, design: DesignModel) -> Array:
        """Whether an estimate, kg m2, is a payload and not the estimator's own tolerance.

        It is from the mass on whose weight reaches `threshold` with the whole lever: a lighter
        one never moves the estimate. In the horizontal, where no weight acts, it never is.
        """
        xp = array_namespace(inertia, design.payload_length)
        least = self.threshold / (GRAVITY_M_PER_S2 * xp.maximum(design.payload_length, 1e-3))
        return (payload_mass(inertia, design) > least) & (design.gravity > 0.0)


def payload_mass(inertia: Array, design: DesignModel) -> Array:
    """Mass, kg, of a payload of this inertia at its lever."""
    xp = array_namespace(inertia, design.payload_length)
    return inertia / xp.maximum(design.payload_length, 1e-3) ** 2


__all__ = ["PayloadEstimator", "payload_mass"]
