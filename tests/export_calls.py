"""Every function of an exported header, found from its declaration, called on rows of numbers.

A function's inputs and outputs are flat rows: the real numbers of its arguments, of the structs
and arrays that they point to, and whole numbers among them.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from export_compiler import STRICT, compiler

from sysid.types import FloatArray

BAD = (np.nan, np.inf, -np.inf)
COUNT = 7  # what `rejected` is before a call
SENTINEL = 123.0
AHEAD = 64
_FUNCTION = re.compile(r"^static inline (\w+) sysid_(\w+)\(([^)]*)\)\n\{", re.M)
_STRUCT = re.compile(r"^typedef struct \{\n(.*?)^\} sysid_(\w+);", re.M | re.S)
_DEFAULTS = re.compile(r"^static const sysid_(\w+) sysid_\w+_defaults = \{(.*?)\};", re.M | re.S)
_ARGUMENT = re.compile(r"(const )?(\w+) (\*?)(\w+)(?:\[(\d+)\])?")
# Whole numbers by the argument's name; else 1.
_WHOLE = {"count": 4, "horizon": AHEAD - 1, "first": 0, "inverse": 0}
# By a part of the name, the first that fits: middle and half range of a number in use.
_RANGES = {
    "pressure": (2e5, 5e4),
    "supply": (3e5, 1e4),
    "atmosphere": (1e5, 1e3),
    "duty": (0.5, 0.4),
    "share": (0.5, 0.4),
    "flow": (1e-4, 1e-4),
    "step_s": (1e-3, 5e-4),
    "span_s": (1e-3, 5e-4),
    "since_s": (1e-3, 5e-4),
    "period_s": (1e-3, 1e-4),
    "payload": (0.05, 0.04),
    "delay": (2e-3, 1e-3),
    "radius": (0.0375, 1e-3),
    "position": (0.0, 0.05),
    "displacement": (0.0, 0.01),
}
_OTHER = (0.3, 0.2)


@dataclass
class Function:
    """A function of the header: its rows' columns, and the C that calls it on one row.

    `inputs`: by the name of each column. `whole`: the columns of whole numbers with their largest
    value. `free`: those that may be not finite without consequence: a memory that starts anew.
    `outputs`: names, those of what it remembers with "state:" before, its count as "rejected".
    """

    name: str
    kind: str
    inputs: list[str] = field(default_factory=list)
    defaults: dict[int, float] = field(default_factory=dict)
    whole: dict[int, int] = field(default_factory=dict)
    free: set[int] = field(default_factory=set)
    remembered: dict[str, int] = field(default_factory=dict)
    outputs: list[str] = field(default_factory=list)
    code: str = ""

    @property
    def is_duty(self) -> bool:
        return re.search(r"(^|_)dut(y|ies)(_[ab])?$", self.name) is not None

    @property
    def has_commands(self) -> bool:
        return "out->motor" in self.outputs


class Header:
    """The declarations of a header."""

    def __init__(self, text: str) -> None:
        self.structs = {name: list(_fields(body)) for body, name in _STRUCT.findall(text)}
        self.defaults = {
            name: [float(x) for x in re.findall(r"(?<![\w.])-?\d[\d.]*(?:e[+-]?\d+)?", body)]
            for name, body in (
                (n, re.sub(r"SYSID_AVERAGED", "0", b)) for n, b in _DEFAULTS.findall(text)
            )
        }
        self.tables = {
            name: found[1]
            for name in self.structs
            if (found := re.search(rf"^static const sysid_{name} (\w+) = \{{", text, re.M))
        }
        self.functions = [
            self._function(*found)
            for found in _FUNCTION.findall(text)
            if found[0] in ("sysid_real", "int", "void")
        ]
        self.starts = [name for kind, name, _ in _FUNCTION.findall(text) if name.endswith("_start")]

    def _function(self, kind: str, name: str, arguments: str) -> Function:
        f = Function(name, kind)
        before: list[str] = []
        call: list[str] = []
        after: list[str] = []
        for text in " ".join(arguments.split()).split(", "):
            match = _ARGUMENT.fullmatch(text)
            if match is None:
                assert text == "void", (name, text)
                continue
            self._argument(f, match, (before, call, after))
        words = f"sysid_{name}({', '.join(call)})"
        if kind != "void":
            f.outputs.insert(0, "return")
            words = f"*o++ = (double){words}"
        f.code = "\n    ".join([*before, f"{words};", *after])
        return f

    def _argument(self, f: Function, m: re.Match[str], parts: tuple[list[str], ...]) -> None:
        const, kind, star, name, size = m.groups()
        before, call, after = parts
        call.append(name)
        if kind == "sysid_real" and not star and not size:
            before.append(f"const real {name} = (real){_next(f, name)};")
        elif kind == "sysid_real" and size:
            values = [f"(real){_next(f, name) if const else SENTINEL}" for _ in range(int(size))]
            before.append(f"{const or ''}real {name}[{size}] = {{{', '.join(values)}}};")
            if not const:
                for k in range(int(size)):
                    _shown(f, after, f"{name}[{k}]")
        elif kind == "sysid_real" and const:  # a table: it rises
            before.append(f"static const real {name}[4] = {{0, 1, 2, 3}};")
        elif kind == "sysid_real":
            before.append(f"real {name}_ = 0;")
            call[-1] = f"&{name}_"
            _shown(f, after, f"{name}_")
        elif kind == "int":
            before.append(f"const int {name} = {_WHOLE.get(name, 1)};")
        elif kind == "unsigned" and star:
            before.append(f"unsigned {name}_ = 0;")
            call[-1] = f"&{name}_"
        else:
            self._struct(f, (const, kind.removeprefix("sysid_"), star, name), parts)

    def _struct(
        self, f: Function, argument: tuple[str, str, str, str], parts: tuple[list[str], ...]
    ) -> None:
        const, kind, star, name = argument
        before, call, after = parts
        assert star and kind in self.structs, f"{f.name}: {kind} {name} is not covered"
        fields = self.structs[kind]
        if kind in self.tables and any("*" in field for _, field in fields):
            call[-1] = f"&{self.tables[kind]}"
            return
        many = [0, 1, AHEAD - 1] if name in ("ahead", "path") else [0]
        before.append(f"sysid_{kind} {name}_[{AHEAD if len(many) > 1 else 1}];")
        call[-1] = f"{name}_"
        is_output = not const and name in ("out", "next", "now")
        is_remembered = not const and any(n == "rejected" for _, n in fields)
        numbers = iter(self.defaults.get(kind, []))
        for place in many if name != "path" else many[:1]:
            for what, key in fields:
                target = f"{name}_[{place}].{key}"
                if what == "unsigned":
                    before.append(f"{target} = {COUNT};")
                    continue
                if is_output:
                    before.append(f"{target} = (real){SENTINEL};")
                    continue
                column = len(f.inputs)
                read = _next(f, f"{name}.{key}")
                default = next(numbers, None)
                if what == "int":
                    f.whole[column] = 1 if default in (0.0, 1.0) and key != "coarse" else 0
                    read = f"(int){read}"
                if default is not None:
                    f.defaults[column] = default
                elif what == "int":
                    f.defaults[column] = 0.0
                if name == "memory" or key == "payload_kg":  # which is NaN without an estimate
                    f.free.add(column)
                if is_remembered:
                    f.remembered[f"{name}->{key}"] = column
                before.append(f"{target} = {read if what == 'int' else f'(real){read}'};")
            if place == 0 and len(many) > 1:
                before.append(f"for (k = 1; k < {AHEAD}; k++) {name}_[k] = {name}_[0];")
        if "horizon" in [key for _, key in fields]:
            before.append(f"{name}_[0].horizon = {AHEAD - 1};")
        if not const:
            for _, key in fields:
                _shown(f, after, f"{name}_[0].{key}", f"{name}->{key}")


def _fields(body: str) -> Iterator[tuple[str, str]]:
    """Type and name of each number of a struct, arrays taken apart."""
    for line in re.sub(r"/\*.*?\*/", "", body, flags=re.S).split(";"):
        kind, _, names = re.sub(r"^const ", "", line.strip()).partition(" ")
        for name in filter(None, (n.strip() for n in names.split(","))):
            base, *sizes = re.findall(r"\w+", name)
            places = [f"*{base}" if "*" in name else base]
            for size in map(int, sizes):
                places = [f"{place}[{k}]" for place in places for k in range(size)]
            yield from ((kind, place) for place in places)


def _next(f: Function, name: str) -> str:
    f.inputs.append(name)
    return f"v[{len(f.inputs) - 1}]"


def _shown(f: Function, after: list[str], value: str, name: str = "") -> None:
    after.append(f"*o++ = (double){value};")
    f.outputs.append(name or value)


PROGRAM = """\
#include "controller.h"
#include <stdio.h>
#include <stdlib.h>
typedef sysid_real real;
#ifdef __clang__
#pragma clang diagnostic ignored "-Wunused-function"
#endif
%s
int main(void)
{
    static void (*const calls[])(const double *, double *) = {%s};
    int head[4];
    while (fread(head, sizeof *head, 4, stdin) == 4) {
        double *v = malloc(sizeof *v * (size_t)(head[2] + 1));
        double *out = malloc(sizeof *out * (size_t)(head[3] + 1));
        int k;
        for (k = 0; k < head[1]; k++) {
            if (head[2] && fread(v, sizeof *v, (size_t)head[2], stdin) != (size_t)head[2]) {
                return 3;
            }
            calls[head[0]](v, out);
            fwrite(out, sizeof *out, (size_t)head[3], stdout);
        }
        free(v);
        free(out);
    }
    return 0;
}
"""


class Calls:
    """A header's functions as a program; `options` of the compiler."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.header = Header((folder / "controller.h").read_text())
        bodies = [
            f"static void call_{f.name}(const double *v, double *o)\n{{\n    int k = 0;\n"
            f"    {f.code}\n    (void)v; (void)o; (void)k;\n}}\n"
            for f in self.header.functions
        ]
        names = ", ".join(f"call_{f.name}" for f in self.header.functions)
        (folder / "calls.c").write_text(PROGRAM % ("\n".join(bodies), names))
        words = [compiler(), *STRICT, "-I", ".", *options, "calls.c", "-o", "calls", "-lm"]
        run = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
        if "cannot find" in run.stderr and "sanit" in " ".join(options):
            pytest.skip("the compiler has no sanitizers")
        assert run.returncode == 0, run.stderr[:3000]
        self.program = folder / "calls"

    def __call__(self, rows: list[tuple[Function, FloatArray]]) -> list[FloatArray]:
        """The outputs of each function on its rows (n, inputs): (n, outputs)."""
        known = self.header.functions
        parts = []
        for f, v in rows:
            head = np.array([known.index(f), len(v), len(f.inputs), len(f.outputs)], np.int32)
            parts += [head.tobytes(), np.ascontiguousarray(v, dtype=float).tobytes()]
        run = subprocess.run(
            [self.program], input=b"".join(parts), capture_output=True, check=False
        )
        assert run.returncode == 0, run.stderr[:3000]
        values = np.frombuffer(run.stdout)
        found, start = [], 0
        for f, v in rows:
            count = len(v) * len(f.outputs)
            found.append(values[start : start + count].reshape(len(v), len(f.outputs)))
            start += count
        return found


