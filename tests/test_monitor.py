"""The monitor: what it says of drift, the same in C as in Python, and safe on any input."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from export_bundles import whole_bundle
from export_compiler import STRICT, compiler
from scipy.special import ndtri

from benchmarks.monitor import SETTLING, Change, Machine, cycles, machine, samples_of, watched
from datasets.generator.files import rig_toml
from sysid.commands.monitor import monitor as monitor_command
from sysid.controllers.monitor.design import MonitorDesign, monitor_design
from sysid.controllers.monitor.drifts import COUNT, DRIFTS, KINDS, NAMES, TESTED, UNDECIDED
from sysid.controllers.monitor.evidence import (
    LEARNING,
    WITHIN,
    Cycle,
    Pool,
    detectable,
    detection,
    likeliest,
    mean_cycle,
    named,
    threshold,
    whitened,
    without_scatter,
)
from sysid.controllers.monitor.logged import CycleVerdict, WatchedSamples, monitored
from sysid.controllers.monitor.observer import ChamberState, chamber_ahead, chamber_bent
from sysid.controllers.monitor.reference import reference_changes
from sysid.controllers.monitor.strokes import cycle_ends
from sysid.controllers.monitor.terms import ChamberTerms
from sysid.errors import InputError
from sysid.exporters import export_bundle
from sysid.fleet.origin import origin_of
from sysid.fleet.rows import FleetRow
from sysid.fleet.trends import fleet_of
from sysid.io.campaign import read_campaign
from sysid.io.tables import write_table
from sysid.parameters import write_bundle
from sysid.pipeline.fleet_monitor import with_alarms
from sysid.pipeline.pages.fleet import fleet_page
from sysid.types import FloatArray

ON_OFF, PWM, BIASED = 5001, 5003, 7200
LINGERING = 8220
"""A machine whose chamber A, compressed while it is discharged, lingers at the choked boundary."""


@cache
def made(seed: int) -> tuple[Machine, MonitorDesign]:
    own = machine(seed)
    return own, monitor_design(own.bundle)


@cache
def healthy(seed: int, count: int = 3) -> WatchedSamples:
    own, _ = made(seed)
    return samples_of(own, list(cycles(own, count, np.random.default_rng([seed, 7]))))


def verdicts(design: MonitorDesign, given: WatchedSamples) -> list[CycleVerdict]:
    return monitored(design, given, design.pool())


def spoilt(given: WatchedSamples) -> WatchedSamples:
    """Each input not finite in turn, in several samples."""
    position, motor = given.position.copy(), given.motor.copy()
    pressure = {s: p.copy() for s, p in given.pressure.items()}
    valve = {s: v.copy() for s, v in given.valve.items()}
    columns = [position, *pressure.values(), motor, *valve.values()]
    for k, column in enumerate(columns):
        bad = (np.nan, np.inf, -np.inf)[k % 3]
        column[300 + 410 * k] = bad
        column[2500 + 300 * k : 2505 + 300 * k] = bad
    return replace(given, position=position, pressure=pressure, motor=motor, valve=valve)


# --- statistics ------------------------------------------------------------------------


def random_cycle(rng: np.random.Generator, drift: FloatArray, scatter: FloatArray) -> Cycle:
    """Equations of a cycle whose innovations are as the model of their noise says."""
    rows = rng.standard_normal((60, COUNT)) * rng.uniform(0.1, 1.0, COUNT)
    own = drift + scatter @ rng.standard_normal(scatter.shape[1])
    values = rows @ own + rng.standard_normal(60)
    return Cycle(rows.T @ rows, rows.T @ values, np.zeros(3), np.ones(3))


def test_statistics_are_of_unit_variance_while_healthy() -> None:
    rng = np.random.default_rng(3)
    scatter = rng.normal(0.0, 0.7, (COUNT, 3))
    std = rng.uniform(0.2, 2.0, COUNT)
    found = []
    for _ in range(150):
        pool = Pool(scatter, np.diag(std**2), np.ones(COUNT))
        bias = std * rng.standard_normal(COUNT)
        for _ in range(4):
            cycle = random_cycle(rng, bias, scatter)
            pool.add(cycle)
        last = Cycle(*without_scatter(cycle.matrix, cycle.vector, scatter))
        found.append(pool.statistics(last)[0])
    z = np.concatenate(found)
    assert np.all(np.abs(np.mean(z**2, axis=0) - 1.0) < 0.5)
    assert abs(float(np.mean(z**2)) - 1.0) < 0.1


def test_a_drift_of_the_smallest_detectable_size_is_found_in_half_of_the_cases() -> None:
    rng = np.random.default_rng(4)
    scatter, errors = np.zeros((COUNT, 1)), np.zeros((COUNT, COUNT))
    k = NAMES.index("leak_a")
    likely = mean_cycle([random_cycle(rng, np.zeros(COUNT), scatter) for _ in range(50)])
    size = detectable(likely, scatter, errors, np.ones(COUNT)).by_cycles[10][k]
    hits = 0
    for _ in range(24):
        pool, drift = Pool(scatter, errors, np.ones(COUNT)), np.zeros(COUNT)
        for count in range(20):
            drift[k] = size if count >= 10 else 0.0
            verdict = pool.add(random_cycle(rng, drift, scatter))
        hits += verdict.z[k] > threshold()
    assert 4 <= hits <= 20


def test_friction_of_the_first_cycle_after_learning_is_no_drift() -> None:
    """Sums of one cycle speak of friction as little as a cycle alone, whose scatter is not exactly
    what the bundle says."""
    rng = np.random.default_rng(8)
    scatter, errors = np.zeros((COUNT, 1)), np.zeros((COUNT, COUNT))
    pool = Pool(scatter, errors, np.ones(COUNT), np.ones(COUNT))
    drift, k = np.zeros(COUNT), NAMES.index("coulomb")
    for _ in range(LEARNING):
        assert not pool.add(random_cycle(rng, drift, scatter)).alarms
    drift[k] = 20.0
    first, second = (pool.add(random_cycle(rng, drift, scatter)) for _ in range(2))
    assert first.z[k] == 0.0 and second.z[k] > threshold()
    assert not first.alarms and second.alarms


def test_scatter_is_integrated_out() -> None:
    rng = np.random.default_rng(5)
    rows, columns = rng.standard_normal((30, COUNT)), rng.standard_normal((COUNT, 2))
    matrix, vector = rows.T @ rows, rng.standard_normal(COUNT)
    found, left = without_scatter(matrix, vector, columns)
    whole = np.linalg.inv(np.linalg.inv(matrix) + columns @ columns.T)
    np.testing.assert_allclose(found, whole, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(left, whole @ np.linalg.solve(matrix, vector), atol=1e-8)


def test_what_was_not_excited_has_no_statistic() -> None:
    rng = np.random.default_rng(6)
    rows = rng.standard_normal((30, 5))
    rows[:, 2] = 0.0
    matrix = rows.T @ rows
    white, out = whitened(matrix, matrix @ np.arange(5.0), matrix)
    assert white[2] == 0.0 and not out[2].any() and not out[:, 2].any()
    np.testing.assert_allclose(out.T @ out, matrix, atol=1e-9)


def test_the_kind_is_named_where_it_is_clear() -> None:
    z = np.zeros(COUNT)
    assert not detection(z).any()
    z[NAMES.index("supply")] = -9.0
    assert named(z) == ("supply", NAMES.index("supply"))
    z[NAMES.index("leak_b")] = 8.9
    assert named(z)[0] == UNDECIDED
    z[NAMES.index("leak_b")] = -8.9  # a leak that is less than none
    assert named(z)[0] == "supply"
    z[NAMES.index("inertia")] = 50.0  # a load is no drift
    assert NAMES[likeliest(z)] == "supply"


def test_a_cycle_is_a_stroke_there_and_back() -> None:
    x = np.concatenate([np.linspace(0.0, 1.0, 50), np.linspace(1.0, 0.0, 50)])
    ends = cycle_ends(np.tile(x, 4), 0.3)
    assert len(ends) == 3 and np.all(np.diff(ends) == 100)
    assert cycle_ends(0.1 * np.tile(x, 4), 0.3) == []
    x[20:25] = np.nan
    assert len(cycle_ends(np.tile(x, 4), 0.3)) == 3


# --- at the choked boundary -------------------------------------------------------------


@pytest.mark.parametrize(
    ("own", "other"),
    [(400.0, 700.0), (15.0, 215.0), (0.0, 200.0), (-10.0, 190.0), (-300.0, -100.0), (90.0, -60.0)],
)
@pytest.mark.parametrize("begins", [-250.0, -60.0, -1.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_boundary_bends_what_is_expected_as_the_mean_of_pressures(
    own: float, other: float, begins: float, way: float
) -> None:
    """`own`, `other`: Pa of a stretch towards the boundary and past it, from `begins` before it."""
    std, boundary, steps = 60.0, 2e5, 2000
    x = begins + std * ndtri((np.arange(2000) + 0.5) / 2000)
    for _ in range(steps):
        x += np.where(x < 0.0, own, other) / steps
    before = ChamberState(boundary + way * begins, std**2, (0.0,))
    terms = ChamberTerms(way * own, 0.0, (0.0,), (0.0, 0.0), 0.0, boundary)
    ahead = chamber_ahead(before, terms, 1.0, 0.0)
    found = chamber_bent(before, ahead, terms, way * other, 1.0)
    expected = way * (found.pressure - boundary)
    assert expected == pytest.approx(np.mean(x), abs=0.02 * abs(other - own))


def test_a_pressure_that_lingers_at_the_boundary_is_no_drift() -> None:
    """An observer that takes the one flow for the other for the rest of the stroke."""
    _, design = made(LINGERING)
    seen = verdicts(design, healthy(LINGERING, 6))
    assert np.max(np.abs([c.verdict.z for c in seen])) < threshold()


# --- on generated machines --------------------------------------------------------------


@pytest.mark.parametrize(
    ("seed", "name"),
    [(ON_OFF, "coulomb"), (ON_OFF, "leak_a"), (ON_OFF, "supply"), (PWM, "off_delay_a")],
)
def test_wear_is_found_and_never_named_wrongly(seed: int, name: str) -> None:
    own, design = made(seed)
    seen = verdicts(design, healthy(seed))
    assert not any(c.verdict.alarms for c in seen)
    on_these = detectable(
        mean_cycle([c.cycle for c in seen]), design.scatter, design.errors, design.scales
    )
    k = NAMES.index(name)
    size = 2.0 * on_these.by_cycles[max(WITHIN)][k] * (-1.0 if name == "supply" else 1.0)
    found = watched(own, design, SETTLING + max(WITHIN), 11, Change(name, float(size)))
    kinds = [c.verdict.kind for c in found]
    assert set(kinds[: SETTLING - 1]) == {""}
    assert set(kinds) <= {"", UNDECIDED, DRIFTS[k].kind} and kinds[-1] == DRIFTS[k].kind
    assert found[-1].verdict.change[k] == pytest.approx(size, rel=0.5)


def test_a_reference_cycle_states_changes_of_every_kind() -> None:
    _, design = made(ON_OFF)
    changes = reference_changes(design)
    assert changes is not None
    one, ten = (changes[0].by_cycles[count][list(TESTED)] for count in WITHIN)
    assert np.all(np.isfinite(ten)) and np.all(ten > 0.0) and np.all(one >= ten)
    assert {DRIFTS[k].kind for k in TESTED} == set(KINDS)


# --- in C -------------------------------------------------------------------------------

_LOOP = """
#include "controller.h"
#include <stdio.h>

