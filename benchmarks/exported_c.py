"""Exported C against Python, and the time of one decision of DVMPC.

    python benchmarks/exported_c.py                 # 10,000 rows a function (minutes)
    python benchmarks/exported_c.py --rows 500 --only-time

For two bundles (that of the bundled campaign, and one of a rig in the vertical, which carries a
payload): the header and its check are compiled by gcc and clang with warnings as errors, in
double and single precision, and replayed with the sanitizers for addresses and undefined
behaviour. Then every function of the header on rows at random and on the edges of its laws, as
`sysid.exporters.vectors` draws them: the largest difference from Python's own function, relative to
the value or its column's root mean square, whichever is larger. "wider": rows in which the last
bit of an input moves Python's own output by more than 1e-12, so that their bound is wider.
Effects have a test of their own: `tests/test_export_catalogue.py`.
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from sysid.exporters import flatten, listed_effects
from sysid.exporters.c_header import Header, render
from sysid.exporters.check_files import check_texts, checked_rows
from sysid.exporters.flat import Flat
from sysid.exporters.vectors import DOUBLE, Vectors
from sysid.parameters import Bundle, read_bundle
from sysid.types import FloatArray

BUNDLES = Path(__file__).resolve().parent.parent / "tests" / "golden" / "bundles"
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"]
SEED = 1

ROWS_C = """\
#define main unused_main
#include "check.c"
#undef main
void replay_rows(int which, int rows, const double *v, double *out);
void replay_rows(int which, int rows, const double *v, double *out)
{
    int k;
    for (k = 0; k < rows; k++) {
        const sysid_vectors *f = &sysid_all[which];
        f->replay(v + k * f->inputs, out + k * f->outputs);
    }
}
"""

TIME_C = """\
#define _POSIX_C_SOURCE 199309L
#include "../model.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
enum { BATCHES = 401, DECISIONS = 50 };
static int rising(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}
int main(int count, char **words)
{
    static sysid_reference ahead[256];
    static double times[BATCHES];
    sysid_dvmpc gains = sysid_dvmpc_defaults;
    sysid_dvmpc_state state = sysid_dvmpc_start();
    sysid_estimate now = {0};
    int k, i, chosen = 0;
    if (count < 4) {
        return 2;
    }
    gains.horizon = atoi(words[1]);
    gains.hold = atoi(words[2]);
    gains.varying = atoi(words[3]);
    for (k = 0; k < 256; k++) {
        ahead[k].position = (sysid_real)0.002 * (sysid_real)k;
        ahead[k].velocity = 2;
    }
    now.pressure_a_pa = 200000;
    now.pressure_b_pa = 150000;
    for (k = 0; k < BATCHES; k++) {
        struct timespec start, stop;
        clock_gettime(CLOCK_MONOTONIC, &start);
        for (i = 0; i < DECISIONS; i++) {
            sysid_commands out;
            now.raw_velocity = (sysid_real)0.01 * (sysid_real)(i + k % 7);
            state.tick = 0;
            sysid_dvmpc_control(&gains, &sysid_payload_estimator_defaults, &state, &now, ahead,
                                &out);
            chosen += (int)(out.valve_a + 2 * out.valve_b);
        }
        clock_gettime(CLOCK_MONOTONIC, &stop);
        times[k] = (double)(stop.tv_sec - start.tv_sec);
        times[k] += 1e-9 * (double)(stop.tv_nsec - start.tv_nsec);
    }
    qsort(times, BATCHES, sizeof *times, rising);
    printf("%.3f %d\\n", 1e6 * times[BATCHES / 2] / DECISIONS, chosen);
    return 0;
}
"""


def compiled(folder: Path, source: str, command: str, real: str, *options: str) -> Path:
    """The program or library of one source file, all warnings errors."""
    out = folder / f"{Path(source).stem}_{command}_{real}"
    words = [command, *STRICT, f"-DSYSID_REAL={real}", *options, source, "-o", str(out), "-lm"]
    subprocess.run(words, cwd=folder, check=True)
    return out


def compilers() -> list[str]:
    """Those of gcc and clang that are there; says which is not."""
    found = [name for name in ("gcc", "clang") if shutil.which(name)]
    for name in {"gcc", "clang"} - set(found):
        print(f"no {name}: not measured")
    return found


def exported(bundle: Bundle, folder: Path) -> tuple[Flat, Header, Path]:
    """The header and its check as `sysid export` writes them, in a folder of their own."""
    flat = flatten(bundle, "")
    made = render(flat, "sysid_", listed_effects(bundle), bundle)
    (folder / "model.h").write_text(made.text)
    check = folder / "check"
    check.mkdir()
    for name, text in check_texts(flat, made, "sysid_", "../model.h").items():
        (check / name).write_text(text)
    (check / "rows.c").write_text(ROWS_C)
    (check / "time.c").write_text(TIME_C)
    return flat, made, check


def errors(library: Path, found: list[Vectors], is_single: bool) -> list[tuple[float, int]]:
    """The largest relative error of each function, and the rows beyond their bound."""
    replay = ctypes.CDLL(str(library)).replay_rows
    worst = []
    for which, v in enumerate(found):
        inputs, out = np.ascontiguousarray(v.inputs), np.empty(v.outputs.shape)
        pointers = (a.ctypes.data_as(ctypes.c_void_p) for a in (inputs, out))
        replay(ctypes.c_int(which), ctypes.c_int(len(inputs)), *pointers)
        bounds = v.bounds[:, int(is_single)]
        error = _errors(out, v.outputs, v.scale)[bounds > 0.0]
        beyond = int(np.sum(~(error <= bounds[bounds > 0.0])))
        worst.append((float(np.max(error, initial=0.0)), beyond))
    return worst


def _errors(found: FloatArray, wanted: FloatArray, scale: FloatArray) -> FloatArray:
    """The largest of each row, relative to the value or its column's root mean square."""
    size = np.maximum(np.abs(wanted), scale)
    error = np.abs(found - wanted) / np.where(size > 0.0, size, 1.0)
    error[np.isnan(found) & np.isnan(wanted)] = 0.0
    return np.asarray(np.max(np.nan_to_num(error, nan=np.inf), axis=1))


