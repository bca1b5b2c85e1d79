"""One step of states whose inputs are given (sampled): Heun's, Rodas3 for stiff ones, and a
fourth-order one for states of which some relax at a known rate.

Motion with dry friction, choking and stops has events within a step and goes through `stepper`.
States are sequences of numbers or arrays of any array library; Rodas3's, (s,), are jax's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sysid.plant.base import Array, is_zero
from sysid.types import FloatArray

# Below it the functions of an exponential step are series, of these factors from the last on.
_SERIES = 0.5
_SERIES_FACTORS = tuple(1.0 / math.factorial(k + 3) for k in reversed(range(11)))


def heun(
    state: Sequence[Array],
    slopes: Sequence[Array],
    slopes_then: Callable[[Sequence[Array]], Sequence[Array]],
    step: Array,
) -> tuple[Array, ...]:
    """States after `step` s, of order 2: `slopes` at its start, `slopes_then` those at its end."""
    trial = [s + step * r for s, r in zip(state, slopes, strict=True)]
    pairs = zip(state, slopes, slopes_then(trial), strict=True)
    return tuple(s + 0.5 * step * (r + q) for s, r, q in pairs)


def relaxing_step(
    state: Sequence[Array],
    rates: Sequence[Array],
    decays: Sequence[Array],
    rates_at: Callable[[float, Sequence[Array]], Sequence[Array]],
    step: float,
) -> tuple[Array, ...]:
    """States after `step` s, of order 4; those that relax at `decays` (1/s) at any such rate.

    `rates` at the start, `rates_at` a share of the step later. With no decay it is Runge and
    Kutta's; the part -decay x state is integrated exactly (Cox, Matthews, J. Comput. Phys. 176
    (2002) 430-455), so that what follows its surroundings at once needs no short steps. numpy only.
    """
    # What does not decay is moved without the products and sums that would leave it as it is.
    gains = [None if is_zero(d) else _gains(step, np.asarray(d, dtype=float)) for d in decays]
    half, sixth, third_of = 0.5 * step, step / 6.0, step / 3.0

    def driven(values: Sequence[Array], slopes: Sequence[Array]) -> list[Array]:
        found = zip(values, slopes, decays, gains, strict=True)
        return [r if g is None else r + d * v for v, r, d, g in found]

    def moved(values: Sequence[Array], by: Sequence[Array]) -> list[Array]:
        found = zip(values, by, gains, strict=True)
        return [v + half * f if g is None else g[0] * v + g[1] * f for v, f, g in found]

    first = driven(state, rates)
    one = moved(state, first)
    second = driven(one, rates_at(0.5, one))
    two = moved(state, second)
    third = driven(two, rates_at(0.5, two))
    three = moved(one, [2.0 * t - f for t, f in zip(third, first, strict=True)])
    fourth = driven(three, rates_at(1.0, three))
    return tuple(
        v + sixth * a + third_of * (b + c) + sixth * d
        if g is None
        else g[2] * v + g[3] * a + g[4] * (b + c) + g[5] * d
        for v, a, b, c, d, g in zip(state, first, second, third, fourth, gains, strict=True)
    )


def _free_gains(step: float) -> tuple[float, ...]:
    """`_gains` of what does not decay."""
    return 1.0, 0.5 * step, 1.0, step / 6.0, step / 3.0, step / 6.0


def _gains(step: float, decay: FloatArray) -> tuple[Any, ...]:
    """Of half a step the decay and the gain, s; of a step the decay and the stages' weights, s."""
    if not np.any(decay):
        return _free_gains(step)
    x = -step * decay
    (one, half), (two, _), (three, _) = _phi(np.stack((x, 0.5 * x)))
    weights = one - 3.0 * two + 4.0 * three, 2.0 * (two - 2.0 * three), 4.0 * three - two
    return np.exp(0.5 * x), 0.5 * step * half, np.exp(x), *(step * w for w in weights)


def _phi(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(e^x - 1) / x and its two successors, (phi - 1 / k!) / x, to rounding for x <= 0."""
    small = np.abs(x) < _SERIES
    if small.all():
        return _phi_near(x)
    far = np.where(small, -1.0, x)
    one = np.expm1(far) / far
    two = (one - 1.0) / far
    three = (two - 0.5) / far
    if not small.any():
        return one, two, three
    near = _phi_near(np.where(small, x, 0.0))
    return (
        np.where(small, near[0], one),
        np.where(small, near[1], two),
        np.where(small, near[2], three),
    )


def _phi_near(z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same by its series, for small arguments."""
    three: FloatArray = np.zeros_like(z)
    for factor in _SERIES_FACTORS:
        np.multiply(three, z, out=three)
        three += factor
    two = z * three + 0.5
    return z * two + 1.0, two, three


def rodas3(rate: Callable[[Any], Any], x: Any, h: Any) -> Any:
    """The change of states (s,) over a step of h s; 0 where h is 0.

    Of order 3 and L-stable (Sandu et al., Atmos. Environ. 31 (1997) 3459-3472).
    """
    from sysid.plant.jax_setup import jax, jnp

    per_step = 1.0 / jnp.where(h > 0.0, h, 1.0)
    slope = jax.jacfwd(rate)(x)
    matrix = 2.0 * per_step * jnp.eye(x.shape[0]) - slope
    solve = _solver(matrix)
    here = rate(x)
    u1 = solve(here)
    u2 = solve(here + 4.0 * per_step * u1)
    u3 = solve(rate(x + 2.0 * u1) + per_step * (u1 - u2))
    u4 = solve(rate(x + 2.0 * u1 + u3) + per_step * (u1 - u2 - 8.0 / 3.0 * u3))
    return jnp.where(h > 0.0, 2.0 * u1 + u3 + u4, 0.0)


def _solver(matrix: Any) -> Callable[[Any], Any]:
    """Solves for a small matrix (s, s), eliminated in place: a call of LAPACK costs far more.

    Without pivoting: twice the inverse step is on the diagonal.
    """
    from sysid.plant.jax_setup import jnp

    size = matrix.shape[0]
    rows = [[matrix[i, j] for j in range(size)] for i in range(size)]
    for k in range(size):
        for i in range(k + 1, size):
            rows[i][k] = rows[i][k] / rows[k][k]
            for j in range(k + 1, size):
                rows[i][j] = rows[i][j] - rows[i][k] * rows[k][j]

    def solve(right: Any) -> Any:
        x = [right[i] for i in range(size)]
        for i in range(size):
            for j in range(i):
                x[i] = x[i] - rows[i][j] * x[j]
        for i in reversed(range(size)):
            for j in range(i + 1, size):
                x[i] = x[i] - rows[i][j] * x[j]
            x[i] = x[i] / rows[i][i]
        return jnp.stack(x)

    return solve


__all__ = ["heun", "relaxing_step", "rodas3"]
