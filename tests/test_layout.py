"""The layout of the package: one room a subject, arrows only downwards, no circle.

`FLOORS` is the order of the table in CONTRIBUTING.md, from the ground up. A module imports only
from its own room and from floors below it.
"""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "sysid"

FLOORS: tuple[tuple[str, ...], ...] = (
    ("errors", "types"),
    ("signals", "estimation", "parallel"),
    ("blocks",),
    ("io",),
    ("plant",),
    ("recording", "surfaces"),
    ("balance", "parameters"),
    ("identification",),
    ("friction", "valve_discrete", "valve_pwm"),
    ("validation",),
    ("refinement",),
    ("controllers",),
    ("diagnosis", "thesis"),
    ("checks", "exporters", "fleet"),
    ("components",),
    ("pipeline",),
    ("app",),
    ("commands",),
)
# Figures that only fall: entries of `sysid/` without its face, floors that the arrows need, and
# arrows: pairs of rooms of which one imports from the other, inside functions too.
ENTRIES, HEIGHT, ARROWS = 28, 14, 181
FLOOR_OF = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
# The package's own face: loads each public name when it is first used.
FACE = ("sysid", "sysid.__main__")


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def room_of(module: str) -> str:
    return module.split(".")[1]


@functools.cache
def imported(path: Path) -> tuple[tuple[str, str], ...]:
    """(module, name) of every import from the package, those inside functions among them."""
    found = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "sysid":
            assert node.level == 0 and node.module is not None
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.append((whole, "") if whole in MODULES else (node.module, alias.name))
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "sysid":
                    found.append((alias.name, ""))
    return tuple(found)


INSIDE = [module for module in MODULES if module not in FACE]


def test_every_room_has_a_floor() -> None:
    assert {room_of(module) for module in INSIDE} == set(FLOOR_OF)


def test_the_table_of_rooms_names_them_all() -> None:
    text = (PACKAGE.parent / "CONTRIBUTING.md").read_text("utf-8")
    table = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    named = set(re.findall(r"`(?:sysid/)?(\w+)(?:/|\.py)`", " ".join(table)))
    assert set(FLOOR_OF) <= named


@pytest.mark.parametrize("module", INSIDE)
def test_imports_go_downwards(module: str) -> None:
    own = room_of(module)
    for target, name in imported(MODULES[module]):
        if target == "sysid":
            assert name == "__version__", f"{module} imports {name} from the package's face"
            continue
        room = room_of(target)
        assert room == own or FLOOR_OF[room] < FLOOR_OF[own], f"{module} imports {target}"


@functools.cache
def arrows_found() -> set[tuple[str, str]]:
    return {
        (room_of(module), room_of(target))
        for module in INSIDE
        for target, _ in imported(MODULES[module])
        if target != "sysid" and room_of(target) != room_of(module)
    }


@functools.cache
def height(room: str) -> int:
    """Rooms of the longest way down from a room, itself among them."""
    return 1 + max((height(other) for own, other in arrows_found() if own == room), default=0)


def test_entries_floors_and_arrows_do_not_grow() -> None:
    assert len(FLOOR_OF) <= ENTRIES
    assert max(map(height, FLOOR_OF)) <= HEIGHT
    found = arrows_found()
    assert len(found) <= ARROWS, f"one of these is new: {sorted(found)}"


@pytest.mark.parametrize("module", MODULES)
def test_private_names_stay_in_their_package(module: str) -> None:
    package = MODULES[module].parent
    for target, name in imported(MODULES[module]):
        private = [part for part in target.split(".") if part.startswith("_")]
        if name.startswith("_") and not name.startswith("__"):
            raise AssertionError(f"{module} imports {target}.{name}")
        assert not private or MODULES[target].parent == package, f"{module} imports {target}"


def test_no_circle_of_modules() -> None:
    """Imports at the top of files, and those inside functions, have an order."""
    arrows = {m: {t for t, _ in imported(p) if t in INSIDE} - {m} for m, p in MODULES.items()}
    done: set[str] = set()
    while len(done) < len(arrows):
        free = {m for m, targets in arrows.items() if m not in done and targets <= done}
        assert free, f"a circle among {sorted(set(arrows) - done)}"
        done |= free


def test_a_bundle_is_not_walked_by_keys() -> None:
    """A bundle's content has types: text keys are for reading and writing its file."""
    walked = re.compile(r"""\bbundle(\.get\(|\[)["']""")
    found = {m: walked.findall(p.read_text("utf-8")) for m, p in MODULES.items()}
    assert not {m: hits for m, hits in found.items() if hits}


