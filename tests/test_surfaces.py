"""Surfaces of mean flow over duty and pressure: fit, inverse, domain, network, comparison."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from pwm_campaign import ATMOSPHERE, VALVE_A, VALVE_B, Samples, Valve, campaign

from sysid.errors import InputError, NotIdentifiedError
from sysid.surfaces import (
    Bipolynomial,
    Domain,
    DutyNetwork,
    Saturation,
    compare_surfaces,
    duty_errors,
    resolution_study,
    surface_from_dict,
    surface_points,
    sweep_hidden_size,
    thin_samples,
)
from sysid.surfaces.comparison import recommend
from sysid.surfaces.holdout import group_folds, hold_out_groups
from sysid.surfaces.inverse import flags_of, invert_quadratic, invert_rising

# a1 to i1: rises with duty everywhere on [0, 1] x [1e5, 3e5] Pa.
TRUE = np.array([-1e-4, 5e-10, -3e-15, 9e-4, -1.5e-9, 2e-15, 1e-4, 2e-10, -1e-15])


def polynomial(duty: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    powers = [duty**i * pressure**j for i in range(3) for j in range(3)]
    return TRUE @ np.array(powers)


def grid(levels: int = 20, pressures: int = 40) -> tuple[np.ndarray, np.ndarray]:
    duty, pressure = np.meshgrid(
        np.linspace(0.05, 0.95, levels), np.linspace(1e5, 3e5, pressures), indexing="ij"
    )
    return duty.ravel(), pressure.ravel()


def design(duty: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    return np.array([duty**i * pressure**j for i in range(3) for j in range(3)]).T


def clone_with(surface: Bipolynomial, coefficients: np.ndarray) -> Bipolynomial:
    content = surface.to_dict()
    for term, value in zip(content["coefficients"], coefficients, strict=True):
        term["value"] = value
    return Bipolynomial.from_dict(content)


@pytest.fixture(scope="module")
def filling() -> Samples:
    return campaign(VALVE_A, "fill", step=0.05, noise=150.0, seconds=0.6)


@pytest.fixture(scope="module")
def network(filling: Samples) -> DutyNetwork:
    X = np.column_stack((filling.flow, filling.pressure))
    return DutyNetwork(restarts=20, max_iter=100).fit(X, filling.duty, groups=filling.test)


@pytest.fixture(scope="module")
def fitted(filling: Samples) -> Bipolynomial:
    X = np.column_stack((filling.duty, filling.pressure))
    return Bipolynomial().fit(X, filling.flow)


class TestImports:
    def test_nothing_heavy_is_imported(self) -> None:
        code = (
            "import sys, sysid.surfaces, sysid.surfaces.bipolynomial, sysid.surfaces.ann, "
            "sysid.surfaces.comparison;"
            "print([m for m in ('torch', 'sklearn', 'scipy', 'pandas', 'jax') if m in sys.modules])"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
        assert done.stdout.strip() == b"[]"

    def test_network_predicts_from_its_dict_without_torch(
        self, network: DutyNetwork, filling: Samples
    ) -> None:
        flow, pressure = float(filling.flow[50]), float(filling.pressure[50])
        code = (
            "import json, sys; sys.modules['torch'] = None\n"
            "from sysid.surfaces import surface_from_dict\n"
            "surface = surface_from_dict(json.load(sys.stdin))\n"
            f"print(repr(float(surface.duty({flow!r}, {pressure!r})[0])))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code],
            input=json.dumps(network.to_dict()).encode(),
            capture_output=True,
            check=True,
        )
        assert float(done.stdout) == pytest.approx(float(network.duty(flow, pressure)[0]), abs=1e-9)


class TestBipolynomialFit:
    def test_recovers_the_thesis_coefficients(self) -> None:
        duty, pressure = grid()
        surface = Bipolynomial().fit(np.column_stack((duty, pressure)), polynomial(duty, pressure))
        np.testing.assert_allclose(surface.coefficients_, TRUE, rtol=1e-9)
        assert surface.condition_ < 1e3
        np.testing.assert_allclose(
            surface.predict(np.column_stack((duty, pressure))),
            polynomial(duty, pressure),
            rtol=0,
            atol=1e-16,
        )

    def test_agrees_with_lstsq_on_weighted_data(self) -> None:
        rng = np.random.default_rng(3)
        duty, pressure = grid()
        std = rng.uniform(0.5e-5, 3e-5, len(duty))
        flow = polynomial(duty, pressure) + std * rng.standard_normal(len(duty))
        surface = Bipolynomial().fit(np.column_stack((duty, pressure)), flow, 1 / std**2)
        A = design(duty, pressure) / std[:, None]
        size = np.linalg.norm(A, axis=0)
        solution = np.linalg.lstsq(A / size, flow / std, rcond=None)[0] / size
        residual = flow / std - A @ solution
        variance = residual @ residual / (len(duty) - 9)
        covariance = np.linalg.inv((A / size).T @ (A / size)) * variance / np.outer(size, size)
        np.testing.assert_allclose(surface.coefficients_, solution, rtol=1e-7)
        np.testing.assert_allclose(surface.std_, np.sqrt(np.diag(covariance)), rtol=1e-6)

    @pytest.mark.parametrize("clustered", [False, True])
    def test_intervals_hold_the_truth_in_95_percent(self, clustered: bool) -> None:
        """300 repeats; with errors shared by a test only the cluster-robust ones are right."""
        rng = np.random.default_rng(11)
        duty, pressure = grid(30, 12)
        test = np.repeat(np.arange(30), 12)
        X, truth = np.column_stack((duty, pressure)), polynomial(duty, pressure)
        shape = np.vander(pressure / 1e5 - 2, 3)
        held = np.zeros(9)
        for _ in range(300):
            noise = rng.standard_normal(len(duty))
            if clustered:
                noise += 3 * (rng.standard_normal((30, 3))[test] * shape).sum(axis=1)
            fit = Bipolynomial().fit(X, truth + 1e-6 * noise, groups=test if clustered else None)
            held += (fit.interval_[:, 0] <= TRUE) & (fit.interval_[:, 1] >= TRUE)
        # Cluster-robust intervals are known to be a little short with 30 clusters.
        assert (0.88 if clustered else 0.93) < held.mean() / 300 < 0.97

    def test_zero_weight_is_as_if_left_out(self) -> None:
        rng = np.random.default_rng(5)
        duty, pressure = grid()
        flow = polynomial(duty, pressure) + 1e-5 * rng.standard_normal(len(duty))
        keep = rng.random(len(duty)) < 0.7
        domain = Domain.from_samples(duty, pressure, flow)
        X = np.column_stack((duty, pressure))
        weighted = Bipolynomial(domain).fit(X, flow, keep.astype(float))
        left_out = Bipolynomial(domain).fit(X[keep], flow[keep])
        np.testing.assert_allclose(weighted.coefficients_, left_out.coefficients_, rtol=1e-6)
        np.testing.assert_allclose(weighted.std_, left_out.std_, rtol=1e-6)

    def test_flow_rises_with_duty_where_least_squares_would_not(self) -> None:
        """Valve B's jump at the choked boundary bends nine terms below zero slope."""
        s = campaign(VALVE_B, "fill", step=0.05, seconds=0.5)
        X = np.column_stack((s.duty, s.pressure))
        free = Bipolynomial(monotone=False).fit(X, s.flow)
        held = Bipolynomial().fit(X, s.flow)
        duty, pressure = _inside(held.domain_)

        def slope(surface: Bipolynomial) -> np.ndarray:
            c2, c1, _ = surface.law.quadratic(pressure)
            return 2 * c2 * duty + c1

        assert slope(free).min() < 0 < slope(held).min()
        assert not free.constrained_
        assert held.constrained_
        assert free.rmse_flow_ < held.rmse_flow_ < 1.2 * free.rmse_flow_
        # Optimal: no feasible surface nearby lies downhill.
        inside = held.domain_.holds_duty(s.duty)
        A, m = design(*X[inside].T), s.flow[inside]
        size = np.linalg.norm(A, axis=0)
        best = float(np.sum((m - A @ held.coefficients_) ** 2))
        assert best == pytest.approx(held.rmse_flow_**2 * len(m), rel=1e-6)
        rng, tried = np.random.default_rng(0), 0
        for _ in range(2000):
            other = clone_with(held, held.coefficients_ + 1e-5 * rng.standard_normal(9) / size)
            if slope(other).min() >= slope(held).min() * (1 + 1e-9):
                tried += 1
                assert np.sum((m - A @ other.coefficients_) ** 2) >= best
        assert tried > 100

    def test_duty_and_pressure_are_saturated_and_flagged(self, fitted: Bipolynomial) -> None:
        top = fitted.domain_.duty_range[1]
        inside, flag = fitted.flow(top, 1.5e5)
        beyond, beyond_flag = fitted.flow(1.0, 1.5e5)
        assert beyond == inside
        assert flag == 0
        assert beyond_flag == Saturation.ABOVE
        low, low_flag = fitted.flow(0.5, 5e4)
        assert low == fitted.flow(0.5, fitted.domain_.pressure_range[0])[0]
        assert low_flag & Saturation.PRESSURE


