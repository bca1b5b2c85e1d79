"""What the golden test and its cases share: the working folder, running a command, comparing.

Nothing here imports `sysid` but the command's entry point, found as `pip` would find it: the
package's files may move, what a user types and reads may not.
"""

from __future__ import annotations

import importlib
import json
import math
import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
GOLDEN = Path(__file__).resolve().parent / "golden"
BUNDLED = REPOSITORY / "datasets" / "bundled"
BUNDLES = sorted(path.stem for path in (GOLDEN / "bundles").glob("*.json"))

# Fitted numbers differ between machines in their last digits; printed ones have four or less.
REL_JSON, ABS_JSON = 1e-6, 1e-12
REL_TEXT = 2e-3
# Nothing is fitted in an export, but its linear algebra rounds as the processor's library does.
REL_EXPORT = 1e-12
# Keys whose values change with the day or the release.
_UNSTABLE = ("created", "sysid_version", "seconds")
# How often a model was evaluated: an optimiser ends by comparing numbers' last digits.
_EVALUATIONS, REL_EVALUATIONS = "evaluations", 0.02
_NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w])")


def command() -> Callable[[list[str]], int]:
    """The console script's function, as pyproject.toml names it.

    `sysid.__main__` cannot be imported for it: importing that runs the program.
    """
    with (REPOSITORY / "pyproject.toml").open("rb") as file:
        module, name = tomllib.load(file)["project"]["scripts"]["sysid"].split(":")
    found: Callable[[list[str]], int] = getattr(importlib.import_module(module), name)
    return found


def golden_bundle(name: str) -> Path:
    """A bundle that an earlier program wrote."""
    return GOLDEN / "bundles" / f"{name}.json"


class Folder:
    """A folder with sound inputs, in which commands run on relative paths."""

    def __init__(self, path: Path) -> None:
        self.path = path
        for source in (GOLDEN / "inputs").glob("*.*"):
            shutil.copy(source, path / source.name)

    def write(self, name: str, text: str) -> None:
        """A file of this folder, bytes as the text says."""
        (self.path / name).write_bytes(text.encode())

    def text(self, name: str) -> str:
        """A file's text, with its line ends."""
        return (self.path / name).read_bytes().decode()

    def bundled(self, *names: str) -> None:
        """Files of the bundled campaign, under their own names."""
        for name in names:
            shutil.copy(BUNDLED / name, self.path / name)

    def bundle(self, name: str) -> None:
        """A golden bundle, as bundle.json."""
        shutil.copy(golden_bundle(name), self.path / "bundle.json")


def masked(text: str, folder: Path) -> str:
    """Text without the folder (and what its length cuts) and the release."""
    for form in {str(folder), str(folder.resolve())}:
        text = text.replace(form, "<folder>")
    text = re.sub(r"(<folder>/)x+\.\.\.", r"\1x...", text)
    return re.sub(r"sysid(,)? (version )?\d+\.\d+(\.\w+)*", r"sysid\1 \2<version>", text)


def run(arguments: list[str], folder: Folder, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """Exit status and what was printed, masked."""
    capsys.readouterr()
    code = command()(arguments)
    said = capsys.readouterr()
    return {
        "exit": code,
        "stdout": masked(said.out, folder.path),
        "stderr": masked(said.err, folder.path),
    }


def differences(found: Any, wanted: Any, where: str = "") -> list[str]:
    """Where two JSON contents differ; structure exactly, numbers within a tolerance."""
    if where.rsplit(".", 1)[-1] in _UNSTABLE:
        return []
    if isinstance(wanted, dict) and isinstance(found, dict):
        if list(wanted) != list(found):
            return [f"{where}: keys {list(found)}, not {list(wanted)}"]
        return [d for k in wanted for d in differences(found[k], wanted[k], f"{where}.{k}")]
    if isinstance(wanted, list) and isinstance(found, list):
        if len(wanted) != len(found):
            return [f"{where}: {len(found)} items, not {len(wanted)}"]
        pairs = enumerate(zip(found, wanted, strict=True))
        return [d for i, (f, w) in pairs for d in differences(f, w, f"{where}[{i}]")]
    same_kind = type(found) is type(wanted)
    if same_kind and where.endswith(f".{_EVALUATIONS}") and isinstance(wanted, int):
        same = math.isclose(found, wanted, rel_tol=REL_EVALUATIONS)
    elif same_kind and isinstance(wanted, float):
        same = math.isclose(found, wanted, rel_tol=REL_JSON, abs_tol=ABS_JSON)
    elif same_kind and isinstance(wanted, str):
        same = not text_differences(found, wanted)
    else:
        same = same_kind and found == wanted
    return [] if same else [f"{where}: {found!r}, not {wanted!r}"]


def text_differences(
    found: str, wanted: str, rel: float = REL_TEXT, smallest: float = ABS_JSON
) -> list[str]:
    """Lines that differ: words exactly, numbers to the digits that are printed, or to `rel`.

    A number may be a character shorter or longer elsewhere, so runs of spaces count as one.
    """
    lines, known = found.splitlines(), wanted.splitlines()
    if len(lines) != len(known):
        return [f"{len(lines)} lines, not {len(known)}:\n{found}"]
    return [
        f"line {i}: {f!r}, not {w!r}"
        for i, (f, w) in enumerate(zip(lines, known, strict=True), 1)
        if f != w and not _alike(f, w, rel, smallest)
    ]


def _alike(found: str, wanted: str, rel: float, smallest: float) -> bool:
    words = [" ".join(_NUMBER.sub("#", line).split()) for line in (found, wanted)]
    numbers = [[float(n.replace("−", "-")) for n in _NUMBER.findall(x)] for x in (found, wanted)]
    return words[0] == words[1] and all(
        math.isclose(f, w, rel_tol=rel, abs_tol=smallest) for f, w in zip(*numbers, strict=True)
    )


def as_json(text: str) -> Any:
    """Text as JSON where it is JSON, else None."""
    try:
        return json.loads(text) if text.startswith("{") or text.startswith("[") else None
    except json.JSONDecodeError:
        return None
