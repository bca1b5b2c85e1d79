"""A chamber about to reach the supply pressure: dD/dt = -K sign(D) sqrt(|D|) + g, D = Ps - P.

Stiff without bound as D -> 0, and there in finite time: explicit methods chatter around it.
Alexander's L-stable method of order 3 (SIAM J. Numer. Anal. 14, 1977) is implicit, but each
of its stages is a quadratic equation here, with one root.
"""

from __future__ import annotations

from sysid.plant.base import Array
from sysid.plant.jax_setup import jax, jnp

# Alexander's gamma, and the third row, which is the weights.
GAMMA = 0.43586652150845899942
SECOND = (1.0 - GAMMA) / 2.0
THIRD = (
    (-6.0 * GAMMA**2 + 16.0 * GAMMA - 1.0) / 4.0,
    (6.0 * GAMMA**2 - 20.0 * GAMMA + 5.0) / 4.0,
)


@jax.jit
def _implicit_root(known: Array, stiffness: Array) -> Array:
    """z with z|z| + stiffness z = known."""
    size = jnp.abs(known)
    # What cancels here is far below a pressure that counts.
    root = 0.5 * (jnp.sqrt(stiffness * stiffness + 4.0 * size) - stiffness)
    return jnp.where(known < 0, -root, root)


@jax.jit  # traced once for both chambers
def gap_change(gap: Array, stiffness: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Change of D over a step of dD/dt = -K sqrt(D) sign(D) + g, by Alexander's method.

    `stiffness` is h K and `other` h g at the step's start and end; Pa^0.5 and Pa.
    """

    part = 0.5  # the method takes a step in two halves

    def stage(start: Array, at: float) -> Array:
        k = part * (stiffness[0] + at * (stiffness[1] - stiffness[0]))
        g = part * (other[0] + at * (other[1] - other[0]))
        return g - k * _implicit_root(start + GAMMA * g, GAMMA * k)

    now = gap
    for begun in range(2):
        first = stage(now, part * (begun + GAMMA))
        second = stage(now + SECOND * first, part * (begun + GAMMA + SECOND))
        third = stage(now + THIRD[0] * first + THIRD[1] * second, part * (begun + 1.0))
        now = now + THIRD[0] * first + THIRD[1] * second + GAMMA * third
    return now - gap


__all__ = ["GAMMA", "SECOND", "THIRD", "gap_change"]