class TestQuadraticInverse:
    def test_against_a_search_over_random_parabolas(self) -> None:
        rng = np.random.default_rng(0)
        n = 4000
        c2 = rng.normal(size=n) * 10.0 ** rng.uniform(-12, 1, n)
        c1, c0 = rng.normal(size=n), rng.normal(size=n)
        low, high = rng.uniform(0, 0.4, n), rng.uniform(0.6, 1, n)
        flow = c0 + rng.normal(size=n)
        u, reasons = invert_quadratic(c2, c1, c0, flow, low, high)
        flags = flags_of(reasons)
        assert ((u >= low) & (u <= high)).all()
        value = (c2 * u + c1) * u + c0
        solved = (flags & (Saturation.ABOVE | Saturation.BELOW)) == 0
        assert 200 < solved.sum() < n - 200
        np.testing.assert_allclose(value[solved], flow[solved], atol=1e-12)
        slope = 2 * c2 * u + c1
        rising = (flags & Saturation.DECREASING) == 0
        assert (slope[rising & solved] >= -1e-9).all()
        # What is called out of reach is out of reach of the stretch that was used.
        share = np.linspace(0, 1, 401)[:, None]
        grid_u = low + share * (high - low)
        reach = (c2 * grid_u + c1) * grid_u + c0
        on_stretch = np.where(rising, 2 * c2 * grid_u + c1 >= 0, True)
        top = np.where(on_stretch, reach, -np.inf).max(axis=0)
        above = (flags & Saturation.ABOVE) != 0
        assert (flow[above & rising] > top[above & rising]).all()
        no_root = (flags & Saturation.NO_ROOT) != 0
        assert ((c1**2 - 4 * c2 * (c0 - flow))[no_root] < 1e-12).all()
        assert no_root.sum() > 30

    @pytest.mark.parametrize(
        ("c2", "c1", "c0", "flow", "duty", "flag"),
        [
            (0.0, 2.0, 0.0, 1.0, 0.5, 0),  # C21 = 0: linear
            (1e-300, 2.0, 0.0, 1.0, 0.5, 0),  # C21 -> 0: the printed formula gives 0/0
            (1.0, 1.0, 0.0, 0.75, 0.5, 0),
            (-1.0, 2.0, 0.0, 0.75, 0.5, 0),  # the printed root is right here too
            (-1.0, 1.0, 0.0, 0.1, 0.1127016653792583, 0),
            (-1.0, 1.0, 0.0, 0.3, 0.5, Saturation.ABOVE | Saturation.NO_ROOT),  # D < 0
            (1.0, -1.0, 1.0, 0.5, 0.5, Saturation.BELOW | Saturation.NO_ROOT),
            (1.0, -1.0, 1.0, 0.84, 0.8, 0),  # the rising root of two in the domain
            (0.0, 2.0, 0.0, 5.0, 0.9, Saturation.ABOVE),
            (0.0, 2.0, 0.0, -5.0, 0.1, Saturation.BELOW),
            (0.0, -2.0, 2.0, 1.0, 0.5, Saturation.DECREASING),
            (-1.0, 0.0, 1.0, 0.75, 0.5, Saturation.DECREASING),
            (0.0, 0.0, 1.0, 1.0, 0.1, Saturation.DECREASING),  # flat: no duty is told apart
        ],
    )
    def test_branches(
        self, c2: float, c1: float, c0: float, flow: float, duty: float, flag: int
    ) -> None:
        args = [np.array([v]) for v in (c2, c1, c0, flow, 0.1, 0.9)]
        u, reasons = invert_quadratic(*args)
        flags = flags_of(reasons)
        assert u[0] == pytest.approx(duty, abs=1e-12)
        assert flags[0] == flag

    def test_iteration_finds_the_crossing_and_the_ends(self) -> None:
        target = np.array([-2.0, 0.0, 0.5, 2.0])
        low, high = np.full(4, -1.0), np.full(4, 1.0)
        x, reached, beneath = invert_rising(lambda v: (v**3, 3 * v**2), target, low, high)
        np.testing.assert_allclose(x, [-1.0, 0.0, 0.5 ** (1 / 3), 1.0], atol=1e-10)
        assert reached.tolist() == [True, True, True, False]
        assert beneath.tolist() == [True, False, False, False]


