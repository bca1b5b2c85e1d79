"""Effects of the chambers: gas law, wall heat, dead volume, tubes and leaks.

Flows are kg/s, positive into the chamber.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sysid.io.channels import SIDES
from sysid.plant import base, valve_laws
from sysid.plant.base import Array, Parameters, array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity, of_side, state_lag
from sysid.plant.ports import Point

# Longer than any test: a temperature that settles so slowly drifts on, s.
NEVER_SETTLES_S = 1e4


def chamber_volume(side: str, point: Point) -> Array:
    """Volume of a chamber, m3, with the nominal pitch radius."""
    p = point.parameters
    if side == "a":
        return base.chamber_volume_a(point.position, p.area_a, p.offset_a, p.pitch_radius)
    return base.chamber_volume_b(point.position, p.area_b, p.offset_b, p.pitch_radius)


def volume_rate(side: str, point: Point) -> Array:
    """dV/dt of a chamber, m3/s, with the nominal pitch radius."""
    p = point.parameters
    speed = p.pitch_radius * point.velocity
    return speed * p.area_a if side == "a" else -(speed * p.area_b)


def base_valve_flow(side: str, point: Point) -> Array:
    """Flow of the valve's law into a chamber, weighted by how far it is open, kg/s.

    0 where the law is not known (NaN), as an averaged valve model does without it.
    """
    p = point.parameters
    valve, pressure, share = p.valve(side), point.pressure(side), point.is_open(side)
    fill = valve_laws.filling_flow(
        valve, pressure, p.supply, p.supply_reference, temperature=p.temperature
    )
    exhaust = valve_laws.exhaust_flow(valve, pressure, p.atmosphere, temperature=p.temperature)
    flow = share * fill + point.vents(side) * exhaust
    return array_namespace(flow).where(flow == flow, flow, 0.0)


def bounded(log_temperature: Array) -> Array:
    """ln(Tg/T) within plausible limits: measured flows that do not fit would drive it away."""
    xp = array_namespace(log_temperature)
    return xp.minimum(xp.maximum(log_temperature, -0.4), 0.4)


def _states_of(prefix: str, chosen: str) -> tuple[str, ...]:
    return tuple(f"{prefix}_{side}" for side in SIDES if of_side(side, chosen))


@dataclass(frozen=True)
class PolytropicExponent(CatalogueEffect):
    """The gas follows an exponent other than the declared one: k + d."""

    exponent_change: Array = 0.0

    id = "polytropic-exponent"
    title = "Polytropic exponent"
    subsystem = "chamber"
    quantities = (
        Quantity(
            "exponent_change", "-", -0.1, -0.4, 0.3, "added to the declared heat capacity ratio"
        ),
    )
    signature = "flow against P dV/dt, and against dP/dt"
    rivals = ("dead-volume-error",)
    tie_breaker = "fill and empty the chambers at several angles"
    source = "thesis 3.3.6; Beater, Pneumatic Drives, 2007"

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        return parameters.replace(
            heat_capacity_ratio=parameters.heat_capacity_ratio + self.exponent_change
        )


@dataclass(frozen=True)
class DeadVolumeError(CatalogueEffect):
    """The chamber is longer or shorter than declared: y_a0 + d, y_b0 + d."""

    dead_length_m: Array = 0.0
    side: str = "both"

    id = "dead-volume-error"
    title = "Dead volume differs from its declared size"
    subsystem = "chamber"
    quantities = (
        Quantity("dead_length_m", "m", 3e-3, -0.01, 0.03, "added to the chamber's length at y = 0"),
    )
    signature = "flow against dP/dt"
    rivals = ("polytropic-exponent",)
    tie_breaker = "fill and empty the chambers at several angles"
    source = "thesis 3.3.6"

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        names = [f"offset_{side}" for side in SIDES if of_side(side, self.side)]
        changes = {name: getattr(parameters, name) + self.dead_length_m for name in names}
        return parameters.replace(**changes)


@dataclass(frozen=True)
class WallHeatTransfer(CatalogueEffect):
    """The cylinder's wall, at ambient temperature, warms or cools the gas.

    Heat Q = d (P / P0)^e (T - Tg) adds (k-1) Q / V to dP/dt: at e = 0 its conductance is constant,
    turbulent gas carries more where it is denser (e = 0.8, P0 the atmosphere). The gas
    temperature Tg = P V / (m R) follows from the base model's own pressure and mass balances, and
    is kept as z = ln(Tg / T), which stays bounded:
    dz/dt = (R flow (k T - Tg) - (k-1) P dV/dt + (k-1) Q) / (P V).
    Without heat a fill from vacuum tends to Tg = k T, as charging does.
    """

    wall_conductance_w_per_k: Array = 0.0
    side: str = "both"
    density_exponent: Array = 0.0

    id = "wall-heat-transfer"
    title = "Heat transfer through the cylinder wall"
    subsystem = "chamber"
    quantities = (
        Quantity(
            "wall_conductance_w_per_k",
            "W/K",
            0.4,
            0.0,
            4.0,
            "heat per kelvin from wall to gas at atmospheric pressure",
        ),
        Quantity(
            "density_exponent",
            "-",
            0.0,
            0.0,
            1.0,
            "power of the pressure by which the conductance grows: 0 constant, 0.8 turbulent",
            is_strength=False,
            grid=(0.0, 0.8),
            absent=0.0,
        ),
    )
    signature = "pressure that decays over about 0.2 s after each valve edge"
    rivals = ("piston-leakage", "atmosphere-leakage")
    tie_breaker = "hold the chamber closed for two different lengths of time"
    source = (
        "energy balance of an open volume; Beater, Pneumatic Drives, 2007; Dittus, Boelter, "
        "1930 (turbulent: the Nusselt number grows as the Reynolds number^0.8)"
    )
    states = ("wall_log_temperature_a", "wall_log_temperature_b")

    def __post_init__(self) -> None:
        # An instance has the states of its own side only.
        object.__setattr__(self, "states", _states_of("wall_log_temperature", self.side))

    def _heat(self, side: str, point: Point) -> Array:
        """Heat into the gas, W."""
        p = point.parameters
        z = bounded(point.extra[f"wall_log_temperature_{side}"])
        xp = array_namespace(z)
        conductance = self.wall_conductance_w_per_k
        if not base.is_zero(self.density_exponent):
            # A sensor's noise may reach below a vacuum.
            ratio = xp.maximum(point.pressure(side) / p.atmosphere, 1e-3)
            conductance = conductance * ratio**self.density_exponent
        return -conductance * p.temperature * xp.expm1(z)

    def pressure_rate(self, rate: Array, side: str, flow: Array, point: Point) -> Array:
        if not of_side(side, self.side):
            return rate
        per_watt = (point.parameters.heat_capacity_ratio - 1.0) / chamber_volume(side, point)
        return rate + per_watt * self._heat(side, point)

    def initial_states(self, point: Point) -> dict[str, Array]:
        return dict.fromkeys(self.states, 0.0 * point.position)

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        p = point.parameters
        less_one = p.heat_capacity_ratio - 1.0
        rates = {}
        for side in SIDES:
            name = f"wall_log_temperature_{side}"
            if name not in self.states:
                continue
            pressure, z = point.pressure(side), bounded(point.extra[name])
            gas = p.temperature * array_namespace(z).exp(z)
            enthalpy = p.gas_constant * flows[side] * (p.heat_capacity_ratio * p.temperature - gas)
            work = less_one * pressure * volume_rate(side, point)
            heat = less_one * self._heat(side, point)
            energy = pressure * chamber_volume(side, point)
            rates[name] = (enthalpy - work + heat) / energy
        return rates


@dataclass(frozen=True)
class TubeLag(CatalogueEffect):
    """The tube between valve and chamber delays the flow as a first-order lag.

    The lag acts on the flow of the base law; flow added by other effects is not delayed.
    Below 1 ms it is correct to first order in the lag.
    """

    tube_lag_s: Array = 0.0
    side: str = "both"

    id = "tube-lag"
    title = "Lag of the tube"
    subsystem = "chamber"
    quantities = (
        Quantity("tube_lag_s", "s", 1.5e-3, 0.0, 0.02, "time constant of the chamber's flow"),
    )
    signature = "timing of the pressure at valve edges"
    rivals = ("pressure-lag", "time-skew")
    tie_breaker = "none from the pressure logs alone; a second sensor at the valve"
    source = "Richer and Hurmuzlu, ASME J. Dyn. Syst. Meas. Control 122, 2000 (tube dynamics)"
    states = ("tube_flow_a", "tube_flow_b")

    def __post_init__(self) -> None:
        # An instance has the states of its own side only.
        object.__setattr__(self, "states", _states_of("tube_flow", self.side))

    def chamber_flow(self, flow: Array, side: str, point: Point) -> Array:
        if not of_side(side, self.side):
            return flow
        behind = point.extra[f"tube_flow_{side}"] - base_valve_flow(side, point)
        return flow + (self.tube_lag_s / state_lag(self.tube_lag_s)) * behind

    def initial_states(self, point: Point) -> dict[str, Array]:
        return {name: base_valve_flow(name[-1], point) for name in self.states}

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        lag = state_lag(self.tube_lag_s)
        return {
            name: (base_valve_flow(name[-1], point) - point.extra[name]) / lag
            for name in self.states
        }


@dataclass(frozen=True)
class PistonLeakage(CatalogueEffect):
    """Air leaks past the piston's seal: d (Pa^2 - Pb^2) from A to B, as through a narrow gap."""

    piston_leakage_kg_per_s_pa2: Array = 0.0
    needs_chamber_b = True

    id = "piston-leakage"
    title = "Leakage past the piston"
    subsystem = "chamber"
    quantities = (
        Quantity(
            "piston_leakage_kg_per_s_pa2",
            "kg/(s Pa^2)",
            5e-17,
            0.0,
            1e-14,
            "flow from A to B per difference of squared pressures",
        ),
    )
    signature = "flow into A that B loses"
    rivals = ("wall-heat-transfer", "laminar-leakage")
    tie_breaker = "plug the port of one chamber and watch its pressure"
    source = "isothermal laminar flow in a narrow gap; Beater, Pneumatic Drives, 2007"

    def chamber_flow(self, flow: Array, side: str, point: Point) -> Array:
        squares = point.pressure_a * point.pressure_a - point.pressure_b * point.pressure_b
        across = self.piston_leakage_kg_per_s_pa2 * squares
        return flow - across if side == "a" else flow + across


