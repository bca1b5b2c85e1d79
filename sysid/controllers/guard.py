"""Letting go: what a controller does in a tick in which a number is not finite.

One NaN would close its valves or open them fully, by the side of a comparison on which it falls,
and would stay in what it remembers. Instead it commands nothing (motor 0, valves off), remembers
what it did before, and counts the tick. An arm in the vertical falls then.
"""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from sysid.controllers.interface import Commands, Controller, Reference, StateEstimate
from sysid.plant.base import Array, Parameters, array_namespace
from sysid.surfaces.hull import FlowLaw


def known(value: Array) -> Array:
    """The value where it is finite, else NaN: before a limit, which would hide an overflow."""
    xp = array_namespace(value)
    return xp.where(xp.isfinite(value), value, xp.nan)


def all_finite(values: Iterable[Array]) -> Array:
    """Whether all values are finite, by lane: each a number, (lanes,) or (any, lanes)."""
    sums: dict[tuple[int, ...], Array] = {}
    found: Array = True
    with np.errstate(invalid="ignore"):
        for value in values:
            shape = np.shape(value)
            sums[shape] = sums.get(shape, 0.0) + 0.0 * value
        for shape, total in sums.items():
            xp = array_namespace(total)
            # The compiler works a sum, or a chain of flags, out anew wherever it is used, and a
            # root once: without it the program of a loop is twice as long.
            flags = xp.isfinite(xp.sqrt(total))
            found = found & (flags.all(axis=0) if len(shape) > 1 else flags)
    return found


def rows_of(reference: Reference, preview: int) -> Iterator[Array]:
    """A reference's numbers now, (lanes,), and those of `preview` ticks ahead, (preview, lanes)."""
    yield from reference[:4]
    if reference.ahead is not None:
        yield from (row[:preview] for row in reference.ahead[:4])


def gains_of(value: Any) -> Iterator[Array]:
    """The numbers, each one or (lanes,), of a controller with its estimator and its model.

    A motor without a limit has an infinite one. Tables and surfaces are omitted: the values read
    from them enter the commands.
    """
    if isinstance(value, FlowLaw):
        return
    if isinstance(value, Parameters):
        limit = value.max_effort
        xp = array_namespace(limit)
        value = value.replace(max_effort=xp.where(limit == np.inf, 0.0, limit))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = [getattr(value, field.name) for field in dataclasses.fields(value)]
    if isinstance(value, tuple | list):
        for part in value:
            yield from gains_of(part)
    elif isinstance(value, float) or (hasattr(value, "dtype") and np.ndim(value) <= 1):
        yield value


def let_go(good: Array, before: Any, after: Any, commands: Commands) -> tuple[Any, Commands]:
    """The state and the commands: in lanes that are not `good`, the state as it was and no command.

    `before` and `after` are memories as `Controller.start` gives them; a memory with a field
    `rejected` counts there the ticks that were not good.
    """
    xp = array_namespace(good, commands.motor)
    none = xp.where(good, 0.0, 0.0)
    motor, a, b = (none + xp.where(good, c, 0.0) for c in commands[:3])
    if xp is np and (np.all(good) or not np.any(good)):
        kept = after if np.all(good) else before
    else:
        kept = _chosen(good, before, after)
    if hasattr(before, "rejected"):
        kept = kept._replace(rejected=before.rejected + xp.where(good, 0.0, 1.0))
    return kept, Commands(motor, a, b, none + xp.where(good, commands.payload_kg, xp.nan))


def _chosen(good: Array, before: Any, after: Any) -> Any:
    """`after` in the lanes that are good, else `before`: arrays, and tuples, lists, dicts of them.

    An array's lanes are its last axis, else its first; one without lanes is kept as a whole.
    Anything else is as it is after.
    """
    if isinstance(after, tuple | list) and type(before) is type(after):
        parts = [_chosen(good, *pair) for pair in zip(before, after, strict=True)]
        return type(after)(*parts) if hasattr(after, "_fields") else type(after)(parts)
    if isinstance(after, dict) and isinstance(before, dict):
        return {k: _chosen(good, before[k], v) if k in before else v for k, v in after.items()}
    if not (hasattr(after, "dtype") or isinstance(after, float | int)):
        return after
    xp = array_namespace(good, before, after)
    shape, lanes = np.shape(after), np.shape(good)
    if lanes and shape[-1:] != lanes:
        is_first = shape[:1] == lanes
        good = good.reshape(lanes + (1,) * (len(shape) - 1)) if is_first else good.all()
    return xp.where(good, after, before)


class GuardedController(Controller):
    """A controller with a safe output: it implements `law`, and its memory has a field `rejected`.

    `rejected` counts the ticks in which the estimate, the reference, a gain, a parameter of its
    model, its memory, or what follows from these was not finite.
    """

    @abstractmethod
    def law(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        """`commands` of numbers that are finite."""

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        """See `Controller`; where something is not finite: motor 0, valves off, memory kept.

        An empty memory is that of a start.
        """
        memory = memory or self.start(np.size(estimate.position))
        with np.errstate(all="ignore"):
            after, commands = self.law(memory, estimate, reference)
        read = [*estimate[1:], *rows_of(reference, self.preview), *gains_of(self), *memory]
        return let_go(all_finite([*read, *after, *commands[:3]]), memory, after, commands)


__all__ = [
    "GuardedController",
    "all_finite",
    "gains_of",
    "known",
    "let_go",
    "rows_of",
]
