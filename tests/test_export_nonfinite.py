"""Exported C on numbers that are not finite: every function that a header declares.

Laws answer NaN, duties 0; controllers let go, keep what they remember and count. A function that
is added is found from its declaration; one with an argument of a new kind fails until it is here.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import conftest
import numpy as np
import pytest
from export_bundles import whole_bundle
from export_calls import COUNT, Calls, Function, bad_rows, good_rows
from export_compiler import compiler, header
from test_export_control import BUNDLES

from sysid.parameters import Bundle
from sysid.types import FloatArray

CALLS = 10_000
MAX_EFFORT = 0.795
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
CONTROLLERS = {"pva_control", "pva_control_counted", "backstepping_control", "dvmpc_control"}


def friction_alone() -> Bundle:
    return whole_bundle(conftest.RIG_TEXT).without("valves")


WAYS = {
    "upright": (BUNDLES["upright"], "double"),
    "effects": (BUNDLES["effects"], "float"),
    "level": (BUNDLES["level"], "float"),
    "linear": (BUNDLES["linear"], "double"),
    "friction": (friction_alone, "double"),
}


def compiled(name: str, folder: Path, *options: str) -> Calls:
    make, real = WAYS[name]
    header(make(), folder)
    return Calls(folder, f"-DSYSID_REAL={real}", *(options or ("-O2",)))


def is_answer(f: Function, inputs: FloatArray, outputs: FloatArray) -> FloatArray:
    """Whether each row (n, outputs) is what a function must answer, (n,)."""
    good = np.ones(len(outputs), dtype=bool)
    with np.errstate(over="ignore"):
        known = {k: np.float32(inputs[:, c]) for k, c in f.remembered.items()}
    for k, name in enumerate(f.outputs):
        column = outputs[:, k]
        if name.endswith("->rejected"):
            good &= column == COUNT + 1
        elif name in f.remembered:
            before = inputs[:, f.remembered[name]]
            good &= (
                (column == before) | (column == known[name]) | (np.isnan(column) & np.isnan(before))
            )
        elif name == "out->payload_kg":
            good &= np.isnan(column)
        elif name.startswith("out->") or (name == "return" and f.kind == "int") or f.is_duty:
            good &= column == 0.0
        else:
            good &= np.isnan(column)
    return good


def wrong(calls: Calls, rows: int, seed: int = 0) -> dict[str, int]:
    """How often each function answers what it must not, where it does."""
    rng = np.random.default_rng(seed)
    given = [(f, bad_rows(f, rng, rows)) for f in calls.header.functions]
    given = [(f, v) for f, v in given if len(v)]
    found = {}
    for (f, v), out in zip(given, calls(given), strict=True):
        found[f.name] = int(np.sum(~is_answer(f, v, out)))
    return {name: count for name, count in found.items() if count}


@pytest.mark.parametrize("name", WAYS)
def test_every_function_answers_what_cannot_harm(name: str, tmp_path: Path) -> None:
    """10,000 calls of each, in which one or two inputs are not finite; and good ones answer."""
    calls = compiled(name, tmp_path)
    assert wrong(calls, CALLS) == {}
    names = {f.name for f in calls.header.functions}
    assert names >= CONTROLLERS | {"sense", "averaged_a_duty"} or name == "friction"
    rng = np.random.default_rng(1)
    given = [(f, good_rows(f, rng, 200)) for f in calls.header.functions]
    for (f, v), out in zip(given, calls(given), strict=True):
        if len(f.inputs) and not is_special(f):
            assert np.isfinite(np.delete(out, unknown(f), axis=1)).mean() > 0.9, f.name
            assert not is_answer(f, v, out).all(), f.name


def is_special(f: Function) -> bool:
    """Functions of mathematics of which some numbers in use have no value, or that is 0."""
    return f.name in ("asin", "acos", "log", "falls", "floor", "payload_detected")


def unknown(f: Function) -> list[int]:
    return [k for k, name in enumerate(f.outputs) if name == "out->payload_kg"]


def test_a_check_that_is_missing_is_found(tmp_path: Path) -> None:
    """Without the reference's check some functions answer with numbers like any others."""
    make, _ = WAYS["upright"]
    path, _ = header(make(), tmp_path)
    text = path.read_text()
    change = "return !x || (isfinite(x->position) && isfinite(x->velocity) && isfinite(x->acceler"
    assert text.count(change) == 2  # an estimate's and a reference's
    path.write_text(text.replace(change, change.replace("!x ||", "!x || x ||")))
    found = wrong(Calls(tmp_path), 1000)
    assert {"reference_is_finite", "backstepping_control", "dvmpc_control"} <= set(found)


def test_the_sanitizers_find_nothing(tmp_path: Path) -> None:
    assert wrong(compiled("effects", tmp_path, *SANITIZERS), 1000) == {}


