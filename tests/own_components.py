"""Campaigns of the worked components, and the commands run on them."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

from sysid.commands.app import main

FOLDER = Path(__file__).resolve().parent.parent / "datasets" / "components"
MOTOR = FOLDER / "geared_motor.py"
CYLINDER = FOLDER / "spring_return_cylinder.py"


@dataclass(frozen=True)
class Command:
    """What a command printed, and its exit code."""

    code: int
    out: str
    err: str


def run(*arguments: object) -> Command:
    """A command, in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(a) for a in arguments])
    return Command(code, out.getvalue(), err.getvalue())


def done(*arguments: object) -> Command:
    """A command that ends well."""
    found = run(*arguments)
    assert found.code == 0, found.err
    return found


def refused(*arguments: object) -> str:
    """The one line of a command that ends with an input error."""
    found = run(*arguments)
    assert found.code == 2, found.err
    lines = [line for line in found.err.splitlines() if line.startswith("sysid: error: ")]
    assert len(lines) == 1 and "Traceback" not in found.err, found.err
    return lines[0]
