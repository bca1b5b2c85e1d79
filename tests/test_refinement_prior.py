"""The joint prior of a refinement: its rows, where they come from, and what they do."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any, cast

import numpy as np
import pytest
from test_bundle import FRICTION, LAW
from test_bundle import estimate as written
from test_valve_discrete import make_rig

from benchmarks.refinement import rig_runs
from benchmarks.refinement import unknown as unknown_of
from sysid.estimation.autoregression import Autoregression
from sysid.io.rig import Rig
from sysid.parameters import Bundle, FittedValves, Friction, Parts
from sysid.parameters.refinement import Refinement
from sysid.plant.ports import Model
from sysid.refinement.draws import drawn_models
from sysid.refinement.estimation import Estimated, FrictionScatter, estimate
from sysid.refinement.prior import BenchRows, prior_factor
from sysid.refinement.problem import Problem
from sysid.refinement.unknowns import Unknown, model_at, unknowns_of
from sysid.types import FloatArray


def unknown(name: str, value: float, std: float, **more: Any) -> Unknown:
    lower, upper, scale = (*more.pop("bounds", (0.0, math.inf)), abs(value) or 1.0)
    return Unknown(name, (0, name), value, std, "", lower, upper, scale, "friction", **more)


def tied(matrix: FloatArray, **more: Any) -> list[Unknown]:
    """One with a logarithm, one between bounds, one without, one without a prior."""
    names = ("log", "bounded", "plain", "none")
    stds = (0.02, 0.05, 0.3, 0.1)
    bounds = ((0.0, math.inf), (-1.0, 1.0), (-math.inf, math.inf), (0.0, math.inf))
    return [
        unknown(
            name,
            value,
            std,
            bounds=own,
            has_prior=name != "none",
            correlations=tuple(zip(names, row, strict=True)),
            **more,
        )
        for name, value, std, own, row in zip(
            names, (0.2, 0.4, -2.0, 1.0), stds, bounds, matrix.tolist(), strict=True
        )
    ]


MATRIX = np.array(
    [[1.0, -0.9, 0.3, 0.5], [-0.9, 1.0, -0.2, 0.0], [0.3, -0.2, 1.0, 0.0], [0.5, 0.0, 0.0, 1.0]]
)


def test_the_rows_are_those_of_the_joint_normal() -> None:
    """Rows' rows are the inverse covariance in the coordinates; zero without a prior."""
    unknowns = tied(MATRIX)
    factor = prior_factor(unknowns)
    std = np.array([u.std / u.slope(u.start) for u in unknowns[:3]])
    inverse = np.linalg.inv(MATRIX[:3, :3] * np.outer(std, std))
    assert (factor.T @ factor)[:3, :3] == pytest.approx(inverse)
    assert not factor[3].any() and not factor[:, 3].any()
    # One that is fixed is not there: the others keep what they had.
    fewer = prior_factor(unknowns[1:3])
    inverse = np.linalg.inv(MATRIX[1:3, 1:3] * np.outer(std[1:], std[1:]))
    assert fewer.T @ fewer == pytest.approx(inverse)
    # Draws of the bench's errors have, whitened, no correlation and unit variance.
    draws = np.random.default_rng(67).multivariate_normal(np.zeros(3), MATRIX[:3, :3], 20_000)
    white = draws * std @ factor[:3, :3].T
    assert np.cov(white.T) == pytest.approx(np.eye(3), abs=0.05)


def test_without_a_correlation_every_prior_stands_alone() -> None:
    unknowns = [dataclasses.replace(u, correlations=()) for u in tied(MATRIX)]
    expected = [1.0 / u.prior_std if u.has_prior else 0.0 for u in unknowns]
    assert (prior_factor(unknowns) == np.diag(expected)).all()


BENCH = BenchRows(
    ((0, "bounded"), (0, "not there"), (0, "log")),
    np.array([0.35, 2.0, 0.22]),
    np.array([[3.0, 1.0, -2.0], [0.5, 4.0, 60.0], [1.0, -1.0, 5.0]]),
    np.array([0.2, -1.0, 0.4]),
)


def test_the_benchs_rows_are_over_the_unknowns_coordinates() -> None:
    unknowns = tied(MATRIX)
    shared = np.array([u.start for u in unknowns]) + np.array([0.1, 0.03, 0.0, 0.2])
    rows = BENCH.over(unknowns, shared)
    bounded, log = (unknowns[i].at(float(shared[i])) for i in (1, 0))
    # What is no unknown stays as it is.
    there = BENCH.left + BENCH.slopes @ np.array([bounded - 0.35, 0.0, log - 0.22])
    assert rows[:, -1] == pytest.approx(there)
    assert not rows[:, 2:4].any()
    for i in (0, 1):
        moved = shared + 1e-6 * (np.arange(4) == i)
        slope = (BENCH.over(unknowns, moved)[:, -1] - rows[:, -1]) / 1e-6
        assert rows[:, i] == pytest.approx(slope, rel=1e-4)


