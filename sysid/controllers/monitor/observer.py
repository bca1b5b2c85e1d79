"""One sample of the observers of a chamber and of the shaft: Kalman filters with their slopes.

Each carries how what it expects moves with every drift, so that an innovation and its slopes are
one row of the normal equations of the drifts (the recursive prediction error method; Ljung, System
Identification, 1999, 11.4; of a change: Basseville and Nikiforov, Detection of Abrupt Changes,
1993, 7.2). Of any array library. Drifts are in the scales of the design.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sysid.controllers.monitor.terms import ChamberTerms
from sysid.plant.base import Array, array_namespace

SURE = 3.0
"""Beyond this many standard deviations it is certain that the shaft moves, by its velocity, and
that a pressure is not where it is expected."""
CLIP = 20.0
"""An innovation beyond this many standard deviations counts as one of that size, its slopes in
proportion: a spike is no evidence, and a drift keeps its shape."""
LOGISTIC = 1.702
"""A normal distribution's standard deviation in scales of the logistic one nearest to it."""
NARROW = 1e-2
"""Of the logistic distribution's scale: within less, its function is taken in the middle."""


class ChamberState(NamedTuple):
    """Expected pressure, Pa, its variance, and its slopes over `drifts.CHAMBER`."""

    pressure: Array
    variance: Array
    slopes: tuple[Array, ...]


class ShaftState(NamedTuple):
    """Expected position and velocity, their covariance, and their slopes over `drifts.SHAFT`."""

    position: Array
    velocity: Array
    var_position: Array
    covariance: Array
    var_velocity: Array
    position_slopes: tuple[Array, ...]
    velocity_slopes: tuple[Array, ...]


class Innovation(NamedTuple):
    """What a reading shows: over its standard deviation, limited; its slopes likewise."""

    value: Array
    slopes: tuple[Array, ...]


def chamber_start(pressure: Array, noise_variance: Array) -> ChamberState:
    """At a reading."""
    return ChamberState(pressure, noise_variance + 0.0 * pressure, (0.0 * pressure,) * 9)


def chamber_switched(state: ChamberState, jumps: tuple[Array, Array]) -> ChamberState:
    """As the valve moves: what a delay that has changed would have moved, `ChamberTerms.jumps`."""
    s = state.slopes
    return state._replace(slopes=(*s[:2], s[2] + jumps[0], s[3] + jumps[1], *s[4:]))


def chamber_ahead(
    state: ChamberState, terms: ChamberTerms, duration: Array, swept: Array
) -> ChamberState:
    """A stretch later: the exponential Euler step, exact where the rate is linear in the pressure.

    `duration` s of the stretch. `swept`: what the position's errors sweep in it, standard
    deviation, Pa per Pa/kg of `per_flow` and Pa of pressure.
    """
    gain = _gain(terms, duration)
    carried = 1.0 + gain * terms.over_pressure
    moved = swept * terms.per_flow * state.pressure
    return ChamberState(
        state.pressure + gain * terms.rate,
        carried * carried * state.variance + moved * moved,
        tuple(
            carried * own + gain * slope
            for own, slope in zip(state.slopes, terms.slopes, strict=True)
        ),
    )


def _gain(terms: ChamberTerms, duration: Array) -> Array:
    """What a rate counts over a stretch, s: the exponential Euler step's."""
    xp = array_namespace(terms.rate)
    z = duration * terms.over_pressure
    is_small = abs(z) < 1e-4
    return duration * xp.where(is_small, 1.0 + 0.5 * z, xp.expm1(z) / xp.where(is_small, 1.0, z))


def chamber_bent(
    before: ChamberState,
    ahead: ChamberState,
    terms: ChamberTerms,
    beyond: Array,
    duration: Array,
) -> ChamberState:
    """`ahead` where the flow changes at the choked boundary: `beyond` is the rate past it, Pa/s.

    What the other rate moves more than the expected pressure's own counts for the share of the
    stretch in which the pressure is past the boundary, in the mean over where it may be: of a
    logistic distribution in place of the normal one. Seen from the boundary, what is on the own
    side moves by the own rate as far as this leads there, and what is past it by the other as far
    as that leads back, so that the share is the mean of that between the two.
    """
    xp = array_namespace(before.pressure, ahead.pressure)
    way = xp.where(before.pressure < terms.boundary, 1.0, -1.0)
    scale = xp.sqrt(ahead.variance) / LOGISTIC
    gain = _gain(terms, duration) * way / scale
    begun = way * (before.pressure - terms.boundary) / scale
    low = begun + xp.minimum(gain * beyond, 0.0)
    high = begun + xp.maximum(gain * terms.rate, 0.0)
    share, density = _past(low, high)
    more = gain * (beyond - terms.rate)
    bend = 1.0 + more * density
    return ChamberState(
        ahead.pressure + way * scale * more * share,
        bend * bend * ahead.variance,
        tuple(bend * s for s in ahead.slopes),
    )


def _past(low: Array, high: Array) -> tuple[Array, Array]:
    """The logistic function's mean from low to high, and the mean of its slope."""
    xp = array_namespace(low, high)
    width = high - low
    is_small = width < NARROW
    apart = xp.where(is_small, 1.0, width)
    above, under = (0.5 + 0.5 * xp.tanh(0.5 * x) for x in (high, low))
    middle = 0.5 + 0.5 * xp.tanh(0.25 * (low + high))
    mean = (_softplus(high) - _softplus(low)) / apart
    return (
        xp.where(is_small, middle, mean),
        xp.where(is_small, middle * (1.0 - middle), (above - under) / apart),
    )


