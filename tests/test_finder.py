"""The search for effects by evidence on twins of a rig whose lack is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from test_diagnosis import OTHERS, Tests, finder_of, made, null_of, seen_in, twin_of

from sysid.diagnosis.actuator import finder as finder_module
from sysid.diagnosis.actuator.bent_waves import bent_waves
from sysid.diagnosis.actuator.between_tests import Support
from sysid.diagnosis.actuator.columns import Proposal
from sysid.diagnosis.actuator.equation_error import CHANNELS, EFFORT
from sysid.diagnosis.actuator.finder import Finder, _worth_fitting
from sysid.diagnosis.actuator.fitted_set import FittedSet, fit_set, weighed
from sysid.diagnosis.actuator.misfit import ResidualChannel, cost, rise, weights_of
from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.projection import Projected, channel_squares, projected
from sysid.diagnosis.actuator.refit import Refit
from sysid.diagnosis.actuator.samples import Traces, commanded_lengths, prepare
from sysid.diagnosis.actuator.screened import Bias, Signed, screened
from sysid.diagnosis.actuator.signatures import candidates, signature
from sysid.diagnosis.search_record import Recorder
from sysid.io.rig import Rig
from sysid.plant.base import Array, array_namespace
from sysid.plant.effects.chamber import AtmosphereLeakage
from sysid.plant.effects.entry import NEARBY, CatalogueEffect
from sysid.plant.effects.friction import (
    PositionDependentFriction,
    QuadraticDrag,
    SealFriction,
    StribeckFriction,
)
from sysid.plant.effects.linkage import GearMeshRipple, LinkFlexibility, MountingTilt
from sysid.plant.effects.motor import TorqueOffset
from sysid.plant.effects.sensor import LostCounts, PressureLag, TimeSkew
from sysid.plant.effects.supply import SupplyPulsation
from sysid.plant.effects.valve import DutyDeadZone, ValveDelay
from sysid.plant.ports import Model, Point
from sysid.types import no_progress

KINDS = (QuadraticDrag, SealFriction, AtmosphereLeakage, TorqueOffset)


@dataclass(frozen=True)
class TightPlace(CatalogueEffect):
    """Coulomb friction is greater about one place: no sine, and no form of the catalogue's."""

    place_rad: float = -0.5
    more: float = 0.3
    width_rad: float = 0.22

    id = "tight-place"
    quantities = ()

    def friction_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.position)
        near = xp.exp(-(((point.position - self.place_rad) / self.width_rad) ** 2))
        return effort + self.more * point.parameters.coulomb_effort * near * point.direction


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


