"""Symbolic expressions as C statements, with common subexpressions worked out once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import sympy
from sympy.printing.c import C99CodePrinter

from sysid.exporters.c_text import Names, literal, real
from sysid.exporters.symbolic import WrittenLoop
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


def traced(
    loops: Sequence[WrittenLoop], results: Sequence[Any], n: Names
) -> tuple[list[str], list[str]]:
    """Statements of loops, in their order, and of what follows them; and the results as C.

    What no loop changes is worked out once, before them.
    """
    parts = [part for loop in loops for part in (*loop.before, *loop.after, loop.is_done)]
    law = reduced(*parts, *results)
    changing = {name for loop in loops for name in (*loop.names, loop.index)}
    fixed = []
    for name, part in law.temporaries:
        if {str(s) for s in part.free_symbols} & changing:
            changing.add(str(name))
        else:
            fixed.append((name, part))
    moving = Reduced(tuple(t for t in law.temporaries if str(t[0]) in changing), ())
    left = iter(law.results)
    lines = all_statements(Reduced(tuple(fixed), ()), n)[0]
    for loop in loops:
        before, after = ([next(left) for _ in loop.names] for _ in range(2))
        lines += _loop_lines(loop, moving, (before, after, next(left)), n)
    more, texts = all_statements(_needed(moving, list(left)), n)
    return lines + more, texts


def _needed(moving: Reduced, results: Sequence[Any]) -> Reduced:
    """The results and the temporaries that they need."""
    names = {s for result in results for s in result.free_symbols}
    found = []
    for name, part in reversed(moving.temporaries):
        if name in names:
            found.append((name, part))
            names |= part.free_symbols
    return Reduced(tuple(reversed(found)), tuple(results))


def _loop_lines(
    loop: WrittenLoop, moving: Reduced, exprs: tuple[list[Any], list[Any], Any], n: Names
) -> list[str]:
    """A loop as C: its values declared and set, and then set anew in every step."""
    r, counter = real(n), f"i{loop.index}"
    before, after, is_done = exprs
    lines, texts = all_statements(_needed(moving, before), n)
    found = [f"{r} {', '.join(loop.names)};", f"int {counter};", "{"]
    found += [f"    {line}" for line in lines]
    found += [f"    {name} = {text};" for name, text in zip(loop.names, texts, strict=True)]
    found += ["}", f"for ({counter} = 0; {counter} < {loop.count}; {counter}++) {{"]
    law = _needed(moving, [*after, is_done])
    if loop.index in law.names():
        found.append(f"    const {r} {loop.index} = ({r}){counter};")
    lines, (*texts, end) = all_statements(law, n)
    if loop.is_done != sympy.false:
        ends, (end,) = all_statements(_needed(moving, [is_done]), n)
        found += [
            *(f"    {line}" for line in ends),
            f"    if ({end}) {{",
            "        break;",
            "    }",
        ]
        lines = [line for line in lines if line not in ends]
    found += [f"    {line}" for line in lines]
    found += [f"    const {r} y{k} = {text};" for k, text in enumerate(texts)]
    return [*found, *(f"    {name} = y{k};" for k, name in enumerate(loop.names)), "}"]


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
        """Whole powers as products: no other powers remain."""
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