def _softplus(x: Array) -> Array:
    """log(1 + e^x), by exp and log1p of what is not above 0."""
    xp = array_namespace(x)
    return xp.maximum(x, 0.0) + xp.log1p(xp.exp(-abs(x)))


def chamber_lost(
    state: ChamberState, reading: Array, noise_variance: Array, boundary: Array
) -> Array:
    """Whether a reading shows that the pressure is on the other side of the choked boundary.

    Where the rates lead away from it, or one barely towards it, a small error of what is expected
    decides for one of the two flows, and what is expected leaves what is read for good.
    """
    xp = array_namespace(state.pressure, reading)
    is_far = abs(reading - state.pressure) > SURE * xp.sqrt(state.variance + noise_variance)
    return is_far & ((reading < boundary) != (state.pressure < boundary))


def chamber_seen(
    state: ChamberState, reading: Array, noise_variance: Array
) -> tuple[ChamberState, Innovation]:
    """The state after a reading, and what this showed."""
    xp = array_namespace(state.pressure, reading)
    whole = state.variance + noise_variance
    part = 1.0 / xp.sqrt(whole)
    gap = reading - state.pressure
    gain = state.variance / whole
    after = ChamberState(
        state.pressure + gain * gap,
        (1.0 - gain) * state.variance,
        tuple((1.0 - gain) * s for s in state.slopes),
    )
    return after, _shown(part, gap, state.slopes)


def shaft_start(position: Array, noise_variance: Array, speed_variance: Array) -> ShaftState:
    """At a reading, the velocity not known."""
    none = 0.0 * position
    return ShaftState(
        position,
        none,
        noise_variance + none,
        none,
        speed_variance + none,
        (none,) * 4,
        (none,) * 4,
    )


class ShaftNumbers(NamedTuple):
    """Of the shaft: inertia, viscous friction, `breakaway` effort, `variance` of the acceleration
    by the pressures' noise, and `travel`: the position beyond which a stop may touch."""

    inertia: Array
    viscous: Array
    breakaway: Array
    variance: Array
    travel: Array


def shaft_moves(state: ShaftState, numbers: ShaftNumbers) -> Array:
    """Whether the shaft slides, in a known direction, between the stops."""
    xp = array_namespace(state.velocity)
    sure = abs(state.velocity) > SURE * xp.sqrt(state.var_velocity)
    return sure & (abs(state.position) < numbers.travel)


def shaft_ahead(
    state: ShaftState,
    effort: Array,
    period: Array,
    numbers: ShaftNumbers,
    scales: Sequence[Array],
) -> ShaftState:
    """A sample later; `scales` (4,) of the drifts.

    Where the shaft may rest, or touches a stop, its acceleration is unknown.
    """
    xp = array_namespace(state.velocity, effort)
    moves = shaft_moves(state, numbers)
    # Viscous friction by the velocity in the middle of the sample.
    inert = numbers.inertia + 0.5 * period * numbers.viscous
    acceleration = xp.where(moves, effort / inert, 0.0)
    free = (abs(effort) + 2.0 * numbers.breakaway) / numbers.inertia
    spread = xp.where(moves, numbers.variance, free * free)
    way = xp.sign(state.velocity)
    slopes = (
        -scales[0] * way / numbers.inertia,
        -scales[1] * (state.velocity + 0.5 * period * acceleration) / numbers.inertia,
        scales[2] / numbers.inertia + 0.0 * way,
        -scales[3] * acceleration,
    )
    half = 0.5 * period * period
    cross = state.covariance + period * state.var_velocity
    known = xp.where(moves, 1.0, 0.0)
    return ShaftState(
        state.position + period * state.velocity + half * acceleration,
        state.velocity + period * acceleration,
        state.var_position + period * (state.covariance + cross) + half * half * spread,
        cross + half * period * spread,
        state.var_velocity + period * period * spread,
        tuple(
            known * (x + period * v + half * s)
            for x, v, s in zip(state.position_slopes, state.velocity_slopes, slopes, strict=True)
        ),
        tuple(known * (v + period * s) for v, s in zip(state.velocity_slopes, slopes, strict=True)),
    )


def shaft_seen(
    state: ShaftState, reading: Array, noise_variance: Array
) -> tuple[ShaftState, Innovation]:
    """The state after a reading, and what this showed."""
    xp = array_namespace(state.position, reading)
    whole = state.var_position + noise_variance
    part = 1.0 / xp.sqrt(whole)
    gap = reading - state.position
    to_position, to_velocity = state.var_position / whole, state.covariance / whole
    x, v = state.position_slopes, state.velocity_slopes
    after = ShaftState(
        state.position + to_position * gap,
        state.velocity + to_velocity * gap,
        (1.0 - to_position) * state.var_position,
        (1.0 - to_position) * state.covariance,
        state.var_velocity - to_velocity * state.covariance,
        tuple((1.0 - to_position) * s for s in x),
        tuple(b - to_velocity * a for a, b in zip(x, v, strict=True)),
    )
    return after, _shown(part, gap, x)


def _shown(part: Array, gap: Array, slopes: Sequence[Array]) -> Innovation:
    """What a gap shows; `part`: one over its standard deviation."""
    xp = array_namespace(gap)
    weight = part * CLIP / xp.maximum(abs(part * gap), CLIP)
    return Innovation(weight * gap, tuple(weight * s for s in slopes))


__all__ = [
    "CLIP",
    "LOGISTIC",
    "NARROW",
    "SURE",
    "ChamberState",
    "Innovation",
    "ShaftNumbers",
    "ShaftState",
    "chamber_ahead",
    "chamber_bent",
    "chamber_lost",
    "chamber_seen",
    "chamber_start",
    "chamber_switched",
    "shaft_ahead",
    "shaft_moves",
    "shaft_seen",
    "shaft_start",
]
