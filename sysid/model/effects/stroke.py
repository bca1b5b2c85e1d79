"""Effects that vary along the stroke: the piston's area and the pressure of its seals."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.model.base import Array
from sysid.model.effects.entry import CatalogueEffect, Quantity
from sysid.model.ports import Point


@dataclass(frozen=True)
class StrokeDependentArea(CatalogueEffect):
    """The piston's areas vary along the stroke, as in a tapered bore: A_a and A_b (1 + d theta).

    Force and rate of the volumes vary alike, so that no energy is lost; the volumes in the middle
    of the stroke are the declared ones.
    """

    area_slope_per_rad: Array = 0.0

    id = "stroke-dependent-area"
    title = "Piston area that varies along the stroke"
    subsystem = "mechanics"
    quantities = (
        Quantity("area_slope_per_rad", "1/rad", 0.05, -0.2, 0.2, "relative change per angle"),
    )
    signature = "torque against the cylinder's torque times angle, the same in both directions"
    rivals = ("pitch-eccentricity", "area-error", "cable-spring")
    tie_breaker = "static torque at two pressures, at both ends of the stroke"
    source = "thesis 3.3.3, with an area that is a function of the position"

    def pitch_radius(self, radius: Array, point: Point) -> Array:
        # The areas count times the radius only: dV/dtheta and torque per pressure.
        nominal = point.parameters.pitch_radius
        return radius + nominal * (self.area_slope_per_rad * point.position)

    def displacement(self, displacement: Array, point: Point) -> Array:
        nominal, angle = point.parameters.pitch_radius, point.position
        return displacement + nominal * (0.5 * self.area_slope_per_rad * angle * angle)


@dataclass(frozen=True)
class StrokeDependentSeals(CatalogueEffect):
    """Friction by pressure varies along the stroke: + d theta (gauge Pa + Pb) sign w.

    Beside seal friction, which is its mean: seals press harder where the bore is narrower.
    """

    seal_slope_nm_per_pa_rad: Array = 0.0

    id = "stroke-dependent-seals"
    title = "Seal friction that varies along the stroke"
    subsystem = "friction"
    quantities = (
        Quantity(
            "seal_slope_nm_per_pa_rad",
            "Nm/(Pa rad)",
            2e-7,
            -2e-6,
            2e-6,
            "change of the friction per pressure on the seals and angle",
        ),
    )
    signature = "torque against the sum of the pressures times angle, against the motion"
    rivals = ("seal-friction", "position-dependent-friction", "stroke-dependent-area")
    tie_breaker = "reversals at the same angle, at several common-mode pressures"
    source = (
        "Andrighetto, Valdiero, Carlotto, Study of the friction behaviour, COBEM 2005 (by "
        "pressure); Olsson et al., European Journal of Control 4(3), 1998 (by position)"
    )

    def friction_effort(self, effort: Array, point: Point) -> Array:
        gauge = point.pressure_a + point.pressure_b - 2.0 * point.parameters.atmosphere
        slope = self.seal_slope_nm_per_pa_rad * point.position
        return effort + slope * gauge * point.direction


EFFECTS: tuple[type[CatalogueEffect], ...] = (StrokeDependentArea, StrokeDependentSeals)
