"""A symbolic array library over sympy: an effect's ports evaluated on names instead of numbers.

`array_namespace` recognises a `Symbolic` by its `__array_namespace__`; numpy's own functions
reach it through `__array_ufunc__` and `__array_function__`. Functions and comparisons stay
as they were called: sympy neither simplifies them nor asks what they assume, so that nested
selections (supply-droop, exhaust-back-pressure) stay as small as their code.

What has no C form raises: a value cannot be branched on (TypeError), nor an unknown function
called (AttributeError).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy
from sympy.core.cache import clear_cache

from sysid.exporters.symbolic_names import (
    BINARY,
    INTERPOLATE,
    IS_FINITE,
    NEGATION,
    UNARY,
    WHERE,
)


def _function(name: str, *arguments: Any) -> Symbolic:
    return Symbolic(sympy.Function(name)(*arguments))


def forget_expressions() -> None:
    """Begin a trace without the expressions of others.

    sympy compares equal expressions that are not one object part by part, and each part anew
    wherever it is shared: what one trace keeps of another makes it many times slower.
    """
    clear_cache()


def expression(value: Any) -> Any:
    """The sympy expression of a `Symbolic`, a number or a truth value. Raises TypeError."""
    if isinstance(value, Symbolic):
        return value.expr
    if isinstance(value, bool | np.bool_):
        return sympy.true if value else sympy.false
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, int | float | np.number):
        raise TypeError(f"a {type(value).__name__} has no C form")
    number = float(value)
    if not math.isfinite(number):
        raise TypeError(f"{number} has no C form")
    # A number that is whole and small is exact in sympy too: x + 0 is x, and 1 * x is x.
    is_whole = number.is_integer() and abs(number) <= 1000.0
    return sympy.Integer(int(number)) if is_whole else sympy.Float(number)


class Symbolic:
    """A sympy expression that takes part in arithmetic as an array does."""

    def __init__(self, expr: Any) -> None:
        self.expr = expr

    def __array_namespace__(self, *, api_version: str | None = None) -> Any:
        return NAMESPACE

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            raise TypeError(f"{ufunc.__name__}.{method} with options has no C form")
        return getattr(NAMESPACE, ufunc.__name__)(*inputs)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        return getattr(NAMESPACE, func.__name__)(*args, **kwargs)

    def __bool__(self) -> bool:
        raise TypeError("a branch on a value has no C form: use where")

    def __float__(self) -> float:
        raise TypeError("a value is needed as a number")

    def __add__(self, other: Any) -> Any:
        if isinstance(other, NamedRow):
            return NotImplemented
        return Symbolic(self.expr + expression(other))

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, NamedRow):
            return NotImplemented
        return Symbolic(self.expr - expression(other))

    def __rsub__(self, other: Any) -> Symbolic:
        return Symbolic(expression(other) - self.expr)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, NamedRow):
            return NotImplemented
        return Symbolic(self.expr * expression(other))

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, NamedRow):
            return NotImplemented
        return Symbolic(self.expr / expression(other))

    def __rtruediv__(self, other: Any) -> Symbolic:
        return Symbolic(expression(other) / self.expr)

    def __pow__(self, other: Any) -> Symbolic:
        return _power(self, other)

    def __rpow__(self, other: Any) -> Symbolic:
        return _power(other, self)

    def __neg__(self) -> Symbolic:
        return Symbolic(-self.expr)

    def __pos__(self) -> Symbolic:
        return self

    def __abs__(self) -> Symbolic:
        return _function("fabs", self.expr)

    def __lt__(self, other: Any) -> Symbolic:
        return _compared("less", self, other)

    def __le__(self, other: Any) -> Symbolic:
        return _compared("less_equal", self, other)

    def __gt__(self, other: Any) -> Symbolic:
        return _compared("less", other, self)

    def __ge__(self, other: Any) -> Symbolic:
        return _compared("less_equal", other, self)

    def __eq__(self, other: Any) -> Any:
        return _compared("equal", self, other)

    def __ne__(self, other: Any) -> Any:
        return _compared("not_equal", self, other)

    __hash__ = object.__hash__

    def __and__(self, other: Any) -> Symbolic:
        return _joined("both", self, other)

    def __or__(self, other: Any) -> Symbolic:
        return _joined("either", self, other)

    def __invert__(self) -> Symbolic:
        if self.expr in (sympy.true, sympy.false):
            return Symbolic(sympy.Not(self.expr))
        return _function(NEGATION, self.expr)

    __radd__, __rmul__, __rand__, __ror__ = __add__, __mul__, __and__, __or__


class NamedRow:
    """Values in a row, which take part in arithmetic one by one; a table of C has a `name`."""

    ndim = 1

    def __init__(self, values: Sequence[Symbolic], name: str = "") -> None:
        self.values, self.name = tuple(values), name

    def __array_namespace__(self, *, api_version: str | None = None) -> Any:
        return NAMESPACE

    def __getitem__(self, key: Any) -> Any:
        """A value by its number, alone or the last of several; a slice as a row."""
        if isinstance(key, slice):
            return NamedRow(self.values[key])
        return self.values[key[-1] if isinstance(key, tuple) else key]

    def __len__(self) -> int:
        return len(self.values)

    def __iter__(self) -> Iterator[Symbolic]:
        return iter(self.values)

    def _each(self, operation: Callable[[Any, Any], Any], other: Any) -> NamedRow:
        return NamedRow(
            [operation(a, b) for a, b in zip(self, _row(other, len(self)), strict=True)]
        )

    def __add__(self, other: Any) -> NamedRow:
        return self._each(lambda a, b: a + b, other)

    def __mul__(self, other: Any) -> NamedRow:
        return self._each(lambda a, b: a * b, other)

    def __sub__(self, other: Any) -> NamedRow:
        return self._each(lambda a, b: a - b, other)

    def __rsub__(self, other: Any) -> NamedRow:
        return self._each(lambda a, b: b - a, other)

    def __rtruediv__(self, other: Any) -> NamedRow:
        return self._each(lambda a, b: b / a, other)

    def __gt__(self, other: Any) -> NamedRow:
        return self._each(lambda a, b: a > b, other)

    __radd__, __rmul__ = __add__, __mul__


def _row(value: Any, count: int) -> Sequence[Any]:
    """The values of a row, or a number as many times."""
    return tuple(value) if isinstance(value, NamedRow | tuple) else (value,) * count


def _by_rows(function: Callable[..., Any], arguments: Sequence[Any]) -> Any:
    """A function of numbers; of rows, one by one."""
    rows = [a for a in arguments if isinstance(a, NamedRow)]
    if not rows:
        return function(*arguments)
    columns = zip(*(_row(a, len(rows[0])) for a in arguments), strict=True)
    return NamedRow([function(*values) for values in columns])


class NamedTable:
    """A table of C of two dimensions, read by [..., row, column]."""

    ndim = 2

    def __init__(self, rows: Sequence[NamedRow]) -> None:
        self._rows = rows

    def __array_namespace__(self, *, api_version: str | None = None) -> Any:
        return NAMESPACE

    def __getitem__(self, key: tuple[Any, int, int]) -> Symbolic:
        return self._rows[key[1]].values[key[2]]


def table(name: str, values: Any) -> Any:
    """The numbers of an array (none, one or two dimensions) by their names in a table of C."""
    if values.ndim == 2:
        size = values.shape[1]
        rows = range(0, values.size, size)
        return NamedTable(
            [NamedRow([symbol(f"{name}[{k + j}]") for j in range(size)]) for k in rows]
        )
    found = [symbol(f"{name}[{k}]") for k in range(values.size)]
    return NamedRow(found, name) if values.ndim else found[0]


@dataclass(frozen=True)
class WrittenLoop:
    """A loop of C: expressions of its `names` before it, and after each of at most `count` steps.

    `index` is the step's number; `is_done` ends it.
    """

    index: str
    count: int
    names: tuple[str, ...]
    before: tuple[Any, ...]
    after: tuple[Any, ...]
    is_done: Any


_LOOPS: ContextVar[list[WrittenLoop]] = ContextVar("loops")


@contextmanager
def loops() -> Iterator[list[WrittenLoop]]:
    """The loops that are written down within the block, in their order."""
    found: list[WrittenLoop] = []
    token = _LOOPS.set(found)
    try:
        yield found
    finally:
        _LOOPS.reset(token)


def _loop(
    count: int,
    body: Callable[[Any, Any], Any],
    carry: tuple[Any, ...],
    is_done: Callable[[Any], Any] | None = None,
) -> tuple[Any, ...]:
    """The values after a loop, by the names of what it changes."""
    written = _LOOPS.get()
    number = len(written)
    names = tuple(f"s{number}_{k}" for k in range(len(carry)))
    inside = tuple(map(symbol, names))
    after = body(symbol(f"k{number}"), inside)
    end = sympy.false if is_done is None else expression(is_done(inside))
    before = tuple(map(expression, carry))
    written.append(
        WrittenLoop(f"k{number}", count, names, before, tuple(map(expression, after)), end)
    )
    return inside


def _interp(x: Any, nodes: NamedRow, values: NamedRow) -> Symbolic:
    """Like numpy's, between the nodes of a table."""
    places = (nodes.name, values.name, str(len(nodes.values)))
    return _function(INTERPOLATE, expression(x), *map(sympy.Symbol, places))


