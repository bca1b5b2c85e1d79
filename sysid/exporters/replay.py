"""What it takes to replay a function of the header: how C calls it, and Python's own answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.types import BoolArray, FloatArray

Columns = Sequence[FloatArray]


@dataclass(frozen=True)
class Replay:
    """A function: the kinds of its inputs (`vectors.DRAWS`), its call in C, its outputs.

    `call`: statements that set out[] from v[], @p@ for the prefix. `evaluate` maps columns (n,)
    to columns (n,) by Python's own functions. `answer`: the outputs where an input is not finite;
    None: what `evaluate` says there, which is a function with its own guard. `is_tie` says in
    which rows (n,) two decisions are so near that single precision may take the other; None where
    nothing is decided.
    """

    name: str
    inputs: tuple[str, ...]
    call: str
    evaluate: Callable[[Columns], Sequence[Any]]
    answer: float | None = math.nan
    is_tie: Callable[[Columns], BoolArray] | None = None


def simple(
    name: str, inputs: tuple[str, ...], evaluate: Callable[..., Any], more: str = "", to: str = ""
) -> Replay:
    """A function of numbers that returns one."""
    values = ", ".join(f"(real)v[{k}]" for k in range(len(inputs)))
    call = f"out[0] = (double)@p@{to or name}({values}{more});"
    answer = 0.0 if name.endswith("_duty") else math.nan
    return Replay(name, inputs, call, lambda v: (evaluate(*v),), answer)


__all__ = ["Columns", "Replay", "simple"]
