"""The laws of effects in the C header against the ports of the effects themselves."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_bundles import RISING, as_bundle, whole_bundle
from export_compiler import Compiled, compile_c, header, macros

from sysid.errors import InputError
from sysid.io.rig import rig_from_content
from sysid.parameters import Bundle, EffectEntry
from sysid.parameters.assembled_model import parameters_from_bundle
from sysid.parameters.effects import entry_of
from sysid.plant.effects.chamber import AtmosphereLeakage, PistonLeakage, TubeLag
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.friction import (
    AsymmetricCoulombFriction,
    PositionDependentFriction,
    QuadraticDrag,
    SealFriction,
    StribeckFriction,
)
from sysid.plant.effects.linkage import CableSpring, GearMeshRipple, MountingTilt
from sysid.plant.effects.motor import TorqueConstantError, TorqueOffset
from sysid.plant.effects.sensor import PressureGain, PressureOffset
from sysid.plant.effects.stroke import EndCushion
from sysid.plant.effects.valve import ValveDelay
from sysid.plant.ports import Model, Point
from sysid.plant.sensors import through_sensors

N = 500
# In an order that counts: a gain between two offsets.
HELD: tuple[CatalogueEffect, ...] = (
    PistonLeakage(5e-15),
    PressureOffset(2e3, "a"),
    AtmosphereLeakage(4e-15, "b"),
    PressureGain(0.03, "both", 2e4),
    AtmosphereLeakage(3e-15, "both"),
    PressureOffset(-3e3, "both"),
    ValveDelay(5e-4, -2e-4, "both"),
    ValveDelay(1e-4, 3e-4, "b"),
)
MECHANICS: tuple[CatalogueEffect, ...] = (
    StribeckFriction(0.1, 0.08, 1.7),
    AsymmetricCoulombFriction(0.03),
    PositionDependentFriction(0.2, -0.3, 3.1),
    SealFriction(3e-7),
    QuadraticDrag(0.01),
    QuadraticDrag(0.02, 1.5),
    StribeckFriction(0.05, 0.3, 2.0),
    GearMeshRipple(0.02, -0.03, 17.0),
    GearMeshRipple(0.02, 0.01, 23.0, 0.4, -0.2),
    CableSpring(0.2, -0.3),
    EndCushion(0.5, 0.3, 1.5, "b", 0.4),
    MountingTilt(0.03, -0.02),
    TorqueOffset(0.04),
    TorqueConstantError(-0.1),
    TorqueConstantError(0.05),
)
FUNCTIONS = {
    **{f"chamber_flow_{s}_with_effects": 3 for s in "ab"},
    **{f"true_pressure_{s}_with_effects": 1 for s in "ab"},
    **{f"valve_{s}_{edge}_delay_with_effects": 1 for s in "ab" for edge in ("on", "off")},
}


def with_effects(rig_text: str, effects: tuple[CatalogueEffect, ...]) -> Bundle:
    return whole_bundle(rig_text, [RISING] * 4).with_effects(entry_of(e) for e in effects)


def test_the_laws_agree_with_the_ports(rig_text: str, tmp_path: Path) -> None:
    bundle = with_effects(rig_text, HELD)
    path, notices = header(bundle, tmp_path)
    assert notices == []
    found = macros(path)
    assert found["SYSID_EFFECTS_CONTAINED"] == len(HELD)
    assert found["SYSID_EFFECTS_NOT_CONTAINED"] == 0
    assert found["SYSID_EFFECTS_ACT_ON_CHAMBER_FLOW_A"] == 1
    c = Compiled(tmp_path, FUNCTIONS, ())
    rig = rig_from_content(tomllib.loads(rig_text), "rig")
    model = Model(parameters_from_bundle(bundle, rig), HELD)
    rng = np.random.default_rng(1)
    pa, pb = rng.uniform(8e4, 3.3e5, (2, N))
    flow, delay = rng.normal(0.0, 5e-4, N), rng.uniform(1e-3, 3e-3, N)
    zero = np.zeros(N)
    point = Point(zero, zero, zero, pa, pb, zero, zero, zero, zero, model.parameters)
    measured = through_sensors({"pressure_a_pa": pa, "pressure_b_pa": pb}, zero, model)
    for side, true in (("a", pa), ("b", pb)):
        whole = model.through("chamber_flow", flow, side, point)
        assert np.abs(whole - flow).max() > 1e-4
        got = c(f"chamber_flow_{side}_with_effects", flow, pa, pb)[0]
        np.testing.assert_allclose(got, whole, rtol=0, atol=1e-15)
        shown = measured[f"pressure_{side}_pa"]
        assert np.abs(shown - true).min() > 10.0
        got = c(f"true_pressure_{side}_with_effects", shown)[0]
        np.testing.assert_allclose(got, true, rtol=1e-14)
        for edge in ("on", "off"):
            later = model.through("delays", delay, zero, edge == "on", side)
            got = c(f"valve_{side}_{edge}_delay_with_effects", delay)[0]
            np.testing.assert_allclose(got, later, rtol=1e-14)


@pytest.mark.parametrize("effects", [MECHANICS, *[(e,) for e in MECHANICS]])
def test_the_laws_of_mechanics_agree_with_the_ports(
    rig_text: str, effects: tuple[CatalogueEffect, ...], tmp_path: Path
) -> None:
    bundle = with_effects(rig_text, effects)
    path, notices = header(bundle, tmp_path)
    assert notices == []
    counts = {"sliding_friction": 5, "external": 3, "motor": 1}
    functions = {f"{name}_with_effects": count for name, count in counts.items()}
    acting = {name: count for name, count in functions.items() if f"{name}(" in path.read_text()}
    c = Compiled(tmp_path, acting, ())
    rig = rig_from_content(tomllib.loads(rig_text), "rig")
    model = Model(parameters_from_bundle(bundle, rig), effects)
    rng = np.random.default_rng(2)
    value, theta, w = rng.normal(0.0, (0.3, 1.0, 0.5), (N, 3)).T
    w[::7] = 0.0
    pa, pb = rng.uniform(8e4, 3.3e5, (2, N))
    zero = np.zeros(N)
    point = Point(zero, theta, w, pa, pb, zero, zero, zero, np.sign(w), model.parameters)
    for name, port, inputs in (
        ("sliding_friction", "friction_effort", (theta, w, pa, pb)),
        ("external", "external_effort", (theta, w)),
        ("motor", "motor_effort", ()),
    ):
        wanted = model.through(port, value, point)
        assert (f"{name}_with_effects" in acting) == bool((wanted != value).any())
        assert macros(path)[f"SYSID_EFFECTS_ACT_ON_{name.upper()}"] == (wanted != value).any()
        if f"{name}_with_effects" in acting:
            got = c(f"{name}_with_effects", value, *inputs)[0]
            np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-11)


def test_what_has_no_law_in_c_is_said(rig_text: str, tmp_path: Path) -> None:
    bundle = with_effects(rig_text, (PressureOffset(2e3, "a"), TubeLag(1e-3)))
    gain = EffectEntry(id="pressure-gain", parameters={"side": "both"})
    path, notices = header(bundle.with_effects([gain]), tmp_path)
    assert [line for line in notices if "tube-lag, pressure-gain;" in line] == notices
    text, found = path.read_text(), macros(path)
    assert "NOT CONTAINED: the laws of these effects of the bundle: tube-lag, pressure-gain" in text
    assert found["SYSID_EFFECTS_CONTAINED"] == 1
    assert found["SYSID_EFFECTS_NOT_CONTAINED"] == 2
    assert found["SYSID_EFFECTS_ACT_ON_TRUE_PRESSURE_A"] == 1
    assert found["SYSID_EFFECTS_ACT_ON_TRUE_PRESSURE_B"] == 0
    assert "true_pressure_b_with_effects" not in text
    c = Compiled(tmp_path, {"true_pressure_a_with_effects": 1}, ())
    assert c("true_pressure_a_with_effects", 1.5e5)[0] == 1.48e5


@pytest.mark.parametrize("side", ["c", 1.0, "*/ int broken; /*"])
def test_a_side_that_is_none_is_refused_and_not_contained(
    rig_text: str, side: Any, tmp_path: Path
) -> None:
    """No file gets past the reading; an entry that was made unchecked adds no law."""
    bundle = with_effects(rig_text, (PressureOffset(2e3, "a"),))
    content = bundle.to_json()
    content["effects"][0]["parameters"]["side"] = side
    with pytest.raises(InputError, match="side"):
        as_bundle(content)
    (entry,) = bundle.effects
    unchecked = entry.replaced(parameters={**entry.parameters, "side": side})
    path, _ = header(bundle.replaced(effects=[unchecked]), tmp_path, sha256="00" * 32)
    assert macros(path)["SYSID_EFFECTS_NOT_CONTAINED"] == 1
    compile_c(tmp_path, '#include "controller.h"\nint main(void) { return 0; }\n')


def test_a_bundle_without_effects_gets_no_function(rig_text: str, tmp_path: Path) -> None:
    path, notices = header(with_effects(rig_text, ()), tmp_path)
    assert notices == [] and "_with_effects(" not in path.read_text()
    assert macros(path)["SYSID_EFFECTS_CONTAINED"] == 0
