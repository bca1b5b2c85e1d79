"""Inversion of a flow law in one variable: the quadratic's branches, and Newton in a bracket."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sysid.plant.arrays import repeat, until
from sysid.plant.base import Array, array_namespace
from sysid.surfaces.hull import Bounded, Saturation
from sysid.types import FloatArray

FlagArray = NDArray[np.uint8]
# Points among which the first crossing is sought, and the most bisection steps that follow.
_SCAN, _MOST_STEPS = 32, 60
# A bracket of this share of the range is a point, and so is where Newton's step was below 2^-40:
# its next is that squared, or two thirds of it where the slope vanishes too.
_RESOLUTION, _LAST_STEP = 2.0**-52, 2.0**-40


def invert_quadratic(
    c2: Array, c1: Array, c0: Array, flow: Array, low: Array, high: Array
) -> Bounded:
    """Duty in [low, high] at which c2 u^2 + c1 u + c0 = flow (thesis 3.7.2, 3.7.3).

    A valve's flow grows with its duty, so the root wanted is on the stretch of [low, high]
    where the parabola rises: there 2 c2 u + c1 = +sqrt(D). Written as
    u = 2 (flow - c0)/(c1 + sqrt(D)) for c1 >= 0 it loses no digits and becomes the linear
    solution as c2 vanishes; for c1 < 0 the printed form loses none. A flow beyond the
    stretch gives its nearer end: an edge of the domain, or the vertex where D < 0. If the
    parabola falls on all of [low, high], the falling root is given and flagged. Where it is
    flat any duty gives the same flow: the lowest.
    """
    xp = array_namespace(c2, c1, c0, flow, low)
    falling = _falls_throughout(c2, c1, low, high)
    # Mirrored in u, a falling parabola rises: u -> -u swaps the ends and the sign of c1.
    b = xp.where(falling, -c1, c1)
    left, right = xp.where(falling, -high, low), xp.where(falling, -low, high)
    bent = c2 != 0.0
    twice = 2.0 * xp.where(bent, c2, 1.0)
    vertex = -b / twice
    inner = bent & (vertex > left) & (vertex < right)
    start = xp.where(inner & (c2 > 0.0), vertex, left)
    stop = xp.where(inner & (c2 < 0.0), vertex, right)
    below = flow < (c2 * start + b) * start + c0
    above = flow > (c2 * stop + b) * stop + c0
    c = c0 - flow
    root_d = xp.sqrt(xp.maximum(b * b - 4.0 * c2 * c, 0.0))
    steep = b + root_d
    rises = steep != 0.0
    linear = xp.where(rises, -2.0 * c / xp.where(rises, steep, 1.0), start)
    u = xp.clip(xp.where(b >= 0.0, linear, (root_d - b) / twice), start, stop)
    u = xp.where(below, start, xp.where(above, stop, u))
    flat = (c2 == 0.0) & (b == 0.0)
    return xp.where(falling, -u, u), {
        Saturation.BELOW: below,
        Saturation.ABOVE: above,
        Saturation.NO_ROOT: inner & ((below & (c2 > 0.0)) | (above & (c2 < 0.0))),
        Saturation.DECREASING: falling | flat,
    }


def _falls_throughout(c2: Array, c1: Array, low: Array, high: Array) -> Array:
    at_low, at_high = 2.0 * c2 * low + c1, 2.0 * c2 * high + c1
    return (at_low <= 0.0) & (at_high <= 0.0) & ((at_low < 0.0) | (at_high < 0.0))


def invert_rising(
    function: Callable[[Array], tuple[Array, Array]], target: Array, low: Array, high: Array
) -> tuple[Array, Array, Array]:
    """The lowest x in [low, high] at which a mostly increasing function(x) = target.

    `function` gives its value and its slope. 32 intervals are searched for the first in
    which the target is reached; Newton's method finds it there, and halves the bracket where a
    step would leave it. A target that is never reached gives the highest point seen.
    Returns x, whether it is reached, and whether it is already exceeded at `low`.
    """
    xp = array_namespace(target, low)
    span, at_low = high - low, function(low)[0]

    def look(k: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
        reached, left, best, highest = carry
        x = low + (k + 1.0) / _SCAN * span
        value = function(x)[0]
        reached = xp.where(value >= target, 1.0, reached)
        better = value > highest
        return (
            reached,
            xp.where(reached > 0.0, left, x),
            xp.where(better, x, best),
            xp.where(better, value, highest),
        )

    first = at_low >= target
    start = 0.0 * target
    begun = xp.where(first, 1.0, 0.0) + start, low + start, low + start, at_low + start
    reached, left, best, _ = repeat(_SCAN, look, begun, target)
    x = bracketed(function, target, (left, left + span / _SCAN), span)
    x = xp.where(first, low, xp.where(reached > 0.0, x, best))
    return x, reached > 0.0, at_low > target


def bracketed(
    function: Callable[[Array], tuple[Array, Array]],
    target: Array,
    bracket: tuple[Array, Array],
    span: Array,
) -> Array:
    """x between a point where function(x) < target and one where it is not, to 2^-52 of `span`."""
    xp = array_namespace(target, span)

    def closer(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        left, right, x, _ = carry
        value, slope = function(x)
        up = value >= target
        left, right = xp.where(up, left, x), xp.where(up, x, right)
        after = x - (value - target) / xp.where(slope == 0.0, 1.0, slope)
        inside = (after >= left) & (after <= right)
        after = xp.where(inside, after, 0.5 * (left + right))
        moved = xp.abs(after - x) / span * (_RESOLUTION / _LAST_STEP)
        return left, right, after, xp.where(inside, moved, (right - left) / span)

    left, right = bracket
    begun = left, right, 0.5 * (left + right), 1.0 + 0.0 * left
    return until(_MOST_STEPS, closer, begun, lambda carry: ~(carry[3] > _RESOLUTION), target)[2]


def evaluated(
    function: Callable[[Array, Array], Bounded], first: object, pressure: object
) -> tuple[FloatArray, FlagArray]:
    """A law's values and `Saturation` flags, in the inputs' common shape.

    NaN, and INVALID alone, where an input is not finite.
    """
    a, p = np.broadcast_arrays(np.asarray(first, dtype=float), np.asarray(pressure, dtype=float))
    shape = a.shape
    a, p = a.ravel(), p.ravel()
    good = np.isfinite(a) & np.isfinite(p)
    with np.errstate(all="ignore"):
        values, reasons = function(np.where(good, a, 0.0), np.where(good, p, 0.0))
    values = np.where(good, values, np.nan)
    flags = np.where(good, flags_of(reasons), np.uint8(Saturation.INVALID))
    return values.reshape(shape), flags.reshape(shape)


def flags_of(reasons: dict[Saturation, Array]) -> FlagArray:
    """Flags of `Saturation` from where each reason holds, all of one shape."""
    flags: FlagArray = np.zeros((), dtype=np.uint8)
    for reason, holds in reasons.items():
        flags = flags | np.where(holds, np.uint8(reason), np.uint8(0))
    return flags
