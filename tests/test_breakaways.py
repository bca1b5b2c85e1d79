"""Readings of the effort at which a shaft breaks away, and the effect that only they show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis import SILENT, Tests, made

from sysid.diagnosis.actuator.breakaways import breakaways
from sysid.diagnosis.actuator.equation_error import (
    BREAKAWAY,
    CHANNELS,
    channels_of,
    equation_error,
)
from sysid.diagnosis.actuator.misfit import ResidualChannel
from sysid.diagnosis.actuator.projection import Projected, projected
from sysid.diagnosis.actuator.refit import refit
from sysid.diagnosis.actuator.samples import Traces, prepare
from sysid.diagnosis.actuator.screened import screened
from sysid.diagnosis.actuator.signatures import Candidate, candidates
from sysid.diagnosis.actuator.states import point_of
from sysid.diagnosis.actuator.twins import Scatter, simulate_twins
from sysid.diagnosis.actuator.whitening import build_frame, noise_of
from sysid.diagnosis.search_record import Recorder
from sysid.io.rig import Rig
from sysid.plant import plant
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.friction import SealFriction, StictionAfterRest
from sysid.plant.ports import Model
from sysid.types import FloatArray

EXPONENTIAL = ("stiction-after-rest", "exponential", 1.0)


def moving(tests: Tests) -> Tests:
    return [test for test in tests if test[1] in ("motion-motor", "motion-pwm")]


def read(traces: Traces, model: Model) -> tuple[FloatArray, FloatArray]:
    """Rows of the readings, and each one's effort over static friction."""
    rows = breakaways(traces, model, np.ones(len(traces), dtype=bool)).centre
    applied = np.asarray(plant.applied_effort(point_of(traces, model), model))
    return rows, np.abs(applied[rows]) / float(model.parameters.static_effort)


@pytest.fixture(scope="module")
def plain() -> tuple[Traces, Rig, Model]:
    tests, rig, model = made()
    return prepare(moving(tests), rig, model), rig, model


@pytest.fixture(scope="module")
def sticking() -> tuple[Traces, Rig, Model]:
    tests, rig, model = made(EXPONENTIAL)
    return prepare(moving(tests), rig, model), rig, model


def seen(traces: Traces, rig: Rig, model: Model) -> Projected:
    """The residual beside what readings of a twin without the effect show."""
    twin = next(iter(simulate_twins(traces, model, SILENT, Scatter(), 1, 3, rig)))
    return projected(build_frame(traces, model, noise_of(twin, model), 0.02), model)


def best_form(base: Projected, forms: list[Candidate]) -> tuple[CatalogueEffect, float]:
    """The form that explains most as it is screened, and by how much it lowers the squares."""
    channels = tuple(
        ResidualChannel(len(base.frame.windows[name]), 1e9, 1.0, float(len(base.rest)))
        for name in CHANNELS
    )
    some = screened(base, forms, channels, Recorder())
    alone = some.columns.proposals([(f,) for f in range(len(some.forms))])
    best = min(alone, key=lambda one: float(np.sum(one.squares)))
    (effect,) = some.effects(best)
    return effect, float(np.sum(some.columns.squares - best.squares))


def test_readings_are_those_of_static_friction(plain: tuple[Traces, Rig, Model]) -> None:
    traces, _, model = plain
    rows, ratio = read(traces, model)
    assert len(rows) >= 20
    assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
    assert np.all((ratio > 0.8) & (ratio < 1.2))


def test_how_long_it_rested_before_a_log_nobody_knows(plain: tuple[Traces, Rig, Model]) -> None:
    traces, _, model = plain
    rows, _ = read(traces, model)
    for run in traces.runs:
        begins = int(np.argmax(traces.direction[run.rows] != 0.0)) + run.rows.start
        own = rows[(rows >= run.rows.start) & (rows < run.rows.stop)]
        assert np.all(own > begins)


def test_what_moves_below_sliding_friction_has_not_broken_away(
    plain: tuple[Traces, Rig, Model],
) -> None:
    """A gap that is crossed, or a bristle that yields: with more friction nothing is read."""
    traces, _, model = plain
    p = model.parameters
    rougher = Model(p.replace(coulomb_effort=2.0 * p.static_effort))
    assert len(read(traces, rougher)[0]) == 0


def test_static_friction_that_grows_at_rest_is_seen_in_readings_alone(
    plain: tuple[Traces, Rig, Model], sticking: tuple[Traces, Rig, Model]
) -> None:
    forms = candidates([StictionAfterRest])
    assert channels_of(StictionAfterRest(0.05)) == (BREAKAWAY,)
    assert BREAKAWAY not in channels_of(SealFriction(2e-7))
    assert np.median(read(sticking[0], sticking[2])[1]) < 0.93
    healthy, lacking = seen(*plain), seen(*sticking)
    assert best_form(healthy, forms)[1] < 5.0
    best, gain = best_form(lacking, forms)
    assert gain > 25.0
    found = refit(lacking, [best])
    own = lacking.frame.rows(BREAKAWAY)
    left, before = found.rest[own], lacking.rest[own]
    assert left @ left < 0.5 * before @ before
    rows = lacking.frame.windows[BREAKAWAY].centre
    extended = sticking[2] + found.effects[0]
    after = equation_error(sticking[0], extended, (BREAKAWAY,)).breakaway[rows]
    assert abs(np.median(after)) < 0.03 * float(sticking[2].parameters.static_effort)


def test_the_shaft_is_simulated_to_break_away_at_less_after_a_short_rest(
    plain: tuple[Traces, Rig, Model],
) -> None:
    """A twin with the effect, read as a log is: the law at the rests that its states say."""
    traces, rig, model = plain
    lacking = model + StictionAfterRest(0.08, 0.2)
    twin = next(iter(simulate_twins(traces, lacking, SILENT, Scatter(), 1, 3, rig)))
    rows = breakaways(twin, model, np.ones(len(twin), dtype=bool))
    static = float(model.parameters.static_effort)
    without = equation_error(twin, model, (BREAKAWAY,)).breakaway[rows.centre] / static
    own = equation_error(twin, lacking, (BREAKAWAY,)).breakaway[rows.centre] / static
    assert np.median(without) < -0.08
    assert abs(np.median(own)) < 0.05
    assert np.std(own) < 0.05


def test_a_held_shaft_has_no_readings(plain: tuple[Traces, Rig, Model]) -> None:
    traces, _, model = plain
    held = replace(traces, runs=tuple(replace(run, moves=False) for run in traces.runs))
    assert len(read(held, model)[0]) == 0
