"""The averaged law: a valve's on/off law over a PWM period, and its inverse in closed form.

A valve that is commanded on for `duty` times the period T opens its switch-on delay late and
closes its switch-off delay late, so that it is open for the share

    s(duty) = (duty T + off_delay - on_delay) / T,  0 at duty 0, within 0 and 1,

of the period. Over one period the chamber's pressure hardly moves, and its mean flow is

    flow(duty, P) = s(duty) fill(P) + (1 - s(duty)) exhaust(P)

with the filling and exhaust flow of the on/off law (thesis 3.6.6, 3.6.7, 3.6.10, or ISO 6358).
At each pressure that is a straight line in the share, hence

    duty(flow, P) = (flow - exhaust(P)) / (fill(P) - exhaust(P)) - (off_delay - on_delay) / T.

A shortest pulse opens the valve for off_delay - on_delay already, and a pause shorter than that
does not close it: shares between 0 and that one, and duties between 1 less it and 1, have no
counterpart. The inverse takes the nearer end of either gap.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from sysid.plant import base, valve_laws
from sysid.plant.base import (
    LEAST_DIVISOR,
    VALVE_NAMES,
    Array,
    Parameters,
    ValveParameters,
    array_namespace,
)
from sysid.plant.iso6358 import ANR_TEMPERATURE

# The ripple follows from the flows, and these from the ripple: each step leaves a tenth of the
# error.
_RIPPLE_STEPS = 4
# Places and weights over 0 to 1.
_GAUSS = (
    (0.5 - math.sqrt(0.15), 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.5 + math.sqrt(0.15), 5.0 / 18.0),
)


class PulseFlows(NamedTuple):
    """Mean flows (kg/s) of the open and of the closed valve in one PWM period.

    `rise`, `fall`: the time, and the part of the ripple, after which the pressure's ramp bends
    at a choked boundary, each as a share of its own phase (0 to 1).
    """

    open: Array
    closed: Array
    rise: tuple[Array, Array]
    fall: tuple[Array, Array]

    def mean(self, share: Array) -> Array:
        """Mean flow over the period, kg/s, of a valve open for `share` of it."""
        return share * self.open + (1.0 - share) * self.closed

    def middle(self, share: Array) -> Array:
        """Mean pressure above the trough, as a part of the ripple: 1/2 where no ramp bends."""
        (up_time, up), (down_time, down) = self.rise, self.fall
        return 0.5 * (share * (up + 1.0 - up_time) + (1.0 - share) * (down_time + 1.0 - down))


@dataclass(frozen=True)
class AveragedLaw:
    """One valve's averaged law: kg/s, kg/(s Pa^0.5), kg/(s Pa), Pa, s; floats or (lanes,).

    A direction with a sonic conductance obeys ISO 6358, of air at `temperature` K; one with a
    coefficient of the valve's own has a flow control in series (`base.ValveParameters`).

    It serves as a valve's surfaces in `simulate`, which takes the flows of its `pulse`, so that
    effects on filling and on exhaust act on each.
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
    sonic_conductance_fill: Array | None = field(default=None, kw_only=True)
    critical_ratio_fill: Array | None = field(default=None, kw_only=True)
    subsonic_index_fill: Array | None = field(default=None, kw_only=True)
    sonic_conductance_dis: Array | None = field(default=None, kw_only=True)
    critical_ratio_dis: Array | None = field(default=None, kw_only=True)
    subsonic_index_dis: Array | None = field(default=None, kw_only=True)
    valve_c_fill: Array | None = field(default=None, kw_only=True)
    valve_c_dis: Array | None = field(default=None, kw_only=True)
    temperature: Array = field(default=ANR_TEMPERATURE, kw_only=True)

    @classmethod
    def of(cls, parameters: Parameters, side: str) -> AveragedLaw:
        """The law of valve "a" or "b" of a model's parameters. ValueError for another side."""
        valve = parameters.valve(side)
        return cls(
            **{name: getattr(valve, name) for name in VALVE_NAMES},
            temperature=parameters.temperature,
            supply=parameters.supply,
            supply_reference=parameters.supply_reference,
            atmosphere=parameters.atmosphere,
            on_delay=getattr(parameters, f"on_delay_{side}"),
            off_delay=getattr(parameters, f"off_delay_{side}"),
            period=parameters.pwm_period,
        )

    @cached_property
    def valve(self) -> ValveParameters:
        """The law of the valve while it is on, and while it is off."""
        return ValveParameters(**{name: getattr(self, name) for name in VALVE_NAMES})

    def _filling(self, pressure: Array, supply: Array) -> Array:
        return valve_laws.filling_flow(
            self.valve, pressure, supply, self.supply_reference, temperature=self.temperature
        )

    def _exhausting(self, pressure: Array, exhaust: Array) -> Array:
        return valve_laws.exhaust_flow(self.valve, pressure, exhaust, temperature=self.temperature)

    @property
    def _overhang(self) -> Array:
        return (self.off_delay - self.on_delay) / self.period

    def open_share(self, duty: Array) -> Array:
        """Share of the period in which the valve is open, 0 to 1, at a duty (0 to 1; NaN: NaN)."""
        xp = array_namespace(duty, self._overhang)
        share = xp.clip(duty + self._overhang, 0.0, 1.0)
        return xp.where(duty <= 0.0, 0.0, xp.where(duty >= 1.0, 1.0, share))

    def duty_of_share(self, share: Array) -> Array:
        """Duty, 0 to 1, whose open share is nearest; the inverse of `open_share`.

        The least duty above 0 stands for its limit: it is 1e-6, whose pulse opens the valve
        for the delays' difference. A share that is NaN has the duty NaN.
        """
        xp = array_namespace(share, self._overhang)
        duty = share - self._overhang
        # Below the shortest pulse's share: none at all or the shortest, whichever is nearer.
        shortest = xp.maximum(self._overhang, 0.0)
        duty = xp.where(share < shortest, xp.where(share < 0.5 * shortest, 0.0, 1e-6), duty)
        # Above the share of the longest pause: without a difference of the delays no gap exists.
        longest = 1.0 + xp.minimum(self._overhang, 0.0)
        beyond = xp.where(share < 0.5 * (longest + 1.0), 1.0 - 1e-6, 1.0)
        duty = xp.clip(xp.where(share > longest, beyond, duty), 0.0, 1.0)
        return xp.where(share >= 1.0, 1.0, duty)

    def open_flow(self, pressure: Array) -> Array:
        """Flow into the chamber while the valve is open, kg/s, at a pressure in Pa."""
        return self._filling(pressure, self.supply)

    def closed_flow(self, pressure: Array) -> Array:
        """Flow into the chamber (negative: out) while the valve is off, kg/s."""
        return self._exhausting(pressure, self.atmosphere)

    def flow(self, duty: Array, pressure: Array) -> Array:
        """Mean flow into the chamber, kg/s, at a duty (0 to 1) and pressure in Pa."""
        share = self.open_share(duty)
        return share * self.open_flow(pressure) + (1.0 - share) * self.closed_flow(pressure)

    def between(self, lines: tuple[Array, Array]) -> Callable[[Array, Array], Array]:
        """Flow, kg/s, by the share of a time that the valve is open in and the pressure then, Pa.

        `lines`: the supply's and the exhaust's pressure, Pa, which stay.
        """
        supply, exhaust = lines
        filling = valve_laws.filling_from(
            self.valve, supply, self.supply_reference, temperature=self.temperature
        )
        exhausting = valve_laws.exhaust_to(self.valve, exhaust, temperature=self.temperature)

        def flow(share: Array, pressure: Array) -> Array:
            return share * filling(pressure) + (1.0 - share) * exhausting(pressure)

        return flow

    fill = flow
    discharge = flow

    def pulse(
        self, share: Array, pressure: Array, lines: tuple[Array, Array], rates: tuple[Array, Array]
    ) -> PulseFlows:
        """A PWM period of a moving chamber that is at `pressure` (Pa) at the period's ends.

        `share` of the period that the valve is open; `lines`: the supply's and the exhaust's
        pressure in force, Pa; `rates`: k R T / V in Pa/kg, and what the piston's motion adds to
        the pressure in a period, Pa. The pressure rises while the valve is open and falls back
        while it is not. Without ripple (0 Pa/kg) the flows are `open_flow` and `closed_flow`.
        """
        per_flow, swept = rates
        found = self._at_once(share, pressure, lines)
        for _ in range(_RIPPLE_STEPS):
            drift = per_flow * self.period * found.mean(share) + swept
            ripple = _ripple(found, per_flow * self.period * share * (1.0 - share))
            found = self._over_ripple(_drifted(pressure, drift, share), ripple, lines)
        return found

    def mean_pulse(
        self,
        share: Array,
        pressure: Array,
        lines: tuple[Array, Array],
        per_flow: Array,
        sampled: tuple[Array, Array] = (0.0, 0.0),
    ) -> PulseFlows:
        """The same for a held chamber, by its mean `pressure` (Pa) over a period.

        `sampled`: what the few samples of a period make of its mean, of `sampled_period`. Without
        it the mean is of all moments, over periods that begin anywhere, as a moving mean's do: the
        pulse then comes neither early nor late, and the pressure's drift leaves the open and the
        closed valve's mean pressures where they are.
        """
        high, lead = sampled
        xp = array_namespace(share, pressure)
        # By how much the closed valve's part of the period lags.
        lag = lead * share / xp.maximum(1.0 - share, LEAST_DIVISOR)
        found = self._at_once(share, pressure, lines)
        pace = per_flow * self.period
        swing = pace * share * (1.0 - share)
        for _ in range(_RIPPLE_STEPS):
            drift, ripple = pace * found.mean(share), _ripple(found, swing)
            trough = pressure - ripple * (found.middle(share) + high)
            found = self._over_ripple((trough + lead * drift, trough - lag * drift), ripple, lines)
        return found

    def held_duty(
        self, flow: Array, pressure: Array, lines: tuple[Array, Array], per_flow: Array
    ) -> Array:
        """Duty, 0 to 1, for a mean flow (kg/s) at a held chamber's mean `pressure` (Pa).

        As `duty`, with the ripple of a chamber of that k R T / V (Pa/kg), which depends on the
        duty itself: found in a few steps from that without ripple.
        """
        xp = array_namespace(flow, pressure)
        found = self._at_once(0.0 * pressure, pressure, lines)
        share = 0.0 * flow
        for _ in range(6):
            span = xp.maximum(found.open - found.closed, LEAST_DIVISOR)
            share = xp.clip((flow - found.closed) / span, 0.0, 1.0)
            found = self.mean_pulse(share, pressure, lines, per_flow)
        return self.duty_of_share(share)

    def _at_once(self, share: Array, pressure: Array, lines: tuple[Array, Array]) -> PulseFlows:
        supply, exhaust = lines
        none = 0.0 * share
        return PulseFlows(
            self._filling(pressure, supply),
            self._exhausting(pressure, exhaust),
            (none, none),
            (none, none),
        )

    def _over_ripple(
        self, troughs: tuple[Array, Array], ripple: Array, lines: tuple[Array, Array]
    ) -> PulseFlows:
        """Flows over a ramp up from the first trough by `ripple`, and down to the second one.

        The part of a ramp that is not choked is taken at its middle.
        """
        (supply, exhaust), (up, down) = lines, troughs
        filling, rise = self._over_rise(up, ripple, supply)
        leaving, fall = self._over_fall(down, ripple, exhaust)
        return PulseFlows(filling, leaving, rise, fall)

    def _over_rise(
        self, up: Array, ripple: Array, supply: Array
    ) -> tuple[Array, tuple[Array, Array]]:
        """Mean filling flow, and where the ramp bends: in time, and in height."""
        xp = array_namespace(up, ripple)
        if valve_laws.obeys_iso(self.valve, "fill"):
            return _mean_over(lambda p: self._filling(p, supply), up, ripple)
        below = xp.clip((valve_laws.filling_boundary(self.valve, supply) - up) / ripple, 0.0, 1.0)
        filling, time = _over_boundary(
            below,
            self.choked_fill * (supply / self.supply_reference),
            base.unchoked_filling_flow(up + 0.5 * (1.0 + below) * ripple, supply, self.c_fill),
        )
        return filling, (time, below)

    def _over_fall(
        self, down: Array, ripple: Array, exhaust: Array
    ) -> tuple[Array, tuple[Array, Array]]:
        """The same of the exhaust."""
        xp = array_namespace(down, ripple)
        if valve_laws.obeys_iso(self.valve, "dis"):
            return _mean_over(lambda p: self._exhausting(p, exhaust), down, ripple)
        boundary = valve_laws.exhaust_boundary(self.valve, exhaust)
        above = xp.clip((down + ripple - boundary) / ripple, 0.0, 1.0)
        leaving, time = _over_boundary(
            above,
            -self.choked_dis,
            base.unchoked_exhaust_flow(down + 0.5 * (1.0 - above) * ripple, exhaust, self.c_dis),
        )
        return leaving, (time, above)

    def duty(self, flow: Array, pressure: Array) -> Array:
        """Duty, 0 to 1, for a wanted mean flow in kg/s; beyond what the valve can pass: 0 or 1."""
        xp = array_namespace(flow, pressure)
        closed = self.closed_flow(pressure)
        span = xp.maximum(self.open_flow(pressure) - closed, LEAST_DIVISOR)
        return self.duty_of_share(xp.clip((flow - closed) / span, 0.0, 1.0))