@dataclass(frozen=True)
class AtmosphereLeakage(CatalogueEffect):
    """A chamber leaks to the outside: d (P^2 - P0^2), as through a narrow gap."""

    atmosphere_leakage_kg_per_s_pa2: Array = 0.0
    side: str = "both"

    id = "atmosphere-leakage"
    title = "Leakage to the atmosphere"
    subsystem = "chamber"
    quantities = (
        Quantity(
            "atmosphere_leakage_kg_per_s_pa2",
            "kg/(s Pa^2)",
            5e-17,
            0.0,
            1e-14,
            "flow out per difference of squared pressures",
        ),
    )
    signature = "flow of one chamber, with the valve on or off"
    rivals = (
        "supply-droop",
        "subsonic-flow-shape",
        "choked-exhaust-scaling",
        "laminar-leakage",
    )
    tie_breaker = "plug the port of the chamber and watch its pressure"
    source = "isothermal laminar flow in a narrow gap; Beater, Pneumatic Drives, 2007"

    def chamber_flow(self, flow: Array, side: str, point: Point) -> Array:
        if not of_side(side, self.side):
            return flow
        pressure, outside = point.pressure(side), point.parameters.atmosphere
        squares = pressure * pressure - outside * outside
        return flow - self.atmosphere_leakage_kg_per_s_pa2 * squares


