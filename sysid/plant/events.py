"""Events within a step: cubics over its share, and the first of several to change sign."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from sysid.plant.base import Array
from sysid.plant.jax_setup import jax, jnp

_Result = TypeVar("_Result")
# Keeps a quotient finite where its result is not used.
_TINY = 1e-300


def apart(always: Array, function: Callable[[], _Result], like: _Result) -> _Result:
    """function(), compiled separately from the code that uses its results, shaped `like` this.

    XLA computes a value that several expressions share anew in each of them, stage upon
    stage, which makes a step several times slower. It does not optimise across a branch:
    `always` (a scalar) is true, which XLA does not know.
    """
    empty = jax.tree.map(jnp.zeros_like, like)
    result: _Result = jax.lax.cond(always, function, lambda: empty)
    return result


class Cubic(NamedTuple):
    """c0 + c1 s + c2 s^2 + c3 s^3 over the share s of a step."""

    c0: Array
    c1: Array
    c2: Array
    c3: Array

    def __call__(self, s: Array) -> Array:
        return self.c0 + s * (self.c1 + s * (self.c2 + s * self.c3))

    def distance(self, sign: Array, origin: Array | float = 0.0) -> Cubic:
        """The cubic's distance from `origin`, times `sign`."""
        return Cubic(sign * (self.c0 - origin), sign * self.c1, sign * self.c2, sign * self.c3)


@jax.jit  # traced once for all states
def kutta_cubic(start: Array, k1: Array, k2: Array, k3: Array, step: Array) -> Cubic:
    """Kutta's third-order method as a cubic in the share of the step (order 2 within)."""
    return Cubic(
        start,
        step * k1,
        step * (2.0 * k2 - 1.5 * k1 - 0.5 * k3),
        step * (2.0 / 3.0) * (k1 - 2.0 * k2 + k3),
    )


def _about(cubic: Cubic) -> Array:
    """About the share of the step at which a cubic that starts positive turns negative.

    2 where it does not; else the root of the parabola through its start, middle and end.
    """
    slope = cubic.c1 - 0.5 * cubic.c3
    bend = cubic.c2 + 1.5 * cubic.c3
    wide = jnp.sqrt(jnp.abs(slope * slope - 4.0 * bend * cubic.c0))
    # Of the formula's two forms the one that does not cancel.
    rises = slope > 0
    top = jnp.where(rises, slope + wide, 2.0 * cubic.c0)
    bottom = jnp.where(rises, -2.0 * bend, wide - slope)
    end = cubic.c0 + cubic.c1 + cubic.c2 + cubic.c3
    return jnp.where(end < 0, top / (bottom + _TINY), 2.0)


def _root(cubic: Cubic, s: Array) -> Array:
    """Root of a cubic in [0, 1] near s, by Newton's method."""
    for _ in range(2):
        slope = cubic.c1 + s * (2.0 * cubic.c2 + s * 3.0 * cubic.c3)
        s = s - cubic(s) / (slope - _TINY)
        s = jnp.where(s > 0, jnp.where(s < 1, s, 1.0), 0.0)
    return s


def first_event(events: list[Cubic], always: Array) -> tuple[Array, list[Array]]:
    """Share of the step at the first event (2: none), and whether each event is the one.

    Where no run meets one in the step, nothing is computed.
    """
    events = apart(always, lambda: events, events)
    ends = [event.c0 + event.c1 + event.c2 + event.c3 < 0 for event in events]
    needed = jnp.any(functools.reduce(jnp.logical_or, ends))
    none = jnp.full_like(events[0].c0, 2.0), [jnp.zeros_like(end) for end in ends]
    found: tuple[Array, list[Array]] = jax.lax.cond(
        needed, lambda: _first(events, always), lambda: none
    )
    return found


def _first(events: list[Cubic], always: Array) -> tuple[Array, list[Array]]:
    every = Cubic(*(jnp.stack(of) for of in zip(*events, strict=True)))
    near = apart(always, lambda: _about(every), every.c0)

    def sooner() -> tuple[Array, Cubic]:
        first, chosen = near[0], events[0]
        for share, event in zip(near[1:], events[1:], strict=True):
            earlier = share < first
            first = jnp.where(earlier, share, first)
            chosen = Cubic(*(jnp.where(earlier, *of) for of in zip(event, chosen, strict=True)))
        return first, chosen

    first, chosen = apart(always, sooner, (near[0], events[0]))
    occurs = first < 1.0
    at = apart(always, lambda: jnp.where(occurs, _root(chosen, first), 2.0), first)
    return at, [occurs & (share == first) for share in near]


__all__ = ["Cubic", "apart", "first_event", "kutta_cubic"]