def test_the_benchs_rows_add_their_squares_to_the_priors() -> None:
    model = Model(cast(Any, None), ())
    problem = Problem((), tuple(tied(MATRIX)), model, "", (), (0.02, 0.02), 0)
    both = dataclasses.replace(problem, bench=BENCH)
    start = problem.first_point()
    other = dataclasses.replace(start, shared=start.shared + np.array([0.02, -0.1, 0.05, 0.3]))

    own = [BENCH.over(problem.unknowns, at)[:, -1] for at in (start.shared, other.shared)]
    fall = [p.prior_cost(start) - p.prior_cost(other) for p in (problem, both)]
    assert fall[1] == pytest.approx(fall[0] + own[0] @ own[0] - own[1] @ own[1])
    before, after = (p.prior(start.shared) for p in (problem, both))
    bench = BENCH.over(problem.unknowns, start.shared)
    assert (after[: len(before)] == before).all()
    squares = after[:, :-1].T @ after[:, :-1]
    assert squares == pytest.approx(
        before[:, :-1].T @ before[:, :-1] + bench[:, :-1].T @ bench[:, :-1]
    )


def test_an_unknown_that_is_held_leaves_the_others_conditional_on_it() -> None:
    """For each: its own row is its own prior, so that the profile's cost is that of the joint."""
    unknowns = tied(MATRIX)[:3]
    whole = prior_factor(unknowns)
    move = np.array([0.03, -0.2, 0.1])
    for i in range(3):
        held = list(unknowns)
        held[i] = dataclasses.replace(held[i], held_at=held[i].start + move[i])
        factor = prior_factor(held)
        assert np.flatnonzero(factor[i]).tolist() == [i]
        assert factor[i, i] == pytest.approx(1.0 / unknowns[i].prior_std)
        left = factor @ move
        assert left @ left == pytest.approx(float(np.sum((whole @ move) ** 2)))


def test_numbers_that_are_tied_exactly_leave_finite_rows() -> None:
    ones = np.ones((4, 4))
    unknowns = tied(ones)[:3]
    factor = prior_factor(unknowns)
    assert np.isfinite(factor).all()
    std = np.array([u.prior_std for u in unknowns])
    along, across = factor @ std, factor @ (std * [1.0, -1.0, 0.0])
    assert along @ along == pytest.approx(1.0, rel=1e-4)
    assert across @ across > 1e5


def pair(first: str, second: str, r: float) -> dict[str, Any]:
    return {"names": [first, second], "matrix": [[1.0, r], [r, 1.0]]}


@pytest.fixture
def rig(rig_text: str) -> Rig:
    return make_rig(rig_text)


@pytest.fixture
def bundle(rig: Rig) -> Bundle:
    """With friction's correlation and that of valve A, not of valve B."""
    together = pair("coulomb_nm", "viscous_nm_s_per_rad", -0.9)
    friction = {**FRICTION, "static_nm": written(0.3), "correlation": together}
    law = LAW.to_json()
    valves = {
        "a": {"discrete": {**law, "correlation": pair("c_fill", "c_dis", 0.5)}},
        "b": {"discrete": law},
    }
    parts = Parts(Friction.model_validate(friction), FittedValves.model_validate(valves))
    return Bundle.new(rig, parts, [])


def test_unknowns_carry_what_the_bundle_keeps(rig: Rig, bundle: Bundle) -> None:
    found = {u.name: u for u in unknowns_of(bundle, rig, bundle.model(rig))}
    coulomb = dict(found["friction.coulomb_nm"].correlations)
    assert coulomb["friction.viscous_nm_s_per_rad"] == -0.9
    assert dict(found["valves.a.c_fill"].correlations)["valves.a.c_dis"] == 0.5
    assert found["friction.static_nm"].correlations == ()
    assert found["valves.b.c_fill"].correlations == ()
    factor = prior_factor([found["friction.coulomb_nm"], found["friction.viscous_nm_s_per_rad"]])
    assert np.count_nonzero(factor) == 3


