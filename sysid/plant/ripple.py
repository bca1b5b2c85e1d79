"""The ripple of a chamber's pressure within a PWM period, as the mean-flow models add it."""

from __future__ import annotations

from typing import NamedTuple

from sysid.plant.base import Array
from sysid.plant.jax_setup import jnp


class Ripple(NamedTuple):
    """A chamber's ripple during a sub-step (see `pulse_means`), arrays (runs,).

    `swing` Pa per share of a period; `start` at the sub-step's start, `slope` per s and `mean`
    over the period, in shares of a period; `begins`: the time of that start, s. `bend`: height
    on a straight ramp (0 to 1) and in truth at which the ramp in force bends.
    """

    swing: Array
    start: Array
    slope: Array
    mean: Array
    begins: Array
    bend: tuple[Array, Array]

    def at(self, time: Array) -> Array:
        """How far the pressure is above that at the ends of the period, Pa."""
        straight = self.start + self.slope * (time - self.begins)
        height = 2.0 * self.mean
        place = straight / jnp.where(height > 0.0, height, 1.0)
        over, true = self.bend
        bump = jnp.minimum(
            place / jnp.where(over > 0.0, over, 1.0),
            (1.0 - place) / jnp.where(over < 1.0, 1.0 - over, 1.0),
        )
        return self.swing * (straight + height * (true - over) * jnp.maximum(bump, 0.0))


__all__ = ["Ripple"]
