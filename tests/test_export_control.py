"""The controllers in C: they compute what Python computes, and let go where they cannot."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import conftest
import numpy as np
import pytest
from export_bundles import LINEAR_RIG, RISING, as_bundle, upright, whole_bundle, whole_content
from export_compiler import STRICT, compile_c, compiler, header, macros

from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.design_model import design_from_bundle
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.interface import Reference
from sysid.controllers.payload import PayloadEstimator
from sysid.controllers.sensing import Readings, filter_coefficients, sense, start_sensing
from sysid.controllers.task import HORIZON
from sysid.exporters import check_folder, export_bundle, flatten, listed_effects
from sysid.exporters.c_header import Header, render
from sysid.exporters.check_files import CHECK_FILES, check_texts, checked_rows
from sysid.exporters.flat import Flat
from sysid.exporters.vectors import CHOICES, DOUBLE
from sysid.parameters import Bundle, bundle_text
from sysid.parameters.effects import entry_of
from sysid.plant.base import exhaust_boundary, filling_boundary
from sysid.plant.effects.catalogue import catalogue, load_user_effects

# With a state, on constants, drifting, on every kind of port that a controller reads.
EFFECTS = (
    "presliding",
    "inertia-mismatch",
    "area-error",
    "temperature-drift",
    "supply-droop",
    "exhaust-back-pressure",
    "piston-leakage",
    "stribeck-friction",
    "torque-ripple",
    "tube-lag",
)
FUNCTIONS = {
    *(f"averaged_{side}_{what}" for side in "ab" for what in ("flow", "duty")),
    "prediction_step",
    "delayed_share_a",
    "delayed_share_b",
    "sense",
    "payload_update",
    "payload_mass",
    "payload_detected",
    "pva_control",
    "backstepping_control",
    "dvmpc_costs",
    "dvmpc_control",
}


def upright_bundle(*effects: str) -> Bundle:
    """A bundle that holds everything, in the vertical, with effects at their usual size."""
    bundle = whole_bundle(upright(conftest.RIG_TEXT), [RISING] * 4)
    return bundle.with_effects(entry_of(catalogue()[name].typical()) for name in effects)


BUNDLES = {
    "upright": upright_bundle,
    "level": lambda: whole_bundle(conftest.RIG_TEXT, [RISING] * 4),
    "effects": lambda: upright_bundle(*EFFECTS),
    "linear": lambda: whole_bundle(LINEAR_RIG, [RISING] * 4),
}


_RENDERED: dict[str, tuple[Flat, Header]] = {}


def rendered(bundle: Bundle) -> tuple[Flat, Header]:
    """A bundle's content and its header, made once: tests check it in several ways."""
    key = bundle_text(bundle)
    if key not in _RENDERED:
        flat = flatten(bundle, "")
        _RENDERED[key] = flat, render(flat, "sysid_", listed_effects(bundle), bundle)
    return _RENDERED[key]


def checked(bundle: Bundle, folder: Path, rows: int = 300) -> Path:
    """The header and its check, as `sysid export` writes them but for the number of rows."""
    flat, made = rendered(bundle)
    assert made.control is not None and made.control.ignored == ()
    (folder / "model.h").write_text(made.text)
    check = folder / "check"
    check.mkdir()
    for name, text in check_texts(flat, made, "sysid_", "../model.h", rows, seed=5).items():
        (check / name).write_text(text)
    return check


