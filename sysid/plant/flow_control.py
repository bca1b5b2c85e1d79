"""A flow control in series with the valve (thesis 3.6.1 to 3.6.10), two orifices in a row.

The two-orifice law with its intermediate pressure, and the combined coefficients with which
the chamber pressure alone gives the flow. Kinds and units as in `base`.
"""

from __future__ import annotations

from sysid.plant.base import (
    Array,
    array_namespace,
    is_exhaust_choked,
    is_filling_choked,
    unchoked_exhaust_flow,
    unchoked_filling_flow,
)


def series_filling_coefficient(c_valve: Array, c_control: Array) -> Array:
    """Combined c_fill of valve and flow control, kg/(s Pa^0.5): C1 C2 / sqrt(C1^2 + C2^2)."""
    xp = array_namespace(c_valve, c_control)
    return c_valve * c_control / xp.sqrt(c_valve**2 + c_control**2)


def series_exhaust_coefficient(c_valve: Array, c_control: Array) -> Array:
    """Combined c_dis of valve and flow control, kg/(s Pa): C1 C2 / (C1 + C2)."""
    return c_valve * c_control / (c_valve + c_control)


def filling_intermediate_pressure(
    pressure: Array, supply: Array, c_valve: Array, c_control: Array
) -> Array:
    """Pressure between valve and flow control while filling, Pa (3.6.4), both unchoked."""
    valve, control = c_valve**2, c_control**2
    return (valve * supply + control * pressure) / (valve + control)


def exhaust_intermediate_pressure(
    pressure: Array, atmosphere: Array, c_valve: Array, c_control: Array
) -> Array:
    """Pressure between flow control and valve while discharging, Pa (3.6.9), unchoked."""
    return (c_valve * atmosphere + c_control * pressure) / (c_valve + c_control)


def series_filling_flow(
    pressure: Array, supply: Array, choked_fill: Array, c_valve: Array, c_control: Array
) -> Array:
    """Filling flow through valve and flow control by the two-orifice law, kg/s (3.6.6).

    The valve is choked where the intermediate pressure is at most 0.53 Ps.
    """
    xp = array_namespace(pressure, supply, choked_fill, c_valve, c_control)
    between = filling_intermediate_pressure(pressure, supply, c_valve, c_control)
    combined = series_filling_coefficient(c_valve, c_control)
    return xp.where(
        is_filling_choked(between, supply),
        choked_fill,
        unchoked_filling_flow(pressure, supply, combined),
    )


def series_exhaust_flow(
    pressure: Array, atmosphere: Array, choked_dis: Array, c_valve: Array, c_control: Array
) -> Array:
    """Exhaust flow through flow control and valve by the two-orifice law, kg/s (3.6.10).

    The valve is choked where the intermediate pressure is at least P0 / 0.53.
    """
    xp = array_namespace(pressure, atmosphere, choked_dis, c_valve, c_control)
    between = exhaust_intermediate_pressure(pressure, atmosphere, c_valve, c_control)
    combined = series_exhaust_coefficient(c_valve, c_control)
    return xp.where(
        is_exhaust_choked(between, atmosphere),
        -choked_dis,
        unchoked_exhaust_flow(pressure, atmosphere, combined),
    )
