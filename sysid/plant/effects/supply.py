"""Effects of the air supply and of the exhaust line.

Droop and back pressure close a loop: the flow lowers the pressure difference that drives it.
The loop of a chamber with its own flow is solved in closed form, by the thesis' law, or in a few
steps by that of ISO 6358. A flow is choked where it would be at the pressure that choked flow
leaves: so it is one or the other, never both or neither. Where the thesis' law jumps, and the
lesser flow leaves a pressure at which it would choke, the pressure is that of the jump. Flows are
kg/s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from sysid.io.channels import SIDES
from sysid.plant import base, valve_laws
from sysid.plant.base import Array, array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity, bent, state_lag
from sysid.plant.iso6358 import ANR_TEMPERATURE, choked_flow
from sysid.plant.ports import Point

# Below it strokes are those to first order: a sine at 0, which has a slope there.
_LEAST_STROKE = 1e-6
# A resistance that grows with the flow is given at this one, kg/s.
REFERENCE_FLOW_KG_PER_S = 3.5e-4
# By this factor the flow of a valve at its choked boundary is beyond it.
_BEYOND = 1.0 + 1e-9
# ISO 6358's flow over the root of its pressure difference changes little with the flow itself: each
# step leaves about a tenth of the error.
_ROOT_STEPS = 5


def drooped_filling_flow(
    pressure: Array,
    supply: Array,
    valve: base.ValveParameters,
    supply_reference: Array,
    droop: Array,
    temperature: Array = ANR_TEMPERATURE,
) -> Array:
    """Filling flow f >= 0 by the valve's law at the supply pressure Ps - droop f, kg/s.

    Choked: f = m (Ps - droop f) / Pref. Unchoked: f^2 = c^2 (Ps - droop f - P). Pressures in
    Pa, `droop` in Pa s/kg, `temperature` in K. No flow above the supply, nor where the law is not
    known (NaN).
    """
    xp = array_namespace(pressure, supply, valve.choked_fill, droop)
    if valve_laws.obeys_iso(valve, "fill"):
        return _drooped_iso(pressure, supply, valve, droop, temperature)
    loss = droop * valve.c_fill
    gap = xp.maximum(supply - pressure, 0.0)
    unchoked = 0.5 * valve.c_fill * (xp.sqrt(loss * loss + 4.0 * gap) - loss)
    choked = valve.choked_fill * supply / (supply_reference + droop * valve.choked_fill)
    boundary = valve_laws.filling_boundary(valve, supply - droop * choked)
    flow = xp.where(pressure <= boundary, choked, unchoked)
    return xp.where((flow > 0.0) & (choked == choked), flow, 0.0)


def _drooped_iso(
    pressure: Array,
    supply: Array,
    valve: base.ValveParameters,
    droop: Array,
    temperature: Array,
) -> Array:
    """`drooped_filling_flow` by ISO 6358: f^2 = c^2 (Ps - droop f - P), c taken where f has got."""
    xp = array_namespace(pressure, supply, droop)
    per_pressure = choked_flow(1.0, valve_laws.iso_numbers(valve, "fill")[0], temperature)
    choked = per_pressure * supply / (1.0 + droop * per_pressure)
    flow, gap = choked, xp.maximum(supply - pressure, 0.0)
    for _ in range(_ROOT_STEPS):
        left = xp.maximum(supply - droop * flow, pressure)
        root = valve_laws.root_coefficient(valve, "fill", left, pressure, temperature)
        loss = droop * root
        flow = 0.5 * root * (xp.sqrt(loss * loss + 4.0 * gap) - loss)
    boundary = valve_laws.filling_boundary(valve, supply - droop * choked)
    flow = xp.where(pressure <= boundary, choked, flow)
    return xp.where((flow > 0.0) & (choked == choked), flow, 0.0)


def _backed_iso(
    pressure: Array,
    atmosphere: Array,
    valve: base.ValveParameters,
    losses: tuple[Array, Array],
    temperature: Array,
) -> Array:
    """`backed_exhaust_flow` by ISO 6358; `losses` are its resistance and curvature."""
    resistance, curvature = losses
    xp = array_namespace(pressure, atmosphere, resistance, curvature)
    choked = choked_flow(pressure, valve_laws.iso_numbers(valve, "dis")[0], temperature)
    flow, gap = choked, xp.maximum(pressure - atmosphere, 0.0)
    for _ in range(_ROOT_STEPS):
        back = xp.minimum(atmosphere + (resistance + curvature * flow) * flow, pressure)
        root = valve_laws.root_coefficient(valve, "dis", back, pressure, temperature)
        square = root * root
        slope = square * resistance
        bent = 4.0 * (1.0 + square * curvature) * square * gap
        flow = 2.0 * square * gap / (slope + xp.sqrt(slope * slope + bent) + base.LEAST_DIVISOR)
    back = atmosphere + (resistance + curvature * choked) * choked
    flow = xp.where(pressure >= valve_laws.exhaust_boundary(valve, back), choked, flow)
    return xp.where(flow > 0.0, flow, 0.0)


def backed_exhaust_flow(
    pressure: Array,
    atmosphere: Array,
    valve: base.ValveParameters,
    resistance: Array,
    curvature: Array = 0.0,
    temperature: Array = ANR_TEMPERATURE,
    other_flow: Array = 0.0,
) -> Array:
    """Flow f out of a chamber by the valve's law against P0 + r f + q f^2, kg/s.

    Unchoked, by 3.6.10: f = c (P - P0 - r f - q f^2). Pressures in Pa, `resistance` r in Pa s/kg,
    `curvature` q in Pa s2/kg2, `temperature` in K. By 3.6.10 air enters a chamber below P0, as much
    of it at most as the other chamber's flow through the same resistance (`other_flow`, whose rise
    is part of P0). No flow where the law is not known (NaN). Where the law jumps, and neither of
    its flows goes with the rise that it causes, the flow is the one whose rise is at the boundary.
    """
    if valve_laws.obeys_iso(valve, "dis"):
        losses = resistance, curvature
        return _backed_iso(pressure, atmosphere, valve, losses, temperature)
    xp = array_namespace(pressure, atmosphere, valve.choked_dis, resistance, curvature)
    free = valve.c_dis * (pressure - atmosphere)
    slowed = 1.0 + resistance * valve.c_dis
    if base.is_zero(curvature):
        unchoked = free / slowed
    else:
        bent = xp.maximum(slowed * slowed + 4.0 * (curvature * valve.c_dis) * free, 0.0)
        unchoked = 2.0 * free / (slowed + xp.sqrt(bent))
    back = atmosphere + (resistance + curvature * valve.choked_dis) * valve.choked_dis
    boundary = valve_laws.exhaust_boundary(valve, back)
    # Just beyond the boundary, so that the valve is not choked there.
    at_boundary = _BEYOND * _flow_of(
        pressure * (back / boundary) - atmosphere, resistance, curvature
    )
    flow = xp.where(pressure >= boundary, valve.choked_dis, xp.maximum(unchoked, at_boundary))
    flow = xp.maximum(flow, -other_flow)
    # Any other number that is not known makes the unchoked flow unknown, too.
    return xp.where((flow == flow) & (valve.choked_dis == valve.choked_dis), flow, 0.0)


def _flow_of(rise: Array, resistance: Array, curvature: Array) -> Array:
    """Flow f with r f + q f^2 = `rise`, kg/s; with r f of it for a rise below 0."""
    xp = array_namespace(rise, resistance, curvature)
    bent = resistance * resistance + 4.0 * curvature * xp.maximum(rise, 0.0)
    # Its root has a slope where there is no resistance, too; one below 0, by which a search probes,
    # may cancel it.
    summed = resistance + xp.sqrt(bent + base.LEAST_DIVISOR)
    return 2.0 * rise / xp.maximum(summed, base.LEAST_DIVISOR)


def _adapted(
    flow: Callable[[str, Array], Array],
    side: str,
    common_share: Array,
    acts: Callable[[str], Array],
) -> Array:
    """A side's own flow and its share of the other's, each solved given the other, in turn.

    `flow` gives a side's flow for a given flow of the other; `acts` the share of the time in which
    a side's flow acts.
    """
    if base.is_zero(common_share):
        return flow(side, 0.0)
    other = SIDES[1 - SIDES.index(side)]
    share = common_share * acts(other)
    own: Array = 0.0
    other_flow: Array = 0.0
    # Of a turbulent silencer's 50 kPa two leave 440 Pa in one state of ten, three 30 Pa.
    for _ in range(3):
        other_flow = share * flow(other, own)
        own = flow(side, other_flow)
    return own + other_flow


@dataclass(frozen=True)
class SupplyDroop(CatalogueEffect):
    """The supply pressure droops with the flow of both chambers: Ps - d (flow A + flow B).

    At a common share of 1; at 0 each valve has a line of its own. Each chamber's flow is
    solved with its own droop and with the other's flow, in turn, three times; the other counts for
    the share of the time that its valve is open. Behind a resistance the line may have a
    volume: what passes the resistance then follows the flow with a time constant, dx/dt =
    (flow - x) / T, T = max(tau, 1 ms), and the loss is d (flow + (tau/T) (x - flow)). Surfaces of
    mean flow have no supply pressure, and so no droop; the averaged law has one.
    """

    droop_pa_s_per_kg: Array = 0.0
    common_share: Array = 1.0
    line_time_s: Array = 0.0

    id = "supply-droop"
    title = "Supply pressure that droops with flow"
    subsystem = "supply"
    quantities = (
        Quantity(
            "droop_pa_s_per_kg",
            "Pa s/kg",
            10e3 / 7.8e-4,
            0.0,
            2e8,
            "loss of supply pressure per flow into both chambers",
        ),
        Quantity(
            "common_share",
            "-",
            1.0,
            0.0,
            1.0,
            "share of the other chamber's flow: 0 separate lines, 1 a common line",
            is_strength=False,
            grid=(0.0, 0.5, 1.0),
        ),
        Quantity(
            "line_time_s",
            "s",
            0.0,
            0.0,
            0.2,
            "time constant of the line's volume behind its resistance",
            is_strength=False,
            grid=(0.0, 0.02),
            absent=0.0,
        ),
    )
    signature = "onset of filling; flow into A while B fills"
    rivals = ("subsonic-flow-shape", "atmosphere-leakage", "choked-exhaust-scaling")
    tie_breaker = "log the supply pressure"
    source = (
        "textbook: source with an internal resistance, and a volume behind it; base law of thesis "
        "3.6.6"
    )
    states = ("line_flow_a", "line_flow_b")

    def __post_init__(self) -> None:
        # Without a volume there is no state: controllers and exports take the law as it is.
        if base.is_zero(self.line_time_s):
            object.__setattr__(self, "states", ())

    def settled(self) -> SupplyDroop:
        return replace(self, line_time_s=0.0)

    def supply_pressure(self, pressure: Array, side: str, point: Point) -> Array:
        flow = _adapted(
            lambda s, other_flow: self._flow(s, pressure, other_flow, point),
            side,
            self.common_share,
            point.is_open,
        )
        passing = point.extra.get(f"line_flow_{side}")
        if passing is not None:
            flow = flow + self.line_time_s / state_lag(self.line_time_s) * (passing - flow)
        return pressure - self.droop_pa_s_per_kg * flow

    def initial_states(self, point: Point) -> dict[str, Array]:
        return dict.fromkeys(self.states, 0.0 * point.position)

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        if "line_flow_a" not in point.extra:  # traced, the time constant is no known 0
            return {}
        taken = {side: self._taken(side, point) for side in SIDES}
        rates = {}
        for side, other in (SIDES, SIDES[::-1]):
            flow = taken[side] + self.common_share * taken[other]
            passing = point.extra[f"line_flow_{side}"]
            rates[f"line_flow_{side}"] = (flow - passing) / state_lag(self.line_time_s)
        return rates

    def _taken(self, side: str, point: Point) -> Array:
        """Flow out of a valve's line by the base law, kg/s; 0 where that is not known (NaN)."""
        p = point.parameters
        valve = p.valve(side)
        supply = p.supply - self.droop_pa_s_per_kg * point.extra[f"line_flow_{side}"]
        flow = point.is_open(side) * valve_laws.filling_flow(
            valve, point.pressure(side), supply, p.supply_reference, temperature=p.temperature
        )
        return array_namespace(flow).where(flow == flow, flow, 0.0)

    def _flow(self, side: str, supply: Array, other_flow: Array, point: Point) -> Array:
        p, droop = point.parameters, self.droop_pa_s_per_kg
        left = supply - droop * other_flow
        return drooped_filling_flow(
            point.pressure(side), left, p.valve(side), p.supply_reference, droop, p.temperature
        )


