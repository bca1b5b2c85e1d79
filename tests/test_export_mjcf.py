"""The joint for MuJoCo: its numbers, its motion against the simulator, and what it leaves out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_bundles import LINEAR_RIG, as_bundle, estimate, upright, whole_content

from sysid.commands.app import main
from sysid.exporters import export_bundle
from sysid.exporters.mjcf import joint_of, mjcf_text
from sysid.parameters import Bundle
from sysid.plant import base
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.ports import Model
from sysid.plant.simulator import Inputs, Trajectory, simulate
from sysid.types import FloatArray

STEP = 1e-3
POSITION_RAD = 2e-3  # a soft constraint stands for dry friction


def loaded(text: str) -> tuple[Any, Any, Any]:
    """MuJoCo, and a model and its data."""
    mujoco = pytest.importorskip("mujoco", reason="no MuJoCo: the joint is not run")
    model = mujoco.MjModel.from_xml_string(text)
    return mujoco, model, mujoco.MjData(model)


def text_of(bundle: Bundle, *effects: Any, **changes: float) -> str:
    model = Model(bundle.model().parameters.replace(**changes), effects)
    return mjcf_text(bundle, joint_of(bundle.rig, model, effects))


def test_inertia_and_gravity_are_the_plants(rig_text: str) -> None:
    bundle = as_bundle(whole_content(upright(rig_text)))
    p = bundle.model().parameters
    mujoco, model, data = loaded(text_of(bundle))
    data.qpos[0] = 0.7
    mujoco.mj_forward(model, data)
    assert model.dof_M0[0] == pytest.approx(p.inertia)
    assert data.qfrc_bias[0] == pytest.approx(p.gravity_moment * np.sin(0.7))
    slide = as_bundle(whole_content(LINEAR_RIG))
    p = slide.model().parameters.replace(inertia=2.5)  # a fitted mass, and the rig's own weight
    mujoco, model, data = loaded(text_of(slide, inertia=2.5))
    mujoco.mj_forward(model, data)
    assert data.qfrc_bias[0] - data.qfrc_gravcomp[0] == pytest.approx(p.weight)


def test_motor_tests_move_as_in_the_simulator(rig_text: str) -> None:
    """Where it breaks away at Coulomb friction, and takes the chambers' effort from the plant."""
    bundle = as_bundle(whole_content(upright(rig_text)))
    p = bundle.model().parameters
    p = p.replace(static_effort=p.coulomb_effort)
    time = np.arange(1501) * STEP
    motor = 0.7 * np.sin(8.0 * time) + 0.2
    run = simulate([Inputs(time, motor, position=0.2)], [Model(p)])[0]
    assert np.ptp(run.position) > 0.3
    found = in_mujoco(text_of(bundle, static_effort=p.static_effort), motor, run, p)
    assert np.abs(found - run.position).max() < POSITION_RAD


def in_mujoco(text: str, motor: FloatArray, run: Trajectory, p: base.Parameters) -> FloatArray:
    mujoco, model, data = loaded(text)
    cylinder = base.cylinder_effort(
        *(run.pressure_a, run.pressure_b, p.area_a, p.area_b, p.atmosphere, p.pitch_radius)
    )
    data.qpos[0] = run.position[0]
    found = [run.position[0]]
    for k in range(len(motor) - 1):
        data.ctrl[:] = motor[k], 0.5 * (cylinder[k] + cylinder[k + 1])
        mujoco.mj_step(model, data)
        found.append(data.qpos[0])
    return np.array(found)


def test_effects_of_a_joints_form_are_in_it(rig_text: str) -> None:
    bundle = as_bundle(whole_content(rig_text))
    kinds = catalogue()
    p = bundle.model().parameters
    effects = (
        kinds["torque-offset"](offset_nm=0.03),
        kinds["cable-spring"].typical(),
        kinds["torque-constant-error"](torque_gain_error=0.1),
        kinds["inertia-mismatch"].typical(),
        kinds["stribeck-friction"].typical(),
        kinds["pressure-lag"].typical(),
        kinds["amplifier-lag"].typical(),
    )
    model = Model(p, effects)
    joint = joint_of(bundle.rig, model, effects)
    at = [model.effects[1].external_effort(0.0, _place(q, p)) for q in (0.0, 1.0)]
    assert joint.constant == pytest.approx(0.03 + at[0])
    assert joint.stiffness == pytest.approx(at[0] - at[1])
    assert joint.gear == pytest.approx(1.1)
    assert joint.inertia == pytest.approx(effects[3].parameters(p, 0.0).inertia)
    said = "\n".join(joint.not_held)
    for left in ("stribeck-friction changes what", "pressure-lag acts on", "amplifier-lag has"):
        assert left in said
    assert "cable-spring" not in said


def _place(position: float, p: base.Parameters) -> Any:
    from sysid.plant.ports import Point

    return Point(0.0, position, 0.0, 1e5, 1e5, 0.0, 0.0, 0.0, 0.0, p)


def test_what_is_left_out_is_said(
    rig_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = whole_content(rig_text)
    lag = {"amplifier_lag_s": estimate(0.003, "s")}
    content["effects"] = [{"id": "amplifier-lag", "parameters": lag}]
    path, out = tmp_path / "bundle.json", tmp_path / "arm.xml"
    path.write_text(json.dumps(content))
    assert main(["export", str(path), "--format", "mjcf", "-o", str(out), "--json"]) == 0
    notices = json.loads(capsys.readouterr().out)["notices"]
    for left in ("static friction, 0.333 Nm", "chambers and valves", "amplifier-lag has states"):
        assert any(left in line for line in notices) and left in out.read_text()
    bundle = as_bundle(content | {"rig": content["rig"] | {"name": "an --> arm & <b>"}})
    export_bundle(bundle, out, "mjcf")
    loaded(out.read_text())
    del content["friction"]
    path.write_text(json.dumps(content))
    assert main(["export", str(path), "--format", "mjcf", "-o", str(out)]) == 3
