"""Estimation by simulation error: the parameters of simulated logs are found, and how well."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.optimize import least_squares

from benchmarks.refinement import rig_runs, unknown
from benchmarks.rigs import REFERENCE
from sysid.errors import InputError, OutOfBudgetError
from sysid.estimation.autoregression import (
    Autoregression,
    autoregression,
    stationary,
    whitening_matrix,
)
from sysid.parallel import limited
from sysid.plant.effects.chamber import TubeLag
from sysid.plant.effects.sensor import PressureLag
from sysid.plant.ports import Model
from sysid.plant.simulator import simulate
from sysid.recording.motion_tests import Segment
from sysid.recording.start_states import InitialState
from sysid.refinement import lengthening, scan
from sysid.refinement.estimation import Estimated, FrictionScatter, estimate
from sysid.refinement.lengthening import _neighbours, _Piece
from sysid.refinement.problem import Iterate, Problem, RunErrors, _sensor_moved
from sysid.refinement.profiles import profile
from sysid.refinement.reduction import ReducedEquations, reduced
from sysid.refinement.runs import Run
from sysid.refinement.scan import scanned
from sysid.refinement.solver import Solution, solve
from sysid.refinement.unknowns import MOST_FACTOR, Unknown, chosen, model_at, numbers_of
from sysid.types import FloatArray

NAMES = ("coulomb_effort", "viscous", "choked_fill_a")
OFF = (0.1, -0.1, 0.05)
LOGS = 3
_AT_REST = InitialState(np.zeros(4), np.zeros(4), np.ones(4, dtype=int))
SCATTER = FrictionScatter(0.02, 0.02, 5.0)


@pytest.fixture(scope="module")
def simulated() -> tuple[list[Run], Model]:
    """Segments of a random rig's logs, with noise, and its model."""
    return rig_runs(12, LOGS, 2.5)


def problem_of(runs: list[Run], model: Model) -> Problem:
    unknowns = tuple(unknown(model, n, off) for n, off in zip(NAMES, OFF, strict=True))
    started = model_at(model, unknowns, np.array([u.value for u in unknowns]))
    white = tuple(tuple(Autoregression.white(float(n) ** 2) for n in run.noise) for run in runs)
    return Problem(tuple(runs), unknowns, started, "theta_rad", white, SCATTER.pair, LOGS)


@pytest.fixture(scope="module")
def found(simulated: tuple[list[Run], Model]) -> Estimated:
    return estimate(problem_of(*simulated), SCATTER)


def test_an_estimation_cut_short_keeps_the_best_so_far(
    simulated: tuple[list[Run], Model], found: Estimated
) -> None:
    problem = problem_of(*simulated)
    with limited(evaluations=1), pytest.raises(OutOfBudgetError):
        estimate(problem, SCATTER)
    with limited() as whole:
        estimate(problem, SCATTER)
    with limited(evaluations=whole.made - 1):
        cut = estimate(problem, SCATTER)
    assert cut.cut_short and not found.cut_short
    off = cut.solution.point.shared - found.solution.point.shared
    errors = np.sqrt(np.diag(found.error_covariance()))[: len(off)]
    assert np.all(np.abs(off) < errors)


def test_parameters_are_found_within_their_errors(
    simulated: tuple[list[Run], Model], found: Estimated
) -> None:
    assert found.solution.converged
    std = np.sqrt(np.diag(found.solution.at.error_covariance()))
    for i, u in enumerate(found.problem.unknowns):
        true = float(getattr(simulated[1].parameters, u.name))
        error = u.at(float(found.solution.point.shared[i])) - true
        allowed = 5.0 * u.slope(float(found.solution.point.shared[i])) * float(std[i])
        assert abs(error) < allowed
        assert allowed < abs(u.value - true)


def test_most_segments_are_followed_to_the_noise(found: Estimated) -> None:
    assert len(found.left_out) <= 1
    for run, own in zip(found.problem.runs, found.solution.at.runs, strict=True):
        rms = np.sqrt(np.mean(own.errors.residual**2, axis=1))
        assert (rms < 3.0 * run.noise).all()