class TestRoundTrip:
    """duty -> flow -> duty inside the domain, within half a duty point."""

    @pytest.mark.parametrize("direction", ["fill", "discharge"])
    @pytest.mark.parametrize("valve", [VALVE_A, VALVE_B], ids=["A", "B"])
    def test_bipolynomial(self, valve: Valve, direction: str) -> None:
        s = campaign(valve, direction, step=0.05, seconds=0.5)
        surface = Bipolynomial().fit(np.column_stack((s.duty, s.pressure)), s.flow)
        duty, pressure = _inside(surface.domain_)
        flow, flags = surface.flow(duty, pressure)
        assert not flags.any()
        back, back_flags = surface.duty(flow, pressure)
        assert np.abs(back - duty).max() < 1e-9
        assert not (back_flags & Saturation.DECREASING).any()

    def test_network(self, network: DutyNetwork) -> None:
        duty, pressure = _inside(network.domain_)
        flow, flags = network.flow(duty, pressure)
        inside = flags == 0
        assert inside.mean() > 0.9
        back, _ = network.duty(flow, pressure)
        assert np.abs(back - duty)[inside].max() < 1e-6

    def test_flow_agrees_with_the_valve(self, network: DutyNetwork, fitted: Bipolynomial) -> None:
        duty, pressure = _inside(network.domain_)
        truth = VALVE_A.mean_flow(duty, pressure)
        there = truth > 2e-5  # filling
        error = [
            np.sqrt(np.mean((s.flow(duty, pressure)[0] - truth)[there] ** 2))
            for s in (network, fitted)
        ]
        assert error[0] < 0.05 * truth.max()
        assert error[0] < error[1]


