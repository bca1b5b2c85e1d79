"""Every stateless effect of the catalogue in C: the class itself, printed, against the class."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import conftest
import numpy as np
import pytest
from export_bundles import RISING, upright, whole_bundle
from export_compiler import STRICT, Compiled, compiler, header, macros
from shared_results import made_once

from sysid.exporters import export_bundle
from sysid.exporters.c_constants import own_constants
from sysid.exporters.c_ports import ARGUMENTS, Port, ports
from sysid.exporters.flat import flatten
from sysid.parameters import Bundle, write_bundle
from sysid.parameters.assembled_model import parameters_from_bundle
from sysid.parameters.effects import entry_of
from sysid.pipeline.export import export_file
from sysid.plant.base import exhaust_boundary, filling_boundary
from sysid.plant.effects.catalogue import catalogue, load_user_effects
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, Point
from sysid.types import FloatArray

N = 10_000
# What follows from more than the point where the model is.
WITH_STATE = {
    "presliding",
    "backlash",
    "link-flexibility",
    "amplifier-lag",
    "wall-heat-transfer",
    "tube-lag",
    "duty-dead-zone",
    "sticking-valve",
    "pressure-lag",
    "time-skew",
    "lost-counts",
    "stiction-after-rest",
}
STATELESS = sorted(set(catalogue()) - WITH_STATE)
CHANGED_CONSTANTS = {
    "area-error": {"area_b_m2"},
    "inertia-mismatch": {"inertia_kg_m2", "gravity_moment_nm"},
    "polytropic-exponent": {"heat_capacity_ratio", "k_r_t_j_per_kg"},
    "dead-volume-error": {"offset_a_m", "offset_b_m"},
    "ambient-pressure-error": {"atmospheric_pressure_pa"},
}
DRIFTING = {"temperature-drift"}


def bundle_with(effects: list[CatalogueEffect], assumed: str = "") -> Bundle:
    """A bundle that holds everything, of a rig that has gravity, with a constant assumed."""
    rig_text = upright(conftest.RIG_TEXT)
    if assumed:
        rig_text = f'assumed = ["{assumed}"]\n{rig_text}'
    return whole_bundle(rig_text, [RISING] * 4).with_effects(entry_of(e) for e in effects)


def sized(name: str, seed: int | None) -> CatalogueEffect:
    """An effect at its usual size, or with a seed anywhere within its bounds."""
    kind = catalogue()[name]
    if seed is None:
        return kind.typical()
    rng = np.random.default_rng(seed)
    sizes = {
        q.name: float(rng.choice(q.grid) if q.is_choice else rng.uniform(q.lower, q.upper))
        for q in kind.quantities
    }
    # A droop behind a volume has a state.
    return kind(**{n: 0.0 if n == "line_time_s" else size for n, size in sizes.items()})


def signatures(text: str, prefix: str) -> dict[str, list[str]]:
    """The functions with effects of a header: names of their arguments, by their own."""
    found = re.findall(rf"{prefix}(\w+)_with_effects\(([^)]*)\)\n{{", text)
    return {name: [part.split()[-1] for part in inputs.split(",")] for name, inputs in found}


@dataclass(frozen=True)
class Headers:
    """One header an effect in `folder`, and `all.c`, which loops over all their functions."""

    folder: Path
    effects: dict[str, CatalogueEffect]
    signatures: dict[str, dict[str, list[str]]]


def write_headers(folder: Path, seed: int | None) -> Headers:
    """Export each effect at its size of this seed.

    Those at their usual sizes with all that a header holds. Others differ in their constants: these
    are without controllers, which may not rest on an assumed constant and take most of the work.
    """
    headers = Headers(folder, {name: sized(name, seed) for name in STATELESS}, {})
    assumed = "" if seed is None else "cylinder.area_a_m2"
    lines = []
    for k, name in enumerate(STATELESS):
        prefix, path = f"e{k}_", folder / f"e{k}.h"
        bundle = bundle_with([headers.effects[name]], assumed)
        export_bundle(bundle, path, "c", prefix=prefix, check=False)
        headers.signatures[name] = signatures(path.read_text(), prefix)
        lines.append(f'#include "{path.name}"')
        lines += [
            _loop(f"{prefix}{function}", arguments)
            for function, arguments in headers.signatures[name].items()
        ]
    (folder / "all.c").write_text("\n".join(lines) + "\n")
    return headers


class Library:
    """The functions of one header an effect, all in one shared library."""

    def __init__(self, headers: Headers, output: Path, real: str, command: str) -> None:
        self.signatures, self.effects = headers.signatures, headers.effects
        options = [*STRICT, f"-DSYSID_REAL={real}", "-shared", "-fPIC", "all.c", "-lm"]
        made = subprocess.run(
            [compiler(command), *options, "-o", output],
            cwd=headers.folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert made.returncode == 0, made.stderr[:3000]
        self._library = ctypes.CDLL(str(output))

    def __call__(self, effect: str, function: str, values: dict[str, FloatArray]) -> FloatArray:
        k, out = STATELESS.index(effect), np.empty(N)
        inputs = [np.ascontiguousarray(values[name]) for name in self.signatures[effect][function]]
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*inputs, out)]
        getattr(self._library, f"all_e{k}_{function}")(ctypes.c_int(N), *pointers)
        return out


def _loop(name: str, arguments: list[str]) -> str:
    inputs = "".join(f"const double *x{k}, " for k in range(len(arguments)))
    values = ", ".join(f"(SYSID_REAL)x{k}[i]" for k in range(len(arguments)))
    head = f"void all_{name}(int n, {inputs}double *out)"
    body = f"for (i = 0; i < n; i++) out[i] = (double){name}_with_effects({values});"
    return f"{head};\n{head}\n{{ int i; {body} }}"


Built = Callable[[int | None, str, str], Library]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Libraries by seed, precision and compiler: each is exported once, for all workers."""

    def headers(seed: int | None) -> Headers:
        folder = tmp_path_factory.mktemp("headers")
        return made_once(tmp_path_factory, f"headers_{seed}", lambda: write_headers(folder, seed))

    @cache
    def library(seed: int | None, real: str, command: str) -> Library:
        output = tmp_path_factory.mktemp("library") / "all.so"
        return Library(headers(seed), output, real, command)

    return library