def test_units_of_a_motion_have_one_address() -> None:
    """What rotary and linear quantities are measured in and called: `rig.units`, `bundle.units`."""
    words = "N|Nm|n|nm|m|rad|force|torque|linear|rotary"
    spelled = re.compile(rf"""["'](?:{words})["'] if \S*is_linear""")
    found = {m for m, path in MODULES.items() if spelled.search(path.read_text("utf-8"))}
    assert not found


def test_keys_of_friction_have_one_address() -> None:
    """A parameter has one name inside; its key in a file has the unit in it."""
    key = re.compile(r"(?:static|coulomb)_nm?|viscous_nm?_s_per_\w+")
    found = {
        module
        for module, path in MODULES.items()
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if key.fullmatch(node.value)
    }
    assert found == {"sysid.io.motion"}


def test_a_class_name_has_one_meaning() -> None:
    owners: dict[str, list[str]] = {}
    for module in INSIDE:
        for node in ast.parse(MODULES[module].read_text("utf-8")).body:
            if isinstance(node, ast.ClassDef):
                owners.setdefault(node.name, []).append(module)
    twice = {name: modules for name, modules in owners.items() if len(modules) > 1}
    assert not twice


# One job, one module: how the job's own code looks, as a pattern of source lines.
JOBS: dict[str, tuple[str, str]] = {
    # A predictor that its reversed self extends, by a reflection coefficient.
    "autoregression": (
        r"(\w+) [-+] \w+ \* \1\[::-1\]|def _?(burg|levinson)",
        "estimation.autoregression",
    ),
    # The factor (n - 1)/n of the sum of squares.
    "jackknife": (
        r"\((\w+|len\(\w+\)) - 1(?:\.0)?\) / \1|def _?leave_one\w*\(",
        "estimation.jackknife",
    ),
    # What an iteration corrects by the error that a `measure`, `sense` or actuator's port adds.
    "sensors undone": (
        r"for _ in range\(.*\n(.*\n){0,3}?.*(measured?|sense|through_sensors|error|motor_effort)\(",
        "plant.sensors",
    ),
    # Edges of bins of equal count.
    "residual over a regressor": (r"\.unique\(np\.quantile\(", "diagnosis.binning"),
    # Each test predicted by the means of the others.
    "structure that repeats": (
        r"- means\) / np\.maximum\(tests - 1|predicted_share|HistGradientBoosting",
        "diagnosis.lack_of_fit",
    ),
    "integration of sampled inputs": (
        r"0\.5 \* \w+ \* \(\w+ \+ \w+\)|def _?(heun|rodas\w*|runge_kutta)\(",
        "plant.steps",
    ),
}

# The old search is replaced whole: what it calls a rest goes with it.
OWN_REST = {"sysid.diagnosis.actuator.breakaways", "sysid.diagnosis.actuator.samples"}
# Static friction by a coarse encoder came out too small with a rest by the record's own scale.
OWN_REST |= {"sysid.identification.friction.static"}


def test_rest_has_one_meaning() -> None:
    """No module says in seconds, or in a speed of its own, when a shaft is at rest."""
    said = re.compile(r"^_?[A-Z_]*REST_(S|SPEED)\b.* = ", re.MULTILINE)
    assert {m for m, p in MODULES.items() if said.search(p.read_text("utf-8"))} == OWN_REST


@pytest.mark.parametrize("job", JOBS)
def test_a_job_has_one_address(job: str) -> None:
    looks, address = JOBS[job]
    pattern = re.compile(looks, re.MULTILINE)
    found = {m for m, p in MODULES.items() if pattern.search(p.read_text("utf-8"))}
    assert found == {f"sysid.{address}"}


OUTSIDE = [
    path for room in ("datasets", "benchmarks") for path in (PACKAGE.parent / room).rglob("*.py")
]


@pytest.mark.parametrize("path", OUTSIDE, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_data_and_benchmarks_use_the_library_not_the_commands(path: Path) -> None:
    """What they want of a command they start as a process, as a user does."""
    rooms = {target.split(".")[1] for target, _ in imported(path) if target.startswith("sysid.")}
    assert "commands" not in rooms


PACKAGES = [
    path for name, path in MODULES.items() if path.name == "__init__.py" and name != "sysid"
]


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.parent.name)
def test_what_a_room_says_of_itself_is_there(path: Path) -> None:
    """Each word in code type of a room's docstring is a file in it, or a name of its modules."""
    said = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    files = {p.stem for p in path.parent.rglob("*") if "__pycache__" not in p.parts}
    written = "".join(p.read_text("utf-8") for p in path.parent.rglob("*.py"))
    for word in re.findall(r"(?<!`)`([a-z_0-9]+)(?:\.py|/)?`(?!`)", said):
        assert word in files or re.search(rf"(?:def |class |\b){word}\b\s*[(:=]", written), word
