"""Rows that share a time stamp: a coarse clock, rows written twice, and what is ambiguous."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.errors import InputError
from sysid.io.logs import Log, read_log
from sysid.io.repeated_times import spread_evenly
from sysid.io.rig import read_rig

RIG = """
[rig]
name = "axis"
motion = "linear"
orientation = "horizontal"
"""


def log_of(
    folder: Path,
    time: np.ndarray,
    place: np.ndarray | None = None,
    force: np.ndarray | None = None,
) -> Log:
    (folder / "rig.toml").write_text(RIG)
    since = np.arange(len(time)) * 1e-3
    position = 0.02 * np.sin(9.0 * since) if place is None else place
    force = 5.0 * np.cos(9.0 * since) if force is None else force
    path = folder / "run.csv"
    table = np.column_stack([time, position, force])
    np.savetxt(path, table, "%.10g", ",", comments="", header="time_s,position_m,motor_force_n")
    return read_log(path, read_rig(folder / "rig.toml"))


@pytest.mark.parametrize(
    "tick", [2e-3, 2.5e-3, 1e-2, 1.5625e-2], ids=["2", "2.5", "10", "15.625 ms"]
)
@pytest.mark.parametrize("begins", [0.0, 0.37])
def test_rows_of_a_coarse_clock_are_spread_evenly(
    tmp_path: Path, tick: float, begins: float
) -> None:
    true = begins * tick + 1e-3 * np.arange(2000)
    stamps = np.floor(true / tick + 1e-9) * tick
    log = log_of(tmp_path, stamps)
    (trial,) = log.trials
    assert np.diff(trial.time) == pytest.approx(1e-3, rel=1e-3)
    # Late by less than a row throughout.
    assert np.ptp(trial.time - true) < 1e-3
    (said,) = [line for line in log.notices if "coarse" in line]
    assert f"a clock that counts {tick:.3g} s is too coarse" in said
    assert "run.csv, line " in said and "they are spread evenly, 0.00" in said


def test_stamps_that_rounding_makes_equal_are_spread(tmp_path: Path) -> None:
    jitter = np.random.default_rng(2).uniform(-3e-4, 3e-4, 2000)
    stamps = np.round(1e-3 * np.arange(2000) + 4.9e-4 + jitter, 3)
    assert np.any(np.diff(stamps) == 0.0) and np.any(np.diff(stamps) > 1.5e-3)
    (trial,) = log_of(tmp_path, stamps).trials
    assert np.diff(trial.time) == pytest.approx(1e-3, rel=1e-3)


def test_rows_written_twice_are_omitted_and_others_refused(tmp_path: Path) -> None:
    rows = np.sort(np.concatenate([np.arange(400), [50, 51, 300]]))
    place, force = 0.02 * np.sin(0.009 * rows), 5.0 * np.cos(0.009 * rows)
    log = log_of(tmp_path, 1e-3 * rows, place, force)
    (trial,) = log.trials
    np.testing.assert_allclose(trial.time, 1e-3 * np.arange(400), atol=1e-12)
    np.testing.assert_allclose(trial["motor_force_n"], 5.0 * np.cos(0.009 * np.arange(400)))
    (said,) = [line for line in log.notices if "twice" in line]
    assert "run.csv, line 53 and 2 more: the row before, written twice: omitted" in said
    force[51] += 1.0
    with pytest.raises(InputError, match=r"line 53: time_s repeats 0\.05, with other values; del"):
        log_of(tmp_path, 1e-3 * rows, place, force)


def test_a_row_too_many_is_refused() -> None:
    time = np.sort(np.append(1e-3 * np.arange(300), 0.1))
    assert spread_evenly(time) is None
    # So is a recording that lost rows: where they are missing nothing says.
    coarse = np.repeat(1e-2 * np.arange(50), 10)
    assert spread_evenly(coarse) is not None
    assert spread_evenly(np.delete(coarse, slice(203, 225))) is None
    assert spread_evenly(np.repeat([0.0, 1.0, 2.0], 5)) is None
    assert spread_evenly(-time) is None
    # A clock that stops.
    assert spread_evenly(np.minimum(1e-3 * np.arange(300), 0.1)) is None
