"""A vessel of constant volume that empties through a port: pressures simulated in open loop.

By the thesis the gas keeps its temperature, and its pressure follows the flow by 3.3.6. By ISO 6358
the flow depends on the temperature of the gas, which cools as it expands and is warmed by the wall:
its mass and temperature are states, and whatever the wall's conductance, from none (adiabatic) to
all (isothermal), is integrated in the same steps. The thesis' flow out of such gas shows what 3.3.6
does to its coefficients.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.plant import base, plant, valve_laws
from sysid.plant.base import Array
from sysid.plant.iso6358 import choked_flow, iso6358_flow, subsonic_share
from sysid.plant.ports import Model, Point, overrides
from sysid.plant.steps import relaxing_step
from sysid.types import BoolArray, FloatArray

# Heat that a square metre of a vessel's wall gives still air, W/(m2 K): the scale of its
# conductance, no number that anything depends on.
_STILL_AIR_W_PER_M2_K = 10.0
# A pressure that no vessel reaches, of the highest one at the start, and none below a vacuum.
_HIGHEST_OF_START, _LOWEST_PA = 10.0, 1.0
_MOST_OF_A_STATE = 1e9
_LEAST_ADIABATIC = 1e-9
_FIRST_STEP = 1e-3
# Of the search for the time in a step at which a flow ceases to be choked.
_HALVINGS = 40
# The ports through which an effect acts on a vessel at rest; those of its place are its volume's.
_PLACE = ("displacement", "pitch_radius")
_OWN_PORTS = ("exhaust_pressure", "exhaust_flow", "chamber_flow", "pressure_rate")
_PORTS = ("parameters", *_PLACE, *_OWN_PORTS)


@dataclass(frozen=True)
class Iso6358:
    """The flow of ISO 6358 and the wall of the vessel; numbers, or one of each run.

    `conductance` C, m3/(s Pa) at ANR, `ratio` b, `index` m, `adiabatic` the share that
    `wall_conductance` gives.
    """

    conductance: Array
    ratio: Array
    index: Array
    adiabatic: Array


def wall_scale(volume: float) -> float:
    """W/K: the conductance of the wall of a cube of `volume` (m3) in still air."""
    area: float = 6.0 * volume ** (2.0 / 3.0)
    return _STILL_AIR_W_PER_M2_K * area


def wall_conductance(adiabatic: Array, volume: float) -> Array:
    """W/K: infinite where the share is 0 (isothermal), none where it is 1 (adiabatic)."""
    share = np.maximum(adiabatic, _LEAST_ADIABATIC)
    return wall_scale(volume) * (1.0 - share) / share


def adiabatic_share(conductance: float, volume: float) -> float:
    """The inverse of `wall_conductance`."""
    return 1.0 / (1.0 + conductance / wall_scale(volume))


@dataclass(frozen=True, eq=False)
class Course:
    """Pressures (m, runs) Pa and their rates at times (m,) s, Pa/s.

    `changes` (4, runs): when a run's flow ceases to be choked, s, its pressure then, and its rate
    before and after; infinite where it does not.
    """

    times: FloatArray
    pressures: FloatArray
    rates: FloatArray
    changes: FloatArray

    def of(self, runs: Sequence[int]) -> Course:
        """Some of the runs."""
        chosen = list(runs)
        return Course(
            self.times, self.pressures[:, chosen], self.rates[:, chosen], self.changes[:, chosen]
        )

    def at(self, time: FloatArray) -> FloatArray:
        """Pressures at times (n,) s, (n, runs): cubics between the steps, and to a change in one.

        A cubic across the change would miss the corner by some Pa over a whole step.
        """
        k = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)
        begin, end = self.times[k][:, None], self.times[k + 1][:, None]
        when, pressure, before, after = self.changes
        inside, now = (begin <= when) & (when < end), time[:, None]
        early, late = inside & (now < when), inside & (now >= when)
        return _cubic(
            now,
            (np.where(late, when, begin), np.where(early, when, end)),
            (
                np.where(late, pressure, self.pressures[k]),
                np.where(early, pressure, self.pressures[k + 1]),
            ),
            (np.where(late, after, self.rates[k]), np.where(early, before, self.rates[k + 1])),
        )


# A search tries laws that no vessel has, of which exponentials overflow: they are held.
@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def simulated(
    starts: FloatArray,
    times: FloatArray,
    model: Model,
    law: Iso6358 | None,
    adiabatic: Array | None = None,
) -> Course:
    """The course at times (m,) s of runs from `starts` (runs,), Pa.

    `law` None: the thesis', `adiabatic` the share that `wall_conductance` gives where its flow is
    that of gas with a temperature. What cannot be, as below a vacuum, is held at what can.
    """
    highest = _HIGHEST_OF_START * max(
        float(np.max(starts)), float(np.max(model.parameters.atmosphere))
    )
    vessel: _BaseVessel
    if law is not None:
        vessel = _GasVessel(model, highest, law)
    elif adiabatic is not None:
        vessel = _WarmedVessel(model, highest, adiabatic)
    else:
        vessel = _BaseVessel(model, highest)
    pressures, rates = np.empty((2, len(times), len(starts)))
    changes = np.full((4, len(starts)), np.inf)
    state = vessel.at_rest(starts)
    for k, t in enumerate(times.tolist()):
        slopes, decays = vessel.slopes(t, state)
        pressures[k], rates[k] = vessel.shown(t, state, slopes)
        if k == len(times) - 1:
            break
        step = float(times[k + 1]) - t

        def ahead(share: float, state: Sequence[Array], time: Array = t, by: Array = step) -> Any:
            return vessel.slopes(time + share * by, state)[0]

        there = relaxing_step(state, slopes, decays, ahead, step)
        share = vessel.changes(t, step, state, slopes, there)
        if share is not None:
            # To the change of the law, and on by the other one.
            until, after = share * step, (1.0 - share) * step
            middle = relaxing_step(state, slopes, decays, functools.partial(ahead, by=until), until)
            change = share < 1.0
            before = vessel.slopes(t + until, middle)[0]
            vessel.change(change)
            slopes, decays = vessel.slopes(t + until, middle)
            pressure, fell = vessel.shown(t + until, middle, before)
            falls = vessel.shown(t + until, middle, slopes)[1]
            changes = np.where(change, np.array([t + until, pressure, fell, falls]), changes)
            later = functools.partial(ahead, time=t + until, by=after)
            there = relaxing_step(middle, slopes, decays, later, after)
        state = vessel.held(there)
    return Course(times, pressures, rates, changes)


class _BaseVessel:
    """The thesis' chamber: states are its pressure (to `highest` Pa) and those of the effects."""

    own = 1

    def __init__(self, model: Model, highest: float) -> None:
        self.model, self.highest = model, highest
        self.names: tuple[str, ...] = ()
        self.choked: BoolArray = np.zeros(0, dtype=bool)
        # A step takes as long for one run as for many, so what a run keeps is worked out once; an
        # effect that does not override a port would give back what it is given.
        self._acting: dict[str, list[Callable[..., Array]]] = {
            port: [getattr(e, port) for e in model.effects if overrides(type(e), port)]
            for port in _PORTS
        }
        self._is_bare = not model.state_names and not any(self._acting.values())
        self._fixed = None if self._acting["parameters"] else model.parameters
        self._volume: Array | None = None
        self._boundary: Array | None = None
        if self._fixed is not None and not any(self._acting[port] for port in _PLACE):
            self._volume = plant.chamber_volume("a", 0.0, self._fixed)
        if self._fixed is not None and not self._acting["exhaust_pressure"]:
            p = self._fixed
            self._boundary = valve_laws.exhaust_boundary(p.valve("a"), p.atmosphere)

    def at_rest(self, starts: FloatArray) -> tuple[Array, ...]:
        state = (starts, *self._of_effects(starts))
        self.choked = self._above(0.0, state) >= 0.0
        return state

    def _at(self, time: float) -> base.Parameters:
        return self.model.at(time) if self._fixed is None else self._fixed

    def _point(self, time: float, pressure: Array, state: Sequence[Array]) -> Point:
        extra = dict(zip(self.names, state[self.own :], strict=True))
        zero = np.zeros(np.shape(pressure))
        # Without a chamber B its pressure is A's, so that nothing flows between the two.
        both = pressure, pressure
        return Point(time, zero, zero, *both, zero, zero, zero, zero, self._at(time), extra)

    def _through(self, port: str, value: Array, *context: Any) -> Array:
        for act in self._acting[port]:
            value = act(value, *context)
        return value

    def _above(self, time: float, state: Sequence[Array]) -> FloatArray:
        """How far the pressure is above that from which on the flow is choked, Pa, (runs,)."""
        boundary, pressure = self._boundary, self._pressure(time, state)
        if boundary is None:
            boundary = plant.exhaust_boundary("a", self._point(time, pressure, state), self.model)
        return np.asarray(pressure - boundary)

    def _pressure(self, time: float, state: Sequence[Array]) -> Array:
        return state[0]

    def changes(
        self,
        time: float,
        step: float,
        state: Sequence[Array],
        slopes: Sequence[Array],
        there: Sequence[Array],
    ) -> FloatArray | None:
        """The share of a step after which a run's flow ceases to be choked, 1 where it does not,
        (runs,); None where no run's does. On the cubic through both ends of the step."""
        if not self.choked.any():
            return None
        ends = self._above(time + step, there)
        crosses = self.choked & (ends < 0.0)
        if not crosses.any():
            return None
        begins, rise = self._above(time, state), step * self.shown(time, state, slopes)[1]
        at_end = self.slopes(time + step, there)[0]
        end_rise = step * self.shown(time + step, there, at_end)[1]
        low, high = np.zeros(len(ends)), np.ones(len(ends))
        for _ in range(_HALVINGS):
            s = 0.5 * (low + high)
            bend = (3.0 - 2.0 * s) * s * s
            sides = s * (1.0 - s) * ((1.0 - s) * rise - s * end_rise)
            is_above = begins + bend * (ends - begins) + sides > 0.0
            low, high = np.where(is_above, s, low), np.where(is_above, high, s)
        return np.where(crosses, high, 1.0)

    def change(self, where: BoolArray) -> None:
        """The runs whose flow is no longer choked."""
        self.choked = self.choked & ~where

    def _of_effects(self, starts: FloatArray) -> list[Array]:
        if not self.model.state_names:
            return []
        extra = plant.initial_states(self._point(0.0, starts, ()), self.model)
        self.names = tuple(extra)
        return list(extra.values())

    def _others(self, point: Point | None, flow: Array) -> list[Array]:
        if point is None or not self.names:
            return []
        found = plant.state_rates(point, {"a": flow, "b": 0.0 * flow}, self.model)
        return [found[name] for name in self.names]

    def slopes(
        self, time: float, state: Sequence[Array]
    ) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        pressure, p = state[0], self._at(time)
        point = None if self._is_bare else self._point(time, pressure, state)
        outside = self._through("exhaust_pressure", p.atmosphere, "a", point)
        # As plant.discrete_flow has it, without the filling, which takes half the time.
        flow = base.exhaust_flow(pressure, outside, p.choked_dis_a, p.c_dis_a, self.choked)
        flow = self._into(flow, point)
        rates = (self._rate(pressure, flow, point, p), *self._others(point, flow))
        return rates, (0.0,) * len(rates)

    def _into(self, flow: Array, point: Point | None) -> Array:
        flow = self._through("exhaust_flow", flow, "a", point)
        return self._through("chamber_flow", flow, "a", point)

    def _rate(self, pressure: Array, flow: Array, point: Point | None, p: base.Parameters) -> Array:
        """As plant.pressure_rate has it."""
        if self._volume is None and point is not None:
            return plant.pressure_rate("a", flow, point, self.model)
        rate = _rate_at_rest(pressure, flow, self._volume, p)
        return self._through("pressure_rate", rate, "a", flow, point)

    def shown(
        self, time: float, state: Sequence[Array], slopes: Sequence[Array]
    ) -> tuple[Array, Array]:
        return state[0], slopes[0]

    def held(self, state: Sequence[Array]) -> tuple[Array, ...]:
        pressure = _between(_LOWEST_PA, state[0], self.highest)
        return (pressure, *map(_bounded, state[1:]))