def times_the_usual_flow(parameters: base.Parameters) -> float:
    """How many times `REFERENCE_FLOW_KG_PER_S` a rig's valves exhaust at the supply's pressure."""
    p, supply = parameters, float(parameters.supply)
    found = (
        abs(float(backed_exhaust_flow(supply, p.atmosphere, p.valve(s), 0.0, 0.0, p.temperature)))
        for s in SIDES
    )
    return max((f for f in found if f > 0.0), default=REFERENCE_FLOW_KG_PER_S) / (
        REFERENCE_FLOW_KG_PER_S
    )


@dataclass(frozen=True)
class ExhaustBackPressure(CatalogueEffect):
    """The valves exhaust through a resistance, such as a silencer: P0 + d flow, or its square.

    Laminar and turbulent losses add: at a linear share s the rise is
    d flow (s + (1 - s) flow / 3.5e-4 kg/s), linear at 1 and a square at 0. The flow is the valve's
    own and, at a common share of 1, that of the other valve through the same silencer. Each
    chamber's flow is solved with its own rise and with the other's flow, in turn, three times. A
    rise by the own flow alone is much like a smaller coefficient of the base law. Surfaces of mean
    flow have no exhaust pressure, and so no back pressure; the averaged law has one.
    """

    back_pressure_pa_s_per_kg: Array = 0.0
    common_share: Array = 1.0
    linear_share: Array = 1.0

    id = "exhaust-back-pressure"
    title = "Back pressure of the exhaust"
    subsystem = "supply"
    quantities = (
        Quantity(
            "back_pressure_pa_s_per_kg",
            "Pa s/kg",
            5e3 / 3.5e-4,
            0.0,
            2e8,
            "rise of the exhaust pressure per flow through the valves, at 3.5e-4 kg/s",
            # It moves the choked boundary, where the base law jumps.
            grid=(4e6, 1.4e7, 4e7),
            is_smooth=True,
        ),
        Quantity(
            "common_share",
            "-",
            1.0,
            0.0,
            1.0,
            "share of the other valve's flow: 0 separate silencers, 1 a common one",
            is_strength=False,
            # Not in between: a choked boundary that is nowhere right traps a fit.
            grid=(0.0, 1.0),
        ),
        Quantity(
            "linear_share",
            "-",
            1.0,
            0.0,
            1.0,
            "share of the rise in proportion to the flow (laminar); the rest grows with its square",
            is_strength=False,
            grid=(0.0, 0.5, 1.0),
            absent=1.0,
        ),
    )
    signature = "exhaust flow, above all below 1.9 times the atmosphere; couples A and B"
    rivals = ("valve-delay",)
    tie_breaker = "remove the silencers"
    source = (
        "textbook: linear and turbulent resistance of a porous silencer (Forchheimer); "
        "base law of thesis 3.6.10"
    )

    def exhaust_pressure(self, pressure: Array, side: str, point: Point) -> Array:
        flow = _adapted(
            lambda s, other_flow: self._flow(s, pressure, other_flow, point),
            side,
            self.common_share,
            point.vents,
        )
        return pressure + self._rise(flow)

    def _rise(self, flow: Array) -> Array:
        """Back pressure of a whole flow, Pa."""
        resistance, curvature = self._coefficients()
        return resistance * flow + curvature * flow * flow

    def _coefficients(self) -> tuple[Array, Array]:
        """Coefficients of the flow, Pa s/kg, and of its square, Pa s2/kg2."""
        whole = self.back_pressure_pa_s_per_kg
        turbulent = whole * (1.0 - self.linear_share) / REFERENCE_FLOW_KG_PER_S
        return whole * self.linear_share, turbulent

    def _flow(self, side: str, atmosphere: Array, other_flow: Array, point: Point) -> Array:
        resistance, curvature = self._coefficients()
        against = atmosphere + self._rise(other_flow)
        # With the other chamber's flow the square has a different slope.
        slope = resistance + 2.0 * curvature * other_flow
        p = point.parameters
        return backed_exhaust_flow(
            point.pressure(side),
            against,
            p.valve(side),
            slope,
            curvature,
            p.temperature,
            other_flow,
        )


