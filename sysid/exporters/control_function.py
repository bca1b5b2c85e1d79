"""A function of the controllers' part of the header, declared once for its C and for its replay.

Its C is `evaluate` on names (`law`), its replay the same `evaluate` on numbers (`replay`): each
`Argument` says how C declares it, what stands for it on names, and how a replay makes it of the
numbers in v[].
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from sysid.controllers.design_model import DesignModel
from sysid.exporters.replay import Columns, Replay
from sysid.exporters.symbolic import expression, symbol

# What C calls a field of a Python class otherwise.
C_FIELDS = {"pressure_a": "pressure_a_pa", "pressure_b": "pressure_b_pa"}
_T = TypeVar("_T")


@dataclass(frozen=True)
class ControlLaw:
    """The C of a function: `results` maps what it sets to expressions.

    `arguments` are C declarations, @p@ for the prefix; `kind` is what it returns: "void", "int"
    or "@p@real", the result of the name "return". An "int" without one is 1.
    """

    name: str
    meaning: str
    arguments: tuple[str, ...]
    results: dict[str, Any]
    kind: str = "void"


def on_names(kind: type[_T], name: str, **others: Any) -> _T:
    """A dataclass or named tuple whose fields are those of a C struct."""
    fields = [f for f in _fields(kind) if f not in others]
    return kind(**{f: symbol(f"{name}->{C_FIELDS.get(f, f)}") for f in fields}, **others)


def _fields(kind: type[Any]) -> Sequence[str]:
    names: Sequence[str] | None = getattr(kind, "_fields", None)
    return names or [f.name for f in dataclasses.fields(kind)]


class Argument(Protocol):
    """An argument of the function in C and in Python."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The kinds of the numbers that a replay makes it of (`vectors.draws`)."""

    @property
    def declaration(self) -> str:
        """In C, @p@ for the prefix."""

    def on_names(self) -> Any:
        """What `evaluate` takes for it where the C is made."""

    def of_columns(self, v: Columns) -> Any:
        """What `evaluate` takes for it in a replay, of its own columns."""

    def call(self, first: int) -> tuple[list[str], str]:
        """Statements that make it of v[first] and what follows, and the expression to pass."""


@dataclass(frozen=True)
class Number:
    """A real number."""

    name: str
    kind: str

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.kind,)

    @property
    def declaration(self) -> str:
        return f"@p@real {self.name}"

    def on_names(self) -> Any:
        return symbol(self.name)

    def of_columns(self, v: Columns) -> Any:
        return v[0]

    def call(self, first: int) -> tuple[list[str], str]:
        return [], f"(real)v[{first}]"


@dataclass(frozen=True)
class Switch:
    """A choice, 0 or 1."""

    name: str

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("switch",)

    @property
    def declaration(self) -> str:
        return f"int {self.name}"

    def on_names(self) -> Any:
        return symbol(self.name)

    def of_columns(self, v: Columns) -> Any:
        return v[0] > 0.0

    def call(self, first: int) -> tuple[list[str], str]:
        return [], f"v[{first}] > 0"


@dataclass(frozen=True)
class Struct:
    """A struct of the type `c_type`, which is only read: the Python class's fields but those in
    `fixed`, of these kinds."""

    c_type: str
    name: str
    python: type[Any]
    inputs: tuple[str, ...]
    fixed: dict[str, Any] = field(default_factory=dict)

    @property
    def declaration(self) -> str:
        return f"const @p@{self.c_type} *{self.name}"

    def on_names(self) -> Any:
        return on_names(self.python, self.name, **self.fixed)

    def _own(self) -> list[str]:
        return [f for f in _fields(self.python) if f not in self.fixed]

    def of_columns(self, v: Columns) -> Any:
        return self.python(**dict(zip(self._own(), v, strict=True)), **self.fixed)

    def call(self, first: int) -> tuple[list[str], str]:
        lines = [
            f"{self.name}.{C_FIELDS.get(f, f)} = (real)v[{k}];"
            for k, f in enumerate(self._own(), start=first)
        ]
        return [f"@p@{self.c_type} {self.name};", *lines], f"&{self.name}"


