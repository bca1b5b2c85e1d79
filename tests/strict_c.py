"""C files under every warning, for the tests of the plant in C."""

from __future__ import annotations

import subprocess
from pathlib import Path

from export_compiler import STRICT, compiler


def strictly(folder: Path, name: str, with_: str, *more: str, output: str = "") -> Path:
    """A file compiled with every warning an error, or only read where there is no `output`.

    The test fails with the compiler's words.
    """
    end = ["-o", output, "-lm"] if output else ["-fsyntax-only"]
    command = [compiler(with_), *STRICT, *more, name, *end]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[:3000]
    return folder / output
