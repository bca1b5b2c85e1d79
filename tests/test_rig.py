"""Rig files: whole, plausible, and the template that `sysid init` writes."""

from __future__ import annotations

import copy
import pickle
import re
import tomllib
from pathlib import Path
from typing import get_args

import jsonschema
import pytest
from pydantic import ValidationError

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.declaration import (
    ChoiceKey,
    ListKey,
    Motion,
    NumberKey,
    TextKey,
    WaysKey,
    declared_keys,
)
from sysid.io.rig import Air, Inertia, RigFile, find_rig_file, read_rig, rig_from_content
from sysid.io.rig_file import RIG_TABLES
from sysid.io.rig_sections import ValveASheet
from sysid.io.rig_template import rig_template

KEYS = [
    (table, name, key) for table, m in RIG_TABLES.items() for name, key in declared_keys(m).items()
]
NUMBERS = [(table, name, key) for table, name, key in KEYS if isinstance(key, NumberKey)]
# The end of a key's name, by its unit; a ratio has none.
ENDINGS = {
    "J/(kg K)": "_j_per_kg_k",
    "kg/(s Pa^0.5)": "_c_fill",
    "kg/(s Pa)": "_c_dis",
    "K": "_k",
    "Pa": "_pa",
    "m": "_m",
    "m2": "_m2",
    "m3": "_m3",
    "kg": "_kg",
    "kg m2": "_kg_m2",
    "Nm": "_nm",
    "N": "_n",
    "s": "_s",
    "Nm/V": "_per_volt_nm",
    "N/V": "_per_volt_n",
    "Nm/rad": "_nm_per_rad",
    "N/m": "_n_per_m",
    "count/rev": "_counts_per_rev",
    "count/m": "_counts_per_m",
    "count": "_counts",
    "1": "",
}
# Keys of benches that are no actuator, and of rigs with one chamber or a spring: the template of
# the usual actuator does without them.
NOT_IN_TEMPLATE = {
    ("tank", "volume_m3"),
    ("cylinder", "chambers"),
    ("valves", "arrangement"),
    ("spring", "stiffness_nm_per_rad"),
    ("spring", "preload_nm"),
    ("spring", "stiffness_n_per_m"),
    ("spring", "preload_n"),
    *((f"valve_{side}", name) for side in "ab" for name in declared_keys(ValveASheet)),
}


def content(**sections: dict[str, float]) -> dict[str, dict[str, object]]:
    return {"rig": {"name": "x", "orientation": "vertical"}, **sections}  # type: ignore[dict-item]