def _inside(domain: Domain) -> tuple[np.ndarray, np.ndarray]:
    pressure = np.repeat(np.linspace(*domain.pressure_range, 41), 41)
    low, high = domain.duty_limits(pressure)
    duty = low + np.tile(np.linspace(0, 1, 41), 41) * (high - low)
    return duty, pressure


class TestDomain:
    def test_always_open_duties_are_left_out(self) -> None:
        """The delays keep the valve open from duty 0.94 on: 0.9501 cannot be told from 1."""
        s = campaign(VALVE_A, "fill", step=0.01, seconds=0.5)
        low, high = Domain.from_samples(s.duty, s.pressure, s.flow).duty_range
        assert low == pytest.approx(0.0001)
        assert 0.93 <= high <= 0.9401 + 1e-9

    @pytest.mark.parametrize("direction", ["fill", "discharge"])
    def test_vanishing_pulses_are_left_out(self, direction: str) -> None:
        """On 2.5 ms, off 2.0 ms: no flow below duty 0.1."""
        valve = replace(VALVE_A, on_delay=2.5e-3)
        s = campaign(valve, direction, step=0.02, seconds=0.5)
        low, high = Domain.from_samples(s.duty, s.pressure, s.flow).duty_range
        assert 0.08 <= low <= 0.1001 + 1e-9
        assert high > 0.8

    def test_hull_follows_the_equilibrium(self, filling: Samples) -> None:
        """A filling test stops where the mean flow is zero; higher pressures hold only
        higher duties."""
        domain = Domain.from_samples(filling.duty, filling.pressure, filling.flow)
        pressure = np.array([1.2e5, 1.6e5, 2.2e5])
        low, high = domain.duty_limits(pressure)
        # Open share at which fill and exhaust cancel, less the 0.06 that the delays add.
        fill, exhaust = VALVE_A.fill_flow(pressure), VALVE_A.exhaust_flow(pressure)
        equilibrium = exhaust / (fill + exhaust) - 0.06
        assert np.abs(low - np.maximum(equilibrium, 1e-4)).max() < 0.12
        assert (np.diff(low) > 0).all()
        assert (high > 0.9).all()

    def test_same_for_both_surfaces(self, fitted: Bipolynomial, network: DutyNetwork) -> None:
        assert fitted.domain_.to_dict() == network.domain_.to_dict()

    @pytest.mark.parametrize(
        ("change", "error", "word"),
        [
            (lambda u, p, m: (np.full_like(u, 0.5), p, m), NotIdentifiedError, "3 duties"),
            (lambda u, p, m: (u, np.full_like(p, 2e5), m), NotIdentifiedError, "pressure stays"),
            (lambda u, p, m: (u, p, -m), NotIdentifiedError, "does not grow"),
            (lambda u, p, m: (100 * u, p, m), InputError, "percent"),
            (lambda u, p, m: (u, p / 1e3, m), InputError, "Pa"),
            (lambda u, p, m: (u, p, np.where(u > 0.9, np.nan, m)), InputError, "not finite"),
            (lambda u, p, m: (u[:-1], p, m), InputError, "shapes"),
            (lambda u, p, m: (u[:0], p[:0], m[:0]), InputError, "none"),
        ],
    )
    def test_bad_samples_are_refused(self, change, error, word) -> None:  # type: ignore[no-untyped-def]
        duty, pressure = grid()
        samples = change(duty, pressure, polynomial(duty, pressure))
        with pytest.raises(error, match=word):
            Domain.from_samples(*samples)


