"""What numbers are called for readers; commands and files keep the names that they have there."""

from __future__ import annotations

import re

import pytest
from golden_folder import golden_bundle

import sysid as si
from sysid.blocks.figures import Words
from sysid.blocks.html import block_html
from sysid.blocks.numbers import unit as shown
from sysid.blocks.titles import within, words_of
from sysid.diagnosis.tables import parameters_table
from sysid.estimation.linear import Estimate
from sysid.io import own_channels
from sysid.io.own_channels import channel_in, error_unit
from sysid.parameters import Bundle
from sysid.parameters.table import in_words, title_of_field
from sysid.parameters.titles import named, part_title, short_title, title_of
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.linear import linear_form

# A key as files have it: words with underscores between them.
_KEY = re.compile(r"[a-z0-9]+_[a-z0-9_]+")


@pytest.fixture(scope="module")
def bundle() -> Bundle:
    return si.read_bundle(golden_bundle("diagnosed"))


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("friction.coulomb_n", "Coulomb friction"),
        ("friction.offset_nm", "Offset of friction"),
        ("valves.b.c_dis", "Valve B, unchoked exhaust coefficient"),
        ("valves.a.discrete.sonic_conductance.fill", "Valve A, sonic conductance, filling"),
        ("valve discrete.c_fill", "Unchoked filling coefficient"),
        ("rig.dead_length_b", "Length of chamber B in the middle"),
        ("tube-lag-2.tube_lag_s", "Lag of the tube (2): time constant of the chamber's flow"),
        (
            "effect atmosphere-leakage (a).atmosphere_leakage_kg_per_s_pa2",
            "Leakage to the atmosphere (A): flow out per difference of squared pressures",
        ),
        ("component pump.gain", "component pump.gain"),
        ("my-effect.gain", "my-effect.gain"),
    ],
)
def test_a_number_is_called_by_its_meaning(name: str, title: str) -> None:
    assert title_of(name) == title


def test_every_number_of_a_model_has_a_title(bundle: Bundle) -> None:
    for row in bundle.parameters.rows:
        for name in (row.path, row.alias):
            assert not _KEY.search(title_of(name)), name
    for id, effect in catalogue().items():
        assert part_title(f"effect {id}") == effect.title
        for one in (effect, linear_form(effect)):
            assert all(title_of(f"{id}.{q.label}") != f"{id}.{q.label}" for q in one.quantities)


def test_a_sum_of_numbers_is_in_words() -> None:
    reason = "only coulomb_n + 0.01 viscous_n_s_per_m is identified: give motion"
    said = "only Coulomb friction + 0.01 m/s × viscous friction is identified: give motion"
    assert in_words(reason) == said
    assert title_of("coulomb_nm - offset_nm") == "Coulomb friction - offset"
    assert title_of("0.5 viscous_nm_s_per_rad") == "0.5 rad/s × viscous friction"
    assert in_words("the friction of a motor_force_n") == "the friction of a motor_force_n"


def test_the_plants_names_have_titles() -> None:
    named = {"coulomb_effort": "Coulomb friction", "viscous": "Viscous friction"}
    named |= {"choked_fill_a": "Valve A, choked filling flow", "of_no_one": ""}
    assert {name: title_of_field(name) for name in named} == named


def test_a_figure_has_room_for_a_title() -> None:
    long = short_title("seal-friction.difference_share")
    assert long.endswith(" …") and len(long) <= 44
    assert short_title("friction.static_nm") == "Static friction"


def test_a_command_keeps_the_names_of_files() -> None:
    cell = named("valves.a.c_fill")
    assert (cell.plain, cell.small) == ("valves.a.c_fill", "valves.a.c_fill")


