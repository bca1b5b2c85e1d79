"""The search for effects by evidence on twins of a rig whose lack is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis import OTHERS, Tests, finder_of, made, null_of, seen_in

from sysid.diagnosis.actuator import finder as finder_module
from sysid.diagnosis.actuator.equation_error import CHANNELS, EFFORT
from sysid.diagnosis.actuator.finder import Finder
from sysid.diagnosis.actuator.fitted_set import fit_set, weighed
from sysid.diagnosis.actuator.misfit import weights_of
from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.projection import Projected
from sysid.diagnosis.actuator.samples import Traces, prepare
from sysid.diagnosis.actuator.screened import Bias, Signed, screened
from sysid.diagnosis.search_record import Recorder
from sysid.io.rig import Rig
from sysid.plant.effects.chamber import AtmosphereLeakage
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.friction import QuadraticDrag, SealFriction, StribeckFriction
from sysid.plant.effects.linkage import LinkFlexibility
from sysid.plant.effects.motor import TorqueOffset
from sysid.plant.effects.sensor import PressureLag, TimeSkew
from sysid.plant.ports import Model

KINDS = (QuadraticDrag, SealFriction, AtmosphereLeakage, TorqueOffset)


@pytest.fixture(scope="module")
def rig() -> tuple[Traces, Model, Rig]:
    """Eight tests that move, the model of their rig, and the rig."""
    tests, declared, model = made(scatter=0.02)
    wanted = {"friction_sliding": 2, "motion_motor": 1, "motion_pwm": 3, "motion_discrete": 2}
    some: Tests = [
        test for stem, n in wanted.items() for test in [t for t in tests if t[0] == stem][:n]
    ]
    return prepare(some, declared, model), model, declared


@pytest.fixture(scope="module")
def null(rig: tuple[Traces, Model, Rig]) -> Null:
    return null_of(*rig)


def lacking(rig: tuple[Traces, Model, Rig], *effects: CatalogueEffect) -> Projected:
    traces, model, declared = rig
    return seen_in(traces, Model(model.parameters, effects), model, declared)


@pytest.mark.parametrize(
    ("drag", "leak"),
    [(0.004, 5e-17), (0.02, 5e-17), (0.004, 4e-16)],
    ids=["alike", "drag", "leak"],
)
def test_a_pair_in_different_balances_is_found_however_much_each_explains(
    drag: float, leak: float, rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """What is left of the chambers, far more than the drag explains, does not outvote it."""
    true = QuadraticDrag(drag), AtmosphereLeakage(leak)
    finder = finder_of(lacking(rig, *true), null, KINDS)
    names = frozenset(e.id for e in true)
    assert finder.run() == names
    found = {e.id: e for e in finder.sets[names].effects}
    for effect in true:
        for q in effect.strengths():
            own = getattr(found[effect.id], q.name)
            assert own == pytest.approx(getattr(effect, q.name), rel=0.05)
    # Each of them is evidence, alone and beside the other.
    alone = [finder.evidence(frozenset({name})) for name in names]
    assert min(alone) > 0.0 and finder.evidence(names) > max(alone) + 10.0
    effort = CHANNELS.index(EFFORT)
    left = finder.sets[names].squares
    assert finder.none[effort] - left[effort] > 0.0 < np.sum(finder.none - left)


def test_where_nothing_is_missing_there_is_no_evidence_for_anything(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """However like a link that bends smoothing and windows look: they do on the twins as well."""
    base = lacking(rig)
    kinds = (*KINDS, LinkFlexibility)
    finder = finder_of(base, null, kinds)
    assert finder.run() == frozenset()
    assert all(finder.evidence(names) < 0.0 for names in finder.sets)
    (only,) = finder.rounds
    assert only.before == only.best == frozenset()
    # Every effect was tried, and those that bias alone explains were asked of the twins.
    some = finder._screened[frozenset()]
    assert {form.id for form in some.forms} == {kind.id for kind in kinds} | set(OTHERS)


def test_a_shape_that_gains_on_twins_once_it_is_fitted_is_no_evidence(
    rig: tuple[Traces, Model, Rig], null: Null, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A set is judged by what it gains beyond its own fit on twins, not beyond the forms alone."""
    finder = finder_of(lacking(rig, StribeckFriction(0.1, 0.1)), null, (*KINDS, StribeckFriction))
    stribeck = frozenset({"stribeck-friction"})
    assert finder.run() == stribeck
    assert finder._on_twins[stribeck] < 0.1 * finder.evidence(stribeck)
    as_much = 2.0 * finder.evidence(stribeck)
    monkeypatch.setattr(finder_module, "fall_on_twin", lambda *_: as_much)
    finder._on_twins.clear()
    assert not stribeck <= finder._beyond_twins()
    # What is linear gains on twins what its forms show: it is not fitted there.
    drag = finder_of(lacking(rig, QuadraticDrag(0.01)), null, KINDS)
    monkeypatch.setattr(finder_module, "fall_on_twin", lambda *_: pytest.fail("fitted"))
    assert drag.run() == {"quadratic-drag"}


