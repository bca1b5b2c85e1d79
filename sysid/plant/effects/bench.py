"""Effects of a valve that show on a bench: partial opening, dead band, restriction, loop.

They act while a valve is between off and on, and do not change one that is fully on or off:
what they do there is part of the discrete law's constants. Flows are kg/s.
"""

from __future__ import annotations

from dataclasses import dataclass

from sysid.plant.base import LEAST_DIVISOR, Array, array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.ports import Point

DUTY_DIRECTION = "duty_direction_"
"""With the side appended, the key in `Point.extra` of where a duty came from: 1 if it rose
to its value, -1 if it fell, 0 if neither. Absent if it is not tracked."""


def _between(share: Array) -> Array:
    """Whether a passage is neither shut nor open all the time."""
    return (share > 0.0) & (share < 1.0)


def _of_full(flow: Array, full: Array) -> Array:
    """A flow over that of the fully open valve, 0 to 1; 1 where that flow is not known."""
    xp = array_namespace(flow, full)
    share = xp.minimum(xp.abs(flow) / xp.maximum(full, 1e-30), 1.0)
    return xp.where(share == share, share, 1.0)


def _line_factor(flow: Array, full: Array, log_ratio: Array) -> Array:
    """The factor on a flow where a line in series already limits the full flow.

    Restrictions in series add 1/C^2; `log_ratio` is the logarithm of the valve's own
    conductance over that of valve and line together.
    """
    x = _of_full(flow, full)
    xp = array_namespace(x, log_ratio)
    squared = xp.exp(2.0 * log_ratio)
    return xp.sqrt(squared / (1.0 + (squared - 1.0) * x * x))


_LOG_RATIO = Quantity(
    "log_conductance_ratio",
    "-",
    1.0,
    0.0,
    12.0,
    "e: logarithm of the valve's conductance over that of valve and line",
    grid=(0.3, 1.0, 2.0, 3.0),
)


@dataclass(frozen=True)
class PartialOpening(CatalogueEffect):
    """A pulse shorter than a time tau opens the valve only partly, before a line that limits.

    The poppet is still travelling when the pulse of length w ends: it passes (w / tau)^n of
    an open valve's flow. n is 0 for a poppet that opens at once, 1 for a steady travel; a
    force that grows with the square of a growing current gives about 4, and the pressure
    that holds a valve shut makes it steeper, so filling and exhaust each have their own n.
    Behind the valve a line limits the flow as in `series-restriction`: a valve that is open
    part of the time already supplies all that the line passes, and the loss of a short pulse
    shows only where the line does not hide it. Pulses follow from duty and PWM period.
    """

    filling_steepness: Array = 0.0
    exhaust_steepness: Array = 0.0
    log_conductance_ratio: Array = 0.0
    opening_time_s: Array = 3.5e-3

    id = "partial-opening"
    title = "Pulses too short to open a valve fully, before a line that limits the flow"
    subsystem = "valve"
    averaged_only = True
    quantities = (
        Quantity("filling_steepness", "-", 4.0, 0.0, 40.0, "n while the chamber fills"),
        Quantity("exhaust_steepness", "-", 4.0, 0.0, 40.0, "n while it empties"),
        _LOG_RATIO,
        Quantity(
            "opening_time_s",
            "s",
            3.5e-3,
            2e-4,
            5e-2,
            "length of the shortest pulse that opens the valve fully",
            is_strength=False,
            grid=(1.5e-3, 2.5e-3, 3.5e-3, 5e-3, 8e-3),
        ),
    )
    signature = "flow at small duties against the pulse length, whatever the period"
    rivals = ("valve-delay", "duty-dead-zone", "valve-dead-band", "series-restriction")
    tie_breaker = "sweep the duty at several PWM periods, down to pulses of 1 ms"
    source = (
        "textbook: ballistic operation of a solenoid valve (force grows with current squared); "
        "ISO 6358-3:2014 (conductances in series)"
    )

    def _passed(
        self, flow: Array, full: Array, share: Array, steepness: Array, point: Point
    ) -> Array:
        xp = array_namespace(flow, share, steepness, self.opening_time_s)
        pulse = xp.maximum(share, LEAST_DIVISOR) * point.parameters.pwm_period
        partly = flow * xp.minimum(pulse / self.opening_time_s, 1.0) ** steepness
        passed = partly * _line_factor(partly, full, self.log_conductance_ratio)
        return xp.where(_between(share), passed, flow)

    def filling_flow(self, flow: Array, side: str, point: Point) -> Array:
        full, share = point.parameters.valve(side).choked_fill, point.is_open(side)
        return self._passed(flow, full, share, self.filling_steepness, point)

    def exhaust_flow(self, flow: Array, side: str, point: Point) -> Array:
        full, share = point.parameters.valve(side).choked_dis, 1.0 - point.is_open(side)
        return self._passed(flow, full, share, self.exhaust_steepness, point)