def _ripple(flows: PulseFlows, swing: Array) -> Array:
    """Peak to peak, Pa; `swing`: that of a difference of 1 kg/s between the two flows."""
    # Pa: a smaller ripple is neglected.
    return array_namespace(swing).maximum(swing * (flows.open - flows.closed), 1e-6)


def _drifted(trough: Array, drift: Array, share: Array) -> tuple[Array, Array]:
    """Where the open and the closed part of a period begin and end, Pa, as the pressure drifts.

    The open part comes first: the pressure has drifted less by then.
    """
    return trough - 0.5 * (1.0 - share) * drift, trough + 0.5 * share * drift


def sampled_period(share: Array, centre: Array, phases: int) -> tuple[Array, Array]:
    """What a moving mean of samples at `phases` even places of a period makes of its ripple.

    `share` of the period that the valve is open, about `centre` of the period, both 0 to 1; the
    first sample is at 0. Returned: by what part of the ripple the samples' mean lies above the
    mean of the two ramps, and how much later than the middle of a mean's own period the open part
    is, as a share of the period; both are 0 for many phases.
    """
    xp = array_namespace(share, centre)
    opened, shut = xp.maximum(share, LEAST_DIVISOR), xp.maximum(1.0 - share, LEAST_DIVISOR)
    high: Array = 0.0 * share
    lead: Array = 0.0 * share
    for k in range(phases):
        since = (k / phases - centre + 0.5 * share) % 1.0
        rising = since < share
        high = high + xp.where(rising, since / opened, (1.0 - since) / shut) - 0.5
        late = (1.0 - share) * (since - 0.5 * share) / opened
        lead = lead + xp.where(rising, late, 0.5 * (1.0 + share) - since)
    return high / phases, lead / phases


