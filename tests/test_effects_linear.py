"""The catalogue on a linear rig: names, units and sizes in N, m and kg."""

from __future__ import annotations

import math
import pickle
import re
from types import SimpleNamespace

import pytest

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.estimation.linear import Estimate
from sysid.parameters.effects import effect_from_entry, entry_of
from sysid.plant.effects import friction, linkage
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.linear import (
    REFERENCE_RADIUS_M,
    for_rig,
    linear_form,
    linear_name,
)

EFFECTS = list(catalogue().values())


@pytest.mark.parametrize("effect", EFFECTS, ids=list(catalogue()))
def test_no_rotary_unit_is_left(effect: type[friction.StribeckFriction]) -> None:
    form = linear_form(effect)
    assert issubclass(form, effect) and form.id == effect.id
    for quantity in form.quantities:
        words = quantity.label.split("_")
        assert not {"nm", "rad", "torque"} & set(words) and "kg_m2" not in quantity.label
        assert not {"Nm", "rad", "kg m2"} & set(quantity.unit.replace("/", " ").split())
        assert not re.search(r"\b(Nm|rad|torque)\b", quantity.meaning)
        assert quantity.lower <= quantity.typical <= quantity.upper
    assert linear_form(effect) is form and pickle.loads(pickle.dumps(form)) is form


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("stribeck_torque_nm", "stribeck_force_n"),
        ("stribeck_velocity_rad_per_s", "stribeck_velocity_m_per_s"),
        ("drag_nm_s2_per_rad2", "drag_n_s2_per_m2"),
        ("inertia_change_kg_m2", "inertia_change_kg"),
        ("piston_leakage_kg_per_s_pa2", "piston_leakage_kg_per_s_pa2"),
    ],
)
def test_names(name: str, expected: str) -> None:
    assert linear_name(name) == expected


def test_no_text_speaks_of_torques_or_angles() -> None:
    for effect in for_rig(catalogue(), True).values():
        texts = (effect.title, effect.tie_breaker, effect.signature)
        assert not re.search(r"\b[Tt]orques?\b|\bangles?\b|\barms?\b", " ".join(texts)), effect.id


def test_sizes_come_over_at_the_reference_radius() -> None:
    """F = T / r and v = r w: a drag per squared speed is 1/r^3 as large."""
    drag = linear_form(friction.QuadraticDrag).quantities[0]
    assert drag.typical == pytest.approx(0.005 / REFERENCE_RADIUS_M**3, rel=1e-3)
    force, speed, exponent = linear_form(friction.StribeckFriction).quantities
    assert force.typical == pytest.approx(0.12 / REFERENCE_RADIUS_M, rel=1e-3)
    assert speed.grid[0] == pytest.approx(0.02 * REFERENCE_RADIUS_M, rel=1e-3)
    assert exponent == friction.StribeckFriction.quantities[2]


def test_sizes_whose_unit_does_not_say_their_radius() -> None:
    """A speed per torque is r^2 as large; a torque over w^n is 1/r^(1 + n), and acts the same."""
    r = REFERENCE_RADIUS_M
    speed = linear_form(linkage.Backlash).quantities[1]
    assert speed.typical == pytest.approx(2.0 * r**2, rel=1e-3)
    assert speed.grid == pytest.approx([0.5 * r**2, 2.0 * r**2, 8.0 * r**2], rel=1e-3)
    assert "under 1 N of motor force" in speed.meaning
    linear = linear_form(friction.PowerLawFriction).typical()
    rotary = friction.PowerLawFriction.typical()
    efforts = [
        effect.friction_effort(0.0, SimpleNamespace(velocity=v, direction=1.0))
        for effect, v in ((linear, 0.1), (rotary, 0.1 / r))
    ]
    assert efforts[0] == pytest.approx(efforts[1] / r, rel=1e-3)


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_the_command_gives_the_names_of_files(
    more: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["effects", "--linear", *more]) == 0
    printed = capsys.readouterr().out
    assert "stribeck_force_n" in printed and "stribeck_torque_nm" not in printed


def test_a_bundle_holds_linear_names() -> None:
    linear = for_rig(catalogue(), is_linear=True)
    effect = linear["stribeck-friction"](5.0, 0.003, 1.0)
    fitted = Estimate(5.0, 0.1, "N", (math.nan, math.nan))
    entry = entry_of(effect, {"stribeck_torque_nm": fitted})
    parameters = entry.to_json()["parameters"]
    assert parameters["stribeck_force_n"] == {"value": 5.0, "std": 0.1, "unit": "N"}
    assert effect_from_entry(entry, "bundle", linear) == effect
    with pytest.raises(InputError, match="is missing; its parameters are"):
        effect_from_entry(entry, "bundle", catalogue())
    assert for_rig(catalogue(), is_linear=False) == catalogue()