def test_signatures_serve_again_beside_a_set(rig: tuple[Traces, Model, Rig], null: Null) -> None:
    """What they are projected on and compared with is the residual's own."""
    base = lacking(rig, QuadraticDrag(0.01))
    finder = finder_of(base, null, KINDS)
    own: dict[str, Signed] = {}
    first = screened(base, finder.forms, finder.channels, Recorder(), own)
    assert set(own) == {form.id for form in finder.forms}
    again = screened(base, finder.forms, finder.channels, Recorder(), own)
    np.testing.assert_array_equal(again.columns.gram, first.columns.gram)
    # The scatter of friction is weighed by the frame that is given.
    more = replace(base, frame=replace(base.frame, scatter=0.1))
    fresh = screened(more, finder.forms, finder.channels, Recorder())
    served = screened(more, finder.forms, finder.channels, Recorder(), own)
    np.testing.assert_allclose(served.columns.gram, fresh.columns.gram, rtol=1e-5, atol=1e-6)
    assert not np.allclose(served.columns.gram, first.columns.gram)


def test_what_a_pair_gains_where_nothing_is_missing_is_no_evidence(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """The difference of two that are nearly alike, as on the twins: neither alone gains it."""
    finder = finder_of(lacking(rig), null, [PressureLag, TimeSkew])
    assert finder.run() == frozenset()


def test_a_gain_that_twins_show_as_well_is_no_evidence(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """A link that bends: smoothing and windows leave what looks like it, on twins and on logs."""
    base, recorder = lacking(rig), Recorder()
    kinds = (*KINDS, LinkFlexibility)
    finder = finder_of(base, null, kinds)
    some = screened(base, finder.forms, finder.channels, recorder)
    bias = Bias(null.twins)
    np.testing.assert_array_equal(bias.counted(some).columns.penalty, some.columns.penalty)
    bias.ask({"link-flexibility"}, finder.forms, recorder)
    assert set(bias.known) == {"link-flexibility"}
    counted = bias.counted(some)
    own = [f for f, form in enumerate(some.forms) if form.id == "link-flexibility"]
    alone = [(f,) for f in range(len(some.forms))]
    before, after = some.columns.proposals(alone), counted.columns.proposals(alone)
    assert max(before[f].evidence for f in own) > 0.0 > max(after[f].evidence for f in own)
    assert all(counted.columns.chance[f] > 0.0 for f in own)
    for f in set(range(len(alone))) - set(own):
        assert before[f].evidence == after[f].evidence


def test_the_evidence_of_a_set_is_that_of_all_its_numbers(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """Laplace's approximation against a sum over a grid of the effect's one number.

    The base parameters, which act linearly, are projected out.
    """
    base = lacking(rig, QuadraticDrag(0.004))
    finder = finder_of(base, null, [QuadraticDrag])
    assert finder.run() == {"quadratic-drag"}
    found = finder.sets[frozenset({"quadratic-drag"})]
    (effect,) = found.effects
    (strength,) = effect.strengths()
    assert len(type(effect).quantities) == 1
    weights = weights_of(finder.channels, found.squares)
    own = weighed(base, weights)
    best = float(getattr(effect, strength.name))

    def power(value: float) -> float:
        """Minus twice the log likelihood, with the channels' noise as it is weighed."""
        model = base.model + type(effect)(value)
        rest = own.project(own.frame.residual(model))
        return float(rest @ rest)

    size = strength.usual_size
    width = size / math.sqrt(power(best + size) + power(best - size) - 2.0 * power(best)) * 2.0**0.5
    grid = np.linspace(best - 6.0 * width, best + 6.0 * width, 41)
    powers = np.array([power(value) for value in grid])
    prior = np.exp(-0.5 * (grid / size) ** 2) / (math.sqrt(2.0 * math.pi) * size)
    step = grid[1] - grid[0]
    ratio = np.sum(np.exp(-0.5 * (powers - powers.min())) * prior) * step
    # -2 log of the share of the prior that the data leave.
    assert found.complexity == pytest.approx(-2.0 * math.log(ratio), abs=0.3)
    fall = sum(
        float(c.cost(was) - c.cost(left))
        for c, was, left in zip(finder.channels, finder.none, found.squares, strict=True)
    )
    raw = found.evidence(finder.channels, finder.none)
    assert raw == pytest.approx(fall - found.complexity)
    # Less what it gains by chance: of so many forms the best, and on the twins.
    some, form = finder._proposed["quadratic-drag"]
    columns = some.columns
    assert columns.penalty[form] - columns.chance[form] > 2.0 * math.log(len(OTHERS))
    by_chance = columns.penalty[form] - columns.chance[form]
    by_chance += finder.bias.reduction(some, (form,), weights)
    assert finder.evidence(frozenset({"quadratic-drag"})) == pytest.approx(raw - by_chance)
    assert finder.bias.reduction(some, (form,), weights) >= 0.0


def test_a_set_with_an_effect_that_is_absent_is_none(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """One that would have to leave its bound: however well the others explain it."""
    base = lacking(rig, SealFriction(2e-7))
    finder = finder_of(base, null, [SealFriction, QuadraticDrag])
    alone = fit_set(base, finder.channels, [SealFriction(1e-7)], finder.none)
    pair = replace(alone, refit=replace(alone.refit, effects=(*alone.effects, QuadraticDrag(0.0))))
    assert not pair.is_whole and alone.is_whole
    assert pair.evidence(finder.channels, finder.none) == -math.inf
    assert alone.evidence(finder.channels, finder.none) > 0.0


def test_a_search_that_is_quick_adds_one_effect_at_most(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    base = lacking(rig, QuadraticDrag(0.004), AtmosphereLeakage(5e-17))
    finder = finder_of(base, null, KINDS)
    quick = Finder(base, finder.forms, null, Recorder(quick=True), finder.progress)
    assert len(quick.run()) == 1 and len(quick.rounds) == 1
    assert all(len(names) == 1 for names in quick.sets)