int main(void)
{
    static sysid_monitor m;
    double x[6];
    unsigned long last = 0;
    int k;
    sysid_monitor_start(&m, DUTY);
    while (fread(x, sizeof x, 1, stdin) == 1) {
        sysid_monitor_update(&m, (sysid_real)x[0], (sysid_real)x[1], (sysid_real)x[2],
                             (sysid_real)x[3], (sysid_real)x[4], (sysid_real)x[5]);
        if (m.cycles != last) {
            last = m.cycles;
            printf("%d %u", m.alarm, m.rejected);
            for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
                printf(" %.17g", (double)m.z[k]);
            }
            printf("\\n");
        }
    }
    return 0;
}
"""
_SAFE = ["-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def in_c(folder: Path, seed: int, given: WatchedSamples, with_: str, *more: str) -> FloatArray:
    """Alarm, what was rejected, and the statistics after each cycle, (cycles, 2 + p)."""
    own, _ = made(seed)
    if not (folder / "controller.h").is_file():
        export_bundle(own.bundle, folder / "controller.h", "c", check=False)
        (folder / "loop.c").write_text(_LOOP)
    duty = f"-DDUTY={int(own.duties is not None)}"
    command = [compiler(with_), *STRICT, *more, duty, "loop.c", "-lm", "-o", "loop"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[:3000]
    columns = [given.position, *given.pressure.values(), given.motor, *given.valve.values()]
    data = np.ascontiguousarray(np.array(columns).T).tobytes()
    done = subprocess.run(["./loop"], cwd=folder, input=data, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    return np.array([[float(v) for v in line.split()] for line in done.stdout.splitlines()])


@pytest.mark.parametrize(("seed", "count"), [(ON_OFF, 3), (PWM, 3), (LINGERING, 6)])
def test_c_says_what_python_says(seed: int, count: int, tmp_path: Path) -> None:
    _, design = made(seed)
    for given in (healthy(seed, count), spoilt(healthy(seed, count))):
        wanted = np.array([c.verdict.z for c in verdicts(design, given)])
        found = in_c(tmp_path, seed, given, "gcc", "-O1")
        assert len(wanted) >= 2 and np.isfinite(wanted).all()
        np.testing.assert_allclose(found[:, 2:], wanted, rtol=1e-6, atol=1e-6)


def test_c_learns_from_the_first_cycles_as_python_does(tmp_path: Path) -> None:
    """Of a machine on which the observer sees friction that is not there."""
    given = healthy(BIASED, LEARNING + 4)
    wanted = np.array([c.verdict.z for c in verdicts(made(BIASED)[1], given)])
    found = in_c(tmp_path, BIASED, given, "gcc", "-O1")
    assert len(wanted) > LEARNING and np.max(np.abs(wanted)) < threshold()
    np.testing.assert_allclose(found[:, 2:], wanted, rtol=1e-6, atol=1e-6)
    blind = replace(made(BIASED)[1], learning=np.zeros(COUNT))
    pool = Pool(blind.scatter, blind.errors, blind.scales)
    assert any(c.verdict.alarms for c in monitored(blind, given, pool))


@pytest.mark.parametrize("with_", ["gcc", "clang"])
def test_nothing_that_is_not_finite_alarms_or_crashes(with_: str, tmp_path: Path) -> None:
    given = spoilt(healthy(ON_OFF))
    found = in_c(tmp_path, ON_OFF, given, with_, *_SAFE)
    assert len(found) >= 2 and np.isfinite(found).all()
    assert set(found[:, 0]) == {0.0}
    assert found[-1, 1] >= 20


def test_single_precision_says_about_the_same(tmp_path: Path) -> None:
    _, design = made(ON_OFF)
    wanted = np.array([c.verdict.z for c in verdicts(design, healthy(ON_OFF))])
    found = in_c(tmp_path, ON_OFF, healthy(ON_OFF), "gcc", "-O1", "-DSYSID_REAL=float")
    assert np.max(np.abs(found[:, 2:] - wanted)[:, list(TESTED)]) < 0.5


def test_a_header_states_what_its_monitor_detects(tmp_path: Path, rig_text: str) -> None:
    own, _ = made(ON_OFF)
    export_bundle(own.bundle, tmp_path / "model.h", "c", check=False)
    text = (tmp_path / "model.h").read_text()
    assert "#define SYSID_HAS_MONITOR 1\n" in text
    assert "one in 1,000,000 healthy cycles" in text
    assert all(f"{DRIFTS[k].title}: " in text for k in TESTED)
    export_bundle(whole_bundle(rig_text), tmp_path / "without.h", "c", check=False)
    text = (tmp_path / "without.h").read_text()
    assert "#define SYSID_HAS_MONITOR 0 /* " in text and "pressure_noise_pa" in text


# --- by command -------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A machine's bundle and a log of it, worn."""
    own, _ = made(ON_OFF)
    write_bundle(own.bundle, tmp_path / "bundle.json")
    given = healthy(ON_OFF)
    write_run(tmp_path / "run.csv", own, given)
    return tmp_path / "bundle.json", tmp_path / "run.csv"


