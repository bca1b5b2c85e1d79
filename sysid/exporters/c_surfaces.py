"""The surfaces' part of the C header: tables of their numbers, and two functions of each.

A `SurfaceFunction` is declared once: its C is what its law does with names (`symbolic`), and
its replay what the same law does with numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, cast

import numpy as np

from sysid.exporters.c_text import DEFAULT_PREFIX, Names, array, indented, names, real
from sysid.exporters.flat import DIRECTIONS, Flat
from sysid.exporters.replay import Replay, simple
from sysid.surfaces.hull import FlowLaw
from sysid.surfaces.kinds import SURFACES

# Names of the first argument in C, by the result.
_ARGUMENTS = {"flow": "duty", "duty": "flow_kg_s"}
# Stands for a surface's table of numbers; no C name holds such a sign.
_TABLE = "@table@"


@dataclass(frozen=True)
class SurfaceFunction:
    """A function of the header: `result` ("flow" or "duty") by the other and the pressure.

    `table` is the C name of the surface's numbers, without prefix.
    """

    name: str
    table: str
    result: str
    law: FlowLaw

    @property
    def arguments(self) -> tuple[str, str]:
        """The kinds of its inputs (`vectors.draws`)."""
        return ("duty" if self.result == "flow" else "flow"), "pressure"

    @property
    def meaning(self) -> str:
        """What the comment above it says."""
        if self.result == "flow":
            return "Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL"
        return "Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL"

    def replay(self) -> Replay:
        """Its replay: the law in numbers."""
        return simple(self.name, self.arguments, getattr(self.law, self.result), more=", NULL")

    def text(self, n: Names) -> str:
        """Its C: the law on names."""
        shapes = tuple((f.name, np.shape(value)) for f, value in _numbers(self.law))
        marks = ((DEFAULT_PREFIX, n.lower), (DEFAULT_PREFIX.upper(), n.upper), (_TABLE, self.table))
        lines = _body(cast(Any, type(self.law)), shapes, self.result)
        for mark, name in marks:
            lines = [line.replace(mark, name) for line in lines]
        r = real(n)
        return f"""\
/* {self.meaning}. */
static inline {r} {n.lower}{self.name}(
    {r} {_ARGUMENTS[self.result]}, {r} pressure_pa, unsigned *flags)
{{
{indented(lines)}
}}
"""


@cache
def _body(kind: Any, shapes: tuple[tuple[str, tuple[int, ...]], ...], result: str) -> list[str]:
    """The function's lines for a law of this class, with tables of these shapes by field.

    They hold no numbers of a law, so that the surfaces of a bundle share them: names have the
    default prefix, and the table's is `_TABLE`.
    """
    from sysid.exporters.c_printer import traced
    from sysid.exporters.symbolic import expression, loops, symbol, table

    n = names(DEFAULT_PREFIX)
    tables = {
        field: table(f"{n.lower}{_TABLE}_{field}", np.empty(shape)) for field, shape in shapes
    }
    law: Any = kind(**tables)
    with loops() as found:
        value, reasons = getattr(law, f"bounded_{result}")(
            symbol(_ARGUMENTS[result]), symbol("pressure_pa")
        )
    results = [expression(value), *map(expression, reasons.values())]
    lines, (answer, *holds) = traced(found, results, n)
    flags = " | ".join(
        f"({test} ? {n.upper}{reason.name} : 0u)"
        for reason, test in zip(reasons, holds, strict=True)
    )
    return [*lines, "if (flags) {", f"    *flags = {flags};", "}", f"return {answer};"]


def _numbers(law: FlowLaw) -> Iterator[tuple[dataclasses.Field[Any], Any]]:
    """The fields of a law, each with its numbers."""
    return ((field, getattr(law, field.name)) for field in dataclasses.fields(law))


def slots(flat: Flat) -> Iterator[tuple[str, str, Any]]:
    """Each surface that a bundle can hold: its C name (`pwm_a_fill`), kind, and itself."""
    for side, valve in flat.valves.items():
        for direction in DIRECTIONS:
            for kind in SURFACES:
                yield f"pwm_{side}_{direction}", kind, valve.pwm[direction].surfaces[kind]


def macro(name: str, kind: str) -> str:
    """Feature macro of a surface, without prefix."""
    return f"HAS_{name}_{SURFACES[kind].c_name}".upper()


def surface_functions(flat: Flat) -> Iterator[SurfaceFunction]:
    """The functions of every surface in a bundle, in the header's order."""
    for slot, kind, surface in slots(flat):
        if surface is None:
            continue
        name, table = (slot + SURFACES[kind].c_suffix, f"{slot}_{SURFACES[kind].c_name}")
        for result in ("flow", "duty"):
            yield SurfaceFunction(f"{name}_{result}", table, result, surface.model.law)


def surfaces(flat: Flat, n: Names) -> str:
    """Helpers, then every surface that the bundle holds; empty without any."""
    functions = list(surface_functions(flat))
    if not functions:
        return ""
    fixed = resources.files("sysid.exporters").joinpath("surfaces.h.in").read_text("utf-8")
    parts = [fixed.replace("@p@", n.lower).replace("@P@", n.upper)]
    for flow, duty in zip(functions[::2], functions[1::2], strict=True):
        texts = [flow.text(n), duty.text(n)]
        parts += [*_tables(flow, "\n".join(texts), n), "", *texts]
    return "\n".join(parts)


def _tables(function: SurfaceFunction, text: str, n: Names) -> Iterator[str]:
    """The numbers of a law of which the C text reads any."""
    for field, values in _numbers(function.law):
        name = f"{n.lower}{function.table}_{field.name}"
        if f"{name}[" in text or f"{name}," in text:
            yield array(name, np.ravel(values), n)


__all__ = ["SurfaceFunction", "macro", "slots", "surface_functions", "surfaces"]
