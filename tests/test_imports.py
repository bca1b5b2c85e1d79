"""What each command imports: nothing heavy that it does not compute with, and torch only to train.

One process runs the commands, from light to heavy, without torch: each may load what is listed for
it and nothing else, and a module that one has loaded is loaded for those after it.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from golden_folder import Folder

REPOSITORY = Path(__file__).resolve().parent.parent
HEAVY = (
    "bokeh", "dask", "jax", "joblib", "matplotlib", "optimistix", "pandas", "panel",
    "scipy.optimize", "scipy.signal", "scipy.stats", "sympy", "torch",
)  # fmt: skip
FRICTION, PWM = "friction_static.parquet", "valve_pwm_a.parquet"
# Each command, what it is the first to load, and the most modules of ours loaded by then.
COMMANDS: tuple[tuple[str, set[str], int], ...] = (
    ("--help", set(), 20),
    ("effects", set(), 75),
    ("export bundle.json --format json -o gains.json", set(), 160),
    ("export bundle.json --format mat -o gains.mat", set(), 160),
    ("compare bundle.json bundle.json", set(), 180),
    ("convert motion.csv -o converted.csv", {"pandas"}, 190),
    (f"check {FRICTION}", set(), 250),
    (f"fit friction {FRICTION} -o none --no-report", set(), 255),
    (f"fit friction {FRICTION} -o part.json --report part.html", {"matplotlib"}, 290),
    (f"fit valve-pwm {PWM} --surface bipolynomial -o none --no-report", {"scipy.optimize"}, 310),
    # The replayed controllers filter what they measure; scipy.signal loads scipy.stats.
    ("export bundle.json --format c -o c.h", {"scipy.signal", "scipy.stats", "sympy"}, 365),
)  # fmt: skip
# Fits of one part in a process of their own: packages of ours that they have no use for.
ALONE = {
    f"fit friction {FRICTION} -o part.json --report part.html": (
        "sysid.components", "sysid.identification.valve_pwm", "sysid.parameters.assembled_model",
        "sysid.plant.effects", "sysid.plant.ports",
    ),
    f"fit valve-pwm {PWM} --surface bipolynomial -o part.json --no-report": (
        "sysid.checks", "sysid.components", "sysid.friction", "sysid.parameters.assembled_model",
        "sysid.pipeline.report", "sysid.plant.effects", "sysid.plant.ports", "sysid.validation",
    ),
}  # fmt: skip
SCRIPT = """\
import contextlib, io, json, sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name == "torch":
            raise ImportError("torch is not here")
sys.meta_path.insert(0, Without())
from sysid.commands.app import main
heavy, commands = json.loads(sys.argv[1])
for words in commands:
    with contextlib.redirect_stdout(io.StringIO()):
        status = main(words.split())
    loaded = [name for name in heavy if name in sys.modules]
    ours = sum(name.startswith("sysid") for name in sys.modules)
    print(json.dumps({"status": status, "loaded": loaded, "ours": ours}))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of a rig, and a bundle."""
    made = Folder(tmp_path_factory.mktemp("imports"))
    made.bundled(FRICTION, PWM)
    made.bundle("diagnosed")
    return made.path


def loaded_by(commands: Sequence[str], names: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    """What one process holds after each command: its status, which of `names`, how many of ours."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps([names, commands])], cwd=folder,
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        timeout=300, check=True,
    )  # fmt: skip
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def found(folder: Path) -> dict[str, dict[str, Any]]:
    """For each command: its status, the heavy modules and the number of ours loaded by its end."""
    commands = [words for words, _, _ in COMMANDS]
    return dict(zip(commands, loaded_by(commands, HEAVY, folder), strict=True))


@pytest.mark.parametrize("number", range(len(COMMANDS)))
def test_a_command_loads_what_it_computes_with(
    number: int, found: dict[str, dict[str, Any]]
) -> None:
    words, _, most = COMMANDS[number]
    allowed = set().union(*(own for _, own, _ in COMMANDS[: number + 1]))
    assert found[words]["status"] == 0
    assert set(found[words]["loaded"]) == allowed
    assert found[words]["ours"] <= most


@pytest.mark.parametrize("words", ALONE)
def test_a_fit_of_one_part_loads_no_other_parts(words: str, folder: Path) -> None:
    (found,) = loaded_by([words], ALONE[words], folder)
    assert found["status"] == 0
    assert found["loaded"] == []


def test_torch_is_imported_where_a_network_is_trained_and_nowhere_else() -> None:
    """Read, simulated and exported, a network is its numbers."""
    importing = {}
    for path in (REPOSITORY / "sysid").rglob("*.py"):
        names = _imported(ast.parse(path.read_text("utf-8")))
        if {"torch", "network_training"} & names:
            importing[path.name] = names & {"torch", "network_training"}
    assert importing == {"ann.py": {"torch", "network_training"}, "network_training.py": {"torch"}}
    tree = ast.parse((REPOSITORY / "sysid/surfaces/ann.py").read_text("utf-8"))
    inside = {
        node.name
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and {"torch", "network_training"} & _imported(node)
    }
    assert inside == {"_train"}


def _imported(tree: ast.AST) -> set[str]:
    """Top-level packages, and names of modules, that code imports."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {alias.name for alias in node.names} | {(node.module or "").split(".")[0]}
            names |= {(node.module or "").rsplit(".", 1)[-1]}
    return names
