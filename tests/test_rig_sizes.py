"""Usual sizes of effects on rigs of another size or speed, by similarity."""

from __future__ import annotations

import copy
import pickle

import pytest

from sysid.plant.base import Parameters
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.demonstration import short_test
from sysid.plant.effects.entry import PER_FLOW
from sysid.plant.effects.friction import QuadraticDrag
from sysid.plant.effects.linear import for_rig
from sysid.plant.effects.rig_sizes import RigSizes, of_size

TIME, AREA, LENGTH = 10.0, 20.0, 3.0


def scaled(p: Parameters, linear: bool) -> Parameters:
    """The rig slower, wider and longer, by similarity: pressures and angles stay."""
    flow = AREA * LENGTH / TIME
    flows = ("choked_fill_a", "choked_dis_a", "c_fill_a", "c_dis_a")
    flows += ("choked_fill_b", "choked_dis_b", "c_fill_b", "c_dis_b")
    changes = {name: flow * getattr(p, name) for name in flows}
    changes |= {"area_a": AREA * p.area_a, "area_b": AREA * p.area_b, "stroke": LENGTH * p.stroke}
    if not linear:
        changes["pitch_radius"] = LENGTH * p.pitch_radius
    return p.replace(**changes)


@pytest.mark.parametrize("linear", [False, True])
def test_sizes_follow_the_rigs_similarity(linear: bool) -> None:
    """Each by its unit: an effort, a drag, a stiffness, an inertia, a leak, a lag."""
    usual = RigSizes.of(short_test(linear=linear).model.parameters)
    sizes = RigSizes.of(scaled(short_test(linear=linear).model.parameters, linear))
    effort, way = (AREA, LENGTH) if linear else (AREA * LENGTH, 1.0)
    assert sizes.effort == pytest.approx(effort * usual.effort)
    assert sizes.position == pytest.approx(way * usual.position)
    assert sizes.time == pytest.approx(TIME * usual.time)
    known = for_rig(catalogue(), linear)
    expected = {
        "stribeck-friction": effort,
        "quadratic-drag": effort * TIME**2 / way**2,
        "asymmetric-viscous-friction": effort * TIME / way,
        "cable-spring": effort / way,
        "inertia-mismatch": effort * TIME**2 / way,
        "atmosphere-leakage": AREA * LENGTH / TIME,
        "seal-friction": effort,
        "pressure-lag": TIME,
        "pressure-gain": 1.0,
    }
    for id, times in expected.items():
        quantity = known[id].strengths()[0]
        first = quantity.usual_size * usual.times(quantity)
        own = of_size([known[id]], sizes)[0].strengths()[0]
        # The demonstration's rig is like the reference rig, to a sixth in its time.
        assert own.usual_size == pytest.approx(times * first, rel=0.3), id
        assert own.upper >= own.typical and own.lower <= 0.0


@pytest.mark.parametrize("linear", [False, True])
def test_a_rig_like_the_reference_rig_has_the_catalogue_itself(linear: bool) -> None:
    own = list(for_rig(catalogue(), linear).values())
    assert of_size(own, RigSizes.of(short_test(linear=linear).model.parameters)) == own


def test_a_faster_rig_has_no_faster_sensors() -> None:
    fast = of_size([catalogue()["pressure-lag"]], RigSizes(time=0.01))[0]
    assert fast is catalogue()["pressure-lag"]
    # What a supply loses is tried by the rig's flow.
    droop = catalogue()["supply-droop"].strengths()[0]
    assert droop.unit == PER_FLOW and RigSizes(flow=100.0).times(droop) == 1.0


def test_frequencies_of_a_slow_rig_are_low_ones_too() -> None:
    """A fast rig's are those of the reference rig, which a simulation follows."""
    link = catalogue()["link-flexibility"]
    assert of_size([link], RigSizes(time=0.1)) == [link]
    (slow,) = of_size([link], RigSizes(time=10.0))
    usual, own = (
        next(q for q in kind.quantities if q.name == "link_frequency_hz") for kind in (link, slow)
    )
    assert own.lower == pytest.approx(usual.lower / 10.0) and own.upper == usual.upper
    assert set(own.grid) == {*usual.grid, *(0.1 * value for value in usual.grid)}


def test_an_effect_of_another_size_is_the_effect_to_other_processes() -> None:
    (kind,) = of_size([QuadraticDrag], RigSizes(time=10.0))
    assert of_size([QuadraticDrag], RigSizes(time=10.0)) == [kind]
    effect = kind.typical()
    assert effect.id == "quadratic-drag" and isinstance(effect, QuadraticDrag)
    for other in (pickle.loads(pickle.dumps(effect)), copy.deepcopy(effect)):
        assert type(other) is QuadraticDrag
        assert other.drag_nm_s2_per_rad2 == pytest.approx(0.5)
