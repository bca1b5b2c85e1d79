"""What every function of the C header does with numbers that are not finite: one guard for all.

A comparison with NaN is false, so that a law which chooses or limits would return a number that
seems valid. The guard is generated from each function's declaration and wraps its computation:
where an input, or what follows from it, is not finite,

- a law answers NaN, and a duty is 0;
- a function with commands lets go (motor 0, valves off) and returns 0 in place of 1;
- a struct with a field `rejected` stays what it was, but that this counts one more.

The names of arguments say what is only written (`out`, `next`, `now` if not const), which reference
is one of many (`ahead`), and what is started anew where it is not finite itself (`memory`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from sysid.exporters.c_text import Names, indented, real

_FUNCTION = re.compile(
    r"^static inline (?P<kind>\w+) (?P<name>\w+)\((?P<arguments>[^)]*)\)\n"
    r"\{\n(?P<body>.*?)^\}\n",
    re.M | re.S,
)
_STRUCT = re.compile(r"^typedef struct \{\n(?P<fields>.*?)^\} (?P<name>\w+);\n", re.M | re.S)
_ARGUMENT = re.compile(
    r"(?P<const>const )?(?P<type>\w+) (?P<star>\*?)(?P<name>\w+)(?:\[(?P<size>\d+)\])?"
)
_COMMENT = re.compile(r"/\*.*?\*/", re.S)
_RETURN = re.compile(r"return ([^;]+);")
_DUTY = re.compile(r"(^|_)dut(y|ies)(_[ab])?$")
_OWN = re.compile(r"_(is|are)_finite$|_let_go$|_known(_flagged)?(_duty)?$")
_OUTPUTS = ("out", "next", "now")
_STARTS_ANEW = "memory"
_COUNT = "rejected"
_UNKNOWN_FIELD = "payload_kg"  # NaN without an estimate


def guarded(text: str, n: Names, *, results: bool = True) -> str:
    """The text of a header with the guard in each of its functions.

    Without `results` they check their inputs only. A function that may fail is of the kind int,
    ends with `return 1;`, and returns 0 where it does: the guard adds the rest there. Functions
    that return a struct, and those that are part of the guard, stay as they are.
    """
    found = {m["name"]: _fields(m["fields"], n) for m in _STRUCT.finditer(text)}
    structs = {name: fields for name, fields in found.items() if fields is not None}
    text = _STRUCT.sub(lambda m: m[0] + _known(m["name"], structs, n), text)
    return _FUNCTION.sub(lambda m: _Guard(m, structs, n, results).text(), text)


def _fields(text: str, n: Names) -> tuple[str, ...] | None:
    """The real numbers of a struct, `rejected` last; None of one with pointers: it is a table."""
    found, counts = [], False
    for line in _COMMENT.sub("", text).split(";"):
        kind, _, names = line.strip().partition(" ")
        if "*" in names:
            return None
        if kind == real(n):
            found += [place for name in names.split(",") for place in _places(name.strip())]
        counts |= names == _COUNT
    return (*found, _COUNT) if counts else tuple(found)


def _places(name: str) -> list[str]:
    """The elements of an array of one or two dimensions, or the name itself."""
    base, *sizes = re.findall(r"\w+", name)
    places = [base]
    for size in sizes:
        places = [f"{place}[{k}]" for place in places for k in range(int(size))]
    return places


def _numbers(fields: tuple[str, ...]) -> list[str]:
    return [f for f in fields if f not in (_COUNT, _UNKNOWN_FIELD)]


def _known(name: str, structs: Mapping[str, tuple[str, ...]], n: Names) -> str:
    """The function that says whether a struct's numbers are finite."""
    numbers = _numbers(structs.get(name, ()))
    if not numbers:
        return ""
    test = " && ".join(f"isfinite(x->{field})" for field in numbers)
    body = indented([f"return !x || ({test});"])
    return f"static inline int {name}_is_finite(const {name} *x)\n{{\n{body}\n}}\n"


@dataclass(frozen=True)
class _Argument:
    """An argument of a function, as it is declared."""

    type: str
    name: str
    is_const: bool
    is_pointer: bool
    size: int

    @property
    def is_output(self) -> bool:
        """Whether the function writes it, and nothing that it remembers."""
        return not self.is_const and (self.is_pointer or self.size > 0)


def _arguments(text: str) -> list[_Argument]:
    found = []
    for declared in " ".join(text.split()).split(", "):
        m = _ARGUMENT.fullmatch(declared)
        if m is not None:
            size = int(m["size"] or 0)
            found.append(_Argument(m["type"], m["name"], bool(m["const"]), bool(m["star"]), size))
        elif declared != "void":
            raise ValueError(f"{declared!r} is no declaration that the guard knows")
    return found