class _GasVessel(_BaseVessel):
    """Gas with a temperature of its own: states are ln(mass / kg), z = ln(T / T0) and the effects'.

    M dz/dt = (k - 1) m + (h / c_v) (1/e^z - 1) for the flow m out of mass M, as what leaves takes
    its own enthalpy; the effects' change of the pressure's rate is heat.
    """

    own = 2

    def __init__(self, model: Model, highest: float, law: Iso6358) -> None:
        super().__init__(model, highest)
        self.law = law
        self._warm(law.adiabatic)

    def _warm(self, adiabatic: Array) -> None:
        p = self.model.parameters
        self.volume = plant.chamber_volume("a", 0.0, p)
        self.wall = wall_conductance(adiabatic, float(np.max(self.volume)))
        self._of_fixed = self._number_of(p)
        per_pascal = self.volume / (p.gas_constant * p.temperature)
        self.least, self.most = np.log(_LOWEST_PA * per_pascal), np.log(self.highest * per_pascal)

    def at_rest(self, starts: FloatArray) -> tuple[Array, ...]:
        p = self.model.at(0.0)
        mass = starts * self.volume / (p.gas_constant * p.temperature)
        return (np.log(mass), 0.0 * starts, *self._of_effects(starts))

    def changes(self, *_: Any) -> FloatArray | None:
        """Of ISO 6358 the flow has no corner."""
        return None

    def _numbers(self, p: base.Parameters) -> tuple[Array, Array]:
        """Pa per kg at the room's temperature, and 1/s times kg of what the wall gives."""
        return self._of_fixed if p is self._fixed else self._number_of(p)

    def _number_of(self, p: base.Parameters) -> tuple[Array, Array]:
        return (
            p.gas_constant * p.temperature / self.volume,
            self.wall * (p.heat_capacity_ratio - 1.0) / p.gas_constant,
        )

    def slopes(
        self, time: float, state: Sequence[Array]
    ) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        z, per_kg, p = state[1], np.exp(-state[0]), self._at(time)
        pascals, wall = self._numbers(p)
        warmer, heat, k = np.exp(z), 0.0, p.heat_capacity_ratio
        pressure = pascals * np.exp(state[0] + z)
        point = None if self._is_bare else self._point(time, pressure, state)
        outside = self._through("exhaust_pressure", p.atmosphere, "a", point)
        flow = self._into(-self._flow(pressure, outside, warmer, p), point)
        if self._acting["pressure_rate"]:
            own = _rate_at_rest(pressure, flow, self.volume, p)
            heat = (self._through("pressure_rate", own, "a", flow, point) - own) / pressure
        per_mass = flow * per_kg
        # What comes in is at the room's temperature.
        enthalpy = np.where(flow > 0.0, k / warmer, k) * per_mass
        relaxing = wall * per_kg
        warming = enthalpy - per_mass + heat + relaxing * np.expm1(-z)
        others = self._others(point, flow)
        return (per_mass, warming, *others), (0.0, relaxing, *(0.0,) * len(self.names))

    def _flow(self, pressure: Array, outside: Array, warmer: Array, p: base.Parameters) -> Array:
        law, leaves = self.law, pressure >= outside
        if leaves.all():
            # The same to the last bit, without what a flow into the vessel would take.
            choked = choked_flow(pressure, law.conductance, p.temperature * warmer)
            return choked * subsonic_share(outside / pressure, law.ratio, law.index)
        gas = p.temperature * np.where(leaves, warmer, 1.0)
        return iso6358_flow(pressure, outside, law.conductance, law.ratio, law.index, gas)

    def shown(
        self, time: float, state: Sequence[Array], slopes: Sequence[Array]
    ) -> tuple[Array, Array]:
        pressure = self._pressure(time, state)
        return pressure, pressure * (slopes[0] + slopes[1])

    def _pressure(self, time: float, state: Sequence[Array]) -> Array:
        return self._numbers(self._at(time))[0] * np.exp(state[0] + state[1])

    def held(self, state: Sequence[Array]) -> tuple[Array, ...]:
        mass = _between(self.least, state[0], self.most)
        # The gas of a vessel that empties is never colder or warmer than by this.
        return (mass, _between(-3.0, state[1], 3.0), *map(_bounded, state[2:]))


