"""The network as a flow law: its duty at once, the flow where it gives a duty by iteration."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from sysid.plant.base import Array, array_namespace
from sysid.surfaces.hull import ROUNDING, Bounded, FlowLaw, Saturation, clipped, ends
from sysid.surfaces.inverse import evaluated, invert_rising

# Nodes of the flow over duty and pressure that a simulation reads; between them it is bilinear.
_NODES = 129


@dataclass(frozen=True, eq=False)
class NetworkLaw(FlowLaw):
    """duty = centre + half (v tanh(w_m m + w_p p + b) + c), m and p the scaled flow and pressure.

    `flow_weights`, `pressure_weights`, `hidden_bias`, `output_weights` (H,), `output_bias`;
    `scaling` (3, 2): centre and half range of flow (kg/s), pressure (Pa) and duty.
    """

    flow_weights: Array
    pressure_weights: Array
    hidden_bias: Array
    output_weights: Array
    output_bias: Array
    scaling: Array

    def network(self, flow: Array, pressure: Array) -> tuple[Array, Array]:
        """The bare network's duty and its slope over the flow, s/kg; nothing saturated."""
        xp = array_namespace(flow, pressure, self.scaling)
        m, p = (
            xp.expand_dims((value - self.scaling[..., i, 0]) / self.scaling[..., i, 1], -1)
            for i, value in enumerate((flow, pressure))
        )
        layer = xp.tanh(self.flow_weights * m + (self.pressure_weights * p + self.hidden_bias))
        out = xp.sum(self.output_weights * layer, axis=-1)
        slope = xp.sum(self.output_weights * self.flow_weights * (1.0 - layer * layer), axis=-1)
        centre, half = self.scaling[..., 2, 0], self.scaling[..., 2, 1]
        return centre + half * (out + self.output_bias), half / self.scaling[..., 0, 1] * slope

    def for_simulation(self) -> FlowLaw:
        """The law with its flow tabulated: a step needs 28 flows, each of which takes iterations.

        By iteration a simulation takes 40 times as long (without the search for the first
        crossing; with it 300 times).
        """
        pressures, duties = (
            np.linspace(float(pair[0]), float(pair[1]), _NODES)
            for pair in (self.pressure_range, self.duty_range)
        )
        flow = evaluated(self.bounded_flow, duties[:, None], pressures[None, :])[0]
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return SimulatedNetwork(**own, nodes=flow)

    def bounded_duty(self, flow: Array, pressure: Array) -> Bounded:
        """See `FlowLaw`: flow, pressure and duty are saturated."""
        p = self.within_pressure(pressure)
        low, high = self.flow_limits(p)
        bottom, top = ends(self.duty_range)
        u = self.network(clipped(flow, low, high), p)[0]
        xp = array_namespace(u)
        return clipped(u, bottom, top), {
            Saturation.PRESSURE: p != pressure,
            Saturation.ABOVE: xp.logical_or(flow > high, u > top),
            Saturation.BELOW: xp.logical_or(flow < low, u < bottom),
        }

    def bounded_flow(self, duty: Array, pressure: Array) -> Bounded:
        """See `FlowLaw`: the lowest flow of the hull to which the network gives the duty."""
        p = self.within_pressure(pressure)
        low, high = self.flow_limits(p)
        bottom, top = ends(self.duty_range)
        flow, reached, beneath = invert_rising(
            lambda m: self.network(m, p), clipped(duty, bottom, top), low, high
        )
        xp = array_namespace(flow)
        return flow, {
            Saturation.PRESSURE: p != pressure,
            Saturation.ABOVE: xp.logical_or(duty > top + ROUNDING, xp.logical_not(reached)),
            Saturation.BELOW: xp.logical_or(duty < bottom - ROUNDING, beneath),
        }


@dataclass(frozen=True, eq=False)
class SimulatedNetwork(NetworkLaw):
    """A network whose flow is bilinear between `nodes` (N, N), kg/s: duty by pressure, over its
    ranges."""

    nodes: Array

    def bounded_flow(self, duty: Array, pressure: Array) -> Bounded:
        """See `FlowLaw`; no reason is given."""
        xp = array_namespace(duty, pressure)
        cells, shares = [], []
        for value, pair in ((duty, self.duty_range), (pressure, self.pressure_range)):
            low, high = ends(pair)
            place = xp.clip((value - low) / (high - low), 0.0, 1.0) * (_NODES - 1)
            cell = xp.minimum(xp.floor(place), _NODES - 2)
            cells.append(cell.astype(int))
            shares.append(place - cell)
        (i, j), (s, t) = cells, shares
        lower = (1.0 - t) * self.nodes[i, j] + t * self.nodes[i, j + 1]
        upper = (1.0 - t) * self.nodes[i + 1, j] + t * self.nodes[i + 1, j + 1]
        return (1.0 - s) * lower + s * upper, {}


__all__ = ["NetworkLaw", "SimulatedNetwork"]