def test_a_bound_stops_one_parameter_and_no_other(simulated: tuple[list[Run], Model]) -> None:
    """A flow that must be 0.1 % above the truth: friction is found all the same."""
    problem = problem_of(*simulated)
    coulomb, viscous, flow = problem.unknowns
    true = simulated[1].parameters
    low = 1.001 * float(true.choked_fill_a)
    bounded = dataclasses.replace(flow, lower=low, upper=2.0 * low)
    held = dataclasses.replace(problem, unknowns=(coulomb, viscous, bounded))
    end, free = (solve(p, p.first_point(), 40, 0.05) for p in (held, problem))
    assert end.converged
    assert bounded.at(float(end.point.shared[2])) == low
    assert flow.at(float(free.point.shared[2])) < low  # it is the bound that keeps it there
    std = np.sqrt(np.diag(free.at.covariance()))[:2]
    assert (np.abs(free.point.shared - problem.first_point().shared)[:2] > 5.0 * std).all()
    assert (np.abs(end.point.shared - free.point.shared)[:2] < 2.0 * std).all()


def test_no_step_takes_a_tests_friction_beyond_its_limit(found: Estimated) -> None:
    """A step that hardly anything damps once overflowed; the other unknowns move as they did."""
    problem, at = found.problem, found.solution.at
    p = len(problem.unknowns)
    far = np.zeros(p + 2 * problem.tests)
    far[p], far[p + 1] = 1e6, -1e6
    there = at.moved(problem, far, found.solution.counted)
    factors = np.exp(there.friction[0] * problem.scatter)
    np.testing.assert_allclose(factors, [MOST_FACTOR, 1.0 / MOST_FACTOR])
    np.testing.assert_array_equal(there.friction[1:], at.point.friction[1:])
    assert np.isfinite(there.starts).all()
    assert all(np.isfinite(run.cost) for run in problem.linearised(there))


def test_a_profile_asks_nothing_beyond_a_bound(found: Estimated) -> None:
    flow = found.problem.unknowns[2]
    at = flow.at(float(found.solution.point.shared[2]))
    std = float(np.sqrt(found.solution.at.error_covariance()[2, 2]))
    low = at - 1.0 * std * flow.scale
    bounded = dataclasses.replace(flow, lower=low, upper=2.0 * at)
    here = dataclasses.replace(found.problem, unknowns=(*found.problem.unknowns[:2], bounded))
    point = dataclasses.replace(
        found.solution.point,
        shared=np.array([*found.solution.point.shared[:2], bounded.coordinate(at)]),
    )
    ended = dataclasses.replace(found, problem=here, solution=solve(here, point, 30, 0.05))
    own = profile(ended, 2, std)
    assert own.values.min() == pytest.approx(low, rel=1e-9) and own.interval[0] >= low
    assert own.rise.max() < 30.0
    assert own.interval[1] == pytest.approx(
        at + 1.96 * std * flow.scale, abs=0.2 * std * flow.scale
    )


def test_scipy_ends_where_optimistix_does(simulated: tuple[list[Run], Model]) -> None:
    """Starts known and friction the same in all logs: the shared parameters alone."""
    runs = [dataclasses.replace(r, start_std=np.full(4, 1e-12)) for r in simulated[0]]
    problem = dataclasses.replace(
        problem_of(runs, simulated[1]), scatter=(1e-9, 1e-9), robust=False
    )
    near = np.array(
        [
            u.coordinate(u.value / (1.0 + 0.98 * o))
            for u, o in zip(problem.unknowns, OFF, strict=True)
        ]
    )
    start = dataclasses.replace(problem.first_point(), shared=near)
    ours = solve(problem, start, 30, 1e-3)

    def residuals(coordinates: FloatArray) -> FloatArray:
        point = dataclasses.replace(start, shared=coordinates)
        models = [problem.model_for(point, run.test) for run in runs]
        errors = []
        for run, one in zip(runs, simulate(problem.inputs(point), models), strict=True):
            shown = np.array([one.position, one.pressure_a, one.pressure_b])
            errors.append(((shown - run.measured) / run.noise[:, None]).ravel())
        return np.concatenate(errors)

    scipys = least_squares(residuals, near, x_scale=0.01, diff_step=1e-6)
    std = np.sqrt(np.diag(ours.at.covariance()))[: len(NAMES)]
    assert np.abs(ours.point.shared - scipys.x).max() < 0.05 * std.max()
    assert ours.at.cost <= 2.0 * scipys.cost * (1.0 + 1e-6)


