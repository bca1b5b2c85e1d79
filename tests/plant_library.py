"""The plant of an FMU as a shared library: its C alone, stepped at a run's own rows."""

from __future__ import annotations

import ctypes
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from sysid.plant.simulator import Inputs
from sysid.types import FloatArray
from tests.export_compiler import STRICT, compiler

_MAIN = """\
#include "plant.h"
int run(int n, const double *u, const int *is_duty, const int *on, const double *start,
        double *out);
int run(int n, const double *u, const int *is_duty, const int *on, const double *start, double *out)
{
    plant p;
    int i, k;
    plant_defaults(&p);
    for (i = 0; i < n; i++) {
        const double *row = u + 5 * (i ? i - 1 : 0);
        p.inputs.motor = row[1];
        p.inputs.payload_kg = row[4];
        for (k = 0; k < 2; k++) {
            p.inputs.valve[k] = row[2 + k];
            p.inputs.is_duty[k] = is_duty[k];
        }
        if (!(i ? plant_advance(&p, u[5 * i] - u[0]) : plant_start(&p, start, on))) {
            return i;
        }
        out[4 * i] = p.shown.position;
        out[4 * i + 1] = p.shown.velocity;
        out[4 * i + 2] = p.shown.pressure[0];
        out[4 * i + 3] = p.shown.pressure[1];
    }
    return n;
}
"""


def unpacked(fmu: Path, folder: Path) -> Path:
    """The folder of an FMU's sources."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder / "sources"


def strictly(folder: Path, name: str, with_: str, *more: str, output: str = "") -> Path:
    """A file compiled with every warning an error, or only read where there is no `output`.

    The test fails with the compiler's words.
    """
    end = ["-o", output, "-lm"] if output else ["-fsyntax-only"]
    command = [compiler(with_), *STRICT, *more, name, *end]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[:3000]
    return folder / output


class PlantLibrary:
    """Runs of a plant in C."""

    def __init__(self, sources: Path) -> None:
        (sources / "main.c").write_text(_MAIN)
        flags = ("-O1", "-shared", "-fPIC")
        self._library = ctypes.CDLL(
            str(strictly(sources, "main.c", "gcc", *flags, output="plant.so"))
        )

    def __call__(
        self, inputs: Inputs, start: Any, payload_kg: float = 0.0
    ) -> tuple[int, FloatArray]:
        """How many rows were reached, and (rows, 4) position, velocity, pressures as shown.

        `start`: as shown too, of the first row.
        """
        n, valves = len(inputs.time), (inputs.valve_a, inputs.valve_b)
        columns = [np.zeros(n) if v is None else v.values for v in valves]
        table = np.column_stack((inputs.time, inputs.motor, *columns, np.full(n, payload_kg)))
        flags = [
            np.array([v is not None and getattr(v, name) for v in valves], dtype=np.int32)
            for name in ("is_duty", "starts_on")
        ]
        out = np.full((n, 4), np.nan)
        arrays = (np.ascontiguousarray(table), *flags, np.array(start, dtype=float), out)
        reached = self._library.run(n, *(a.ctypes.data_as(ctypes.c_void_p) for a in arrays))
        return int(reached), out
