"""What numbers are called for readers; commands and files keep the names that they have there."""

from __future__ import annotations

import re

import pytest
from golden_folder import golden_bundle

import sysid as si
from sysid.blocks.html import block_html
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
    ticks = found.figure().panels[0].y.ticks
    assert ticks and not [text for _, text in ticks if _KEY.search(text)]
    # The first of the table is the highest.
    assert max(ticks)[1] == "Static friction"