class _Guard:
    """One function's guard."""

    def __init__(
        self, match: re.Match[str], structs: Mapping[str, tuple[str, ...]], n: Names, results: bool
    ) -> None:
        self._match, self._structs, self._n = match, structs, n
        self._checks_results = results
        self._arguments = _arguments(match["arguments"])
        name = match["name"].removeprefix(n.lower)
        self._is_duty = bool(_DUTY.search(name))
        self._answer = "0" if self._is_duty else f"({real(n)})NAN"
        self._commands = f"{n.lower}commands"
        self._remembered = [
            a for a in self._arguments if a.is_output and _COUNT in structs.get(a.type, ())
        ]
        self._outputs = [
            a
            for a in self._arguments
            if a.is_output and a not in self._remembered and (a.type == real(n) or self._is(a))
        ]
        self._flags = any(a.name == "flags" for a in self._arguments)

    def text(self) -> str:
        """The function with its guard."""
        kind, name, body = (self._match[key] for key in ("kind", "name", "body"))
        if _OWN.search(name) or kind not in (real(self._n), "int", "void"):
            return self._match[0]
        if self._checks_results:
            body = self._kept() + self._with_results(kind, body)
        if inputs := [test for a in self._arguments if (test := self._input(a))]:
            body = self._if_not(inputs, self._bad(is_kept=True)) + body
        start, _, _ = self._match[0].partition("{\n")
        return f"{start}{{\n{body}}}\n"

    def _is(self, argument: _Argument) -> bool:
        return bool(_numbers(self._structs.get(argument.type, ())))

    def _input(self, a: _Argument) -> str:
        """The test of an argument that is read; empty for any other."""
        if a.type == real(self._n):
            if a.size and a.is_const:
                return self._array(a)
            return "" if a.is_pointer or a.size else f"isfinite({a.name})"
        if not a.is_pointer or not self._is(a):
            return ""
        if not a.is_const and (a.name in _OUTPUTS or a.name == _STARTS_ANEW):
            return ""
        if a.name == "ahead":
            return f"{self._n.lower}references_are_finite(ahead, gains->horizon)"
        return f"{a.type}_is_finite({a.name})"

    def _array(self, a: _Argument) -> str:
        return " && ".join(f"isfinite({place})" for place in _places(f"{a.name}[{a.size}]"))

    def _results(self) -> list[str]:
        """The tests of what the function has written."""
        found = []
        for a in (*self._outputs, *self._remembered):
            if a.type != real(self._n):
                if self._is(a):
                    found.append(f"{a.type}_is_finite({a.name})")
            else:
                found.append(self._array(a) if a.size else f"isfinite(*{a.name})")
        return found

    def _if_not(self, tests: list[str], then: list[str]) -> str:
        test = " && ".join(tests)
        is_one = re.fullmatch(r"\w+\([^()]*\)", test)
        condition = f"if (!{test}) {{" if is_one else f"if (!({test})) {{"
        return indented([condition, *(f"    {line}" for line in then), "}"]) + "\n"

    def _kept(self) -> str:
        """The statements that restore the state as it was."""
        kept = [f"const {a.type} {a.name}_before = *{a.name};" for a in self._remembered]
        return indented(kept) + "\n" if kept else ""

    def _bad(self, *, is_kept: bool) -> list[str]:
        """What is done where a number is not finite; `is_kept`: nothing has been written yet."""
        lines = []
        for a in self._remembered:
            lines += [] if is_kept else [f"*{a.name} = {a.name}_before;"]
            lines.append(f"{a.name}->{_COUNT}++;")
        returned = {"int": "return 0;", "void": "return;"}.get(
            self._match["kind"], f"return {self._answer};"
        )
        for a in self._outputs:
            if a.type == self._commands:
                returned = f"return {self._n.lower}let_go({a.name});"
                continue
            if a.type == real(self._n):
                places = _places(f"{a.name}[{a.size}]") if a.size else [f"*{a.name}"]
            else:
                places = [f"{a.name}->{field}" for field in _numbers(self._structs[a.type])]
            lines.append(" = ".join([*places, f"{self._answer};"]))
        if self._flags:
            lines += ["if (flags) {", f"    *flags = {self._n.upper}INVALID;", "}"]
        return [*lines, returned]

    def _with_results(self, kind: str, body: str) -> str:
        """The body with what it gives checked where it ends."""
        if kind == real(self._n):
            flags, more = ("_flagged", ", flags") if self._flags else ("", "")
            call = f"{self._n.lower}known{flags}{'_duty' if self._is_duty else ''}"
            plain = f"return {self._answer};"
            return _RETURN.sub(
                lambda m: m[0] if m[0] == plain else f"return {call}({m[1]}{more});", body
            )
        tests, bad = self._results(), self._bad(is_kept=False)
        if kind == "void":
            *then, _ = bad
            return body + self._if_not(tests, then) if tests else body
        end = "    return 1;\n"
        if not tests or not body.endswith(end):
            return body
        lines = "\n".join(f"        {line}" for line in bad)
        start = body.removesuffix(end).replace("        return 0;", lines)
        return start + self._if_not(tests, bad) + end


__all__ = ["guarded"]
