"""Counts of work that do not depend on the machine: a slowdown fails here without a stopwatch.

A bound is what was counted when it was set, and a tenth; what has become less work lowers it.
"""

from __future__ import annotations

import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from golden_folder import BUNDLED

from sysid.commands.app import main
from sysid.identification.friction import static
from sysid.io import logs
from sysid.io.rig import read_rig
from sysid.surfaces import averaged_fit


class Counted:
    """A function that counts its calls."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.calls = function, 0

    def __call__(self, *words: Any, **options: Any) -> Any:
        self.calls += 1
        return self.function(*words, **options)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("rig.toml", "friction_static.parquet", "valve_pwm_a.parquet"):
        shutil.copy(BUNDLED / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def counted(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> Counted:
    found = Counted(getattr(module, name))
    monkeypatch.setattr(module, name, found)
    return found


@pytest.mark.usefixtures("folder")
def test_a_fit_and_its_page_read_a_log_and_find_an_onset_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reads = counted(monkeypatch, logs, "read_table")
    squares = counted(monkeypatch, static, "_rest_then_motion")
    static._begins.cache_clear()
    assert main(["fit", "friction", "friction_static.parquet"]) == 0
    ramps = static._begins.cache_info()
    assert reads.calls == 1
    assert ramps.misses <= ramps.hits  # the check and the comparison ask for the same
    assert squares.calls <= 33 * ramps.misses


@pytest.mark.usefixtures("folder")
def test_a_pwm_fit_evaluates_its_law_as_seldom_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    reads = counted(monkeypatch, logs, "read_table")
    flows = counted(monkeypatch, averaged_fit, "_mean_flow")
    words = ["--surface", "bipolynomial", "-o", "none", "--no-report"]
    assert main(["fit", "valve-pwm", "valve_pwm_a.parquet", *words]) == 0
    assert reads.calls == 1
    assert flows.calls <= 440


def test_reading_a_log_takes_so_many_bytes_a_row(folder: Path) -> None:
    rows = 20_000
    time = 1e-3 * np.arange(rows)
    columns = [time, 0.3 * np.sin(time), 1e5 + 1e3 * np.sin(3.0 * time), np.full(rows, 1e5)]
    path = folder / "log.csv"
    header = "time_s,theta_rad,pressure_a_pa,pressure_b_pa"
    np.savetxt(path, np.stack(columns, axis=1), "%.6f", ",", header=header, comments="")
    rig = read_rig(folder / "rig.toml")
    logs.read_log(path, rig)  # what is imported at first use is not counted
    tracemalloc.start()
    try:
        log = logs.read_log(path, rig)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(log.trials[0]) == rows
    assert peak / rows <= 580.0