class TestPoints:
    def test_cell_means_keep_the_surface_and_lower_the_noise(self, filling: Samples) -> None:
        points = surface_points(filling.duty, filling.pressure, filling.flow, filling.test)
        assert points.count.sum() == len(filling.duty)
        assert len(points.duty) <= 20 * 32
        truth = VALVE_A.mean_flow(points.duty, points.pressure)
        resting = points.count > 20
        assert resting.sum() > 10
        error = np.abs(points.flow - truth)[resting]
        raw = np.abs(filling.flow - VALVE_A.mean_flow(filling.duty, filling.pressure))
        assert np.median(error) < 0.5 * np.median(raw)
        assert np.isnan(points.std[points.count == 1]).all()

    def test_thinning_is_even_and_repeatable(self, filling: Samples) -> None:
        args = (filling.duty, filling.pressure, filling.flow)
        rows = thin_samples(*args, 500, seed=4)
        assert len(rows) == 500
        assert len(np.unique(rows)) == 500
        np.testing.assert_array_equal(rows, thin_samples(*args, 500, seed=4))
        spread = np.std(filling.flow[rows])
        assert spread > 1.2 * np.std(filling.flow)  # the rest at equilibrium no longer rules
        few = thin_samples(*args, 50)
        assert len(few) == 50


