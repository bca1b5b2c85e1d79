"""Bundles next to each other: what moved, and only that."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from golden_folder import golden_bundle

import sysid as si
from sysid.blocks.figures import Bars, Figure, Panel, Points, Scale
from sysid.blocks.svg import picture
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.estimation.linear import Estimate, mean_estimate
from sysid.fleet.comparison import Comparison
from sysid.fleet.rows import effects_of
from sysid.identification.valve_discrete.responses import Responses
from sysid.io.rig import Rig, rig_from_content
from sysid.parameters import Bundle, DiscreteLaw, FittedValves, Parts, Valve
from sysid.parameters.effects import EffectEntry, entry_of
from sysid.parameters.refinement import Refinement
from sysid.parameters.valves import OpenLaw
from sysid.pipeline.compare import compare, shown_names, write_comparison
from sysid.plant.effects import AtmosphereLeakage


@pytest.fixture(scope="module")
def bundle() -> Bundle:
    return si.read_bundle(golden_bundle("diagnosed"))


def moved_by(bundle: Bundle, place: str, name: str, errors: float) -> Bundle:
    """The bundle with one number of friction moved by so many of its standard errors."""
    part = getattr(bundle, place)
    old = getattr(part, name)
    content = part.to_json()
    content[name] = {**content[name], "value": old.value + errors * old.std}
    content[name].pop("interval", None)
    return bundle.replaced(**{place: type(part).model_validate(content)})


def redrawn(bundle: Bundle, rng: np.random.Generator) -> Bundle:
    """Friction as another day's tests would give it: its numbers drawn with their covariance."""
    part = bundle.parameters.parts()["friction"]
    keys = tuple(key for key, estimate in part.estimates.items() if estimate.has_error)
    drawn = rng.multivariate_normal(
        [part.estimates[k].value for k in keys], part.covariance(keys), method="svd"
    )
    content: dict[str, Any] = bundle.to_json()["friction"]
    for key, value in zip(keys, drawn, strict=True):
        content[key] = {**content[key], "value": float(value)}
    return bundle.replaced(friction=type(bundle.friction).model_validate(content))


def test_a_bundle_does_not_move_against_itself(bundle: Bundle) -> None:
    found = si.compare(bundle, bundle)
    assert found.moved == () and found.movements
    assert {e.state for e in found.effects} == {"same"}
    assert "no parameter moved" in found.headline()


def test_what_moved_is_found_and_nothing_else(bundle: Bundle) -> None:
    found = si.compare(bundle, moved_by(bundle, "friction", "coulomb_nm", 12.0))
    assert {m.part for m in found.moved} == {"friction"}
    assert [m.name for m in found.moved if m.name] == ["coulomb_nm"]
    movement = next(m for m in found.moved if m.name)
    assert movement.z == pytest.approx(12.0 / np.sqrt(2.0))
    frame = found.to_frame()
    moved = frame[frame["significant"]]
    assert set(moved["parameter"]) == {"coulomb_nm"} and len(moved) == 1


def test_chance_is_not_called_a_movement(bundle: Bundle) -> None:
    """Bundles that differ by their errors alone: at most 5 % of comparisons say something."""
    rng = np.random.default_rng(20181)
    made = [redrawn(bundle, rng) for _ in range(200)]
    pairs = zip(made[::2], made[1::2], strict=True)
    said = sum(bool(si.compare(one, other).moved) for one, other in pairs)
    assert said <= 10  # of 100; 5 % would be 5


def few_trials(bundle: Bundle, rng: np.random.Generator, trials: int) -> Bundle:
    """Friction whose static, Coulomb and viscous friction are each a mean of so many trials."""
    content: dict[str, Any] = bundle.to_json()["friction"]
    content = {k: v for k, v in content.items() if k != "correlation"}
    for key in ("static_nm", "coulomb_nm", "viscous_nm_s_per_rad"):
        drawn = rng.normal(content[key]["value"], 0.05, trials)
        made = mean_estimate(drawn, content[key]["unit"]).to_json()
        content[key] = made
    return bundle.replaced(
        friction=type(bundle.friction).model_validate(content), valves=None, effects=[]
    )


@pytest.mark.parametrize("dof", [1.0, 2.0, 11.0, 300.0, np.inf])
def test_degrees_of_freedom_are_those_of_the_interval(dof: float) -> None:
    found = Estimate.symmetric(2.0, 0.1, "Nm", dof).degrees_of_freedom
    assert found == pytest.approx(dof, rel=1e-6)


