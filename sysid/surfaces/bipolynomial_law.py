"""The bipolynomial as a flow law: a parabola in the duty at each pressure (thesis 3.7.1)."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.plant.base import Array
from sysid.surfaces.hull import ROUNDING, Bounded, FlowLaw, Saturation, clipped, ends
from sysid.surfaces.inverse import invert_quadratic


@dataclass(frozen=True, eq=False)
class BipolynomialLaw(FlowLaw):
    """sum of c[i, j] u^i Tj(scaled pressure), i, j = 0 to 2, kg/s; u the duty, T of Chebyshev.

    `coefficients` (3, 3); `pressure_scaling` (2,): centre and half range, Pa.
    """

    coefficients: Array
    pressure_scaling: Array

    def bounded_flow(self, duty: Array, pressure: Array) -> Bounded:
        """See `FlowLaw`. A duty of the range that was not seen at this pressure is extrapolated."""
        p = self.within_pressure(pressure)
        low, high = self.duty_limits(p)
        c2, c1, c0 = self.quadratic(p)
        u = clipped(duty, *ends(self.duty_range))
        return (c2 * u + c1) * u + c0, {
            Saturation.PRESSURE: p != pressure,
            Saturation.ABOVE: duty > high + ROUNDING,
            Saturation.BELOW: duty < low - ROUNDING,
        }

    def bounded_duty(self, flow: Array, pressure: Array) -> Bounded:
        """See `FlowLaw`: within the duties seen at this pressure (thesis 3.7.2, 3.7.3)."""
        p = self.within_pressure(pressure)
        duty, reasons = invert_quadratic(*self.quadratic(p), flow, *self.duty_limits(p))
        return duty, {Saturation.PRESSURE: p != pressure, **reasons}

    def quadratic(self, pressure: Array) -> tuple[Array, Array, Array]:
        """C21, C11 and C01 + flow of 3.7.2 at a pressure, Pa: of u^2, u and 1, kg/s."""
        centre, half = ends(self.pressure_scaling)
        b = (pressure - centre) / half
        second = 2.0 * b * b - 1.0
        c = self.coefficients
        c2, c1, c0 = (c[..., i, 0] + c[..., i, 1] * b + c[..., i, 2] * second for i in (2, 1, 0))
        return c2, c1, c0


__all__ = ["BipolynomialLaw"]