def _mean_over(
    flow: Callable[[Array], Array], trough: Array, ripple: Array
) -> tuple[Array, tuple[Array, Array]]:
    """Mean in time of a smooth law's flow over a ramp by `ripple` from a trough; no bend in it.

    The harmonic mean in pressure, at three points (Gauss).
    """
    xp = array_namespace(trough, ripple)
    total: Array = 0.0
    # A flow of nothing takes forever: next to it the ramp's other points count.
    for place, weight in _GAUSS:
        at = flow(trough + place * ripple)
        away = xp.where(xp.abs(at) > LEAST_DIVISOR, at, LEAST_DIVISOR)
        total = total + weight / away
    none = 0.0 * trough
    return 1.0 / total, (none, none)


def _over_boundary(part: Array, choked: Array, free: Array) -> tuple[Array, Array]:
    """Mean flow of a ramp whose `part` (0 to 1) of the range is choked, and that part in time.

    The ramp is the steeper the larger the flow: the mean in time is the harmonic one in pressure.
    """
    xp = array_namespace(part, choked)
    own = part * free
    weighted = own + (1.0 - part) * choked
    weighted = xp.where(weighted == 0.0, 1.0, weighted)
    return choked * free / weighted, own / weighted


__all__ = ["AveragedLaw", "PulseFlows", "sampled_period"]