def test_chance_is_no_movement_with_few_trials_either(bundle: Bundle) -> None:
    """Of 3 trials each: every single p-value is below 5 % about as often as it says, or less."""
    rng = np.random.default_rng(20185)
    made = [few_trials(bundle, rng, 3) for _ in range(400)]
    pairs = zip(made[::2], made[1::2], strict=True)
    found = [si.compare(one, two) for one, two in pairs]
    moves = [m for one in found for m in one.movements if m.name != "offset_nm"]
    whole = [m.p_value < 0.05 for m in moves if m.name is None]
    single = [m.p_value < 0.05 for m in moves if m.name is not None]
    assert len(whole) == 200 and len(single) == 600
    assert np.mean(single) < 0.07 and np.mean(whole) < 0.08
    assert sum(bool(one.moved) for one in found) <= 16  # of 200; 5 % would be 10


def test_numbers_whose_errors_go_together_are_compared_together(bundle: Bundle) -> None:
    """Each moves by 1.5 errors, against their correlation: together that is no chance."""
    friction = bundle.friction
    assert friction is not None
    content = friction.to_json()
    names = ["coulomb_nm", "viscous_nm_s_per_rad"]
    content["correlation"] = {"names": names, "matrix": [[1.0, -0.98], [-0.98, 1.0]]}
    one = bundle.replaced(friction=type(friction).model_validate(content))
    two = moved_by(moved_by(one, "friction", names[0], 2.2), "friction", names[1], 2.2)
    content = two.friction.to_json() | {"correlation": content["correlation"]}  # type: ignore[union-attr]
    two = two.replaced(friction=type(friction).model_validate(content))
    moved = [(m.part, m.name) for m in si.compare(one, two).moved]
    assert moved == [("friction", None)]


def test_numbers_that_are_nearly_one_are_compared_as_one(bundle: Bundle) -> None:
    """The file's rounding leaves a correlation of 1: only the common direction is tested."""
    assert bundle.friction is not None
    names = ["coulomb_nm", "viscous_nm_s_per_rad"]
    for corner in (1.0, 0.999999, 1.000001):
        content = bundle.friction.to_json()
        content["correlation"] = {"names": names, "matrix": [[1.0, corner], [corner, 1.0]]}
        one = bundle.replaced(friction=type(bundle.friction).model_validate(content))
        two = moved_by(one, "friction", names[0], 0.01)
        whole = next(
            m for m in si.compare(one, two).movements if m.part == "friction" and not m.name
        )
        assert 0.0 <= whole.z < 0.1 and whole.p_value > 0.9


def test_effects_appear_disappear_and_grow(bundle: Bundle) -> None:
    assert bundle.effects
    bare = bundle.replaced(effects=[])
    assert {e.state for e in si.compare(bare, bundle).effects} == {"appeared"}
    assert {e.state for e in si.compare(bundle, bare).effects} == {"disappeared"}
    entry = bundle.effects[0].to_json()
    name, value = next((k, v) for k, v in entry["parameters"].items() if isinstance(v, dict))
    value = {**value, "std": 1e-3 * abs(value["value"])}
    value.pop("interval", None)
    entry["parameters"] = entry["parameters"] | {name: value}
    one = bundle.replaced(effects=[type(bundle.effects[0]).model_validate(entry)])
    entry["parameters"] = entry["parameters"] | {name: {**value, "value": 1.5 * value["value"]}}
    two = bundle.replaced(effects=[type(bundle.effects[0]).model_validate(entry)])
    assert [e.state for e in si.compare(one, two).effects] == ["grew"]
    assert [e.state for e in si.compare(two, one).effects] == ["shrank"]


def test_an_effect_whose_shape_alone_moved_is_the_same(bundle: Bundle) -> None:
    entry = bundle.effects[0]
    content = entry.to_json()
    strength, shape = entry.numbers()
    old = content["parameters"][shape]
    moved = {"value": old["value"] + 50.0 * old["std"], "std": old["std"], "unit": old["unit"]}
    content["parameters"] = {**content["parameters"], shape: moved}
    other = bundle.replaced(effects=[type(entry).model_validate(content)])
    found = si.compare(bundle, other)
    assert [e.state for e in found.effects] == ["same"]
    assert shape in [m.name for m in found.moved] and strength not in [m.name for m in found.moved]


