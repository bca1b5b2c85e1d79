"""The averaged law: a valve's on/off law over a PWM period, and its inverse in closed form.

A valve that is commanded on for `duty` times the period T opens its switch-on delay late and
closes its switch-off delay late, so that it is open for the share

    s(duty) = (duty T + off_delay - on_delay) / T,  0 at duty 0, within 0 and 1,

of the period. Over one period the chamber's pressure hardly moves, and its mean flow is

    flow(duty, P) = s(duty) fill(P) + (1 - s(duty)) exhaust(P)

with the filling and exhaust flow of the on/off law (thesis 3.6.6, 3.6.7, 3.6.10). At each
pressure that is a straight line in the share, hence

    duty(flow, P) = (flow - exhaust(P)) / (fill(P) - exhaust(P)) - (off_delay - on_delay) / T.

A shortest pulse opens the valve for off_delay - on_delay already, and a pause shorter than that
does not close it: shares between 0 and that one, and duties between 1 less it and 1, have no
counterpart. The inverse takes the nearer end of either gap.
"""

from __future__ import annotations

from dataclasses import dataclass

from sysid.io.channels import SIDES
from sysid.model import base
from sysid.model.base import Array, Parameters, array_namespace

# Keeps a quotient finite where filling and exhaust meet, which no real valve's do.
_TINY_FLOW = 1e-12


@dataclass(frozen=True)
class AveragedLaw:
    """One valve's averaged law: kg/s, kg/(s Pa^0.5), kg/(s Pa), Pa, s; floats or (lanes,).

    `fill` and `discharge` are the same law, each side of which `simulate` takes with its own
    sign, so that the law serves as a valve's surfaces there.
    """

    choked_fill: Array
    choked_dis: Array
    c_fill: Array
    c_dis: Array
    supply: Array
    supply_reference: Array
    atmosphere: Array
    on_delay: Array
    off_delay: Array
    period: Array

    @classmethod
    def of(cls, parameters: Parameters, side: str) -> AveragedLaw:
        """The law of valve "a" or "b" of a model's parameters. ValueError for another side."""
        if side not in SIDES:
            raise ValueError(f"side is {side!r}, not one of {', '.join(SIDES)}")
        valve = parameters.valve(side)
        return cls(
            choked_fill=valve.choked_fill,
            choked_dis=valve.choked_dis,
            c_fill=valve.c_fill,
            c_dis=valve.c_dis,
            supply=parameters.supply,
            supply_reference=parameters.supply_reference,
            atmosphere=parameters.atmosphere,
            on_delay=getattr(parameters, f"on_delay_{side}"),
            off_delay=getattr(parameters, f"off_delay_{side}"),
            period=parameters.pwm_period,
        )

    @property
    def _overhang(self) -> Array:
        return (self.off_delay - self.on_delay) / self.period

    def open_share(self, duty: Array) -> Array:
        """Share of the period in which the valve is open, 0 to 1, at a duty (0 to 1)."""
        xp = array_namespace(duty, self._overhang)
        share = xp.clip(duty + self._overhang, 0.0, 1.0)
        return xp.where(duty > 0.0, xp.where(duty < 1.0, share, 1.0), 0.0)

    def duty_of_share(self, share: Array) -> Array:
        """Duty, 0 to 1, whose open share is nearest; the inverse of `open_share`.

        The least duty above 0 stands for its limit: it is 1e-6, whose pulse opens the valve
        for the delays' difference.
        """
        xp = array_namespace(share, self._overhang)
        duty = share - self._overhang
        # Below the shortest pulse's share: none at all or the shortest, whichever is nearer.
        shortest = xp.maximum(self._overhang, 0.0)
        duty = xp.where(share < shortest, xp.where(share < 0.5 * shortest, 0.0, 1e-6), duty)
        # Above the share of the longest pause: without delays' difference there is no gap.
        longest = 1.0 + xp.minimum(self._overhang, 0.0)
        beyond = xp.where(share < 0.5 * (longest + 1.0), 1.0 - 1e-6, 1.0)
        duty = xp.clip(xp.where(share > longest, beyond, duty), 0.0, 1.0)
        return xp.where(share < 1.0, duty, 1.0)

    def open_flow(self, pressure: Array) -> Array:
        """Flow into the chamber while the valve is open, kg/s, at a pressure in Pa."""
        return base.filling_flow(
            pressure, self.supply, self.choked_fill, self.c_fill, self.supply_reference
        )

    def closed_flow(self, pressure: Array) -> Array:
        """Flow into the chamber (negative: out) while the valve is off, kg/s."""
        return base.exhaust_flow(pressure, self.atmosphere, self.choked_dis, self.c_dis)

    def flow(self, duty: Array, pressure: Array) -> Array:
        """Mean flow into the chamber, kg/s, at a duty (0 to 1) and pressure in Pa."""
        share = self.open_share(duty)
        return share * self.open_flow(pressure) + (1.0 - share) * self.closed_flow(pressure)

    fill = flow
    discharge = flow

    def duty(self, flow: Array, pressure: Array) -> Array:
        """Duty, 0 to 1, for a wanted mean flow in kg/s; beyond what the valve can pass: 0 or 1."""
        xp = array_namespace(flow, pressure)
        closed = self.closed_flow(pressure)
        span = xp.maximum(self.open_flow(pressure) - closed, _TINY_FLOW)
        return self.duty_of_share(xp.clip((flow - closed) / span, 0.0, 1.0))


__all__ = ["AveragedLaw"]