def test_steps_with_the_same_slopes_end_where_those_with_their_own_do(found: Estimated) -> None:
    std = np.sqrt(np.diag(found.solution.at.covariance()))[: len(NAMES)]
    at = found.solution.point
    start = dataclasses.replace(at, shared=at.shared + 2.0 * std)
    own = solve(found.problem, start, 30, 0.05, first_step=1e6)
    chords = solve(found.problem, start, 30, 0.05, first_step=1e6, chords=True)
    assert own.converged and chords.converged
    assert chords.evaluations < own.evaluations
    assert (np.abs(chords.point.shared - own.point.shared) < 0.25 * std).all()
    found_std = [np.sqrt(np.diag(s.at.covariance()))[: len(NAMES)] for s in (own, chords)]
    np.testing.assert_allclose(*found_std, rtol=0.02)
    known = found.problem.equations([run.errors for run in own.at.runs], own.point)
    for one, other in zip(known, own.at.runs, strict=True):
        np.testing.assert_array_equal(one.factor, other.factor)


def test_friction_that_all_tests_share_and_that_is_their_own_is_one_direction(
    simulated: tuple[list[Run], Model],
) -> None:
    """The model's sliding friction up, each test's own down: no simulation changes."""
    problem = problem_of(*simulated)
    point = problem.first_point()
    unseen = problem.unseen_friction(point)
    assert unseen is not None
    own = unseen[len(NAMES) :].reshape(-1, 2)
    moved = Iterate(point.shared + 1e-3 * unseen[: len(NAMES)], 1e-3 * own, point.starts)
    here, there = (problem.model_for(at, 0).parameters for at in (point, moved))
    for name in ("coulomb_effort", "viscous"):
        assert abs(float(getattr(there, name)) / float(getattr(here, name)) - 1.0) < 1e-8
    alone = dataclasses.replace(problem, unknowns=problem.unknowns[1:])
    assert alone.unseen_friction(alone.first_point()) is None  # Coulomb friction is fixed


def test_a_damped_descent_moves_friction_of_all_tests_at_once(
    simulated: tuple[list[Run], Model],
) -> None:
    """Little scatter: the tests' own friction is nearly one number, moved against the mean."""
    problem = dataclasses.replace(problem_of(*simulated), scatter=(0.005, 0.005))
    end = solve(problem, problem.first_point(), 25, 0.5, first_step=300.0)
    assert end.converged and end.evaluations <= 4  # damped each for themselves: 7


