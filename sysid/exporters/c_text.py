"""Pieces of C text: names, numbers, and comments that no file content can break."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sysid.errors import input_error

DEFAULT_PREFIX = "sysid_"
LARGEST = 1e30
"""Stands for a limit that there is not, and for a time that never comes."""
_PREFIX = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,30}")
_UNSAFE = re.compile(r"[^A-Za-z0-9 .,:;+=()@#%&<>/^_'-]")
KEPT = "\0"
"""A space at which no line breaks."""


@dataclass(frozen=True)
class Names:
    """The prefix of functions and constants, and that of macros."""

    lower: str
    upper: str


def names(prefix: str) -> Names:
    """Checked prefixes. Raises InputError for one that is not a C name."""
    if not _PREFIX.fullmatch(prefix):
        raise input_error(
            "--prefix", f"{prefix[:40]!r} does not begin a C name", "use letters, digits and _"
        )
    return Names(prefix, prefix.upper())


def number(value: float) -> str:
    """A double that C reads back to the last bit."""
    return repr(float(value))


def comment_text(text: str, longest: int = 100) -> str:
    """Text for a comment: one line of ASCII that neither ends nor opens a comment."""
    short = text if len(text) <= longest else text[: longest - 3] + "..."
    return re.sub(r"/(?=/)", "_", _UNSAFE.sub("_", short))


def real(n: Names) -> str:
    """The header's real type: SYSID_REAL, double unless the compiler sets it."""
    return f"{n.lower}real"


def literal(value: float, n: Names) -> str:
    """A number of the header's real type, without an implicit conversion."""
    return f"({real(n)}){number(value)}"


def constant(name: str, value: float, comment: str, n: Names) -> str:
    """One named constant with its unit or meaning."""
    return f"static const {real(n)} {name} = {literal(value, n)}; /* {comment_text(comment)} */"


def array(name: str, values: Iterable[float], n: Names) -> str:
    """A named array, four numbers per line."""
    items = [literal(v, n) for v in values]
    lines = [", ".join(items[k : k + 4]) for k in range(0, len(items), 4)]
    body = ",\n    ".join(lines)
    return f"static const {real(n)} {name}[{len(items)}] = {{\n    {body}\n}};"


def has(name: str, present: bool) -> str:
    """A feature macro, 0 or 1; `name` with its prefix."""
    return f"#define {name} {int(present)}"


def wrapped(text: str, width: int = 96) -> list[str]:
    """Lines of at most `width` characters, broken between words."""
    return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)


def indented(lines: Sequence[str]) -> str:
    """Lines of a function's body, those that are too long with more lines below them."""
    found = []
    for line in lines:
        depth = 4 + len(line) - len(line.lstrip())
        first, *more = wrapped(line.lstrip(), 96 - depth)
        found += [" " * depth + first, *(" " * (depth + 4) + part for part in more)]
    return "\n".join(found)
