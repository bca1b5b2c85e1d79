"""A user's own Python file: run as a module, with errors that are the file's."""

from __future__ import annotations

import importlib.util
import re
import sys
import traceback
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

from sysid.errors import InputError, input_error

# Modules that files written for 0.1 import, and their present names.
_MOVED = {"sysid.model": "sysid.plant", "sysid.bundle": "sysid.parameters"}


def run_file(path: Path, holds: str) -> ModuleType:
    """Run a user's file; `holds` says what it should define, for messages ("effects").

    Raises InputError where the file is missing or does not run.
    """
    if not path.is_file():
        raise input_error(path, "no such file", f"name a Python file that defines {holds}")
    name = f"sysid_user_{holds.replace(' ', '_')}_{path.stem}"
    spec = importlib.util.spec_from_loader(name, SourceFileLoader(name, str(path)))
    assert spec is not None and spec.loader is not None  # a loader was given
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses resolve annotations given as text
    try:
        _find_what_moved(path.read_text("utf-8", errors="replace"))
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise error_in_file(error, path) from None
    return module


def _find_what_moved(source: str) -> None:
    """Let a file find the rooms that it imports under their names of 0.1."""
    for old, new in _MOVED.items():
        for tail in {"", *re.findall(rf"\b{re.escape(old)}((?:\.\w+)+)", source)}:
            if old in source and importlib.util.find_spec(new + tail) is not None:
                sys.modules[old + tail] = importlib.import_module(new + tail)


def error_in_file(error: BaseException, path: Path) -> InputError:
    """The InputError for what a user's code raised, with the line where it did."""
    line = _line_of(error, path)
    where = f"{path}, line {line}" if line else str(path)
    reason = error.msg if isinstance(error, SyntaxError) else str(error)
    first = reason.strip().partition("\n")[0]
    return input_error(where, f"does not run: {type(error).__name__}: {first}", "fix the file")


def _line_of(error: BaseException, path: Path) -> int | None:
    """The line of the user's file at which an error arose, if any did."""
    if isinstance(error, SyntaxError):
        return error.lineno if error.filename == str(path) else None
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
    return lines[-1] if lines else None


__all__ = ["error_in_file", "run_file"]
