"""The plant as an FMU: its C against the simulator, the standard's rules, and what it refuses."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import RIG_TEXT
from export_bundles import LINEAR_RIG, as_bundle, estimate, iso_law, upright, whole_content
from export_compiler import compiler
from fmu_loop import STEP, Unit, loop
from strict_c import strictly

from benchmarks.plant_library import PlantLibrary, unpacked
from benchmarks.rigs import pwm_run
from sysid.commands.app import main
from sysid.controllers.design_model import design_from_bundle
from sysid.controllers.interface import Reference
from sysid.controllers.sensing import Readings, filter_coefficients, sense, start_sensing
from sysid.controllers.trajectories import Cycloidal
from sysid.errors import InputError
from sysid.exporters import controllers_file, export_bundle
from sysid.exporters.c_control import gains
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.plant.ports import Model
from sysid.plant.sensors import measured_channels, true_start
from sysid.plant.simulator import Inputs, ValveCommand, simulate
from sysid.types import FloatArray

POSITION, PRESSURE = 1e-6, 1.0  # rad or m, Pa: what the simulator and the C may differ by
# States, pulses and delays, parameters that drift, sensors that remember or do not.
EFFECTS = {
    "stribeck-friction": {
        "stribeck_torque_nm": (0.1, "Nm"),
        "stribeck_velocity_rad_per_s": (0.07, "rad/s"),
        "stribeck_exponent": (2.0, "-"),
    },
    "amplifier-lag": {"amplifier_lag_s": (0.003, "s")},
    "temperature-drift": {"temperature_drift_k": (9.0, "K"), "drift_time_s": (20.0, "s")},
    "coil-heating": {
        "on_delay_drift_s": (6e-4, "s"),
        "off_delay_drift_s": (-4e-4, "s"),
        "heating_time_s": (5.0, "s"),
    },
    "sticking-valve": {"stuck_delay_s": (0.003, "s"), "sticking_time_s": (0.05, "s")},
    "duty-dead-zone": {"dead_time_s": (4e-4, "s"), "whole_ratio": (1.8, "-")},
    "atmosphere-leakage": {},
    "pressure-offset": {"pressure_offset_pa": (700.0, "Pa")},
    "pressure-lag": {"pressure_lag_s": (0.004, "s")},
    "encoder-eccentricity": {
        "encoder_sine_rad": (0.004, "rad"),
        "encoder_cosine_rad": (-0.003, "rad"),
    },
}


def with_effects(content: dict[str, Any]) -> dict[str, Any]:
    from sysid.plant.effects.catalogue import catalogue

    entries = []
    for name, given in EFFECTS.items():
        kind = catalogue()[name]
        numbers = {
            q.label: estimate(*given.get(q.label, (q.typical, q.unit))) for q in kind.quantities
        }
        side = {"side": "both"} if kind.has_side() else {}
        entries.append({"id": name, "parameters": {**numbers, **side}})
    return content | {"effects": entries}


@pytest.fixture
def sources_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """No library is built into an FMU, which takes most of an export's time."""
    monkeypatch.setattr("sysid.exporters.fmu.c_compiler", lambda: None)


@pytest.fixture(scope="module")
def upright_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs of an upright rig with effects, by FMI's version."""
    bundle = as_bundle(with_effects(whole_content(upright(RIG_TEXT))))
    folder = tmp_path_factory.mktemp("fmu")
    return {fmi: exported(bundle, folder / fmi, fmi=fmi) for fmi in ("3", "2")}


def exported(bundle: Bundle, folder: Path, **options: Any) -> Path:
    """The plant's FMU; libraries in it are built without optimization, which takes longest."""
    folder.mkdir(exist_ok=True)
    path = folder / "plant.fmu"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sysid.exporters.fmu.OPTIMIZED", "-O0")
        export_bundle(bundle, path, "fmu", **options)
    return path


