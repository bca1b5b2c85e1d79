"""The C header: it compiles everywhere, and computes what Python computes."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_bundles import (
    FLAT,
    LINEAR_RIG,
    as_bundle,
    unidentified,
    upright,
    whole_bundle,
    whole_content,
)
from export_compiler import Compiled, compile_c, compiler, header, macros

from sysid.errors import InputError
from sysid.exporters import export_bundle
from sysid.parameters import Bundle, PwmSurfaces
from sysid.parameters.assembled_model import parameters_from_bundle
from sysid.plant import base
from sysid.surfaces import Saturation

N = 4000
SLOTS = [(side, direction) for side in "ab" for direction in ("fill", "discharge")]


@pytest.fixture
def bundle(rig_text: str) -> Bundle:
    return whole_bundle(rig_text)


@pytest.fixture
def content(rig_text: str) -> dict[str, Any]:
    return whole_content(rig_text)


def pwm(bundle: Bundle, side: str, direction: str) -> PwmSurfaces:
    held = bundle.valve(side).surfaces(direction)
    assert held is not None
    return held


def model(bundle: Bundle, side: str, direction: str, kind: str) -> Any:
    """The surface that the bundle holds, evaluated in Python."""
    surface = pwm(bundle, side, direction).surface(kind)
    assert surface is not None
    return surface.model()


def assert_same(found: Any, wanted: Any, scale: Any = 0.0) -> None:
    """Equal to 1e-12 of the value, or of the largest term that cancels in it (`scale`)."""
    found, wanted = np.asarray(found), np.asarray(wanted)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
    bound = 1e-12 * np.maximum(np.abs(wanted), scale)
    bad = np.abs(found - wanted) > bound
    assert not bad.any(), (found[bad][:3], wanted[bad][:3])


# --- C: laws ---------------------------------------------------------------------------

LAWS = {
    "cylinder_torque": 2,
    "gravity_torque": 1,
    "sliding_friction_torque": 1,
    "friction_torque": 2,
    "motor_torque": 1,
    "pressure_rate_a": 4,
    "pressure_rate_b": 4,
    "flow_for_pressure_rate_a": 4,
    "flow_for_pressure_rate_b": 4,
    **{f"valve_{s}_{w}_flow": 2 for s in "ab" for w in ("filling", "exhaust")},
}


def test_laws_agree_with_python(rig_text: str, tmp_path: Path) -> None:
    bundle = whole_bundle(upright(rig_text))
    _, notices = header(bundle, tmp_path)
    assert notices == []
    c = Compiled(tmp_path, LAWS, ())
    p = parameters_from_bundle(bundle, bundle.rig)
    rng = np.random.default_rng(1)
    pa, pb = rng.uniform(8e4, 3.3e5, (2, N))
    theta, w = rng.uniform(-1.6, 1.6, N), rng.normal(0.0, 2.0, N)
    w[::5] = 0.0
    applied, volts = rng.normal(0.0, 0.4, N), rng.normal(0.0, 8.0, N)
    cylinder = base.cylinder_effort(pa, pb, p.area_a, p.area_b, p.atmosphere, p.pitch_radius)
    assert_same(c("cylinder_torque", pa, pb)[0], cylinder, scale=2e5 * p.area_a * p.pitch_radius)
    assert p.gravity_moment > 1.0
    assert_same(c("gravity_torque", theta)[0], base.gravity_effort(theta, p.gravity_moment))
    sliding = base.sliding_friction(w, np.sign(w), p.coulomb_effort, p.viscous)
    assert_same(c("sliding_friction_torque", w)[0], sliding)
    friction = base.friction_effort(w, applied, p.static_effort, p.coulomb_effort, p.viscous)
    assert_same(c("friction_torque", w, applied)[0], friction)
    assert_same(c("motor_torque", volts)[0], base.motor_effort(volts, 0.0795, p.max_effort))


def test_valve_laws_agree_with_python(bundle: Bundle, tmp_path: Path) -> None:
    header(bundle, tmp_path)
    c = Compiled(tmp_path, LAWS, ())
    p = parameters_from_bundle(bundle, bundle.rig)
    rng = np.random.default_rng(2)
    pressure, supply = rng.uniform(7e4, 3.5e5, N), rng.uniform(2e5, 3.2e5, N)
    atmosphere = rng.uniform(9.5e4, 1.05e5, N)
    # On the boundaries themselves, and to the last bit beside them.
    pressure[:3] = base.filling_boundary(3e5) * np.array([1.0, 1.0 + 2e-16, 1.0 - 2e-16])
    supply[:3] = 3e5
    pressure[3:6] = base.exhaust_boundary(1e5) * np.array([1.0, 1.0 + 2e-16, 1.0 - 2e-16])
    atmosphere[3:6] = 1e5
    pressure[6], pressure[7] = supply[6], atmosphere[7]
    for side in "ab":
        v = p.valve(side)
        filling = base.filling_flow(pressure, supply, v.choked_fill, v.c_fill, p.supply_reference)
        assert_same(c(f"valve_{side}_filling_flow", pressure, supply)[0], filling)
        exhaust = base.exhaust_flow(pressure, atmosphere, v.choked_dis, v.c_dis)
        assert_same(c(f"valve_{side}_exhaust_flow", pressure, atmosphere)[0], exhaust)
        choked = base.is_filling_choked(pressure, supply)
        assert choked.any() and not choked.all()


def test_chamber_equations_agree_with_python(bundle: Bundle, tmp_path: Path) -> None:
    header(bundle, tmp_path)
    c = Compiled(tmp_path, LAWS, ())
    p = parameters_from_bundle(bundle, bundle.rig)
    rng = np.random.default_rng(3)
    pressure, theta = rng.uniform(8e4, 3.3e5, N), rng.uniform(-1.6, 1.6, N)
    w, flow, rate = rng.normal(0, 2, N), rng.normal(0, 5e-4, N), rng.normal(0, 1e6, N)
    air = (p.heat_capacity_ratio, p.gas_constant, p.temperature)
    for side, volumes, sign in (
        ("a", base.chamber_volume_a, 1.0),
        ("b", base.chamber_volume_b, -1.0),
    ):
        area, offset = getattr(p, f"area_{side}"), getattr(p, f"offset_{side}")
        volume = volumes(theta, area, offset, p.pitch_radius)
        swept = sign * p.pitch_radius * w * area
        wanted = base.pressure_rate(pressure, flow, volume, swept, *air)
        scale = p.heat_capacity_ratio * np.abs(pressure * swept) / volume
        found = c(f"pressure_rate_{side}", pressure, theta, w, flow)[0]
        assert_same(found, wanted, scale)
        wanted = base.flow_from_pressure_rate(rate, pressure, volume, swept, *air)
        found = c(f"flow_for_pressure_rate_{side}", rate, pressure, theta, w)[0]
        assert_same(found, wanted, np.abs(pressure * swept) / (air[1] * air[2]))
        beyond = 3.0 if side == "b" else -3.0
        assert np.isnan(c(f"pressure_rate_{side}", 1e5, beyond, 0.0, 0.0)[0])


def test_an_input_that_is_not_a_number_gives_none(bundle: Bundle, tmp_path: Path) -> None:
    header(bundle, tmp_path)
    c = Compiled(tmp_path, LAWS, ())
    for name, count in LAWS.items():
        other = 0.5 if "rate" in name else 0.0 if "friction" in name else 1e5
        for k in range(count):
            inputs = [np.nan if j == k else other for j in range(count)]
            assert np.isnan(c(name, *inputs)[0]), (name, k)


# --- C: surfaces -----------------------------------------------------------------------

FLAGGED = tuple(
    f"pwm_{s}_{d}_{what}" for s, d in SLOTS for what in ("flow", "duty", "network_duty")
)


def compare_surfaces(bundle: Bundle, folder: Path, seed: int) -> set[int]:
    """Every surface against Python on random points in and out of its domain; flags seen."""
    header(bundle, folder)
    c = Compiled(folder, dict.fromkeys(FLAGGED, 2), FLAGGED)
    rng = np.random.default_rng(seed)
    seen: set[int] = set()
    for side, direction in SLOTS:
        surface = model(bundle, side, direction, "bipolynomial")
        name = f"pwm_{side}_{direction}"
        duty, pressure = rng.uniform(-0.1, 1.1, N), rng.uniform(0.8e5, 3.3e5, N)
        flow = rng.uniform(-9e-4, 1.2e-3, N)
        duty[:3], flow[:3] = (np.nan, np.inf, -np.inf), (np.nan, np.inf, -np.inf)
        pressure[3] = np.nan
        wanted, flags = surface.flow(duty, pressure)
        found = c(f"{name}_flow", duty, pressure)
        assert_same(found[0], wanted, scale=float(np.abs(surface.scaled_coefficients_).max()))
        np.testing.assert_array_equal(found[1], flags)
        wanted, flags = surface.duty(flow, pressure)
        found = c(f"{name}_duty", flow, pressure)
        np.testing.assert_allclose(found[0], np.nan_to_num(wanted), rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(found[1], flags)
        seen |= set(flags.tolist())
        net = model(bundle, side, direction, "ann")
        wanted, flags = net.duty(flow, pressure)
        found = c(f"{name}_network_duty", flow, pressure)
        assert_same(found[0], np.nan_to_num(wanted), scale=float(np.abs(net.output_weights_).sum()))
        np.testing.assert_array_equal(found[1], flags)
    return seen


def test_surfaces_agree_with_python_on_every_branch(bundle: Bundle, tmp_path: Path) -> None:
    seen = compare_surfaces(bundle, tmp_path, seed=4)
    for flag in Saturation:
        assert any(value & flag for value in seen), flag
    assert 0 in seen


@pytest.mark.parametrize("seed", [11, 12])
def test_random_surfaces_agree_with_python(rig_text: str, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = [3e-4 * rng.normal(size=(3, 3)) for _ in range(3)] + [FLAT]
    compare_surfaces(whole_bundle(rig_text, shapes, seed), tmp_path, seed)


def test_a_flow_that_every_duty_gives_has_the_lowest(rig_text: str, tmp_path: Path) -> None:
    bundle = whole_bundle(rig_text, [np.zeros((3, 3))] * 4)
    header(bundle, tmp_path)
    c = Compiled(tmp_path, {"pwm_a_fill_duty": 2}, FLAGGED)
    pressure = np.linspace(1.1e5, 3.0e5, 20)
    surface = model(bundle, "a", "fill", "bipolynomial")
    wanted, flags = surface.duty(0.0, pressure)
    found = c("pwm_a_fill_duty", 0.0, pressure)
    assert_same(found[0], wanted)
    np.testing.assert_array_equal(found[1], flags)
    assert (flags == Saturation.DECREASING).all()


def test_the_inverse_inverts_the_flow(bundle: Bundle, tmp_path: Path) -> None:
    header(bundle, tmp_path)
    c = Compiled(tmp_path, {"pwm_a_fill_flow": 2, "pwm_a_fill_duty": 2}, FLAGGED)
    rng = np.random.default_rng(5)
    duty, pressure = rng.uniform(0.4, 0.7, N), rng.uniform(1.1e5, 2.9e5, N)
    back = c("pwm_a_fill_duty", c("pwm_a_fill_flow", duty, pressure)[0], pressure)
    np.testing.assert_array_equal(back[1], 0)
    np.testing.assert_allclose(back[0], duty, rtol=1e-9)


# --- C: what is absent, names, units of translation --------------------------------------


def test_what_is_not_identified_is_absent(content: dict[str, Any], tmp_path: Path) -> None:
    content["friction"]["static_nm"] = unidentified("no ramp moves")
    content["valves"]["a"]["discrete"]["c_dis"] = unidentified("always choked")
    del content["valves"]["b"]["discrete"]
    del content["valves"]["b"]["pwm"]["fill"]["ann"]
    del content["valves"]["a"]["pwm"]["discharge"]
    path, notices = header(as_bundle(content), tmp_path)
    found = macros(path)
    absent = {
        "SYSID_HAS_FRICTION",
        "SYSID_HAS_VALVE_A_EXHAUST",
        "SYSID_HAS_VALVE_A_DISCRETE",
        "SYSID_HAS_VALVE_B_FILLING",
        "SYSID_HAS_VALVE_B_EXHAUST",
        "SYSID_HAS_VALVE_B_DISCRETE",
        "SYSID_HAS_VALVE_B_DELAYS",
        "SYSID_HAS_PWM_B_FILL_NETWORK",
        "SYSID_HAS_PWM_A_DISCHARGE_BIPOLYNOMIAL",
        "SYSID_HAS_PWM_A_DISCHARGE_NETWORK",
        "SYSID_HAS_CONTROLLERS",
    }
    assert {name for name, value in found.items() if value == 0 and "HAS" in name} == absent
    assert found["SYSID_HAS_VALVE_A_FILLING"] == found["SYSID_HAS_SLIDING_FRICTION"] == 1
    assert all(any(name in line for line in notices) for name in absent)
    assert any("no ramp moves" in line for line in notices)
    text = path.read_text()
    for gone in ("friction_static_nm", "valve_a_exhaust_flow", "pwm_b_fill_network_duty"):
        assert gone not in text.replace("sliding_friction", "")
    compile_c(
        tmp_path,
        '#include "controller.h"\n#if SYSID_HAS_FRICTION || !SYSID_HAS_SLIDING_FRICTION\n'
        "#error wrong\n#endif\nint main(void) { return 0; }\n",
    )


def test_a_bundle_of_friction_alone_compiles(bundle: Bundle, tmp_path: Path) -> None:
    path, _ = header(bundle.without("valves"), tmp_path)
    assert "network" not in path.read_text().replace("NETWORK", "")
    source = (
        '#include "controller.h"\nint main(void) { return sysid_cylinder_torque(1e5, 1e5) > 0; }'
    )
    subprocess.run([compile_c(tmp_path, source + "\n")], check=True)


def test_two_translation_units_and_two_rigs(bundle: Bundle, tmp_path: Path) -> None:
    header(bundle, tmp_path)
    export_bundle(bundle, tmp_path / "leg.h", "c", prefix="leg_")
    (tmp_path / "other.c").write_text(
        '#include "leg.h"\n#include "controller.h"\n#include "leg.h"\ndouble other(void);\n'
        "double other(void) { unsigned f; return leg_pwm_a_fill_duty(1e-4, 2e5, &f); }\n"
    )
    program = compile_c(
        tmp_path,
        '#include <stdio.h>\n#include "controller.h"\ndouble other(void);\n'
        'int main(void) { printf("%.17g %.17g", sysid_pwm_a_fill_duty(1e-4, 2e5, 0), other());\n'
        "return 0; }\n",
        "other.c",
    )
    run = subprocess.run([program], capture_output=True, text=True, check=True)
    surface = model(bundle, "a", "fill", "bipolynomial")
    wanted = float(surface.duty(1e-4, 2e5)[0])
    np.testing.assert_allclose([float(x) for x in run.stdout.split()], wanted, rtol=1e-12)


def test_it_is_cplusplus_too(bundle: Bundle, tmp_path: Path) -> None:
    header(bundle, tmp_path)
    (tmp_path / "main.cpp").write_text('#include "controller.h"\nint main() { return 0; }\n')
    command = [compiler("g++"), "-std=c++11", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    run = subprocess.run(
        [*command, "main.cpp"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[:2000]


@pytest.mark.parametrize(
    "name",
    [
        "x */ int broken; /*",
        "a\n#error broken\n",
        "ends with \\",
        "??/\n",
        "Müller \u202e\u2066",
        "",
    ],
)
def test_a_name_cannot_break_the_comment(
    content: dict[str, Any], name: str, tmp_path: Path
) -> None:
    # Reading refuses a rig's name with control characters; nothing else of a bundle is text alone.
    content["rig"]["rig"]["name"] = name if name.isprintable() else "rig"
    content["created"] = name
    content["effects"] = [{"id": name, "parameters": {}}]
    path, _ = header(as_bundle(content), tmp_path)
    text = path.read_text("ascii")
    assert "#error" not in [line.strip()[:6] for line in text.splitlines()]
    compile_c(tmp_path, '#include "controller.h"\nint main(void) { return 0; }\n')


@pytest.mark.parametrize("prefix", ["", "1a", "a-b", "_x", "a b", "é", "x" * 40, "a;\n"])
def test_a_prefix_that_is_no_name_is_refused(bundle: Bundle, prefix: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--prefix"):
        header(bundle, tmp_path, prefix=prefix)
    assert list(tmp_path.iterdir()) == []


def test_a_linear_rig_has_forces(tmp_path: Path) -> None:
    bundle = whole_bundle(LINEAR_RIG)
    path, notices = header(bundle, tmp_path)
    assert any("max_force_n" in line for line in notices)
    functions = {"cylinder_force": 2, "gravity_force": 1, "friction_force": 2, "motor_force": 1}
    c = Compiled(tmp_path, {**functions, "pressure_rate_b": 4}, ())
    p = parameters_from_bundle(bundle, bundle.rig)
    rng = np.random.default_rng(6)
    pa, pb = rng.uniform(1e5, 6e5, (2, N))
    wanted = base.cylinder_effort(pa, pb, p.area_a, p.area_b, p.atmosphere)
    assert_same(c("cylinder_force", pa, pb)[0], wanted, scale=5e5 * p.area_a)
    assert_same(c("gravity_force", pa)[0], np.full(N, 2.0 * 9.81))
    assert_same(c("motor_force", 1000.0)[0], 4000.0)
    wanted = base.friction_effort(pa - pa, pb - 3e5, p.static_effort, 5.5, 34.0)
    assert_same(c("friction_force", 0.0 * pa, pb - 3e5)[0], wanted)
    assert "_nm" not in path.read_text()


@pytest.mark.parametrize(
    ("section", "said", "controllers"),
    [("pwm", "no controllers in the C header", "0"), ("valves", "valves without delays", "1")],
)
def test_a_rig_without_times_of_its_valves(
    content: dict[str, Any], section: str, said: str, controllers: str, tmp_path: Path
) -> None:
    """A period of 1 s that nobody declared was in the averaged law of the header."""
    del content["rig"][section]
    path, notices = header(as_bundle(content), tmp_path)
    assert any(f"has no [{section}]" in line and said in line for line in notices)
    assert f"define SYSID_HAS_CONTROLLERS {controllers}" in path.read_text()


def test_gains_of_an_arm_are_said_on_a_linear_rig(bundle: Bundle, tmp_path: Path) -> None:
    (tmp_path / "linear").mkdir()
    _, notices = header(whole_bundle(LINEAR_RIG), tmp_path / "linear")
    assert any("default gains" in line for line in notices)
    assert not any("default gains" in line for line in header(bundle, tmp_path)[1])


def test_the_motor_has_a_share_where_there_is_one(content: dict[str, Any], tmp_path: Path) -> None:
    """A motor without a declared limit is one."""
    shares = []
    for n, keys in enumerate((("max_torque_nm",), ("torque_per_volt_nm",))):
        rig = {**content["rig"], "motor": {"torque_per_volt_nm": 0.08}}
        if "torque_per_volt_nm" in keys:
            del rig["motor"]
        folder = tmp_path / str(n)
        folder.mkdir()
        path, _ = header(as_bundle({**content, "rig": rig}), folder)
        defaults = path.read_text().split("sysid_backstepping_defaults = {")[1].split("}")[0]
        shares.append("0.1" in defaults)
    assert shares == [True, False]


def test_negative_friction_is_said(content: dict[str, Any], tmp_path: Path) -> None:
    content["friction"]["viscous_nm_s_per_rad"]["value"] = -0.03
    _, notices = header(as_bundle(content), tmp_path)
    assert any("viscous_nm_s_per_rad is -0.03" in line for line in notices)


def test_laws_in_single_precision(rig_text: str, tmp_path: Path) -> None:
    bundle = whole_bundle(upright(rig_text))
    header(bundle, tmp_path)
    calls = {
        "cylinder_torque": (2.1e5, 1.4e5),
        "gravity_torque": (0.7,),
        "friction_torque": (-1.3, 0.2),
        "motor_torque": (3.0,),
        "pressure_rate_a": (2e5, 0.3, 1.1, 3e-4),
        "flow_for_pressure_rate_b": (5e5, 2e5, 0.3, 1.1),
        "valve_a_filling_flow": (2.4e5, 3e5),
        "valve_b_exhaust_flow": (1.5e5, 1e5),
        "pwm_a_fill_flow": (0.5, 2e5),
        "pwm_b_discharge_duty": (-1e-4, 2e5),
        "pwm_a_fill_network_duty": (2e-4, 2e5),
    }
    text = {
        name: ", ".join(f"(SYSID_REAL){x!r}" for x in values) + (", 0" if "pwm" in name else "")
        for name, values in calls.items()
    }
    shown = "".join(f'printf("%.9g ", (double)sysid_{n}({x}));\n' for n, x in text.items())
    source = (
        f'#include <stdio.h>\n#include "controller.h"\nint main(void) {{ {shown} return 0; }}\n'
    )
    found = []
    for real in ("double", "float"):
        program = compile_c(tmp_path, source, f"-DSYSID_REAL={real}", output=real)
        run = subprocess.run([program], capture_output=True, text=True, check=True)
        found.append([float(x) for x in run.stdout.split()])
    assert len(found[0]) == len(calls) and found[0] != found[1]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-4)