def _sum(row: NamedRow, axis: int = -1) -> Any:
    """The sum of a row's values, added one after the other."""
    total: Any = row.values[0]
    for value in row.values[1:]:
        total = total + value
    return total


def _power(base: Any, exponent: Any) -> Symbolic:
    """A power: products where the exponent is 0, 1, 2 or 3, else the function."""
    x, y = expression(base), expression(exponent)
    return Symbolic(x**y) if y in (0, 1, 2, 3) else _function("pow", x, y)


def _compared(name: str, left: Any, right: Any) -> Symbolic:
    """A comparison. x == x, the ports' question for NaN, is true: what is exported is known."""
    a, b = expression(left), expression(right)
    if a == b:
        return Symbolic(sympy.true if name in ("equal", "less_equal") else sympy.false)
    if a.is_number and b.is_number:
        return Symbolic(sympy.true if _holds(name, float(a), float(b)) else sympy.false)
    return _function(name, a, b)


def _holds(name: str, a: float, b: float) -> bool:
    if name in ("equal", "not_equal"):
        return (a == b) == (name == "equal")
    return a < b if name == "less" else a <= b


def _joined(name: str, left: Any, right: Any) -> Symbolic:
    """Both, or either, of two truth values."""
    neutral, absorbing = sympy.true, sympy.false
    if name == "either":
        neutral, absorbing = absorbing, neutral
    a, b = expression(left), expression(right)
    if absorbing in (a, b):
        return Symbolic(absorbing)
    if a == neutral or b == neutral:
        return Symbolic(b if a == neutral else a)
    return _function(name, a, b)


