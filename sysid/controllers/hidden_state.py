"""What a user's controller keeps outside its memory: a compiled loop would freeze it at its start.

Found by comparison before and after a run: in the controller itself, however deep, in its classes
and closures, and in the globals and other classes of its file that its methods read.
"""

from __future__ import annotations

import copy
import types
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from sysid.controllers.interface import Controller

_ATOMS = (type(None), bool, int, float, complex, str, bytes, np.generic)
# Their objects do not change, or only in caches; those of jax are compared by identity.
_FIXED = ("sysid", "jax", "jaxlib")


class _Same:
    """Stands for an object that is not inspected further: equal to itself alone."""

    def __init__(self, value: object) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.value is other.value

    def __hash__(self) -> int:
        return id(self.value)


def frozen(value: object) -> Any:
    """A copy of a value's whole content that compares by `==` with a later one.

    One that is nested too deep to be inspected differs from any other.
    """
    try:
        return _frozen(value, {})
    except RecursionError:
        return object()


def _frozen(value: Any, seen: dict[int, Any]) -> Any:
    # `seen` also keeps what was met alive: an id is used again.
    if isinstance(value, _ATOMS):
        return type(value), value
    if id(value) in seen:
        return "again", seen[id(value)][0]
    seen[id(value)] = len(seen), value

    def each(values: Any) -> Any:
        return tuple(_frozen(v, seen) for v in values)

    if isinstance(value, np.ndarray) and value.dtype != object:
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, dict):
        return type(value), tuple(each(item) for item in value.items())
    if isinstance(value, list | tuple):
        return type(value), each(value)
    if isinstance(value, set | frozenset):
        return type(value), frozenset(each(value))
    if isinstance(value, types.FunctionType):
        cells = [c.cell_contents for c in value.__closure__ or () if c != types.CellType()]
        return _Same(value.__code__), each(cells), _frozen(vars(value), seen)
    if isinstance(value, types.GeneratorType):
        return _Same(value), each([] if value.gi_frame is None else [value.gi_frame.f_locals])
    if isinstance(value, type | types.ModuleType) or _is_fixed(type(value)):
        return _Same(value)
    return _reduced(value, seen)


def _reduced(value: Any, seen: dict[int, Any]) -> Any:
    """The parts of any other object, as pickled: attributes, slots, queues, generators."""
    try:
        parts = value.__reduce_ex__(4)
    except Exception:  # whatever a user's class raises: it cannot be inspected
        return _Same(value)
    if isinstance(parts, str):
        return _Same(value)
    content = [tuple(p) if isinstance(p, Iterator) else p for p in parts[1:5]]
    return _Same(type(value)), _frozen(content, seen)


def _is_fixed(cls: type) -> bool:
    return cls.__module__.partition(".")[0] in _FIXED


# --- what a controller shares with others ----------------------------------------------------


class Place(NamedTuple):
    """Something outside the controller that it may change: its name, and how to get and set it."""

    name: str
    get: Callable[[], Any]
    put: Callable[[Any], None]


def shared_by(controller: Controller) -> list[Place]:
    """Attributes of the user's classes, closures, and the globals that their methods read."""
    found: dict[tuple[int, str], Place] = {}
    functions: list[Any] = []
    known: set[int] = set()

    def look_into(cls: type) -> None:
        if id(cls) in known or _is_fixed(cls) or cls.__module__ in ("abc", "builtins"):
            return
        known.add(id(cls))
        for name, value in vars(cls).items():
            inner = getattr(value, "__func__", getattr(value, "fget", value))
            if isinstance(inner, types.FunctionType):
                functions.append(inner)
            elif not name.startswith("__"):
                found[id(cls), name] = _attribute(cls, name)

    for cls in type(controller).__mro__:
        look_into(cls)
    while functions:
        function = functions.pop()
        if id(function) in known:
            continue
        known.add(id(function))
        for place, one in _read_by(function):
            held = one.get()
            if isinstance(held, types.FunctionType):
                if held.__globals__ is function.__globals__:
                    functions.append(held)
            elif isinstance(held, type) and held.__module__ == function.__module__:
                look_into(held)
            elif not isinstance(held, type | types.ModuleType):
                found[place] = one
    return list(found.values())


def _attribute(cls: type, name: str) -> Place:
    def put(value: Any) -> None:
        setattr(cls, name, value)

    return Place(f"{cls.__name__}.{name}", lambda: vars(cls)[name], put)


def _read_by(function: types.FunctionType) -> Iterator[tuple[tuple[int, str], Place]]:
    """The globals and closures that a function names, each by its place."""
    space = function.__globals__
    for name in _names(function.__code__):
        if name in space:
            yield (id(space), name), _global(space, name)
    closures = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    for name, cell in closures:
        if name != "__class__" and cell != types.CellType():
            yield (id(cell), name), _closure(cell, name)


def _global(space: dict[str, Any], name: str) -> Place:
    def put(value: Any) -> None:
        space[name] = value

    return Place(name, lambda: space[name], put)


def _closure(cell: Any, name: str) -> Place:
    def put(value: Any) -> None:
        cell.cell_contents = value

    return Place(name, lambda: cell.cell_contents, put)


def _names(code: types.CodeType) -> set[str]:
    """The names that code reads, that of functions within it among them."""
    inner = [c for c in code.co_consts if isinstance(c, types.CodeType)]
    return set(code.co_names).union(*map(_names, inner))


# --- before and after ------------------------------------------------------------------------


class Watch:
    """A controller before a run; `changed` says afterwards where it kept something."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._before = frozen(controller)
        self._shared = [
            (one, frozen(one.get()), _copied(one.get())) for one in shared_by(controller)
        ]

    def changed(self) -> str:
        """Where its state is, in words; empty where nothing changed."""
        if frozen(self._controller) != self._before:
            return "in itself"
        names = [one.name for one, before, _ in self._shared if frozen(one.get()) != before]
        return f"in {' and '.join(names)}" if names else ""

    def restore(self) -> None:
        """Put back what it shares: a compiled run leaves tracers in it."""
        for one, before, kept in self._shared:
            if frozen(one.get()) != before:
                one.put(kept)


def _copied(value: Any) -> Any:
    try:
        return copy.deepcopy(value)
    except Exception:  # as `_reduced`
        return value


__all__ = ["Place", "Watch", "frozen", "shared_by"]