def test_a_refinement_says_how_an_effects_errors_go_together(bundle: Bundle) -> None:
    effect = bundle.effects[0]
    names = [f"{effect.id}.{key}" for key in effect.numbers()]
    value = {"value": 1.0, "std": 0.1, "unit": ""}
    content = {
        "parameters": [
            {"name": name, "origin": "effect", "before": 1.0, "before_std": None, "after": value}
            | {"movement": None, "informed_by_motion": True}
            for name in ["friction.coulomb_nm", *names]
        ],
        "correlation": (0.5 + 0.5 * np.eye(len(names) + 1)).tolist(),
        **dict.fromkeys(("converged", "evaluations", "segments", "segments_left_out"), 1),
        "friction_scatter": None,
    }
    refined = bundle.replaced(refinement=Refinement.model_validate(content))
    part = next(p for place, p in refined.parameters.parts().items() if place.startswith("effect"))
    assert tuple(part.estimates) == tuple(effect.numbers())
    assert part.correlation[0, -1] in (0.5, 1.0)


def test_shown_as_the_other_results_are(bundle: Bundle) -> None:
    found = si.compare(bundle, moved_by(bundle, "friction", "coulomb_nm", 12.0), bundle)
    assert isinstance(found, Comparison)
    assert "\n" not in repr(found) and "coulomb_nm" in str(found)
    assert "<table>" in found._repr_html_()
    # What moved is a cloud of its own, filled, beyond the stripe of its bundle; nothing else is.
    clouds = [mark for mark in found.figure().panels[0].marks if isinstance(mark, Points)]
    assert [(cloud.is_filled, len(cloud.x) > 0) for cloud in clouds].count((True, True)) == 1
    assert len(found.plot().get_lines()) == len(clouds) == 3
    stripes = [mark for mark in found.figure().panels[0].marks if isinstance(mark, Bars)]
    assert len(stripes) == 2
    # The legend has a row of its own above all of them.
    ax = found.plot()
    ax.get_figure(root=True).canvas.draw()
    box = ax.get_legend().get_window_extent().transformed(ax.transData.inverted())
    assert box.y0 > max(place for one in stripes for place in one.places)
    limits = {y: x for one in stripes for x, y in zip(one.ends, one.places, strict=True)}
    for cloud in clouds:
        beyond = [abs(x) > limits[y] for x, y in zip(cloud.x, cloud.y, strict=True)]
        assert beyond == [cloud.is_filled] * len(beyond)
    parameters = next(iter(found.tables()))
    assert parameters.columns[2].name == "Unit"
    cells = [str(cell) for row in parameters.rows for cell in row[3:]]
    assert not [cell for cell in cells if cell.count("× 10") > 1]
    json.dumps(found.to_json(), allow_nan=False)


def test_what_moved_has_its_unit(bundle: Bundle) -> None:
    delay = bundle.parameters.parts()["valves.a.discrete"].estimates["on_delay_s"]
    content = bundle.to_json()
    later = {"value": delay.value + 0.002, "std": delay.std, "unit": "s"}
    content["valves"]["a"]["discrete"]["on_delay_s"] = later
    found = si.compare(bundle, Bundle.model_validate(content))
    moved = next(t for t in found.tables() if t.caption.startswith("What moved"))
    row = next(r for r in moved.rows if r[2].plain == "on_delay_s")
    assert re.match(r"2\.0\d* ms \(", row[3])


def test_surfaces_that_are_not_compared_are_said(bundle: Bundle) -> None:
    said = "PWM surfaces are not compared"
    assert any(said in line for line in si.compare(bundle, bundle).notices)
    content = bundle.to_json()
    for valve in content["valves"].values():
        valve["pwm"] = {"fill": {"identified": False, "reason": "too few duties"}}
    none = Bundle.model_validate(content)
    for one, other in ((none, bundle), (bundle, none), (none, none)):
        assert not any(said in line for line in si.compare(one, other).notices)


def test_effects_of_one_name_are_kept_apart(bundle: Bundle) -> None:
    entries = []
    for side, p in (("a", 1e-30), ("a", 0.02), ("b", 0.04)):
        entry = entry_of(AtmosphereLeakage(5e-17, side)).to_json()
        entries.append(EffectEntry.model_validate({**entry, "p_value": p}))
    several = bundle.replaced(effects=entries)
    places = [place for place in several.parameters.parts() if place.startswith("effect")]
    name = "effect atmosphere-leakage"
    assert places == [f"{name} (a)", f"{name} (a) 2", f"{name} (b)"]
    assert effects_of(several) == {"atmosphere-leakage": 1e-30}