@pytest.fixture(scope="module", params=[None, 7], ids=["usual", "any"])
def library(built: Built, request: pytest.FixtureRequest) -> Library:
    return built(request.param, "double", "gcc")


@pytest.fixture(scope="module")
def single(built: Built) -> Library:
    return built(None, "float", "gcc")


def inputs(seed: int, edges: float = 0.1) -> dict[str, FloatArray]:
    """Values (N,) of every argument at random, a share of each on the edges of its laws."""
    rng = np.random.default_rng(seed)
    supply, atmosphere = 3e5, 1e5
    corners = [supply, atmosphere, filling_boundary(supply), exhaust_boundary(atmosphere), 0.0, 1e9]

    def draw(values: FloatArray, corners: list[float]) -> FloatArray:
        return np.where(rng.random(N) < edges, rng.choice(corners, N), values)

    pressures = [draw(rng.uniform(8e4, 3.3e5, N), corners) for _ in range(2)]
    return {
        "position": draw(rng.uniform(-1.6, 1.6, N), [0.0]),
        "velocity": draw(rng.normal(0.0, 2.0, N), [0.0, 1e-300, -1e-300, 0.1]),
        "pressure_a_pa": pressures[0],
        "pressure_b_pa": pressures[1],
        "motor_command": rng.normal(0.0, 0.3, N),
        "open_a": draw(rng.random(N), [0.0, 1.0, 1e-9, 1.0 - 1e-9]),
        "open_b": draw(rng.random(N), [0.0, 1.0, 1e-9, 1.0 - 1e-9]),
        "duty_direction_a": rng.choice([-1.0, 0.0, 1.0], N),
        "duty_direction_b": rng.choice([-1.0, 0.0, 1.0], N),
        "time_s": draw(rng.uniform(0.0, 60.0, N), [0.0]),
        "friction": rng.normal(0.0, 0.3, N),
        "effort": draw(rng.normal(0.0, 0.6, N), [0.0, 1.0 / 1.8, -1.0 / 1.8]),
        "radius_m": np.full(N, 0.0375),
        "displacement_m": rng.uniform(-0.06, 0.06, N),
        "supply_pa": draw(rng.uniform(2e5, 3.3e5, N), [supply]),
        "atmosphere_pa": draw(rng.uniform(9.5e4, 1.05e5, N), [atmosphere]),
        "flow_kg_s": draw(rng.normal(0.0, 5e-4, N), [0.0, 7.8e-4, -3.5e-4]),
        "rate_pa_s": rng.normal(0.0, 1e6, N),
        "delay_s": rng.uniform(1e-3, 3e-3, N),
    }


def wanted(port: Port, model: Model, v: dict[str, FloatArray]) -> FloatArray:
    """What the effects' own ports make of a function's first argument."""
    names = [name for name in ARGUMENTS if not name.startswith(("duty_direction", "time_s"))]
    point = Point(
        v["time_s"],
        *(v[name] for name in names),
        np.sign(v["velocity"]),
        model.at(v["time_s"]),
        {name: v[name] for name in ("duty_direction_a", "duty_direction_b")},
    )
    value = v[port.arguments[0]]
    if port.port == "delays":
        found = model.through("delays", value, v["time_s"], port.is_opening, port.side)
    elif port.port == "pressure_rate":
        found = model.through(port.port, value, port.side, v["flow_kg_s"], point)
    else:
        found = model.through(port.port, value, *([port.side] if port.side else []), point)
    return np.asarray(found)


