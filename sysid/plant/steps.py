"""One step of states whose inputs are given (sampled): Heun's, and Rodas3 for stiff ones.

Motion with dry friction, choking and stops has events within a step and goes through `stepper`.
States are sequences of numbers or arrays of any array library; Rodas3's, (s,), are jax's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from sysid.plant.base import Array


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

    Without pivoting: twice the inverse step stands on the diagonal.
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


__all__ = ["heun", "rodas3"]