def measure(name: str, rows: int) -> None:
    """A bundle's table: warnings, sanitizers, and the worst of each function."""
    with tempfile.TemporaryDirectory() as folder:
        flat, made, check = exported(read_bundle(BUNDLES / f"{name}.json"), Path(folder))
        found = checked_rows(flat, made, rows, SEED)
        print(f"\n{name}: {len(found)} functions, {rows} rows each; {made.notices or 'whole'}")
        columns = []
        for command in compilers():
            for real in ("double", "float"):
                checked = compiled(check, "check.c", command, real, "-O1", *SANITIZERS)
                subprocess.run([checked], check=True, stdout=subprocess.DEVNULL)
                library = compiled(check, "rows.c", command, real, "-O2", "-shared", "-fPIC")
                columns.append((f"{command} {real}", errors(library, found, real == "float")))
        print("no warning, no finding of the sanitizers")
        print(f"{'rows':>34}{'wider':>8}{'in float':>12}" + "".join(f"{c:>14}" for c, _ in columns))
        for k, v in enumerate(found):
            wider = int(np.sum(v.bounds[:, 0] > DOUBLE))
            kept = 100.0 * float(np.mean(v.bounds[:, 1] > 0.0))
            cells = "".join(f"{values[k][0]:14.2g}" for _, values in columns)
            print(f"{v.replay.name:34}{wider:8d}{kept:10.2f} %{cells}")
        for label, values in columns:
            largest, beyond = max(v[0] for v in values), sum(v[1] for v in values)
            print(f"{label}: largest {largest:.2g}, {beyond} rows beyond their bound")


def decision_time() -> None:
    """Median time of one decision, and its share of the period of 1 ms."""
    cases = {
        "N_p = 60, four inputs": (60, 5, 0),
        "N_p = 40, four inputs (160 steps)": (40, 5, 0),
        "varying, 39 with hold 7 (156 steps)": (39, 7, 1),
    }
    with tempfile.TemporaryDirectory() as folder:
        _, _, check = exported(read_bundle(BUNDLES / "diagnosed.json"), Path(folder))
        print("\none decision of DVMPC, -O2, with the payload estimator and the motor's law")
        for command in compilers():
            for real in ("double", "float"):
                program = compiled(check, "time.c", command, real, "-O2")
                for label, words in cases.items():
                    run = subprocess.run(
                        [program, *map(str, words)], check=True, capture_output=True, text=True
                    )
                    median = float(run.stdout.split()[0])
                    share = f"{median:6.2f} us = {median / 10:.2f} % of 1 ms"
                    print(f"{command:6} {real:7} {label:36} {share}")


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description="Exported C against Python.")
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--only-time", action="store_true")
    options = parser.parse_args()
    if not options.only_time:
        for name in ("diagnosed", "made_upright"):
            measure(name, options.rows)
    decision_time()


if __name__ == "__main__":
    main()