def comparisons(
    library: Library, effect: str, v: dict[str, FloatArray]
) -> Iterator[tuple[str, FloatArray, FloatArray, FloatArray]]:
    """Function, its values in C and in Python, and the size of the terms that make them up."""
    known = library.effects[effect]
    bundle = bundle_with([known])
    model = Model(parameters_from_bundle(bundle, bundle.rig), (known,))
    for port in ports():
        if port.name not in library.signatures[effect]:
            continue
        if port.channels:
            true = v["position"] if port.name == "true_position" else v[port.channels[0]]
            shown = model.through("measure", {port.channels[0]: true}, v["time_s"])
            measured = {**v, port.arguments[0]: shown[port.channels[0]]}
            yield port.name, library(effect, port.name, measured), true, np.abs(true) + 1e-3
            continue
        exact = wanted(port, model, v)
        yield port.name, library(effect, port.name, v), exact, np.abs(v[port.arguments[0]])


def worst(library: Library, effect: str, v: dict[str, FloatArray], of_rms: bool = False) -> float:
    """Largest difference between C and Python, relative to the value or its largest term.

    `of_rms`: or to the root mean square of the function's values, where that is larger.
    """
    found = [0.0]
    for _, got, exact, size in comparisons(library, effect, v):
        scale = np.maximum(np.abs(exact), size)
        if of_rms:
            scale = np.maximum(scale, np.sqrt(np.mean(exact**2)))
        assert np.isfinite(got).all() and np.isfinite(exact).all()
        found.append(float(np.max(np.abs(got - exact) / np.where(scale > 0.0, scale, 1.0))))
    return max(found)


@pytest.mark.parametrize("effect", STATELESS)
def test_an_effect_in_c_is_that_of_its_class(library: Library, effect: str) -> None:
    if effect in CHANGED_CONSTANTS:
        assert library.signatures[effect] == {}
    elif effect not in DRIFTING:
        v = inputs(1)
        changes = [
            bool(np.any(np.asarray(exact) != v[port.arguments[0]]))
            for name, _, exact, _ in comparisons(library, effect, v)
            for port in ports()
            if port.name == name and not port.channels
            if not library.effects[effect].is_idle(port.port)
        ]
        assert library.signatures[effect] and all(changes)
        assert worst(library, effect, v) <= 1e-12


@pytest.mark.parametrize("effect", STATELESS)
def test_an_effect_in_single_precision(single: Library, effect: str) -> None:
    """Away from the edges, where rounding decides on which side a value is.

    Relative to the value or the root mean square of all, whichever is larger: where a sine of
    many teeth or a root at the end of subsonic flow vanishes, the rounding of its argument
    does not, and such a value alone is right to 1e-3 (usual sizes: 2e-4).
    """
    assert worst(single, effect, inputs(2, edges=0.0), of_rms=True) <= 1e-4


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_every_law_compiles_without_a_warning(name: str, real: str, built: Built) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"no {name}: the C header is not compiled by it")
    assert built(None, real, name).signatures


@pytest.mark.parametrize("effect", sorted(CHANGED_CONSTANTS))
def test_an_effect_on_constants_is_in_them(effect: str, tmp_path: Path) -> None:
    known = catalogue()[effect].typical()
    bundle, bare = bundle_with([known]), bundle_with([])
    text = header(bundle, tmp_path)[0].read_text()
    found, base = _constants(text), _constants(header(bare, tmp_path)[0].read_text())
    changed = {name for name in base if found[name] != base[name]}
    assert changed == CHANGED_CONSTANTS[effect]
    assert all(f"with {effect}" in line for line in text.splitlines() if _is_one(line, changed))
    now = Model(parameters_from_bundle(bundle, bundle.rig), (known,)).at(0.0)
    for key, name in own_constants(flatten(bundle, "")).items():
        if name in found:
            assert found[name] == getattr(now, key), name


def _constants(text: str) -> dict[str, float]:
    lines = re.findall(r"const sysid_real sysid_(\w+) = \(sysid_real\)(\S+);", text)
    return {name: float(value) for name, value in lines}


def _is_one(line: str, names: set[str]) -> bool:
    return any(line.startswith(f"static const sysid_real sysid_{name} =") for name in names)