@dataclass(frozen=True)
class LaminarLeakage(CatalogueEffect):
    """Air leaks in proportion to the pressure's difference: d (Pa - Pb) from A to B (side "both"),
    or d (P - P0) out of one chamber.

    As through a long passage whose density hardly changes, or a porous seal.
    """

    laminar_leakage_kg_per_s_pa: Array = 0.0
    side: str = "both"
    is_between_sides = True

    id = "laminar-leakage"
    title = "Leakage in proportion to the pressure"
    subsystem = "chamber"
    quantities = (
        Quantity(
            "laminar_leakage_kg_per_s_pa",
            "kg/(s Pa)",
            2e-11,
            0.0,
            1e-8,
            "flow per difference of the pressures: of both chambers, or of one and the atmosphere",
        ),
    )
    signature = "flow against the difference of the pressures"
    rivals = ("piston-leakage", "atmosphere-leakage")
    tie_breaker = "two levels of pressure with the ports plugged"
    source = "Hagen-Poiseuille; Beater, Pneumatic Drives, 2007"

    def chamber_flow(self, flow: Array, side: str, point: Point) -> Array:
        if self.side == "both":
            across = self.laminar_leakage_kg_per_s_pa * (point.pressure_a - point.pressure_b)
            return flow - across if side == "a" else flow + across
        if side != self.side:
            return flow
        above = point.pressure(side) - point.parameters.atmosphere
        return flow - self.laminar_leakage_kg_per_s_pa * above


