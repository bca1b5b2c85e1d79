"""What every flow surface is to a simulation or a controller: pure functions within its hull.

A `FlowLaw` is numbers alone: they may be arrays of any library, the names of a C header, or carry
the lanes of a batch as their first axis. Its functions are written once for all of these.
"""

from __future__ import annotations

import enum
from abc import abstractmethod
from dataclasses import dataclass

from sysid.plant.base import Array, array_namespace

# A duty this far beyond an edge is at the edge.
ROUNDING = 1e-9


class Saturation(enum.IntFlag):
    """Why a value was saturated; combined by `|`, 0 where nothing was."""

    INSIDE = 0
    PRESSURE = 1  # outside the pressure range; the nearest edge was used
    ABOVE = 2  # flow (inverse) or duty (forward map) above what was seen at this pressure
    BELOW = 4  # and below
    NO_ROOT = 8  # beyond the extremum of the surface (negative discriminant): its vertex
    DECREASING = 16  # root on a stretch where the fitted flow falls with duty, or is flat
    INVALID = 32  # an input is not finite; so is the result


Bounded = tuple[Array, dict[Saturation, Array]]
"""A value, and where (truth values) it was saturated for which reason."""


@dataclass(frozen=True, eq=False)
class FlowLaw:
    """Mean flow of one valve in one direction over duty and pressure, within the hull of its data.

    `duty_range`, `pressure_range` (2,): low and high, 0 to 1 and Pa. At the nodes `pressure` (G,),
    Pa: `duty_low`, `duty_high` and `flow_low`, `flow_high` (kg/s), linear between them.
    """

    duty_range: Array
    pressure_range: Array
    pressure: Array
    duty_low: Array
    duty_high: Array
    flow_low: Array
    flow_high: Array

    @abstractmethod
    def bounded_flow(self, duty: Array, pressure: Array) -> Bounded:
        """Mean flow, kg/s, at a duty (0 to 1) and a pressure, Pa."""

    @abstractmethod
    def bounded_duty(self, flow: Array, pressure: Array) -> Bounded:
        """Duty, 0 to 1, for a wanted mean flow, kg/s, at a pressure, Pa."""

    def flow(self, duty: Array, pressure: Array) -> Array:
        """Mean flow, kg/s; beyond the hull that at its edge."""
        return self.bounded_flow(duty, pressure)[0]

    def duty(self, flow: Array, pressure: Array) -> Array:
        """Duty, 0 to 1, for a wanted mean flow, kg/s; beyond what was seen the nearest."""
        return self.bounded_duty(flow, pressure)[0]

    def for_simulation(self) -> FlowLaw:
        """The law in the form whose flow costs a simulation least: itself, unless it iterates."""
        return self

    def within_pressure(self, pressure: Array) -> Array:
        """A pressure moved into the hull, Pa."""
        return clipped(pressure, *ends(self.pressure_range))

    def duty_limits(self, pressure: Array) -> tuple[Array, Array]:
        """Lowest and highest duty that was seen at a pressure."""
        return tuple(
            interpolated(pressure, self.pressure, edge) for edge in (self.duty_low, self.duty_high)
        )

    def flow_limits(self, pressure: Array) -> tuple[Array, Array]:
        """Lowest and highest flow, kg/s, that was seen at a pressure."""
        return tuple(
            interpolated(pressure, self.pressure, edge) for edge in (self.flow_low, self.flow_high)
        )


@dataclass(frozen=True, eq=False)
class ValveLaw:
    """Both directions of one valve: what a simulation and a controller ask of its surfaces."""

    filling: FlowLaw
    emptying: FlowLaw

    def fill(self, duty: Array, pressure: Array) -> Array:
        """Mean flow into the chamber while its pressure rises, kg/s."""
        return self.filling.flow(duty, pressure)

    def discharge(self, duty: Array, pressure: Array) -> Array:
        """Mean flow (negative: out) while the chamber's pressure falls, kg/s."""
        return self.emptying.flow(duty, pressure)

    def span(self, pressure: Array) -> Array:
        """Flow of the open valve less that of the closed one, kg/s, as the hulls' ends say."""
        high, low = ends(self.filling.duty_range)[1], ends(self.emptying.duty_range)[0]
        return (self.fill(high, pressure) - self.discharge(low, pressure)) / (high - low)

    def duty(self, flow: Array, pressure: Array) -> Array:
        """Duty, 0 to 1, for a wanted mean flow, kg/s: that of the direction of the flow."""
        xp = array_namespace(flow, pressure)
        into, out = self.filling.duty(flow, pressure), self.emptying.duty(flow, pressure)
        return xp.where(flow >= 0.0, into, out)


@dataclass(frozen=True, eq=False)
class NoValve:
    """What stands for the surfaces of a chamber that a rig lacks: nothing flows."""

    def fill(self, duty: Array, pressure: Array) -> Array:
        """0 kg/s."""
        return 0.0 * pressure

    discharge = fill

    def span(self, pressure: Array) -> Array:
        """0 kg/s."""
        return 0.0 * pressure


def ends(pair: Array) -> tuple[Array, Array]:
    """The two numbers of a pair (..., 2)."""
    return pair[..., 0], pair[..., 1]


def clipped(value: Array, low: Array, high: Array) -> Array:
    """A value not below `low` and not above `high`; NaN stays."""
    return array_namespace(value, low).clip(value, low, high)


def interpolated(value: Array, nodes: Array, at_nodes: Array) -> Array:
    """Linear between rising nodes (G,), the nearest value beyond; (lanes, G): each lane its own."""
    xp = array_namespace(value, nodes)
    if nodes.ndim == 1:
        return xp.interp(value, nodes, at_nodes)
    steps = nodes[..., 1:] - nodes[..., :-1]
    within = xp.clip(xp.expand_dims(value, -1) - nodes[..., :-1], 0.0, steps)
    slopes = (at_nodes[..., 1:] - at_nodes[..., :-1]) / steps
    return at_nodes[..., 0] + xp.sum(slopes * within, axis=-1)


__all__ = ["ROUNDING", "Bounded", "FlowLaw", "NoValve", "Saturation", "ValveLaw"]