def run_check(check: Path, command: str, *options: str) -> subprocess.CompletedProcess[str]:
    words = [compiler(command), *STRICT, *options, "check.c", "-lm", "-o", "run"]
    made = subprocess.run(words, cwd=check, capture_output=True, text=True, check=False)
    if "cannot find" in made.stderr and "sanit" in " ".join(options):
        pytest.skip("the compiler has no sanitizers")
    assert made.returncode == 0, made.stderr[:3000]
    return subprocess.run([check / "run"], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", BUNDLES)
def test_every_function_is_that_of_python(name: str, tmp_path: Path) -> None:
    """Both compilers, both precisions, 300 rows a function, no warning."""
    check = checked(BUNDLES[name](), tmp_path)
    ways = [("gcc", "double"), ("clang", "float"), ("gcc", "float"), ("clang", "double")]
    if name in ("upright", "level"):  # the others hold what these hold
        ways = ways[:2]
    for command, real in ways:
        if shutil.which(command) is None:
            pytest.skip(f"no {command}: the controllers in C are not compiled by it")
        run = run_check(check, command, "-O1", f"-DSYSID_REAL={real}")
        assert run.returncode == 0, (command, real, run.stdout)
        assert set(re.findall(r"^(\w+) +\d+ rows", run.stdout, re.M)) >= FUNCTIONS


def test_the_sanitizers_find_nothing(tmp_path: Path) -> None:
    check = checked(BUNDLES["effects"](), tmp_path, rows=100)
    options = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    for real in ("double", "float"):
        run = run_check(check, "gcc", *options, f"-DSYSID_REAL={real}")
        assert run.returncode == 0, run.stdout + run.stderr[:3000]


@pytest.mark.parametrize(
    "change",
    [
        (
            "sysid_pitch_radius_m = (sysid_real)0.0375",
            "sysid_pitch_radius_m = (sysid_real)0.037501",
        ),
        ("costs[k] < costs[best]", "costs[k] > costs[best]"),
        ("y3 = now->pressure_b_pa +", "y3 = now->pressure_b_pa -"),
    ],
)
def test_the_check_finds_what_is_wrong(change: tuple[str, str], tmp_path: Path) -> None:
    check = checked(upright_bundle(), tmp_path, rows=50)
    path = tmp_path / "model.h"
    text = path.read_text()
    assert text.count(change[0]) == 1
    path.write_text(text.replace(*change))
    run = run_check(check, "gcc", "-O1")
    found = re.search(r"^(\d+) of 43 functions disagree", run.stdout, re.M)
    assert run.returncode == 1 and found and int(found[1]) > 0


def test_the_rows_reach_every_choice_and_edge() -> None:
    flat, made = rendered(upright_bundle())
    rows = {v.replay.name: v for v in checked_rows(flat, made)}
    assert set(rows) > FUNCTIONS
    steps = rows["backstepping_control"].inputs
    assert set(steps[:, 16]) == {1.0, 2.0, 3.0, 4.0} and set(steps[:, 17]) == {0.0, 1.0, 2.0}
    assert set(rows["dvmpc_costs"].inputs[:, 14]) == {0.0, 1.0, 2.0, 4.0, 8.0, 15.0}
    chosen = {tuple(row) for row in rows["dvmpc_control"].outputs[:, 1:3]}
    assert len(chosen) == 4
    detected = rows["payload_detected"].outputs[:, 0]
    assert 0.0 < np.mean(detected) < 1.0
    many = {v.replay.name: v for v in checked_rows(flat, made, 300, 5)}
    for v in many.values():
        bad = ~np.isfinite(v.inputs).all(axis=1)
        assert bad.sum() == 2 * sum(kind not in CHOICES for kind in v.replay.inputs)
        assert np.isfinite(v.outputs[~bad]).all()
    edges = {1e5, 3e5, filling_boundary(3e5), exhaust_boundary(1e5)}
    assert edges < set(many["prediction_step"].inputs[:, 2:4].ravel())
    assert all(np.mean(v.bounds[:, 0] == DOUBLE) > 0.9 for v in many.values())
    assert all(np.mean(v.bounds[:, 1] > 0.0) > 0.6 for v in many.values())


def test_cmake_builds_and_passes(tmp_path: Path) -> None:
    if shutil.which("cmake") is None or shutil.which("ctest") is None:
        pytest.skip("no cmake: the check's CMakeLists.txt is not tried")
    path = tmp_path / "model.h"
    export_bundle(upright_bundle(), path, "c")
    folder = check_folder(path)
    assert folder == tmp_path / "model_check"
    assert {file.name for file in folder.iterdir()} == set(CHECK_FILES)
    for words in (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"], ["ctest"]):
        place = folder / "build" if words == ["ctest"] else folder
        run = subprocess.run(words, cwd=place, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr
    assert "2 tests" in run.stdout or "out of 2" in run.stdout


def test_nothing_is_allocated_or_global(tmp_path: Path) -> None:
    text = header(upright_bundle(), tmp_path)[0].read_text()
    assert not re.search(r"\b(malloc|calloc|realloc|alloca|free)\b", text)
    assert not re.search(r"^ *static (?!const |inline )", text, re.M)


# --- what the bundle does not hold -----------------------------------------------------------


def test_without_the_valve_law_there_are_no_controllers(tmp_path: Path) -> None:
    content = whole_content(conftest.RIG_TEXT)
    del content["valves"]["b"]["discrete"]
    path, notices = header(as_bundle(content), tmp_path)
    assert macros(path)["SYSID_HAS_CONTROLLERS"] == 0
    assert any("valves.b.discrete is missing" in line for line in notices)
    assert "dvmpc" not in path.read_text().partition("#ifndef")[2]
    export_bundle(as_bundle(content), path, "c")
    check = check_folder(path)
    assert run_check(check, "gcc").returncode == 0


def test_only_inverses_that_are_there_can_be_chosen(tmp_path: Path) -> None:
    content = whole_content(conftest.RIG_TEXT)
    del content["valves"]["b"]["pwm"]["fill"]["ann"]
    text = header(as_bundle(content), tmp_path)[0].read_text()
    assert "enum { SYSID_AVERAGED, SYSID_BIPOLYNOMIAL };" in text


OWN = '''
from dataclasses import dataclass
from sysid.plant.effects.entry import CatalogueEffect, Quantity

@dataclass(frozen=True)
class Branching(CatalogueEffect):
    """A port with a branch on a value has no law in C."""
    stiffness: float = 0.0
    id = "branching"
    title = "Branch"
    subsystem = "mechanics"
    quantities = (Quantity("stiffness", "Nm", 0.3, 0.0, 5.0, "of the stop"),)
    signature = "torque near the ends"
    source = "own"

    def external_effort(self, effort, point):
        return effort if point.position > 0 else effort + self.stiffness
'''


def test_an_effect_without_a_form_in_c_is_named(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text(OWN)
    kinds = {**catalogue(), **load_user_effects(own)}
    effects = [kinds[name].typical() for name in ("quadratic-drag", "branching")]
    bundle = upright_bundle().with_effects(entry_of(e) for e in effects)
    _, notices = header(bundle, tmp_path, catalogue=kinds)
    assert any("omit branching, whose code" in line for line in notices)


# --- over many ticks -------------------------------------------------------------------------

LOOP = """\
#include "controller.h"
void loop(int ticks, int horizon, const double *readings, const double *wanted, double *out);
void loop(int ticks, int horizon, const double *readings, const double *wanted, double *out)
{
    static sysid_reference r[4096];
    sysid_sensing memory = sysid_sensing_start(readings[0], readings[1], readings[2]);
    sysid_backstepping_state back = sysid_backstepping_start();
    sysid_dvmpc_state held = sysid_dvmpc_start();
    sysid_backstepping gains = sysid_backstepping_type(4);
    int k;
    for (k = 0; k < ticks + horizon; k++) {
        r[k].position = wanted[4 * k];
        r[k].velocity = wanted[4 * k + 1];
        r[k].acceleration = wanted[4 * k + 2];
        r[k].jerk = wanted[4 * k + 3];
    }
    for (k = 0; k < ticks; k++) {
        const double *y = readings + 3 * k;
        const sysid_payload_estimator *seen = &sysid_payload_estimator_defaults;
        sysid_estimate now;
        sysid_commands c;
        sysid_sense(&sysid_filter_defaults, &memory, y[0], y[1], y[2], &now);
        sysid_backstepping_control(&gains, seen, &back, &now, &r[k], &r[k + 5], &c);
        out[7 * k] = c.motor;
        out[7 * k + 1] = c.valve_a;
        out[7 * k + 2] = c.valve_b;
        sysid_dvmpc_control(&sysid_dvmpc_defaults, seen, &held, &now, &r[k], &c);
        out[7 * k + 3] = c.motor;
        out[7 * k + 4] = c.valve_a;
        out[7 * k + 5] = c.valve_b;
        out[7 * k + 6] = c.payload_kg;
    }
}
"""


def recorded(ticks: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Noisy readings (ticks, 3), two of them lost, and the wanted motion with its preview."""
    t = 1e-3 * np.arange(ticks + HORIZON)
    w = 5.0
    wanted = np.stack(
        [np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t), -(w**3) * np.cos(w * t)], axis=1
    )
    rng = np.random.default_rng(4)
    readings = np.stack(
        [
            wanted[:ticks, 0] + rng.normal(0.0, 2e-3, ticks),
            2e5 + 4e4 * np.sin(7.0 * t[:ticks]) + rng.normal(0.0, 150.0, ticks),
            1.8e5 - 4e4 * np.sin(9.0 * t[:ticks]) + rng.normal(0.0, 150.0, ticks),
        ],
        axis=1,
    )
    readings[50, 0] = readings[70, 2] = np.nan
    return readings, wanted


def test_memories_carry_over_ticks_as_in_python(tmp_path: Path) -> None:
    """Sensing, payload, held decisions: 400 ticks of both controllers, from their starts.

    In two ticks, whose readings are not finite, both let go.
    """
    ticks, bundle = 400, upright_bundle("quadratic-drag")
    readings, wanted = recorded(ticks)
    header(bundle, tmp_path)
    library = ctypes.CDLL(str(compile_c(tmp_path, LOOP, "-shared", "-fPIC", output="loop.so")))
    found = np.empty((ticks, 7))
    pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (readings, wanted, found)]
    library.loop(ctypes.c_int(ticks), ctypes.c_int(HORIZON), *pointers)
    exact = in_python(bundle, readings, wanted)
    assert np.flatnonzero(np.isnan(exact[:, 6])).tolist() == [50, 70]
    assert len(np.unique(exact[:, 4:6], axis=0)) >= 3 and np.ptp(exact[71:, 6]) > 0.05
    np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-10)


def in_python(
    bundle: Bundle, readings: np.ndarray[Any, Any], wanted: np.ndarray[Any, Any]
) -> np.ndarray[Any, Any]:
    design = design_from_bundle(bundle)
    known: Any = {"design": design, "estimator": PayloadEstimator()}
    controllers = (
        BacksteppingController(**known),
        DvmpcController(**known, horizon=HORIZON),
    )
    memories = [controller.start(1) for controller in controllers]
    filters = filter_coefficients(1e-3)[:, :, None]
    sensing = start_sensing(Readings(*(np.array([v]) for v in readings[0])))
    out = []
    for k, row in enumerate(readings):
        ahead = Reference(*(wanted[k + 1 : k + 1 + HORIZON, i, None] for i in range(4)))
        reference = Reference(*(wanted[k, i, None] for i in range(4)), ahead)
        now_readings = Readings(*(np.array([v]) for v in row))
        sensing, now = sense(sensing, now_readings, k, 1e-3, filters)
        line: list[float] = []
        for i, controller in enumerate(controllers):
            memories[i], c = controller.commands(memories[i], now, reference)
            line += [float(np.asarray(v).item()) for v in (c.motor, c.valve_a, c.valve_b)]
        out.append([*line, float(c.payload_kg[0])])
    return np.array(out)


LETS_GO = """\
#include "controller.h"
int main(void)
{
    sysid_estimate now = {0, 0, 0, 0, 2e5, 2e5};
    sysid_reference wanted[64] = {{0, 0, 0, 0}};
    sysid_backstepping_state back = sysid_backstepping_start();
    sysid_dvmpc_state held = sysid_dvmpc_start();
    sysid_commands c;
    int bad = 0;
    bad += sysid_pva_control(&sysid_pva_defaults, &now, wanted, &c) != 1;
    now.velocity = (sysid_real)NAN;
    bad += sysid_pva_control(&sysid_pva_defaults, &now, wanted, &c) != 0;
    bad += c.motor != 0 || c.valve_a != 0 || c.valve_b != 0;
    bad += sysid_backstepping_control(&sysid_backstepping_defaults, NULL, &back, &now, wanted,
                                      wanted, &c) != 0;
    bad += c.motor != 0 || c.valve_a != 0 || c.valve_b != 0;
    bad += sysid_dvmpc_control(&sysid_dvmpc_defaults, NULL, &held, &now, wanted, &c) != 0;
    bad += c.motor != 0 || c.valve_a != 0 || c.valve_b != 0 || held.tick != 0;
    return bad;
}
"""


def test_an_estimate_that_is_not_finite_lets_go(tmp_path: Path) -> None:
    header(upright_bundle(), tmp_path)
    program = compile_c(tmp_path, LETS_GO.replace("#include", "#include <stddef.h>\n#include", 1))
    assert subprocess.run([program], check=False).returncode == 0