def test_overflow_lets_go_too(tmp_path: Path) -> None:
    """Finite inputs from which infinite numbers follow: an answer that is finite, or none."""
    calls = compiled("upright", tmp_path)
    rng = np.random.default_rng(3)
    given = [(f, bad_rows(f, rng, 2000, bad=(1e308, -1e308))) for f in calls.header.functions]
    given = [(f, v) for f, v in given if len(v) and (f.remembered or f.has_commands)]
    assert len(given) >= len(CONTROLLERS)
    for (f, v), out in zip(given, calls(given), strict=True):
        has_let_go = is_answer(f, v, out)
        assert (has_let_go | np.isfinite(np.delete(out, unknown(f), axis=1)).all(axis=1)).all()
        assert has_let_go.any(), f.name
        if f.has_commands:
            motor = out[:, f.outputs.index("out->motor")]
            assert np.abs(motor).max() <= MAX_EFFORT


# --- what comes after ------------------------------------------------------------------------


def run(calls: Calls, f: Function, rows: FloatArray) -> FloatArray:
    """Outputs (n, outputs) of a function called row after row, with what it remembers."""
    places = [f.remembered[name] for name in f.remembered]
    shown = [f.outputs.index(name) for name in f.remembered]
    outputs, state = [], rows[0, places]
    for row in rows:
        given = row.copy()
        given[places] = state
        (out,) = calls([(f, given[None])])
        outputs.append(out[0])
        state = out[0, shown]
    return np.array(outputs)


@pytest.mark.parametrize("name", ["upright", "linear"])
def test_bad_samples_leave_no_trace(name: str, tmp_path: Path) -> None:
    """100 good samples after, and among, bad ones: as without these, to the last bit."""
    calls = compiled(name, tmp_path)
    rng = np.random.default_rng(2)
    stateful = [f for f in calls.header.functions if f.remembered]
    assert {f.name for f in stateful} >= {"sense", *CONTROLLERS} - {
        "pva_control",
        "pva_control_counted",  # it remembers a count only
    }
    for f in stateful:
        good, bad = good_rows(f, rng, 100), bad_rows(f, rng, 40)
        own = [*f.whole, *f.remembered.values()]  # of the run, not of the sample
        good[:, own] = bad[:, own] = good[0, own]
        sample = [k for k in range(len(f.inputs)) if k not in own]
        bad[np.isfinite(bad).all(axis=1), sample[0]] = np.nan
        exact = run(calls, f, good)
        kept = [k for k, n in enumerate(f.outputs) if not n.endswith("->rejected")]
        after = run(calls, f, np.concatenate([bad, good]))[len(bad) :]
        np.testing.assert_array_equal(after[:, kept], exact[:, kept], f.name)
        places = np.arange(len(bad))
        among = run(calls, f, np.insert(good, places, bad, axis=0))
        among = np.delete(among, 2 * places, axis=0)
        np.testing.assert_array_equal(among[:, kept], exact[:, kept], f.name)


STARTS = """\
#include "controller.h"
#include <string.h>
int main(void)
{
    sysid_sensing lost = sysid_sensing_start((sysid_real)NAN, 2e5, (sysid_real)INFINITY);
    sysid_sensing found = sysid_sensing_start((sysid_real)0.3, 2e5, 1.5e5);
    sysid_estimate e[2];
    int k, bad = 0;
    sysid_sense(&sysid_filter_defaults, &lost, (sysid_real)NAN, 2e5, 1.5e5, &e[0]);
    bad += lost.rejected != 1 || !isnan(e[0].position);
    for (k = 0; k < 100; k++) {
        const sysid_real x = (sysid_real)(0.3 + 0.001 * k);
        sysid_sense(&sysid_filter_defaults, &lost, x, 2e5, 1.5e5, &e[0]);
        sysid_sense(&sysid_filter_defaults, &found, x, 2e5, 1.5e5, &e[1]);
        bad += memcmp(&e[0], &e[1], sizeof *e) != 0 || !isfinite(e[0].acceleration);
    }
    return bad;
}
"""


def test_sensing_starts_at_the_first_good_readings(tmp_path: Path) -> None:
    header(BUNDLES["level"](), tmp_path)
    (tmp_path / "main.c").write_text(STARTS)
    words = [compiler(), "-std=c99", "-Wall", "-Werror", "main.c", "-lm", "-o", "out"]
    subprocess.run(words, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "out"], check=False).returncode == 0


# --- how it is compiled ----------------------------------------------------------------------


@pytest.mark.parametrize("option", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
@pytest.mark.parametrize("command", ["gcc", "clang"])
def test_options_that_drop_the_checks_are_an_error(
    command: str, option: str, tmp_path: Path
) -> None:
    header(friction_alone(), tmp_path)
    (tmp_path / "main.c").write_text('#include "controller.h"\nint main(void) { return 0; }\n')
    words = [compiler(command), "-std=c99", option, "-fsyntax-only", "main.c"]
    found = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert found.returncode != 0 and "compile without -ffast-math" in found.stderr
    again = subprocess.run([*words[:2], *words[3:]], cwd=tmp_path, check=False)
    assert again.returncode == 0


def test_the_header_says_what_letting_go_does(tmp_path: Path) -> None:
    text = header(BUNDLES["upright"](), tmp_path)[0].read_text().partition("*/")[0]
    assert "an arm in the\n * vertical falls" in text and "rejected" in text
