"""Every error line of the program with its remedy, read from the source."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import sysid

_PACKAGE = Path(sysid.__file__).parent
_TOPICS = {
    "io": "Files: logs, rig, campaign, foreign formats",
    "checks": "Checks of logs",
    "identification": "Fits",
    "friction": "Fits",
    "valve_discrete": "Fits",
    "valve_pwm": "Fits",
    "surfaces": "Fits",
    "estimation": "Fits",
    "balance": "Fits",
    "recording": "Fits",
    "plant": "Model, effects and simulation",
    "parameters": "Bundle",
    "validation": "Validation and refinement",
    "refinement": "Validation and refinement",
    "search": "Diagnosis",
    "diagnosis": "Diagnosis",
    "components": "A component of one's own",
    "controllers": "Controllers",
    "thesis": "Controllers",
    "exporters": "Export",
    "fleet": "Fleet",
    "app": "Workbench in the browser",
}
_OTHER = "Commands and pipelines"


def messages() -> str:
    """The page."""
    found: dict[str, dict[tuple[str, str], None]] = {}
    for path in sorted(_PACKAGE.rglob("*.py")):
        room = path.relative_to(_PACKAGE).parts[0].removesuffix(".py")
        topic = _TOPICS.get(room, _OTHER)
        for row in _errors(ast.parse(path.read_text("utf-8"))):
            found.setdefault(topic, {})[row] = None
    parts = [_HEAD]
    for topic in dict.fromkeys([*_TOPICS.values(), _OTHER]):
        rows = sorted(found.get(topic, {}), key=lambda row: row[0].lower())
        for code, title in (("2", "the input cannot be used"), ("3", "not identified")):
            own = [row for row in rows if bool(row[1]) == (code == "2")]
            if own:
                parts.append(f"## {topic}: exit {code}, {title}\n")
                parts.append(_table(own) if code == "2" else _list(own))
    return "\n".join(parts)


_HEAD = """# Messages and what to do

Every error is one line on standard error, `sysid: error: place: what is wrong; what to do`.
The lists below are read from the source; words in *italics* stand for names and numbers of your
files. With exit 2 the input cannot be used; with exit 3 it was read, but does not identify what was
asked. Exit 1 is a fault of the program: `SYSID_DEBUG=1` shows where, and a report of it is welcome.
A notice has the same form without "error", and the result stands.
"""


def _errors(tree: ast.Module) -> Iterator[tuple[str, str]]:
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        names = {
            target.id: node.value
            for node in ast.walk(function)
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for node in ast.walk(function):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            words = [_text(names.get(a.id, a) if isinstance(a, ast.Name) else a) for a in node.args]
            if node.func.id == "input_error" and len(words) == 3 and all(words[1:]):
                yield words[1], words[2]
            elif node.func.id == "NotIdentifiedError" and len(words) == 1 and words[0]:
                yield words[0], ""


def _text(node: ast.expr) -> str:
    """A message's text; placeholders in italics, empty where the source does not show it."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return _escaped(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(map(_text, node.values))
    if isinstance(node, ast.FormattedValue):
        return f"*{_name(node.value)}*"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = _text(node.left), _text(node.right)
        return left + right if left and right else left or right
    if isinstance(node, ast.IfExp):
        return _text(node.body) or _text(node.orelse)
    return ""


def _name(node: ast.expr) -> str:
    if isinstance(node, ast.Name):
        return node.id.strip("_").replace("_", " ")
    if isinstance(node, ast.Attribute):
        return node.attr.strip("_").replace("_", " ")
    if isinstance(node, ast.Subscript | ast.Call) and not isinstance(node, ast.Call):
        return _name(node.value)
    return "…"


def _escaped(text: str) -> str:
    return re.sub(r"([\\`*_{}\[\]<>$|#~])", r"\\\1", " ".join(text.split(" ")))


def _table(rows: list[tuple[str, str]]) -> str:
    lines = [f"| {what} | {fix} |" for what, fix in rows]
    return "| what is wrong | what to do |\n| --- | --- |\n" + "\n".join(lines) + "\n"


def _list(rows: list[tuple[str, str]]) -> str:
    return "\n".join(f"- {what}" for what, _ in rows) + "\n"