class TestNetwork:
    def test_jacobian_and_gradient_agree_with_differences(self) -> None:
        import torch

        from sysid.surfaces import network_training

        rng = np.random.default_rng(1)
        weights = torch.as_tensor(rng.normal(size=(3, 41)))
        data = network_training.Samples(
            torch.as_tensor(rng.uniform(-1, 1, (2, 30))),
            torch.as_tensor(rng.normal(size=30)),
            torch.as_tensor(rng.uniform(0.5, 2, 30)),
        )
        _, jacobian = network_training.jacobian(weights, data.x)
        _, gradient = network_training._loss_and_gradient(weights, data)
        for k in range(41):
            step = torch.zeros(41, dtype=torch.float64)
            step[k] = 1e-6
            ahead, behind = weights + step, weights - step
            slope = (
                network_training.outputs(ahead, data.x) - network_training.outputs(behind, data.x)
            ) / 2e-6
            torch.testing.assert_close(jacobian[:, k], slope, rtol=1e-6, atol=1e-8)
            fall = (
                network_training._squares(ahead, data) - network_training._squares(behind, data)
            ) / 4e-6
            torch.testing.assert_close(gradient[:, k], fall, rtol=1e-6, atol=1e-7)

    def test_recovers_a_network_of_its_own_size(self) -> None:
        """Data made by a 2-3-1 network are fitted all but exactly."""
        duty, pressure, flow = _teacher_samples()
        surface = DutyNetwork(hidden=3, restarts=20).fit(np.column_stack((flow, pressure)), duty)
        assert surface.rmse_ < 1e-3
        assert surface.n_parameters_ == 13

    def test_same_seed_same_network(self, filling: Samples) -> None:
        X = np.column_stack((filling.flow, filling.pressure))
        one, two = (
            DutyNetwork(restarts=4, max_iter=20, seed=7).fit(X, filling.duty) for _ in range(2)
        )
        assert one.to_dict() == two.to_dict()
        other = DutyNetwork(restarts=4, max_iter=20, seed=8).fit(X, filling.duty)
        assert other.restart_seeds_ != one.restart_seeds_
        assert len(set(one.restart_seeds_)) == 4

    def test_best_restart_on_held_out_tests_is_kept(
        self, network: DutyNetwork, filling: Samples
    ) -> None:
        assert len(network.restart_rmse_) == 20
        assert network.held_out_rmse_ == network.restart_rmse_.min()
        assert network.restart_rmse_.max() > network.restart_rmse_.min()
        held = np.isin(filling.test, network.held_out_groups_)
        inside = network.domain_.holds_duty(filling.duty)
        ends = filling.duty[inside].min(), filling.duty[inside].max()
        assert 0 < held[inside].mean() < 0.5
        assert not set(filling.duty[held]) & set(ends)

    def test_weights_count(self, filling: Samples) -> None:
        """Samples of no weight change nothing, however wrong they are."""
        X = np.column_stack((filling.flow, filling.pressure))
        wrong = filling.test == 8
        spoilt = np.where(wrong[:, None], X + np.array([4e-4, 0.0]), X)
        settings = {"restarts": 4, "max_iter": 30}
        domain = Domain.from_samples(filling.duty, filling.pressure, filling.flow)
        weight = np.where(wrong, 0.0, 1.0)
        one = DutyNetwork(domain=domain, **settings).fit(spoilt, filling.duty, weight)
        two = DutyNetwork(domain=domain, **settings).fit(X[~wrong], filling.duty[~wrong])
        np.testing.assert_allclose(one.hidden_weights_, two.hidden_weights_)

    def test_prediction_is_saturated_and_flagged(self, network: DutyNetwork) -> None:
        low, high = network.domain_.duty_range
        flow = np.array([1.0, -1.0, 3e-4, np.nan, 3e-4])
        pressure = np.array([1.5e5, 1.5e5, 1.2e5, 1.5e5, 1e6])
        duty, flags = network.duty(flow, pressure)
        assert flags[0] == Saturation.ABOVE
        assert flags[1] == Saturation.BELOW
        assert flags[2] == 0
        assert flags[3] == Saturation.INVALID
        assert np.isnan(duty[3])
        assert flags[4] & Saturation.PRESSURE
        finite = duty[np.isfinite(duty)]
        assert ((finite >= low) & (finite <= high)).all()

    def test_sweep_names_a_small_network(self) -> None:
        duty, pressure, flow = _teacher_samples()
        rng = np.random.default_rng(0)
        noisy = flow + 1e-6 * rng.standard_normal(len(flow))
        sweep = sweep_hidden_size(
            noisy, pressure, duty, sizes=(1, 3, 10), folds=2, restarts=10, max_iter=80
        )
        assert sweep.smallest == 3
        best = min(sweep.rmse)
        assert sweep.rmse[1] <= 1.1 * best < sweep.rmse[0]

    @pytest.mark.parametrize(
        ("settings", "word"), [({"hidden": 0}, "hidden"), ({"restarts": 0}, "restarts")]
    )
    def test_bad_settings_are_refused(self, settings, word, filling: Samples) -> None:  # type: ignore[no-untyped-def]
        X = np.column_stack((filling.flow, filling.pressure))
        with pytest.raises(InputError, match=word):
            DutyNetwork(**settings).fit(X, filling.duty)

    def test_too_few_samples_are_refused(self) -> None:
        duty, pressure = grid(8, 8)
        X = np.column_stack((polynomial(duty, pressure), pressure))
        with pytest.raises(NotIdentifiedError, match="41 weights"):
            DutyNetwork().fit(X, duty)


