"""The catalogue on a linear rig: names, units and sizes in N, m and kg."""

from __future__ import annotations

import math
import pickle

import pytest

from sysid.bundle.effects import effect_from_entry, entry_of
from sysid.errors import InputError
from sysid.estimation.linear import Estimate
from sysid.model.effects import friction
from sysid.model.effects.catalogue import catalogue
from sysid.model.effects.linear import (
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


def test_sizes_come_over_at_the_reference_radius() -> None:
    """F = T / r and v = r w: a drag per squared speed is 1/r^3 as large."""
    drag = linear_form(friction.QuadraticDrag).quantities[0]
    assert drag.typical == pytest.approx(0.005 / REFERENCE_RADIUS_M**3, rel=1e-3)
    force, speed, exponent = linear_form(friction.StribeckFriction).quantities
    assert force.typical == pytest.approx(0.12 / REFERENCE_RADIUS_M, rel=1e-3)
    assert speed.grid[0] == pytest.approx(0.02 * REFERENCE_RADIUS_M, rel=1e-3)
    assert exponent == friction.StribeckFriction.quantities[2]


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
