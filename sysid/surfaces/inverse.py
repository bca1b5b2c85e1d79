"""Inversion of a surface in one variable: the quadratic's branches, and bisection."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sysid.surfaces.domain import Saturation
from sysid.types import FloatArray

FlagArray = NDArray[np.uint8]


def invert_quadratic(
    c2: FloatArray,
    c1: FloatArray,
    c0: FloatArray,
    flow: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> tuple[FloatArray, FlagArray]:
    """Duty in [low, high] at which c2 u^2 + c1 u + c0 = flow (thesis 3.7.2, 3.7.3); all (n,).

    A valve's flow grows with its duty, so the root wanted is on the stretch of [low, high]
    where the parabola rises: there 2 c2 u + c1 = +sqrt(D). Written as
    u = 2 (flow - c0)/(c1 + sqrt(D)) for c1 >= 0 it loses no digits and becomes the linear
    solution as c2 vanishes; for c1 < 0 the printed form loses none. A flow beyond the
    stretch gives its nearer end: an edge of the domain, or the vertex where D < 0. If the
    parabola falls on all of [low, high], the falling root is given and flagged.
    Returns duty (n,) and flags (n,) of `Saturation`.
    """
    falling = _falls_throughout(c2, c1, low, high)
    # Mirrored in u, a falling parabola rises: u -> -u swaps the ends and the sign of c1.
    b = np.where(falling, -c1, c1)
    left = np.where(falling, -high, low)
    right = np.where(falling, -low, high)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        vertex = -b / (2.0 * c2)
    inner = np.isfinite(vertex) & (vertex > left) & (vertex < right)
    start = np.where(inner & (c2 > 0), vertex, left)
    stop = np.where(inner & (c2 < 0), vertex, right)

    below = flow < (c2 * start + b) * start + c0
    above = flow > (c2 * stop + b) * stop + c0
    root = _rising_root(c2, b, c0 - flow)
    u = np.clip(root, start, stop)
    u = np.where(below, start, np.where(above, stop, u))
    u = np.where(np.isnan(u), start, u)  # flat everywhere: any duty gives the same flow
    flat = (c2 == 0) & (b == 0)

    flags = np.where(below, int(Saturation.BELOW), 0) | np.where(above, int(Saturation.ABOVE), 0)
    beyond_vertex = inner & ((below & (c2 > 0)) | (above & (c2 < 0)))
    flags |= np.where(beyond_vertex, int(Saturation.NO_ROOT), 0)
    flags |= np.where(falling | flat, int(Saturation.DECREASING), 0)
    return np.where(falling, -u, u), flags.astype(np.uint8)


def _falls_throughout(
    c2: FloatArray, c1: FloatArray, low: FloatArray, high: FloatArray
) -> NDArray[np.bool_]:
    slope_low, slope_high = 2.0 * c2 * low + c1, 2.0 * c2 * high + c1
    return np.asarray((slope_low <= 0) & (slope_high <= 0) & ((slope_low < 0) | (slope_high < 0)))


def _rising_root(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Root of a u^2 + b u + c at which the slope is +sqrt(D); the vertex where D < 0."""
    root_d = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.where(b >= 0, -2.0 * c / (b + root_d), (root_d - b) / (2.0 * a))
    return np.asarray(u)


def invert_rising(
    function: Callable[[FloatArray], FloatArray],
    target: FloatArray,
    low: FloatArray,
    high: FloatArray,
    scan: int = 33,
    steps: int = 45,
) -> tuple[FloatArray, FlagArray]:
    """x in [low, high] at which a mostly increasing function(x) = target; all (n,).

    A scan of `scan` points finds the first interval in which the target is crossed upward,
    `steps` bisections find it there (to (high - low)/scan/2^steps). A target never reached
    gives the end, or the highest point of the scan, and a flag.
    """
    share = np.linspace(0.0, 1.0, scan)[:, None]
    grid = low + share * (high - low)
    values = np.stack([function(x) for x in grid])
    reached = values >= target
    above = ~reached.any(axis=0)
    first = np.argmax(reached, axis=0)
    below = (first == 0) & ~above & (values[0] > target)

    column = np.arange(len(target))
    left = grid[np.maximum(first - 1, 0), column]
    right = grid[first, column]
    for _ in range(steps):
        middle = 0.5 * (left + right)
        up = function(middle) >= target
        right = np.where(up, middle, right)
        left = np.where(up, left, middle)
    top = grid[np.argmax(values, axis=0), column]
    x = np.where(above, top, np.where(first == 0, low, 0.5 * (left + right)))
    flags = np.where(above, int(Saturation.ABOVE), 0) | np.where(below, int(Saturation.BELOW), 0)
    return x, flags.astype(np.uint8)


def broadcast_inputs(
    first: object, pressure: object
) -> tuple[FloatArray, FloatArray, FlagArray, tuple[int, ...]]:
    """Both as flat float64 of one length, flags for what is not finite, and the shape.

    Values that are not finite are replaced by 0 and must be turned into NaN at the end
    (`finish`), so that no warning arises in between.
    """
    a, p = np.broadcast_arrays(np.asarray(first, dtype=float), np.asarray(pressure, dtype=float))
    shape = a.shape
    a, p = a.ravel(), p.ravel()
    good = np.isfinite(a) & np.isfinite(p)
    flags = np.where(good, 0, int(Saturation.INVALID)).astype(np.uint8)
    return np.where(good, a, 0.0), np.where(good, p, 0.0), flags, shape


def finish(
    values: FloatArray, flags: FlagArray, shape: tuple[int, ...]
) -> tuple[FloatArray, FlagArray]:
    """Values and flags in the caller's shape, NaN and INVALID alone where an input was not
    finite."""
    bad = (flags & int(Saturation.INVALID)) != 0
    values = np.where(bad, np.nan, values)
    flags = np.where(bad, int(Saturation.INVALID), flags).astype(np.uint8)
    return values.reshape(shape), flags.reshape(shape)