def good_rows(f: Function, rng: np.random.Generator, rows: int) -> FloatArray:
    """Inputs in the range of use, (rows, inputs)."""
    columns = []
    for k, name in enumerate(f.inputs):
        if k in f.whole:
            default = np.full(rows, f.defaults[k])
            columns.append(rng.integers(0, 2, rows) if f.whole[k] else default)
        elif k in f.defaults:
            columns.append(f.defaults[k] * rng.uniform(0.9, 1.1, rows))
        else:
            middle, half = next((r for key, r in _RANGES.items() if key in name), _OTHER)
            columns.append(middle + half * rng.uniform(-1.0, 1.0, rows))
    return np.stack(columns, axis=1) if columns else np.zeros((rows, 0))


def bad_rows(
    f: Function, rng: np.random.Generator, rows: int, bad: tuple[float, ...] = BAD
) -> FloatArray:
    """The same with one or two inputs that are not finite; empty for one without such inputs."""
    places = [k for k in range(len(f.inputs)) if k not in f.whole and k not in f.free]
    if not places:
        return np.zeros((0, len(f.inputs)))
    found, each = good_rows(f, rng, rows), np.arange(rows)
    found[each, np.resize(places, rows)] = rng.choice(bad, rows)
    second = rng.random(rows) < 0.5
    found[each[second], rng.choice(places, second.sum())] = rng.choice(bad, second.sum())
    return found


__all__ = ["AHEAD", "BAD", "COUNT", "Calls", "Function", "Header", "bad_rows", "good_rows"]
