"""Effects of the valves: flow law and timing.

Flows are kg/s, positive into the chamber.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.plant.base import LEAST_DIVISOR, Array, array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity, of_side
from sysid.plant.ports import Point
from sysid.plant.valve_laws import exhaust_boundary, obeys_iso
from sysid.plant.valve_timing import TIME_TOLERANCE


def iso6358_share(ratio: Array, critical_ratio: Array, exponent: Array) -> Array:
    """Flow over choked flow by ISO 6358-1:2013, 0 to 1; `ratio` is downstream over upstream.

    1 up to the critical ratio b, then (1 - ((ratio - b) / (1 - b))^2)^exponent.
    """
    xp = array_namespace(ratio, critical_ratio, exponent)
    beyond = xp.maximum((ratio - critical_ratio) / (1.0 - critical_ratio), 0.0)
    return xp.maximum(1.0 - beyond * beyond, 0.0) ** exponent


@dataclass(frozen=True)
class SubsonicFlowShape(CatalogueEffect):
    """Flow follows ISO 6358's ellipse instead of the thesis' unchoked laws.

    A blend (0: the base law, 1: ISO's), separate for filling and exhaust. ISO's law takes
    the base law's choked flow as its own, at the nominal supply and atmosphere. Flow that
    runs backwards keeps the base law. An averaged flow is blended with ISO's for the share
    of the time that the valve is open.
    """

    filling_blend: Array = 0.0
    exhaust_blend: Array = 0.0
    critical_ratio: Array = 0.3
    subsonic_exponent: Array = 0.5

    id = "subsonic-flow-shape"
    title = "Shape of the subsonic flow (ISO 6358)"
    subsystem = "valve"
    quantities = (
        Quantity("filling_blend", "-", 1.0, 0.0, 1.5, "share of ISO's law in filling"),
        Quantity("exhaust_blend", "-", 1.0, 0.0, 1.5, "share of ISO's law in exhaust"),
        Quantity(
            "critical_ratio",
            "-",
            0.3,
            0.05,
            0.6,
            "downstream over upstream pressure below which flow is choked",
            is_strength=False,
            grid=(0.2, 0.3, 0.4, 0.5),
        ),
        Quantity(
            "subsonic_exponent",
            "-",
            0.5,
            0.3,
            1.0,
            "exponent of the ellipse",
            is_strength=False,
            grid=(0.4, 0.5, 0.6),
        ),
    )
    signature = "flow against P/Ps while filling, P0/P in exhaust"
    rivals = ("choked-exhaust-scaling", "supply-droop", "atmosphere-leakage")
    tie_breaker = "repeat the valve tests at a second supply pressure"
    source = "ISO 6358-1:2013"

    def _share(self, ratio: Array) -> Array:
        return iso6358_share(ratio, self.critical_ratio, self.subsonic_exponent)

    def filling_flow(self, flow: Array, side: str, point: Point) -> Array:
        p, pressure = point.parameters, point.pressure(side)
        if obeys_iso(p.valve(side), "fill"):
            return flow  # which is ISO's own
        choked = p.valve(side).choked_fill * (p.supply / p.supply_reference)
        law = point.is_open(side) * choked * self._share(pressure / p.supply)
        return _blended(flow, law, self.filling_blend, pressure < p.supply)

    def exhaust_flow(self, flow: Array, side: str, point: Point) -> Array:
        p, pressure = point.parameters, point.pressure(side)
        if obeys_iso(p.valve(side), "dis"):
            return flow  # which is ISO's own
        xp = array_namespace(pressure, p.atmosphere)
        # Below the atmosphere the base law holds; the ratio has only to be finite there.
        ratio = p.atmosphere / xp.maximum(pressure, p.atmosphere)
        law = -point.vents(side) * p.valve(side).choked_dis * self._share(ratio)
        return _blended(flow, law, self.exhaust_blend, pressure > p.atmosphere)


def _blended(flow: Array, law: Array, blend: Array, forward: Array) -> Array:
    """flow, or where `forward` and the law is known (not NaN), blended with it."""
    xp = array_namespace(flow, law, blend, forward)
    return flow + blend * xp.where(forward & (law == law), law - flow, 0.0)


@dataclass(frozen=True)
class ChokedExhaustScaling(CatalogueEffect):
    """Choked exhaust grows with the chamber's pressure instead of being constant.

    Above the boundary P0/0.53 the flow is that of the base law times 1 + d (P/(P0/0.53) - 1);
    at d = 1 it is proportional to P. Anchored at the boundary, where the fitted constant
    holds: the law gets no new jump there.
    """

    exhaust_scaling: Array = 0.0

    id = "choked-exhaust-scaling"
    title = "Choked exhaust that grows with pressure"
    subsystem = "valve"
    quantities = (
        Quantity(
            "exhaust_scaling",
            "-",
            0.75,
            0.0,
            1.5,
            "relative growth of the flow per relative rise above the choked boundary",
        ),
    )
    signature = "exhaust flow above 1.9 times the atmosphere (189 kPa)"
    rivals = ("subsonic-flow-shape", "supply-droop", "atmosphere-leakage")
    tie_breaker = "discharge from a second, higher supply pressure"
    source = "ISO 6358-1:2013 (choked flow is proportional to the upstream pressure)"

    def exhaust_flow(self, flow: Array, side: str, point: Point) -> Array:
        valve = point.parameters.valve(side)
        if obeys_iso(valve, "dis"):
            return flow  # which grows by itself
        boundary = exhaust_boundary(valve, point.parameters.atmosphere)
        xp = array_namespace(point.pressure(side), boundary)
        excess = xp.maximum(point.pressure(side) / boundary - 1.0, 0.0)
        return flow * (1.0 + self.exhaust_scaling * excess)


@dataclass(frozen=True)
class ValveDelay(CatalogueEffect):
    """A valve opens and closes later than declared (negative: earlier)."""

    on_delay_s: Array = 0.0
    off_delay_s: Array = 0.0
    side: str = "both"

    id = "valve-delay"
    title = "Valve delays differ from their declared values"
    subsystem = "valve"
    quantities = (
        Quantity("on_delay_s", "s", 5e-4, -1.5e-3, 1e-2, "added to the delay of opening"),
        Quantity("off_delay_s", "s", 5e-4, -1.5e-3, 1e-2, "added to the delay of closing"),
    )
    signature = "mass of air that every edge adds or removes"
    rivals = ("time-skew", "exhaust-back-pressure", "pressure-lag")
    tie_breaker = "sweep the PWM frequency"
    source = "thesis 3.7"

    def delays(self, delays: Array, times: Array, opening: bool, side: str) -> Array:
        if not of_side(side, self.side):
            return delays
        return delays + (self.on_delay_s if opening else self.off_delay_s)


def partly_lost(length: Array, dead_time: Array, whole_ratio: Array) -> Array:
    """Delay, s, of a valve that obeys a command of some length only partly.

    A command as long as the dead time is lost, one `whole_ratio` times as long is not; in
    between the response grows linearly. `length` and `dead_time` in s.
    """
    xp = array_namespace(length, dead_time, whole_ratio)
    short_of = (whole_ratio * dead_time - length) / xp.maximum(whole_ratio - 1.0, LEAST_DIVISOR)
    lost = xp.minimum(xp.maximum(short_of, 0.0), dead_time)
    return xp.where(whole_ratio > 1.0, lost, 0.0)


@dataclass(frozen=True)
class DutyDeadZone(CatalogueEffect):
    """Pulses shorter than d vanish, and so do the pauses between pulses.

    A valve follows a command only if the command lasts for d; to close, for `pause_ratio` times d
    (0: it closes in any pause). A valve that opens (or closes) only partly under one that lasts
    little longer obeys all of it from `whole_ratio` times d on: in between it passes what it would
    if it were open for (length - d) / (1 - 1 / ratio). At a ratio of 1 there is nothing in between.
    """

    dead_time_s: Array = 0.0
    side: str = "both"
    whole_ratio: Array = 1.0
    pause_ratio: Array = 1.0

    id = "duty-dead-zone"
    title = "Dead zone of the duty"
    subsystem = "valve"
    quantities = (
        Quantity(
            "dead_time_s",
            "s",
            9e-4,
            0.0,
            2.5e-3,
            "pulses and pauses below this length vanish",
            grid=(4e-4, 7e-4, 1e-3, 1.4e-3),
        ),
        Quantity(
            "whole_ratio",
            "-",
            1.0,
            1.0,
            4.0,
            "shortest pulse that opens the valve fully over the dead time; 1: no partial opening",
            caption="shortest pulse that opens the valve fully over the dead time",
            forms=((1.0, "no partial opening"),),
            is_strength=False,
            grid=(1.0, 1.8),
            absent=1.0,
        ),
        Quantity(
            "pause_ratio",
            "-",
            1.0,
            0.0,
            2.0,
            "dead time of pauses over that of pulses; 0: no pause vanishes",
            caption="dead time of pauses over that of pulses",
            forms=((0.0, "no pause vanishes"),),
            is_strength=False,
            grid=(0.0, 1.0),
            absent=1.0,
        ),
    )
    signature = "flow at duties below 0.1 and above 0.8"
    source = "thesis 3.7"

    def pulses(self, on: Array, off: Array, side: str) -> tuple[Array, Array]:
        if not of_side(side, self.side) or len(on) == 0:
            return on, off
        edges = np.column_stack((on, off)).ravel()
        # Segment 0 is the pause before the first edge, 1 the first pulse, and so on.
        segment = np.arange(len(edges) + 1)
        dead = self._dead(segment[1:-1] % 2 == 1)
        within = np.diff(edges) >= dead - TIME_TOLERANCE
        lasts = np.concatenate(([True], within, [True]))
        obeyed = np.maximum.accumulate(np.where(lasts, segment, 0))
        state = obeyed % 2
        moves = state[1:] != state[:-1]
        kept, rises = edges[moves], state[1:][moves] == 1
        kept[:-1] += self._lost(np.diff(kept), rises[:-1])
        return kept[rises], kept[~rises]

    def _dead(self, is_pulse: Array) -> Array:
        """Dead time of pulses, and of the pauses between them, s."""
        xp = array_namespace(is_pulse, self.dead_time_s)
        return xp.where(is_pulse, self.dead_time_s, self.pause_ratio * self.dead_time_s)

    def recent_pulses(self, on: Array, off: Array, until: Array, side: str) -> tuple[Array, Array]:
        """See `Effect`; a pause up to `until` counts as one that a pulse ends."""
        if not of_side(side, self.side):
            return on, off
        xp = array_namespace(on, self.dead_time_s)
        pulse, pause = self._dead(True), self._dead(False)
        follows = [until]
        for i in range(len(on) - 1):
            follows.append(xp.where(on[i] > -xp.inf, on[i], follows[i]))
        start, holding = xp.full_like(on[0], -xp.inf), on[0] != on[0]
        rows: list[tuple[Array, Array]] = []
        for i in reversed(range(len(on))):
            real = on[i] > -xp.inf
            obeyed = real & (off[i] >= on[i] + pulse - TIME_TOLERANCE)
            start = xp.where(obeyed & ~holding, on[i], start)
            holding = holding | obeyed
            ends = real & holding & (follows[i] >= off[i] + pause - TIME_TOLERANCE)
            rows.insert(0, (xp.where(ends, start, -xp.inf), xp.where(ends, off[i], -xp.inf)))
            holding = holding & ~ends
        # Still on: whether it closes is decided by the next pulse.
        rows[0] = xp.where(holding, start, rows[0][0]), xp.where(holding, xp.inf, rows[0][1])
        rows = self._partly_opened(rows, until)
        return xp.stack([row[0] for row in rows]), xp.stack([row[1] for row in rows])

    def _partly_opened(
        self, rows: list[tuple[Array, Array]], until: Array
    ) -> list[tuple[Array, Array]]:
        """Intervals, newest first, each edge as late as the valve follows it."""
        xp = array_namespace(until, self.dead_time_s)
        found = []
        for start, end in rows:
            real = start > -xp.inf
            begun, ended = xp.where(real, start, 0.0), xp.where(real, end, 0.0)
            opens = start + xp.where(real, self._lost(ended - begun, True), 0.0)
            # One that has not ended yet ends at infinity, whatever is added.
            closes = end + xp.where(real, self._lost(until - ended, False), 0.0)
            found.append((opens, closes))
            until = xp.where(real, start, until)
        return found

    def _lost(self, length: Array, is_pulse: Array) -> Array:
        """Loss, s, of a pulse or a pause of some length whose valve moves only partly."""
        return partly_lost(length, self._dead(is_pulse), self.whole_ratio)


@dataclass(frozen=True)
class CoilHeating(CatalogueEffect):
    """A valve's delays drift as its coil warms up: d (1 - exp(-t / tau))."""

    on_delay_drift_s: Array = 0.0
    off_delay_drift_s: Array = 0.0
    heating_time_s: Array = 20.0
    side: str = "both"

    id = "coil-heating"
    title = "Valve delays that drift as the coil warms up"
    subsystem = "valve"
    quantities = (
        Quantity("on_delay_drift_s", "s", 5e-4, -1.5e-3, 5e-3, "final change of the opening delay"),
        Quantity(
            "off_delay_drift_s", "s", 5e-4, -1.5e-3, 5e-3, "final change of the closing delay"
        ),
        Quantity(
            "heating_time_s",
            "s",
            20.0,
            5.0,  # a coil's copper and iron take longer
            300.0,
            "time constant of the warming",
            is_strength=False,
            grid=(10.0, 20.0, 40.0),
        ),
    )
    signature = "drift of the switching times over a test"
    rivals = ("temperature-drift", "valve-delay")
    tie_breaker = "repeat a test with the coil warm"
    source = "textbook: first-order warming of a coil, whose resistance rises with temperature"

    def delays(self, delays: Array, times: Array, opening: bool, side: str) -> Array:
        if not of_side(side, self.side):
            return delays
        # A valve that was on before the test has an edge at minus infinity.
        xp = array_namespace(times, self.heating_time_s)
        warmed = -xp.expm1(-xp.maximum(times, 0.0) / self.heating_time_s)
        return delays + (self.on_delay_drift_s if opening else self.off_delay_drift_s) * warmed


@dataclass(frozen=True)
class StickingValve(CatalogueEffect):
    """A valve that has rested opens late: its delay grows with the rest, d t / (t + tau).

    t is the time since its last command to close; before the first one of a test it has rested for
    long. A stretch that is simulated by itself (a segment of the refinement) counts as a test, so
    that its first pulse is late. A pulse that ends before the valve comes loose does not open it.
    Pulses follow a rest of milliseconds under PWM, of seconds in a test of single pulses.
    """

    stuck_delay_s: Array = 0.0
    sticking_time_s: Array = 0.1
    side: str = "both"

    id = "sticking-valve"
    title = "Valve that sticks after a rest"
    subsystem = "valve"
    quantities = (
        Quantity("stuck_delay_s", "s", 2e-3, 0.0, 2e-2, "added to the opening delay, long rested"),
        Quantity(
            "sticking_time_s",
            "s",
            0.1,
            1e-3,
            60.0,
            "rest after which half of it is added",
            is_strength=False,
            grid=(0.01, 0.03, 0.1, 0.3, 1.0),
        ),
    )
    signature = "mass of air missing from pulses after a pause, less under PWM"
    rivals = ("valve-delay", "duty-dead-zone", "coil-heating")
    tie_breaker = "equal pulses after pauses of several lengths"
    source = (
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994: static friction that "
        "rises with the time at rest, here that of the valve's seals"
    )

    def _later(self, on: Array, last_off: Array) -> Array:
        """Starts of pulses, s, as late as the rest since `last_off` makes them."""
        xp = array_namespace(on, self.stuck_delay_s)
        real = on > -xp.inf
        rest = xp.where(real, on, 0.0) - xp.where(real, last_off, 0.0)
        rested = 1.0 - self.sticking_time_s / (xp.maximum(rest, 0.0) + self.sticking_time_s)
        return on + xp.where(real, self.stuck_delay_s * rested, 0.0)

    def pulses(self, on: Array, off: Array, side: str) -> tuple[Array, Array]:
        if not of_side(side, self.side) or len(on) == 0:
            return on, off
        # One that starts after its end, once delayed, cancels there.
        return self._later(on, np.concatenate(([-np.inf], off[:-1]))), off

    def recent_pulses(self, on: Array, off: Array, until: Array, side: str) -> tuple[Array, Array]:
        """See `Effect`; a valve without a pulse among these has rested for long.

        With a dead zone, which forgets pulses, that may be too long.
        """
        if not of_side(side, self.side):
            return on, off
        xp = array_namespace(on, self.stuck_delay_s)
        last = [xp.full_like(off[0], -xp.inf)]
        for ended in off[:0:-1]:
            last.insert(0, xp.maximum(last[0], ended))
        return self._later(on, xp.stack(last)), off


EFFECTS: tuple[type[CatalogueEffect], ...] = (
    SubsonicFlowShape,
    ChokedExhaustScaling,
    ValveDelay,
    DutyDeadZone,
    CoilHeating,
    StickingValve,
)
