"""Exporting to C, for its tests: the header, a strict compiler, its functions over arrays."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sysid.exporters import export_bundle
from sysid.parameters import Bundle, bundle_text
from sysid.types import FloatArray

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion"]


# Text and notices, by the text of the bundle: an export of all there is takes a second.
_HEADERS: dict[str, tuple[str, list[str]]] = {}


def header(bundle: Bundle, folder: Path, **options: Any) -> tuple[Path, list[str]]:
    """Its header in a folder, and the notices; without options a bundle is exported once only."""
    path = folder / "controller.h"
    if options:
        return path, export_bundle(bundle, path, "c", check=False, **options)
    key = bundle_text(bundle)
    if key not in _HEADERS:
        notices = export_bundle(bundle, path, "c", check=False)
        _HEADERS[key] = path.read_text("utf-8"), notices
    text, notices = _HEADERS[key]
    path.write_text(text, "utf-8")
    return path, [*notices]


def macros(path: Path) -> dict[str, int]:
    lines = [line.split() for line in path.read_text().splitlines() if line.startswith("#define")]
    return {line[1]: int(line[2]) for line in lines if len(line) == 3 and line[2].isdigit()}


def compiler(name: str = "gcc") -> str:
    found = shutil.which(name) or (shutil.which("cc") if name == "gcc" else None)
    if found is None:
        pytest.skip(f"no {name}: the C header is not compiled")
    return found


def compile_c(folder: Path, source: str, *arguments: str, output: str = "out") -> Path:
    """Compile with all warnings as errors; the test fails with the compiler's own words."""
    (folder / "main.c").write_text(source)
    command = [compiler(), *STRICT, "-I", ".", "main.c", *arguments, "-lm", "-o", output]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[:3000]
    return folder / output


class Compiled:
    """The header's functions over arrays, through a shared library."""

    def __init__(self, folder: Path, functions: dict[str, int], flagged: tuple[str, ...]) -> None:
        lines = ['#include "controller.h"', '#include "controller.h"']
        for name, count in functions.items():
            inputs = ", ".join(f"const double *x{k}" for k in range(count))
            values = ", ".join(f"x{k}[i]" for k in range(count))
            flags = ", &flags[i]" if name in flagged else ""
            lines.append(
                f"void all_{name}(int n, {inputs}, double *out, unsigned *flags);\n"
                f"void all_{name}(int n, {inputs}, double *out, unsigned *flags)\n"
                f"{{ int i; (void)flags; for (i = 0; i < n; i++) "
                f"out[i] = sysid_{name}({values}{flags}); }}"
            )
        path = compile_c(folder, "\n".join(lines) + "\n", "-shared", "-fPIC", output="lib.so")
        self.library = ctypes.CDLL(str(path))

    def __call__(self, name: str, *inputs: Any) -> tuple[FloatArray, NDArray[np.uint32]]:
        arrays = [np.ascontiguousarray(a, dtype=float) for a in np.broadcast_arrays(*inputs)]
        out = np.empty(arrays[0].shape)
        flags = np.zeros(arrays[0].shape, dtype=np.uint32)
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*arrays, out, flags)]
        getattr(self.library, f"all_{name}")(ctypes.c_int(out.size), *pointers)
        return out, flags
