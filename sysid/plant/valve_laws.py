"""Flow through a valve, by the law that each of its directions obeys.

The thesis', that of the valve with a flow control in series (thesis 3.6), or ISO 6358.

Kinds and units as in `base`. Which law a direction obeys is part of a model's structure.
"""

from __future__ import annotations

from collections.abc import Callable

from sysid.plant import base
from sysid.plant.base import LEAST_DIVISOR, Array, ValveParameters, array_namespace
from sysid.plant.flow_control import series_exhaust_boundary, series_filling_boundary
from sysid.plant.iso6358 import ANR_TEMPERATURE, iso6358_flow


def obeys_iso(valve: ValveParameters, way: str) -> bool:
    """Whether a direction, "fill" or "dis", obeys ISO 6358."""
    return getattr(valve, f"sonic_conductance_{way}") is not None


def iso_numbers(valve: ValveParameters, way: str) -> tuple[Array, Array, Array]:
    """Conductance, critical ratio and index of a direction that obeys ISO 6358."""
    return (
        getattr(valve, f"sonic_conductance_{way}"),
        getattr(valve, f"critical_ratio_{way}"),
        getattr(valve, f"subsonic_index_{way}"),
    )


def filling_boundary(valve: ValveParameters, supply: Array) -> Array:
    """Chamber pressure up to which filling is choked, Pa."""
    if obeys_iso(valve, "fill"):
        return valve.critical_ratio_fill * supply
    if valve.valve_c_fill is not None:
        return series_filling_boundary(supply, valve.valve_c_fill, valve.c_fill)
    return base.filling_boundary(supply)


def exhaust_boundary(valve: ValveParameters, atmosphere: Array) -> Array:
    """Chamber pressure from which on the exhaust is choked, Pa."""
    if obeys_iso(valve, "dis"):
        ratio = valve.critical_ratio_dis
        return atmosphere / array_namespace(ratio).maximum(ratio, LEAST_DIVISOR)
    if valve.valve_c_dis is not None:
        return series_exhaust_boundary(atmosphere, valve.valve_c_dis, valve.c_dis)
    return base.exhaust_boundary(atmosphere)


def filling_flow(
    valve: ValveParameters,
    pressure: Array,
    supply: Array,
    supply_reference: Array | None = None,
    choked: Array | None = None,
    temperature: Array = ANR_TEMPERATURE,
) -> Array:
    """Flow into the chamber through an open valve, kg/s; as `base.filling_flow`.

    ISO 6358 is continuous at its boundary: `choked` changes nothing of it. `temperature` in K.
    """
    if obeys_iso(valve, "fill"):
        return iso6358_flow(supply, pressure, *iso_numbers(valve, "fill"), temperature)
    if choked is None:
        choked = pressure <= filling_boundary(valve, supply)
    return base.filling_flow(
        pressure, supply, valve.choked_fill, valve.c_fill, supply_reference, choked
    )


def exhaust_flow(
    valve: ValveParameters,
    pressure: Array,
    atmosphere: Array,
    choked: Array | None = None,
    temperature: Array = ANR_TEMPERATURE,
) -> Array:
    """Flow into the chamber (negative: out) through a valve that is off, kg/s.

    As `base.exhaust_flow`; `choked` and `temperature` as in `filling_flow`.
    """
    if obeys_iso(valve, "dis"):
        return iso6358_flow(atmosphere, pressure, *iso_numbers(valve, "dis"), temperature)
    if choked is None:
        choked = pressure >= exhaust_boundary(valve, atmosphere)
    return base.exhaust_flow(pressure, atmosphere, valve.choked_dis, valve.c_dis, choked)


def filling_from(
    valve: ValveParameters,
    supply: Array,
    supply_reference: Array,
    temperature: Array = ANR_TEMPERATURE,
) -> Callable[[Array], Array]:
    """`filling_flow` from a supply that stays, of the pressure alone."""
    boundary = filling_boundary(valve, supply)

    def flow(pressure: Array) -> Array:
        choked = pressure <= boundary
        return filling_flow(valve, pressure, supply, supply_reference, choked, temperature)

    return flow


def exhaust_to(
    valve: ValveParameters, atmosphere: Array, temperature: Array = ANR_TEMPERATURE
) -> Callable[[Array], Array]:
    """`exhaust_flow` to a line whose pressure stays, of the chamber's pressure alone."""
    boundary = exhaust_boundary(valve, atmosphere)

    def flow(pressure: Array) -> Array:
        return exhaust_flow(valve, pressure, atmosphere, pressure >= boundary, temperature)

    return flow


def root_coefficient(
    valve: ValveParameters,
    way: str,
    line: Array,
    pressure: Array,
    temperature: Array = ANR_TEMPERATURE,
) -> Array:
    """c of flow = c sqrt(|line - pressure|) where a chamber nears a line, kg/(s Pa^0.5).

    The thesis' exhaust, which is linear in the difference, has none (ValueError); ISO 6358's c
    depends on the difference.
    """
    if not obeys_iso(valve, way):
        if way != "fill":
            raise ValueError("the thesis' exhaust is linear in the pressure difference")
        return valve.c_fill
    xp = array_namespace(line, pressure)
    gap = xp.maximum(xp.abs(line - pressure), 1e-3)
    high = xp.maximum(line, pressure)
    flow = iso6358_flow(high, high - gap, *iso_numbers(valve, way), temperature)
    return flow / xp.sqrt(gap)


__all__ = [
    "exhaust_boundary",
    "exhaust_flow",
    "exhaust_to",
    "filling_boundary",
    "filling_flow",
    "filling_from",
    "iso_numbers",
    "obeys_iso",
    "root_coefficient",
]