@pytest.mark.parametrize("tests", [2, 8], ids=["in two tests", "in every test"])
def test_an_effect_of_a_few_tests_is_no_effect(
    tests: int, rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """An offset of two tests explains more than noise ever does, and is none of the rig."""
    traces, model, declared = rig
    twin = twin_of(model, traces, declared, 3)
    motor = twin.motor.copy()
    for run in twin.runs[-tests:]:
        motor[run.rows] += 0.01
    shown = replace(lacking(rig).frame, traces=replace(twin, motor=motor))
    base = projected(shown, model)
    channels = tuple(ResidualChannel.of_noise(len(base.frame.windows[name])) for name in CHANNELS)
    none = channel_squares(base, base.rest)
    found = fit_set(base, channels, [TorqueOffset(0.001)], none)
    (support,) = found.supports
    assert cost(channels, none) - cost(channels, found.squares) > 100.0
    assert support.squares == pytest.approx(none, rel=1e-3)
    assert (found.evidence(channels, none) > 100.0) == (tests == len(twin.runs))
    assert (support.most < 20.0) == (tests < len(twin.runs))
    # Two that imitate each other do not gain more than either.
    starts = [TorqueOffset(0.001), MountingTilt(0.001, 0.001)]
    pair = fit_set(base, channels, starts, none)
    assert (pair.evidence(channels, none) > 50.0) == (tests == len(twin.runs))


@pytest.mark.parametrize(("more", "evidence"), [(20.0, 140.0), (250.0, 600.0), (-5.0, 95.0)])
def test_what_is_owed_to_few_tests_a_further_effect_pays_with_what_it_gains(
    more: float,
    evidence: float,
    rig: tuple[Traces, Model, Rig],
    null: Null,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Next to an effect that hardly helps, strengths may scatter less between tests by chance."""
    finder = finder_of(lacking(rig), null, KINDS)
    monkeypatch.setattr(finder, "_by_chance", lambda *_: 0.0)
    base = finder.first
    finder.channels = tuple(
        ResidualChannel.of_noise(len(base.frame.windows[name])) for name in CHANNELS
    )
    effort = np.array([float(name == EFFORT) for name in CHANNELS])

    def gaining(squares: float, most: float) -> FittedSet:
        refit = cast(Refit, SimpleNamespace(effects=()))
        return FittedSet(refit, finder.none - squares * effort, 0.0, (Support(finder.none, most),))

    alone, both = frozenset({"a"}), frozenset({"a", "b"})
    finder.sets = {alone: gaining(400.0, 100.0)}
    assert finder.evidence(alone) == pytest.approx(100.0)
    finder.sets[both] = gaining(400.0 + more, 380.0 + more)
    assert finder.evidence(both) == pytest.approx(evidence)


@pytest.mark.parametrize(("draws", "whole"), [(1e12, 300.0), (10.0, None)], ids=["noise", "misfit"])
def test_directions_owe_no_more_to_few_tests_than_they_gain_together(
    draws: float, whole: float | None
) -> None:
    """Where a misfit counts by its logarithm, each of two gains next to the other nearly as much as
    both do."""
    rows = 1000
    channel = ResidualChannel(rows, draws, 1.0, rows + 300.0)
    none, left = np.array([rows + 300.0]), np.array([float(rows)])
    parts = np.add(left, [[200.0], [100.0]])
    alone = [float(cost([channel], part) - cost([channel], left)) for part in parts]
    together = float(cost([channel], none) - cost([channel], left))
    assert together == pytest.approx(sum(alone)) if whole else together < 0.7 * sum(alone)

    def owed(*most: float) -> float:
        limits = zip(parts, most, strict=True)
        refit = cast(Refit, SimpleNamespace(effects=()))
        found = FittedSet(refit, left, 0.0, tuple(Support(*pair) for pair in limits))
        return found.of_few_tests([channel])

    assert owed(*alone) == 0.0
    assert owed(0.0, 0.0) == pytest.approx(together)
    one = owed(0.0, alone[1])
    assert one == pytest.approx(together * alone[0] / sum(alone))
    assert one < alone[0] if whole is None else one == pytest.approx(alone[0])
    assert FittedSet(cast(Refit, None), left, 0.0, ()).of_few_tests([channel]) == 0.0


def test_a_shape_that_gains_on_twins_once_it_is_fitted_is_no_evidence(
    rig: tuple[Traces, Model, Rig], null: Null, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A set is judged by what it gains beyond its own fit on twins, not beyond the forms alone."""
    finder = finder_of(lacking(rig, StribeckFriction(0.1, 0.1)), null, (*KINDS, StribeckFriction))
    stribeck = frozenset({"stribeck-friction"})
    assert finder.run() == stribeck
    squares, gained = finder.sets[stribeck].squares, finder._on_twins[stribeck]
    assert rise(finder.channels, squares, gained) < 0.1 * finder.evidence(stribeck)
    as_much = finder.none - squares
    monkeypatch.setattr(finder_module, "fall_on_twin", lambda *_: as_much)
    finder._on_twins.clear()
    assert not stribeck <= finder._beyond_twins()
    # What is linear gains on twins what its forms show: it is not fitted there.
    drag = finder_of(lacking(rig, QuadraticDrag(0.01)), null, KINDS)
    monkeypatch.setattr(finder_module, "fall_on_twin", lambda *_: pytest.fail("fitted"))
    assert drag.run() == {"quadratic-drag"}


def test_what_twins_gain_counts_as_misfit_does() -> None:
    """In full where noise is all there is, and by the logarithm next to what a large effect
    explains: it was taken off in full, and hid effects of fifty times its size."""
    little, much = (ResidualChannel(10_000, 12.0, 1.0, 10_000.0 + e) for e in (0.0, 9000.0))
    gained, noise = np.array([170.0]), np.array([9_900.0])
    assert rise([little], noise, np.zeros(1)) == 0.0
    assert rise([little], noise, np.array([60.0])) == pytest.approx(60.0)
    fall = float(much.cost(19_000.0) - much.cost(9_900.0))
    assert rise([much], noise, gained) < 0.5 * fall < 0.5 * float(gained[0])
    # What twins gain as well leaves no evidence, however large the misfit.
    assert rise([much], noise, np.array([9_100.0])) == pytest.approx(fall)


def test_what_twins_lose_in_one_balance_makes_up_for_no_gain_in_another() -> None:
    """A remainder slightly above its noise holds what was lost: without it, it is not explained."""
    channels = (ResidualChannel.of_noise(9000), ResidualChannel(9000, 12.0, 1.0, 9600.0))
    squares = np.array([9000.0, 9600.0])
    gained = np.array([200.0, -600.0])
    own = rise(channels, squares, gained * [1.0, 0.0])
    assert own == pytest.approx(200.0)
    assert own > rise(channels, squares, gained) > 0.8 * own


def test_what_explains_most_of_a_misfit_is_fitted_next_to_what_gains_most() -> None:
    """A wave between two frequencies explains a part of a chamber's misfit, which counts by its
    logarithm; a little in the torque, which is noise, counts in full."""
    torque = ResidualChannel(1_000, 12.0, 1.0, 1_000.0)
    chamber = ResidualChannel(1_000, 12.0, 1.0, 500_000.0)
    little = Proposal((0,), (np.ones(1),), -5.0, np.array([960.0, 500_000.0]))
    wave = Proposal((1,), (np.ones(1),), -5.0, np.array([1_000.0, 200_000.0]))
    columns: Any = SimpleNamespace(
        channels=(torque, chamber), squares=np.array([1_000.0, 500_000.0])
    )
    gains = [float(cost(columns.channels, p.squares)) for p in (little, wave)]
    assert gains[0] < gains[1]
    found = _worth_fitting(columns, [[little, wave]])
    assert any(p is little for p in found) and any(p is wave for p in found)
    # In channels that are noise alone, the one that gains most in all.
    columns.squares = np.array([1_000.0, 900.0])
    assert all(p is little for p in _worth_fitting(columns, [[little, wave]]))


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
    assert [q for q in type(effect).quantities if not q.is_choice] == [strength]
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
    proposed = finder._proposed["quadratic-drag"][frozenset()]
    some, form, columns = proposed.some, proposed.form, proposed.some.columns
    assert columns.penalty[form] - columns.chance[form] > 2.0 * math.log(len(OTHERS))
    by_chance = columns.penalty[form] - columns.chance[form]
    gained = finder.bias.gained(some, (form,), weights)
    by_chance += rise(finder.channels, found.squares, gained)
    assert finder.evidence(frozenset({"quadratic-drag"})) == pytest.approx(raw - by_chance)
    assert weights @ gained >= 0.0


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


def test_a_relative_gives_its_place_up_to_what_does_better_in_it(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """A pressure that is logged late was found as a lag of its sensor: with the drag it had been
    screened as that, and the two together were the best set."""
    drag, late, lag = QuadraticDrag(0.004), TimeSkew(2e-3, "a"), PressureLag(2e-3, "a")
    base = lacking(rig, drag, late)
    finder = finder_of(base, null, (QuadraticDrag, TimeSkew, PressureLag))
    assert finder.run() == {drag.id, late.id}
    left = finder.sets[finder.best()].squares
    finder.sets.clear()
    for starts in ([late], [lag], [drag, lag]):
        own = fit_set(base, finder.channels, starts, left)
        finder.sets[own.names] = own
    relative = frozenset({drag.id, lag.id})
    assert finder.best() == relative
    finder._exchanged(relative)
    assert finder.best() == {drag.id, late.id}
    # Nothing did better in the place of either of these.
    known = set(finder.sets)
    finder._exchanged(finder.best())
    assert set(finder.sets) == known


def test_a_valve_that_is_late_is_found_where_it_opens_and_closes_as_late(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """Either delay alone changes the flow far more than both together: strengths are probed on top
    of each other, so that their sum is what both do."""
    base, late = lacking(rig, ValveDelay(5e-4, 5e-4, "a")), ValveDelay
    form = next(f for f in candidates([late]) if dict(f.shape)["side"] == "a")
    one, other = signature(base.frame, base.model, base.residual, form).T
    both = base.frame.residual(base.model + form.with_strengths((1.0, 1.0))) - base.residual
    np.testing.assert_allclose(one + other, both, atol=1e-9)
    assert np.linalg.norm(both) < 0.5 * min(np.linalg.norm(one), np.linalg.norm(other))
    finder = Finder(base, candidates([late, AtmosphereLeakage]), null, Recorder(), no_progress)
    assert finder.run() == {"valve-delay"}
    (found,) = finder.sets[frozenset({"valve-delay"})].effects
    assert found == ValveDelay(pytest.approx(5e-4, abs=5e-5), pytest.approx(5e-4, abs=5e-5), "a")


def test_a_threshold_is_tried_where_the_commands_lengths_lie(
    rig: tuple[Traces, Model, Rig],
) -> None:
    """Two values far apart both miss a dead time between them: it acts pulse by pulse."""
    traces, model, _ = rig
    lengths = commanded_lengths(traces.runs, model)
    assert np.all(lengths > 0.0) and len(lengths) > 1000
    forms = candidates([DutyDeadZone, StribeckFriction], lengths=lengths)
    tried = np.unique([dict(f.steps)["dead_time_s"] for f in forms if f.id == "duty-dead-zone"])
    assert np.max(tried[1:] / tried[:-1]) <= NEARBY**2 * (1.0 + 1e-9)
    assert tried[0] <= np.quantile(lengths, 0.01)
    assert tried[-1] == pytest.approx(min(np.median(lengths), 2.5e-3))
    # Of logs without commands it is what the catalogue says, and so is what is no threshold.
    (dead, *_) = DutyDeadZone.quantities
    assert dead.at_lengths(np.zeros(0)) == dead
    assert all(q.at_lengths(lengths) == q for q in StribeckFriction.quantities)


def test_strokes_are_found_from_a_sine_whose_phase_makes_up_for_its_frequency(
    rig: tuple[Traces, Model, Rig],
) -> None:
    """A fit that begins at a sine alone ends in a minimum of its own."""
    strokes = SupplyPulsation(5e3, -6e3, 2.55, 0.9)
    base = lacking(rig, strokes)
    sine = SupplyPulsation(-7e3, 1e3, 2.55, 0.0)
    every = list(bent_waves(base, (sine,), 0))
    # The second of each two is as long again: a sine may follow a harmonic of the strokes.
    assert [one.stroke_share for one in every] == pytest.approx([-0.49, -0.49, 0.49, 0.49])
    assert [one.pulsation_hz for one in every] == pytest.approx([2.55, 1.275, 2.55, 1.275])
    bent = every[::2]
    for one in every:
        assert math.hypot(one.pulsation_sine_pa, one.pulsation_cosine_pa) == pytest.approx(
            math.hypot(7e3, 1e3)
        )
    # Of the phases the one next to the strokes'.
    turned = math.atan2(bent[1].pulsation_cosine_pa, bent[1].pulsation_sine_pa)
    assert turned == pytest.approx(math.atan2(-6e3, 5e3), abs=0.4)
    # A shape that screening tries at several values begins at the best of them, and what is no
    # wave has no phase to be wrong.
    assert list(bent_waves(base, (StribeckFriction(0.1, 0.1),), 0)) == []
    assert list(bent_waves(base, (LinkFlexibility(0.1),), 0)) == []


def test_a_ripple_with_a_second_harmonic_is_one_effect(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """Of a wave with a strong second harmonic a sine leaves more than is tolerated."""
    true = GearMeshRipple(0.03, 0.02, 17.3, 0.45, -0.3)
    finder = finder_of(lacking(rig, true), null, (*KINDS, GearMeshRipple))
    names = frozenset({"gear-mesh-ripple"})
    assert finder.run() == names
    (found,) = finder.sets[names].effects
    for q in type(found).quantities:
        assert getattr(found, q.name) == pytest.approx(getattr(true, q.name), rel=0.1)


def test_the_speed_from_which_counts_are_lost_is_found_though_the_loss_jumps_there(
    rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """Over a small step of that speed hardly a sample begins to lose: it has no slope."""
    base = lacking(rig, LostCounts(0.03, 0.86, 1.0))
    finder = finder_of(base, null, [LostCounts])
    found = fit_set(base, finder.channels, [LostCounts(0.02, 1.0, 1.0)], finder.none)
    (lossy,) = found.effects
    assert isinstance(lossy, LostCounts)
    assert lossy.counted_speed_rad_per_s == pytest.approx(0.86, rel=0.02)
    assert lossy.lost_share == pytest.approx(0.03, rel=0.03)
    assert lossy.lost_of_all == 1.0


@pytest.mark.parametrize("wave", [2.4, 4.8])
def test_a_tight_place_is_found_from_a_sine(
    wave: float, rig: tuple[Traces, Model, Rig], null: Null
) -> None:
    """Also from one that follows the first harmonic of the peak."""
    base = lacking(rig, TightPlace())
    finder = finder_of(base, null, [PositionDependentFriction])
    start = PositionDependentFriction(-0.05, 0.05, wave)
    found = fit_set(base, finder.channels, [start], finder.none)
    (peaked,) = found.effects
    assert isinstance(peaked, PositionDependentFriction)
    assert 0.3 < float(peaked.friction_peakedness) < 0.9
    # The peak lies where it is: at a phase of which the wave is at its height.
    phase = math.atan2(float(peaked.friction_sine), float(peaked.friction_cosine))
    period = 2.0 * math.pi / float(peaked.friction_wave_per_rad)
    place = phase / float(peaked.friction_wave_per_rad)
    assert abs((place + 0.5 + 0.5 * period) % period - 0.5 * period) < 0.05
    effort = CHANNELS.index(EFFORT)
    assert found.squares[effort] < 0.2 * finder.none[effort]