@dataclass(frozen=True)
class ValveDeadBand(CatalogueEffect):
    """No flow below a duty d, and above it a flow that grows as ((u - d) / (1 - d))^(1 + c).

    It replaces a flow proportional to the duty u: the overlap of a spool or the
    preload of a spring, and a port that is not cut straight.
    """

    dead_duty: Array = 0.0
    curvature: Array = 0.0

    id = "valve-dead-band"
    title = "Dead band and curved opening of a valve"
    subsystem = "valve"
    averaged_only = True
    quantities = (
        Quantity(
            "dead_duty",
            "-",
            0.2,
            0.0,
            0.95,
            "duty below which nothing flows",
            grid=(0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5),
        ),
        Quantity("curvature", "-", 0.5, -0.9, 5.0, "c: 0 for a flow in proportion to u - d"),
    )
    signature = "flow against the duty, whatever the PWM period"
    rivals = ("partial-opening", "valve-delay", "duty-dead-zone")
    tie_breaker = "sweep the duty at two PWM periods: a dead time moves with the period"
    source = "textbook: overlap and flow characteristic of a proportional valve"

    def _factor(self, share: Array) -> Array:
        xp = array_namespace(share, self.dead_duty, self.curvature)
        share = xp.maximum(share, LEAST_DIVISOR)
        # A fit may try d beyond 1; it finds a valve that never opens.
        dead = xp.minimum(self.dead_duty, 1.0 - 1e-6)
        opening = (share - dead) / (1.0 - dead)
        curved = xp.maximum(opening, LEAST_DIVISOR) ** self.curvature
        factor = xp.where(opening > 0.0, opening * curved / share, 0.0)
        # Neutral to the last bit; division by the share would not be.
        moved = (self.dead_duty != 0.0) | (self.curvature != 0.0)
        return xp.where(_between(share) & moved, factor, 1.0)

    def filling_flow(self, flow: Array, side: str, point: Point) -> Array:
        return flow * self._factor(point.is_open(side))

    def exhaust_flow(self, flow: Array, side: str, point: Point) -> Array:
        return flow * self._factor(1.0 - point.is_open(side))


@dataclass(frozen=True)
class SeriesRestriction(CatalogueEffect):
    """A line in series with the valve limits the flow once the valve is open most of the time.

    Restrictions in series add 1/C^2. With e the logarithm of the valve's own conductance over
    that of valve and line together, and x the flow over that of the fully open valve, the
    flow grows by exp(e) / sqrt(1 + (exp(2 e) - 1) x^2): the full flow, which the line limits
    already, stays. A logarithm, since no sweep can say how much wider a very wide valve is.
    """

    log_conductance_ratio: Array = 0.0

    id = "series-restriction"
    title = "A line in series with a valve limits its flow"
    subsystem = "valve"
    averaged_only = True
    quantities = (_LOG_RATIO,)
    signature = "flow that levels off as the duty grows"
    rivals = ("valve-dead-band", "partial-opening")
    tie_breaker = "repeat the sweep with a short, wide line"
    source = "ISO 6358-3:2014 (conductances in series)"

    def _passed(self, flow: Array, full: Array, share: Array) -> Array:
        xp = array_namespace(flow, share, self.log_conductance_ratio)
        passed = flow * _line_factor(flow, full, self.log_conductance_ratio)
        return xp.where(_between(share), passed, flow)

    def filling_flow(self, flow: Array, side: str, point: Point) -> Array:
        full = point.parameters.valve(side).choked_fill
        return self._passed(flow, full, point.is_open(side))

    def exhaust_flow(self, flow: Array, side: str, point: Point) -> Array:
        full = point.parameters.valve(side).choked_dis
        return self._passed(flow, full, 1.0 - point.is_open(side))


@dataclass(frozen=True)
class ValveHysteresis(CatalogueEffect):
    """Flow depends on whether the duty rose or fell: a loop that closes at both ends of the duty.

    With x the flow over that of the fully open valve, it falls by h (1 - x) of itself where
    the duty rose to its value and grows by as much where it fell (h < 0: the other way).
    Nothing changes where the direction of the duty is not tracked.
    """

    loop_share: Array = 0.0

    id = "valve-hysteresis"
    title = "Flow that depends on whether the duty rose or fell"
    subsystem = "valve"
    averaged_only = True
    quantities = (
        Quantity(
            "loop_share", "-", 0.05, -1.0, 1.0, "h: half the loop's width, relative to a small flow"
        ),
    )
    signature = "flow on the way up against the way down"
    source = "textbook: friction and remanence of a proportional solenoid"

    def filling_flow(self, flow: Array, side: str, point: Point) -> Array:
        way = point.extra.get(DUTY_DIRECTION + side, 0.0)
        rest = 1.0 - _of_full(flow, point.parameters.valve(side).choked_fill)
        return flow * (1.0 - self.loop_share * way * rest)


EFFECTS: tuple[type[CatalogueEffect], ...] = (
    PartialOpening,
    ValveDeadBand,
    SeriesRestriction,
    ValveHysteresis,
)
