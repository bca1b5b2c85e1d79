"""What numbers are called for readers; commands and files keep the names that they have there."""

from __future__ import annotations

import re

import pytest
from golden_folder import golden_bundle

import sysid as si
from sysid.blocks.html import block_html
from sysid.parameters import Bundle
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