def test_of_other_rigs_and_of_one_alone(bundle: Bundle) -> None:
    linear = si.read_bundle(golden_bundle("linear_axis"))
    with pytest.raises(InputError, match=r"is of a linear rig, .* of a rotary one"):
        si.compare(bundle, linear)
    with pytest.raises(InputError, match="holds no law of valve A that valve B has too"):
        si.compare(linear)
    with pytest.raises(InputError, match="give at least one with two valves"):
        si.compare()
    with pytest.raises(InputError, match="holds no part that"):
        si.compare(bundle.replaced(effects=[], valves=None), bundle.replaced(friction=None))
    surfaces = bundle.replaced(effects=[], friction=None).to_json()
    for valve in surfaces["valves"].values():
        valve["pwm"] = {"fill": {"identified": False, "reason": "too few duties"}}
        del valve["discrete"]
    only = Bundle.model_validate(surfaces)
    with pytest.raises(InputError, match=r"nothing in common .* but PWM surfaces"):
        si.compare(only, only)
    bare = bundle.to_json()["friction"]
    bare = {k: {**v, "std": None} if k.endswith("_nm") else v for k, v in bare.items()}
    bare["viscous_nm_s_per_rad"] = {**bare["viscous_nm_s_per_rad"], "std": None}
    friction = type(bundle.friction).model_validate(bare)
    untested = bundle.replaced(friction=friction, valves=None, effects=[])
    assert "no movement was tested" in si.compare(untested, untested).headline()
    content = {**bundle.rig_content, "pwm": {"period_s": 0.01}}
    other = si.compare(bundle, bundle.replaced(rig_content=content))
    assert "[pwm] differs" in other.notices[0]


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("one", "two"):
        shutil.copy(golden_bundle("diagnosed"), tmp_path / f"{name}.json")
    files = [str(tmp_path / "one.json"), str(tmp_path / "two.json")]
    assert main(["compare", *files]) == 0
    assert "no parameter moved" in capsys.readouterr().out
    assert main(["compare", *files, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bundles"] == ["one.json", "two.json"]
    page = tmp_path / "page.html"
    assert main(["compare", files[0], "--report", str(page)]) == 0
    assert "against valve A: moved" in capsys.readouterr().out
    assert "fig-responses-dis" in page.read_text("utf-8")


def test_responses_of_candidate_valves_follow_from_their_laws(bundle: Bundle) -> None:
    """A tenth of the way from the atmosphere is choked: a straight line after the delay (3.5.2)."""
    found = si.compare(bundle, bundle)
    assert isinstance(found.responses, Responses)
    assert len({r.valve for r in found.responses.responses}) == 4
    air, own = bundle.rig.air, bundle.rig.cylinder
    assert air is not None and own is not None
    volume = (own.offset_a_m + 0.5 * own.stroke_m) * own.area_a_m2
    assert found.responses.volume_m3 == pytest.approx(volume)
    rise = 0.1 * (air.supply_pressure_pa - air.atmospheric_pressure_pa)
    mass = rise * volume / (air.heat_capacity_ratio * air.gas_constant_j_per_kg_k)
    mass /= air.temperature_k
    for response in found.responses.responses[:2]:
        side = response.valve[-1].lower()
        part = bundle.parameters.parts()[f"valves.{side}.discrete"]
        keys = ("choked_flow_fill_kg_s", "on_delay_s")
        flow, delay = (part.estimates[key].value for key in keys)
        assert response.times[0].value == pytest.approx(delay + mass / flow, rel=1e-4)
        slope = np.array([-mass / flow**2, 1.0])
        error = math.sqrt(slope @ part.covariance(keys) @ slope)
        assert response.times[0].std == pytest.approx(error, rel=1e-3)
    valves = si.compare(bundle)
    assert valves.names == ("valve A", "valve B") and valves.movements and not valves.effects
    assert valves.to_frame()["part"].unique().tolist() == ["valve discrete"]


def test_names_of_bundles_are_as_short_as_they_can_be() -> None:
    far = "/measurements/rig 3/"
    assert shown_names([f"{far}a.json", f"{far}b.json"]) == ["a.json", "b.json"]
    assert shown_names([f"{far}1/a.json", f"{far}2/a.json"]) == ["1/a.json", "2/a.json"]
    assert shown_names([f"{far}a.json", f"{far}a.json"]) == ["a.json", "a.json (2)"]
    same = [f"{far}1/a.json", f"{far}2/a.json", f"{far}1/a.json"]
    assert shown_names(same) == ["1/a.json", "2/a.json", "1/a.json (2)"]


def test_the_page_says_what_moved_by_titles(bundle: Bundle, tmp_path: Path) -> None:
    found = si.compare(bundle, moved_by(bundle, "friction", "coulomb_nm", 12.0))
    assert "coulomb_nm" in found.headline()
    write_comparison(tmp_path / "compared.html", found)
    page = (tmp_path / "compared.html").read_text("utf-8")
    assert "moved: friction coulomb_nm" not in page
    # One colon, and the bundle that the others are compared with.
    assert f">Moved against {found.names[0]}: Coulomb friction, friction as a whole.<" in page


# --- flow laws that are not decided --------------------------------------------------------


def of_laws(rig: Rig, **by_law: tuple[float, float]) -> Bundle:
    """A tank's bundle, c_dis and its error by each law that its tests leave open."""
    unit = "kg/(s Pa)"
    numbers = {law: Estimate.symmetric(c, std, unit, math.inf) for law, (c, std) in by_law.items()}
    first, *others = numbers.values()
    unasked = Estimate.unidentified("", "not asked")
    law = DiscreteLaw(
        c_fill=unasked,
        choked_flow_fill_kg_s=unasked,
        choked_flow_dis_kg_s=unasked,
        c_dis=first.covering(others),
        by_law=[OpenLaw(law=law, numbers={"c_dis": own}) for law, own in numbers.items()],
    )
    return Bundle.new(rig, Parts(valves=FittedValves(a=Valve(discrete=law))), [])


def test_numbers_by_laws_that_are_not_decided_move_by_each_of_them(rig_text: str) -> None:
    """The machine has one law: intervals that cover two hide a movement, and none is made up."""
    rig = rig_from_content(tomllib.loads(rig_text), "rig.toml")
    first = of_laws(rig, cold=(9.0e-10, 1e-13), warm=(12.6e-10, 1e-13))
    (moved,) = compare(first, of_laws(rig, cold=(9.9e-10, 1e-13), warm=(13.8e-10, 2e-13))).moved
    assert moved.name == "c_dis" and moved.change == pytest.approx(0.9e-10)
    assert abs(moved.z) == pytest.approx(1.2e-10 / math.hypot(1e-13, 2e-13))
    again = compare(first, of_laws(rig, cold=(9.9e-10, 1e-13), warm=(12.6e-10, 2e-13)))
    assert not again.moved and len(again.movements) == 1
    (line,) = again.notices
    assert "not decided (cold or warm in both)" in line and line.endswith("of c_dis overlap")
    # A number of one law is none of the other's.
    decided = compare(of_laws(rig, cold=(9.0e-10, 1e-13)), of_laws(rig, warm=(12.6e-10, 1e-13)))
    assert not decided.movements
    (line,) = decided.notices
    assert "follows the flow law warm" in line and "cold" in line and "not compared" in line
    one = compare(first, of_laws(rig, warm=(13.8e-10, 1e-13)))
    assert [m.change for m in one.moved] == pytest.approx([1.2e-10])


def test_a_number_fitted_anew_is_of_no_law_before(rig_text: str) -> None:
    rig = rig_from_content(tomllib.loads(rig_text), "rig.toml")
    law = of_laws(rig, cold=(9.0e-10, 1e-13), warm=(12.6e-10, 1e-13)).valve("a").discrete
    assert law is not None and law.by_law is not None
    assert law.replaced(c_dis=law.c_dis).by_law is None
    assert law.replaced(tests=["1"]).by_law == law.by_law


def test_a_legend_without_room_next_to_the_title_is_beneath_it() -> None:
    points = np.arange(3.0)
    marks = tuple(Points(points, points, "model", f"a bundle of number {i}.json") for i in range(4))
    panel = Panel(Scale("x"), Scale("y"), marks, legend="over")
    text = picture(Figure("f", "Each number against the first", "", (panel,))).svg
    found = re.findall(r'<text[^>]* x="(-?[\d.]+)" y="(-?[\d.]+)"[^>]*>([^<]*)<', text)
    places = {said: (float(x), float(y)) for x, y, said in found}
    title = places["Each number against the first"]
    entries = [place for said, place in places.items() if said.startswith("a bundle")]
    assert len(entries) == 4
    assert all(x > 0.0 and y > title[1] + 8.0 for x, y in entries)
