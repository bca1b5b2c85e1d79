"""Effects that vary along the stroke: the piston's area, the pressure of its seals, cushions."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.plant.base import Array, array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity, of_side
from sysid.plant.ports import Point


@dataclass(frozen=True)
class StrokeDependentArea(CatalogueEffect):
    """The piston's areas vary along the stroke: A_a and A_b (1 + d theta + c theta^2).

    A tapered bore has a slope d, a barrelled one a curvature c. Force and rate of the volumes vary
    alike, so that no energy is lost; the volumes in the middle of the stroke are the declared ones.
    """

    area_slope_per_rad: Array = 0.0
    area_curvature_per_rad2: Array = 0.0

    id = "stroke-dependent-area"
    title = "Piston area that varies along the stroke"
    subsystem = "mechanics"
    quantities = (
        Quantity("area_slope_per_rad", "1/rad", 0.05, -0.2, 0.2, "relative change per angle"),
        Quantity(
            "area_curvature_per_rad2",
            "1/rad2",
            0.1,
            -0.4,
            0.4,
            "relative change per square of the angle",
            absent=0.0,
        ),
    )
    signature = "torque against the cylinder's torque times angle or its square, the same both ways"
    rivals = ("pitch-eccentricity", "area-error", "cable-spring")
    tie_breaker = "static torque at two pressures, at both ends of the stroke"
    source = "thesis 3.3.3, with an area that is a function of the position"

    def pitch_radius(self, radius: Array, point: Point) -> Array:
        # The areas count times the radius only: dV/dtheta and torque per pressure.
        nominal, angle = point.parameters.pitch_radius, point.position
        change = self.area_slope_per_rad + self.area_curvature_per_rad2 * angle
        return radius + nominal * (change * angle)

    def displacement(self, displacement: Array, point: Point) -> Array:
        nominal, angle = point.parameters.pitch_radius, point.position
        change = self.area_slope_per_rad / 2.0 + self.area_curvature_per_rad2 * angle / 3.0
        return displacement + nominal * (change * angle * angle)


@dataclass(frozen=True)
class StrokeDependentSeals(CatalogueEffect):
    """Friction by pressure varies along the stroke: + (d theta + c |theta|) (gauge Pa + Pb) sign w.

    In addition to seal friction, which is its value in the middle: seals press harder where the
    bore is narrower. A tapered bore has d alone, one that is narrow at both ends c, at one end
    both.
    """

    seal_slope_nm_per_pa_rad: Array = 0.0
    seal_bend_nm_per_pa_rad: Array = 0.0

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
        Quantity(
            "seal_bend_nm_per_pa_rad",
            "Nm/(Pa rad)",
            2e-7,
            -2e-6,
            2e-6,
            "change of the friction per pressure on the seals and angle from the middle",
            absent=0.0,
        ),
    )
    signature = (
        "torque against the sum of the pressures times angle, or its amount, against the motion"
    )
    rivals = ("seal-friction", "position-dependent-friction", "stroke-dependent-area")
    tie_breaker = "reversals at the same angle, at several common-mode pressures"
    source = (
        "Andrighetto, Valdiero, Carlotto, Study of the friction behaviour, COBEM 2005 (by "
        "pressure); Olsson et al., European Journal of Control 4(3), 1998 (by position)"
    )

    def friction_effort(self, effort: Array, point: Point) -> Array:
        gauge = point.pressure_a + point.pressure_b - 2.0 * point.parameters.atmosphere
        angle = point.position
        change = self.seal_slope_nm_per_pa_rad * angle
        change = change + self.seal_bend_nm_per_pa_rad * abs(angle)
        return effort + change * gauge * point.direction


@dataclass(frozen=True)
class EndCushion(CatalogueEffect):
    """A cushion near an end of the stroke: - d s (depth / s)^n (1 + c speed), depth = |theta| - s.

    It begins at s from the middle; d is its stiffness where it is as deep as s. Damping c makes it
    push harder on the way in than on the way out; it never pulls. A cushion of side "a" is at the
    end where chamber A is smallest, at negative theta.
    """

    cushion_nm_per_rad: Array = 0.0
    cushion_start_rad: Array = 0.5
    cushion_exponent: Array = 2.0
    side: str = "both"
    cushion_damping_s_per_rad: Array = 0.0

    id = "end-cushion"
    title = "Cushion at an end of the stroke"
    subsystem = "mechanics"
    quantities = (
        Quantity(
            "cushion_nm_per_rad", "Nm/rad", 0.3, 0.0, 20.0, "torque per depth at a depth of s"
        ),
        Quantity(
            "cushion_start_rad",
            "rad",
            0.5,
            0.05,
            3.0,
            "angle from the middle at which it begins, s",
            is_strength=False,
            grid=(0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.25, 1.5),
        ),
        Quantity(
            "cushion_exponent",
            "-",
            2.0,
            1.0,
            4.0,
            "1 a spring, 1.5 a contact of round bodies, above it stiffens further",
            is_strength=False,
            grid=(1.0, 2.5),
        ),
        Quantity(
            "cushion_damping_s_per_rad",
            "s/rad",
            0.0,
            0.0,
            5.0,
            "share by which it pushes harder, per speed into the cushion",
            is_strength=False,
            grid=(0.0, 0.3),
            absent=0.0,
        ),
    )
    signature = "torque against angle near an end, towards the middle, at rest too"
    rivals = ("cable-spring", "mounting-tilt")
    tie_breaker = "breakaway in both directions at several angles, some close to the end"
    is_of_an_end = True
    source = "Hunt, Crossley, ASME Journal of Applied Mechanics 42(2), 1975"

    def external_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.position, self.cushion_nm_per_rad)
        start = self.cushion_start_rad
        # Never zero: a power of zero has no derivative.
        depth = xp.maximum(xp.abs(point.position) - start, 0.0) / start + 1e-12
        upper, lower = (1.0 * of_side(side, self.side) for side in "ba")
        way = xp.where(point.position > 0, upper, -lower)
        push = xp.maximum(1.0 + self.cushion_damping_s_per_rad * way * point.velocity, 0.0)
        return effort - way * (
            self.cushion_nm_per_rad * start * depth**self.cushion_exponent * push
        )


EFFECTS: tuple[type[CatalogueEffect], ...] = (
    StrokeDependentArea,
    StrokeDependentSeals,
    EndCushion,
)
