"""The model's rates at a point, and how they move with what may drift.

Every function is of any array library, and of names of C: all goes through `sysid.plant.plant`, so
that a bundle's effects count. An effect with a state counts as where that has settled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from sysid.plant import plant
from sysid.plant.base import Array, array_namespace
from sysid.plant.ports import Model, Point

PAST = 1e-6
"""How far past the choked flow's boundary, relative, its other side is taken."""


class ChamberPoint(NamedTuple):
    """Where a chamber is while no valve moves: rad or m, rad/s or m/s, Pa.

    `pressure` is its own, `other` the other chamber's; `is_open`, `other_open`: 1 where the valves
    are, else 0; `opened`, `closed`: 1 where the own one did as this began.
    """

    position: Array
    velocity: Array
    pressure: Array
    other: Array
    is_open: Array
    other_open: Array
    opened: Array
    closed: Array


class ChamberTerms(NamedTuple):
    """dP/dt of a chamber, Pa/s: its `rate`, its slope over the pressure, 1/s, and over the drifts.

    `slopes`: for each of `drifts.CHAMBER`, Pa/s per scale of it; `jumps` of the two delays, Pa per
    scale, as a valve moves; `per_flow` k R T / V, Pa/kg; `boundary`: the choked flow's pressure.
    """

    rate: Array
    over_pressure: Array
    slopes: tuple[Array, ...]
    jumps: tuple[Array, Array]
    per_flow: Array
    boundary: Array


@dataclass(frozen=True)
class Noise:
    """What the observers take for the sensors' errors, standard deviations.

    `pressure` Pa, `position` rad or m; `period` s of a sample.
    """

    pressure: Array
    position: Array
    period: Array


def _point(
    model: Model, side: str, at: ChamberPoint, supply: Array | None, is_open: Array
) -> tuple[Point, Model]:
    xp = array_namespace(at.pressure, at.position)
    base = model.parameters if supply is None else model.parameters.replace(supply=supply)
    own = Model(base, model.effects)
    none = 0.0 * at.pressure
    pressures = (at.pressure, at.other) if side == "a" else (at.other, at.pressure)
    opens = (is_open, at.other_open) if side == "a" else (at.other_open, is_open)
    point = Point(
        time=none,
        position=at.position,
        velocity=at.velocity,
        pressure_a=pressures[0],
        pressure_b=pressures[1],
        motor=none,
        open_a=opens[0],
        open_b=opens[1],
        direction=xp.sign(at.velocity),
        parameters=own.at(0.0),
    )
    return point, own


def chamber_rate(
    model: Model, side: str, at: ChamberPoint, is_open: Array, supply: Array | None = None
) -> Array:
    """dP/dt, Pa/s, with the own valve open for a share, and the supply at a pressure."""
    point, own = _point(model, side, at, supply, is_open)
    return plant.pressure_rate(side, plant.shared_flow(side, is_open, point, own), point, own)


def swept_rate(model: Model, side: str, at: ChamberPoint) -> Array:
    """dP/dt, Pa/s, without any flow."""
    point, own = _point(model, side, at, None, at.is_open)
    return plant.pressure_rate(side, 0.0 * at.pressure, point, own)


def rate_per_flow(model: Model, side: str, position: Array) -> Array:
    """k R T / V of a chamber at a position, Pa/kg."""
    none = 0.0 * position
    at = ChamberPoint(position, none, none, none, none, none, none, none)
    point, own = _point(model, side, at, None, none)
    p = point.parameters
    volume = plant.chamber_volume(side, plant.displacement(point, own), p)
    return p.heat_capacity_ratio * p.gas_constant * p.temperature / volume


def shaft_effort(
    model: Model,
    position: Array,
    velocity: Array,
    pressure_a: Array,
    pressure_b: Array,
    motor: Array,
) -> Array:
    """All efforts less friction while moving as the velocity says, Nm or N; at 0 no friction."""
    xp = array_namespace(velocity, pressure_a)
    none = 0.0 * velocity
    point = Point(
        time=none,
        position=position,
        velocity=velocity,
        pressure_a=pressure_a,
        pressure_b=pressure_b,
        motor=motor,
        open_a=none,
        open_b=none,
        direction=xp.sign(velocity),
        parameters=model.at(0.0),
    )
    return plant.applied_effort(point, model) - plant.sliding_friction(point, model)


