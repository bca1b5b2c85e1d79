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

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-shared", "-fPIC")
_MAIN = """\
#include <time.h>
#include "plant.h"
int run(int n, const double *u, const int *is_duty, const int *on, const double *start,
        double *out, double *seconds);
int run(int n, const double *u, const int *is_duty, const int *on, const double *start, double *out,
        double *seconds)
{
    const clock_t began = clock();
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
    *seconds = (double)(clock() - began) / CLOCKS_PER_SEC;
    return n;
}
"""


def unpacked(fmu: Path, folder: Path) -> Path:
    """The folder of an FMU's sources."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder / "sources"


class PlantLibrary:
    """Runs of a plant in C; `seconds` of processor time the last one took."""

    def __init__(self, sources: Path, optimized: str = "-O1") -> None:
        (sources / "main.c").write_text(_MAIN)
        command = ["cc", *FLAGS, optimized, "main.c", "-o", "plant.so", "-lm"]
        subprocess.run(command, cwd=sources, check=True)
        self._library = ctypes.CDLL(str(sources / "plant.so"))
        self.seconds = 0.0

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
        out, seconds = np.full((n, 4), np.nan), np.zeros(1)
        arrays = (np.ascontiguousarray(table), *flags, np.array(start, dtype=float), out, seconds)
        reached = self._library.run(n, *(a.ctypes.data_as(ctypes.c_void_p) for a in arrays))
        self.seconds = float(seconds[0])
        return int(reached), out
