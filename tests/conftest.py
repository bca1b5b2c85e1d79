"""What several tests share."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED = REPOSITORY.parent / "shared"
MOST_MEMORY_MB = 2500.0
CHROMIUM = Path("/usr/bin/chromium")
CHROMIUM_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]

# The workers of pytest keep the cores busy: processes that a test starts besides would each load
# the package, and what jax has compiled, again. A test of several processes sets their number.
os.environ.setdefault("SYSID_JOBS", "1")
# The generator's compiled loops gain nothing from vectorisers, which take a third of its compiling.
os.environ.setdefault("NUMBA_SLP_VECTORIZE", "0")
os.environ.setdefault("NUMBA_LOOP_VECTORIZE", "0")

LOOP_OPTIONS = {
    "xla_backend_optimization_level": 0,
    "xla_llvm_enable_alias_scope_metadata": False,
    "xla_llvm_enable_noalias_metadata": False,
}

RIG_TEXT = """\
[rig]
name = "arm"
orientation = "horizontal"

[air]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
temperature_k = 293.15
atmospheric_pressure_pa = 100000.0
supply_pressure_pa = 300000.0

[cylinder]
area_a_m2 = 4.524e-4
area_b_m2 = 4.207e-4
offset_a_m = 0.075
offset_b_m = 0.075
stroke_m = 0.127
pitch_radius_m = 0.0375

[inertia]
equivalent_kg_m2 = 0.02368

[motor]
torque_per_volt_nm = 0.0795
max_torque_nm = 0.795

[pwm]
period_s = 0.005

[valves]
on_delay_s = 0.0017
off_delay_s = 0.002

[sampling]
period_s = 0.001

[sensors]
encoder_counts_per_rev = 80000
"""


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """How many tests were skipped for want of the data beside the project."""
    for folder in ("data", "samples", "spec"):
        wanted = f"../shared/{folder} is absent"
        count = sum(
            wanted in str(report.longrepr) for report in terminalreporter.stats.get("skipped", [])
        )
        terminalreporter.write_line(f"skipped for want of ../shared/{folder}: {count}")


def pytest_collection_finish() -> None:
    """What was imported and collected stays: it is left out of every collection of garbage.

    What jax traces is objects that stay too: searched for garbage as often as by default, they take
    5 % of the tests that trace.

    Most closed loops are run once, and compile for 5 to 20 s: without LLVM's notes on which arrays
    do not overlap, and without its optimisations, they take half of that.
    """
    gc.freeze()
    gc.set_threshold(10_000)
    loop: Any = sys.modules.get("sysid.controllers.loop")
    if loop is not None:
        loop._COMPILER_OPTIONS.update(LOOP_OPTIONS)


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Between files, what jax has compiled is let go of where it has grown large.

    It is in jax's cache of files: what is needed again is loaded from there.
    """
    same_file = nextitem is not None and nextitem.path == item.path
    jax = sys.modules.get("jax")
    if same_file or jax is None or _memory_mb() < MOST_MEMORY_MB:
        return
    jax.clear_caches()
    gc.collect()


def _memory_mb() -> float:
    """Of this process; 0 where it is not told."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.fixture
def rig_text() -> str:
    """A whole rig file (the thesis' reference rig)."""
    return RIG_TEXT


def shared_folder(name: str) -> Path:
    """A folder beside the project; skips the test visibly where it is absent."""
    folder = SHARED / name
    if not folder.is_dir():
        pytest.skip(f"../shared/{name} is absent")
    return folder


@pytest.fixture
def shared_data() -> Path:
    """The measured data."""
    return shared_folder("data")


@pytest.fixture
def shared_spec() -> Path:
    """The contracts."""
    return shared_folder("spec")


@pytest.fixture
def shared_samples() -> Path:
    """The sample campaigns."""
    return shared_folder("samples")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium; skips visibly where it or playwright is absent."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is absent")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is absent")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=str(CHROMIUM), args=CHROMIUM_ARGUMENTS
        )
        yield chromium
        chromium.close()