def past_boundary(at: ChamberPoint, terms: ChamberTerms) -> ChamberPoint:
    """The point just past the choked flow's boundary."""
    xp = array_namespace(at.pressure, terms.boundary)
    way = xp.where(at.pressure < terms.boundary, PAST, -PAST)
    return at._replace(pressure=terms.boundary * (1.0 + way))


def chamber_terms(
    model: Model,
    side: str,
    at: ChamberPoint,
    noise: Noise,
    scales: Sequence[Array],
    choked: tuple[Array, Array],
) -> ChamberTerms:
    """The terms of a stretch; `scales` (9,) of the drifts, `choked`: the pressures up to which
    filling and from which on the exhaust is choked, Pa.

    Slopes are differences over the pressure's noise to either side.

    A slope over what the sensors resolve stays finite where the law's own does not, at the line's
    pressure (statistical linearisation).
    """

    supply, spread = model.parameters.supply, noise.pressure
    xp = array_namespace(at.pressure, at.position)
    is_on = at.is_open > 0

    def rate(pressure: Array, line: Array) -> Array:
        return chamber_rate(model, side, at._replace(pressure=pressure), at.is_open, line)

    def own_flow(is_open: float) -> Array:
        return chamber_rate(model, side, at, is_open, supply)

    def chokes(pressure: Array, line: Array) -> Array:
        return xp.where(is_on, pressure <= choked[0] * line / supply, pressure >= choked[1])

    opened, closed, swept = own_flow(1.0), own_flow(0.0), swept_rate(model, side, at)
    now, is_choked = xp.where(is_on, opened, closed), chokes(at.pressure, supply)

    def kept(pressure: Array, line: Array) -> Array:
        """Whether the regime is that of the point."""
        return chokes(pressure, line) == is_choked

    # Slopes are taken within a regime: over its boundary the flow jumps.
    low, high = at.pressure - spread, at.pressure + spread
    low = xp.where(kept(low, supply), low, at.pressure)
    high = xp.where(kept(high, supply), high, at.pressure)
    over_pressure = (rate(high, supply) - rate(low, supply)) / (high - low)
    lower, upper = supply - spread, supply + spread
    lower = xp.where(kept(at.pressure, lower), lower, supply)
    upper = xp.where(kept(at.pressure, upper), upper, supply)
    over_supply = (rate(at.pressure, upper) - rate(at.pressure, lower)) / (upper - lower)
    per_flow = rate_per_flow(model, side, at.position)
    atmosphere: Any = model.parameters.atmosphere
    squares = at.pressure * at.pressure
    by_flow = now - swept
    slopes = (
        -scales[0] * per_flow * (squares - at.other * at.other),
        -scales[1] * per_flow * (squares - atmosphere * atmosphere),
        0.0 * per_flow,
        0.0 * per_flow,
        scales[4] * over_supply,
        scales[5] * xp.where(is_on & is_choked, by_flow, 0.0),
        scales[6] * xp.where(is_on & ~is_choked, by_flow, 0.0),
        scales[7] * xp.where(~is_on & is_choked, by_flow, 0.0),
        scales[8] * xp.where(~is_on & ~is_choked, by_flow, 0.0),
    )
    edge = opened - closed
    jumps = (-scales[2] * at.opened * edge, scales[3] * at.closed * edge)
    boundary = xp.where(is_on, choked[0], choked[1])
    return ChamberTerms(now, over_pressure, slopes, jumps, per_flow, boundary)


__all__ = [
    "PAST",
    "ChamberPoint",
    "ChamberTerms",
    "Noise",
    "chamber_rate",
    "chamber_terms",
    "past_boundary",
    "rate_per_flow",
    "shaft_effort",
    "swept_rate",
]