def _where(condition: Any, chosen: Any, other: Any) -> Symbolic:
    test, a, b = map(expression, (condition, chosen, other))
    if test in (sympy.true, sympy.false):
        return Symbolic(a if test == sympy.true else b)
    if a == b:
        return Symbolic(a)
    return _function(WHERE, test, a, b)


def _clip(x: Any, low: Any = None, high: Any = None) -> Any:
    """Like numpy: first not below `low`, then not above `high`; None for no bound."""
    x = x if low is None else NAMESPACE.maximum(x, low)
    return x if high is None else NAMESPACE.minimum(x, high)


class _Namespace:
    """The functions of the library, by their names in numpy and in the array API."""

    pi = math.pi
    e = math.e
    nan = Symbolic(sympy.Symbol("NAN"))  # as C names it
    inf = 1e30  # of the range of single precision; beyond all times and limits
    where = staticmethod(lambda *arguments: _by_rows(_where, arguments))
    clip = staticmethod(_clip)
    power = pow = staticmethod(_power)
    interp = staticmethod(_interp)
    sum = staticmethod(_sum)
    loop = staticmethod(_loop)

    def __getattr__(self, name: str) -> Any:
        try:
            return _FUNCTIONS[name]
        except KeyError:
            raise AttributeError(f"the function {name} has no C form") from None


NAMESPACE: Any = _Namespace()


def _called(name: str, numpys: str) -> Callable[..., Any]:
    """A function of names, worked out at once where all its arguments are numbers."""

    def call(*arguments: Any) -> Any:
        if any(isinstance(a, NamedRow) for a in arguments):
            return _by_rows(call, arguments)
        if not any(isinstance(a, Symbolic) for a in arguments):
            return getattr(np, numpys)(*arguments)
        return _function(name, *map(expression, arguments))

    return call


def _wrapped(value: Any) -> Symbolic:
    return value if isinstance(value, Symbolic) else Symbolic(expression(value))


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{
        known: _called(name, numpys)
        for name, numpys in (UNARY | BINARY).items()
        for known in (name, numpys)
    },
    "abs": abs,
    "square": lambda x: x * x,
    "negative": lambda x: -_wrapped(x),
    "positive": _wrapped,
    "asarray": _wrapped,
    "add": lambda x, y: _wrapped(x) + y,
    "subtract": lambda x, y: _wrapped(x) - y,
    "multiply": lambda x, y: _wrapped(x) * y,
    "divide": lambda x, y: _wrapped(x) / y,
    "true_divide": lambda x, y: _wrapped(x) / y,
    "float_power": _power,
    "less": lambda x, y: _wrapped(x) < y,
    "less_equal": lambda x, y: _wrapped(x) <= y,
    "greater": lambda x, y: _wrapped(x) > y,
    "greater_equal": lambda x, y: _wrapped(x) >= y,
    "equal": lambda x, y: _wrapped(x) == y,
    "not_equal": lambda x, y: _wrapped(x) != y,
    "logical_and": lambda x, y: _wrapped(x) & y,
    "logical_or": lambda x, y: _wrapped(x) | y,
    "logical_not": lambda x: ~_wrapped(x),
    "zeros_like": lambda x: 0.0,
    "full_like": lambda x, value: value,
    "ones_like": lambda x: 1.0,
    "isnan": lambda x: Symbolic(sympy.false),
    "isfinite": lambda x: _function(IS_FINITE, expression(x)),
    "stack": tuple,
    "expand_dims": lambda x, axis: x,
}


def symbol(name: str) -> Symbolic:
    """A name of the C text as a value."""
    return Symbolic(sympy.Symbol(name))