def write_run(path: Path, own: Machine, given: WatchedSamples) -> None:
    columns = {
        "time_s": given.time,
        own.bundle.rig.position_channel: given.position,
        **{f"pressure_{s}_pa": p for s, p in given.pressure.items()},
        **{f"valve_{s}": v for s, v in given.valve.items()},
    }
    write_table(pd.DataFrame(columns), path, [])


def test_the_command_watches_logs(files: tuple[Path, Path], tmp_path: Path) -> None:
    bundle, log = map(str, files)
    out = tmp_path / "watched.json"
    ran = CliRunner().invoke(monitor_command, [bundle, log, "--json", "-o", str(out)])
    assert ran.exit_code == 0, ran.output
    said = json.loads(ran.stdout)
    assert said["alarm"] is None and len(said["tests"][0]["cycles"]) >= 2
    assert set(said["smallest_detectable"]) == {NAMES[k] for k in TESTED}
    assert json.loads(out.read_text())["tests"] == said["tests"]
    ran = CliRunner().invoke(monitor_command, [bundle, log])
    assert "the machine obeys its bundle" in ran.stdout and "off-delay of valve B" in ran.stdout


def test_a_log_without_motion_or_a_column_is_refused(
    files: tuple[Path, Path], tmp_path: Path, rig_text: str
) -> None:
    bundle, log = files
    lines = log.read_text().splitlines()
    short = tmp_path / "short.csv"
    short.write_text("\n".join(lines[:300]) + "\n")
    ran = CliRunner().invoke(monitor_command, [str(bundle), str(short)])
    assert ran.exception is not None and "no cycle" in str(ran.exception)
    write_bundle(whole_bundle(rig_text), tmp_path / "silent.json")
    ran = CliRunner().invoke(monitor_command, [str(tmp_path / "silent.json")])
    assert isinstance(ran.exception, InputError) and "pressure_noise_pa" in str(ran.exception)