def switched_run(rng: np.random.Generator, seconds: float, motor: float) -> Inputs:
    """Both valves on and off at random moments, under a sine of the motor."""
    time = np.arange(round(seconds / 1e-3) + 1) * 1e-3
    levels = rng.uniform(size=(2, len(time) // 90 + 1)) > 0.5
    valves = [ValveCommand(np.repeat(row, 90)[: len(time)].astype(float)) for row in levels]
    return Inputs(time, motor * np.sin(9.0 * time), valves[0], valves[1], position=0.01)


def differences(
    library: PlantLibrary, runs: Sequence[Inputs], model: Model, rig: Rig
) -> tuple[float, float]:
    """Largest differences of what is shown, in position and pressures."""
    position = rig.position_channel
    began = [true_start(one, position, model) for one in runs]
    payload = 0.0 if rig.inertia is None else rig.inertia.payload_mass_kg
    found: list[tuple[float, float]] = []
    for one, run in zip(runs, simulate(began, [model] * len(runs)), strict=True):
        shown = np.array(list(measured_channels(run, position, model).values())).T
        start = one.position, one.velocity, one.pressure_a, one.pressure_b
        reached, rows = library(one, start, payload)
        assert reached == len(one.time)
        assert np.ptp(shown[:, 0]) > 1e-3
        errors = np.abs(rows - shown).max(axis=0)
        found.append((errors[0], errors[2:].max()))
    return max(f[0] for f in found), max(f[1] for f in found)


def one_chamber_rig() -> str:
    """A linear rig with a return spring in place of chamber B."""
    kept = [line for line in LINEAR_RIG.splitlines() if not line.startswith(("area_b", "offset_b"))]
    text = "\n".join(kept).replace("[cylinder]", '[cylinder]\nchambers = ["a"]')
    return text + "\n[spring]\nstiffness_n_per_m = 300.0\npreload_n = 20.0\n"


def delays_of_effect() -> dict[str, Any]:
    numbers = {"on_delay_s": estimate(5e-4, "s"), "off_delay_s": estimate(8e-4, "s")}
    return {**numbers, "side": "both"}


def fill_and_bleed_rig() -> str:
    """The same with two valves, one of which fills the chamber and one empties it."""
    delays = "on_delay_s = 0.0022\noff_delay_s = 0.0035\n"
    return f'{one_chamber_rig()}[valves]\narrangement = "fill-and-bleed"\n{delays}'


@pytest.mark.usefixtures("sources_only")
@pytest.mark.parametrize(
    "kind",
    ["base", "effects", "one chamber", "iso6358", "fill and bleed", "fill and bleed, effects"],
)
def test_the_plant_in_c_moves_as_the_simulator(kind: str, rig_text: str, tmp_path: Path) -> None:
    compiler("gcc")  # skips without one
    two_valves = kind.startswith("fill")
    is_linear = two_valves or kind == "one chamber"
    linear = fill_and_bleed_rig() if two_valves else one_chamber_rig()
    content = whole_content(linear if is_linear else upright(rig_text))
    if is_linear:
        del content["valves"]["b"]
    if kind.endswith(", effects"):
        content["effects"] = [
            {"id": "tube-lag", "parameters": {"tube_lag_s": estimate(0.002, "s"), "side": "a"}},
            {"id": "valve-delay", "parameters": delays_of_effect()},
        ]
    if kind == "iso6358":
        content["valves"]["a"]["discrete"] = iso_law()
    bundle = as_bundle(with_effects(content) if kind == "effects" else content)
    rng = np.random.default_rng(7)
    motor = 15.0 if is_linear else 0.6
    runs = [
        replace(run, pressure_a=130e3, pressure_b=180e3)
        for run in (pwm_run(rng, 1.0, motor=False), switched_run(rng, 1.0, motor))
    ]
    library = PlantLibrary(unpacked(exported(bundle, tmp_path), tmp_path))
    position, pressure = differences(library, runs, bundle.model(), bundle.rig)
    assert position < POSITION
    assert pressure < PRESSURE


@pytest.mark.parametrize(
    ("own", "fmi", "part"), [("gcc", "3", "plant"), ("clang", "2", "controllers")]
)
def test_sessions_are_clean(
    own: str, fmi: str, part: str, upright_fmus: dict[str, Path], tmp_path: Path
) -> None:
    """No warning, nothing undefined, NaN refused, and a kept state goes on to the same bits."""
    path = upright_fmus[fmi]
    sources = unpacked(path if part == "plant" else controllers_file(path), tmp_path)
    other = "clang" if own == "gcc" else "gcc"
    strictly(sources, f"fmi{fmi}.c", other)
    shutil.copy(Path(__file__).parent / "fmi_session.c", sources)
    sanitizers = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
    program = strictly(
        sources, "fmi_session.c", own, *sanitizers, f"-DFMI_VERSION={fmi}", output="session"
    )
    run = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (run.stdout, run.returncode) == ("ok\n", 0), run.stderr[:3000]


@pytest.mark.parametrize("fmi", ["3", "2"])
def test_fmpy_accepts_and_simulates(
    fmi: str, upright_fmus: dict[str, Path], tmp_path: Path
) -> None:
    fmpy = pytest.importorskip("fmpy", reason="no FMPy: the FMU is not validated")
    from fmpy.validation import validate_fmu

    path = upright_fmus[fmi]
    assert validate_fmu(str(path)) == validate_fmu(str(controllers_file(path))) == []
    described = fmpy.read_model_description(path)
    numbers = {v.name: v for v in described.modelVariables}
    tuned = numbers["effects.stribeck_friction.stribeck_torque_nm"]
    assert (tuned.causality, tuned.variability, float(tuned.start)) == ("parameter", "tunable", 0.1)
    headers = Path(fmpy.__file__).parent / "c-code"
    checked = tmp_path / "sources" / "checked.c"
    unpacked(path, tmp_path)
    checked.write_text(f'#include "fmi{fmi}Functions.h"\n#include "fmi{fmi}.c"\n')
    flags = ("-fsyntax-only", "-Wall", "-Wextra", "-Werror", f"-I{headers}", "-std=c99")
    subprocess.run([compiler("gcc"), *flags, checked.name], cwd=checked.parent, check=True)
    falls = fmpy.simulate_fmu(
        str(path),
        stop_time=0.2,
        step_size=1e-3,
        output_interval=1e-3,
        start_values={"start.theta_rad": 1.0},
        output=["theta_rad", "gravity_torque_nm"],
    )
    rig = as_bundle(whole_content(upright(RIG_TEXT))).rig
    gravity = rig.gravity_moment() * np.sin(falls["theta_rad"])
    assert falls["theta_rad"][-1] < 0.99
    assert falls["gravity_torque_nm"] == pytest.approx(gravity, rel=0.02)  # an eccentric encoder


@pytest.mark.usefixtures("sources_only")
def test_bounds_are_the_intervals(rig_text: str, tmp_path: Path) -> None:
    pytest.importorskip("fmpy", reason="no FMPy: the FMU is not read")
    from fmpy import read_model_description

    content = whole_content(rig_text)
    content["friction"]["coulomb_nm"] |= {"interval": [0.2, 0.22]}
    described = read_model_description(exported(as_bundle(content), tmp_path))
    found = {v.name: v for v in described.modelVariables}["friction.coulomb_nm"]
    assert (float(found.min), float(found.start), float(found.max)) == (0.2, 0.208, 0.22)


@pytest.mark.usefixtures("sources_only")
def test_the_same_bundle_gives_the_same_file(rig_text: str, tmp_path: Path) -> None:
    bundle = as_bundle(whole_content(rig_text))
    one, two = (exported(bundle, tmp_path / name).read_bytes() for name in "ab")
    assert one == two


@pytest.mark.usefixtures("sources_only")
def test_two_valves_of_one_chamber_have_their_names_and_delays(tmp_path: Path) -> None:
    """Also where no test shows when they close: every model then has the rig file's delay."""
    content = whole_content(fill_and_bleed_rig())
    del content["valves"]["b"]
    lacking = {"value": None, "identified": False, "reason": "no flow shows", "unit": "s"}
    content["valves"]["a"]["discrete"]["off_delay_s"] = lacking
    bundle = as_bundle(content)
    described = unpacked(exported(bundle, tmp_path), tmp_path).parent / "modelDescription.xml"
    names = set(re.findall(r' name="([^"]+)"', described.read_text("utf-8")))
    assert names >= {
        f"{stem}_a_{v}" for stem in ("valve", "duty", "pwm") for v in ("fill", "bleed")
    }
    assert names >= {
        f"rig.valve_a_{v}_{e}_delay_s" for v in ("fill", "bleed") for e in ("on", "off")
    }
    assert not any(name.endswith("_b") or "_b_" in name for name in names)
    header = tmp_path / "model.h"
    said = export_bundle(bundle, header, "c")
    text = header.read_text("utf-8")
    assert "#define SYSID_HAS_VALVE_A_DELAYS 1" in text
    assert "sysid_valve_a_off_delay_s = (sysid_real)0.0035;" in text
    assert any("off_delay_s is the rig file's 0.0035" in line for line in said)
    assert "with the fill valve on" in text and "with the bleed valve on" in text
    assert "with the valve off" not in text


@pytest.mark.usefixtures("sources_only")
def test_what_cannot_be_held_is_refused(
    rig_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = whole_content(rig_text)
    content["effects"] = [
        {"id": "time-skew", "parameters": {"time_skew_s": estimate(2e-3, "s"), "side": "a"}}
    ]
    with pytest.raises(InputError, match="effect time-skew: cannot be part of a plant in C"):
        exported(as_bundle(content), tmp_path)
    content = whole_content(rig_text)
    content["rig"] |= {"assumed": ["cylinder.area_a_m2"]}
    path = tmp_path / "bundle.json"
    path.write_text(json.dumps(content))
    out = tmp_path / "out.fmu"
    asked = ["export", str(path), "--format", "fmu", "-o", str(out)]
    assert main([*asked]) == 2
    assert "cylinder.area_a_m2" in capsys.readouterr().err and not out.exists()
    assert main([*asked, "--accept-assumed", "--fmi", "2"]) == 0
    assert out.exists()
    content = whole_content(rig_text)
    del content["valves"]["a"]["discrete"]
    path.write_text(json.dumps(content))
    assert main([*asked, "--accept-assumed"]) == 3


@pytest.fixture(scope="module")
def level_fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plant's FMU of a level rig without effects; the controllers' next to it."""
    return exported(as_bundle(whole_content(RIG_TEXT)), tmp_path_factory.mktemp("level"))


@pytest.mark.parametrize("name", ["pva", "backstepping", "dvmpc"])
def test_controllers_command_what_pythons_do(name: str, level_fmus: Path) -> None:
    """In a loop of two FMUs, with the reference given ahead of its time."""
    pytest.importorskip("fmpy", reason="no FMPy: the FMU of controllers is not run")
    bundle = as_bundle(whole_content(RIG_TEXT))
    design = design_from_bundle(bundle)
    controller = gains(design)[name]
    number = ["pva", "backstepping", "dvmpc"].index(name) + 1
    ticks, lead = 250, 0.05
    path = Cycloidal(travel=0.4, lasts=0.3, starts=(0.05, 9.0), origin=-0.2)
    uses_motor = number > 1
    plant = Unit(level_fmus, {"start.theta_rad": -0.2, "pwm_a": number < 3, "pwm_b": number < 3})
    own = {"controller": number, "uses_motor": uses_motor, "reference.lead_s": lead}
    controllers = Unit(controllers_file(level_fmus), own | {"theta_rad": -0.2})
    ahead = path.sample(np.arange(ticks) * STEP + lead)
    found = loop(plant, controllers, ahead, uses_duty=number < 3)
    assert controllers["is_good"] and controllers["rejected"] == 0
    for unit in (plant, controllers):
        unit.close()
    wanted = _python_commands(controller, found, path)
    wanted[:, 0] *= uses_motor
    assert np.ptp(found[:, 0]) > 0.1 and np.any(wanted[:, 1:] > 0.0)
    assert found[:, 3:] == pytest.approx(wanted, abs=1e-9)


def _python_commands(controller: Any, found: FloatArray, path: Cycloidal) -> FloatArray:
    """Motor and valves that Python's controller commands on the same readings, by tick."""
    filters = filter_coefficients(STEP)[:, :, None]
    rows = [np.atleast_1d(value) for value in found[0, :3]]
    sensing, memory = start_sensing(Readings(*rows)), controller.start(1)
    commands = []
    for tick, row in enumerate(found[:, :3]):
        readings = Readings(*(np.atleast_1d(value) for value in row))
        sensing, estimate = sense(sensing, readings, tick, STEP, filters)
        times = (tick + np.arange(controller.preview + 1)) * STEP
        now, *later = path.sample(times)[:, :, None]
        ahead = Reference(*np.array(later).transpose(1, 0, 2)) if len(later) else None
        memory, given = controller.commands(memory, estimate, Reference(*now, ahead))
        commands.append([float(np.squeeze(c)) for c in given[:3]])
    return np.array(commands)