@pytest.mark.parametrize("linear", [False, True])
def test_the_template_is_a_sound_rig_file(
    linear: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rig.toml"
    assert main(["init", str(path), *(["--linear"] if linear else [])]) == 0
    rig = read_rig(path)
    assert rig.is_linear is linear
    assert rig.total_inertia() is not None
    assert main(["init", str(path)]) == 2
    assert "--force" in capsys.readouterr().err


def test_inertia_from_masses_and_lengths() -> None:
    rig = rig_from_content(
        content(
            inertia={
                "arm_mass_kg": 0.3,
                "arm_length_m": 0.46,
                "block_mass_kg": 0.5,
                "payload_mass_kg": 0.2,
                "payload_length_m": 0.37,
            },
            cylinder={
                "area_a_m2": 4.5e-4,
                "area_b_m2": 4.2e-4,
                "offset_a_m": 0.075,
                "offset_b_m": 0.075,
                "stroke_m": 0.127,
                "pitch_radius_m": 0.0375,
            },
        ),
        "rig.toml",
    )
    expected = 0.3 * 0.46**2 / 3 + 0.2 * 0.37**2 + 0.5 * 0.0375**2
    assert rig.total_inertia() == pytest.approx(expected)
    assert rig.gravity_moment() == pytest.approx((0.3 * 0.46 / 2 + 0.2 * 0.37) * 9.81)


def test_the_equivalent_inertia_is_without_payload_and_gravity_uses_the_masses() -> None:
    rig = rig_from_content(
        content(
            inertia={
                "equivalent_kg_m2": 0.02,
                "arm_mass_kg": 0.3,
                "arm_length_m": 0.46,
                "payload_mass_kg": 0.5,
                "payload_length_m": 0.37,
            }
        ),
        "rig.toml",
    )
    assert rig.total_inertia() == pytest.approx(0.02 + 0.5 * 0.37**2)
    assert rig.gravity_moment() == pytest.approx((0.3 * 0.46 / 2 + 0.5 * 0.37) * 9.81)


def test_the_nearest_rig_file_is_found(tmp_path: Path, rig_text: str) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    (tmp_path / "rig.toml").write_text(rig_text)
    assert find_rig_file(inner / "run.csv") == tmp_path / "rig.toml"
    (inner.parent / "rig.toml").write_text(rig_text)
    assert find_rig_file(inner / "run.csv") == inner.parent / "rig.toml"


def test_an_unknown_key_is_said_and_a_near_miss_refused() -> None:
    rig = rig_from_content(content(inertia={"mass_kg": 1.0, "colour": 3.0}), "rig.toml")
    assert any("colour" in n for n in rig.notices)
    with pytest.raises(InputError, match="did you mean"):
        rig_from_content(content(inertia={"mas_kg": 1.0}), "rig.toml")


def test_gravity_without_masses_is_refused_not_taken_as_zero() -> None:
    rig = rig_from_content(content(inertia={"equivalent_kg_m2": 0.02}), "rig.toml")
    with pytest.raises(InputError, match="arm_mass_kg"):
        rig.gravity_moment()


def filled_in(text: str) -> str:
    """A template whose optional lines are no comments any more."""
    return re.sub(r"^# (\w+ = )", r"\1", text, flags=re.MULTILINE)


def test_every_key_of_every_section_is_declared_once() -> None:
    assert list(RIG_TABLES) == list(RigFile.model_fields)
    for table, model in RIG_TABLES.items():
        assert list(declared_keys(model)) == list(model.model_fields), table
        for name, field in model.model_fields.items():
            assert len(field.metadata) == 1, f"[{table}] {name}"
    assert {type(key) for _, _, key in KEYS} == {
        NumberKey,
        ChoiceKey,
        ListKey,
        TextKey,
        WaysKey,
    }


@pytest.mark.parametrize(("table", "name", "key"), NUMBERS)
def test_a_number_has_a_description_a_range_and_the_unit_of_its_name(
    table: str, name: str, key: NumberKey
) -> None:
    assert key.description.endswith(".") and "\n" not in key.description
    assert key.range.lower < key.range.upper
    assert name.endswith(ENDINGS[key.range.unit])
    default = RIG_TABLES[table].model_fields[name].get_default()
    assert not isinstance(default, float) or key.range.holds(default)
    assert key.example is None or key.range.holds(float(key.example.value))


def test_every_key_stands_in_a_template_or_is_known_not_to() -> None:
    shown = set()
    for motion in get_args(Motion):
        text = filled_in(rig_template(linear=motion == "linear"))
        content = tomllib.loads(text)
        shown |= {(table, name) for table, keys in content.items() for name in keys}
    declared = {(table, name) for table, name, _ in KEYS}
    assert shown == declared - NOT_IN_TEMPLATE


@pytest.mark.parametrize("linear", [False, True])
def test_a_filled_in_template_is_read_and_fits_the_schema(linear: bool) -> None:
    content = tomllib.loads(filled_in(rig_template(linear=linear)))
    rig = rig_from_content(content, "rig.toml")
    assert rig.notices == () and rig.is_linear is linear
    for table in content.keys() - {"rig"}:
        section = getattr(rig, table)
        assert section.model_dump(exclude_unset=True) == content[table]
    jsonschema.validate(content, RigFile.model_json_schema())


@pytest.mark.parametrize(("table", "name", "key"), NUMBERS)
def test_bounds_hold_in_file_model_and_schema(table: str, name: str, key: NumberKey) -> None:
    """One declaration: what it refuses is refused everywhere, with one line."""
    model, low = RIG_TABLES[table], key.range.lower
    others = {n: k.range.lower for n, k in declared_keys(model).items() if isinstance(k, NumberKey)}
    if "law" in model.model_fields:
        others |= {"law": "thesis-series"}
    low_by_a_little = low - max(1e-9, 1e-3 * abs(low))
    line = re.escape(f"[{table}] {name} = {low_by_a_little:g} is not plausible")
    with pytest.raises(InputError, match=line):
        model.from_table(others | {name: low_by_a_little}, "rig.toml")
    with pytest.raises(InputError, match=line):
        model(**others | {name: low_by_a_little})
    schema = model.model_json_schema()
    jsonschema.validate(others, schema)
    with pytest.raises(jsonschema.ValidationError, match="minimum"):
        jsonschema.validate(others | {name: low_by_a_little}, schema)
    shown = schema["properties"][name]
    assert shown["description"] == key.description and shown["unit"] == key.range.unit
    assert shown["maximum"] == key.range.upper and shown["type"] == "number"


def test_a_number_too_large_for_a_float_is_not_plausible() -> None:
    with pytest.raises(InputError, match="mass_kg = inf is not plausible"):
        rig_from_content(content(inertia={"mass_kg": 10**400}), "rig.toml")


def test_choices_are_checked_before_texts() -> None:
    head = {"name": 3, "orientation": "up", "motion": "rotary"}
    with pytest.raises(InputError, match="orientation = 'up' is unknown"):
        rig_from_content({"rig": head}, "rig.toml")
    with pytest.raises(InputError, match="name = 3 is not text"):
        rig_from_content({"rig": head | {"orientation": "vertical"}}, "rig.toml")


def test_sections_are_frozen_hashable_and_can_be_pickled(rig_text: str) -> None:
    rig = rig_from_content(tomllib.loads(rig_text), "rig.toml")
    again = pickle.loads(pickle.dumps(rig))
    assert again == rig and hash(again) == hash(rig) and again.content == rig.content
    assert rig.air is not None and rig.air == Air(**rig.air.model_dump())
    with pytest.raises(ValidationError, match="frozen"):
        rig.air.temperature_k = 300.0
    assert copy.copy(rig.air) == rig.air
    assert rig.air.model_copy(update={"temperature_k": 300.0}) != rig.air


def test_a_section_constructed_by_name_is_checked_as_in_a_file() -> None:
    assert Inertia(mass_kg=2, arm_mass_kg=None) == Inertia(mass_kg=2.0)
    with pytest.raises(InputError, match=r"Air: .air. gas_constant_j_per_kg_k is missing; add"):
        Air(temperature_k=293.15)  # type: ignore[call-arg]
    with pytest.raises(ValidationError, match="mas_kg"):
        Inertia(mas_kg=2.0)  # type: ignore[call-arg]