def test_a_comparison_shows_titles_on_a_page_and_keys_in_a_terminal(bundle: Bundle) -> None:
    found = si.compare(bundle, bundle)
    parameters = next(iter(found.tables()))
    assert parameters.rows[0][:2] == ("Friction", "Static friction")
    assert "friction" in str(found) and "static_nm" in str(found)
    page = re.sub(r"<small>.*?</small>", "", block_html(parameters))
    assert not _KEY.search(re.sub(r"<[^>]*>", "", page))
    rows = [(m.y, m.text) for m in found.figure().panels[0].marks if isinstance(m, Words)]
    assert rows and not [text for _, text in rows if _KEY.search(text)]
    # The first of the table is the highest.
    assert max(rows)[1] == "Static friction"


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("back_emf_v_s_per_rad", "V*s/rad", "back emf"),
        ("drag_nm_s2_per_rad2", "Nm*s**2/rad**2", "drag"),
        ("conductance_kg_s_pa", "kg/s/Pa", "conductance"),
        ("current_a", "A", "current"),
        # Nothing but the unit, another one, and none.
        ("volts", "V", "volts"),
        ("pressure_a", "Pa", "pressure a"),
        ("command", "1", "command"),
    ],
)
def test_a_name_in_words_is_without_its_unit(name: str, unit: str, words: str) -> None:
    assert words_of(name, unit) == words


def test_units_of_bundles_and_users_are_written_alike() -> None:
    assert shown("Nm s/rad") == shown("N*m*s/rad") == "N·m·s/rad"
    assert shown("kg/s/Pa") == shown("kg/(s Pa)") == "kg/(s·Pa)"
    assert (shown("kg*m**2"), shown("m/s^2"), shown("ohm")) == ("kg·m²", "m/s²", "Ω")


def test_channels_of_a_users_own_are_shown_as_those_of_logs() -> None:
    own = {"angle_rad": "rad", "current_a": "A", "gap_pa": "Pa"}
    angle, gap = channel_in("angle_rad", own), channel_in("gap_pa", own)
    assert (angle.title, angle.unit, angle.residual_unit) == ("Angle", "rad", "mrad")
    assert error_unit(gap, is_alone=True) == ("kPa", 1e-3)  # how large it is, only the user knows
    both = channel_in("current_a and angle_rad", own)
    assert (both.name, both.residual_unit) == ("current and angle", "of the spread")
    assert own_channels.in_words("rate of angle_rad", own) == "rate of angle"
    assert channel_in("angle_rad", {}).title == "angle_rad"


@pytest.mark.parametrize(("side", "said"), [("a", "A"), ("both", "both")])
def test_a_side_has_the_capital_letter_of_its_chamber(side: str, said: str) -> None:
    lag = catalogue()["pressure-lag"]
    content = {
        "effects": [{"id": lag.id, "parameters": {"side": side}}],
        "figures": {"titles": {lag.id: lag.title}, "meanings": {}},
    }
    assert f">{said}<" in block_html(parameters_table(content))


def test_what_a_number_stands_for_is_said_in_words() -> None:
    """Pages name the form that was chosen, and no caption is a key to numbers."""
    for effect in catalogue().values():
        for quantity in (*effect.quantities, *linear_form(effect).quantities):
            assert not re.search(r"\b[01]: ", quantity.title), quantity.name
            if quantity.is_choice and set(quantity.grid) <= {0.0, 1.0}:
                assert all(quantity.form(value) for value in quantity.grid), quantity.name
            assert not quantity.forms or quantity.caption
    seal = catalogue()["seal-friction"]
    estimates = {q.label: Estimate(0.0, 0.1, q.unit, (0.0, 0.2)).to_json() for q in seal.quantities}
    content = {
        "effects": [{"id": seal.id, "parameters": estimates}],
        "figures": {
            "titles": {seal.id: seal.title},
            "meanings": {seal.id: {q.label: q.title for q in seal.quantities}},
            "forms": {seal.id: seal.forms()},
        },
    }
    shown = block_html(parameters_table(content))
    assert "the sum of the gauge pressures alone" in shown and "their difference alone" not in shown
    first, other = (f"{seal.id}/{q.label}" for q in seal.quantities[:2])
    reasons = (
        f"{first} is stuck at its bound, 0",
        f"the data cannot distinguish {other} from {first}",
    )
    for quantity, reason in zip(seal.quantities[:2], reasons, strict=True):
        estimates[quantity.label] = Estimate.unidentified(quantity.unit, reason).to_json()
    shown = block_html(parameters_table(content))
    assert f"{seal.id}/" not in shown and ">stuck at its bound, 0<" in shown
    assert f"from {within(seal.quantities[0].title)}" in shown
