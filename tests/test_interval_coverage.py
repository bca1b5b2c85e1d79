"""How often intervals hold the truth: a short run of `benchmarks/interval_coverage.py`.

Bands are the share asked there, 92 to 98 %, and four standard errors of the run's own length.
"""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from scipy import linalg, signal

from benchmarks.interval_coverage import (
    ASKED,
    CLUSTERS,
    CORRELATIONS,
    REGRESSORS,
    cluster_coverage,
    cluster_fit,
    first_order,
    linear_coverage,
)
from sysid.estimation.autocovariance import correlated_covariance, error_model
from sysid.estimation.autoregression import Autoregression
from sysid.estimation.linear import linear_fit
from sysid.types import FloatArray


def in_band(shares: FloatArray, draws: int) -> bool:
    slack = 4.0 * math.sqrt(0.95 * 0.05 / draws)
    return bool(np.all((shares > ASKED[0] - slack) & (shares < ASKED[1] + slack)))


@pytest.mark.parametrize("correlation", CORRELATIONS)
@pytest.mark.parametrize("regressor", ["persistent", "ramp"])
def test_intervals_hold_for_errors_that_follow_one_another(
    regressor: str, correlation: float
) -> None:
    rng = np.random.default_rng(11)
    plain, correlated = linear_coverage(rng, 200, correlation, REGRESSORS[regressor], 300)
    assert in_band(correlated, 300)
    assert correlation < 0.9 or plain[0] < 0.6


@pytest.mark.parametrize("tests", CLUSTERS)
def test_a_jackknife_over_few_tests_has_their_number_of_degrees_of_freedom(tests: int) -> None:
    held = cluster_coverage(np.random.default_rng(12), tests, False, 200)
    assert in_band(held[2:], 200)
    fit, labels = cluster_fit(np.random.default_rng(13), [40] * tests)
    low, high = fit.estimate("gain", fit.jackknife_covariance(labels)).interval
    from scipy.stats import t

    std = math.sqrt(fit.jackknife_covariance(labels).matrix[0, 0])
    assert high - low == pytest.approx(2.0 * t.ppf(0.975, tests - 1) * std)


def test_one_test_gives_no_interval_of_a_scatter_between_tests() -> None:
    fit, labels = cluster_fit(np.random.default_rng(14), [40])
    assert fit.estimate("gain", fit.jackknife_covariance(labels)).interval == (-math.inf, math.inf)


def test_errors_that_a_zero_phase_filter_made() -> None:
    """Their autocovariance is singular but for rounding, and far from any autoregression's."""
    rng, held = np.random.default_rng(15), np.zeros(2)
    filtering = signal.butter(2, 50.0, fs=1000.0)
    x = np.column_stack([np.ones(1000), np.linspace(-1.0, 1.0, 1000)])
    for _ in range(150):
        noise = signal.filtfilt(*filtering, rng.standard_normal(1400))[200:-200]
        fit = linear_fit(x, noise)
        found = fit.correlated_covariance()
        quantile = [_quantile(dof) for dof in found.dof]
        held += np.abs(fit.coefficients) <= quantile * np.sqrt(np.diag(found.matrix))
    assert in_band(held / 150, 150)


def test_errors_that_alternate_do_not_make_a_mean_surer() -> None:
    noise = first_order(np.random.default_rng(16), 500, -0.8)
    fit = linear_fit(np.ones((500, 1)), noise)
    found = float(fit.correlated_covariance().matrix[0, 0])
    assert found / fit.covariance[0, 0] == pytest.approx(1.0, rel=0.05)


def test_independent_samples_of_persistent_errors() -> None:
    """(1 + r)/(1 - r) samples count for one in a long run; two short ones count for two."""
    shown = np.array([1.0, 0.8])
    model = Autoregression(np.array([0.8]), 0.36, shown)
    assert model.independent_samples([5000]) == pytest.approx(5000 / 9.0, rel=0.01)
    assert model.independent_samples([2, 2]) == pytest.approx(2.0 * 2.0 / 1.8)
    assert model.independent_samples([1, 1, 1]) == 3.0


def test_covariance_is_the_one_of_the_model_written_out() -> None:
    """U X' Omega X U with a Toeplitz block for each run, against the transforms."""
    rng = np.random.default_rng(17)
    groups = np.repeat(np.arange(3), [40, 25, 61])
    x = rng.standard_normal((126, 4))
    x[:, 3] = groups == 1
    noise = np.concatenate([first_order(rng, n, 0.7) for n in (40, 25, 61)])
    fit = linear_fit(x, noise)
    gamma = error_model(x, fit.residuals, groups).autocovariance(126)
    apart = groups[:, None] != groups[None, :]
    omega = np.where(apart, 0.0, linalg.toeplitz(gamma))
    expected = fit.influence @ omega @ fit.influence.T
    np.testing.assert_allclose(fit.correlated_covariance(groups).matrix, expected, rtol=1e-10)


def test_runs_of_one_model_are_told_from_one_another() -> None:
    """Twenty short runs, each with an offset of its own to be fitted: errors of 0.9."""
    rng, held = np.random.default_rng(18), np.zeros(2)
    groups = np.repeat(np.arange(20), 50)
    t = np.tile(np.linspace(0.0, 1.0, 50), 20)
    x = np.column_stack([np.exp(-3.0 * t), t, groups[:, None] == np.arange(20)])
    for _ in range(80):
        fit = linear_fit(x, np.concatenate([first_order(rng, 50, 0.9) for _ in range(20)]))
        found = fit.correlated_covariance(groups)
        quantile = [_quantile(dof) for dof in found.dof[:2]]
        held += np.abs(fit.coefficients[:2]) <= quantile * np.sqrt(np.diag(found.matrix))[:2]
    assert in_band(held / 80, 80)


@pytest.mark.parametrize("rows, columns", [(1, 1), (3, 3), (4, 3), (6, 1), (20, 18)])
def test_few_rows_give_wide_intervals_not_errors(rows: int, columns: int) -> None:
    rng = np.random.default_rng(19)
    x, r = rng.standard_normal((rows, columns)), rng.standard_normal(rows)
    found = correlated_covariance(x, r, np.linalg.inv(x.T @ x), np.arange(rows) // 2)
    assert np.all(found.dof <= rows - columns)
    assert np.all(np.diag(found.matrix) > 0.0)
    assert (rows > columns) == bool(np.all(np.isfinite(found.matrix)))


def test_a_perfect_fit_has_no_error() -> None:
    found = correlated_covariance(np.ones((50, 1)), np.zeros(50), np.array([[0.02]]))
    assert found.std(0) == 0.0


def test_a_long_log_takes_no_time() -> None:
    rng = np.random.default_rng(20)
    x = np.column_stack([np.ones(100_000), rng.standard_normal((100_000, 9))])
    noise = first_order(rng, 100_000, 0.5)
    began = time.process_time()
    correlated_covariance(x, noise, np.linalg.inv(x.T @ x))
    assert time.process_time() - began < 1.0


def _quantile(dof: float) -> float:
    from sysid.estimation.linear import t_quantile

    return t_quantile(float(dof))