class _WarmedVessel(_GasVessel):
    """Gas with a temperature of its own that leaves by the thesis' flow."""

    def __init__(self, model: Model, highest: float, adiabatic: Array) -> None:
        _BaseVessel.__init__(self, model, highest)
        self._warm(adiabatic)

    def at_rest(self, starts: FloatArray) -> tuple[Array, ...]:
        state = super().at_rest(starts)
        self.choked = self._above(0.0, state) >= 0.0
        return state

    changes = _BaseVessel.changes

    def _flow(self, pressure: Array, outside: Array, warmer: Array, p: base.Parameters) -> Array:
        return -base.exhaust_flow(pressure, outside, p.choked_dis_a, p.c_dis_a, self.choked)


def _between(least: Array, value: Array, most: Array) -> Array:
    """Within limits; 0, or the limit next to it, where it is not a number."""
    number = np.where(np.isnan(value), 0.0, value)
    # As np.clip, whose call takes longer than both.
    return np.minimum(np.maximum(number, least), most)


def _bounded(value: Array) -> Array:
    return _between(-_MOST_OF_A_STATE, value, _MOST_OF_A_STATE)


def _rate_at_rest(pressure: Array, flow: Array, volume: Array, p: base.Parameters) -> Array:
    """Pa/s that a flow into a constant volume gives it."""
    k = p.heat_capacity_ratio
    return base.pressure_rate(pressure, flow, volume, 0.0, k, p.gas_constant, p.temperature)