@dataclass(frozen=True)
class SupplyPulsation(CatalogueEffect):
    """The supply pulsates, as a compressor or a hunting regulator makes it: Ps + a wave in time.

    A wave u = s sin(2 pi f t) + c cos(2 pi f t), and v a quarter period before, is bent to strokes
    by k: (A/k) atan(k u / (A - k v)) with A its amplitude, whose harmonics are k^(n-1) / n of it: a
    sine at 0, a sawtooth towards 1 (a jump up, then an even fall; towards -1 the other way round).
    t is from the start of a test: of tests that do not begin in phase with the source only those of
    one phase are described. Surfaces of mean flow have no supply pressure, and so no pulsation; the
    averaged law has one.
    """

    pulsation_sine_pa: Array = 0.0
    pulsation_cosine_pa: Array = 0.0
    pulsation_hz: Array = 2.0
    stroke_share: Array = 0.0

    id = "supply-pulsation"
    title = "Supply pressure that pulsates"
    subsystem = "supply"
    quantities = (
        Quantity("pulsation_sine_pa", "Pa", 8e3, -3e4, 3e4, "amplitude of the sine"),
        Quantity("pulsation_cosine_pa", "Pa", 8e3, -3e4, 3e4, "amplitude of the cosine"),
        Quantity(
            "pulsation_hz",
            "Hz",
            2.0,
            0.1,
            30.0,
            "frequency",
            is_strength=False,
            # As close as a test of some seconds distinguishes frequencies.
            grid=tuple(0.125 * n for n in range(2, 41)),
        ),
        # A sine shows most of a sawtooth, at any of many frequencies.
        bent(
            "stroke_share",
            0.0,
            -0.98,
            0.98,
            "0 a sine, towards 1 strokes that jump up and fall evenly",
            is_smooth=False,
        ),
    )
    signature = "filling flow of both chambers, periodic in time whatever they do"
    rivals = ("supply-droop",)
    tie_breaker = "log the supply pressure"
    source = "Beater, Pneumatic Drives, 2007 (compressed air supply: pulsating delivery)"

    def supply_pressure(self, pressure: Array, side: str, point: Point) -> Array:
        xp = array_namespace(point.time, self.pulsation_hz)
        phase = (2.0 * math.pi) * self.pulsation_hz * point.time
        sine, cosine, k = self.pulsation_sine_pa, self.pulsation_cosine_pa, self.stroke_share
        parts = ((sine, xp.sin), (cosine, xp.cos))
        wave = sum(size * f(phase) for size, f in parts if not base.is_zero(size))
        if not base.is_zero(k):
            quarter = sine * xp.cos(phase) - cosine * xp.sin(phase)
            # Never zero: a wave without amplitude has a slope.
            amplitude = xp.sqrt(sine * sine + cosine * cosine + 1e-6)
            hardly = xp.abs(k) < _LEAST_STROKE
            bent = xp.where(hardly, _LEAST_STROKE, k)
            strokes = amplitude / bent * xp.arctan(bent * wave / (amplitude - bent * quarter))
            wave = xp.where(hardly, wave + k * wave * quarter / amplitude, strokes)
        return pressure + wave


EFFECTS: tuple[type[CatalogueEffect], ...] = (SupplyDroop, ExhaustBackPressure, SupplyPulsation)
