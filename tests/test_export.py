"""Exports: MAT and JSON hold the model's numbers, what is absent is said, nothing by halves."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_bundles import (
    RISING,
    as_bundle,
    estimate,
    unidentified,
    upright,
    whole_bundle,
    whole_content,
)
from export_compiler import compile_c, header, macros
from scipy.io import loadmat

from sysid.errors import InputError
from sysid.exporters import export_bundle
from sysid.parameters import Bundle, write_bundle
from sysid.parameters.assembled_model import parameters_from_bundle
from sysid.pipeline.export import export_file


@pytest.fixture
def bundle(rig_text: str) -> Bundle:
    return whole_bundle(rig_text)


@pytest.fixture
def content(rig_text: str) -> dict[str, Any]:
    return whole_content(rig_text)


# --- JSON and MAT ------------------------------------------------------------------------


def as_json(bundle: Bundle, folder: Path) -> tuple[dict[str, Any], list[str]]:
    notices = export_bundle(bundle, folder / "controller.json", "json")
    return json.loads((folder / "controller.json").read_text("utf-8")), notices


def as_mat(bundle: Bundle, folder: Path) -> tuple[Any, list[str]]:
    notices = export_bundle(bundle, folder / "controller.mat", "mat")
    loaded = loadmat(io.BytesIO((folder / "controller.mat").read_bytes()), simplify_cells=True)
    return loaded["sysid"], notices


def test_json_holds_the_models_parameters(rig_text: str, tmp_path: Path) -> None:
    bundle = whole_bundle(upright(rig_text))
    found, notices = as_json(bundle, tmp_path)
    p = parameters_from_bundle(bundle, bundle.rig)
    constants = found["constants"]
    assert constants["inertia_kg_m2"] == p.inertia == pytest.approx(0.02368 + 0.5 * 0.37**2)
    assert constants["gravity_moment_nm"] == p.gravity_moment
    assert constants["gravity_moment_nm"] == pytest.approx((0.3 * 0.23 + 0.5 * 0.37) * 9.81)
    assert constants["k_r_t_j_per_kg"] == pytest.approx(1.4 * 287.0 * 293.15)
    assert found["friction"]["static_nm"] == p.static_effort
    by_position = found["friction"]["static_by_position"]
    assert by_position["static_nm"] == [0.368, None, 0.278]
    for side in "ab":
        law = found["valves"][side]["discrete"]
        assert law["choked_flow_fill_kg_s"] == p.valve(side).choked_fill
        assert law["c_dis"] == p.valve(side).c_dis
    assert notices == [] and found["not_identified"] == {} and found["effects"] == []


def test_json_surfaces_are_those_of_the_bundle(content: dict[str, Any], tmp_path: Path) -> None:
    found, _ = as_json(as_bundle(content), tmp_path)
    part = content["valves"]["a"]["pwm"]["fill"]
    surface = found["valves"]["a"]["pwm"]["fill"]["bipolynomial"]
    assert surface["coefficients"] == [t["value"] for t in part["bipolynomial"]["coefficients"]]
    assert surface["exponents"][5] == [1, 2]
    assert surface["domain"]["nodes"]["duty_high"] == part["ann"]["domain"]["nodes"]["duty_high"]
    net = found["valves"]["a"]["pwm"]["fill"]["ann"]
    assert net["hidden_weights"] == part["ann"]["hidden_weights"]["value"]
    assert net["scaling"]["flow_kg_s"] == {"centre": 1.0e-4, "half_range": 5.0e-4}


def test_every_number_has_a_unit(content: dict[str, Any], tmp_path: Path) -> None:
    content["effects"] = EFFECTS
    found, _ = as_json(as_bundle(content), tmp_path)

    def check(numbers: Any, units: Any, place: str) -> None:
        if isinstance(numbers, dict):
            assert isinstance(units, dict) and set(units) == set(numbers), place
            for key, item in numbers.items():
                check(item, units[key], f"{place}.{key}")
        elif isinstance(units, list):
            assert len(units) == len(numbers), place
        else:
            assert isinstance(units, str), place

    for key in ("constants", "friction", "valves"):
        check(found[key], found["units"][key], key)


def test_mat_has_natural_shapes(bundle: Bundle, tmp_path: Path) -> None:
    found, notices = as_mat(bundle, tmp_path)
    held = bundle.valve("b").surfaces("fill")
    assert held is not None and held.surfaces().keys() == {"bipolynomial", "ann"}
    surface, net = (part.model() for part in held.surfaces().values())
    part = found["valves"]["b"]["pwm"]["fill"]
    u, p = 0.6, 2.2e5
    flow = np.array([1.0, u, u * u]) @ part["bipolynomial"]["C"] @ np.array([1.0, p, p * p])
    assert flow == pytest.approx(float(surface.flow(u, p)[0]), rel=1e-9)
    raw = loadmat(tmp_path / "controller.mat")["sysid"][0, 0]
    ann = raw["valves"][0, 0]["b"][0, 0]["pwm"][0, 0]["fill"][0, 0]["ann"][0, 0]
    shapes = {key: ann[key].shape for key in ("W1", "b1", "W2", "b2")}
    assert shapes == {"W1": (10, 2), "b1": (10, 1), "W2": (1, 10), "b2": (1, 1)}
    scaled = []
    for key, value in (("flow_kg_s", 1e-4), ("pressure_pa", p)):
        row = part["ann"]["scaling"][key]
        scaled.append([(value - row["centre"]) / row["half_range"]])
    out = ann["W2"] @ np.tanh(ann["W1"] @ np.array(scaled) + ann["b1"]) + ann["b2"]
    duty = part["ann"]["scaling"]["duty"]
    wanted = float(net.network(np.array([1e-4]), np.array([p]))[0])
    assert duty["centre"] + duty["half_range"] * out.item() == pytest.approx(wanted, rel=1e-12)
    assert found["units"]["valves"]["b"]["pwm"]["fill"]["bipolynomial"]["C"][1, 2] == "kg/(s Pa^2)"
    assert notices == []


def test_mat_says_the_same_as_json(content: dict[str, Any], tmp_path: Path) -> None:
    content["valves"]["a"]["discrete"]["c_dis"] = unidentified()
    del content["valves"]["b"]
    bundle = as_bundle(content)
    numbers, _ = as_json(bundle, tmp_path)
    struct, _ = as_mat(bundle, tmp_path)
    for part in ("constants", "friction"):
        for key, value in numbers[part].items():
            if isinstance(value, float):
                assert struct[part][key] == value, key
    assert np.isnan(struct["valves"]["a"]["discrete"]["c_dis"])
    assert numbers["valves"]["a"]["discrete"]["c_dis"] is None
    assert np.isnan(struct["valves"]["b"]["discrete"]["c_fill"])
    assert np.size(struct["valves"]["b"]["pwm"]["fill"]["ann"]) == 0
    assert numbers["valves"]["b"]["pwm"]["fill"]["ann"] is None
    assert struct["provenance"] == numbers["provenance"]
    assert np.isnan(struct["friction"]["static_by_position"]["static_nm"][1])


def test_the_mat_file_is_version_5_and_reproducible(bundle: Bundle, tmp_path: Path) -> None:
    export_bundle(bundle, tmp_path / "one.mat", "mat")
    export_bundle(bundle, tmp_path / "two.mat", "mat")
    data = (tmp_path / "one.mat").read_bytes()
    assert data == (tmp_path / "two.mat").read_bytes()
    assert data.startswith(b"MATLAB 5.0 MAT-file")
    assert data[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


@pytest.mark.parametrize(("fmt", "word"), [("json", "null"), ("mat", "NaN"), ("c", "omitted")])
def test_what_is_not_identified_is_said(
    content: dict[str, Any], tmp_path: Path, fmt: str, word: str
) -> None:
    content["friction"]["static_nm"] = unidentified("no ramp moves")
    del content["rig"]["motor"]
    notices = export_bundle(as_bundle(content), tmp_path / "out", fmt)
    assert f"friction.static_nm: {word}, not identified (no ramp moves)" in notices
    assert any("max_torque_nm" in line and "no [motor]" in line for line in notices)


def test_gravity_without_masses_is_not_zero(rig_text: str, tmp_path: Path) -> None:
    bundle = whole_bundle(rig_text.replace("horizontal", "vertical"))
    found, notices = as_json(bundle, tmp_path)
    assert found["constants"]["gravity_moment_nm"] is None
    assert any("gravity_moment_nm" in line and "arm_mass_kg" in line for line in notices)
    assert macros(header(bundle, tmp_path)[0])["SYSID_HAS_GRAVITY"] == 0


def test_an_identified_inertia_replaces_the_declared(
    content: dict[str, Any], tmp_path: Path
) -> None:
    content["friction"]["inertia_kg_m2"] = estimate(0.031, "kg m2")
    found, notices = as_json(as_bundle(content), tmp_path)
    assert found["constants"]["inertia_kg_m2"] == 0.031
    assert any("0.031" in line and "0.02368" in line for line in notices)


# --- effects, provenance, errors -----------------------------------------------------------

EFFECTS: list[dict[str, Any]] = [
    {
        "id": "stribeck-friction",
        "parameters": {"stribeck_torque_nm": {"value": 0.11, "std": 0.004, "unit": "Nm"}},
    },
    {
        "id": "pressure-lag",
        "parameters": {
            "side": "a",
            "lag_s": {"value": 0.002, "unit": "s"},
            "shape": {"value": None, "identified": False, "reason": "no step"},
        },
    },
]


def test_effects_are_data_and_the_header_does_not_pretend(
    content: dict[str, Any], tmp_path: Path
) -> None:
    content["effects"] = EFFECTS
    bundle = as_bundle(content)
    found, notices = as_json(bundle, tmp_path)
    assert notices == []
    assert found["effects"][0]["parameters"] == {"stribeck_torque_nm": 0.11}
    assert found["effects"][1]["parameters"] == {"side": "a", "lag_s": 0.002, "shape": None}
    assert found["units"]["effects"][0]["parameters"] == {"stribeck_torque_nm": "Nm"}
    struct, _ = as_mat(bundle, tmp_path)
    assert struct["effects"][0]["parameters"]["stribeck_torque_nm"] == 0.11
    assert struct["effects"][1]["parameters"]["side"] == "a"
    path, notices = header(bundle, tmp_path)
    assert any("stribeck-friction" in line and "pressure-lag" in line for line in notices)
    assert "NOT CONTAINED" in path.read_text() and "stribeck-friction" in path.read_text()
    assert macros(path)["SYSID_EFFECTS_NOT_CONTAINED"] == 2


def test_provenance_names_the_bundle_file(bundle: Bundle, tmp_path: Path) -> None:
    source = tmp_path / "bundle.json"
    write_bundle(bundle, source)
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    found, _ = as_json(bundle, tmp_path)
    assert found["provenance"]["bundle_sha256"] == digest
    assert found["provenance"]["bundle_created"] == "2026-01-02T03:04:05+00:00"
    # A file that was laid out anew has a hash of its own.
    source.write_text(json.dumps(bundle.to_json()))
    export_file(source, tmp_path / "out.h", format="c")
    text = (tmp_path / "out.h").read_text()
    assert hashlib.sha256(source.read_bytes()).hexdigest() in text and digest not in text
    assert "2026-01-02T03:04:05+00:00" in text


def spoil_unit(b: dict[str, Any]) -> None:
    b["friction"]["coulomb_nm"]["unit"] = "mNm"


def spoil_period(b: dict[str, Any]) -> None:
    b["valves"]["a"]["pwm"]["fill"]["pwm_period_s"] = 0.004


def spoil_order(b: dict[str, Any]) -> None:
    b["valves"]["a"]["pwm"]["fill"]["bipolynomial"]["coefficients"].reverse()


def spoil_nodes(b: dict[str, Any]) -> None:
    b["valves"]["b"]["pwm"]["discharge"]["ann"]["domain"]["nodes"]["pressure_pa"].reverse()


def spoil_weight(b: dict[str, Any]) -> None:
    b["valves"]["b"]["pwm"]["discharge"]["ann"]["hidden_bias"]["value"][0] = float("inf")


def spoil_activation(b: dict[str, Any]) -> None:
    b["valves"]["b"]["pwm"]["discharge"]["ann"]["activation"] = "relu"


def spoil_value(b: dict[str, Any]) -> None:
    b["valves"]["a"]["discrete"]["c_dis"]["value"] = float("inf")


def spoil_effect(b: dict[str, Any]) -> None:
    b["effects"] = [{"id": "x", "parameters": {"no name": 1.0}}]


def spoil_effect_value(b: dict[str, Any]) -> None:
    b["effects"] = [{"id": "x", "parameters": {"gain": {"value": float("nan"), "unit": "1"}}}]


def spoil_row(b: dict[str, Any]) -> None:
    b["friction"]["static_by_position"][0] = {"position": 1.0}


@pytest.mark.parametrize("fmt", ["c", "mat", "json"])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_unit, "coulomb_nm: is in 'mNm', not 'Nm'"),
        (spoil_period, "PWM period of 0.004 s"),
        (spoil_order, "thesis' order"),
        (spoil_nodes, "do not rise"),
        (spoil_weight, "not finite"),
        (spoil_activation, "relu"),
        (spoil_value, "c_dis"),
        (spoil_effect, "no name"),
        (spoil_effect_value, "effect x, gain: 'nan' is not a finite number"),
        (spoil_row, "static_by_position"),
    ],
)
def test_content_that_is_wrong_writes_nothing(
    content: dict[str, Any],
    spoil: Callable[[dict[str, Any]], None],
    message: str,
    fmt: str,
    tmp_path: Path,
) -> None:
    path = tmp_path / "out"
    path.write_text("before")
    spoil(content)
    with pytest.raises(InputError, match=message):
        export_bundle(as_bundle(content), path, fmt, sha256="00" * 32)
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_unknown_format_and_a_missing_folder(
    bundle: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sysid.exporters.flatten", None)  # said before any work
    with pytest.raises(InputError, match="--format"):
        export_bundle(bundle, tmp_path / "out", "xml")
    with pytest.raises(InputError, match="does not exist"):
        export_bundle(bundle, tmp_path / "nowhere" / "out.mat", "mat")
    assert list(tmp_path.iterdir()) == []


def test_a_bundle_of_one_part_is_exported(rig_text: str, tmp_path: Path) -> None:
    content = whole_content(rig_text, [RISING] * 4)
    del content["friction"]
    del content["rig"]["cylinder"], content["rig"]["inertia"]
    bundle = as_bundle(content)
    found, notices = as_json(bundle, tmp_path)
    assert found["friction"]["coulomb_nm"] is None and found["constants"]["area_a_m2"] is None
    assert any(line.startswith("friction: null") for line in notices)
    path, _ = header(bundle, tmp_path)
    assert macros(path)["SYSID_HAS_CYLINDER"] == macros(path)["SYSID_HAS_INERTIA"] == 0
    compile_c(tmp_path, '#include "controller.h"\nint main(void) { return 0; }\n')
