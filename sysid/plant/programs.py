"""Compiled functions that are kept for the life of the process, up to a number of them.

jax keeps all that it has compiled, with what it was traced from: a process that diagnoses one
campaign after the other would grow with each structure of a model that it meets, by 3 to 20 MB.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from typing import Any

import numpy as np

from sysid.plant.jax_setup import jax


class Programs:
    """A function compiled for each structure and shape that it meets; the last `most` are kept.

    Its keywords are the structure, which decides what is compiled; its other arguments are arrays,
    or nests of them. `options` are the compiler's. Arguments that are `given_up`, by their places,
    lend their memory to the results, and are gone after the call.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        most: int,
        options: dict[str, Any] | None = None,
        given_up: tuple[int, ...] = (),
    ) -> None:
        self._function, self._most = function, most
        self._options, self._given_up = options, given_up
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self._lock = threading.Lock()
        self.__doc__ = function.__doc__

    def __call__(self, *arrays: Any, **structure: Hashable) -> Any:
        """The function's result: of its program for the structure and arrays of these shapes."""
        shapes = (np.shape(leaf) for leaf in jax.tree.leaves(arrays))
        key = (*structure.values(), *shapes)
        with self._lock:
            program = self._kept.get(key) or self._new(structure)
            self._kept[key] = program
            self._kept.move_to_end(key)
            dropped = self._kept.popitem(last=False)[1] if len(self) > self._most else None
        if dropped is not None:
            dropped.clear_cache()  # jax would keep what is compiled
        return program(*arrays)

    def __len__(self) -> int:
        return len(self._kept)

    def _new(self, structure: Mapping[str, Hashable]) -> Any:
        def one(*arrays: Any) -> Any:
            return self._function(*arrays, **structure)

        one.__name__ = self._function.__name__
        return jax.jit(one, compiler_options=self._options, donate_argnums=self._given_up)


def kept(
    most: int, options: dict[str, Any] | None = None, given_up: tuple[int, ...] = ()
) -> Callable[..., Programs]:
    """A decorator that makes a function `Programs`."""
    return lambda function: Programs(function, most, options, given_up)


__all__ = ["Programs", "kept"]