@dataclass(frozen=True)
class ThresholdLeakage(CatalogueEffect):
    """A chamber leaks to the outside above a threshold pressure only: d max(P - Pt, 0).

    As a relief valve opens, or a lip seal lifts.
    """

    threshold_leakage_kg_per_s_pa: Array = 0.0
    threshold_pa: Array = 1.6e5
    side: str = "both"

    id = "threshold-leakage"
    title = "Leakage above a threshold pressure"
    subsystem = "chamber"
    quantities = (
        Quantity(
            "threshold_leakage_kg_per_s_pa",
            "kg/(s Pa)",
            1.2e-9,
            0.0,
            2e-7,
            "flow out per pressure above the threshold",
        ),
        Quantity(
            "threshold_pa",
            "Pa",
            1.6e5,
            1e5,
            1e6,
            "absolute pressure from which on the chamber leaks",
            is_strength=False,
            grid=(1.3e5, 1.45e5, 1.6e5, 1.75e5, 1.9e5, 2.1e5, 2.4e5, 3e5, 4e5, 5.5e5),
        ),
    )
    signature = "flow of one chamber at high pressure, with the valve on or off"
    rivals = ("atmosphere-leakage", "choked-exhaust-scaling", "subsonic-flow-shape")
    tie_breaker = "plug the port of the chamber: its pressure falls to the threshold and stays"
    source = "Beater, Pneumatic Drives, 2007 (relief valve: flow by the excess over its setting)"

    def chamber_flow(self, flow: Array, side: str, point: Point) -> Array:
        if not of_side(side, self.side):
            return flow
        pressure = point.pressure(side)
        xp = array_namespace(pressure, self.threshold_pa)
        excess = xp.maximum(pressure - self.threshold_pa, 0.0)
        return flow - self.threshold_leakage_kg_per_s_pa * excess


@dataclass(frozen=True)
class TemperatureDrift(CatalogueEffect):
    """The air's temperature drifts over a test: T + d t, which scales the effect of a flow.

    Or it settles with a time constant tau: T + d tau (1 - exp(-t / tau)); d is its first slope.
    At tau of 1e4 s it does not settle at all. It falls to half of the declared one at most.
    """

    temperature_drift_k_per_s: Array = 0.0
    settling_time_s: Array = NEVER_SETTLES_S

    id = "temperature-drift"
    title = "Drift of the air's temperature"
    subsystem = "chamber"
    quantities = (
        Quantity(
            "temperature_drift_k_per_s",
            "K/s",
            10.0 / 60.0,
            -5.0,
            5.0,
            "rise at a test's start",
        ),
        Quantity(
            "settling_time_s",
            "s",
            NEVER_SETTLES_S,
            0.5,
            NEVER_SETTLES_S,
            "time constant with which it settles; 1e4: it drifts on",
            is_strength=False,
            grid=(1.5, 4.0, 10.0, NEVER_SETTLES_S),
            absent=NEVER_SETTLES_S,
        ),
    )
    signature = "a scale of the flow that drifts slowly over a test, or settles"
    rivals = ("coil-heating",)
    tie_breaker = "hold one valve for a long time, without edges"
    source = "thesis 3.3.6; textbook: first-order warming of a body"

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        xp = array_namespace(time, self.settling_time_s, self.temperature_drift_k_per_s)
        tau = self.settling_time_s
        span = xp.where(tau < NEVER_SETTLES_S, -tau * xp.expm1(-time / tau), time)
        declared = parameters.temperature
        drifted = declared + self.temperature_drift_k_per_s * span
        return parameters.replace(temperature=xp.maximum(drifted, 0.5 * declared))


EFFECTS: tuple[type[CatalogueEffect], ...] = (
    PolytropicExponent,
    WallHeatTransfer,
    DeadVolumeError,
    TubeLag,
    PistonLeakage,
    AtmosphereLeakage,
    LaminarLeakage,
    ThresholdLeakage,
    TemperatureDrift,
)