def test_a_scan_finds_static_friction_that_has_no_slope() -> None:
    """A motor that rises by steps of a sample: breakaway is at one of them."""
    runs, model = rig_runs(12, 1, 2.5)
    effort = float(model.parameters.static_effort)
    (first, *_) = runs
    n = len(first.inputs.time)
    still = dataclasses.replace(
        first.inputs,
        valve_a=None,
        valve_b=None,
        motor=np.repeat(np.linspace(0.0, 1.3 * effort, 26), n // 26 + 1)[:n],
        position=0.0,
        velocity=0.0,
        pressure_a=float(model.parameters.atmosphere),
        pressure_b=float(model.parameters.atmosphere),
    )
    (one,) = simulate([still], [model])
    measured = np.array([one.position, one.pressure_a, one.pressure_b])
    run = Run(0, "ramp", still, measured, np.array([1e-5, 1e-9, 1.0, 1.0]), first.noise)
    started = Model(model.parameters.replace(static_effort=0.9 * effort))
    white = (tuple(Autoregression.white(float(x) ** 2) for x in run.noise),)
    problem = Problem(
        (run,), (unknown(started, "viscous", 0.0),), started, "theta_rad", white, SCATTER.pair, 1
    )
    here = problem.first_point()
    there = scanned(problem, here, np.array([True]), far=True)
    assert problem.linearised(here)[0].cost > 5.0 * problem.linearised(there)[0].cost
    share = np.exp(there.friction[0, 1] * SCATTER.static) * 0.9
    assert abs(share - 1.0) < 1.3 / 26.0


def test_friction_that_a_scan_takes_out_of_its_scatter_is_scanned_in_pairs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A shaft that sticks and slips: less static friction makes up for more that slides."""
    runs, model = rig_runs(12, 1, 2.5)
    effort = float(model.parameters.static_effort)
    (first, *_) = runs
    n = len(first.inputs.time)
    time = np.arange(n) / n
    saw = 1.25 * effort * (7.0 * time % 1.0) * np.sign(np.sin(3.0 * np.pi * time))
    atmosphere = float(model.parameters.atmosphere)
    still = dataclasses.replace(
        first.inputs, valve_a=None, valve_b=None, motor=saw, position=0.0, velocity=0.0,
        pressure_a=atmosphere, pressure_b=atmosphere,
    )  # fmt: skip
    base, own = model.parameters, np.exp(np.array([-1.3, 0.8]) * SCATTER.pair)
    sliding = {name: getattr(base, name) * own[0] for name in ("coulomb_effort", "viscous")}
    true = Model(base.replace(**sliding, static_effort=effort * own[1]))
    (one,) = simulate([still], [true])
    measured = np.array([one.position, one.pressure_a, one.pressure_b])
    assert np.sum(np.diff(np.flatnonzero(one.velocity)) > 1) >= 5  # it sticks and slips
    run = Run(0, "saw", still, measured, np.array([1e-5, 1e-9, 1.0, 1.0]), first.noise)
    white = (tuple(Autoregression.white(float(x) ** 2) for x in run.noise),)
    problem = Problem(
        (run,), (unknown(model, "choked_fill_a", 0.0),), model, "theta_rad", white, SCATTER.pair, 1
    )
    none = problem.first_point()
    lost = dataclasses.replace(none, friction=np.array([[1.0, -7.0]]))
    found = scanned(problem, lost, np.array([True]), far=False)
    assert found.friction[0] == pytest.approx([-1.3, 0.8], abs=0.1)
    monkeypatch.setattr(scan, "_in_pairs", lambda problem, point, tests: point)
    alone = scanned(problem, lost, np.array([True]), far=False)
    assert alone.friction[0] != pytest.approx([-1.3, 0.8], abs=1.0)


def test_a_profile_of_a_linear_parameter_is_its_standard_error(found: Estimated) -> None:
    std = float(np.sqrt(found.solution.at.error_covariance()[2, 2]))
    own = profile(found, 2, std)
    low, high = own.interval
    value = found.problem.unknowns[2].at(float(found.solution.point.shared[2]))
    width = 1.96 * std * value
    assert abs((value - low) / width - 1.0) < 0.1
    assert abs((high - value) / width - 1.0) < 0.1


def test_a_simulation_that_blows_up_is_far_off_and_pulls_nothing(
    simulated: tuple[list[Run], Model],
) -> None:
    problem = problem_of(*simulated)
    (first, *_) = problem.linearised(problem.first_point())
    assert first.errors.kept(problem.runs[0]) is first.errors
    residual = np.array(first.errors.residual)
    residual[1, -1] = np.inf
    lost = RunErrors(residual, first.errors.slopes).kept(problem.runs[0])
    assert np.isfinite(lost.residual).all()
    assert (np.abs(lost.residual) > 1e3 * np.abs(first.errors.residual).max(axis=1)[:, None]).all()
    assert not lost.slopes.any()


@pytest.mark.parametrize(
    ("lower", "upper", "value"), [(0.0, np.inf, 2.0), (-1.0, 3.0, 0.5), (-np.inf, np.inf, -4.0)]
)
def test_coordinates_lead_back_and_stay_in_bounds(lower: float, upper: float, value: float) -> None:
    own = Unknown("x", (0, "x"), value, 0.1, "", lower, upper, 2.0, "effect")
    assert own.at(own.start) == pytest.approx(value)
    low, high = own.limits
    assert lower <= own.at(low) and own.at(high) <= upper
    assert own.at(low - 1.0) == own.at(low) and own.at(high + 1.0) == own.at(high)
    for coordinate in (-0.7, 0.4, 1.2):
        inside = own.at(coordinate)
        assert lower < inside < upper
        assert own.coordinate(inside) == pytest.approx(coordinate)
        step = 1e-6
        slope = (own.at(coordinate + step) - own.at(coordinate - step)) / (2.0 * step)
        assert own.slope(coordinate) == pytest.approx(slope, rel=1e-5)


def test_names_choose_and_an_unknown_one_is_refused(
    simulated: tuple[list[Run], Model],
) -> None:
    declared = unknown(simulated[1], "inertia", 0.0)
    unknowns = [unknown(simulated[1], n, 0.0) for n in NAMES]
    every = [*unknowns, dataclasses.replace(declared, name="rig.inertia", origin="rig")]
    assert [u.name for u in chosen(every)] == list(NAMES)
    assert [u.name for u in chosen(every, free=["rig.inertia"], fix=["viscous"])] == [
        "coulomb_effort",
        "choked_fill_a",
        "rig.inertia",
    ]
    assert numbers_of(every, ["inertia"]) == [3]
    with pytest.raises(InputError, match=r"'mass': is unknown; use one of coulomb_effort"):
        chosen(every, fix=["mass"])


def test_a_run_shorter_than_the_whitening_has_its_first_rows_variance() -> None:
    """A run at rest is one reading."""
    own = stationary(np.array([0.5, 0.2]), 1.0)
    assert own is not None
    long = own.innovations(np.ones((5, 1)))
    np.testing.assert_array_equal(own.innovations(np.ones((1, 1))), long[:1])
    assert long[0, 0] == pytest.approx(1.0 / np.sqrt(own.variance))
    assert own.innovations(np.ones((0, 1))).shape == (0, 1)


def test_innovations_are_white_from_the_first_row_on() -> None:
    """Through the whitening the covariance of a run's rows is the unit matrix."""
    own = stationary(np.array([1.4, -0.6]), 0.04)
    assert own is not None
    white = own.innovations(np.linalg.cholesky(toeplitz(own.autocovariance(12))))
    np.testing.assert_allclose(white @ white.T, np.eye(12), atol=1e-10)
    other = Autoregression.white(0.25)
    runs = [slice(0, 5), slice(5, 6), slice(6, 9), slice(9, 12)]
    matrix = whitening_matrix([own, own, other, own], runs, [1.0, 1.0, 0.5, 1.0])
    rows = np.random.default_rng(3).standard_normal((12, 2))
    apart = [own.innovations(rows[run]) for run in runs]
    apart[2] = 0.5 * other.innovations(rows[runs[2]])
    np.testing.assert_allclose(matrix @ rows, np.concatenate(apart), atol=1e-12)


def test_whitening_leaves_innovations() -> None:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(20000)
    errors = np.zeros_like(noise)
    for i in range(1, len(noise)):
        errors[i] = 0.8 * errors[i - 1] + noise[i]
    own = autoregression([errors], 4)
    white = own.innovations(errors[:, None])[:, 0]
    assert own.std == pytest.approx(1.0, rel=0.03)
    assert abs(float(white[1:] @ white[:-1]) / float(white @ white)) < 0.03


def test_slow_errors_of_what_a_model_lacks_are_not_taken_for_white_noise() -> None:
    """Segments that drift off by a polynomial: each row says next to nothing of its own."""
    rng, x = np.random.default_rng(2), np.linspace(0.0, 1.0, 1000)
    drifts = [np.polynomial.Polynomial(rng.standard_normal(4))(x) for _ in range(12)]
    own = autoregression(drifts, 4)
    white = np.concatenate([own.innovations(drift[:, None])[:, 0] for drift in drifts])
    assert len(own.coefficients) and own.std < 0.05
    # The information that they are given is that of about as many readings as there are drifts.
    mean = own.innovations(np.ones((1000, 1)))
    information = len(drifts) * float(mean[:, 0] @ mean[:, 0])
    assert information < 30.0 * len(drifts)
    assert float(white @ white) < 2.0 * len(white)


def test_errors_are_never_below_the_information(found: Estimated) -> None:
    """Few segments: the spread of their gradients alone would promise too much."""
    at = found.solution.at
    assert (np.diag(at.error_covariance()) >= 0.999 * np.diag(at.covariance())).all()


def test_a_positive_parameter_with_an_upper_bound_stays_below_it() -> None:
    own = Unknown("gap", (1, "gap"), 0.08, 0.01, "rad", 0.0, 0.1, 0.05, "effect")
    assert own.at(own.start) == pytest.approx(0.08)
    assert own.at(1e9) <= 0.1
    assert own.at(-1e9) >= 0.0


def test_a_channel_without_noise_is_not_known_exactly(
    simulated: tuple[list[Run], Model],
) -> None:
    runs, model = simulated
    flat = np.array(runs[0].measured)
    flat[1] = flat[1, 0]
    problem = problem_of([dataclasses.replace(runs[0], measured=flat)], model)
    (one,) = dataclasses.replace(problem, tests=1).linearised(
        Iterate(problem.first_point().shared, np.zeros((1, 2)), np.zeros((1, 4)))
    )
    assert np.isfinite(one.factor).all()


def with_errors_of(size: float, at: ReducedEquations, rng: np.random.Generator) -> ReducedEquations:
    """The equations at the least squares of runs whose errors are drawn of this size."""
    drawn = [size * rng.standard_normal(len(rows)) for rows in at.own]
    step = at.covariance() @ sum(rows[:, :-1].T @ e for rows, e in zip(at.own, drawn, strict=True))
    own = [
        np.column_stack([rows[:, :-1], e - rows[:, :-1] @ step])
        for rows, e in zip(at.own, drawn, strict=True)
    ]
    return dataclasses.replace(at, own=tuple(own))


def test_errors_are_enlarged_by_what_the_runs_show_beyond_chance(found: Estimated) -> None:
    rng, at, flow = np.random.default_rng(1), found.solution.at, 2
    by_chance = [with_errors_of(1.0, at, rng).enlargement()[flow] for _ in range(40)]
    assert np.median(by_chance) == 1.0
    assert np.mean(np.array(by_chance) > 1.0) <= 0.1
    larger = [with_errors_of(6.0, at, rng).enlargement()[flow] for _ in range(40)]
    assert np.sqrt(np.mean(np.square(larger))) == pytest.approx(6.0, rel=0.25)


def test_errors_have_as_many_degrees_of_freedom_as_runs_speak_of_them(found: Estimated) -> None:
    """Runs that say the same of two unknowns, one of which the prior knows as well as they do."""
    count = 5
    run = np.column_stack([np.eye(2), np.zeros(2)])
    at = dataclasses.replace(
        found.solution.at,
        jacobian=np.sqrt(count * np.diag([1.0, 2.0])),
        own=(run,) * count,
    )
    assert at.degrees_of_freedom() == pytest.approx([count, 4 * count])
    alone = dataclasses.replace(at, jacobian=np.eye(2), own=(run,))
    assert alone.degrees_of_freedom() == pytest.approx([1.0, 1.0])


def test_few_long_runs_have_the_freedom_of_the_runs_whose_scatter_counts(found: Estimated) -> None:
    """The scatter of the shorter runs, where it is larger, and then their number too."""
    rng, flow = np.random.default_rng(1), 2
    steady, scattered = (with_errors_of(s, found.solution.at, rng) for s in (0.5, 6.0))
    two = dataclasses.replace(steady, own=steady.own[:2])

    def with_at(at: ReducedEquations) -> Estimated:
        return dataclasses.replace(found, solution=dataclasses.replace(found.solution, at=at))

    joined = dataclasses.replace(with_at(two), shorter=with_at(scattered))
    assert joined.enlargement()[flow] == scattered.enlargement()[flow] > 1.0
    assert joined.degrees_of_freedom()[flow] == scattered.degrees_of_freedom()[flow]
    joined = dataclasses.replace(with_at(two), shorter=with_at(steady))
    assert joined.enlargement()[flow] == 1.0
    assert joined.degrees_of_freedom()[flow] == two.degrees_of_freedom()[flow]


def test_where_a_descent_ends_its_errors_are_those_of_the_least(found: Estimated) -> None:
    """A tenth of a standard error off, not six times as uncertain by what no other run says."""
    problem, least = found.problem, found.solution
    std = np.sqrt(np.diag(least.at.covariance()))[: len(NAMES)]
    near = dataclasses.replace(least.point, shared=least.point.shared + 0.1 * std)
    none = np.zeros(len(problem.runs))
    there = reduced(problem, near, problem.linearised(near), none, least.counted)
    np.testing.assert_allclose(there.enlargement(), least.at.enlargement(), rtol=0.05)


def test_rows_of_an_encoder_at_rest_count_as_one(simulated: tuple[list[Run], Model]) -> None:
    run = simulated[0][0]
    count = len(run.inputs.time)
    position = np.arange(count, dtype=float)
    position[100:300] = 100.0  # a rest of 0.2 s
    position[400:410] = 400.0  # slow, but it moves
    own = dataclasses.replace(run, measured=np.array([position, position, position]))
    rows = np.random.default_rng(2).standard_normal((count, 3))
    found = own.independent(0, rows)
    assert len(found) == count - 199
    assert found[100] == pytest.approx(rows[100:300].mean(axis=0))
    assert found[101:] == pytest.approx(rows[300:])
    assert own.independent(1, rows) is rows


def test_where_no_test_is_followed_their_breakaway_is_scanned(
    simulated: tuple[list[Run], Model],
) -> None:
    """None is worse than the others, and the noise says so all the same."""
    runs, model = simulated
    off = np.array([0.0, 50.0, 50.0])[:, None]
    ramp = np.linspace(-1.0, 1.0, len(runs[0].inputs.time))
    wrong = [
        dataclasses.replace(r, measured=r.measured + off * r.noise[:, None] * ramp)
        for r in runs
        if r.test == 0
    ]
    problem = dataclasses.replace(problem_of(wrong, model), tests=1)
    said: list[str] = []
    estimate(problem, SCATTER, progress=said.append)
    assert "round 1: breakaway of 1 tests" in said


def test_runs_remember_what_goes_before_them_as_the_unknowns_have_it(
    simulated: tuple[list[Run], Model],
) -> None:
    runs, model = simulated
    before, after = runs[:2]
    own = [before, dataclasses.replace(after, run_up=before.inputs)]
    bare = problem_of(own, model)
    point = bare.first_point()
    assert not any(run.inputs.remembered for run in bare.after_run_ups(point).runs)
    flows = []
    for lag in (2e-3, 6e-3):
        problem = dataclasses.replace(bare, model=bare.model + TubeLag(lag))
        first, second = problem.after_run_ups(point).runs
        assert not first.inputs.remembered
        assert set(second.inputs.remembered) == {"tube_flow_a", "tube_flow_b"}
        again = problem.after_run_ups(point).after_run_ups(point).runs[1]
        assert again.inputs.remembered == second.inputs.remembered
        flows.append(second.inputs.remembered["tube_flow_a"])
    assert flows[0] != flows[1]
    own[1] = dataclasses.replace(own[1], as_measured=after.inputs)
    problem = dataclasses.replace(bare, runs=tuple(own), model=bare.model + PressureLag(5e-3))
    once = problem.after_run_ups(point)
    twice = once.after_run_ups(point)
    assert once.runs[1].inputs.pressure_a != after.inputs.pressure_a
    assert twice.runs[1].inputs.pressure_a == once.runs[1].inputs.pressure_a


def test_a_sensor_at_its_bound_is_moved_away_from_it() -> None:
    """Beyond, its law need not hold: a lag is of second order at most."""
    model = Model(REFERENCE) + PressureLag(4e-3, "both", 1.0)
    step, moved = _sensor_moved(model, (1, "second_order_share"), 1.0)
    assert step < 0.0 and moved.effects[0].second_order_share == 1.0 + step
    assert _sensor_moved(model, (1, "pressure_lag_s"), 1.0)[0] > 0.0


def test_a_segment_that_was_left_out_is_not_joined_in() -> None:
    pieces = [
        _Piece(0, Segment(start, start + 100, _AT_REST), (i,))
        for i, start in enumerate((0, 110, 220, 430, 530))
    ]
    groups = _neighbours(pieces, 0, gap=50.0)
    assert [[p.members[0] for p in group] for group in groups] == [[0, 1, 2], [3, 4]]
    pairs = _neighbours(pieces, 2, gap=50.0)
    assert [[p.members[0] for p in group] for group in pairs] == [[0, 1], [2], [3, 4]]


@pytest.mark.parametrize("converged, times", [(True, 2), (False, 1)])
def test_longer_runs_that_do_not_converge_are_not_weighted_anew(
    converged: bool, times: int, found: Estimated, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def solved(problem: Problem, point: Iterate, **given: object) -> Solution:
        asked.append(problem)
        return dataclasses.replace(found.solution, converged=converged, evaluations=3)

    monkeypatch.setattr(lengthening, "solve", solved)
    _, solution = lengthening._solved(found.problem, found.solution.point)
    assert len(asked) == times
    assert solution.evaluations == 3 * times
