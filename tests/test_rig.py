"""Rig files: whole, plausible, and the template that `sysid init` writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.rig import find_rig_file, read_rig, rig_from_content


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