def _teacher_samples() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Duty, pressure, and the flow at which a fixed 2-3-1 network gives that duty."""
    duty, pressure = grid(25, 40)
    duty = 0.3 + 0.4 * duty

    def teacher(flow: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = flow / 4e-4 - 1, pressure / 1e5 - 2
        hidden = np.tanh([2.5 * x + 0.5 * y, x - 2 * y + 0.8, 0.7 * x + 1.5 * y - 0.6])
        weights = np.array([0.25, 0.08, 0.12])
        slope = weights * np.array([2.5, 1.0, 0.7]) / 4e-4
        return 0.5 + weights @ hidden, slope @ (1.0 - hidden**2)

    low, high = np.full_like(duty, -4e-4), np.full_like(duty, 1.6e-3)
    flow, reached, beneath = invert_rising(teacher, duty, low, high)
    assert reached.all() and not beneath.any()
    return duty, pressure, flow


class TestHoldOut:
    def test_every_inner_test_is_held_out_once(self) -> None:
        test = np.repeat([f"t{k}" for k in range(12)], 5)
        duty = np.repeat(np.linspace(0, 1, 12), 5)
        held = np.sum(group_folds(test, duty, 4, seed=1), axis=0)
        assert held.tolist() == [0] * 5 + [1] * 50 + [0] * 5
        for fold in group_folds(test, duty, 4, seed=1):
            assert all(len(set(fold[test == t])) == 1 for t in set(test))

    def test_too_few_tests_are_refused(self) -> None:
        test, duty = np.repeat(np.arange(4), 3), np.repeat(np.linspace(0, 1, 4), 3)
        with pytest.raises(InputError, match="folds"):
            group_folds(test, duty, 4, seed=0)
        with pytest.raises(InputError, match="hold out"):
            hold_out_groups(test[:6], duty[:6], 0.2, seed=0)


class TestScikitLearn:
    def test_clone_keeps_parameters_and_forgets_the_fit(
        self, network: DutyNetwork, fitted: Bipolynomial
    ) -> None:
        from sklearn.base import clone, is_regressor

        for surface in (DutyNetwork(hidden=4, seed=9), network, Bipolynomial(fitted.domain_)):
            copy = clone(surface)
            assert not hasattr(copy, "domain_")
            assert copy.get_params().keys() == surface.get_params().keys()
            assert is_regressor(copy)
        assert clone(DutyNetwork(hidden=4, seed=9)).get_params()["hidden"] == 4
        assert repr(DutyNetwork(hidden=4)) == "DutyNetwork(hidden=4)"
        with pytest.raises(ValueError, match="not a parameter"):
            DutyNetwork().set_params(neurons=3)

    def test_cross_validation_by_test(self, filling: Samples) -> None:
        from sklearn.model_selection import GroupKFold, cross_val_score

        X = np.column_stack((filling.duty, filling.pressure))
        scores = cross_val_score(
            Bipolynomial(), X, filling.flow, groups=filling.test, cv=GroupKFold(4)
        )
        assert (scores > 0.8).all()
        domain = Domain.from_samples(filling.duty, filling.pressure, filling.flow)
        inverse = np.column_stack((filling.flow, filling.pressure))
        estimator = DutyNetwork(restarts=5, max_iter=40, domain=domain)
        scores = cross_val_score(
            estimator, inverse, filling.duty, groups=filling.test, cv=GroupKFold(2)
        )
        assert (scores > 0.9).all()

    def test_grid_search_over_hidden_size(self, filling: Samples) -> None:
        from sklearn.model_selection import GridSearchCV, GroupKFold

        X = np.column_stack((filling.flow, filling.pressure))
        search = GridSearchCV(
            DutyNetwork(restarts=3, max_iter=30), {"hidden": [1, 6]}, cv=GroupKFold(2)
        )
        search.fit(X, filling.duty, groups=filling.test)
        assert search.best_params_["hidden"] == 6

    def test_score_is_r2(self, fitted: Bipolynomial, filling: Samples) -> None:
        from sklearn.metrics import r2_score

        X = np.column_stack((filling.duty, filling.pressure))
        weight = np.linspace(0, 1, len(X))
        expected = r2_score(filling.flow, fitted.predict(X), sample_weight=weight)
        assert fitted.score(X, filling.flow, weight) == pytest.approx(expected)

    def test_unfitted_says_so(self) -> None:
        with pytest.raises(InputError, match="not been fitted"):
            DutyNetwork().predict([[1e-4, 2e5]])


class TestDict:
    def test_round_trip_predicts_the_same(
        self, fitted: Bipolynomial, network: DutyNetwork, filling: Samples
    ) -> None:
        for surface in (fitted, network):
            text = json.dumps(surface.to_dict(), allow_nan=False)
            read = surface_from_dict(json.loads(text))
            for name, first in (("flow", filling.duty), ("duty", filling.flow)):
                values, flags = getattr(read, name)(first, filling.pressure)
                expected, expected_flags = getattr(surface, name)(first, filling.pressure)
                np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-12)
                np.testing.assert_array_equal(flags, expected_flags)

    def test_numbers_carry_value_std_and_unit(
        self, fitted: Bipolynomial, network: DutyNetwork
    ) -> None:
        terms = fitted.to_dict()["coefficients"]
        assert len(terms) == 9
        assert terms[4]["term"] == "u^1 P^1"
        assert terms[4]["unit"] == "kg/(s Pa^1)"
        assert terms[4]["interval"][0] < terms[4]["value"] < terms[4]["interval"][1]
        content = network.to_dict()
        weights = [content[k]["value"] for k in ("hidden_weights", "hidden_bias")]
        assert np.shape(weights[0]) == (10, 2)
        assert np.shape(weights[1]) == (10,)

    def test_a_missing_key_is_named(self, fitted: Bipolynomial, network: DutyNetwork) -> None:
        for surface, key in ((fitted, "scaling"), (network, "output_bias"), (network, "domain")):
            content = surface.to_dict()
            del content[key]
            with pytest.raises(InputError, match=key):
                surface_from_dict(content)
        with pytest.raises(InputError, match="kind"):
            surface_from_dict({"kind": "spline"})
        content = fitted.to_dict()
        content["coefficients"] = content["coefficients"][:8]
        with pytest.raises(InputError, match="8 coefficients"):
            surface_from_dict(content)


class TestComparison:
    @pytest.mark.parametrize("direction", ["fill", "discharge"])
    @pytest.mark.parametrize("valve", [VALVE_A, VALVE_B], ids=["A", "B"])
    def test_network_has_at_most_0_4_of_the_error(self, valve: Valve, direction: str) -> None:
        s = campaign(valve, direction)
        found = compare_surfaces(s.duty, s.pressure, s.flow, s.test, folds=3)
        assert found.ratio <= 0.4
        assert found.network.rmse <= 0.025
        assert found.recommended == "ann"
        assert found.bipolynomial.n_points == found.network.n_points
        json.dumps(found.to_dict(), allow_nan=False)

    @pytest.mark.parametrize("rate", [250, 300])
    def test_at_other_pwm_rates(self, rate: int) -> None:
        s = campaign(replace(VALVE_A, period=1 / rate), "discharge")
        found = compare_surfaces(s.duty, s.pressure, s.flow, s.test, folds=3)
        assert found.ratio <= 0.4
        assert found.network.rmse <= 0.025

    def test_errors_by_hand(self) -> None:
        u = np.array([0.0, 0.001, 0.5, 0.8])
        fit = np.array([0.01, 0.003, 0.45, 0.8])
        error = duty_errors(fit, u, np.full(4, 2e5), np.arange(4) * 1e-4, 9)
        assert error.rmse == pytest.approx(np.sqrt((1e-4 + 4e-6 + 25e-4) / 4))
        assert error.max_relative_error_percent == pytest.approx(200.0)
        assert error.worst.duty == 0.001
        assert error.worst.flow_kg_s == 1e-4
        assert error.max_error_points == pytest.approx(5.0)

    def test_recommendation_has_a_reason(self) -> None:
        def errors(scale: float, size: int):  # type: ignore[no-untyped-def]
            u = np.linspace(0.1, 0.9, 50)
            off = scale * np.resize([1.0, -1.0], 50)
            return duty_errors(u + off, u, np.full(50, 2e5), u, size)

        assert recommend(errors(0.04, 9), errors(0.01, 41), 0.005)[0] == "ann"
        choice, why = recommend(errors(0.04, 9), errors(0.035, 41), 0.005)
        assert choice == "bipolynomial"
        assert "quarter" in why
        assert recommend(errors(0.004, 9), errors(0.001, 41), float("nan"))[0] == "bipolynomial"
        choice, why = recommend(errors(0.02, 9), errors(0.01, 41), 0.02)
        assert choice == "bipolynomial"
        assert "noise" in why
        # In points, as the tables next to it.
        assert "1.00 points of duty" in why and "noise level, 2.00 points" in why

    def test_polynomial_data_need_no_network(self) -> None:
        duty, pressure = grid(20, 60)
        flow = polynomial(duty, pressure) + 1e-7 * np.random.default_rng(0).standard_normal(1200)
        quick = DutyNetwork(hidden=4, restarts=4, max_iter=40)
        found = compare_surfaces(duty, pressure, flow, folds=2, network=quick)
        assert found.recommended == "bipolynomial"
        assert found.network.n_parameters == 17

    def test_resolution_study(self) -> None:
        """The highest duty that a step reaches sets the flow (Table 3.7.1)."""
        s = campaign(VALVE_A, "fill", step=0.05, noise=50.0, seconds=0.4)
        study = resolution_study(s.duty, s.pressure, s.flow)
        assert study.steps[0] == pytest.approx(0.05)
        assert study.tests[0] == 20
        reached = np.array([0.0001 + 0.95 // (k * 0.05 - 1e-9) * k * 0.05 for k in range(1, 7)])
        expected = VALVE_A.choked_fill * np.minimum(1, reached + 0.06)
        expected -= 0.5 * (1 - np.minimum(1, reached + 0.06)) * VALVE_A.c_dis * ATMOSPHERE
        np.testing.assert_allclose(study.max_flow, expected[: len(study.steps)], rtol=0.06)
        assert study.coarsest in study.steps
        with pytest.raises(NotIdentifiedError, match="unevenly"):
            resolution_study(s.duty**2, s.pressure, s.flow)