def test_constants_that_drift_are_functions_of_the_time(tmp_path: Path) -> None:
    effects = [catalogue()[name].typical() for name in ("temperature-drift", "polytropic-exponent")]
    bundle = bundle_with(effects)
    path, notices = header(bundle, tmp_path)
    assert notices == [] and macros(path)["SYSID_EFFECTS_ACT_ON_CONSTANTS_OVER_TIME"] == 1
    names = {"temperature_k_with_effects": 1, "k_r_t_j_per_kg_with_effects": 1}
    c, time = Compiled(tmp_path, names, ()), np.linspace(0.0, 600.0, N)
    p = Model(parameters_from_bundle(bundle, bundle.rig), tuple(effects)).at(time)
    got = c("temperature_k_with_effects", time)[0]
    np.testing.assert_allclose(got, p.temperature, rtol=1e-14)
    product = p.heat_capacity_ratio * p.gas_constant * p.temperature
    np.testing.assert_allclose(c("k_r_t_j_per_kg_with_effects", time)[0], product, rtol=1e-14)


def test_all_that_is_left_out_has_a_state_and_the_header_says_so(tmp_path: Path) -> None:
    bundle = bundle_with([effect.typical() for effect in catalogue().values()])
    path, notices = header(bundle, tmp_path)
    found, text = macros(path), path.read_text()
    assert found["SYSID_EFFECTS_CONTAINED"] == len(STATELESS)
    assert found["SYSID_EFFECTS_NOT_CONTAINED"] == len(WITH_STATE)
    (notice,) = notices
    for name in WITH_STATE:
        assert name in notice and re.search(rf"^ \* {name}: .*(state|test|time)", text, re.M)


def test_no_input_makes_a_law_misbehave(tmp_path: Path) -> None:
    """Address and undefined-behaviour sanitizers, over all inputs that a sensor could give."""
    bundle = bundle_with([effect.typical() for effect in catalogue().values()])
    text = header(bundle, tmp_path)[0].read_text()
    calls = [
        f"sum += sysid_{name}_with_effects({', '.join(f'v[(i + {5 * k}) % 9]' for k in range(n))});"
        for name, n in ((name, len(names)) for name, names in signatures(text, "sysid_").items())
    ]
    (tmp_path / "main.c").write_text(
        '#include "controller.h"\nint main(void)\n{\n'
        "double v[9] = {0.0, -1.0, 1.0, 1e5, 3e5, 1e9, NAN, INFINITY, -INFINITY}, sum = 0.0;\n"
        f"int i;\nfor (i = 0; i < 9; i++) {{ {' '.join(calls)} }}\n"
        "return sum == 1.5;\n}\n"
    )
    options = [*STRICT, "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = [compiler(), *options, "main.c", "-lm", "-o", "main"]
    made = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    if "cannot find" in made.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert made.returncode == 0, made.stderr[:3000]
    run = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[:3000]


def test_sympy_is_loaded_for_effects_in_c_alone() -> None:
    modules = "sys, sysid.exporters.c_header, sysid.commands.app"
    source = f"import {modules}; print('sympy' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


OWN = '''
from dataclasses import dataclass
import numpy as np
from sysid.plant.base import array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity

@dataclass(frozen=True)
class Bumper(CatalogueEffect):
    """A rubber stop."""
    stiffness: float = 0.0
    id = "bumper"
    title = "Rubber stop"
    subsystem = "mechanics"
    quantities = (Quantity("stiffness", "Nm", 0.3, 0.0, 5.0, "of the stop"),)
    signature = "torque near the ends"
    source = "own"

    def external_effort(self, effort, point):
        xp = array_namespace(point.position, self.stiffness)
        over = xp.clip(xp.abs(point.position) - 1.0, 0.0, None)
        return effort - self.stiffness * np.tanh(over) * np.sign(point.position) ** 3

@dataclass(frozen=True)
class Branching(Bumper):
    """A port with a branch on a value has no law in C."""
    id = "branching"

    def external_effort(self, effort, point):
        return effort if point.position > 0 else effort + self.stiffness
'''


def test_a_users_own_effect_is_exported(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text(OWN)
    kinds = load_user_effects(own)
    effects = [kinds["bumper"].typical(), kinds["branching"].typical()]
    write_bundle(bundle_with(effects), tmp_path / "bundle.json")
    source, header_file = tmp_path / "bundle.json", tmp_path / "controller.h"
    notices = export_file(source, header_file, format="c", effects=own)
    assert notices and all("branching" in line for line in notices)
    assert "a branch on a value has no C form" in (tmp_path / "controller.h").read_text()
    theta, zero = np.linspace(-1.6, 1.6, N), np.zeros(N)
    c = Compiled(tmp_path, {"external_with_effects": 3}, ())
    point: dict[str, Any] = {f.name: zero for f in fields(Point)} | {"position": theta}
    exact = effects[0].external_effort(zero + 0.1, Point(**point))
    got = c("external_with_effects", 0.1, theta, zero)[0]
    np.testing.assert_allclose(got, exact, rtol=0, atol=1e-15)