@dataclass(frozen=True)
class Gains:
    """A struct of gains, which the header has as `..._defaults` and Python as the class's own."""

    c_type: str
    name: str
    python: type[Any]

    @property
    def inputs(self) -> tuple[str, ...]:
        return ()

    @property
    def declaration(self) -> str:
        return f"const @p@{self.c_type} *{self.name}"

    def on_names(self) -> Any:
        return on_names(self.python, self.name)

    def of_columns(self, v: Columns) -> Any:
        return self.python()

    def call(self, first: int) -> tuple[list[str], str]:
        return [], f"&@p@{self.c_type}_defaults"


@dataclass(frozen=True)
class Written:
    """The struct that a function writes: the fields of what `evaluate` returns."""

    c_type: str
    name: str
    python: type[Any]

    @property
    def declaration(self) -> str:
        """In C, @p@ for the prefix."""
        return f"@p@{self.c_type} *{self.name}"

    def fields(self) -> list[str]:
        """What C calls them."""
        return [C_FIELDS.get(f, f) for f in _fields(self.python)]


@dataclass(frozen=True)
class ControlFunction:
    """A function of the header: `evaluate` takes the design model and the arguments.

    It returns a number, or what is `written`. `kind` and the C of it are a `ControlLaw`'s, `answer`
    a `Replay`'s.
    """

    name: str
    meaning: str
    arguments: tuple[Argument, ...]
    evaluate: Callable[..., Any]
    kind: str = "@p@real"
    written: Written | None = None
    answer: float | None = math.nan

    def law(self, design: DesignModel) -> ControlLaw:
        """Its C, of a design model on names."""
        found = self.evaluate(design, *(argument.on_names() for argument in self.arguments))
        declared = [argument.declaration for argument in self.arguments]
        if self.written is None:
            results = {"return": expression(found)}
            return ControlLaw(self.name, self.meaning, tuple(declared), results, self.kind)
        names = (f"{self.written.name}->{name}" for name in self.written.fields())
        results = {name: expression(v) for name, v in zip(names, found, strict=True)}
        declared.append(self.written.declaration)
        return ControlLaw(self.name, self.meaning, tuple(declared), results)

    def replay(self, design: DesignModel) -> Replay:
        """Its call in C, and its answers with a design model in numbers."""
        inputs = tuple(kind for argument in self.arguments for kind in argument.inputs)

        def evaluate(v: Columns) -> Sequence[Any]:
            own, values = list(v), []
            for argument in self.arguments:
                count = len(argument.inputs)
                values.append(argument.of_columns(own[:count]))
                own = own[count:]
            found = self.evaluate(design, *values)
            return (found,) if self.written is None else tuple(found)

        return Replay(self.name, inputs, self._call(), evaluate, self.answer)

    def _call(self) -> str:
        """Statements that set out[] from v[]."""
        lines: list[str] = []
        passed: list[str] = []
        first = 0
        for argument in self.arguments:
            made, value = argument.call(first)
            lines += made
            passed.append(value)
            first += len(argument.inputs)
        if self.written is None:
            lines.append(f"out[0] = (double)@p@{self.name}({', '.join(passed)});")
            return "\n    ".join(lines)
        name = self.written.name
        lines.insert(0, f"@p@{self.written.c_type} {name};")
        lines.append(f"@p@{self.name}({', '.join([*passed, f'&{name}'])});")
        lines += [f"out[{k}] = (double){name}.{f};" for k, f in enumerate(self.written.fields())]
        return "\n    ".join(lines)


__all__ = [
    "C_FIELDS",
    "Argument",
    "ControlFunction",
    "ControlLaw",
    "Gains",
    "Number",
    "Struct",
    "Switch",
    "Written",
    "on_names",
]
