"""Where each equation and table of the thesis is, read from the docstrings that cite it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import sysid

_PACKAGE = Path(sysid.__file__).parent
# A number, or a range of them; "Table" before it, or the room of the tables, makes it a table's.
_NUMBER = r"[3-6]\.\d{1,2}\.\d{1,2}"
_CITED = re.compile(rf"(Tables? )?\b({_NUMBER})(?:(?:-| to )((?:{_NUMBER})|\d{{1,2}})\b)?")
_OF_TABLES = "thesis"


def equations() -> str:
    """The page."""
    found: dict[bool, set[tuple[str, str, str]]] = {False: set(), True: set()}
    for path in sorted(_PACKAGE.rglob("*.py")):
        module = ".".join(path.relative_to(_PACKAGE.parent).with_suffix("").parts)
        room = path.relative_to(_PACKAGE).parts[0]
        for name, text in _docstrings(ast.parse(path.read_text("utf-8"))):
            address = f"{module.removesuffix('.__init__')}{'.' * bool(name)}{name}"
            first = " ".join(text.split("\n\n")[0].split())
            for cited in _CITED.finditer(text):
                is_table = bool(cited[1]) or room == _OF_TABLES
                found[is_table].add((_numbers(cited[2], cited[3]), first, address))
    return "\n".join(
        [_HEAD, "## Equations\n", _table(found[False]), "## Tables\n", _table(found[True])]
    )


_HEAD = """# Equations and tables of the thesis

Where each is in the program, by the docstrings that cite it. Corrections of the print are in the
docstrings too.
"""


def _numbers(first: str, last: str | None) -> str:
    """A number, or a range with both in full: "3.3.8 to 3.3.10" of 3.3.8-10."""
    if last is None:
        return first
    section = first.rpartition(".")[0]
    return f"{first} to {last}" if "." in last else f"{first} to {section}.{last}"


def _docstrings(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """The name within the module ("" for its own) and the text of every docstring."""

    def walk(node: ast.AST, prefix: str) -> Iterator[tuple[str, str]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.ClassDef | ast.FunctionDef):
                name = f"{prefix}{child.name}"
                yield name, ast.get_docstring(child) or ""
                yield from walk(child, f"{name}.")

    yield "", ast.get_docstring(tree) or ""
    yield from walk(tree, "")


def _table(rows: set[tuple[str, str, str]]) -> str:
    def place(row: tuple[str, str, str]) -> tuple[list[int], str]:
        return [int(part) for part in row[0].split(" ")[0].split(".")], row[2]

    lines = [
        f"| {number} | {_escaped(what)} | `{address}` |"
        for number, what, address in sorted(rows, key=place)
    ]
    return "| number | what it is | where |\n| --- | --- | --- |\n" + "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    return re.sub(r"([\\*_{}\[\]<>$|#~])", r"\\\1", text)
