"""Loops and branches that serve numpy and jax alike, and dataclasses taken apart into numbers.

A controller is written once: called with numpy arrays it runs as it stands, called with jax
arrays it becomes part of a compiled loop.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import numpy as np

from sysid.plant.base import Array, array_namespace

Carry = TypeVar("Carry")


def _is_compiled(value: Array) -> bool:
    return array_namespace(value) is not np


def _is_traced(value: Array) -> bool:
    """Whether a value is a name of C text, whose library writes loops down (`loop`)."""
    return hasattr(array_namespace(value), "loop")


def repeat(count: int, body: Callable[[Any, Carry], Carry], carry: Carry, like: Array) -> Carry:
    """body(i, carry) for i = 0 to count - 1; `like` is an array of the library in use."""
    if not _is_compiled(like):
        for i in range(count):
            carry = body(i, carry)
        return carry
    if _is_traced(like):
        names: Carry = array_namespace(like).loop(count, body, carry)
        return names
    from sysid.plant.jax_setup import jax

    result: Carry = jax.lax.fori_loop(0, count, body, carry)
    return result


def until(
    most: int,
    body: Callable[[Carry], Carry],
    carry: Carry,
    is_done: Callable[[Carry], Array],
    like: Array,
) -> Carry:
    """body(carry) until `is_done` of every lane, `most` times at most; `like` as in `repeat`."""
    if not _is_compiled(like):
        for _ in range(most):
            if np.all(is_done(carry)):
                break
            carry = body(carry)
        return carry
    if _is_traced(like):
        names: Carry = array_namespace(like).loop(most, lambda _, c: body(c), carry, is_done)
        return names
    from sysid.plant.jax_setup import jax, jnp

    def goes_on(numbered: tuple[Array, Carry]) -> Array:
        count, carry = numbered
        return (count < most) & ~jnp.all(is_done(carry))

    def step(numbered: tuple[Array, Carry]) -> tuple[Array, Carry]:
        return numbered[0] + 1, body(numbered[1])

    result: Carry = jax.lax.while_loop(goes_on, step, (0, carry))[1]
    return result


def when(condition: Array, then: Callable[[], Carry], otherwise: Carry, like: Array) -> Carry:
    """then() if the scalar `condition` holds, else `otherwise`; both of the same shapes."""
    if not _is_compiled(like):
        return then() if condition else otherwise
    from sysid.plant.jax_setup import jax

    result: Carry = jax.lax.cond(condition, then, lambda: otherwise)
    return result


# --- dataclasses as structure and numbers ------------------------------------------------

_NUMBER = (float, np.floating, np.ndarray)


@dataclasses.dataclass(frozen=True, eq=False)
class _ByIdentity:
    """An object compared by identity: it may change, or hold what cannot be hashed."""

    value: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and self.value is other.value

    def __hash__(self) -> int:
        return id(self.value)


def take_apart(value: Any) -> tuple[Any, list[Array]]:
    """A hashable structure of `value` and its numbers, in order.

    Frozen dataclasses and tuples are followed into; floats and arrays are numbers; anything
    else, whole numbers and strings among it, belongs to the structure: a dataclass that is not
    frozen stays the object that it is. `put_together` is the inverse.
    """
    numbers: list[Array] = []

    def walk(value: Any) -> Any:
        if isinstance(value, _NUMBER):
            numbers.append(value)
            return "number"
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            if not value.__dataclass_params__.frozen:  # type: ignore[attr-defined]
                return ("held", _ByIdentity(value))
            fields = dataclasses.fields(value)
            return (type(value), tuple((f.name, walk(getattr(value, f.name))) for f in fields))
        if isinstance(value, tuple):
            return ("tuple", tuple(walk(v) for v in value))
        return ("fixed", value)

    return walk(value), numbers


def put_together(structure: Any, numbers: Sequence[Array]) -> Any:
    """Rebuild what `take_apart` took apart."""
    rest = iter(numbers)

    def build(structure: Any, rest: Iterator[Array]) -> Any:
        if structure == "number":
            return next(rest)
        kind, content = structure
        if kind == "fixed":
            return content
        if kind == "held":
            return content.value
        if kind == "tuple":
            return tuple(build(part, rest) for part in content)
        return kind(**{name: build(part, rest) for name, part in content})

    return build(structure, rest)


def stacked(values: Sequence[list[Array]]) -> list[Array]:
    """Numbers of several instances of one structure, each with the lanes as its first axis."""
    return [
        np.stack([np.asarray(v, dtype=float) for v in column])
        for column in zip(*values, strict=True)
    ]


__all__ = ["put_together", "repeat", "stacked", "take_apart", "until", "when"]