def test_drawn_models_are_as_wrong_as_the_bundle_says(rig: Rig, bundle: Bundle) -> None:
    model = bundle.model(rig)
    p = model.parameters
    drawn = [m.parameters for m in drawn_models(bundle, rig, model, 4000, seed=5)]
    names = ("static_effort", "coulomb_effort", "viscous")
    off = np.array([[getattr(d, n) / getattr(p, n) - 1.0 for n in names] for d in drawn])
    assert off.std(axis=0) == pytest.approx([0.1, 0.1, 0.1], rel=0.1)  # as `written`
    assert np.corrcoef(off.T)[1, 2] == pytest.approx(-0.9, abs=0.02)
    assert np.corrcoef(off.T)[0, 1] == pytest.approx(0.0, abs=0.06)
    assert {d.inertia for d in drawn} == {p.inertia}
    same = [m.parameters for m in drawn_models(bundle, rig, model, 2, seed=5)]
    assert [d.viscous for d in same] == [d.viscous for d in drawn[:2]]


def test_of_numbers_without_an_error_no_model_is_drawn(rig: Rig, bundle: Bundle) -> None:
    assert bundle.friction is not None
    friction = {**bundle.friction.to_json(), "correlation": None}
    friction["viscous_nm_s_per_rad"] = {"value": 0.05, "unit": "Nm s/rad"}
    other = bundle.replaced(friction=Friction.model_validate(friction))
    assert drawn_models(other, rig, other.model(rig), 3, seed=5) == []


def test_of_a_refined_bundle_the_whole_matrix_counts(rig: Rig, bundle: Bundle) -> None:
    """Across the parts too, of all that it estimated; `sysid advise` starts from there."""
    names = ("friction.coulomb_nm", "valves.b.c_fill")
    rows = [
        {
            "name": name,
            "origin": "friction",
            "before": 1.0,
            "before_std": 0.1,
            "after": written(1.0),
            "movement": 0.0,
            "informed_by_motion": True,
        }
        for name in names
    ]
    record = Refinement.model_validate(
        {"parameters": rows, "correlation": [[1.0, 0.4], [0.4, 1.0]]}
    )
    refined = bundle.replaced(refinement=record)
    found = {u.name: u for u in unknowns_of(refined, rig, refined.model(rig))}
    for name, other in itertools.permutations(names):
        assert dict(found[name].correlations)[other] == 0.4
    # What it left alone is as the bench tests said.
    assert found["valves.a.c_fill"].correlations == (("valves.a.c_dis", 0.5),)


# --- the estimation ----------------------------------------------------------------------

FRICTIONS = ("coulomb_effort", "viscous")
OFF = (0.01, 0.01)
STD = 0.01
SCATTER = FrictionScatter(0.02, 0.02, 5.0)


def estimated(r: float) -> Estimated:
    """A random rig's motion, its friction started off by 1 % with a prior of 1 %."""
    runs, model = rig_runs(12, 3, 2.5)
    unknowns = tuple(
        dataclasses.replace(
            unknown_of(model, name, off),
            std=STD * float(getattr(model.parameters, name)) * (1.0 + off),
            correlations=tuple((other, 1.0 if other == name else r) for other in FRICTIONS),
        )
        for name, off in zip(FRICTIONS, OFF, strict=True)
    )
    started = model_at(model, unknowns, np.array([u.value for u in unknowns]))
    white = tuple(tuple(Autoregression.white(float(n) ** 2) for n in run.noise) for run in runs)
    problem = Problem(tuple(runs), unknowns, started, "theta_rad", white, SCATTER.pair, 3)
    return estimate(problem, SCATTER)


def test_an_estimate_moves_as_the_joint_prior_says() -> None:
    """Both priors are 1 % too high, which errors that go against each other make unlikely.

    The difference of the two solutions is that of the priors' linear equations.
    """
    alone, together = estimated(0.0), estimated(-0.99)
    first, second = (np.array(f.solution.point.shared) for f in (alone, together))
    prior = [f.problem.prior(first) for f in (alone, together)]
    m = alone.solution.at.jacobian.shape[1]
    information = alone.solution.at.jacobian.T @ alone.solution.at.jacobian
    wide = [np.pad(p[:, :-1], ((0, 0), (0, m - 2))) for p in prior]
    information += wide[1].T @ wide[1] - wide[0].T @ wide[0]
    slope = wide[1].T @ prior[1][:, -1] - wide[0].T @ prior[0][:, -1]
    expected = -np.linalg.solve(information, slope)[:2]
    assert np.abs(expected).max() > 1e-3
    assert second - first == pytest.approx(expected, abs=0.1 * float(np.abs(expected).max()))
    # A prior that knows the sum better leaves it known better.
    ones = np.ones(2)
    spread = [
        float(
            ones @ np.linalg.inv(f.solution.at.jacobian.T @ f.solution.at.jacobian)[:2, :2] @ ones
        )
        for f in (alone, together)
    ]
    assert spread[1] < 0.9 * spread[0]