def test_a_fleet_shows_the_alarms_of_its_rigs_first_monitor(tmp_path: Path) -> None:
    own, _ = made(ON_OFF)
    leak = Change("leak_a", 2e-16)
    worn = list(cycles(own, SETTLING + 4, np.random.default_rng(3), leak))[SETTLING:]
    runs = {"2025-01-10": healthy(ON_OFF), "2025-02-11": healthy(ON_OFF)}
    runs["2025-03-12"] = samples_of(own, worn)
    rows = []
    for day, given in runs.items():
        (tmp_path / day).mkdir()
        (tmp_path / day / "rig.toml").write_text(rig_toml(own.rig.content))
        write_run(tmp_path / day / "run.csv", own, given)
        path = tmp_path / day / "campaign.toml"
        path.write_text('rig = "rig.toml"\n[[log]]\nkind = "motion-discrete"\nfile = "run.csv"\n')
        write_bundle(own.bundle, tmp_path / day / "bundle.json")
        rows.append(FleetRow(str(path), day, origin_of(read_campaign(path))))
    found = fleet_of(with_alarms(rows, tmp_path))
    assert [row.alarm for row in found.rows[:2]] == [None, ""]
    assert found.rows[2].alarm == "leakage (leak of chamber A, at supply pressure)"
    text = fleet_page(found)
    assert "no alarm" in text and "leakage (leak of chamber A" in text
