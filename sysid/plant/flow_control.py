"""A flow control in series with the valve (thesis 3.6.1 to 3.6.10), two orifices in a row.

Both pass the same flow, so that a chamber's pressure alone gives it, by the coefficient of both.
The valve chokes by the pressure between them: of the pressure drop over both, its share is a number
of their coefficients, and so the choked boundary is a pressure of the chamber. Kinds and units as
in `base`; "valve" is the valve's own coefficient, "combined" that of both.
"""

from __future__ import annotations

from sysid.plant.base import CRITICAL_RATIO, LEAST_DIVISOR, Array, array_namespace


def series_filling_coefficient(c_valve: Array, c_control: Array) -> Array:
    """Combined c_fill of valve and flow control, kg/(s Pa^0.5): C1 C2 / sqrt(C1^2 + C2^2)."""
    xp = array_namespace(c_valve, c_control)
    return c_valve * c_control / xp.sqrt(c_valve**2 + c_control**2)


def series_exhaust_coefficient(c_valve: Array, c_control: Array) -> Array:
    """Combined c_dis of valve and flow control, kg/(s Pa): C1 C2 / (C1 + C2)."""
    return c_valve * c_control / (c_valve + c_control)


def filling_intermediate_pressure(
    pressure: Array, supply: Array, c_valve: Array, combined: Array
) -> Array:
    """Pressure between valve and flow control while filling, Pa (3.6.4), both unchoked."""
    return supply - (combined / c_valve) ** 2 * (supply - pressure)


def exhaust_intermediate_pressure(
    pressure: Array, atmosphere: Array, c_valve: Array, combined: Array
) -> Array:
    """Pressure between flow control and valve while discharging, Pa (3.6.9), unchoked."""
    return atmosphere + (combined / c_valve) * (pressure - atmosphere)


def series_filling_boundary(supply: Array, c_valve: Array, combined: Array) -> Array:
    """Chamber pressure up to which the valve is choked while filling, Pa (3.6.6).

    There the pressure between the two is 0.53 Ps. Below 0 with a flow control so narrow that the
    valve is never choked.
    """
    xp = array_namespace(supply, c_valve, combined)
    drop = (c_valve / xp.maximum(combined, LEAST_DIVISOR**2)) ** 2
    return (1.0 - (1.0 - CRITICAL_RATIO) * drop) * supply


def series_exhaust_boundary(atmosphere: Array, c_valve: Array, combined: Array) -> Array:
    """Chamber pressure from which on the valve is choked while discharging, Pa (3.6.10).

    There the pressure between the two is P0 / 0.53.
    """
    xp = array_namespace(atmosphere, c_valve, combined)
    drop = c_valve / xp.maximum(combined, LEAST_DIVISOR**2)
    return (1.0 + (1.0 / CRITICAL_RATIO - 1.0) * drop) * atmosphere


__all__ = [
    "exhaust_intermediate_pressure",
    "filling_intermediate_pressure",
    "series_exhaust_boundary",
    "series_exhaust_coefficient",
    "series_filling_boundary",
    "series_filling_coefficient",
]
