"""Symbolic expressions as C statements, with common subexpressions worked out once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import sympy
from sympy.printing.c import C99CodePrinter

from sysid.exporters.c_text import Names, literal, real
from sysid.exporters.symbolic_names import (
    BINARY,
    COMPARISONS,
    IS_FINITE,
    LOGIC,
    NEGATION,
    POWERS,
    UNARY,
    WHERE,
)

_TRUTHS = {*COMPARISONS, *LOGIC, NEGATION, IS_FINITE}
_OPERATORS = COMPARISONS | LOGIC


@dataclass(frozen=True)
class Reduced:
    """Expressions as temporaries (symbol, expression), in order, and the results in them."""

    temporaries: tuple[tuple[Any, Any], ...]
    results: tuple[Any, ...]

    def names(self) -> set[str]:
        """The names that the expressions read."""
        parts = [*(part for _, part in self.temporaries), *self.results]
        own = {str(name) for name, _ in self.temporaries}
        return {str(s) for part in parts for s in part.free_symbols} - own


def reduced(*exprs: Any) -> Reduced:
    """Expressions with their common subexpressions taken out; nothing is simplified."""
    symbols = sympy.numbered_symbols("x")
    temporaries, results = sympy.cse(list(exprs), symbols=symbols, order="none")
    return Reduced(tuple(temporaries), tuple(results))


def statements(law: Reduced, n: Names) -> tuple[list[str], str]:
    """Declarations of the temporaries, and the one result as an expression of C."""
    lines, (result,) = all_statements(law, n)
    return lines, result


def all_statements(law: Reduced, n: Names) -> tuple[list[str], list[str]]:
    """Declarations of the temporaries, and the results as expressions of C."""
    printer = _Printer(n)
    lines = []
    for name, part in law.temporaries:
        kind = "int" if _is_truth(part) else real(n)
        lines.append(f"const {kind} {name} = {_bare(printer.doprint(part))};")
    return lines, [_bare(printer.doprint(result)) for result in law.results]


def _is_truth(expr: Any) -> bool:
    return expr.func.__name__ in _TRUTHS


def _bare(text: str) -> str:
    """Text without the brackets around all of it."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for k, sign in enumerate(text):
        depth += (sign == "(") - (sign == ")")
        if depth == 0 and k < len(text) - 1:
            return text
    return text[1:-1]


class _Printer(C99CodePrinter):  # type: ignore[misc]
    """C of the header's own real type: its literals, and its functions by their prefix."""

    def __init__(self, n: Names) -> None:
        super().__init__()
        self._names = n

    def _print_Float(self, expr: Any) -> str:  # noqa: N802
        return literal(float(expr), self._names)

    _print_Integer = _print_Rational = _print_Float  # noqa: N815
    _print_Zero = _print_One = _print_NegativeOne = _print_Half = _print_Float  # noqa: N815

    def _print_BooleanTrue(self, expr: Any) -> str:  # noqa: N802
        return "1"

    def _print_BooleanFalse(self, expr: Any) -> str:  # noqa: N802
        return "0"

    def _print_Pow(self, expr: Any) -> str:  # noqa: N802
        """Whole powers as products: nothing else is left as a power."""
        count = abs(int(expr.exp))
        base = self._print(expr.base)
        if count > 1:
            power = f"{self._names.lower}{POWERS[count]}({_bare(base)})"
        else:
            power = base if expr.base.is_Atom or expr.base.is_Function else f"({base})"
        return power if expr.exp > 0 else f"({literal(1.0, self._names)}/{power})"

    def _print_Function(self, expr: Any) -> str:  # noqa: N802
        name = expr.func.__name__
        arguments = [_bare(text) if _is_call(name) else text for text in self._all(expr.args)]
        if name == WHERE:
            return "({} ? {} : {})".format(*arguments)
        if name == NEGATION:
            return f"!{arguments[0]}"
        if name == IS_FINITE:
            return f"{name}({arguments[0]})"
        if name in _OPERATORS:
            return f"({f' {_OPERATORS[name]} '.join(arguments)})"
        return f"{self._names.lower}{name}({', '.join(arguments)})"

    def _all(self, arguments: Iterable[Any]) -> list[str]:
        return [self._print(argument) for argument in arguments]


def _is_call(name: str) -> bool:
    return name in UNARY or name in BINARY