def grid(end: float, first: float, longest: float, growth: float) -> FloatArray:
    """Times of the steps (m,) s from 0 to `end` or just beyond, each longer than the one before.

    From a thousandth of `first` s doubled up to it, then by `growth` up to `longest`: at the start
    the gas of a conducting tank goes over to its quasi-steady temperature, in as short a time as
    may be, and the rates at both ends of a step say nothing of what lies between.
    """
    times, step = [0.0], _FIRST_STEP * first
    while times[-1] < end:
        times.append(times[-1] + step)
        step = min(2.0 * step, first) if step < first else min(step * growth, longest)
    return np.array(times)


def _cubic(
    at: FloatArray,
    times: tuple[FloatArray, FloatArray],
    values: tuple[FloatArray, FloatArray],
    rates: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Hermite's cubic through values and rates at the two `times` about each of `at`."""
    step = times[1] - times[0]
    s = (at - times[0]) / step
    bend = (3.0 - 2.0 * s) * s * s
    slope = step * s * (1.0 - s) * ((1.0 - s) * rates[0] - s * rates[1])
    return np.asarray(values[0] + bend * (values[1] - values[0]) + slope)


__all__ = [
    "Course",
    "Iso6358",
    "adiabatic_share",
    "grid",
    "simulated",
    "wall_conductance",
    "wall_scale",
]
